"""Cohorts with known answers, each run blind by `sinew discover`, and scored when all of them are through.

A run gets the case's folder and a study, nothing else. It leaves in ``OUT/FOLDER/CASE`` what `sinew discover`
leaves, ``study.yaml``, and ``case.json`` with what the verdict depends on: a case with a verdict for the same inputs
is not run again. One that fails is a line of the result.
"""

import hashlib
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from sinew.runner.errors import BadInput, shown
from sinew.runner.files import in_megabytes
from sinew.tasks.benchmark.answers import Answer, read_answers
from sinew.tasks.benchmark.blind import refuse_strange, run_blind
from sinew.tasks.benchmark.score import Case, Median, Share, class_of, coverage, medians, outcome_of, shares
from sinew.tasks.benchmark.selectors import Selected, compare
from sinew.tasks.discover.result import COPY, DiscoverResult
from sinew.tasks.report.status import is_seconds
from sinew.tasks.study.files import digest, read_json, write_json, write_text
from sinew.tasks.study.own_template import template_texts
from sinew.tasks.study.resources import resource
from sinew.tasks.study.settings_file import as_yaml, from_yaml
from sinew.tasks.study.study import read_study
from sinew.tasks.study.workspace import check_folder

STUDY = "configs/discover.yaml"
LOGGED = "case.json"
MAX_BYTES = 2**28  # of a file of a case

Say = Callable[[str], None]


@dataclass(frozen=True)
class Run:
    """What became of a case. ``seconds``: None where a part of the work was done before."""

    seconds: float | None
    error: str | None
    mixed: bool


def benchmark(
    folders: Sequence[Path],
    out: Path,
    *,
    study: Path | None = None,
    workers: int | None = None,
    only: Sequence[str] = (),
    say: Say = lambda line: None,
) -> dict[str, Any]:
    """Run all cases of ``folders`` that have no verdict yet, and score all. Returns ``benchmark.json``.

    ``only``: names of cases, with or without their folder's. Raises :class:`BadInput` for folders, answers and studies
    that cannot be used, before any case is run.
    """
    answers = _chosen(_answers(folders), only)
    base, template = _base(study or resource(STUDY))
    check_folder(out)
    refuse_strange(out)
    for folder in folders:
        if out.resolve().is_relative_to(folder.resolve()):
            raise BadInput(f"--out {out}", f"lies inside {folder}", "a folder beside it")
    places = {folder.resolve().name: folder.resolve() for folder in folders}
    runs = []
    for number, answer in enumerate(answers, 1):
        run = run_case(places[answer.folder] / answer.case, out / answer.folder / answer.case, base, template, workers)
        runs.append(run)
        say(f"{number} of {len(answers)}  {answer.name}: {_said(out / answer.folder / answer.case, run)}")
    cases = [
        Case(answer, None if run.error else _verdict(out / answer.folder / answer.case), run.seconds, run.error)
        for answer, run in zip(answers, runs, strict=True)
    ]
    result = result_of(cases, mixed=sum(run.mixed for run in runs))
    write_json(out / "benchmark.json", result)
    return result


def _answers(folders: Sequence[Path]) -> list[Answer]:
    if not folders:
        raise BadInput("FOLDER", "missing", "folders with answers.json and case folders")
    names = [folder.resolve().name for folder in folders]
    for name in names:
        if names.count(name) > 1:
            raise BadInput("FOLDER", f"two folders are called {shown(name)}", "folders of different names")
    return [answer for folder in folders for answer in read_answers(folder)]


def _chosen(answers: Sequence[Answer], only: Sequence[str]) -> list[Answer]:
    for name in only:
        if not any(name in (answer.case, answer.name) for answer in answers):
            raise BadInput("--only", f"no case {shown(name)}", "names such as case_01 or FOLDER/case_01")
    return [answer for answer in answers if not only or answer.case in only or answer.name in only]


def _base(path: Path) -> tuple[dict[str, Any], dict[str, str]]:
    """The settings of a study as they are written, once it is known that they are right; the files of its template.

    These by their paths as seen from the study.
    """
    study = read_study(path)
    if study.model.effects:
        raise BadInput(f"{path}: model.effects", "is not empty", "a model without effects to begin with")
    folder = PurePosixPath(study.simulator.own_template or "").parent
    template = {str(folder / name): text for name, text in template_texts(study).items()}
    return from_yaml(path.read_text("utf-8")), template


