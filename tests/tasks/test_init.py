"""`sinew init`: a person's own files become a cohort and a study that runs as it is."""

import json
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tasks import cli
from tasks.guess import Hints
from tasks.init import Sizes, init
from tasks.measurements import read_cohort
from tasks.problems import BadInput
from tasks.study import read_study
from tasks.workspace import Workspace

BAR = Sizes(10.0, 8.0, 4.0)
OF_TEMPLATES = {"protocols", "specimen", "output"}  # no study of measured tissue has them


def table(path: Path, header: str = "time_s,displacement_mm,force_N", scale: float = 1.0) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    rows = [f"{i},{min(0.1 * i, 0.4):g},{scale * 20 * min(i, 4):g}" for i in range(12)]
    path.write_text("\n".join([header, *rows, ""]), "utf-8")
    return path


def sinew(*words: object) -> None:
    argv, sys.argv = sys.argv, ["sinew", *map(str, words)]
    try:
        cli.main()
    finally:
        sys.argv = argv


def refused(capsys: pytest.CaptureFixture[str], *words: object) -> str:
    with pytest.raises(SystemExit) as stopped:
        sinew(*words)
    said = capsys.readouterr()
    assert (stopped.value.code, said.out, said.err.count("\n")) == (2, "", 1)
    return said.err


def names(folder: Path) -> dict[str, list[str]]:
    return {one.name: [curve.name for curve in one.curves] for one in read_cohort(folder).specimens}


@pytest.mark.parametrize(
    ("files", "found"),
    [
        (["T1_relax.csv", "T1_cyclic.csv", "T2_relax.csv"], {"T1": ["cyclic", "relax"], "T2": ["relax"]}),
        (["relaxation-01.csv", "relaxation-02.csv"], {"bench": ["relaxation_01", "relaxation_02"]}),
        (["A/one_step.csv", "A/cyclic.csv", "B/cyclic.csv"], {"A": ["cyclic", "one_step"], "B": ["cyclic"]}),
        (["d/1/ramp.csv", "d/2/ramp.csv", "p/1/ramp.csv"], {"d/1": ["ramp"], "d/2": ["ramp"], "p/1": ["ramp"]}),
        (["d/x_ramp.csv", "p/y_ramp.csv"], {"d/x": ["ramp"], "p/y": ["ramp"]}),
        (["A_p1.csv", "A_p2.csv", "B_p1.csv", "B_p2.csv"], {"A": ["p1", "p2"], "B": ["p1", "p2"]}),
        (["mouse one.csv", "Mäuse (2).csv"], {"Mause_2": ["test"], "mouse_one": ["test"]}),
        (["hold2_S7.txt", "hold1_S7.txt"], {"S7": ["hold1", "hold2"]}),
    ],
)
def test_names_of_files_say_specimen_and_protocol(tmp_path, files, found):
    for number, name in enumerate(files):
        table(tmp_path / "bench" / name, scale=1 + number)
    made = init([tmp_path / "bench"], tmp_path / "out", sizes=BAR)
    assert names(tmp_path / "out" / "cohort") == found
    assert not made.missing
    assert read_study(made.study).cohort_path == tmp_path / "out" / "cohort"


def test_what_was_guessed_is_said(tmp_path, capsys):
    table(tmp_path / "T1_relax.csv", "Time (min),Standardweg [um],Load (kN)")
    sizes = ("--length-mm", 10, "--width-mm", 8, "--thickness-mm", 4)
    sinew("init", tmp_path / "T1_relax.csv", "--out", tmp_path / "out", *sizes)
    said = capsys.readouterr().out
    assert "specimen T1: 10 x 8 x 4 mm" in said
    assert "time from 'Time (min)' in min (sure), displacement from 'Standardweg [um]' in um (likely)" in said
    assert "force from 'Load (kN)' in kN (sure)" in said
    assert "12 points, 660 s, displacement 0 to 0.0004 mm (strain to 0.004 %), force 0 to 8e+04 N" in said
    assert said.splitlines()[-1] == f"next: sinew run {tmp_path / 'out' / 'study.yaml'}"
    (curve,) = read_cohort(tmp_path / "out" / "cohort").specimens[0].curves
    np.testing.assert_allclose(curve.force_N[-1], 80_000)


