"""Cohorts read back as they were written; whatever stands in their files is read as it is, or refused in one line."""

import csv
import io
import json
import tracemalloc
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from sinew.runner.errors import BadInput
from sinew.tasks.data import cohort
from sinew.tasks.data.cohort import COLUMNS, GEOMETRY, read_cohort, write_cohort
from sinew.tasks.data.sizes import LONGEST_MM, SHORTEST_MM
from sinew.tasks.data.text import BINARY
from sinew.tasks.data.virtual import virtual_cohort
from sinew.tasks.model import Curve, Protocol, Specimen
from tests.effort import at_most
from tests.tasks.cli.bad_input import HEADER, ROWS
from tests.tasks.inputs import CELLS, NUMBERS, mutated, quick, read_or_refuse, table

VALID_GEOMETRY = json.dumps(dict.fromkeys(GEOMETRY, 10.0))
SPECIMEN_JSON, PULL = "cohort/s01/specimen.json", "cohort/s01/pull.csv"


def read_cohort_or_refuse(curve: str | bytes = "", geometry: str | bytes = VALID_GEOMETRY) -> Specimen | None:
    """The only specimen of a cohort with this curve and geometry."""
    files = {PULL: curve or "\n".join([HEADER, *ROWS]), SPECIMEN_JSON: geometry}
    cohort = read_or_refuse(read_cohort, "cohort", files=files)
    return cohort and cohort.specimens[0]


@quick
@given(st.binary() | mutated("\n".join([HEADER, *ROWS, ""])))
@example(HEADER.encode() + b"\n0,0,0,9\n1,0,0,9\n2,0,0,9\n")
@example(HEADER.encode() + b"\n0,0,0,\n1,0,0,\n2,0,0,\n")
@example(b"\xef\xbb\xbf")
def test_any_bytes_as_curve(content):
    assert_read_as_it_stands(content, read_cohort_or_refuse(curve=content or b"\n"))


@quick
@given(st.lists(st.lists(CELLS, min_size=3, max_size=3) | st.lists(CELLS, max_size=4), max_size=5), st.booleans())
@example(rows=[["-1e308", "0", "0"], ["1e308", "0", "0"], ["1.1e308", "0", "0"]], in_order=False)
def test_any_cells_as_curve(rows, in_order):
    text = table(HEADER, [[str(i), *row[1:]] for i, row in enumerate(rows)] if in_order else rows)
    assert_read_as_it_stands(text.encode(), read_cohort_or_refuse(curve=text))


def assert_read_as_it_stands(content: bytes, specimen: Specimen | None) -> None:
    """An accepted curve holds the numbers of its file, nothing left out and nothing filled in."""
    if specimen is None:
        return
    (curve,) = specimen.curves
    cells = [row for row in csv.reader(io.StringIO(content.decode("utf-8-sig"), newline="")) if any(row)][1:]
    read = np.column_stack([curve.protocol.time_s, curve.protocol.displacement_mm, curve.force_N])
    assert read.tolist() == [[float(cell) for cell in row] for row in cells]
    assert np.isfinite(read).all()
    assert (np.diff(read[:, 0]) > 0).all()
    assert (read[:, 1] > -specimen.length_mm).all()


JSON_VALUES = st.recursive(
    st.none() | st.booleans() | NUMBERS | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
    max_leaves=5,
)


@quick
@given(st.binary() | mutated(VALID_GEOMETRY) | JSON_VALUES.map(json.dumps))
@example(f'{{"length_mm": {"9" * 5000}}}')
@example("[" * 100_000)
def test_any_bytes_as_specimen(content):
    assert_possible(read_cohort_or_refuse(geometry=content))


@quick
@given(st.dictionaries(st.sampled_from([*GEOMETRY, "donor", "note"]) | st.text(max_size=9), JSON_VALUES, max_size=3))
def test_any_values_as_specimen(values):
    assert_possible(read_cohort_or_refuse(geometry=json.dumps(json.loads(VALID_GEOMETRY) | values)))


def assert_possible(specimen: Specimen | None) -> None:
    if specimen is not None:
        assert all(SHORTEST_MM <= getattr(specimen, key) < LONGEST_MM for key in GEOMETRY)


