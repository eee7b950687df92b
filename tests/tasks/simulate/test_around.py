"""Effects around a simulator: the same forces as with the effects in sinew's own equations, and rows that fail."""

import shutil
from dataclasses import dataclass, field, replace
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sinew.runner.errors import BadInput
from sinew.runner.store.schema import STATUSES
from sinew.tasks.model import Curve, Model, Protocol, Specimen
from sinew.tasks.model.effect import model_with, model_without
from sinew.tasks.model.effects import named
from sinew.tasks.model.protocols import STANDARD
from sinew.tasks.simulate import Capabilities, Simulated
from sinew.tasks.simulate.around import Around
from sinew.tasks.simulate.balance import RUNS
from sinew.tasks.simulate.effects import UniaxialWith
from sinew.tasks.simulate.near import Near
from sinew.tasks.simulate.retrying import simulate_patiently
from sinew.tasks.simulate.uniaxial import Uniaxial
from tests.tasks.simulate.febio.dogbone import BAR, OWN, RELAX, dogbone

BONE = Specimen("bone", 10.0, 8.0, 4.0)
AROUND = {name: effect for name, effect in named().items() if effect.around}
SEVERAL = [
    ("machine-compliance", "grip-slip", "time-lag"),
    ("force-drift", "friction/pressed", "area-error", "buckling"),
]


@dataclass
class Counting:
    """A simulator that counts its runs."""

    inner: Any
    runs: int = 0
    paces: list[Protocol] = field(default_factory=list)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.inner, name)

    def simulate(self, model: Model, specimen: Specimen, protocol: Protocol, *arguments: Any, **options: Any) -> Any:
        self.runs += 1
        self.paces.append(protocol.pace)
        return self.inner.simulate(model, specimen, protocol, *arguments, **options)


def rows_of(model: Model, count: int) -> np.ndarray:
    """The reference, and rows of the lower three quarters of all ranges."""
    low = np.array([parameter.minimum for parameter in model.parameters])
    high = np.array([parameter.maximum for parameter in model.parameters])
    drawn = np.random.default_rng(1).uniform(0.01, 0.75, (count, low.size))
    return np.concatenate([model.reference[np.newaxis], low + (high - low) * drawn])


def test_effects_of_the_machine_are_those_around():
    assert {name.partition("/")[0] for name in AROUND} == {
        "area-error", "buckling", "force-drift", "friction", "grip-slip", "machine-compliance", "time-lag",
    }  # fmt: skip
    with pytest.raises(ValueError, match="softening acts inside the specimen"):
        Around(Uniaxial(), (named()["softening"],))


@pytest.mark.parametrize("make", STANDARD)
@pytest.mark.parametrize("names", [*((name,) for name in AROUND), *SEVERAL], ids="+".join)
def test_forces_are_those_of_the_equations_with_the_effects_in_them(names, make):
    effects = tuple(AROUND[name] for name in names)
    model, protocol = model_with(Model(), effects), make(10.0, 5.0)
    gentle = len(names) > 1 or "grip-slip/" in names[0]  # where the specimen slides out, there may be no balance
    rows = rows_of(model, 0 if gentle else 2)
    counting = Counting(Uniaxial())
    found = Around(counting, effects).simulate(model, BONE, protocol, rows)
    expected = UniaxialWith(names).simulate(model, BONE, protocol, rows).force_N
    assert found.messages == ("",) * len(rows)
    assert all(pace is protocol for pace in counting.paces)
    assert np.abs(found.force_N - expected).max() < 1e-4 * np.abs(expected).max()
    assert counting.runs <= (len(rows) if not any(effect.giving_way for effect in effects) else 20 * len(rows))


@pytest.mark.parametrize("name", AROUND)
def test_at_their_null_values_effects_change_nothing(name):
    effect = AROUND[name]
    model, protocol = model_with(Model(), (effect,)), STANDARD[2](10.0, 5.0)
    row = np.concatenate([Model().reference, effect.null_values])[np.newaxis]
    counting = Counting(Uniaxial())
    found = Around(counting, (effect,)).simulate(model, BONE, protocol, row)
    bare = Uniaxial().simulate(Model(), BONE, protocol, row[:, :16])
    np.testing.assert_allclose(found.force_N, bare.force_N, rtol=1e-9, atol=1e-9)
    assert counting.runs == 1


