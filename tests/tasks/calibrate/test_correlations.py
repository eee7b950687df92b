"""Repeated-measures correlations: numbers known otherwise, what is left without one, and those of the paper."""

import csv
import json
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from sinew.tasks.calibrate.correlations import correlations, sites_table
from sinew.tasks.calibrate.result import NoCorrelations
from sinew.tasks.data.virtual import published
from sinew.tasks.model import Model, Parameter
from sinew.tasks.study.result import plain
from tests.tasks.calibrations import fit_of

SITES = ("distal", "middle", "proximal")
PARAMETERS = tuple(Parameter(name, "MPa", 0.0, 100.0, 1.0, "") for name in ("a", "b", "c"))


def fit(site, donor, values, determined=None):
    known = list(values) if determined is None else determined
    return fit_of(values, site=site, donor=donor, determined=known, total_N=sum(values.values()))


def cohort(rows, **more):
    return {f"{site}/{donor}": fit(site, donor, values, **more) for site, donor, values in rows}


def pair(found, *names):
    return next(each for each in found.pairs if set(each.parameters) == set(names))


@pytest.fixture(scope="module")
def paper():
    names = Model().names
    table = published().to_dict("records")
    rows = [(row["site"], row["specimen"], {name: row[name] for name in names}) for row in table]
    return cohort(rows)


@pytest.fixture(scope="module")
def of_the_paper(paper):
    return correlations(paper, Model().parameters)


def donors(count, seed=0):
    """Two parameters whose deviations within each donor correlate by 0.6; donors differ more, the other way."""
    rng = np.random.default_rng(seed)
    pattern = np.array([[1.0, -1.0, 0.0], [1.0, 1.0, -2.0] / np.sqrt(3)])  # orthogonal, of equal length
    rows = []
    for donor in range(count):
        offset, size = 50.0 + 4 * (donor - count / 2), rng.uniform(0.5, 2.0)
        first, second = size * pattern[0], size * (0.6 * pattern[0] + 0.8 * pattern[1])
        for k, site in enumerate(SITES):
            values = {"a": offset + first[k], "b": 100.0 - offset + second[k], "c": 100.0 * (k % 2)}
            rows.append((site, f"D{donor}", values))
    return rows


def test_a_known_correlation_within_donors_is_found():
    found = correlations(cohort(donors(8)), PARAMETERS)
    known = pair(found, "a", "b")
    assert known.r == pytest.approx(0.6, abs=1e-12)
    assert known.dof == 8 * 3 - 8 - 1
    t = 0.6 * np.sqrt(known.dof / (1 - 0.6**2))
    assert known.p == pytest.approx(2 * stats.t.sf(t, known.dof))
    # Fisher's transformation
    half = 1.959964 / np.sqrt(known.dof - 1)
    assert known.interval == pytest.approx(np.tanh([np.arctanh(0.6) - half, np.arctanh(0.6) + half]), abs=1e-6)
    assert found.tests == 3
    json.dumps(plain(found), allow_nan=False)


def test_the_example_of_bakdash_and_marusich():
    import pingouin

    data = pingouin.read_dataset("rm_corr")  # its occasions stand for sites
    specimens = {
        str(number): fit(f"occasion {number}", str(row["Subject"]), {"a": row["pH"], "b": row["PacO2"]})
        for number, row in enumerate(data.to_dict("records"))
    }
    known = pair(correlations(specimens, PARAMETERS[:2]), "a", "b")
    assert known.r == pytest.approx(-0.50677, abs=1e-5)
    assert known.dof == 38
    assert known.p == pytest.approx(0.000847, abs=1e-6)
    assert known.interval == pytest.approx([-0.71, -0.23], abs=0.005)


def test_p_is_adjusted_for_the_number_of_pairs(of_the_paper):
    tested = sorted(of_the_paper.pairs, key=lambda each: each.p)
    assert of_the_paper.tests == len(tested) == 16 * 15 // 2
    assert tested[0].p_holm == pytest.approx(120 * tested[0].p)
    assert tested[1].p_holm == pytest.approx(119 * tested[1].p)
    assert tested[-1].p_holm == 1.0


PUBLISHED = {
    ("tau_3m", "tau_1f"): 0.80,
    ("g_3m", "g_3f"): 0.71,
    ("tau_2m", "tau_1f"): 0.69,
    ("g_2m", "tau_1f"): 0.65,
    ("g_2m", "g_3f"): 0.64,
    ("E_m", "tau_1f"): -0.48,
}


def swapped(name):
    return name[:-1] + {"m": "f", "f": "m"}[name[-1]]


@pytest.mark.parametrize(("names", "r"), PUBLISHED.items())
def test_the_paper_s_correlations_are_those_of_its_table_with_matrix_and_fibre_swapped(of_the_paper, names, r):
    assert pair(of_the_paper, *map(swapped, names)).r == pytest.approx(r, abs=0.0055)
    if names != ("g_3m", "g_3f"):
        assert abs(pair(of_the_paper, *names).r - r) > 0.35, "as the paper's text has it, its table says otherwise"


