"""What a study may ask of Sobol indices."""

import pytest

import sinew
from sinew.runner.errors import BadInput
from sinew.tasks.model import Model
from sinew.tasks.sobol.settings import Settings, check
from sinew.tasks.study.settings_file import FieldError


def study(folder, *, free: int = 2, simulator: str = ""):
    fixed = "".join(f"    {p.name}: {{fixed: {p.reference}}}\n" for p in Model().parameters[free:])
    (folder / "study.yaml").write_text(f"name: small\ncohort: cohort\n{simulator}model:\n  parameters:\n{fixed}")
    return sinew.read_study(folder / "study.yaml")


def test_two_free_parameters_are_enough(tmp_path):
    check(study(tmp_path), tmp_path)
    with pytest.raises(BadInput) as error:
        check(study(tmp_path, free=1), tmp_path)
    assert str(error.value) == (
        f"{tmp_path / 'study.yaml'}: model.parameters: one free parameter; expected at least two for Sobol indices"
    )


def test_only_a_finished_study_is_extended(tmp_path):
    with pytest.raises(BadInput) as error:
        check(study(tmp_path), tmp_path, extend=True)
    where = tmp_path / "sobol.json"
    assert str(error.value) == f"{where}: is not there; expected a finished `sinew sobol` to extend"
    where.write_text("{}")
    check(study(tmp_path), tmp_path, extend=True)


def test_an_output_is_one_that_the_simulator_has(tmp_path):
    known = study(tmp_path)
    Settings().check_study(known)
    with pytest.raises(FieldError) as error:
        Settings(output="torque").check_study(known)
    assert (error.value.field, error.value.problem) == ("output", "no output 'torque'")
    assert error.value.expected == "nothing; only templates have outputs"


def test_a_name_that_no_output_has_is_told_the_names_that_are_there(tmp_path):
    class Template:
        class simulator:
            output_names = ("force", "stretch")

    Settings(output="stretch").check_study(Template)
    with pytest.raises(FieldError) as error:
        Settings(output="torque").check_study(Template)
    assert error.value.expected == "one of force, stretch"


@pytest.mark.parametrize(
    ("given", "field", "problem"),
    [
        ({"groups": {"one": ["E_f", "moonlight"]}}, "groups.one", "'moonlight'"),
        ({"groups": {"one": ["E_f"], "two": ["E_f", "E_m"]}}, "groups.two", "'E_f' is in a group twice"),
        ({"groups": {"E_m": ["E_f", "alpha_f"]}}, "groups", "'E_m' is a parameter"),
        ({"distributions": {"moonlight": {"mean": 1, "sd": 1}}}, "distributions", "'moonlight'"),
        ({"distributions": {"E_f": {"mean": 10, "sd": 1}}}, "distributions.E_f.mean", "10"),
        ({"correlations": {"E_f": {"moonlight": 0.5}}}, "correlations", "'moonlight'"),
        ({"correlations": {"E_f": {"E_f": 0.5}}}, "correlations", "'E_f' with 'E_f'"),
        ({"correlations": {"E_f": {"E_m": 0.5}, "E_m": {"E_f": 0.5}}}, "correlations", "'E_m' with 'E_f' twice"),
        (
            {"correlations": {"E_f": {"E_m": 0.9, "alpha_f": -0.9}, "E_m": {"alpha_f": 0.9}}},
            "correlations",
            "contradict each other, or one parameter is nearly a function of others",
        ),
    ],
)
def test_groups_and_distributions_are_of_free_parameters(tmp_path, given, field, problem):
    known = study(tmp_path, free=len(Model().parameters) - 1)
    Settings(groups={"one": ["E_f", "E_m"]}, distributions={"E_f": {"mean": 205, "sd": 27}}).check_study(known)
    with pytest.raises(FieldError) as error:
        Settings(**given).check_study(known)
    assert (error.value.field, error.value.problem) == (field, problem)


def test_one_group_of_everything_has_no_indices(tmp_path):
    path = tmp_path / "study.yaml"
    names = ", ".join(parameter.name for parameter in Model().parameters)
    path.write_text(f"name: small\ncohort: cohort\nsobol: {{groups: {{all: [{names}]}}}}\n")
    with pytest.raises(BadInput, match=r"sobol.groups: one group of all parameters"):
        check(sinew.read_study(path), tmp_path)


@pytest.mark.parametrize(
    ("given", "problem"),
    [({"method": "surrogate"}, "expected method: saltelli"), ({"second_order": True}, "given beside correlations")],
)
def test_correlations_need_a_method_that_knows_them(given, problem):
    with pytest.raises(ValueError, match=problem):
        Settings(correlations={"E_f": {"E_m": 0.5}}, **given)


@pytest.mark.parametrize("given", [{"E_f": {}}, {"E_f": {"E_m": 1.0}}, {"E_f": {"E_m": float("nan")}}])
def test_a_correlation_is_a_number_within_its_range(given):
    with pytest.raises(ValueError, match="correlations"):
        Settings(correlations=given)
