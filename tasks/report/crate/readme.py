"""README.md of a crate: what is in it, and the commands that make its results again."""

import shlex
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from sinew.runner.errors import one_line
from sinew.tasks.discover.result import ADOPTED, DiscoverResult
from sinew.tasks.registry import TASKS
from sinew.tasks.report.crate import environment
from sinew.tasks.report.crate.layout import Layout, changed_fields
from sinew.tasks.report.crate.source import Source
from sinew.tasks.simulate.febio.settings import FEBIO, SolverSettings
from sinew.tasks.study.files import as_bytes

OF_SOBOL = {name for name, task in TASKS.items() if task.needs == "sobol"}
CHANGES = {
    "cohort": "the path of the cohort", "seed": "the seed that the run was given",
    "simulator": "the simulator that the run was given", "cluster": "this machine in place of a cluster",
}  # fmt: skip


def readme(source: Source, layout: Layout, *, store: bool) -> bytes:
    """The page, in Markdown."""
    lines = [
        f"# {source.study.name}",
        "A study made with sinew, as an RO-Crate: measured data, study, results and environment.",
        "",
        "| what | where |",
        "|---|---|",
        f"| study file | `{layout.study}` |",
    ]
    lines += [f"| measured curves | `{layout.cohort}` |"] if layout.cohort is not None else []
    lines += [
        f"| results, `report.html` and figures | `{layout.results}` |",
        "| numbers of each result as CSV | `tables` |",
        "| words for a methods section, with references | `METHODS.md` |",
        "| versions | `environment/environment.json`, `environment/requirements.txt` |",
        "| description of all files (JSON-LD) | `ro-crate-metadata.json` |",
        "",
        "Check that no file has changed:",
        "```sh",
        "sha256sum -c --quiet sha256sums.txt",
        "```",
        "## Run it again",
        f"{_needs(source)} In this folder:",
        "```sh",
        "pip install -r environment/requirements.txt",
        environment.install(source),
        "```",
        "```sh",
        *commands(source, layout),
        "```",
        "With the same versions, the results that are compared have the same bytes.",
        "",
        *_remarks(source, layout, store=store),
    ]
    return as_bytes("\n".join(lines).rstrip() + "\n")


def commands(source: Source, layout: Layout) -> list[str]:
    """What repeats the runs in their order, and compares the results."""
    study, first, again = (shlex.quote(str(path)) for path in (layout.study, layout.results, layout.again))
    solver = f" --solver {FEBIO}" if _own_solver(source) else ""
    done = []
    for words in _order(source):
        command, _, flag = words.partition(" ")
        done.append(f"sinew {command} {study} --out {again}{solver}{f' {flag}' if flag else ''}")
    return done + [f"cmp {first}/{task}.json {again}/{task}.json" for task in compared(source, layout)]


def adopted(source: Source) -> list[str]:
    """The results of the model with the named effect, as paths in the result folder without their suffix."""
    return [f"{ADOPTED}/{task}" for task in TASKS if (source.found.folder / ADOPTED / f"{task}.json").is_file()]


def compared(source: Source, layout: Layout) -> list[str]:
    """The results that a repetition makes with the same bytes."""
    discovery = source.found.result(DiscoverResult)
    moved = not layout.kept and discovery is not None and discovery.model is not None
    return [task for task in source.found.results if not (moved and task == "discover")] + adopted(source)


def _order(source: Source) -> Iterator[str]:
    """Commands in the order of the runs: a search may begin with the rows that earlier tasks left."""
    had: set[str] = set()
    last: int | None = None
    adopt = " --adopt" if adopted(source) else ""
    for tasks, base in _runs(source.found.events):
        grown = 0 if base is None or last is None else base - last
        had -= OF_SOBOL if grown else set()
        new = [task for task in tasks if task in source.found.results and task not in had]
        had |= set(new)
        if new and tasks == source.study.tasks:
            yield f"run{adopt}"
        elif grown:
            yield "sobol --extend" if grown > 0 else "sobol"
            yield from (task for task in new if task != "sobol")
        else:
            yield from new
        last = last if base is None else base


def _runs(events: Iterable[Mapping[str, Any]]) -> Iterator[tuple[list[str], int | None]]:
    """The tasks of each run, and the base samples of its Sobol study, if it made one."""
    tasks: list[str] | None = None
    base: int | None = None
    for event in [*events, {"message": "run started"}]:
        if event["message"] == "run started":
            if tasks is not None:
                yield tasks, base
            told, base = event.get("tasks"), None
            tasks = list(map(str, told)) if isinstance(told, list) else []
        elif event["message"] == "sobol" and isinstance(event.get("base_samples"), int):
            base = event["base_samples"]


def _own_solver(source: Source) -> bool:
    settings = source.study.simulator
    return isinstance(settings, SolverSettings) and settings.executable != FEBIO


def _needs(source: Source) -> str:
    name, version = environment.solver(source)
    embedded = source.run["simulator"] == "uniaxial"
    solver = "" if embedded else f", and the solver {name} {version} as `{FEBIO}` on the PATH"
    return one_line(f"You need Python {environment.version_of(source.run, 'python', '3.11 or newer')}{solver}.")


def _remarks(source: Source, layout: Layout, *, store: bool) -> Iterator[str]:
    changed = changed_fields(source, layout)
    if changed:
        said = ", ".join(CHANGES[name] for name in changed)
        yield f"Changed in the study file, so that it runs here: {said}."
    if not set(source.found.results) <= set(compared(source, layout)):
        yield "`discover.json` is not compared: its field `model.difference` shows where the cohort lay."
    if not store:
        yield "The single evaluations (`store.zarr`) are left out; the commands above compute them again."
    which = "`report.html` and `log.jsonl` name" if store else "`report.html` names"
    yield f"{which} the machine and the folders of the run."
