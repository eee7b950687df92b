"""What a study compares beside the force, how noisy it is, and what is wrong with a column."""

from dataclasses import replace

import numpy as np
import pytest

from sinew.runner.errors import BadInput
from sinew.tasks.data.cohort import read_cohort, write_cohort
from sinew.tasks.model import Model
from sinew.tasks.simulate.evaluation import SpecimenEvaluation
from sinew.tasks.simulate.uniaxial import Uniaxial
from sinew.tasks.study.cohort import cohort_of
from sinew.tasks.study.study import read_study
from tests.tasks.measured import EVERY, NOISE, measured_laterally, study_of, write_measured


def refused(read) -> str:
    with pytest.raises(BadInput) as problem:
        read()
    assert "\n" not in str(problem.value)
    return str(problem.value)


def test_further_columns_are_read_back_with_their_gaps(tmp_path):
    (written,), _ = measured_laterally()
    write_measured(tmp_path)
    (read,) = read_cohort(tmp_path / "cohort").specimens
    for curve in written.curves:
        again = next(each for each in read.curves if each.name == curve.name)
        np.testing.assert_allclose(again.others["lateral_strain"], curve.others["lateral_strain"], rtol=1e-9)
        assert np.isnan(again.others["lateral_strain"]).sum() == curve.force_N.size - -(-curve.force_N.size // EVERY)
        assert again.digest == read_back_without(again)


def read_back_without(curve) -> str:
    return type(curve)(curve.protocol, curve.force_N).digest


@pytest.mark.parametrize("quantity", ["force", "lateral_strain"])
@pytest.mark.parametrize("noise", ["1e-300", "5e-324", "1e300"])
def test_noise_in_units_of_which_errors_are_no_numbers_is_refused(tmp_path, quantity, noise):
    write_measured(tmp_path)
    given = {"force": "{}", "lateral_strain": "{}"} | {quantity: f"{{noise: {noise}}}"}
    text = ", ".join(f"{name}: {one}" for name, one in given.items())
    study = read_study(study_of(tmp_path, "", f"measured: {{{text}}}"))
    words = refused(lambda: cohort_of(study))
    assert f"measured.{quantity}.noise: {float(noise):.3g}, in distal/1, where {quantity} moves by" in words
    assert "expected from 1e-09 to 1e+09 times that" in words


def test_a_column_of_the_smallest_numbers_is_refused(tmp_path):
    (written,), _ = measured_laterally()
    curves = []
    for curve in written.curves:
        tiny = np.where(np.arange(curve.force_N.size) % 2, 5e-324, 0.0)
        curves.append(replace(curve, others={"lateral_strain": tiny}))
    write_cohort(tmp_path / "cohort", [replace(written, curves=tuple(curves))])
    words = refused(lambda: cohort_of(read_study(study_of(tmp_path, ""))))
    assert "measured.lateral_strain.noise" in words


def test_the_noise_of_a_column_is_estimated_as_that_of_the_force(tmp_path):
    truth = write_measured(tmp_path)
    (one,) = cohort_of(read_study(study_of(tmp_path, ""))).specimens
    assert list(one.noise) == ["force", "lateral_strain"]
    assert one.noise["lateral_strain"] == pytest.approx(NOISE, rel=0.1)
    assert one.name in truth
    assert "compared" in one.identity()


def test_a_study_that_names_no_quantity_knows_the_force_alone(tmp_path):
    write_measured(tmp_path)
    for compared in ("", "measured: {force: {}}"):
        (one,) = cohort_of(read_study(study_of(tmp_path, "", compared))).specimens
        assert not one.noise
        assert not one.curves[0].others
        assert "compared" not in one.identity()


def test_noise_that_is_given_is_taken(tmp_path):
    write_measured(tmp_path)
    study = study_of(tmp_path, "", "measured: {force: {noise: 2.0}, lateral_strain: {noise: 0.001}}")
    (one,) = cohort_of(read_study(study)).specimens
    assert dict(one.noise) == {"force": 2.0, "lateral_strain": 0.001}


def test_the_force_comes_first_in_whatever_order_the_study_lists_them(tmp_path):
    """Parts of the objective, residuals and reported errors follow one order."""
    write_measured(tmp_path)
    study = read_study(study_of(tmp_path, "", "measured: {lateral_strain: {noise: 0.001}, force: {noise: 2.0}}"))
    (one,) = cohort_of(study).specimens
    assert list(one.noise) == ["force", "lateral_strain"]


def test_the_objective_is_the_sum_of_errors_over_noise(tmp_path):
    write_measured(tmp_path)
    study = read_study(study_of(tmp_path, "", "measured: {lateral_strain: {noise: 0.001}, force: {noise: 2.0}}"))
    (one,) = cohort_of(study).specimens
    model = Model()
    evaluation = SpecimenEvaluation(model, one, Uniaxial(compared=study.compared), 50)
    found = evaluation(np.array([model.reference])).values
    errors = found["rmse_force"] / 2.0 + found["rmse_lateral_strain"] / 0.001
    np.testing.assert_allclose(found["objective"], errors, rtol=1e-12)
    assert np.ptp(found["objective"]) > 0
    parts = evaluation.parts(found)[0]
    assert [(s.output, s.protocol) for s in evaluation.series()] == [
        (name, curve.name) for name in ("force", "lateral_strain") for curve in one.curves
    ]
    np.testing.assert_allclose(parts[: len(one.curves)], found["rmse_force"][0] / 2.0)


@pytest.mark.parametrize(
    ("compared", "words"),
    [
        ("measured: {lateral_strain: {}}", "measured: without the force; expected force: {} among the quantities"),
        ("measured: {force: {}, width: {}}", "the simulator has no such output; expected force or one of its: lateral"),
        ("measured: {force: {}, lateral_strain: {column: width_mm}}", "'width_mm' is in mm, the simulator's lateral_"),
        ("measured: {force: {}, lateral_strain: {noise: 0}}", "measured.lateral_strain.noise"),
        ("measured: {force: {noise: 0.1}}", "measured.force.noise: 0.1; expected no noise where the force alone"),
        ("measured: {force: {column: load_N}}", "measured.force.column: 'load_N'; expected force_N, or nothing"),
        ("simulator: febio\nmeasured: {force: {}, lateral_strain: {}}", "one of its: nothing besides the force"),
    ],
)
def test_quantities_that_cannot_be_compared_are_refused(tmp_path, compared, words):
    assert words in refused(lambda: read_study(study_of(tmp_path, "", compared)))


@pytest.mark.parametrize(
    ("column", "words"),
    [
        (None, "one_step.csv: lateral_strain: no such column; expected the measured lateral_strain; columns: none"),
        ("", "one_step.csv: lateral_strain: the column is empty; expected at least 3 numbers of the measured lateral"),
        ("0.25", "one_step.csv: lateral_strain: 0.25 in every row; expected a measured course of lateral_strain"),
        ("x", "one_step.csv: row 2, lateral_strain: 'x'; expected a finite number"),
        ("nan", "one_step.csv: row 2, lateral_strain: 'nan'; expected a finite number"),
        ("inf", "one_step.csv: row 2, lateral_strain: 'inf'; expected a finite number"),
    ],
)
def test_a_column_that_cannot_be_compared_is_named_with_its_file(tmp_path, column, words):
    write_measured(tmp_path)
    (file,) = (tmp_path / "cohort").glob("*/*/one_step.csv")
    header, *rows = [line.split(",")[:3] for line in file.read_text().splitlines()]
    if column is not None:
        header, rows = [*header, "lateral_strain"], [[*row, column] for row in rows]
    file.write_text("".join(",".join(cells) + "\n" for cells in (header, *rows)))
    study = read_study(study_of(tmp_path, ""))
    assert f"{file.parent}/{words}" in refused(lambda: cohort_of(study))


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("force_N", "row 1, force_N: given twice; expected each column once"),
        ("two words", "row 1: a column called 'two words'; expected another name of letters"),
        ("force", "row 1: a column called 'force'; expected another name of letters"),
    ],
)
def test_names_of_columns_that_cannot_be_used(tmp_path, name, words):
    write_measured(tmp_path)
    (file,) = (tmp_path / "cohort").glob("*/*/one_step.csv")
    file.write_text(file.read_text().replace("lateral_strain", name, 1))
    assert words in refused(lambda: read_cohort(tmp_path / "cohort"))


def test_noise_that_cannot_be_estimated_is_asked_for(tmp_path):
    write_measured(tmp_path)
    for file in (tmp_path / "cohort").glob("*/*/*.csv"):
        lines = file.read_text().splitlines()
        cut = [lines[0], *(f"{','.join(line.split(',')[:3])},{i if i < 4 else ''}" for i, line in enumerate(lines[1:]))]
        file.write_text("\n".join(cut) + "\n")
    words = refused(lambda: cohort_of(read_study(study_of(tmp_path, ""))))
    assert (
        "measured.lateral_strain.noise: cannot be estimated from the curves of distal/1; expected a standard" in words
    )


def test_an_output_and_a_protocol_of_one_name_are_refused(tmp_path):
    write_measured(tmp_path)
    (file,) = (tmp_path / "cohort").glob("*/*/one_step.csv")
    file.rename(file.with_name("lateral_strain.csv"))
    assert "two things are called" in refused(lambda: cohort_of(read_study(study_of(tmp_path, ""))))
