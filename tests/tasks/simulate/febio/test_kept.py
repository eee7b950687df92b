"""Runs that are kept, and outputs that are computed from them without a new run."""

import json
import signal
import struct
import subprocess
import sys
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sinew.runner.errors import StoreError
from sinew.tasks.simulate.febio import keeping, kept_files
from sinew.tasks.simulate.febio.field_output import FieldOutput, field_course
from sinew.tasks.simulate.febio.kept import Run, entry_of, write_runs
from sinew.tasks.simulate.febio.plot_file import plot_file_of
from sinew.tasks.simulate.row_by_row import Failed
from sinew.tasks.study.workspace import _no_abandoned_folders
from tests.tasks.simulate.febio import plot_writer
from tests.tasks.simulate.febio.dogbone import BAR, OWN, RELAX, dogbone
from tests.tasks.simulate.febio.keeping_bar import LATERAL, ROWS, keeping_bar
from tests.tasks.simulate.febio.plotting_bar import plotting_bar, runs


@pytest.fixture(autouse=True)
def _no_memory(monkeypatch):
    monkeypatch.setattr(keeping, "_indexes", {})  # as in another process


def test_a_new_output_needs_no_new_run(tmp_path):
    before = keeping_bar(tmp_path)._rows(OWN, BAR, RELAX, ROWS)
    assert runs(tmp_path) == 3
    assert len(list((tmp_path / "fields").iterdir())) == 1  # a file for all rows of the batch
    reaction = FieldOutput("reaction", "N", "max", "reaction forces", "z", (), "grip", "sum", 4.0)
    stress = FieldOutput("mean_stress", "MPa", "max", "stress", "zz", (), "gauge", "mean")
    keeping._indexes.clear()
    found, status, _ = keeping_bar(tmp_path, LATERAL, reaction, stress)._rows(OWN, BAR, RELAX, ROWS)
    assert runs(tmp_path) == 3
    assert not status.any()
    assert np.array_equal(found[:, :3], before[0])  # of the log, kept with all digits
    for new, log in ((3, 2), (4, 0), (5, 1)):
        assert np.abs(found[:, new] - found[:, log]).max() < 2e-7 * np.abs(found[:, log]).max()


def test_keeping_changes_neither_identity_nor_numbers(tmp_path):
    plain = dogbone(tmp_path, program=plotting_bar(tmp_path))
    kept = keeping_bar(tmp_path)
    assert kept.identity() == plain.identity()
    assert np.array_equal(kept._rows(OWN, BAR, RELAX, ROWS)[0], plain._rows(OWN, BAR, RELAX, ROWS)[0])
    assert keeping_bar(tmp_path, LATERAL).identity() != plain.identity()


def test_what_is_missing_is_solved_again(tmp_path):
    few = replace(keeping_bar(tmp_path), plotted=("stress",))
    few._rows(OWN, BAR, RELAX, ROWS[:2])
    with_lateral = keeping_bar(tmp_path, LATERAL)
    found, status, _ = with_lateral._rows(OWN, BAR, RELAX, ROWS)
    assert runs(tmp_path) == 2 + 3
    assert not status.any()
    assert np.array_equal(with_lateral._rows(OWN, BAR, RELAX, ROWS[::-1])[0], found[::-1])
    assert runs(tmp_path) == 5
    longer = replace(RELAX, time_s=2 * RELAX.time_s)
    with_lateral._rows(OWN, replace(BAR, length_mm=30.0), longer, ROWS)
    assert runs(tmp_path) == 8


def test_a_wrong_field_output_fails_its_rows_and_loses_no_run(tmp_path):
    wrong = {
        replace(LATERAL, set="side"): "no set 'side' of nodes; expected one of edge, gauge, grip",
        replace(LATERAL, component="q"): "component 'q' of displacement, which has x, y, z, magnitude",
        replace(LATERAL, component=None): "component None of displacement",
        replace(LATERAL, set="grip"): "12 places, and no reduce",
        replace(LATERAL, set=None, ids=(1, 9999)): "some of the nodes are not in the model",
        replace(LATERAL, field="temperature"): "no variable 'temperature' in the plot file",
    }
    for output, words in wrong.items():
        _, status, messages = keeping_bar(tmp_path, output)._rows(OWN, BAR, RELAX, ROWS[:1])
        assert words in messages[0]
        assert status[0] == 7  # bad_input
    assert runs(tmp_path) == 2  # the variable that is not there may be in a new run
    assert not list((tmp_path / "attempts").glob("*"))