@pytest.mark.parametrize(
    ("sources", "problem"),
    [
        (["T1.csv"], "sources: ['T1.csv']; expected a text for each protocol"),
        ({"pull": 3}, "sources: pull: 3; expected a text of at most 1,000 characters"),
        ({"pull": "x" * 1001}, "expected a text of at most 1,000 characters"),
    ],
)
def test_sources_are_texts(tmp_path, sources, problem):
    write_cohort(tmp_path / "cohort", virtual_cohort(seed=3, per_site=1, rate_hz=2.0)[0][:1])
    (described,) = (tmp_path / "cohort").rglob("specimen.json")
    described.write_text(json.dumps(json.loads(described.read_text()) | {"sources": sources}))
    with pytest.raises(BadInput) as refused:
        read_cohort(tmp_path / "cohort")
    assert problem in str(refused.value)


# ---- round trip


def written_and_read(specimen: Specimen) -> Specimen:
    with TemporaryDirectory() as folder:
        write_cohort(Path(folder, "cohort"), [specimen])
        (read,) = read_cohort(Path(folder, "cohort")).specimens
    assert (read.name, read.donor) == (specimen.name, specimen.donor)
    assert all(getattr(read, key) == getattr(specimen, key) for key in GEOMETRY)
    assert [curve.name for curve in read.curves] == sorted(curve.name for curve in specimen.curves)
    assert {curve.name: curve.source for curve in read.curves} == {c.name: c.source for c in specimen.curves}
    return read


def numbers(specimen: Specimen) -> dict[str, np.ndarray]:
    """``[3, t]`` by protocol: the columns of each file."""
    return {
        curve.name: np.array([curve.protocol.time_s, curve.protocol.displacement_mm, curve.force_N])
        for curve in specimen.curves
    }


@st.composite
def specimens(draw: st.DrawFn, values: st.SearchStrategy[float]) -> Specimen:
    """Times are steps of a tenth of a millisecond and more, so that 10 digits tell them apart."""

    def curve(name: str) -> Curve:
        steps = draw(st.lists(st.integers(1, 10**6), min_size=3, max_size=20))
        times = np.cumsum(steps) / 1e4
        columns = [draw(st.lists(values, min_size=len(steps), max_size=len(steps))) for _ in COLUMNS[1:]]
        displacement, force = np.array(columns)
        return Curve(Protocol(name, times, np.abs(displacement)), force, source=source)

    name = st.from_regex(r"[A-Za-z0-9][A-Za-z0-9_+.-]{0,20}", fullmatch=True)
    folder = draw(name.filter(lambda text: Path(text).suffix.lower() not in {*BINARY, ".csv"}))
    site = draw(st.sampled_from(["", "distal/"]))
    sizes = draw(st.tuples(*[st.floats(SHORTEST_MM, LONGEST_MM, exclude_max=True)] * 3))
    protocols = draw(st.sets(st.sampled_from(["pull", "one_step", "cyclic.2", "A+b"]), min_size=1, max_size=2))
    source = draw(st.sampled_from(["", "T1.xlsx, test 2: force from 'Kraft' in kN"]))
    donor = draw(st.none() | st.text(max_size=5))
    return Specimen(site + folder, *sizes, tuple(curve(protocol) for protocol in sorted(protocols)), donor)


FEW_DIGITS = st.builds(lambda digits, power: digits / 10**power, st.integers(-(10**9), 10**9), st.integers(0, 9))


@settings(quick, max_examples=30)
@given(specimens(FEW_DIGITS) | specimens(st.floats(-1e30, 1e30)))
def test_what_is_written_reads_back_to_ten_digits(specimen):
    """Numbers of at most ten digits read back to the same bits."""
    read = numbers(written_and_read(specimen))
    for name, written in numbers(specimen).items():
        assert np.array_equal(read[name], [[float(f"{value:.10g}") for value in column] for column in written])


