"""`sinew init`: a person's own files become a cohort and a study that runs as it is."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sinew.runner.errors import BadInput
from sinew.tasks.data.answers import Answers
from sinew.tasks.data.cohort import read_cohort
from sinew.tasks.data.hints import Hints
from sinew.tasks.data.init import Files, init, read_all, specimens_of
from sinew.tasks.data.names import names_of
from sinew.tasks.data.new_study import NewSpecimen
from sinew.tasks.data.specimen_sizes import Sizes, size_of
from sinew.tasks.study.study import read_study
from sinew.tasks.study.workspace import Workspace
from tests.tasks.study.test_pipeline import sinew

BAR = Sizes(10.0, 8.0, 4.0)
BAR_OPTIONS = ("--length-mm", 10, "--width-mm", 8, "--thickness-mm", 4)


def table(path: Path, header: str = "time_s,displacement_mm,force_N", scale: float = 1.0) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    rows = [f"{i},{min(0.1 * i, 0.4):g},{scale * 20 * min(i, 4):g}" for i in range(12)]
    path.write_text("\n".join([header, *rows, ""]), "utf-8")
    return path


def new_specimens(*paths: Path, sizes: Sizes = BAR) -> list[NewSpecimen]:
    """What init makes of files, before it is written."""
    return specimens_of(read_all(Files(paths, ()), Hints()).recordings, names_of(paths), sizes)


def refused(capsys: pytest.CaptureFixture[str], *words: object) -> str:
    with pytest.raises(SystemExit) as stopped:
        sinew(*words)
    said = capsys.readouterr()
    assert (stopped.value.code, said.out, said.err.count("\n")) == (2, "", 1)
    return said.err


# ---- the command


def test_the_study_runs_as_it_is(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(Workspace, "client", lambda self: None)  # in this process
    table(tmp_path / "T1_relax.csv", "Time (min),Standardweg [um],Load (kN)")
    study = tmp_path / "out" / "study.yaml"
    sinew("init", tmp_path / "T1_relax.csv", "--out", tmp_path / "out", *BAR_OPTIONS)
    said = capsys.readouterr().out
    assert "specimen T1: 10 x 8 x 4 mm" in said
    assert "displacement from 'Standardweg [um]' in um (sure)" in said
    assert said.splitlines()[-1] == f"next: sinew run {study}"
    (curve,) = read_cohort(tmp_path / "out" / "cohort").specimens[0].curves
    np.testing.assert_allclose(curve.force_N[-1], 80_000)
    study.write_text(
        study.read_text().replace("points: 20000", "base_samples: 4").replace("resamples: 200", "resamples: 10")
    )
    sinew("sobol", study, "--out", tmp_path / "results", "--workers", 1, "--quiet")
    assert json.loads((tmp_path / "results" / "sobol.json").read_text())["failed"] == 0


def test_sizes_that_nobody_tells_are_to_be_filled_in(tmp_path, capsys):
    table(tmp_path / "T1_relax.csv")
    sinew("init", tmp_path / "T1_relax.csv", "--out", tmp_path / "out", "--length-mm", 10)
    said = capsys.readouterr().out
    described = tmp_path / "out" / "cohort" / "T1" / "specimen.json"
    assert f"fill in: {described}" in said
    assert json.loads(described.read_text())["width_mm"] is None


def test_a_unit_that_is_missing_is_refused_and_nothing_is_written(tmp_path, capsys):
    table(tmp_path / "T1_relax.csv", "time_s,displacement_mm,force")
    told = refused(capsys, "init", tmp_path / "T1_relax.csv", "--out", tmp_path / "out")
    assert "'force': no unit of the force can be found; expected --force-unit, one of N, kN, mN" in told
    assert told.rstrip().endswith(", dyn; `sinew import --dry-run` lists what is open")
    assert not (tmp_path / "out").exists()
    sinew("init", tmp_path / "T1_relax.csv", "--out", tmp_path / "out", "--force-unit", "mN", "--json")
    made = json.loads(capsys.readouterr().out)
    assert made["study"] == str(tmp_path / "out" / "study.yaml")
    assert made["fill_in"] == [str(tmp_path / "out" / "cohort" / "T1" / "specimen.json")]
    assert made["told"][0] == "specimen T1: ? x ? x ? mm (length x width x thickness)"


@pytest.mark.parametrize(
    "words", [(), ("absent.csv",), (".",), ("--length-mm", "-1", "a.csv"), ("--length-mm", "nan", "a.csv")]
)
def test_wrong_arguments(tmp_path, capsys, monkeypatch, words):
    monkeypatch.chdir(tmp_path)
    if "a.csv" in words:
        table(tmp_path / "a.csv")
    refused(capsys, "init", *words, "--out", "out")
    assert not (tmp_path / "out").exists()


def test_import_reads_what_init_reads(tmp_path):
    path = table(tmp_path / "T1.dat", "time_s,displacement_mm,Cell A")
    path.write_text(path.read_text().replace(",", "\t"))
    hints = ("--force-column", "3", "--force-unit", "kN")
    sinew("import", path, *hints, "--length-mm", 10, "--area-mm2", 32, "--out", tmp_path / "imported")
    sinew("init", path, *hints, *BAR_OPTIONS, "--out", tmp_path / "study")
    imported, ours = (read_cohort(tmp_path / name).specimens[0] for name in ("imported", "study/cohort"))
    assert imported.curves[0].digest == ours.curves[0].digest
    assert imported.area_mm2 == pytest.approx(ours.area_mm2)


# ---- what it writes


def test_a_cohort_is_used_where_it_is(tmp_path):
    init([table(tmp_path / "T1_relax.csv")], tmp_path / "first", sizes=BAR)
    cohort = tmp_path / "first" / "cohort"
    made = init([cohort], tmp_path / "second")
    assert made.lines[0] == f"{cohort}: a cohort of 1 specimen, 1 curve, used as it is"
    assert made.lines[1].startswith(
        "ranges: scaled to these tests, as those of human tendon do not fit (strain 0 to 4 %; T1 relax has "
    )
    study = read_study(made.study)
    assert study.cohort == "../first/cohort"
    assert study.cohort_path.resolve() == cohort.resolve()
    with pytest.raises(BadInput, match="lies inside the cohort"):
        init([cohort], cohort / "study")


@pytest.mark.parametrize("taken", ["study.yaml", "cohort/x"])
def test_nothing_is_overwritten(tmp_path, taken):
    table(tmp_path / "out" / taken)
    with pytest.raises(BadInput, match="is there already"):
        init([table(tmp_path / "a.csv")], tmp_path / "out")


def test_the_same_numbers_twice_are_refused(tmp_path):
    with pytest.raises(BadInput, match="same numbers"):
        init([table(tmp_path / "y.csv"), table(tmp_path / "z.csv")], tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_links_and_names_with_separators_stay_inside(tmp_path):
    path = table(tmp_path / "bench" / "x\\..\\y_relax.csv")
    (tmp_path / "bench" / "etc").symlink_to("/etc")
    init([path.parent], tmp_path / "out", sizes=BAR)
    written = {str(file.relative_to(tmp_path / "out")) for file in (tmp_path / "out").rglob("*")}
    assert written == {
        "answers.yaml",
        "study.yaml",
        "cohort",
        "cohort/x_y",
        "cohort/x_y/relax.csv",
        "cohort/x_y/specimen.json",
    }


def test_a_header_block_tells_sizes(tmp_path):
    block = 'Specimen properties : Length,"1.2",cm\nSpecimen properties : Diameter,"2.0",mm\n\n'
    (new,) = new_specimens(table(tmp_path / "tail.csv", f"{block}Time,Extension,Load\n(s),(mm),(N)"), sizes=Sizes())
    assert new.specimen.length_mm == 12
    assert new.specimen.area_mm2 == pytest.approx(np.pi)
    assert not new.missing


@pytest.mark.parametrize("line", ["Length,12", "Length at break (mm),12", "Length (mm),about 12", "Length (N),12"])
def test_a_size_without_a_clear_unit_and_number_is_not_known(tmp_path, line):
    path = table(tmp_path / "tail.csv", f"{line}\nTime (s),Extension (mm),Load (N)")
    (recording,) = read_all(Files((path,), ()), Hints()).recordings
    assert size_of(recording, "length") is None
    (new,) = new_specimens(path, sizes=Sizes(None, 8.5, 4))
    assert new.missing == ("length",)


def test_sizes_that_disagree_are_told_with_both_files(tmp_path):
    first = table(tmp_path / "A_relax.csv", "Width (mm),8.5\nTime (s),Extension (mm),Load (N)")
    other = table(tmp_path / "A_cyclic.csv", "Width (mm),9\nTime (s),Extension (mm),Load (N)")
    with pytest.raises(BadInput) as told:
        new_specimens(first, other, sizes=Sizes())
    assert f"{other}: a width of 9 mm, but 8.5 mm in {first}, of the same specimen A" in str(told.value)
    assert "--width-mm" in str(told.value)
    (new,) = new_specimens(first, other, sizes=replace(BAR, override=True))
    assert new.specimen.width_mm == 8.0
    assert new.notes == tuple(
        f"width 8 mm by --width-mm; A_{name} mm" for name in ("relax.csv gives 8.5", "cyclic.csv gives 9")
    )


@pytest.mark.parametrize(
    ("header", "last"),
    [
        ("time_s,strain (%),force_N", 0.04),
        ("time_s,Position (mm),force_N", 0.4),
        ("time_s,displacement_mm,stress (MPa)", 0.4),
    ],
)
def test_strains_positions_and_stresses(tmp_path, header, last):
    (new,) = new_specimens(table(tmp_path / "a.csv", header))
    (curve,) = new.specimen.curves
    np.testing.assert_allclose(curve.protocol.displacement_mm[[0, -1]], [0, last], atol=1e-12)
    assert curve.force_N[-1] == pytest.approx(80 * 32 if "stress" in header else 80)


def test_the_first_of_lengths_is_the_gauge_length_if_nobody_says(tmp_path):
    path = table(tmp_path / "a.csv", "time_s,Length (mm),force_N")
    path.write_text(path.read_text().replace(",0.", ",12.").replace("0,0,0", "0,12,0"))
    (new,) = new_specimens(path, sizes=Sizes(None, 8.0, 4.0))
    assert new.specimen.length_mm == 12.0
    assert new.notes == ("gauge length 12 mm, likely: the length in the first row",)


def test_the_first_of_lengths_is_not_certain_to_be_the_gauge_length(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("time_s,Length (mm),force_N\n0,12,0\n1,12.1,5\n2,12.2,9\n")
    told = {"sizes": Sizes(None, 8.0, 4.0), "hints": Hints(displacement_column="2"), "certain": True}
    with pytest.raises(
        BadInput, match=r"12 mm, the length in the first row, is likely, not certain; expected --length-mm"
    ):
        init([path], tmp_path / "out", **told)
    made = init([path], tmp_path / "out", **told, answers=Answers(sizes={"a": {"length": 11.0}}))
    assert made.specimens[0].length_mm == 11.0


@pytest.mark.parametrize("header", ["time_s,strain (%),force_N", "time_s,displacement_mm,stress (MPa)"])
def test_what_needs_a_size_is_refused_without_it(tmp_path, header):
    with pytest.raises(BadInput, match=r"expected --(length|width)-mm"):
        new_specimens(table(tmp_path / "a.csv", header), sizes=Sizes())


def test_forces_below_zero_are_remarked_on(tmp_path):
    (new,) = new_specimens(table(tmp_path / "a.csv", scale=-1.0))
    assert any("forces are negative" in note for note in new.notes)
