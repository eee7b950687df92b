"""What a crate is made from: a finished result folder, and the study and the cohort that its results are of."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sinew.runner.errors import BadInput, SinewError
from sinew.tasks.data.cohort import Cohort
from sinew.tasks.report.folder import ResultFolder, read_folder
from sinew.tasks.simulate.registry import kinds
from sinew.tasks.study.cohort import cohort_of
from sinew.tasks.study.files import digest
from sinew.tasks.study.own_template import template_hash
from sinew.tasks.study.provenance import identities
from sinew.tasks.study.study import Study, read_study

#: of a run: what its numbers depend on, beside versions
SAME = ("study_hash", "template_hash", "cohort_hash", "seed", "simulator")


@dataclass(frozen=True)
class Source:
    """A result folder, what its log says of its ``run``, and the study and its cohort as they were then."""

    found: ResultFolder
    run: Mapping[str, Any]
    study: Study
    cohort: Cohort

    @property
    def cohort_folder(self) -> Path | None:
        """The folder of the measured curves; None for a study that describes its own protocols."""
        return None if self.cohort.folder == self.study.path else self.cohort.folder


def read_source(folder: Path, study: Path | None = None, data: Path | None = None) -> Source:
    """Read all of it, and check that it belongs together.

    ``study`` and ``data`` are where the study file and the cohort lie now, by default where the log says. Raises
    :class:`BadInput` for a folder whose results are of several studies, and for a study, a template or a cohort that is
    not the one of the results; ``SinewError`` for a damaged folder.
    """
    found = read_folder(folder)
    if found.trouble:
        raise SinewError(found.trouble[0])
    if found.status is not None and found.status["now"] is not None and found.status["now"]["alive"]:
        raise BadInput(folder, "a run is writing to it", "a folder whose run is over")
    if not found.results:
        raise BadInput(folder, "holds no result", "a folder with at least one finished task")
    run = _last_run(found)
    path = study or Path(_text(found, run, "study_file", "--study STUDY"))
    read = read_study(path, seed=run["seed"])
    if digest(read.text) != run.get("study_hash"):
        raise BadInput(path, "is not the study file of these results", "the same bytes (--study), or a new `sinew run`")
    if (its := template_hash(read, run["simulator"])) != (run.get("template_hash") or ""):
        problem = "is not the template of these results, or a file that it includes is not"
        if its and not run.get("template_hash"):
            problem = "may be another template than that of these results: the log does not say which"
        raise BadInput(path.parent / str(read.simulator.own_template), problem, "the same bytes, or a new `sinew run`")
    cohort = cohort_of(read, data or _cohort(run))
    if digest(identities(cohort.specimens)) != run.get("cohort_hash"):
        raise BadInput(cohort.folder, "is not the cohort of these results", "the same curves (--data), or a new run")
    return Source(found, run, read, cohort)


def _last_run(found: ResultFolder) -> Mapping[str, Any]:
    """The last run of the log, if all results are of the same study, data, seed and simulator."""
    made: dict[str, Mapping[str, Any]] = {}
    run: Mapping[str, Any] | None = None
    for event in found.events:
        if event["message"] == "run started":
            run = event
        elif (
            event["message"] == "task finished"
            and run is not None
            and (task := str(event.get("task"))) in found.results
        ):
            made.pop(task, None)  # the last one to finish comes last
            made[task] = run
    log = found.folder / "log.jsonl"
    for task in found.results:
        if task not in made:
            raise BadInput(log, f"does not say which run made {task}.json", "the whole log, or a new `sinew run`")
    last = list(made.values())[-1]
    for task, one in made.items():
        for name in SAME:
            if (one.get(name) or "") != (last.get(name) or ""):  # older logs do not name the template
                problem = f"{task}.json is of a run with another {name.removesuffix('_hash')} than the last one"
                raise BadInput(found.folder, problem, "results of one study; run it once more")
    seed = last.get("seed")
    if not isinstance(seed, int) or isinstance(seed, bool) or not 0 <= seed < 2**32:
        raise BadInput(f"{log}: seed", repr(seed)[:40], "the seed of the run")
    if str(last.get("simulator")) not in kinds():
        raise BadInput(f"{log}: simulator", repr(last.get("simulator"))[:40], f"one of {', '.join(kinds())}")
    return last


def _text(found: ResultFolder, run: Mapping[str, Any], name: str, instead: str) -> str:
    value = run.get(name)
    if not isinstance(value, str) or not value:
        raise BadInput(f"{found.folder / 'log.jsonl'}: {name}", "missing", instead)
    return value


def _cohort(run: Mapping[str, Any]) -> Path | None:
    value = run.get("cohort")
    return Path(value) if isinstance(value, str) and value else None
