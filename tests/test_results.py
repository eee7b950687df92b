"""``import sinew``: results that print and plot, and open as the objects of the libraries that others work with."""

import json
import shutil
import sqlite3
import struct
import subprocess
import sys
import warnings
import zlib
from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pandas as pd
import pytest
import xarray as xr
from matplotlib import pyplot as plt
from matplotlib.figure import Figure
from numcodecs import Zstd

import sinew
from sinew import interop
from sinew.runner.errors import BadInput, SinewError, StoreError
from sinew.runner.store.schema import STATUSES
from sinew.runner.store.store import open_store
from sinew.tasks.model import Model
from sinew.tasks.registry import TASKS
from sinew.tasks.study.files import read_json, write_json
from sinew.tasks.study.workspace import Workspace
from tests.golden.study import FREE
from tests.tasks.calibrations import calibration_of, fit_of


@pytest.fixture(scope="module")
def folder(golden_run: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Results of every task over two specimens of two sites, with their study."""
    return Path(shutil.copytree(golden_run.parent, tmp_path_factory.mktemp("notebook") / "golden")) / "out"


@pytest.fixture
def results(folder: Path) -> sinew.Results:
    return sinew.results(folder)


@pytest.fixture
def copied_run(folder: Path, tmp_path: Path) -> Path:
    """A folder of results that a test may damage."""
    return Path(shutil.copytree(folder, tmp_path / "out"))


@pytest.fixture(autouse=True)
def no_figures_left_open():
    yield
    plt.close("all")


def test_importing_the_package_imports_no_library():
    code = "import sys, sinew; print(sorted({'numpy', 'pandas', 'distributed', 'matplotlib'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize("name", sinew.__all__)
def test_every_public_name_is_there_and_says_what_it_is(name):
    assert getattr(sinew, name).__doc__
    assert name in dir(sinew)


def test_a_name_that_is_not_there():
    with pytest.raises(AttributeError, match="no attribute 'sobols'"):
        sinew.sobols  # noqa: B018


@pytest.mark.parametrize("task", TASKS)
def test_every_task_prints_and_plots(results, task):
    one = getattr(results, task)
    assert task in repr(one)
    assert len(one.table)
    assert isinstance(one.plot(), Figure)
    html = one._repr_html_()
    assert html.count("<table") == html.count("</table>") == 1
    for name, each in one.plots.items():
        if (task, name) == ("calibrate", "correlations"):
            continue
        figure = one.plot(name, each[-1] if each else None)
        assert isinstance(figure, Figure)
        figure.canvas.draw()
    assert not plt.get_fignums(), "a notebook would show them twice"


def test_results_tell_what_is_there(results):
    assert results.finished == tuple(TASKS)
    for words in (repr(results), results._repr_html_()):
        assert "golden" in words
        assert "largest total indices" in words
        assert results.discover.content["verdict"] in words


def test_tables_hold_the_numbers_of_the_files(results, folder):
    told = json.loads((folder / "sobol.json").read_text())
    assert results.sobol.table.loc[("total", "E_f"), "ST"] == told["ST"][0]
    assert list(results.sobol.table.index.get_level_values("output").unique()) == ["total", *told["protocols"]]
    csv = pd.read_csv(folder / "calibrate.csv", index_col="specimen").astype(float)
    pd.testing.assert_frame_equal(results.calibrate.table[list(csv)].astype(float), csv, rtol=1e-5)
    table3 = pd.read_csv(folder / "infer.csv", index_col="parameter")
    assert results.infer.table.loc[("distal", "E_f"), "mean"] == pytest.approx(table3.loc["E_f", "distal_mean"], 1e-5)


def test_what_is_missing_is_said(results, tmp_path):
    with pytest.raises(SinewError, match="one of indices, convergence, time"):
        results.sobol.plot("pie")
    with pytest.raises(SinewError, match="of 'nobody'; expected one of distal/1, middle/1"):
        results.sobol.plot("time", "nobody")
    with pytest.raises(SinewError, match="expected nothing"):
        results.sobol.plot("indices", "distal/1")
    with pytest.raises(SinewError, match="holds no correlations"):
        results.calibrate.plot("correlations")
    with pytest.raises(SinewError, match="is not there"):
        sinew.results(tmp_path / "nowhere")
    with pytest.raises(SinewError, match="neither a store nor results"):
        sinew.results(tmp_path)
    for call in (results.arviz, results.abc_history):
        with pytest.raises(SinewError, match=r"no posterior of '\.\./x'; expected one of distal, middle"):
            call("../x")
    with pytest.raises(SinewError, match="expected one of distal/1, middle/1"):
        results.skopt_result("nobody")
    with pytest.raises(SinewError, match="expected one of total, "):
        results.salib_result("nothing")


def test_an_unfinished_folder_opens(tmp_path):
    write_json(tmp_path / "importance.json", {"names": ["E_f"]})
    partial = sinew.results(tmp_path)
    assert partial.finished == ("importance",)
    with pytest.raises(SinewError, match=r"importance\.json: impurity_percent: missing; expected what this version's"):
        partial.importance  # noqa: B018
    with pytest.raises(SinewError, match=r"sobol\.json: is not there; expected a finished `sinew sobol`"):
        partial.sobol  # noqa: B018


def test_words_from_a_result_cannot_become_html(tmp_path):
    evil = "<script>alert(1)</script>"
    calibration_of({evil: fit_of({evil: 1.0}, site=evil, method=evil)}).write(tmp_path)
    one = sinew.results(tmp_path)
    assert "<script" not in one._repr_html_() + one.calibrate._repr_html_()
    assert "&lt;script" in one.calibrate._repr_html_()
    for html in (
        one._repr_html_(),
        one.calibrate._repr_html_(),
    ):  # no formula is set, as one may hold a link to a script
        assert html.startswith('<div class="tex2jax_ignore mathjax_ignore">')
        assert html.endswith("</div>")
        assert html.count("<div") == html.count("</div>") == html.count("tex2jax_ignore") + html.count("<div>")


def test_paths_may_be_texts(folder, tmp_path):
    cohort = sinew.read_cohort(str(folder.parent / "cohort"))
    sinew.write_cohort(str(tmp_path / "again"), cohort.specimens)
    assert sinew.read_cohort(tmp_path / "again").specimens[0].name == cohort.specimens[0].name
    with pytest.raises(sinew.BadInput, match=r"gone\.yaml: is not there"):
        sinew.run(str(tmp_path / "gone.yaml"))
    with pytest.raises(sinew.BadInput, match=r"gone\.csv: "):
        sinew.read_exports(str(tmp_path / "gone.csv"))
    with pytest.raises(sinew.BadInput, match="paths: no files"):
        sinew.read_exports([])
    with pytest.raises(sinew.BadInput, match="is not there"):
        sinew.results("a" * 5000)


def test_run_refuses_what_the_command_refuses(folder, tmp_path):
    study = sinew.read_study(folder.parent / "study.yaml")
    with pytest.raises(sinew.BadInput, match="some of sobol, importance"):
        sinew.run(study, "sobols", out=tmp_path)
    for task, before in {name: task.needs for name, task in TASKS.items() if task.needs}.items():
        with pytest.raises(sinew.BadInput, match=f"`sinew {before}` on this study first"):
            sinew.run(study, task, out=tmp_path)
    assert not list(tmp_path.iterdir())


@pytest.mark.figures
def test_running_again_evaluates_nothing(folder, monkeypatch):
    monkeypatch.setattr(Workspace, "client", lambda self: pytest.fail("a cluster was started"))
    before = (folder / "sobol.json").read_bytes()
    again = sinew.run(
        sinew.read_study(folder.parent / "study.yaml"), "sobol", "importance", out=str(folder), figures=True
    )
    assert again == sinew.results(folder)
    assert before == (folder / "sobol.json").read_bytes()
    assert {"sobol.png", "importance.png"} <= {path.name for path in again.figures}


# ---- other libraries


def test_the_store_opens_in_xarray(results, folder):
    tree = results.xarray()
    assert tree["sobol"]["ST"].sel(output="total", parameter="E_f").item() == results.sobol.content["ST"][0]
    tables = [name for name in tree["evaluations"].children if name.startswith("distal-1")]
    one = xr.open_zarr(folder / "store.zarr", group=f"evaluations/{tables[0]}", consolidated=False)
    assert one["force_cyclic"].attrs["units"] == "N"


def test_salib_analyses_the_sample_and_finds_the_indices(results):
    from SALib import ProblemSpec
    from SALib.analyze import sobol

    problem = results.salib_problem()
    assert problem["names"] == list(FREE)
    by_name = {parameter.name: parameter for parameter in Model().parameters}
    assert problem["bounds"] == [[by_name[name].minimum, by_name[name].maximum] for name in FREE]
    x, y = results.salib_samples("distal/1")
    assert x.shape == (16 * 5, 3)
    found = sobol.analyze(problem, y, calc_second_order=False, num_resamples=20, seed=1)
    stored = results.sobol.content["specimens"]["distal/1"]
    assert np.allclose(found["S1"], stored["S1"])
    assert np.allclose(found["ST"], stored["ST"])
    spec = ProblemSpec(problem).set_samples(x).set_results(y)
    assert np.allclose(spec.analyze_sobol(calc_second_order=False, num_resamples=20).analysis["ST"], stored["ST"])


def test_salib_results_plot_themselves(results):
    for output in ("total", "cyclic"):
        found = results.salib_result(output)
        total, first = found.to_df()
        assert list(total.index) == list(FREE)
        assert np.allclose(first["S1"], results.sobol.table.loc[output, "S1"])
        axes = found.plot()
        assert len(axes) == 2


def test_the_history_is_pyabcs_own(results):
    import pyabc.visualization as visualization

    history = results.abc_history("distal")
    frame, weight = history.get_distribution(m=0)
    kept = results.xarray()["infer/distal"]
    assert np.array_equal(frame[list(FREE)].to_numpy(), kept["parameters"].values[-1])
    assert weight.sum() == pytest.approx(1)
    assert history.max_t == 1
    visualization.plot_epsilons(history)
    visualization.plot_kde_1d(frame, weight, x="E_f")


def test_the_posterior_is_arvizs_own(results):
    data = results.arviz("distal")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FutureWarning)
        import arviz
    told = arviz.summary(data, kind="stats")
    for name in FREE:
        assert told.loc[name, "mean"] == pytest.approx(results.infer.table.loc[("distal", name), "mean"], rel=0.05)


def test_the_search_is_skopts_own(results, folder):
    from skopt.plots import plot_convergence, plot_evaluations, plot_objective

    found = results.skopt_result("distal/1")
    totals = found.func_vals
    assert len(found.x_iters) == totals.size == 12
    assert found.fun == totals.min()
    assert found.space.dimension_names == list(FREE)
    assert all(
        low <= value <= high for x in found.x_iters for value, (low, high) in zip(x, found.space.bounds, strict=True)
    )
    plot_convergence(found)
    plot_evaluations(found)
    told = read_json(folder / "calibrate.json")["specimens"]["distal/1"]["methods"]["bayesian"]
    assert found.fun == pytest.approx(told["total_N"])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of a process that is fitted to few points
        learned = results.skopt_result("distal/1", surrogate=True)
    plot_objective(learned, n_points=5, n_samples=5)


@pytest.mark.parametrize("format", ["csv", "parquet"])
def test_tables_go_into_files_and_come_back(results, tmp_path, format):
    paths = results.export(tmp_path / "tables", format)
    assert {path.suffix for path in paths} == {f".{format}"}
    assert {path.stem for path in paths} == set(results.tables())
    read = {"csv": pd.read_csv, "parquet": pd.read_parquet}[format]
    found = {path.stem: read(path) for path in paths}
    particles = found["particles_distal"]
    assert particles.groupby("generation")["weight"].sum().to_numpy() == pytest.approx(1)
    assert np.allclose(particles["E_f"], results.particles("distal")["E_f"], rtol=1e-14)
    name = next(name for name in found if name.startswith("samples_distal-1"))
    samples = found[name]
    assert set(samples["status"]) <= {"pending", *STATUSES}
    protocols = [column for column in samples if column.startswith("rmse_")]
    assert samples[protocols].sum(axis=1).to_numpy() == pytest.approx(samples["total_N"].to_numpy())
    assert "E_f" in set(found["sobol"]["parameter"])


def test_a_format_that_is_not_there(results, tmp_path):
    with pytest.raises(SinewError, match="csv or parquet"):
        results.export(tmp_path, "pickle")
    with pytest.raises(SinewError, match="no evaluations 'x'"):
        results.samples("x")


def test_a_database_with_a_program_is_refused(copied_run):
    with closing(sqlite3.connect(copied_run / "infer" / "distal.db")) as database:
        database.execute("ALTER TABLE version RENAME TO version_of")
        endless = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) SELECT i AS version_num FROM n"
        database.execute(f"CREATE VIEW version AS {endless}")
        database.commit()
    with pytest.raises(BadInput, match=r"distal\.db: holds a view; expected what `sinew infer` writes"):
        sinew.results(copied_run).abc_history("distal")
    (copied_run / "infer" / "distal.db").write_bytes(b"no database at all")
    with pytest.raises(BadInput, match=r"distal\.db: damaged"):
        sinew.results(copied_run).abc_history("distal")


@pytest.mark.parametrize(
    "change",
    [
        "ALTER TABLE parameters ADD COLUMN more text GENERATED ALWAYS AS (printf('%.*c', 9, 'x')) VIRTUAL",
        "CREATE VIRTUAL TABLE more USING fts5(x)",
    ],
)
def test_a_database_whose_tables_compute_is_refused(copied_run, monkeypatch, change):
    assert sinew.results(copied_run).abc_history("distal").max_t >= 0
    with closing(sqlite3.connect(copied_run / "infer" / "distal.db")) as database:
        database.execute(change)
        database.commit()
    with pytest.raises(BadInput, match=r"distal\.db: holds a table that computes its content"):
        sinew.results(copied_run).abc_history("distal")
    monkeypatch.setattr("sinew.interop.MAX_FILE_BYTES", 1000)
    with pytest.raises(BadInput, match=r"distal\.db: has [0-9,]+ bytes"):
        sinew.results(copied_run).abc_history("distal")


def test_samples_that_the_store_does_not_hold_are_not_drawn(copied_run):
    path = copied_run / "sobol.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {"base_samples": 2**26}))
    with pytest.raises(BadInput, match="67,108,864 base samples of"):
        sinew.results(copied_run).salib_samples("distal/1")


def test_chunks_are_checked_before_they_become_a_table(copied_run):
    (table, *_) = open_store(copied_run).tables()
    chunk = copied_run / "store.zarr" / "evaluations" / table.name / "parameter" / "c" / "0"
    chunk.write_bytes(bytes(Zstd().encode(struct.pack("<I", 500_000_000))))
    with pytest.raises(StoreError, match="a chunk does not hold"):
        sinew.results(copied_run).samples(table.name)


def test_words_from_a_result_do_not_steer_the_terminal(tmp_path):
    evil = "\x1b]0;title\x07"
    calibration_of({evil: fit_of({evil: 1.0}, site=evil, method=evil)}).write(tmp_path)
    one = sinew.results(tmp_path)
    assert "\\x1b]0;title" in repr(one.calibrate)
    assert not {"\x1b", "\x07"} & set(repr(one) + repr(one.calibrate))


@pytest.mark.parametrize("names", [["E_f"] * 2, ["E_f", "x"]], ids=["twice", "unknown"])
def test_samples_of_other_parameters_are_not_drawn(copied_run, names):
    """A gigabyte of them would be, before they are looked for."""
    result = sinew.results(copied_run).sobol.result
    other = replace(result, names=tuple(names), bounds=result.bounds[:2])
    with pytest.raises(BadInput, match=rf"names: .*{names[1]}"):
        interop.salib_samples(other, copied_run, "distal/1")


def change_posterior(folder: Path, change: Callable[[h5py.File], object]) -> None:
    with h5py.File(folder / "infer" / "distal.nc", "r+") as file:
        change(file)


def external(file: h5py.File) -> None:
    shape = file["posterior/E_f"].shape
    del file["posterior/E_f"]
    secret = Path(file.filename).with_name("secret")
    secret.write_bytes(bytes(8 * int(np.prod(shape))))
    file["posterior"].create_dataset("E_f", shape, "f8", external=[(str(secret), 0, h5py.h5f.UNLIMITED)])


def compressed(file: h5py.File, chunk: bytes) -> None:
    made = file.create_dataset("more", (1000,), "i8", chunks=(1000,), compression="gzip")
    made.id.write_direct_chunk((0,), chunk)


def lists(count: int) -> np.ndarray:
    found = np.empty(count, object)
    found[:] = [np.zeros(1 + i, "i4") for i in range(count)]
    return found


POSTERIORS = {
    "external": (external, "E_f has its numbers elsewhere"),
    "link": (lambda file: file["posterior"].__setitem__("more", h5py.ExternalLink("x.nc", "/")), "more is a link"),
    "soft": (lambda file: file["posterior"].__setitem__("more", h5py.SoftLink("/posterior")), "more is a link"),
    "huge": (
        lambda file: file.create_dataset("more", (2**40,), "f8", chunks=(1024,)),
        "more has 1099511627776 numbers",
    ),
    "wide": (
        lambda file: file.create_dataset("more", (1000,), "S2000000", chunks=(1,)),
        "more has numbers of 2000000 bytes",
    ),
    "chunks": (
        lambda file: file.create_dataset("more", (10,), "f8", maxshape=(None,), chunks=(2**21,), compression="gzip"),
        "more has chunks of 2,097,152 numbers",
    ),
    "long attribute": (
        lambda file: file["posterior/E_f"].attrs.__setitem__("more", np.zeros(8100, "f8")),
        "E_f has an attribute of 64,800 bytes",
    ),
    "long text": (
        lambda file: file["posterior/E_f"].attrs.__setitem__("more", "x" * 60_000),
        "E_f has an attribute of 60,000 bytes",
    ),
    "texts as an attribute": (
        lambda file: file["posterior/E_f"].attrs.create("more", ["x" * 100] * 2, dtype=h5py.string_dtype()),
        "E_f has an attribute of 2 texts or lists",
    ),
    "lists as an attribute": (
        lambda file: file["posterior/E_f"].attrs.create("more", lists(9), dtype=h5py.vlen_dtype("i4")),
        "E_f has an attribute of 9 texts or lists",
    ),
    "bomb": (
        lambda file: compressed(file, zlib.compress(bytes(10**6))),
        "more has a chunk that holds more than it should",
    ),
    "no chunk": (
        lambda file: compressed(file, b"not compressed"),
        r"damaged \(.*\)",
    ),
    "another filter": (
        lambda file: file.create_dataset("more", (1000,), "i8", chunks=(1000,), compression="lzf"),
        "more is compressed in an unusual way",
    ),
    "parts of an attribute": (
        lambda file: file["posterior/E_f"].attrs.create(
            "more", np.array([("x",)], [("a", h5py.string_dtype())]), dtype=[("a", h5py.string_dtype())]
        ),
        "E_f has an attribute with parts that are no numbers",
    ),
    "parts": (
        lambda file: file.create_dataset("more", (4,), [("a", h5py.string_dtype())]),
        "more has parts that are no numbers",
    ),
    "texts": (
        lambda file: file.create_dataset("more", data=["x" * 70_000] * 20, dtype=h5py.string_dtype()),
        "more has texts of more than 1,048,576 bytes",
    ),
    "many attributes": (
        lambda file: [file["posterior/E_f"].attrs.__setitem__(f"a{i}", i) for i in range(200)] and None,
        "E_f has [0-9]+ attributes",
    ),
    "twice": (lambda file: file["posterior"].__setitem__("more", file["posterior/E_f"]), "more is there twice"),
    "many": (
        lambda file: [file.create_group(f"more{i}") for i in range(1000)] and None,
        "more[0-9]* is one of more than 1000 objects",
    ),
}


@pytest.mark.parametrize("kind", POSTERIORS)
def test_a_posterior_whose_numbers_are_elsewhere_is_refused(copied_run, kind):
    assert "posterior" in sinew.results(copied_run).arviz("distal").groups()
    change, words = POSTERIORS[kind]
    change_posterior(copied_run, change)
    with pytest.raises(BadInput, match=rf"distal\.nc: {words}; expected what `sinew infer` writes"):
        sinew.results(copied_run).arviz("distal")


def test_the_store_is_checked_before_it_opens_in_xarray(copied_run):
    """Zarr's codecs believe what a chunk says of itself."""
    (table, *_) = open_store(copied_run).tables()
    chunk = copied_run / "store.zarr" / "evaluations" / table.name / "wall_seconds" / "c" / "0"
    header = bytearray(chunk.read_bytes()[:16])
    chunk.write_bytes(header + chunk.read_bytes()[-4:])
    with pytest.raises(StoreError, match=r"a chunk claims [0-9,]+ bytes and has 20"):
        sinew.results(copied_run).xarray()
    names = [path.name for path in (copied_run / "store.zarr" / "sobol").iterdir() if path.is_dir()]
    (copied_run / "store.zarr" / "sobol" / names[0] / "zarr.json").unlink()
    chunk.unlink()
    with pytest.raises(StoreError, match="sobol: damaged"):
        sinew.results(copied_run).xarray()


def test_a_path_that_pyabc_would_cut_is_refused(copied_run, tmp_path):
    """What stands before the question mark would be opened, and written to."""
    shutil.copytree(copied_run, tmp_path / "a?b")
    with pytest.raises(BadInput, match=r"distal\.db: has a '\?' in its path"):
        sinew.results(tmp_path / "a?b").abc_history("distal")


@pytest.mark.parametrize("ending", ["-journal", "-wal", "-shm"])
def test_a_database_with_a_journal_is_refused(copied_run, ending):
    """SQLite deletes files that a journal names."""
    (copied_run / "infer" / f"distal.db{ending}").write_bytes(b"")
    with pytest.raises(BadInput, match=rf"distal\.db{ending}: is there"):
        sinew.results(copied_run).abc_history("distal")


def test_a_database_that_takes_too_long_to_check_is_refused(copied_run, monkeypatch):
    """One page that is named many times is a table without end."""
    monkeypatch.setattr("sinew.interop.STEP", 10)
    monkeypatch.setattr("sinew.interop.MAX_STEPS", 1)
    with pytest.raises(BadInput, match=r"distal\.db: damaged \(interrupted\)"):
        sinew.results(copied_run).abc_history("distal")
    monkeypatch.undo()
    path = copied_run / "infer" / "distal.db"
    content = path.read_bytes()
    with closing(sqlite3.connect(path)) as database:
        (root,) = database.execute("SELECT rootpage FROM sqlite_master WHERE name = 'parameters'").fetchone()
        (size,) = database.execute("PRAGMA page_size").fetchone()
    twice = bytearray(size)
    twice[0], twice[3:5], twice[5:7], twice[8:12] = 5, b"\0\1", (size - 6).to_bytes(2, "big"), root.to_bytes(4, "big")
    twice[12:14], twice[size - 6 :] = (size - 6).to_bytes(2, "big"), root.to_bytes(4, "big") + b"\x81\0"
    path.write_bytes(content[: (root - 1) * size] + twice + content[root * size :])
    with pytest.raises(BadInput, match=r"distal\.db: damaged"):
        sinew.results(copied_run).abc_history("distal")


def test_a_database_whose_schema_fills_the_memory_is_refused(copied_run):
    path = copied_run / "infer" / "distal.db"
    with closing(sqlite3.connect(path)) as database:
        database.execute("PRAGMA writable_schema=ON")
        rows = ((f"t{i:x}", f"t{i:x}", f"CREATE TABLE t{i:x}(a)") for i in range(40_000))
        database.executemany("INSERT INTO sqlite_master VALUES('table', ?, ?, 2, ?)", rows)
        database.commit()
    with pytest.raises(BadInput, match=r"distal\.db: (holds [0-9,]+ tables|takes too long|damaged)"):
        sinew.results(copied_run).abc_history("distal")


def edit(path: Path, change: Callable[[dict[str, Any]], object]) -> None:
    content = json.loads(path.read_text())
    change(content)
    path.write_text(json.dumps(content))


CONTRADICTIONS = {
    "compare": ("infer", lambda one: one.update(names=["x"] * len(one["names"]))),
    "predict": ("infer", lambda one: [site.update(specimens=[]) for site in one["sites"].values()]),
    "infer": ("calibrate", lambda one: [fit["parameters"].pop("E_f") for fit in one["specimens"].values()]),
}


@pytest.mark.parametrize("task", CONTRADICTIONS)
def test_a_result_that_contradicts_itself_is_one_line_where_another_task_uses_it(folder, copied_run, task, monkeypatch):
    monkeypatch.setattr(Workspace, "client", lambda self: pytest.fail("a cluster was started"))
    of, change = CONTRADICTIONS[task]
    (copied_run / f"{task}.json").unlink()
    edit(copied_run / f"{of}.json", change)
    with pytest.raises(BadInput, match=rf"{of}\.json: .*; expected what .*`sinew {of}` writes; run it again"):
        sinew.run(sinew.read_study(folder.parent / "study.yaml"), task, out=str(copied_run))


def test_a_result_that_contradicts_itself_is_one_line_in_a_notebook(copied_run):
    edit(copied_run / "sobol.json", lambda one: one.update(ST=[]))
    with pytest.raises(BadInput, match=r"sobol\.json: contradicts itself, or the store \("):
        repr(sinew.results(copied_run).sobol)


IMPOSSIBLE = [
    ("compare", lambda one: one["pairs"][0].update(auc=7.3), r"pairs\.0\.auc: 7\.3: expected 0 to 1"),
    (
        "compare",
        lambda one: one["pairs"][0]["interval"].__setitem__(1, -4.0),
        r"pairs\.0\.interval: .*: expected 0 to 1",
    ),
    ("compare", lambda one: one["pairs"][0].update(sites=["a", "b"]), "content: sites a, b, which are not compared"),
    ("compare", lambda one: one["component"].update(explained_variance=42), "explained_variance: 42: expected 0 to 1"),
    ("predict", lambda one: one["coverage"]["hdi"].update(all=4.2), "all: 4.2: expected 0 to 1"),
    ("predict", lambda one: one["coverage"]["hdi"].update(points=-7), "points: -7: expected at least 0"),
    ("predict", lambda one: one.update(failed=one["rows"] + 1), "content: [0-9]+ of [0-9]+ simulations failed"),
    ("calibrate", lambda one: first_fit(one).update(r2=dict.fromkeys(first_fit(one)["r2"], 55)), "r2.*: 55: expected"),
    ("calibrate", lambda one: first_fit(one).update(total_N=-3), "total_N: -3: expected at least 0"),
    (
        "calibrate",
        lambda one: first_fit(one)["parameters"].update(E_f=-1e9),
        "content: E_f -1e.09 of distal/1, outside",
    ),
    ("infer", lambda one: one.update(names=["x"]), "content: units: 3 of 1 parameters"),
    ("calibrate", lambda one: one.update(free=["x"] * 1001), "free: 1,001 entries; expected at most 1,000"),
]


def first_fit(one):
    return next(iter(one["specimens"].values()))


@pytest.mark.parametrize(("task", "change", "problem"), IMPOSSIBLE)
def test_a_result_that_cannot_be_is_one_line(copied_run, task, change, problem):
    edit(copied_run / f"{task}.json", change)
    with pytest.raises(BadInput, match=rf"{task}\.json: .*{problem}"):
        getattr(sinew.results(copied_run), task)


def test_a_result_that_cannot_be_drawn_is_one_line_in_a_notebook(copied_run):
    edit(copied_run / "sobol.json", lambda one: one.update(ST_conf=one["ST_conf"][1:]))
    with pytest.raises(BadInput, match=r"sobol\.json: contradicts itself, or the store \(ValueError: "):
        sinew.results(copied_run).sobol.plot()
    with pytest.raises(BadInput, match="sobol: figure"):
        sinew.results(copied_run).sobol.plot("nothing")


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ({"free": ["x"] * len(FREE)}, "content: free parameters that are named twice, or are no parameters"),
        ({"bounds": [[1.0, 0.0]] * len(FREE)}, "content: [A-Za-z_]+ [0-9.]+ of distal/1, outside its range 1 to 0"),
        ({"bounds": []}, f"content: {len(FREE)} free parameters, 0 ranges"),
    ],
)
def test_a_search_of_other_parameters_is_one_line_in_a_notebook(copied_run, change, problem):
    edit(copied_run / "calibrate.json", lambda one: one.update(change))
    with pytest.raises(BadInput, match=rf"calibrate\.json: {problem}"):
        sinew.results(copied_run).skopt_result("distal/1")