def test_a_damaged_plot_file_fails_the_row(tmp_path):
    bar = keeping_bar(tmp_path)
    program = Path(bar.executable)
    cut = "import os\nif os.path.exists('model.xplt'):\n    os.truncate('model.xplt', 5000)\nsys.exit(code)\n"
    program.write_text(program.read_text().replace("sys.exit(main(", "code = (main(").rstrip("\n") + "\n" + cut)
    _, status, messages = bar._rows(OWN, BAR, RELAX, ROWS[:1])
    assert status[0] == 5  # bad_output
    assert messages[0].startswith("plot file: ")
    assert len(list((tmp_path / "attempts").glob("failed-bad_output-*"))) == 1
    assert not (tmp_path / "fields").exists()


@pytest.fixture
def written(tmp_path) -> Path:
    plot = plot_file_of(plot_writer.plot_file(), 2**20)
    entries = [entry_of("of", "pull", ("a", "b"), np.array([1.0, number])) for number in range(2)]
    return write_runs(tmp_path / "fields", [(entry, Run({"x": np.arange(4.0)}, plot)) for entry in entries])


def test_a_run_is_read_as_it_was_written(written):
    plot = plot_file_of(plot_writer.plot_file(), 2**20)
    (one, _), (two, place) = kept_files.contents(written)
    assert one.key != two.key
    assert two.parameters == {"a": 1.0, "b": 1.0}
    run = kept_files.read_run(place)
    assert run.logged["x"].tolist() == [0, 1, 2, 3]
    assert run.plot.time_s.tolist() == list(plot_writer.TIMES)
    assert list(run.plot.variables) == list(plot.variables)
    for name, variable in plot.variables.items():
        again = run.plot.variables[name]
        assert np.array_equal(again.values, variable.values, equal_nan=True)
        plain = [{k: v for k, v in vars(each).items() if k != "values"} for each in (again, variable)]
        assert plain[0] == plain[1]
    mesh, other = plot.mesh, run.plot.mesh
    assert [(r.name, r.shape, r.ids.tolist(), r.corners.tolist()) for r in (*other.domains, *other.surfaces)] == [
        (r.name, r.shape, r.ids.tolist(), r.corners.tolist()) for r in (*mesh.domains, *mesh.surfaces)
    ]
    assert np.array_equal(other.nodes, mesh.nodes)
    assert {k: v.tolist() for k, v in other.node_sets.items()} == {"side": [1, 3, 5]}
    assert {k: v.tolist() for k, v in other.element_sets.items()} == {"upper": [2]}
    assert other.parts == mesh.parts


def test_variables_of_any_name_and_of_zeros_are_read_again(tmp_path):
    """A variable called ``c``, as Zarr calls the folders of chunks; and chunks of zeros, which Zarr does not write."""
    plot = plot_file_of(plot_writer.plot_file(), 2**20)
    energy = plot.variables["energy"]
    named = {"c": replace(energy, name="c"), "c c": replace(energy, name="c c", values=0 * energy.values)}
    path = write_runs(
        tmp_path / "fields", [(entry_of("of", "pull", ("a",), np.ones(1)), Run({}, replace(plot, variables=named)))]
    )
    ((_, place),) = kept_files.contents(path)
    again = kept_files.read_run(place).plot.variables
    assert list(again) == ["c", "c c"]
    assert np.array_equal(again["c"].values, energy.values)
    assert not again["c c"].values.any()


def test_equal_runs_are_equal_bytes(tmp_path, written):
    runs_of = [(entry, kept_files.read_run(place)) for entry, place in kept_files.contents(written)]
    assert write_runs(tmp_path / "other", runs_of).read_bytes() == written.read_bytes()


