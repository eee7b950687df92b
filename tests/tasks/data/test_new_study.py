"""What `sinew init` writes and says."""

import json
from dataclasses import replace

import numpy as np
import pytest
import yaml

from sinew.runner.errors import BadInput
from sinew.tasks.data.cohort import read_cohort, write_cohort
from sinew.tasks.data.curves import Bar, curve_of
from sinew.tasks.data.first_ranges import FirstRanges
from sinew.tasks.data.hints import Hints
from sinew.tasks.data.names import FileName
from sinew.tasks.data.new_study import (
    NewSpecimen,
    ReadFile,
    describe,
    describe_unused,
    environment,
    leave_open,
    write_study,
)
from sinew.tasks.data.recordings import read_recordings
from sinew.tasks.infer.settings import OF_BOTH, OF_LIKELIHOOD, Settings
from sinew.tasks.model import Curve, Model, Protocol, Specimen
from sinew.tasks.registry import TASKS
from sinew.tasks.sobol.settings import OF_SEVERAL, OF_SURROGATE
from sinew.tasks.study.model import model_of
from sinew.tasks.study.study import read_study

OF_TEMPLATES = {"protocols", "specimen", "output"}  # no study of measured tissue has them
TIME = np.arange(4.0)
PUBLISHED = FirstRanges(Model(), ())


def specimen(name: str, *protocols: str) -> Specimen:
    curves = tuple(Curve(Protocol(protocol, TIME, TIME / 10), TIME * (1 + i)) for i, protocol in enumerate(protocols))
    return Specimen(name, 10.0, 8.0, 4.0, curves)


def test_the_study_explains_every_field_and_holds_every_task(tmp_path):
    (tmp_path / "my study").mkdir()
    path = write_study(
        tmp_path / "my study", "cohort", [specimen("d/x", "cyclic", "ramp"), specimen("p/x", "zyklisch")], PUBLISHED
    )
    study = read_study(path)
    assert study.name == "my_study"
    assert study.cohort_path == tmp_path / "my study" / "cohort"
    assert study.tasks == ["sobol", "importance", "calibrate", "infer", "predict", "compare", "discover"]
    assert study.infer.method == "likelihood"
    text = path.read_text("utf-8")
    for name, section in type(study).model_fields.items():
        if name in OF_TEMPLATES or (name in TASKS and TASKS[name].optional):
            continue
        assert f"\n{name}:" in text
        own = set(getattr(type(section.default), "model_fields", {})) if name not in ("simulator", "cluster") else set()
        if name == "infer":
            own &= OF_BOTH | OF_LIKELIHOOD
        for field in own - OF_TEMPLATES - OF_SURROGATE - OF_SEVERAL:  # fields of one method
            assert f" {field}: " in text or f"{{{field}: " in text or f"\n  {field}:\n" in text
    fields = [line for line in text.splitlines() if line.startswith("  ") and ":" in line and "#" not in line]
    assert {line.strip() for line in fields} == {"specimens: all", "bayesian:"}


def test_where_nothing_is_known_of_a_tissue_the_inference_is_by_abc(tmp_path):
    ranges = FirstRanges(Model(), (), scaled=True)
    path = write_study(tmp_path, "cohort", [specimen("x", "cyclic", "ramp"), specimen("y", "zyklisch")], ranges)
    settings = read_study(path).infer
    assert settings.method == "abc"
    assert settings.single_cycle == ["cyclic", "zyklisch"]
    assert settings.model_fields_set == set(Settings.model_fields) - (OF_LIKELIHOOD - OF_BOTH)
    (tmp_path / "times").mkdir()
    only_times = write_study(
        tmp_path / "times", "cohort", [specimen("x", "a")], FirstRanges(Model(), (), scaled=True, only_times=True)
    )
    assert read_study(only_times).infer.method == "likelihood"