def test_the_study_explains_every_field_and_holds_every_task(tmp_path):
    for site in ("d", "p"):
        table(tmp_path / "bench" / site / "x_cyclic.csv", scale=1 if site == "d" else 2)
    made = init([tmp_path / "bench"], tmp_path / "my study", sizes=BAR)
    study = read_study(made.study)
    assert study.name == "my_study"
    assert study.tasks == ["sobol", "importance", "calibrate", "infer", "predict", "compare", "discover"]
    assert study.infer.single_cycle == ["cyclic"]
    text = made.study.read_text("utf-8")
    for name, section in type(study).model_fields.items():
        if name in OF_TEMPLATES:
            continue
        assert f"\n{name}:" in text
        own = set(getattr(type(section.default), "model_fields", {})) if name not in ("simulator", "cluster") else set()
        for field in own - OF_TEMPLATES:
            assert f" {field}: " in text or f"{{{field}: " in text or f"\n  {field}:\n" in text
    fields = [line for line in text.splitlines() if line.startswith("  ") and ":" in line and "#" not in line]
    assert {line.strip() for line in fields} == {"specimens: all", "bayesian:"}
    one_site = init([tmp_path / "bench" / "d"], tmp_path / "other", sizes=BAR)
    assert "compare" not in read_study(one_site.study).tasks