def test_every_cut_and_many_changes_are_refused_or_read(written):
    content = written.read_bytes()
    random = np.random.default_rng(3)
    refused = 0
    for number in range(150):
        damaged = bytearray(content)
        if number % 3 == 0:
            damaged = damaged[: random.integers(len(damaged))]
        for _ in range(number % 3):
            damaged[random.integers(len(damaged))] = random.integers(256)
        written.write_bytes(damaged)
        try:
            for _, place in kept_files.contents(written):
                kept_files.read_run(place)
        except StoreError as error:
            refused += 1
            assert str(written) in str(error)
    assert refused > 50
    index = keeping.Index(written.parent)
    written.write_bytes(content[:-40])
    index.look()
    assert index.places == {}


def test_a_chunk_that_says_it_is_longer_is_refused(written):
    """Blosc would give the memory of the process that lies behind it."""
    with zipfile.ZipFile(written) as archive:
        members = {one: archive.read(one) for one in archive.namelist()}
    name = "run_0/time_s/c/0"
    holds = int.from_bytes(members[name][4:8], "little")
    members[name] = struct.pack("<BBBBIII", 2, 1, 2, 8, holds, holds, holds + 16) + members[name][-4:]
    with zipfile.ZipFile(written, "w") as archive:
        for one, content in members.items():
            archive.writestr(one, content)
    (_, place), _ = kept_files.contents(written)
    with pytest.raises(StoreError, match=f"run_0/time_s: a chunk claims {holds + 20:,} bytes and has 20"):
        kept_files.read_run(place)


def test_a_file_lists_no_more_runs_than_a_batch_has(written, monkeypatch):
    monkeypatch.setattr(kept_files, "MAX_RUNS", 1)
    with pytest.raises(StoreError, match="it lists 2 runs"):
        kept_files.contents(written)


def test_a_list_of_members_that_would_fill_the_memory_is_not_read(written):
    """The file is sparse: it takes no room on the disk."""
    size = 3_000_000_000
    with written.open("wb") as file:
        file.seek(size)
        file.write(struct.pack("<4s4H2LH", b"PK\5\6", 0, 0, 1, 1, size, 0, 0))
    with pytest.raises(StoreError, match=r"damaged \(it lists 1 members in 3,000,000,000 bytes"):
        kept_files.contents(written)
    with written.open("wb") as file:
        file.write(struct.pack("<4s4H2LH", b"PK\5\6", 0, 0, 1, 1, 46, 0, 1))
    with pytest.raises(StoreError, match="it does not end as a zip"):
        kept_files.contents(written)


def test_a_chunk_is_no_larger_than_its_array(written):
    with zipfile.ZipFile(written) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    about = json.loads(members["run_0/displacement/zarr.json"])
    about["chunk_grid"]["configuration"]["chunk_shape"] = [1, 12, 2**20]
    members["run_0/displacement/zarr.json"] = json.dumps(about).encode()
    with zipfile.ZipFile(written, "w") as archive:
        for one, content in members.items():
            archive.writestr(one, content)
    (place, _) = (one for _, one in kept_files.contents(written))
    with pytest.raises(StoreError, match=r"run_0/displacement has the shape \(3, 12, 3\) and chunks"):
        kept_files.read_run(place)


KILLED = """
import os, sys, signal
sys.path.insert(0, {root!r})
import numpy as np
from tests.tasks.simulate.febio.dogbone import BAR, OWN, RELAX
from tests.tasks.simulate.febio.keeping_bar import ROWS, keeping_bar
from pathlib import Path
os.replace = lambda *_: os.kill(os.getpid(), signal.SIGKILL)
keeping_bar(Path({folder!r}))._rows(OWN, BAR, RELAX, ROWS)
"""


def test_a_killed_writer_leaves_nothing_that_counts(tmp_path):
    """Killed before the file has its name: the rows have no outcome then, and are solved again."""
    text = KILLED.format(root=str(Path(__file__).parents[4]), folder=str(tmp_path))
    ended = subprocess.run([sys.executable, "-c", text], check=False)
    assert ended.returncode == -signal.SIGKILL
    (partial,) = (tmp_path / "fields").iterdir()
    assert partial.name.endswith(".partial")
    found, status, _ = keeping_bar(tmp_path, LATERAL)._rows(OWN, BAR, RELAX, ROWS)
    assert not status.any()
    assert np.isfinite(found).all()
    assert runs(tmp_path) == 6
    with _no_abandoned_folders(tmp_path):
        assert [path.suffix for path in (tmp_path / "fields").iterdir()] == [".zip"]


