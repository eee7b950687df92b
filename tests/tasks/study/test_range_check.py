"""Ranges that cannot reach the measured forces are refused, with such as can, before anything is written."""

import json
from dataclasses import replace

import numpy as np
import pytest

from sinew.runner.errors import BadInput
from sinew.tasks.cli import main as cli
from sinew.tasks.data.cohort import write_cohort
from sinew.tasks.data.virtual import virtual_cohort
from sinew.tasks.model import Curve
from sinew.tasks.study import range_check
from sinew.tasks.study.cohort import cohort_of
from sinew.tasks.study.range_check import RANGES, Ranges, keep, look, rounded
from sinew.tasks.study.study import read_study

SPECIMENS, _ = virtual_cohort(seed=1, per_site=1, rate_hz=2.0)


def times(specimen, factor):
    curves = tuple(Curve(curve.protocol, factor * curve.force_N) for curve in specimen.curves)
    return replace(specimen, curves=curves)


def study_in(folder, specimens, more=""):
    write_cohort(folder / "cohort", specimens)
    (folder / "study.yaml").write_text(f"name: x\ncohort: cohort\n{more}")
    return read_study(folder / "study.yaml")


def looked(folder, specimens, more=""):
    study = study_in(folder, specimens, more)
    return study, look(study, cohort_of(study), folder / "out")


def test_published_ranges_reach_published_tendons(tmp_path):
    study, found = looked(tmp_path, SPECIMENS)
    assert found.out_of_reach == []
    found.refuse(study.path)
    assert list(found.remarks()) == ["ranges: no force of these tests depends on nu_m; a fixed value would save work"]


@pytest.mark.parametrize("factor", [1e-5, 0.02, 30.0, 1e4])
def test_ranges_out_of_reach_are_refused_with_some_that_reach(tmp_path, factor):
    (tmp_path / "again").mkdir()
    specimens = [times(one, factor) for one in SPECIMENS]
    study, found = looked(tmp_path, specimens)
    with pytest.raises(
        BadInput, match=r"has .* MPa at its peak \(median of 3 points\), .*; expected ranges such as E_f: \{min: "
    ) as refused:
        found.refuse(study.path)
    assert len(str(refused.value)) <= 300 + len(str(tmp_path))
    wider = "".join(f"    {name}: {{min: {low:g}, max: {high:g}}}\n" for name, low, high in found.advice)
    study, found = looked(tmp_path / "again", specimens, f"model:\n  parameters:\n{wider}")
    assert found.out_of_reach == []
    found.refuse(study.path)


def test_forces_of_the_other_sign_are_told_as_such(tmp_path):
    study, found = looked(tmp_path, [times(one, -1.0) for one in SPECIMENS])
    with pytest.raises(BadInput, match="forces of the other sign"):
        found.refuse(study.path)


@pytest.mark.parametrize("moved", [0.0, 2e-17])
def test_a_displacement_that_moves_no_specimen_is_refused(tmp_path, moved):
    curves = [
        replace(curve, protocol=replace(curve.protocol, displacement_mm=moved * np.ones(curve.force_N.size)))
        for curve in SPECIMENS[0].curves
    ]
    study, found = looked(tmp_path, [replace(SPECIMENS[0], curves=tuple(curves))])
    with pytest.raises(BadInput, match="N, but its displacement pulls nothing; expected a displacement in mm"):
        found.refuse(study.path)


def test_one_odd_specimen_of_many_is_remarked_on(tmp_path):
    study, found = looked(tmp_path, [*SPECIMENS[:2], times(SPECIMENS[2], 1000.0)])
    found.refuse(study.path)
    assert next(found.remarks()).startswith(
        f"ranges: 1 of 3 specimens are out of reach; for example, {SPECIMENS[2].name} "
    )


def test_peaks_just_beyond_the_ranges_are_remarked_on(tmp_path):
    most = dict[str, float]()
    for one in looked(tmp_path, SPECIMENS)[1].reach:
        most[one.specimen] = min(one.ratios[1], most.get(one.specimen, np.inf))
    (tmp_path / "again").mkdir()
    study, found = looked(tmp_path / "again", [times(one, 1.5 * most[one.name]) for one in SPECIMENS])
    found.refuse(study.path)
    assert found.out_of_reach == []
    (line, *_) = found.remarks()
    assert line.startswith(
        f"ranges: the peaks of {len(SPECIMENS)} of {len(SPECIMENS)} specimens lie outside what they give; for example, "
    )
    assert line.endswith("fits will be pushed against the bounds (`sinew init` on the cohort chooses other ranges)")