def test_nothing_is_overwritten(tmp_path):
    t = np.array([0.0, 1.0, 2.0])
    specimen = Specimen("s1", 10.0, 8.0, 4.0, (Curve(Protocol("pull", t, t / 10), t),))
    write_cohort(tmp_path, [specimen], {"seed": 1})
    assert json.loads((tmp_path / "truth.json").read_text()) == {"seed": 1}
    with pytest.raises(BadInput, match="s1: is there already; expected a new folder"):
        write_cohort(tmp_path, [specimen])
    assert (tmp_path / "s1" / "pull.csv").read_text() == "time_s,displacement_mm,force_N\n0,0,0\n1,0.1,1\n2,0.2,2\n"


def test_a_cohort_is_not_written_through_links(tmp_path):
    specimens, truth = virtual_cohort(seed=1, per_site=1, rate_hz=1.0)
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "distal").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(BadInput, match=r"a/distal: is a link; expected a folder"):
        write_cohort(tmp_path / "a", specimens[:1], truth)
    (tmp_path / "b").mkdir()
    (tmp_path / "victim").write_text("mine")
    (tmp_path / "b" / "truth.json").symlink_to(tmp_path / "victim")
    write_cohort(tmp_path / "b", specimens[:1], truth)
    assert (tmp_path / "victim").read_text() == "mine"
    assert "specimens" in json.loads((tmp_path / "b" / "truth.json").read_text())
    (tmp_path / "c").mkdir()
    (tmp_path / "c" / "distal").mkdir()
    (tmp_path / "c" / "distal" / "1").symlink_to(tmp_path / "nowhere")
    with pytest.raises(BadInput, match="is there already"):
        write_cohort(tmp_path / "c", specimens[:1])


def specimen_folder(folder: Path) -> Path:
    (folder / "A").mkdir()
    (folder / "A" / "specimen.json").write_text('{"length_mm": 10, "width_mm": 8, "thickness_mm": 4}')
    return folder / "A"


def test_a_row_of_very_many_cells_is_refused_before_it_fills_the_memory(tmp_path):
    """pandas would make a column of each."""
    curve = specimen_folder(tmp_path) / "ramp.csv"
    for row in ("1," * 3_000_000 + "1", "1," * 50_000 + "1"):
        curve.write_text(f"time_s,displacement_mm,force_N\n{row}\n")
        tracemalloc.start()
        try:
            with pytest.raises(BadInput, match=r"ramp\.csv: row 2: (6,000,00. characters|50001 cells); expected"):
                read_cohort(tmp_path)
            assert tracemalloc.get_traced_memory()[1] < 150 * 2**20
        finally:
            tracemalloc.stop()


def test_a_key_that_is_given_twice_is_found_in_time(tmp_path):
    keys = ",".join(f'"{number:x}": 0' for number in range(70_000))
    (specimen_folder(tmp_path) / "specimen.json").write_text(f'{{{keys}, "1": 0}}')
    (tmp_path / "A" / "ramp.csv").write_text("time_s,displacement_mm,force_N\n0,0,0\n1,1,1\n2,2,2\n")
    with at_most(10), pytest.raises(BadInput, match=r"specimen\.json: 1: given twice"):
        read_cohort(tmp_path)


def test_links_do_not_make_one_curve_many(tmp_path, monkeypatch):
    folder = specimen_folder(tmp_path)
    rows = "".join(f"{number},{number % 9},1\n" for number in range(100))
    (folder / "ramp.csv").write_text(f"time_s,displacement_mm,force_N\n{rows}")
    for number in range(4):
        (folder / f"again{number}.csv").symlink_to("ramp.csv")
    monkeypatch.setattr(cohort, "MAX_POINTS", 100)
    assert len(read_cohort(tmp_path).specimens[0].curves) == 5
    for left, most in (((1499, 9), "100,000,000 numbers"), ((1500, 4), "10,000 curves")):
        monkeypatch.setattr(cohort._Room.__init__, "__defaults__", left)
        with pytest.raises(BadInput, match=f"more than {most}; expected fewer or thinner curves"):
            read_cohort(tmp_path)
    monkeypatch.setattr(cohort, "MAX_POINTS", 99)
    with pytest.raises(BadInput, match="100 rows of numbers; expected at most 99; every second or tenth row will do"):
        read_cohort(tmp_path)