@pytest.mark.thorough
def test_writers_of_the_same_and_of_other_rows_do_not_meet(tmp_path):
    text = KILLED.replace("os.replace = lambda *_: os.kill(os.getpid(), signal.SIGKILL)\n", "").replace(
        "RELAX, ROWS)", "RELAX, ROWS[{part}])"
    )
    parts = ["0:2", "0:2", "1:3"]
    words = {"root": str(Path(__file__).parents[4]), "folder": str(tmp_path)}
    keeping_bar(tmp_path)  # writes the program
    started = [subprocess.Popen([sys.executable, "-c", text.format(part=part, **words)]) for part in parts]
    assert [one.wait() for one in started] == [0, 0, 0]
    before = runs(tmp_path)
    found, status, _ = keeping_bar(tmp_path, LATERAL)._rows(OWN, BAR, RELAX, ROWS)
    assert runs(tmp_path) == before
    assert not status.any()
    assert np.abs(found[:, 3] - found[:, 2]).max() < 2e-7 * np.abs(found[:, 2]).max()


def test_places_of_each_kind_of_variable():
    plot = plot_file_of(plot_writer.plot_file(), 2**20)

    def of(name: str, component: str | None, **choice) -> np.ndarray:
        return field_course(FieldOutput("o", "1", "max", name, component, **choice), plot)[1]

    stress = plot.variables["stress"].values[1:].astype(float)
    assert np.array_equal(of("stress", "zz", set="block", reduce="max"), stress[:, :2, 2].max(1))
    assert np.array_equal(of("stress", "zz", set="tissue", reduce="max"), stress[:, :2, 2].max(1))
    assert np.array_equal(of("stress", "xy", set="upper"), stress[:, 1, 3])
    assert np.array_equal(of("stress", "xy", ids=(3,)), stress[:, 2, 3])
    assert np.array_equal(of("stress", "xx", reduce="sum"), stress[:, :, 0].sum(1))
    xx, yy, zz, xy, yz, xz = stress[:, 1].T
    tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]).transpose(2, 0, 1)
    deviator = tensor - np.trace(tensor, axis1=1, axis2=2)[:, None, None] / 3 * np.eye(3)
    assert np.allclose(of("stress", "von_mises", ids=(2,)), np.sqrt(1.5 * (deviator**2).sum((1, 2))))
    moved = plot.variables["displacement"].values[1:].astype(float)
    assert np.array_equal(of("displacement", "x", set="side", reduce="mean"), moved[:, [1, 3, 5], 0].mean(1))
    assert np.array_equal(of("displacement", "y", set="top", reduce="sum"), moved[:, 8:12, 1].sum(1))
    assert np.array_equal(of("displacement", "z", ids=(11, 10), reduce="sum"), moved[:, :2, 2].sum(1))
    assert np.allclose(of("displacement", "magnitude", ids=(10,)), np.linalg.norm(moved[:, 0], axis=1))
    assert np.array_equal(
        of("density", None, set="upper", reduce="sum"), plot.variables["density"].values[1:, 8:, 0].sum(1, dtype=float)
    )
    assert np.array_equal(of("pull", "z", set="top"), plot.variables["pull"].values[1:, 0, 2].astype(float))
    empty = replace(plot.variables["displacement"], values=np.zeros((plot.time_s.size, 0, 3), "f4"), regions=())
    nowhere = replace(plot, variables={"displacement": empty})
    with pytest.raises(Failed, match="displacement is there for no part of the mesh"):
        field_course(FieldOutput("o", "1", "max", "displacement", "x", ids=(10,)), nowhere)
    assert np.array_equal(of("energy", None), plot.variables["energy"].values[1:, 0, 0].astype(float))
