"""What is fuzzed: valid files by target, and the functions that read them; an input is a damaged file."""

import json
import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sinew.runner.cluster.job_table import JobTable
from sinew.runner.store.segment import Segment
from sinew.runner.store.store import Store, open_store
from sinew.tasks import pipeline
from sinew.tasks.cli.look import Rows, look
from sinew.tasks.cluster.profile import read_profile
from sinew.tasks.data.cohort import read_cohort
from sinew.tasks.data.exports import read_export
from sinew.tasks.model import Model
from sinew.tasks.registry import TASKS
from sinew.tasks.report import page
from sinew.tasks.report.folder import read_folder
from sinew.tasks.report.status import print_status, read_status, rows_as_csv
from sinew.tasks.simulate.febio import rendering
from sinew.tasks.simulate.febio.files import read_text
from sinew.tasks.simulate.febio.kept import Run, entry_of, write_runs
from sinew.tasks.simulate.febio.kept_files import contents, read_run
from sinew.tasks.simulate.febio.output import Logged, read_output, read_output_at
from sinew.tasks.simulate.febio.plot_file import plot_file_of, read_plot_file
from sinew.tasks.simulate.rows import read_parameters
from sinew.tasks.study.checkpoint import Checkpoint
from sinew.tasks.study.model import model_of
from sinew.tasks.study.study import read_study
from tests.runner.evaluations import Quick, table_spec
from tests.runner.stores import fill, some
from tests.tasks.cli.bad_input import EXPORT, GEOMETRY, HEADER, PARAMETERS, ROWS, STUDY
from tests.tasks.simulate.febio import plot_writer

ROOT = Path(__file__).parents[2]
EXPECTED = ROOT / "tests" / "golden" / "expected"


@dataclass(frozen=True)
class Target:
    """Valid ``files`` of a kind; ``read`` gets the folder that holds them all, and the path of the damaged one."""

    name: str
    files: dict[str, bytes]
    read: Callable[[Path, Path], Any]
    damaged: tuple[str, ...] = ()
    share: int = 1

    @property
    def seeds(self) -> tuple[str, ...]:
        """The files that may be damaged."""
        return self.damaged or tuple(self.files)


def targets(folder: Path) -> dict[str, Target]:
    """All targets by name; ``folder`` is for a result folder that is made here."""
    made = [
        _study(),
        _profile(),
        _cohort(),
        _export(),
        _parameters(),
        _template(),
        _output(),
        _plot_file(),
        _kept_runs(folder),
        _checkpoint(),
        _results(),
    ]
    return {target.name: target for target in (*made, _result_folder(folder))}


def _study() -> Target:
    demos = {f"{path.name}": path.read_bytes() for path in sorted((ROOT / "configs").glob("*.yaml"))}
    demos["study.yaml"] = json.dumps(STUDY, indent=1).encode()

    def read(_: Path, path: Path) -> None:
        study = read_study(path)
        model_of(study.model, study.simulator.law)

    return Target("study", demos, read, share=3)


def _profile() -> Target:
    files = {path.name: path.read_bytes() for path in sorted((ROOT / "slurm").glob("*.yaml"))}
    return Target("profile", files, lambda _, path: read_profile(path))


def _cohort() -> Target:
    files = {
        "cohort/one/pull.csv": "\n".join((HEADER, *ROWS, "")).encode(),
        "cohort/one/specimen.json": json.dumps(GEOMETRY).encode(),
    }
    return Target("cohort", files, lambda folder, _: read_cohort(folder / "cohort"), share=2)


def _export() -> Target:
    tabs = "Time [s]\tWeg / mm\tKraft / N\r\n0,0\t0,0\t0,0\r\n1,0\t0,1\t5,0\r\n2,0\t0,2\t9,0\r\n"
    plain = (
        "# gauge length: 10 mm, width 4 mm, thickness 1 mm\ntime (s), strain (%), stress (MPa)\n0,0,0\n1,1,5\n2,2,9\n"
    )
    files = {"test.csv": EXPORT.encode(), "tabs.txt": tabs.encode("cp1252"), "plain.csv": plain.encode()}
    files["wide.txt"] = b"\xff\xfe" + tabs.encode("utf-16-le")
    return Target("export", files, lambda _, path: read_export(path), share=3)


def _parameters() -> Target:
    files = {"rows.csv": PARAMETERS.encode()}
    return Target("parameters", files, lambda _, path: read_parameters(path, Model()))


def _template() -> Target:
    bar = b"""<?xml version="1.0"?>
<febio_spec version="4.0"><Material>
<material id="1" type="neo-Hookean"><E>{{ E_f }}</E><v>{{ nu_m | round(3) }}</v></material>
</Material><Mesh><Nodes name="all">{% for i in range(3) %}<node id="{{ loop.index }}">{{ i }},0,{{ sqrt(E_f) }}</node>
{% endfor %}</Nodes></Mesh></febio_spec>
"""
    job = b"#!/bin/sh\n#SBATCH --time={{ walltime }}\n{% if account %}# {{ account }}\n{% endif %}{{ command }}\n"

    def read(_: Path, path: Path) -> None:
        text = read_text(path)
        if path.suffix == ".j2":
            rendering.job_script(path.name, text, {"walltime": "1:00", "account": "a", "command": "true"})
            return
        rendering.included(path.name, text)
        variables = {"E_f": 200.0, "nu_m": 0.3}
        job = {"main": path.name, "renders": [variables, variables], "outputs": [], "known": list(variables)}
        rendering.answer(job, {path.name: text})

    return Target("template", {"bar.feb": bar, "job.sh.j2": job}, read, share=2)


