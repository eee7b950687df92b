"""Whatever stands in a file, reading it gives a valid object or ``BadInput`` in one printable line that names the file.

Curves that are written read back: to the same 10 significant digits, and to the same bits when they have no more.
"""

import csv
import io
import json
import math
from collections.abc import Callable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import yaml
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from tasks.bench_exports import Reading, read_export
from tasks.cohort import write_cohort
from tasks.measurements import COLUMNS, GEOMETRY, read_cohort
from tasks.model import TENDON, Curve, Model, Protocol, Specimen
from tasks.problems import BadInput
from tasks.simulations import read_parameters
from tasks.study import Study, read_study
from tests.tasks.test_bad_input import EXPORT, HEADER, PARAMETERS, ROWS, STUDY

quick = settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.too_slow])
VALID_GEOMETRY = json.dumps(dict.fromkeys(GEOMETRY, 10.0))
SPECIMEN_JSON, PULL = "cohort/s01/specimen.json", "cohort/s01/pull.csv"


def read_or_refuse(read: Callable[[Path], Any], path: str, *, files: dict[str, str | bytes]) -> Any:
    """What ``read`` makes of the file at ``path``, or None when it says in one line what is wrong with it."""
    with TemporaryDirectory() as folder:
        for name, content in files.items():
            file = Path(folder, name)
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(content.encode() if isinstance(content, str) else content)
        try:
            return read(Path(folder, path))
        except BadInput as problem:
            line = str(problem)
            assert line.isprintable()
            assert line.startswith(folder)
            assert "; expected " in line
            return None


def read_study_or_refuse(text: str | bytes) -> Study | None:
    return read_or_refuse(read_study, "study.yaml", files={"study.yaml": text})


def read_cohort_or_refuse(curve: str | bytes = "", geometry: str | bytes = VALID_GEOMETRY) -> Specimen | None:
    """The only specimen of a cohort with this curve and geometry."""
    files = {PULL: curve or "\n".join([HEADER, *ROWS]), SPECIMEN_JSON: geometry}
    cohort = read_or_refuse(read_cohort, "cohort", files=files)
    return cohort and cohort.specimens[0]


def mutated(valid: str) -> st.SearchStrategy[bytes]:
    """A valid file with a few pieces replaced by others."""
    piece = st.binary(max_size=4) | st.sampled_from(
        [b"", b",", b"\n", b"\r", b'"', b";", b"-", b".", b"e9", b"e308", b"\0", b"\xff", b"nan", b"inf", b"_", b"1 "]
    )
    edit = st.tuples(st.integers(0, len(valid)), st.integers(0, 3), piece)

    def apply(edits: list[tuple[int, int, bytes]]) -> bytes:
        content = valid.encode()
        for start, length, new in edits:
            content = content[:start] + new + content[start + length :]
        return content

    return st.lists(edit, min_size=1, max_size=4).map(apply)


# ---- the study file

YAML_PIECES = (
    "name: a\n|seed: |sobol: |points|: |- |  |\n|{|}|[|]|, |'|\"|#|>\n|!!int |!!float |!!bool |!!timestamp |!!binary "
    "|!!set |!!omap |!!str |!x |&a |*a|<<: |? |---\n|...\n|%YAML 1.1\n|0x|0b|1:60|1e3|.nan|-.inf|null|~|yes|\t|\0|\x85|"
    "\u2028|\\ud800|=|@|`|%|1|_|2001-01-01|febio|model: "
)


@quick
@given(st.text() | st.lists(st.sampled_from(YAML_PIECES.split("|")), max_size=12).map("".join))
@example("name: !!timestamp x")
@example("name: !!bool x")
@example("name: !!int ''")
@example("name: !!float ''")
@example("name: a\nseed: 0x" + "f" * 5000)
@example('name: "\\ud800"')
@example('"\\ud800": a')
def test_any_text_as_study(text):
    study = read_study_or_refuse(text)
    assert study is None or len(study.tendon().names) == len(TENDON)


@quick
@given(st.binary() | mutated(yaml.safe_dump(STUDY)))
def test_any_bytes_as_study(content):
    read_study_or_refuse(content)


NUMBERS = st.integers(-(10**400), 10**400) | st.integers(-3, 300) | st.floats() | st.sampled_from([0, 1e-320, 1e308])
SCALARS = st.none() | st.booleans() | NUMBERS | st.text(max_size=8) | st.dates() | st.binary(max_size=4)
WORDS = st.sampled_from(["febio", "uniaxial", "local", "address", "all", "sobol", "importance", "s01", "MPa", "name"])
VALUES = st.recursive(
    SCALARS | WORDS,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4) | WORDS, inner, max_size=3),
    max_leaves=4,
)