def test_the_study_runs_as_it_is(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(Workspace, "client", lambda self: None)  # in this process
    table(tmp_path / "T1_relax.csv")
    sinew("init", tmp_path / "T1_relax.csv", "--out", tmp_path / "out", "--length-mm", 10, "--width-mm", 8,
          "--thickness-mm", 4)  # fmt: skip
    study = tmp_path / "out" / "study.yaml"
    study.write_text(
        study.read_text().replace("points: 20000", "base_samples: 4").replace("resamples: 200", "resamples: 10")
    )
    sinew("sobol", study, "--out", tmp_path / "results", "--workers", 1, "--quiet")
    assert json.loads((tmp_path / "results" / "sobol.json").read_text())["failed"] == 0


def test_sizes_that_nobody_tells_are_places_to_fill_in(tmp_path, capsys):
    table(tmp_path / "T1_relax.csv")
    sinew("init", tmp_path / "T1_relax.csv", "--out", tmp_path / "out", "--length-mm", 10)
    said = capsys.readouterr().out
    described = tmp_path / "out" / "cohort" / "T1" / "specimen.json"
    assert f"fill in: {described}" in said
    told = refused(capsys, "run", tmp_path / "out" / "study.yaml", "--out", tmp_path / "results")
    assert told == f"sinew: {described}: width_mm: is not filled in; expected a length in mm, such as 10.0\n"
    assert not (tmp_path / "results").exists()
    described.write_text(json.dumps(json.loads(described.read_text()) | {"width_mm": 8, "thickness_mm": 4}))
    assert read_cohort(tmp_path / "out" / "cohort").specimens[0].area_mm2 == 32


def test_a_unit_that_is_missing_is_refused_and_nothing_is_written(tmp_path, capsys):
    table(tmp_path / "T1_relax.csv", "time_s,displacement_mm,force")
    told = refused(capsys, "init", tmp_path / "T1_relax.csv", "--out", tmp_path / "out")
    assert "'force': no unit of the force can be found; expected --force-unit, one of N, kN, mN" in told
    assert not (tmp_path / "out").exists()
    sinew("init", tmp_path / "T1_relax.csv", "--out", tmp_path / "out", "--force-unit", "mN", "--json")
    made = json.loads(capsys.readouterr().out)
    assert made["fill_in"] == [str(tmp_path / "out" / "cohort" / "T1" / "specimen.json")]


def test_a_person_is_asked(tmp_path):
    table(tmp_path / "T1_relax.csv", "time_s,displacement_mm,force")
    asked: list[str] = []

    def ask(question: str, choices: Any) -> str:
        asked.append(question)
        return {"force": "mN", "length": "10", "width ": "8,5", "thickn": ""}[question[:6].replace("force ", "force")]

    made = init([tmp_path / "T1_relax.csv"], tmp_path / "out", ask=ask)
    assert len(asked) == 4
    specimen = json.loads((tmp_path / "out" / "cohort" / "T1" / "specimen.json").read_text())
    assert (specimen["length_mm"], specimen["width_mm"], specimen["thickness_mm"]) == (10, 8.5, None)
    assert made.missing


def test_a_header_block_tells_sizes(tmp_path):
    block = 'Specimen properties : Length,"1.2",cm\nSpecimen properties : Diameter,"2.0",mm\n\n'
    block += "Time,Extension,Load\n(s),(mm),(N)"
    table(tmp_path / "tail.csv", block)
    made = init([tmp_path / "tail.csv"], tmp_path / "out")
    (specimen,) = read_cohort(tmp_path / "out" / "cohort").specimens
    assert specimen.length_mm == 12
    assert specimen.area_mm2 == pytest.approx(np.pi)
    assert not made.missing


@pytest.mark.parametrize(
    "lines",
    [
        "Gauge length (mm),12\nWidth (mm),8.5\nThickness (mm),4\n",
        "Operator: mk\nlength_mm: 12\nwidth_mm: 8.5\nthickness_mm: 4\n",
        "Sample length = 1.2 cm\nBreite [mm],8.5\nDicke,4,mm\n",
        "Initial gauge length / mm,12\nSpecimen width,8.5,(mm)\nThickness: 4000 um\n",
    ],
)
def test_lines_above_the_table_tell_sizes(tmp_path, lines):
    table(tmp_path / "tail.csv", lines + "Time (s),Extension (mm),Load (N)")
    made = init([tmp_path / "tail.csv"], tmp_path / "out")
    (specimen,) = read_cohort(tmp_path / "out" / "cohort").specimens
    sizes = (specimen.length_mm, specimen.width_mm, specimen.thickness_mm)
    assert sizes == pytest.approx((12, 8.5, 4))
    assert not made.missing


def test_sizes_that_disagree_are_told_with_both_files(tmp_path, capsys):
    first = table(tmp_path / "A_relax.csv", "Width (mm),8.5\nTime (s),Extension (mm),Load (N)")
    other = table(tmp_path / "A_cyclic.csv", "Width (mm),9\nTime (s),Extension (mm),Load (N)")
    told = refused(capsys, "init", first, other, "--out", tmp_path / "out")
    expected = f"{other}: a width of 9 mm, but 8.5 mm in {first}, of the same specimen A"
    assert expected in told
    assert "--width-mm" in told


@pytest.mark.parametrize("line", ["Length,12", "Length at break (mm),12", "Length (mm),about 12", "Length (N),12"])
def test_a_size_without_a_clear_unit_and_number_is_not_known(tmp_path, line):
    table(tmp_path / "tail.csv", f"{line}\nTime (s),Extension (mm),Load (N)")
    assert init([tmp_path / "tail.csv"], tmp_path / "out", sizes=Sizes(None, 8.5, 4)).missing


def test_a_long_line_costs_no_time(tmp_path):
    table(tmp_path / "tail.csv", "length" + " :" * 40_000 + "\nTime (s),Extension (mm),Load (N)")
    started = time.perf_counter()
    assert init([tmp_path / "tail.csv"], tmp_path / "out", sizes=Sizes(None, 8.5, 4)).missing
    assert time.perf_counter() - started < 20


@pytest.mark.parametrize(
    ("header", "first", "last"),
    [
        ("time_s,strain (%),force_N", 0, 0.04),
        ("time_s,Stretch,force_N", -10, -6),
        ("time_s,Position (mm),force_N", 0, 0.4),
        ("time_s,displacement_mm,stress (MPa)", 0, 0.4),
    ],
)
def test_strains_ratios_positions_and_stresses(tmp_path, header, first, last):
    path = table(tmp_path / "a.csv", header)
    if "Stretch" in header:
        with pytest.raises(BadInput, match="shortens a gauge of 10 mm to nothing"):
            init([path], tmp_path / "out", sizes=BAR)
        return
    init([path], tmp_path / "out", sizes=BAR)
    (specimen,) = read_cohort(tmp_path / "out" / "cohort").specimens
    (curve,) = specimen.curves
    np.testing.assert_allclose(curve.protocol.displacement_mm[[0, -1]], [first, last], atol=1e-12)
    assert curve.force_N[-1] == pytest.approx(80 * 32 if "stress" in header else 80)


@pytest.mark.parametrize("header", ["time_s,strain (%),force_N", "time_s,displacement_mm,stress (MPa)"])
def test_what_needs_a_size_is_refused_without_it(tmp_path, header):
    with pytest.raises(BadInput, match=r"expected --(length|width)-mm"):
        init([table(tmp_path / "a.csv", header)], tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_cohort_is_used_where_it_is(tmp_path, capsys):
    init([table(tmp_path / "T1_relax.csv")], tmp_path / "first", sizes=BAR)
    cohort = tmp_path / "first" / "cohort"
    sinew("init", cohort, "--out", tmp_path / "second")
    assert "a cohort of 1 specimens, 1 curves, used as it is" in capsys.readouterr().out
    study = read_study(tmp_path / "second" / "study.yaml")
    assert study.cohort == "../first/cohort"
    assert study.cohort_path.resolve() == cohort.resolve()
    assert "inside the cohort" in refused(capsys, "init", cohort, "--out", cohort / "study")


@pytest.mark.parametrize("taken", ["study.yaml", "cohort/x"])
def test_nothing_is_overwritten(tmp_path, capsys, taken):
    table(tmp_path / "out" / taken)
    assert "is there already" in refused(capsys, "init", table(tmp_path / "a.csv"), "--out", tmp_path / "out")


def test_files_that_cannot_be_told_apart(tmp_path, capsys):
    first, second = table(tmp_path / "a" / "x-1.csv"), table(tmp_path / "a" / "x 1.csv")
    assert "x_1" in refused(capsys, "init", first, table(tmp_path / "a" / "x_1.csv"), second, "--out", tmp_path / "out")
    assert "same numbers" in refused(
        capsys, "init", table(tmp_path / "b" / "y.csv"), table(tmp_path / "b" / "z.csv"), "--out", tmp_path / "out"
    )


@pytest.mark.parametrize(
    "words", [(), ("absent.csv",), (".",), ("--length-mm", "-1", "a.csv"), ("--length-mm", "nan", "a.csv")]
)
def test_wrong_arguments(tmp_path, capsys, monkeypatch, words):
    monkeypatch.chdir(tmp_path)
    if "a.csv" in words:
        table(tmp_path / "a.csv")
    refused(capsys, "init", *words, "--out", "out")
    assert not (tmp_path / "out").exists()


def test_links_and_names_with_separators_stay_inside(tmp_path):
    path = table(tmp_path / "bench" / "x\\..\\y_relax.csv")
    (tmp_path / "bench" / "etc").symlink_to("/etc")
    init([path.parent], tmp_path / "out", sizes=BAR)
    written = {str(file.relative_to(tmp_path / "out")) for file in (tmp_path / "out").rglob("*")}
    assert written == {
        "study.yaml",
        "cohort",
        "cohort/x_y",
        "cohort/x_y/relax.csv",
        "cohort/x_y/specimen.json",
    }


def test_forces_below_zero_are_remarked_on(tmp_path):
    made = init([table(tmp_path / "a.csv", scale=-1.0)], tmp_path / "out", hints=Hints(), sizes=BAR)
    assert any("forces are below 0" in line for line in made.told)