def run_case(cohort: Path, out: Path, base: dict[str, Any], template: dict[str, str], workers: int | None) -> Run:
    """See to it that a case has a verdict, from its cohort alone. ``template``: texts of files beside the study."""
    settings = {**(base.get("discover") or {}), "laws": False}  # a law changes no verdict
    text = as_yaml({**base, "cohort": str(cohort), "tasks": ["discover"], "discover": settings})
    inputs, method = digest(_files(cohort), text, *([template] if template else [])), digest(DiscoverResult.versions())
    before = read_json(out / LOGGED) or {}
    listed = before.get("codes")
    codes = [one for one in listed if isinstance(one, str)] if isinstance(listed, list) else []
    verdict = out / COPY
    if before.get("inputs") == inputs and codes[-1:] == [method] and before.get("finished") and verdict.is_file():
        took = before.get("seconds")
        return Run(took if is_seconds(took) else None, None, len(codes) > 1)
    out.mkdir(parents=True, exist_ok=True)
    verdict.unlink(missing_ok=True)
    fresh = not (out / "discover").exists()
    codes = [method] if fresh else [*dict.fromkeys(one for one in codes if one != method), method]
    logged = {"inputs": inputs, "codes": codes, "finished": False}
    write_json(out / LOGGED, logged)
    write_text(out / "study.yaml", text)
    for name, content in template.items():
        (out / name).parent.mkdir(parents=True, exist_ok=True)
        write_text(out / name, content)
    started = time.monotonic()
    read = read_study(out / "study.yaml")
    error = run_blind(read, read.tasks, out, workers, lambda *_: None)
    seconds = time.monotonic() - started if fresh and error is None else None
    write_json(out / LOGGED, {**logged, "finished": error is None, "seconds": seconds, "error": error})
    return Run(seconds, error, len(codes) > 1)


def _files(folder: Path) -> list[list[str]]:
    """Names and hashes of all files below a folder.

    Raises :class:`BadInput` for links, pipes and devices in it, and for files larger than any of a case.
    """
    refuse_strange(folder)
    found = []
    for path in sorted(path for path in folder.rglob("*") if path.is_file()):
        if (size := path.stat().st_size) > MAX_BYTES:
            raise BadInput(path, in_megabytes(size), f"files of at most {in_megabytes(MAX_BYTES)} in a case")
        with path.open("rb") as file:
            hashed = hashlib.file_digest(file, "blake2b").hexdigest()[:32]
        found.append([str(path.relative_to(folder)), hashed])
    return found


def _verdict(out: Path) -> DiscoverResult:
    """What a discovery left. Raises :class:`BadInput` when it cannot be read."""
    found = DiscoverResult.read(out)
    if found is None:
        raise BadInput(DiscoverResult.path(out), "is not there", "a verdict that `sinew discover` wrote")
    return found


def _said(out: Path, run: Run) -> str:
    """A verdict in a few words; the truth is not known yet."""
    if run.error:
        return f"failed: {run.error}"
    seconds = "" if run.seconds is None else f" ({run.seconds:.0f} s)"
    return _verdict(out).headline + seconds


def result_of(cases: Sequence[Case], mixed: int = 0) -> dict[str, Any]:
    """``benchmark.json``. ``mixed``: how many cases hold fits that another version of the program made."""
    counted = shares(cases)
    return {
        "cases": [_case(case) for case in cases],
        "classes": _counts([class_of(case) for case in cases]),
        "outcomes": _counts([outcome_of(case) for case in cases]),
        "shares": [_share(row) for row in counted],
        "medians": [_median(row) for row in medians(cases)],
        "selectors": [_selected(row) for row in compare(cases)],
        "mixed": mixed,
    }


def _counts(words: Sequence[str]) -> dict[str, int]:
    return {word: words.count(word) for word in dict.fromkeys(sorted(words))}


def _case(case: Case) -> dict[str, Any]:
    result = case.result
    held = coverage([case])
    return {
        "name": case.answer.name,
        "label": case.answer.label,
        "truth": list(case.answer.truth),
        "class": class_of(case),
        "verdict": result.verdict if result else None,
        "effects": list(result.effects) if result else [],
        "set": list(result.set) if result else [],
        "outcome": outcome_of(case),
        "closed": result.gap.closed if result else None,
        "misfit": result.null.loss - result.null.floor if result else None,
        "intervals": {"hold": held.count, "of": held.of},
        "seconds": case.seconds,
        "error": case.error,
    }


def _share(row: Share) -> dict[str, Any]:
    return {"name": row.name, "count": row.count, "of": row.of, "share": row.share, "interval": row.interval,
            "good": "high" if row.high else "low"}  # fmt: skip


def _median(row: Median) -> dict[str, Any]:
    return {"name": row.name, "unit": row.unit, "median": row.median, "interval": row.interval, "range": row.range,
            "of": len(row.values)}  # fmt: skip


def _selected(row: Selected) -> dict[str, Any]:
    return {"name": row.name, "right": _share(row.right), "wrong": _share(row.wrong), "alarms": _share(row.alarms)}