def test_an_earlier_look_counts_until_something_changes(tmp_path, monkeypatch):
    study, found = looked(tmp_path, SPECIMENS)
    out = tmp_path / "out"
    out.mkdir()
    keep(found, out)
    monkeypatch.setattr(range_check, "reach", lambda *_: pytest.fail("it looked again"))
    assert look(study, cohort_of(study), out) == found
    (tmp_path / "study.yaml").write_text("name: x\ncohort: cohort\nmodel: {parameters: {E_m: {max: 60}}}\n")
    monkeypatch.setattr(range_check, "reach", lambda *_: ())
    changed = read_study(tmp_path / "study.yaml")
    assert look(changed, cohort_of(changed), out).reach == []


@pytest.mark.parametrize("content", ["", "[]", "{}", '{"inputs": 1, "reach": [], "unseen": []}', "{" * 5000])
def test_a_damaged_look_is_made_again(tmp_path, content):
    study, found = looked(tmp_path, SPECIMENS[:1])
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / RANGES).write_text(content)
    assert look(study, cohort_of(study), tmp_path / "out") == found


@pytest.mark.parametrize("number", [0, None, 1e400, "x", "NaN"])
def test_impossible_numbers_under_the_right_key_are_looked_at_again(tmp_path, number):
    study, found = looked(tmp_path, SPECIMENS[:1])
    (tmp_path / "out").mkdir()
    keep(found, tmp_path / "out")
    path = tmp_path / "out" / RANGES
    content = json.loads(path.read_text())
    content["reach"][0]["measured_N"] = number
    path.write_text(json.dumps(content))
    assert look(study, cohort_of(study), tmp_path / "out") == found


def test_specimens_that_need_different_scales_get_ranges_for_all(tmp_path):
    specimens = [SPECIMENS[0], times(SPECIMENS[1], 10.0), times(SPECIMENS[2], 11.0)]
    study, found = looked(tmp_path, specimens)
    with pytest.raises(BadInput):
        found.refuse(study.path)
    ends = {name: (low, high) for name, low, high in found.advice}
    assert ends["E_f"][0] <= 160
    assert ends["E_f"][1] > 1000


def test_a_fixed_modulus_that_is_in_the_way_leaves_no_advice(tmp_path):
    fixed = "model: {parameters: {E_f: {fixed: 200}}}\n"
    study, found = looked(tmp_path, [times(one, 1e-4) for one in SPECIMENS], fixed)
    assert found.advice == []
    with pytest.raises(BadInput, match="expected other ranges"):
        found.refuse(study.path)


def test_a_template_of_ones_own_is_not_judged(tmp_path):
    study = study_in(tmp_path, SPECIMENS[:1], "simulator: {name: febio, template: mine.feb.j2}\n")
    assert look(study, cohort_of(study), tmp_path / "out") is None


def test_the_command_refuses_and_writes_nothing(tmp_path, monkeypatch, capsys):
    study_in(tmp_path, [times(one, 1e-4) for one in SPECIMENS])
    monkeypatch.setattr("sys.argv", ["sinew", "run", str(tmp_path / "study.yaml"), "--out", str(tmp_path / "out")])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert ended.value.code == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "expected ranges such as E_f: {min: " in said
    assert not (tmp_path / "out").exists()


def test_given_rows_are_simulated_whatever_the_ranges(tmp_path, monkeypatch):
    study_in(tmp_path, [times(SPECIMENS[0], 1e-4)])
    (tmp_path / "rows.csv").write_text("E_f\n200\n")
    words = ["simulate", tmp_path / "study.yaml", "--parameters", tmp_path / "rows.csv", "--out", tmp_path / "out"]
    monkeypatch.setattr("sys.argv", ["sinew", *map(str, words), "--workers", "1"])
    cli.main()
    assert json.loads((tmp_path / "out" / "simulate.json").read_text())["failed"] == 0
    assert not (tmp_path / "out" / RANGES).exists()


@pytest.mark.parametrize("value", [0.0, 1e-9, 0.0123, 9.99, 10.0, 275.0, 9.96e7])
def test_numbers_are_rounded_to_two_digits_outwards(value):
    down, up = rounded(value, up=False), rounded(value, up=True)
    assert down <= value <= up
    assert up - down <= 0.11 * value
    assert float(f"{up:.2g}") == up
    assert np.isfinite([down, up]).all()


@pytest.mark.parametrize("value", [5e-324, 1e-310, 2.3e-308])
def test_next_to_the_smallest_number_there_is(value):
    assert 0.0 <= rounded(value, up=False) <= value <= rounded(value, up=True)


def test_what_is_kept_is_what_was_found(tmp_path):
    _, found = looked(tmp_path, SPECIMENS[:1])
    keep(found, tmp_path)
    assert Ranges.model_validate(json.loads((tmp_path / RANGES).read_text())) == found