@pytest.mark.parametrize("end", ["\n", "\r", "\x85", "\u2028", "\u2029"])
def test_no_name_of_a_folder_or_model_adds_a_line_to_a_study(end):
    """YAML knows more ends of lines than JSON escapes by itself."""
    text = environment().from_string("a: 1   # {{ path | json }}\n").render(path=f"x{end}retries: 20 #")
    assert yaml.safe_load(text) == {"a": 1}


def test_sites_are_compared_where_there_are_two(tmp_path):
    path = write_study(tmp_path, "cohort", [specimen("d/x", "a"), specimen("d/y", "a")], PUBLISHED)
    assert "compare" not in read_study(path).tasks


@pytest.mark.parametrize("scaled", [False, True])
def test_the_study_has_the_ranges_that_it_is_given(tmp_path, scaled):
    model = Model(lambda_0=1.24)
    for name, low, high in (("E_m", 1.5e-5, 0.0123), ("alpha_f", 0.0, 14.0), ("nu_m", 0.2, 0.2)):
        parameter = model.parameters[model.names.index(name)]
        model = model.with_parameter(replace(parameter, minimum=low, maximum=high, reference=(low + high) / 2))
    path = write_study(tmp_path, "cohort", [specimen("x", "a")], FirstRanges(model, (), scaled))
    assert model_of(read_study(path).model, "tendon") == model
    text = path.read_text("utf-8")
    assert ("these are for human tendon" in text) != scaled
    assert "nu_m: {fixed: 0.2" in text


def test_the_study_says_where_only_the_relaxation_times_are_scaled(tmp_path):
    path = write_study(tmp_path, "cohort", [specimen("x", "a")], FirstRanges(Model(), (), scaled=True, only_times=True))
    text = path.read_text("utf-8")
    assert "these are for human tendon, with relaxation times as long as the tests" in text
    assert "scaled to the curves" not in text


def test_sizes_that_nobody_knows_are_left_open(tmp_path):
    write_cohort(tmp_path, [specimen("T1", "relax")])
    described = tmp_path / "T1" / "specimen.json"
    leave_open(described, ("width", "thickness"))
    content = json.loads(described.read_text())
    assert (content["length_mm"], content["width_mm"], content["thickness_mm"]) == (10.0, None, None)
    assert content["note"].startswith("fill in width_mm, thickness_mm")
    with pytest.raises(BadInput, match="width_mm: is not filled in; expected a length in mm, such as"):
        read_cohort(tmp_path)
    described.write_text(json.dumps(content | {"width_mm": 8, "thickness_mm": 4}))
    assert read_cohort(tmp_path).specimens[0].area_mm2 == 32


def test_what_was_guessed_is_said(tmp_path):
    path = tmp_path / "T1_relax.csv"
    path.write_text("Time (min),Standardweg [um],Load (kN),SD\n0,0,0,1\n1,100,5,1\n11,400,80,1\n")
    recording = read_recordings(path, Hints())[0]
    curve = curve_of(recording, Bar(10.0, 8.0, 4.0), "relax")
    file = ReadFile(recording, FileName("T1", "relax"))
    known = NewSpecimen(Specimen("T1", 10.0, 8.0, 4.0, (curve,)), (file,), (), ("a note",))
    assert list(describe([known])) == [
        "specimen T1: 10 x 8 x 4 mm (length x width x thickness)",
        f"  {path}: protocol relax (likely); time from 'Time (min)' in min (sure), "
        "displacement from 'Standardweg [um]' in um (sure), force from 'Load (kN)' in kN (sure)",
        "    3 points, 660 s, displacement 0 to 0.4 mm (strain to 4 %), force 0 to 8e+04 N, loaded at 6.06e-05 1/s",
        "    left out: SD",
        "    a note",
    ]
    path.write_text("time_s,displacement_mm,force_N\n0,0,0\n1,-1,-5\n2,-3,-9\n")
    pressed = curve_of(*read_recordings(path, Hints()), Bar(10.0, 8.0, 4.0), "relax")
    lines = list(describe([NewSpecimen(Specimen("T1", 10.0, 8.0, 4.0, (pressed,)), (file,), (), ())]))
    assert (
        lines[2]
        == "    3 points, 2 s, displacement -3 to 0 mm (strain -30 to 0 %), force -9 to 0 N, loaded at 0.15 1/s"
    )
    short = Specimen("T1", 0.05, 8.0, 4.0, (curve,))
    lines = list(describe([NewSpecimen(short, (file,), (), ())]))
    assert "(strain to 800 %; few tissues bear that: check the gauge length)" in lines[2]
    path.write_text("Time_S,Size_mm,Displacement_mm,Force_N\n0,12.5,0,1\n1,12.6,0.1,2\n2,12.7,0.2,3\n")
    beside = ReadFile(read_recordings(path, Hints())[0], FileName("T1", "relax"))
    for length, said in ((12.5, 1), (10.0, 0)):  # that of the column, or one that was told in its place
        lines = list(describe([NewSpecimen(Specimen("T1", length, 8.0, 4.0, (curve,)), (beside,), (), ())]))
        assert lines.count("    gauge length: 'Size_mm' less the displacement") == said
    unknown = NewSpecimen(known.specimen, known.tests, ("length",), ())
    lines = list(describe([unknown]))
    assert lines[0] == "specimen T1: ? x 8 x 4 mm (length x width x thickness)"
    assert "strain" not in lines[2]