def test_outputs_and_errors_are_those_along_the_displacement_that_is_left():
    effects = (AROUND["machine-compliance"], AROUND["force-drift"])
    model, protocol = model_with(Model(), effects), STANDARD[0](10.0, 2.0)
    rng = np.random.default_rng(2)
    lateral = np.where(np.arange(protocol.time_s.size) % 3, np.nan, -0.01)
    curve = Curve(protocol, rng.normal(300.0, 9.0, protocol.time_s.size), {"lateral_strain": lateral})
    keep, rows = np.arange(0, protocol.time_s.size, 7), rows_of(model, 1)
    found = Around(Uniaxial(compared=("lateral_strain",)), effects).compare(model, BONE, curve, rows, keep)
    expected = UniaxialWith(tuple(one.name for one in effects), compared=("lateral_strain",)).compare(
        model, BONE, curve, rows, keep
    )
    np.testing.assert_allclose(found.force_N, expected.force_N, rtol=1e-3, atol=0.05)
    np.testing.assert_allclose(found.rmse_N, expected.rmse_N, rtol=1e-3)
    for name in ("outputs", "summaries", "rmse"):
        one, other = getattr(found, name)["lateral_strain"], getattr(expected, name)["lateral_strain"]
        np.testing.assert_allclose(one, other, rtol=1e-3, atol=1e-6)


def test_a_simulation_gives_the_outputs_of_a_comparison():
    effects = (AROUND["machine-compliance"],)
    model, protocol = model_with(Model(), effects), STANDARD[0](10.0, 2.0)
    curve, rows = Curve(protocol, np.zeros(protocol.time_s.size)), rows_of(model, 1)
    rows = np.concatenate([rows, rows[:1]])
    rows[-1, 0] = -1.0
    everywhere = np.arange(protocol.time_s.size)
    for simulator in (
        Uniaxial(compared=("lateral_strain",)),
        UniaxialWith(("machine-compliance",), compared=("lateral_strain",)),
        Around(Uniaxial(compared=("lateral_strain",)), effects),
    ):
        own, values = (Model(), rows[:, :-1]) if isinstance(simulator, Uniaxial) else (model, rows)
        done = simulator.simulate(own, BONE, protocol, values)
        compared = simulator.compare(own, BONE, curve, values, everywhere)
        assert list(done.outputs) == ["lateral_strain"]
        np.testing.assert_array_equal(done.outputs["lateral_strain"], compared.outputs["lateral_strain"])
        assert np.isnan(done.outputs["lateral_strain"][-1]).all(), "of a row that failed"
        np.testing.assert_array_equal(done.courses(["lateral_strain"])["force"], done.force_N)


def test_rows_that_fail_say_why_and_leave_the_others():
    effect = AROUND["machine-compliance"]
    model = model_with(Model(), (effect,))
    rows = np.tile(model.reference, (3, 1))
    rows[0, model.names.index("E_f")] = -1.0
    rows[1, model.names.index("compliance")] = -1.0
    done = Around(Uniaxial(), (effect,)).simulate(model, BONE, STANDARD[0](10.0, 2.0), rows)
    assert [STATUSES[status] for status in done.status] == ["bad_input", "bad_input", "ok"]
    assert done.messages[0].startswith("E_f = -1; expected")
    assert done.messages[1].startswith("compliance = -1; expected")
    assert np.isnan(done.force_N[:2]).all()
    assert np.isfinite(done.force_N[2]).all()


@dataclass
class Contrary:
    """A simulator with another force in each run, so that no displacement agrees with it."""

    name = "contrary"
    capabilities = Capabilities()
    runs: int = 0
    status: int = 0

    def simulate(self, model: Model, specimen: Specimen, protocol: Protocol, parameters: np.ndarray) -> Simulated:
        self.runs += 1
        force = np.random.default_rng(self.runs).normal(0.0, 100.0, (1, protocol.time_s.size))
        return Simulated(force, np.array([self.status], dtype=np.int8), ("stopped" if self.status else "",))


@dataclass
class Brittle(Counting):
    """A simulator of which every third run fails, the second one first."""

    def simulate(self, *arguments: Any, **options: Any) -> Any:
        done = super().simulate(*arguments, **options)
        if self.runs % 3 == 2:
            return replace(done, status=np.array([STATUSES.index("diverged")], dtype=np.int8), messages=("no",))
        return done


