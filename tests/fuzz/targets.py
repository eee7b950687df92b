"""What is fuzzed: valid files by target, and the functions that read them; an input is a damaged file."""

import json
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from sinew.runner.cluster.job_table import JobTable
from sinew.runner.errors import brief
from sinew.runner.store.segment import Segment
from sinew.runner.store.store import Store, open_store
from sinew.tasks.benchmark.answers import read_answers as hidden_answers
from sinew.tasks.cli.watch_state import Rows, look
from sinew.tasks.cluster.profile import read_profile
from sinew.tasks.data.answers import read_answers
from sinew.tasks.data.cohort import Cohort, read_cohort
from sinew.tasks.data.exports import read_export
from sinew.tasks.data.new_model_study import Choices, init_model
from sinew.tasks.model import Curve, Model, Protocol, Specimen
from sinew.tasks.registry import TASKS
from sinew.tasks.report import page
from sinew.tasks.report.folder import read_folder
from sinew.tasks.report.status import print_status, read_status, rows_as_csv
from sinew.tasks.simulate.febio.files import read_text
from sinew.tasks.simulate.febio.kept import Run, entry_of, write_runs
from sinew.tasks.simulate.febio.kept_files import contents, read_run
from sinew.tasks.simulate.febio.model_file.contents import contents_of
from sinew.tasks.simulate.febio.model_file.listing import as_json, lines
from sinew.tasks.simulate.febio.model_file.source import read_source
from sinew.tasks.simulate.febio.output import Logged, read_output, read_output_at
from sinew.tasks.simulate.febio.plot_file import plot_file_of, read_plot_file
from sinew.tasks.simulate.febio.rendering import program, sandbox
from sinew.tasks.simulate.rows import read_parameters
from sinew.tasks.study import pipeline
from sinew.tasks.study import range_check as ranges
from sinew.tasks.study.checkpoint import Checkpoint
from sinew.tasks.study.curves import keep_curves, kept_curves
from sinew.tasks.study.model import model_of
from sinew.tasks.study.study import read_study
from tests.runner.evaluations import Quick, table_spec
from tests.runner.stores import fill, some
from tests.tasks.cli.bad_input import EXPORT, GEOMETRY, HEADER, PARAMETERS, ROWS, STUDY
from tests.tasks.data.test_sheets import write_workbook
from tests.tasks.simulate.febio import plot_writer
from tests.tasks.simulate.febio.model_file.cube import CUBE, in_format_3

ROOT = Path(__file__).parents[2]
EXPECTED = ROOT / "tests" / "golden" / "expected"


@dataclass(frozen=True)
class Target:
    """Valid ``files`` of a kind; ``read`` gets the folder that holds them all, and the path of the damaged one.

    ``whole``: it reads all of them, whichever is damaged.
    """

    name: str
    files: dict[str, bytes]
    read: Callable[[Path, Path], Any]
    damaged: tuple[str, ...] = ()
    share: int = 1
    whole: bool = False

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
        _model(),
        _ranges(),
        _answers(),
        _hidden(),
        _workbook(folder),
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
    tabs = "Length\t10 mm\r\nWidth\t4 mm\r\nThickness\t1 mm\r\nTime [s]\tWeg / mm\tKraft / N\r\n"
    tabs += "0,0\t0,0\t0,0\r\n1,0\t0,1\t5,0\r\n2,0\t0,2\t9,0\r\n"
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
            sandbox.job_script(path.name, text, {"walltime": "1:00", "account": "a", "command": "true"})
            return
        sandbox.included(path.name, text)
        variables = {"E_f": 200.0, "nu_m": 0.3}
        job = {"main": path.name, "renders": [variables, variables], "outputs": [], "known": list(variables)}
        program.answer(job, {path.name: text})

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


def _model() -> Target:
    """FEBio models as ``sinew init`` takes them: what they hold is listed, and a study is made of it."""
    fields = {"vary": ["gel ä.elastic.E", "gel ä.g1=0.1:1"], "measure": ["side=ux@cube:max", "stress=sz@part"]}
    files = {"cube.feb": CUBE.encode("latin-1"), "three.feb": in_format_3(CUBE).encode("latin-1")}

    def read(folder: Path, path: Path) -> None:
        source = read_source(path)
        contents = contents_of(source)
        listed = [*lines(source, contents), json.dumps(as_json(source, contents))]
        assert all(isinstance(line, str) for line in listed)
        vary = [*fields["vary"], *list(contents.numbers)[:1]]
        for number, move in enumerate(("pull", None)):
            init_model(source, contents, Choices(vary, move, measure=fields["measure"]), folder / f"study{number}")

    return Target("model", files, read, share=2)


