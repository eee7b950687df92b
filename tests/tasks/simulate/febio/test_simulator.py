"""FEBio as a simulator, with the tendon and with a user's own template."""

import json
import pickle
from dataclasses import replace

import numpy as np
import pytest

from sinew.runner.errors import BadInput
from sinew.runner.store.schema import STATUSES
from sinew.tasks.model import Curve, Protocol
from sinew.tasks.simulate.febio.stepping import solver_steps
from sinew.tasks.simulate.febio.tendon import TendonTemplate, read_template
from tests.tasks.simulate.febio.dogbone import BAR as GAUGE
from tests.tasks.simulate.febio.dogbone import FORCE, OWN, RELAX, dogbone, stand_in
from tests.tasks.simulate.febio.fake_solver import BAR, BREAK, OK, PULL, TEMPLATE, attempts, outcome, rows_with, solver


def test_the_force_is_twice_the_sum_of_the_reactions(tmp_path, model):
    simulator = solver(tmp_path)
    rows = rows_with(model, "E_m", 11.0, 20.0, 70.0)
    simulated = simulator.simulate(model, BAR, PULL, rows)
    assert not simulated.status.any()
    assert simulated.messages == ("", "", "")
    expected = 2.0 * np.array([[11.0], [20.0], [70.0]]) * PULL.displacement_mm
    assert np.allclose(simulated.force_N, expected, rtol=1e-15)
    assert attempts(simulator) == []


def test_a_template_that_cannot_be_rendered_for_a_row_fails_that_row_only(tmp_path, model):
    template = TEMPLATE.replace("<febio_spec", "<!-- {{ 1 / parameters.alpha_f }} --><febio_spec", 1)
    simulator = replace(solver(tmp_path), template=TendonTemplate(template))
    simulated = simulator.simulate(model, BAR, PULL, rows_with(model, "alpha_f", 1.0, 0.0, 2.0))
    assert [STATUSES[s] for s in simulated.status] == ["ok", "bad_input", "ok"]
    assert "division by zero" in simulated.messages[1]
    assert not [name for name in attempts(simulator) if name.startswith("attempt-")]


def test_comparison_is_the_rmse_over_every_point(tmp_path, model):
    simulator = solver(tmp_path, f"if E_m == 20:\n    {BREAK}\n{OK}")
    measured = 30.0 * PULL.displacement_mm + np.cos(PULL.time_s)
    rows = rows_with(model, "E_m", 15.0, 20.0, 30.0)
    compared = simulator.compare(model, BAR, Curve(PULL, measured), rows, np.array([0, 5]))
    force = 2.0 * np.array([[15.0], [np.nan], [30.0]]) * PULL.displacement_mm
    assert np.allclose(compared.rmse_N, np.sqrt(np.mean((force - measured) ** 2, axis=1)), equal_nan=True)
    assert np.allclose(compared.force_N, force[:, [0, 5]], equal_nan=True)
    assert [STATUSES[s] for s in compared.status] == ["ok", "negative_jacobian", "ok"]
    assert compared.messages[0] == ""
    assert "Negative jacobian" in compared.messages[1]


def test_it_can_be_sent_to_a_worker(tmp_path, model):
    simulator = solver(tmp_path)
    assert pickle.loads(pickle.dumps(simulator)) == simulator
    assert outcome(pickle.loads(pickle.dumps(simulator)), model) == ("ok", "")


def test_stresses_are_not_offered(tmp_path, model):
    with pytest.raises(BadInput, match="stresses"):
        solver(tmp_path).simulate(model, BAR, PULL, model.reference[np.newaxis], stresses=True)


def test_identity_follows_what_an_outcome_depends_on(tmp_path):
    simulator = solver(tmp_path)
    others = [
        replace(simulator, version="4.0"),
        replace(simulator, template=TendonTemplate(TEMPLATE + "\n")),
        replace(simulator, ramp_s=0.1),
        replace(simulator, hold_growth=0.0),
        replace(simulator, still_mm=0.001),
    ]
    identities = [str(one.identity()) for one in (simulator, *others)]
    assert len(set(identities)) == len(identities)
    same = replace(
        simulator, timeout_s=1.0, max_file_bytes=10, keep_failed=0, scratch=tmp_path, executable="x", restart_s=1.0
    )
    assert same.identity() == simulator.identity()