def test_a_run_that_fails_on_the_way_to_the_balance_is_a_step_too_far():
    effect = AROUND["machine-compliance"]
    model, protocol = model_with(Model(), (effect,)), STANDARD[2](10.0, 5.0)
    row = model.reference[np.newaxis]
    done = Around(Brittle(Uniaxial()), (effect,)).simulate(model, BONE, protocol, row)
    expected = UniaxialWith((effect.name,)).simulate(model, BONE, protocol, row).force_N
    assert done.messages == ("",)
    assert np.abs(done.force_N - expected).max() < 1e-4 * np.abs(expected).max()


@pytest.mark.parametrize("name", ["machine-compliance", "grip-slip/threshold"])
def test_near_a_balance_others_are_found_in_fewer_runs(name):
    effect = AROUND[name]
    model, protocol = model_with(Model(), (effect,)), STANDARD[0](10.0, 5.0)
    rows = np.tile(model.reference, (4, 1))
    rows[1:] *= 1.0 + 0.003 * np.eye(3, rows.shape[1], rows.shape[1] - 3)
    alone, together, known = Counting(Uniaxial()), Counting(Uniaxial()), {}
    expected = Around(alone, (effect,)).simulate(model, BONE, protocol, rows).force_N
    found = Around(together, (effect,), Near(known)).simulate(model, BONE, protocol, rows).force_N
    assert np.abs(found - expected).max() < 2e-4 * np.abs(expected).max()
    assert together.runs < 0.7 * alone.runs
    assert list(known) == [protocol.digest]
    begun = together.runs
    Around(together, (effect,), Near(known)).simulate(model, BONE, protocol, rows[:1])
    assert together.runs <= begun + 1 + effect.asks_rigid, "it begins where the first row ended"


@pytest.mark.parametrize("part", [5e-6, 5e-4])
def test_near_a_balance_small_steps_change_the_force(part):
    """A step that moves the specimen by less than what a balance may leave still tells a derivative."""
    effect = AROUND["machine-compliance"]
    model, protocol = model_with(Model(), (effect,)), STANDARD[0](10.0, 5.0)
    rows = np.tile(model.reference, (2, 1))
    exact = UniaxialWith((effect.name,)).simulate(model, BONE, protocol, rows).force_N[0]
    rows[1, -1] += part * protocol.displacement_mm.max() / exact.max()
    expected = np.diff(UniaxialWith((effect.name,)).simulate(model, BONE, protocol, rows).force_N, axis=0)[0]
    found = np.diff(Around(Uniaxial(), (effect,), Near({})).simulate(model, BONE, protocol, rows).force_N, axis=0)[0]
    assert np.abs(found - expected).max() < 0.02 * np.abs(expected).max()


def test_a_balance_that_is_not_near_misleads_nobody():
    effect = AROUND["machine-compliance"]
    model, protocol = model_with(Model(), (effect,)), STANDARD[0](10.0, 5.0)
    row, known = model.reference[np.newaxis], {}
    expected = Around(Uniaxial(), (effect,), Near(known)).simulate(model, BONE, protocol, row).force_N
    (right,) = known.values()
    for wrong in (np.full_like(right.run.displacement_mm, np.nan), -9.0 * right.run.displacement_mm):
        run = replace(right.run, displacement_mm=wrong)
        known[protocol.digest] = replace(right, values=right.values + 0.01, run=run)
        found = Around(Uniaxial(), (effect,), Near(known)).simulate(model, BONE, protocol, row)
        assert found.messages == ("",)
        assert np.abs(found.force_N - expected).max() < 2e-4 * np.abs(expected).max()


def test_without_a_run_outputs_are_those_of_a_specimen_that_is_linear_nearby():
    """The effect acts as it does, however large its change; what follows from the tissue is linear."""
    effects = (AROUND["machine-compliance"], AROUND["time-lag"])
    model, protocol = model_with(Model(), effects), STANDARD[0](10.0, 5.0)
    row, known = model.reference, {}
    steps = 0.01 * np.eye(row.size) * [p.maximum - p.minimum for p in model.parameters]
    counting = Counting(Uniaxial(compared=("lateral_strain",)))
    around = Around(counting, effects, Near(known))
    assert around.nearly(model, BONE, protocol, row[np.newaxis]) is None, "nothing is known yet"
    around.simulate(model, BONE, protocol, np.concatenate([row[np.newaxis], row + steps]))
    begun = counting.runs
    there = np.array([row, row + 0.5 * steps[0], row + 0.5 * steps[3], row * [*np.ones(16), 1.5, 3.0]])
    found = around.nearly(model, BONE, protocol, there)
    assert counting.runs == begun
    whole = UniaxialWith(tuple(one.name for one in effects), compared=("lateral_strain",))
    expected = whole.simulate(model, BONE, protocol, there)
    for force, truth in zip(found["force"], expected.force_N, strict=True):
        assert np.abs(force - truth).max() < 2e-3 * np.abs(truth).max()
    assert np.abs(found["force"][3] - found["force"][0]).max() > 0.02 * np.abs(found["force"][0]).max()
    lateral = expected.outputs["lateral_strain"]
    assert np.abs(found["lateral_strain"] - lateral).max() < 2e-3 * np.abs(lateral).max()