def test_the_paper_s_five_are_the_largest_between_matrix_and_fibre_and_one_of_them_is_negative(of_the_paper):
    between = [each for each in of_the_paper.pairs if len({name[-1] for name in each.parameters}) == 2]
    assert len(between) == 64
    largest = sorted(between, key=lambda each: each.p)[:5]
    assert [frozenset(each.parameters) for each in largest] == [
        frozenset(map(swapped, names)) for names in list(PUBLISHED)[:5]
    ]
    negative = [each.parameters for each in between if each.p < 0.05 and each.r < 0]
    assert [set(names) for names in negative] == [{"tau_1m", "E_f"}]


def test_what_stays_on_a_bound_has_a_reason_and_no_number():
    rows = [(site, donor, {**values, "c": 100.0 - 0.05 * (k % 2)}) for k, (site, donor, values) in enumerate(donors(4))]
    found = correlations(cohort(rows), PARAMETERS)
    assert pair(found, "a", "b").r is not None
    for other in ("a", "b"):
        stuck = pair(found, other, "c")
        assert "does not vary" in stuck.reason
        assert "c" in stuck.reason
        assert (stuck.r, stuck.p, stuck.p_holm) == (None, None, None)
    assert found.tests == 1
    assert pair(found, "a", "b").p_holm == pair(found, "a", "b").p
    constant = [(site, donor, dict.fromkeys("abc", 1.0)) for site, donor, _ in rows]
    assert correlations(cohort(constant), PARAMETERS).tests == 0


def test_a_parameter_that_differs_between_donors_only_does_not_vary():
    rows = [(site, donor, {**values, "c": 10.0 * int(donor[1:])}) for site, donor, values in donors(4)]
    assert pair(correlations(cohort(rows), PARAMETERS), "a", "c").reason


def test_two_parameters_in_proportion_correlate_by_one():
    rows = [(site, donor, {**values, "c": 100.0 - values["a"]}) for site, donor, values in donors(3)]
    proportional = pair(correlations(cohort(rows), PARAMETERS), "a", "c")
    assert proportional.r == pytest.approx(-1.0)
    assert proportional.interval == pytest.approx([-1.0, -1.0], abs=1e-5)


def test_pairs_that_are_mostly_not_determined_are_marked():
    specimens = cohort(donors(4))
    for number, (name, each) in enumerate(specimens.items()):
        known = ["a", "b"] if number % 2 else ["a"] if number == 0 else ["a", "b", "c"]
        specimens[name] = replace(each, determined=known)
    few = correlations(specimens, PARAMETERS)
    assert few.determined == {"a": 1.0, "b": 11 / 12, "c": 5 / 12}
    assert pair(few, "a", "b").determined
    assert not pair(few, "a", "c").determined
    assert not pair(few, "b", "c").determined
    assert pair(few, "b", "c").r is not None, "marked, not left out"


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        ([row for row in donors(4) if row[0] == "distal"], "fewer than two sites"),
        ([(None, donor, values) for _, donor, values in donors(4)], "fewer than two sites"),
        ([(site, None, values) for site, _, values in donors(4)], "donors are not known"),
        (donors(2), "2 donors"),
        ([(site, f"{site}{donor}", values) for site, donor, values in donors(4)], "0 donors"),
        ([("distal", *donors(4)[0][1:]), ("middle", *donors(4)[1][1:])], "1 donors"),
    ],
)
def test_where_nothing_can_be_said_there_is_a_reason(rows, said):
    specimens = {str(number): fit(*row) for number, row in enumerate(rows)}
    found = correlations(specimens, PARAMETERS)
    assert isinstance(found, NoCorrelations)
    assert said in found.reason


def test_donors_of_one_site_only_are_left_out():
    alone = {f"distal/{k}": fit("distal", "alone", {"a": 7.0 * k, "b": 9.0 * k, "c": 0.0}) for k in range(5)}
    unknown = {"middle/x": fit("middle", None, {"a": 0.0, "b": 99.0, "c": 0.0})}
    specimens = cohort(donors(4))
    assert correlations({**specimens, **alone, **unknown}, PARAMETERS) == correlations(specimens, PARAMETERS)


def test_the_table_by_site_has_the_paper_s_mean_and_deviation(paper):
    paper = {**paper, "distal/1": replace(paper["distal/1"], on_bound=["E_f"], determined=["E_f"])}
    rows = list(csv.DictReader(sites_table(paper, Model().parameters).splitlines()))
    assert [(row["site"], row["parameter"]) for row in rows] == [
        (site, name) for site in SITES for name in (*Model().names, "rmse_N")
    ]
    row = rows[0]
    assert (row["parameter"], row["unit"], row["specimens"], row["on_bound"], row["determined"]) == (
        "E_f",
        "MPa",
        "9",
        "1",
        "9",
    )
    assert float(row["mean"]) == pytest.approx(204.82, abs=0.05), "the paper's text; its table gives 204.849"
    assert float(row["sd"]) == pytest.approx(27.42, abs=0.01)


def test_one_specimen_has_no_deviation_and_a_specimen_may_have_no_site():
    text = sites_table({"x": fit(None, None, {"a": 1.5, "b": 2.0, "c": 3.0})}, PARAMETERS)
    rows = list(csv.DictReader(text.splitlines()))
    assert [row["mean"] for row in rows] == ["1.5", "2", "3", "6.5"]
    assert {row["sd"] for row in rows} == {""}
    assert {row["site"] for row in rows} == {""}