def test_thinned_steps_give_a_force_at_every_row(tmp_path, model):
    time_s = np.linspace(0.0, 20.0, 401)
    history = Protocol("ramp and hold", time_s, 0.1 * np.minimum(time_s, 4.0))
    steps = solver_steps(history, 0.2, 0.02, 0.0).size
    assert steps < 200
    simulator = replace(solver(tmp_path, f"assert len(points) == {steps}\n{OK}"), ramp_s=0.2)
    simulated = simulator.simulate(model, BAR, history, rows_with(model, "E_m", 20.0))
    assert simulated.messages == ("",)
    assert np.allclose(simulated.force_N[0], 40.0 * history.displacement_mm, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("start", [0.0, 3.5])
@pytest.mark.parametrize("ramp_s", [0.0, 1.0])
def test_a_history_that_starts_displaced_is_relaxed_first(tmp_path, model, start, ramp_s):
    time_s = start + np.linspace(0.0, 4.0, 17)
    history = Protocol("displaced", time_s, 0.3 + 0.05 * (time_s - start))
    seen = tmp_path / "seen.json"
    simulator = replace(
        solver(tmp_path, f"import json; json.dump(points, open({str(seen)!r}, 'w'))\n{OK}"), ramp_s=ramp_s
    )
    rows = rows_with(model, "E_m", 20.0)
    rows[0, model.names.index("tau_3m")] = 150.0
    simulated = simulator.simulate(model, BAR, history, rows)
    assert simulated.messages == ("",)
    assert np.allclose(simulated.force_N[0], 40.0 * history.displacement_mm, rtol=1e-12)
    times, displacements = np.array(json.loads(seen.read_text())).T
    assert times[:2].tolist() == [0.0, 1.0]
    assert displacements[:3].tolist() == [0.0, 0.3, 0.3]
    assert times[2] >= 20 * 150.0, "long enough for all to relax"
    expected = solver_steps(history, ramp_s, 0.02, 0.0)
    assert np.allclose(times[2:] - times[2], history.time_s[expected] - start, rtol=0, atol=1e-9)
    assert displacements[2:].tolist() == history.displacement_mm[expected].tolist()


def test_a_history_that_starts_late_starts_at_zero(tmp_path, model):
    late = Protocol("late", PULL.time_s + 100.0, PULL.displacement_mm)
    simulated = solver(tmp_path).simulate(model, BAR, late, rows_with(model, "E_m", 20.0))
    assert np.allclose(simulated.force_N[0], 40.0 * PULL.displacement_mm, rtol=1e-12)


def test_files_outside_the_attempt_are_refused_for_every_row(tmp_path, model):
    """A template can name another file for some parameters only."""
    elsewhere = "{% if parameters.E_m < 12 %}/tmp/{% endif %}reaction.txt"
    text = TEMPLATE.replace('file="reaction.txt"', f'file="{elsewhere}"')
    (tmp_path / "input.feb.j2").write_text(text)
    simulator = replace(solver(tmp_path), template=read_template(tmp_path, "input.feb.j2"))
    simulated = simulator.simulate(model, BAR, PULL, rows_with(model, "E_m", 11.0, 13.0))
    assert [STATUSES[s] for s in simulated.status] == ["bad_input", "ok"]


def test_an_evaluation_gives_all_outputs(tmp_path):
    simulator = dogbone(tmp_path)
    curve = Curve(RELAX, np.zeros(RELAX.time_s.size))
    keep = np.array([0, 8, 24])
    rows = np.stack([OWN.reference, [40.0, 0.3, 0.8, 8.0], [20.0, 0.2, 0.8, 8.0], [-1.0, 0.3, 0.8, 8.0]])
    found = simulator.compare(OWN, GAUGE, curve, rows, keep)
    assert [STATUSES[status] for status in found.status] == ["ok", "ok", "ok", "bad_input"]
    assert "E_matrix = -1; expected from 5 to 50" in found.messages[3]
    assert set(found.outputs) == set(found.summaries) == {"force", "stress", "narrowing"}
    done = simulator.simulate(OWN, GAUGE, RELAX, rows)
    for name, values in found.outputs.items():
        np.testing.assert_array_equal(done.outputs[name][:, keep], values)
    assert np.allclose(found.force_N[1], 2 * found.force_N[0], rtol=1e-12)  # linear in the modulus
    assert (found.outputs["narrowing"][2][1:] < found.outputs["narrowing"][0][1:]).all()
    assert np.isclose(found.summaries["force"][0], found.force_N[0, 1])
    assert np.isclose(found.rmse_N[1], 2 * found.rmse_N[0])
    assert np.isnan(found.rmse_N[3])
    assert not list((tmp_path / "attempts").glob("attempt-*"))


PLAYS = {
    "a step short": ("text = text.rpartition('*Step')[0]", "bad_output", "force ends at"),
    "no number": ("text = text.replace('1,', '1,x', 1)", "bad_output", "something else than numbers"),
    "other nodes": ("text = text.replace('\\n', '\\n9', 4)", "bad_output", "force"),
    "nothing": ("text = ''", "bad_output", "0 steps"),
}


@pytest.mark.parametrize("name", PLAYS)
def test_output_that_is_amiss_is_a_failed_row_with_its_reason(tmp_path, name):
    play, status, told = PLAYS[name]
    program = stand_in(tmp_path)
    text = program.read_text()
    wrote = '(folder / asked.get("file")).write_text("\\n".join(lines) + "\\n")'
    assert wrote in text
    program.write_text(
        text.replace(
            wrote,
            f'text = "\\n".join(lines) + "\\n"\n        {play}\n        (folder / asked.get("file")).write_text(text)',
        )
    )
    simulator = dogbone(tmp_path, program=program)
    found = simulator.simulate(OWN, GAUGE, RELAX, OWN.reference[np.newaxis])
    assert STATUSES[found.status[0]] == status
    assert told in found.messages[0]
    (kept,) = (tmp_path / "attempts").iterdir()
    assert json.loads((kept / "failure.json").read_text())["parameters"]["E_matrix"] == 20.0


FINER = """
    finer = [a + part * (b - a) for a, b in pairwise(times) for part in (0.4, 0.99)] + [times[-1]]
    at = [max(i for i in range(len(times) - 1) if times[i] <= t) for t in finer]
    slopes = [(pulled[i + 1] - pulled[i]) / (times[i + 1] - times[i]) for i in at]
    pulled = [0.0] + [pulled[i] + slope * (t - times[i]) for i, slope, t in zip(at, slopes, finer)]
    times = [0.0] + finer
"""


def test_a_solver_with_its_own_time_steps_is_interpolated(tmp_path):
    """Without step_points in the template, outputs come at the solver's own times."""
    program = stand_in(tmp_path)
    text = program.read_text()
    assert text.count("    E, nu = number") == 1
    program.write_text(text.replace("    E, nu = number", f"{FINER}\n    E, nu = number"))
    found = dogbone(tmp_path, program=program).simulate(OWN, GAUGE, RELAX, OWN.reference[np.newaxis])
    exact = dogbone(tmp_path, program=stand_in(tmp_path)).simulate(OWN, GAUGE, RELAX, OWN.reference[np.newaxis]).force_N
    assert not found.status.any(), found.messages
    assert np.abs(found.force_N - exact).max() < 2e-3 * exact.max()


def test_the_identity_names_all_that_matters(tmp_path):
    one = dogbone(tmp_path)
    others = [
        replace(one, version="2"),
        replace(one, template=replace(one.template, files={"model.feb.j2": "other"})),
        replace(one, template=replace(one.template, outputs=(FORCE,))),
        replace(one, template=replace(one.template, force=None)),
        replace(one, ramp_s=1.0),
    ]
    assert len({json.dumps(each.identity(), sort_keys=True) for each in (one, *others)}) == 6
    assert replace(one, timeout_s=1.0, executable="x").identity() == one.identity()


def test_a_protocol_that_starts_displaced_starts_at_rest(tmp_path):
    moved = Protocol("moved", RELAX.time_s, RELAX.displacement_mm + 0.5)
    simulator = dogbone(tmp_path)
    simulator = replace(simulator, template=replace(simulator.template, settle_s=400.0))
    force = simulator.simulate(OWN, GAUGE, moved, OWN.reference[np.newaxis]).force_N[0]
    still = Protocol("still", RELAX.time_s, np.full(RELAX.time_s.size, 0.5))
    assert np.allclose(force[0], simulator.simulate(OWN, GAUGE, still, OWN.reference[np.newaxis]).force_N[0], rtol=1e-9)