def test_a_step_of_one_parameter_tells_its_slope():
    effect = AROUND["machine-compliance"]
    model, protocol = model_with(Model(), (effect,)), STANDARD[0](10.0, 5.0)
    rows, known = np.tile(model.reference, (2, 1)), {}
    rows[1, 0] *= 1.05
    for row in rows:
        Around(Uniaxial(), (effect,), Near(known)).simulate(model, BONE, protocol, row[np.newaxis])
    found = known[protocol.digest]
    moved = replace(protocol, displacement_mm=found.run.displacement_mm)
    ends = Uniaxial().simulate(Model(), BONE, moved, rows[:, :16]).force_N
    step = found.values[0] - (rows[0, 0] - model.parameters[0].minimum) / (
        model.parameters[0].maximum - model.parameters[0].minimum
    )
    expected = np.diff(ends, axis=0)[0] / step
    assert np.abs(found.slopes[0, 0] - expected).max() < 0.1 * np.abs(expected).max()
    assert not found.slopes[1:].any()


def test_what_the_grips_hold_follows_the_parameters():
    """It is a part of the force along the grips, not of that along what slip leaves."""
    effect = AROUND["grip-slip/threshold"]
    model, protocol = model_with(Model(), (effect,)), STANDARD[0](10.0, 5.0)
    row, known = model.reference.copy(), {}
    row[-2] *= 4.0
    steps = np.zeros((1, row.size))
    steps[0, 0] = 0.005 * (model.parameters[0].maximum - model.parameters[0].minimum)
    around = Around(Uniaxial(), (effect,), Near(known))
    found = np.diff(around.simulate(model, BONE, protocol, np.array([row, row + steps[0]])).force_N, axis=0)[0]
    whole = UniaxialWith((effect.name,))
    ends = whole.simulate(model, BONE, protocol, np.array([row, row + steps[0]])).force_N
    expected = np.diff(ends, axis=0)[0]
    assert np.abs(found - expected).max() < 0.03 * np.abs(expected).max()
    rigid = Uniaxial().simulate(Model(), BONE, protocol, np.array([row, row + steps[0]])[:, :16]).force_N
    np.testing.assert_allclose(
        known[protocol.digest].rigid_slopes[0], np.diff(rigid, axis=0)[0] / 0.005, rtol=1e-6, atol=1e-6
    )


def test_a_machine_that_runs_away_has_no_balance():
    """Where a linear specimen has none, the nearest displacement is none either, however well its answer is known."""
    effect = AROUND["grip-slip"]
    model, protocol = model_with(Model(), (effect,)), STANDARD[0](10.0, 5.0)
    row, contrary = np.append(model.reference[:-2], [5e-4, 1e-6]), Contrary()
    done = Around(contrary, (effect,), Near({})).simulate(model, BONE, protocol, row[np.newaxis])
    assert STATUSES[done.status[0]] == "diverged"


@dataclass
class Accident(Counting):
    """A simulator whose run with this number is killed."""

    at: int = 0

    def simulate(self, *arguments: Any, **options: Any) -> Any:
        done = super().simulate(*arguments, **options)
        if self.runs != self.at:
            return done
        return replace(done, status=np.array([STATUSES.index("out_of_memory")]), messages=("killed",))


@pytest.mark.parametrize("at", range(1, 9))
def test_a_run_that_is_killed_changes_no_number(at):
    effect = AROUND["machine-compliance"]
    model, protocol = model_with(Model(), (effect,)), STANDARD[0](10.0, 5.0)
    rows = np.tile(model.reference, (4, 1))
    rows[[1, 2, 3], [0, 3, -1]] *= 1.003
    results, left = [], []
    killed = Accident(Uniaxial(), at=at)
    for simulator in (Counting(Uniaxial()), killed):
        known: dict[str, Any] = {}
        around = Around(simulator, (effect,), Near(known))
        results.append(simulate_patiently(around, model, BONE, protocol, rows, retries=2))
        left.append(known[protocol.digest])
    assert results[1].messages == ("",) * 4
    assert results[0].force_N.tobytes() == results[1].force_N.tobytes()
    assert killed.runs > at, "one run was killed"
    for name in ("run.displacement_mm", "run.courses", "slopes", "response.shown.changes", "rigid_slopes"):
        one, other = map(attrgetter(name), left)
        assert one.tobytes() == other.tobytes()