def places(section: Any, place: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    if place:
        yield place
    for key in section if isinstance(section, dict) else range(len(section)) if isinstance(section, list) else ():
        yield from places(section[key], (*place, key))


@quick
@given(st.lists(st.tuples(st.sampled_from(list(places(STUDY))), st.none() | st.text(max_size=5), VALUES), max_size=3))
def test_mutated_study(mutations):
    study = json.loads(json.dumps(STUDY))
    for place, new_name, value in mutations:
        section = study
        for key in place[:-1]:
            if isinstance(section, dict) and key in section and isinstance(section[key], dict):
                section = section[key]
        section[place[-1] if new_name is None else new_name] = value
    read = read_study_or_refuse(yaml.safe_dump(study, allow_unicode=True))
    assert mutations or read is not None
    if read is not None:
        assert all(math.isfinite(p.minimum) and p.minimum <= p.reference <= p.maximum for p in read.tendon().parameters)
        assert read.seed in range(2**32)


# ---- measured curves, specimens and parameters

CELLS = st.one_of(
    st.floats(0, 100).map(repr),
    st.integers(0, 99).map(str),
    st.floats().map(repr),
    st.text(st.characters(codec="utf-8"), max_size=3),
    st.sampled_from(["", " ", " 1", "1 ", "+1", "0x10", "1d5", "1_0", "1e999", "True", "NA", '"1"', "1\0", "٣", "1,2"]),
)


def table(header: str, rows: list[list[str]]) -> str:
    return "\n".join([header, *(",".join(row) for row in rows)]) + "\n"


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
        assert all(0 < getattr(specimen, key) < 1e4 for key in GEOMETRY)


@quick
@given(
    st.binary()
    | mutated(PARAMETERS)
    | st.lists(CELLS, max_size=4).map(lambda cells: table("nu_m", [[c] for c in cells]))
)
@example(b"\xef\xbb\xbf")
@example(b"\n")
@example(b"E_f,nu_m\n200,0.3,1\n")
def test_any_bytes_as_parameters(content):
    model = Model()
    values = read_or_refuse(lambda path: read_parameters(path, model), "rows.csv", files={"rows.csv": content})
    if values is not None:
        assert values.shape[1] == len(TENDON)
        assert all(p.possible(value) for row in values for p, value in zip(model.parameters, row, strict=True))


# ---- exports of the testing machine

EXPORT_PIECES = (
    'Time|Extension|Load|Length|Diameter|Width|Hold|,|;|\n|\r|"|(s)|[mm]|(kN)|(N)|mm|in|1|2.5|-3|1e308|nan| : |\0|µm|()'
    "|(\n)|Time,Extension,Load\n(s),(mm),(N)\n|Length,10,mm\n|Diameter,5,mm\n|1,1,1\n|2,2,2\n|3,3,3\n"
)


RATIOS = "Time (s),L,F,SD\n2,0.95,0.5,0.1\n2.5,1.045,4,0.2\n3,1.14,10,0.3\n4,1.14,8,0.3\n"


@quick
@given(st.binary() | mutated(RATIOS))
@example(RATIOS.replace("1.14", "1e-320"))
def test_any_bytes_as_ratios(content):
    reading = Reading(stress="kPa", time="s", reference=0.95)
    specimen = read_or_refuse(lambda path: read_export(path, reading=reading), "test.csv", files={"test.csv": content})
    assert_possible(specimen)
    if specimen is not None:
        (curve,) = specimen.curves
        assert np.isfinite([curve.protocol.time_s, curve.protocol.displacement_mm, curve.force_N]).all()
        assert curve.protocol.displacement_mm.min() > -specimen.length_mm


@quick
@given(st.binary() | mutated(EXPORT) | st.lists(st.sampled_from(EXPORT_PIECES.split("|")), max_size=30).map("".join))
@example("a\rb")
@example("x" * 200_000)
@example(EXPORT.replace("(N)", "(kN)").replace("5.0", "1e307"))
@example(EXPORT.replace('"2.0"', '"1e308"').replace('"0.0"', '"-1e308"'))
def test_any_bytes_as_export(content):
    specimen = read_or_refuse(read_export, "test.csv", files={"test.csv": content})
    assert_possible(specimen)
    if specimen is not None:
        (curve,) = specimen.curves
        assert np.isfinite([curve.protocol.time_s, curve.protocol.displacement_mm, curve.force_N]).all()
        assert (np.diff(curve.protocol.time_s) > 0).all()
        assert curve.protocol.displacement_mm.min() > -specimen.length_mm


# ---- round trip


def written_and_read(specimen: Specimen) -> Specimen:
    with TemporaryDirectory() as folder:
        write_cohort(Path(folder, "cohort"), [specimen])
        (read,) = read_cohort(Path(folder, "cohort")).specimens
    assert (read.name, read.donor) == (specimen.name, specimen.donor)
    assert all(getattr(read, key) == getattr(specimen, key) for key in GEOMETRY)
    assert [curve.name for curve in read.curves] == sorted(curve.name for curve in specimen.curves)
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
        return Curve(Protocol(name, times, np.abs(displacement)), force)

    name = st.from_regex(r"[A-Za-z0-9][A-Za-z0-9_+.-]{0,20}", fullmatch=True)
    folder = draw(name.filter(lambda text: Path(text).suffix.lower() not in UNUSABLE))
    site = draw(st.sampled_from(["", "distal/"]))
    sizes = draw(st.tuples(*[st.floats(0, 1e4, exclude_min=True, exclude_max=True)] * 3))
    protocols = draw(st.sets(st.sampled_from(["pull", "one_step", "cyclic.2", "A+b"]), min_size=1, max_size=2))
    donor = draw(st.none() | st.text(max_size=5))
    return Specimen(site + folder, *sizes, tuple(curve(protocol) for protocol in sorted(protocols)), donor)


UNUSABLE = {".pkl", ".pickle", ".p", ".npy", ".npz", ".joblib", ".dill", ".pt", ".mat", ".csv"}
FEW_DIGITS = st.builds(lambda digits, power: digits / 10**power, st.integers(-(10**9), 10**9), st.integers(0, 9))


@quick
@given(specimens(FEW_DIGITS))
def test_few_digits_read_back_to_the_same_bits(specimen):
    read = numbers(written_and_read(specimen))
    for name, written in numbers(specimen).items():
        assert np.array_equal(read[name], written)


@quick
@given(specimens(st.floats(-1e30, 1e30)))
def test_any_numbers_read_back_to_ten_digits(specimen):
    read = numbers(written_and_read(specimen))
    for name, written in numbers(specimen).items():
        assert np.array_equal(read[name], [[float(f"{value:.10g}") for value in column] for column in written])