def test_answers_of_specimens_that_are_not_there_are_said():
    new = NewSpecimen(specimen("T1", "relax"), (), (), ())
    assert list(describe_unused(["T9", "T1"], [new])) == [
        "answers that were not used: sizes of T9; no test is of a specimen of that name"
    ]
    assert not list(describe_unused(["T1"], [new]))
    (line,) = describe_unused([f"s{number}" for number in range(100)], [new])
    assert "and 80 more;" in line


def test_recordings_of_several_in_one_file_are_said_to_be_of_several_specimens(tmp_path):
    path = tmp_path / "both tests.csv"
    block = "Time (s),Displacement (mm),Load (N)\n0,0,0\n1,1,5\n2,3,9\n"
    path.write_text(f"{block}\n{block}")
    recordings = read_recordings(path, Hints())
    new = [
        NewSpecimen(
            Specimen(f"T{i}", 10.0, 8.0, 4.0, (curve_of(one, Bar(10.0, 8.0, 4.0), "test"),)),
            (ReadFile(one, FileName(f"T{i}", "test")),), (), (),
        )
        for i, one in enumerate(recordings, 1)
    ]  # fmt: skip
    *_, line = describe(new)
    assert not [each for each in describe(new[:1]) if "its 1 tests" in each]
    assert line == (
        f"{path}: its 2 tests are taken for those of 2 specimens; if all are of one specimen, make a cohort first, "
        f"with the same options: sinew import '{path}' --specimen NAME --out COHORT"
    )


def test_of_many_files_with_several_tests_one_line_is_said(tmp_path):
    block = "Time (s),Displacement (mm),Load (N)\n0,0,0\n1,1,5\n2,3,9\n"
    new = []
    for name in ("a", "b", "c"):
        path = tmp_path / f"{name}.csv"
        path.write_text(f"{block}\n{block}")
        new += [
            NewSpecimen(
                Specimen(f"{name}{i}", 10.0, 8.0, 4.0, (curve_of(one, Bar(10.0, 8.0, 4.0), "test"),)),
                (ReadFile(one, FileName(f"{name}{i}", "test")),), (), (),
            )
            for i, one in enumerate(read_recordings(path, Hints()), 1)
        ]  # fmt: skip
    (line,) = [each for each in describe(new) if "are taken for" in each]
    assert line == (
        f"{tmp_path / 'a.csv'} and 2 more: their 6 tests are taken for those of 6 specimens; if all in a file are of "
        f"one specimen, make a cohort first, with the same options: "
        f"sinew import {tmp_path / 'a.csv'} --specimen NAME --out COHORT"
    )