def _output() -> Target:
    text = "".join(f"*Step  = {i}\n*Time  = {i / 2}\n*Data  = z\n1,{i}.5\n2,-{i}e-1\n" for i in range(1, 6))

    def read(_: Path, path: Path) -> None:
        output = Logged("force", "N", "", "node_data", "Rz", (1, 2), None, "sum", 2.0)
        for how in (
            lambda: read_output(path, output, 2**20, 2.5),
            lambda: read_output_at(path, output, 2**20, np.arange(1, 6) / 2),
        ):
            how()

    return Target("output", {"force.txt": text.encode()}, read, share=2)


def _plot_file() -> Target:
    files = {f"{name}.xplt": plot_writer.plot_file(compressed=name == "packed") for name in ("plain", "packed")}
    return Target("plot file", files, lambda _, path: read_plot_file(path, 2**20), share=2)


def _kept_runs(folder: Path) -> Target:
    plot = plot_file_of(plot_writer.plot_file(), 2**20)
    entry = entry_of("of", "pull", ("a",), np.ones(1))
    written = write_runs(folder / "kept", [(entry, Run({"x": np.arange(4.0)}, plot))])

    def read(_: Path, path: Path) -> None:
        for _, place in contents(path):
            read_run(place)

    return Target("kept runs", {written.name: written.read_bytes()}, read)


def _checkpoint() -> Target:
    files = {"fits.jsonl": b'{"inputs": "a"}\n[1.0, 2.0]\n[3.0]\n'}
    return Target("checkpoint", files, lambda _, path: Checkpoint(path, "a").kept)


def _results() -> Target:
    files = {path.name: path.read_bytes() for path in sorted(EXPECTED.glob("*.json")) if path.stem in TASKS}
    return Target("results", files, lambda folder, path: TASKS[path.stem].read(folder), share=3)


def _result_folder(folder: Path) -> Target:
    """A small store with a segment in its journal, a log, progress and jobs."""
    made = folder / "made"
    with Store.writing(made, "study") as store:
        table = store.table(table_spec())
        fill(table, some(20))
        rows = table.plan(some(24), settle=False)[20:]
        outcome = Quick()(some(24)[20:])
        ones = np.ones(4)
        segment = Segment(
            rows, outcome.status, ones.astype(np.int16), ones, outcome.values, outcome.messages, "node:1 job 7"
        )
        segment.write(table.journal / "rows-000000020-00004.safetensors")
    (made / "log.jsonl").write_text(_LOG)
    (made / "progress.json").write_text(json.dumps(_PROGRESS))
    jobs = JobTable(made / "jobs")
    jobs.note("7", "submitted", role="worker", cores=2, nodes="n1")
    jobs.note("7", "started")
    shutil.copyfile(EXPECTED / "sobol.json", made / "sobol.json")
    files = {path.relative_to(made).as_posix(): path.read_bytes() for path in sorted(made.rglob("*")) if path.is_file()}
    named = {f"out/{name}": content for name, content in files.items()}
    return Target("result folder", named, lambda place, _: _look_at(place / "out"), share=5)


def _look_at(out: Path) -> None:
    """Everything that commands read of a result folder; each part must end by itself."""
    errors = []
    for part in (_status, _all_rows, _look, _page, pipeline.repair, _all_rows):
        try:
            part(out)
        except Exception as error:
            errors.append(error)
    if errors:
        raise ExceptionGroup("of the parts", errors)


def _status(out: Path) -> None:
    print_status(read_status(out))


def _look(out: Path) -> None:
    rows = Rows(out)
    rows.look()
    look(out, rows)


def _page(out: Path) -> None:
    page._key(read_folder(out))  # what is wrong with a section, the page says in its place


def _all_rows(out: Path) -> None:
    list(rows_as_csv(out))
    for table in open_store(out).tables():
        for name in ("parameters", *table.fields):
            table.read(name, np.arange(table.settled))
        table.coordinate("protocol")


_LOG = """{"asctime": "2026-01-01", "levelname": "INFO", "name": "sinew", "message": "run started", "version": "0", \
"seed": 1, "study_file": "study.yaml", "cohort": "cohort", "tasks": ["sobol"], \
"packages": {"numpy": "2"}, "study_text": "name: a", "specimens": {"a": {"length_mm": 10.0}}}
{"asctime": "2026-01-01", "message": "task started", "task": "sobol"}
{"asctime": "2026-01-01", "message": "task finished", "task": "sobol", "seconds": 1.5, "new_simulations": 20}
"""
_PROGRESS = {
    "title": "sobol", "of": "rows", "done": 20, "total": 24, "failed": 0, "running": 4, "state": "running",
    "time": 1.0, "process": {"host": "n1", "pid": 1, "since": 1.0},
    "notes": {"sobol": {"a": {"words": "fine", "best": 1.0}}},
    "rows_per_s": 2.0, "eta_s": 2.0, "tasks": {"sobol": "running"}, "dashboard": {"port": 1},
    "workers": 2,
}  # fmt: skip


def corpus(folder: Path) -> Iterator[tuple[str, str, bytes]]:
    """Inputs that once broke something: target, file of the target, content."""
    for path in sorted(folder.rglob("*.bin")):
        target, name = path.parent.relative_to(folder).parts[0], "/".join(path.parent.relative_to(folder).parts[1:])
        yield target, name, path.read_bytes()