def _ranges() -> Target:
    """What an earlier run saw of a study's ranges."""
    numbers = {"measured_N": 90.0, "least_N": 1.0, "most_N": 9.0, "area_mm2": 4.0}
    far, near = {"specimen": "a", "protocol": "pull"} | numbers, {"specimen": "b", "protocol": "pull"} | numbers
    written = {"inputs": "0", "reach": [far, near | {"measured_N": 5.0}], "unseen": ["nu_m"], "advice": [["E_f", 1, 9]]}

    def read(_: Path, path: Path) -> None:
        found = ranges.read(path)
        for line in () if found is None else found.remarks():
            assert line == brief(line), line
        if found is not None:
            found.refuse(path)

    return Target("ranges", {ranges.RANGES: json.dumps(written).encode()}, read)


def _answers() -> Target:
    text = """# answers
time_unit: s
force_column: Kraft
rate_hz: 10.0
specimens:
  A 1: {length_mm: 10.0, width_mm: 4.0}
  "07": {thickness_mm: 1.5}
"""
    return Target("answers", {"answers.yaml": text.encode()}, lambda _, path: read_answers(path))


def _hidden() -> Target:
    """``answers.json`` of cohorts with hidden effects."""
    case = {"truth": ["preload"], "case": "one", "magnitude": {"stretch": 1.01}, "same_form": {"preload_stretch": 1.01}}
    files = {"answers.json": json.dumps({"a": case, "b": {"truth": ["OUTSIDE"]}, "c": {"truth": []}}).encode()}

    def read(folder: Path, _: Path) -> None:
        for name in "abc":
            (folder / name).mkdir()
        hidden_answers(folder)

    return Target("hidden effects", files, read)


def _workbook(made: Path) -> Target:
    """Spreadsheets with damage inside of the archive, where no checksum sees it."""
    rows: list[list[object]] = [["length", 10, "mm"], ["width", 4, "mm"], ["thickness", 1, "mm"]]
    rows += [["time (s)", "displacement (mm)", "force (N)"], [0.0, 0.0, 0.0], [1, 0.1, 5], [2, 1, 9]]
    book = write_workbook(made / "book.xlsx", tests=rows, more=[["a", "b & c"], [None, 1e-7]])
    with zipfile.ZipFile(book) as archive:
        parts = {f"parts/{name}": archive.read(name) for name in archive.namelist()}

    def read(folder: Path, _: Path) -> None:
        with zipfile.ZipFile(folder / "test.xlsx", "w") as archive:
            for name in parts:
                archive.write(folder / name, name.removeprefix("parts/"))
        read_export(folder / "test.xlsx")

    return Target("workbook", parts, read)


def _checkpoint() -> Target:
    files = {"fits.jsonl": b'{"inputs": "a"}\n[1.0, 2.0]\n[3.0]\n'}
    return Target("checkpoint", files, lambda _, path: Checkpoint(path, "a").kept)


def _results() -> Target:
    files = {f"{task}.json": _result(task) for task in sorted(TASKS)}
    return Target("results", files, lambda folder, path: TASKS[path.stem].read(folder), share=3)


def _result(task: str) -> bytes:
    """A result as a run writes it; the golden files leave out what it was made from."""
    content = json.loads((EXPECTED / f"{task}.json").read_bytes())
    if "law" in content:
        content["law"] |= {"path": "discover/law.yaml", "difference": "+ effects"}
    return json.dumps({"inputs": "0", **content}).encode()


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
        store.write_result("sobol", xr.Dataset({"ST": ("parameter", ones)}, {"parameter": list("abcd")}))
        keep_curves(store, _COHORT)
    (made / "log.jsonl").write_text(_LOG)
    (made / "progress.json").write_text(json.dumps(_PROGRESS))
    jobs = JobTable(made / "jobs")
    jobs.note("7", "submitted", role="worker", cores=2, nodes="n1")
    jobs.note("7", "started")
    (made / "sobol.json").write_bytes(_result("sobol"))
    files = {path.relative_to(made).as_posix(): path.read_bytes() for path in sorted(made.rglob("*")) if path.is_file()}
    named = {f"out/{name}": content for name, content in files.items()}
    return Target("result folder", named, lambda place, _: _look_at(place / "out"), whole=True)


def _look_at(out: Path) -> None:
    """Everything that commands read of a result folder; each part must end by itself."""
    errors = []
    for part in (_status, _all_rows, _arrays, _curves, _look, _page, pipeline.repair, _all_rows, _run_again):
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


def _arrays(out: Path) -> None:
    open_store(out).read_result("sobol")


def _curves(out: Path) -> None:
    kept_curves(open_store(out))


def _run_again(out: Path) -> None:
    with Store.writing(out, "study") as store:
        keep_curves(store, _COHORT)


def _all_rows(out: Path) -> None:
    list(rows_as_csv(out))
    for table in open_store(out).tables():
        for name in ("parameters", *table.fields):
            table.read(name, np.arange(table.settled))
        table.coordinate("protocol")


_PULL = Protocol("pull", np.linspace(0.0, 9.0, 10), np.linspace(0.0, 0.3, 10))
_COHORT = Cohort(Path("cohort"), (Specimen("a", 10.0, 5.0, 2.0, curves=(Curve(_PULL, np.ones(10)),)),))
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