def test_rows_that_differ_in_their_effects_alone_share_runs():
    effects = (AROUND["force-drift"], AROUND["time-lag"])
    model, protocol = model_with(Model(), effects), STANDARD[0](10.0, 5.0)
    rows = np.tile(model.reference, (5, 1))
    rows[np.arange(1, 4), -np.arange(1, 4)] *= 1.1
    rows[4, 0] *= 1.1
    counting = Counting(Uniaxial())
    found = Around(counting, effects).simulate(model, BONE, protocol, rows)
    assert counting.runs == 2
    assert len({force.tobytes() for force in found.force_N}) == 5


def test_without_a_balance_a_row_fails():
    effect = AROUND["machine-compliance"]
    model, contrary = model_with(Model(), (effect,)), Contrary()
    done = Around(contrary, (effect,)).simulate(model, BONE, STANDARD[0](10.0, 1.0), model.reference[np.newaxis])
    assert STATUSES[done.status[0]] == "diverged"
    assert done.messages == (f"no balance of force and displacement in {RUNS} runs of the simulator",)
    assert RUNS // 2 < contrary.runs <= RUNS, "the same displacement is not run twice"
    stopped = Contrary(status=STATUSES.index("timeout"))
    done = Around(stopped, (effect,)).simulate(model, BONE, STANDARD[0](10.0, 1.0), model.reference[np.newaxis])
    assert (STATUSES[done.status[0]], done.messages, stopped.runs) == ("timeout", ("stopped",), 1)


def test_there_are_no_stresses_of_the_constituents():
    effect = AROUND["time-lag"]
    model = model_with(Model(), (effect,))
    with pytest.raises(BadInput, match="with effects there are no stresses"):
        Around(Uniaxial(), (effect,)).simulate(
            model, BONE, STANDARD[0](10.0, 1.0), model.reference[None], stresses=True
        )


@pytest.mark.parametrize("solver", ["stand-in", pytest.param("febio4", marks=pytest.mark.febio)])
def test_a_model_of_ones_own_is_in_balance_with_the_machine(tmp_path, solver):
    """The solver stops where it would without the machine, although no hold is one for the specimen any more."""
    program = None if solver == "stand-in" else Path(str(shutil.which(solver)))
    own = replace(dogbone(tmp_path, program=program), hold_growth=0.5)
    effect = replace(AROUND["machine-compliance"])
    around = own.with_effects((effect,))
    assert isinstance(around, Around)
    model = model_with(OWN, (effect,))
    assert model_without(model, (effect,)) == OWN
    compliance = 2e-3
    row = np.append(OWN.reference, compliance)[np.newaxis]
    force = around.simulate(model, BAR, RELAX, row).force_N[0]
    left = RELAX.displacement_mm - compliance * force
    assert np.ptp(left[RELAX.time_s > 4.0]) > 1e-3, "the specimen moves on in the hold"
    alone = own.simulate(OWN, BAR, replace(RELAX, displacement_mm=left, paced_by=RELAX), row[:, :-1]).force_N[0]
    np.testing.assert_allclose(force, alone, rtol=1e-4, atol=1e-4 * force.max())
    assert np.abs(own.simulate(OWN, BAR, RELAX, row[:, :-1]).force_N[0] - force).max() > 0.01 * force.max()
    stops = own._stops(OWN, replace(RELAX, displacement_mm=left, paced_by=RELAX), row[0, :-1])
    assert stops.rows.tolist() == own._stops(OWN, RELAX, row[0, :-1]).rows.tolist()
    assert around.identity() == own.identity() | {"around": {"version": 2, "effects": ["machine-compliance"]}}


def test_effects_inside_the_specimen_are_refused_around_a_model_of_ones_own(tmp_path):
    own = dogbone(tmp_path)
    assert own.can_have((AROUND["friction"], AROUND["area-error"]))
    assert not own.can_have((named()["softening"],))
    with pytest.raises(BadInput, match=r"simulator\.fibre does not say which material"):
        own.with_effects((named()["softening"], AROUND["friction"]))
