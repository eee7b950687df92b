"""Planting in a record is exact: the simulator with the effect, pulled as the planted record says, gives its force."""

import json

import numpy as np
import pytest
from click.testing import CliRunner

from sinew.tasks.data.cohort import write_cohort
from sinew.tasks.data.noise import Noise
from sinew.tasks.discover.fit.candidate import Candidate
from sinew.tasks.fitting.measured import Measured
from sinew.tasks.model import Curve, Model, Protocol, Specimen
from sinew.tasks.model.effects import library
from sinew.tasks.model.protocols import cyclic
from sinew.tasks.simulate.effects import simulate_with
from tests.hidden.planted import EFFECTS, main, planted, strength
from tests.tasks.discover import few

BAR = Specimen("bar", 10.0, 8.0, 4.0)
AT = Model().reference[np.newaxis]


def recorded(effects=(), values=(), protocol=None):
    protocol = cyclic(10.0, 20.0) if protocol is None else protocol
    force = simulate_with(Model(), effects, BAR, protocol, AT, np.array([values]).reshape(1, -1))[0]
    return Specimen("bar", 10.0, 8.0, 4.0, (Curve(protocol, force),))


def values_of(name, size, curve):
    """The library's parameters of what is planted with a size."""
    moved, peak = np.abs(curve.protocol.displacement_mm).max(), curve.force_N.max()
    time = curve.protocol.time_s
    impulse = np.sum(np.maximum(curve.force_N, 0.0) * np.diff(time, prepend=time[0]))
    return {
        "machine-compliance": [size * moved / peak],
        "grip-slip": [0.0, size * moved / impulse],
        "force-drift": [0.0, size * peak / (time[-1] - time[0])],
        "time-lag": [size],
    }[name]


@pytest.mark.parametrize("name", ["machine-compliance", "grip-slip", "force-drift", "time-lag"])
def test_the_simulator_with_the_effect_gives_the_planted_record(name):
    true = recorded()
    found = planted(true, name, 0.05).curves[0]
    effect = library()[name]
    values = values_of(name, 0.05, true.curves[0])[: len(effect.parameters)]
    expected = recorded((effect,), values, found.protocol).curves[0]
    difference = np.abs(found.force_N - true.curves[0].force_N).max()
    moved = np.abs(found.protocol.displacement_mm - true.curves[0].protocol.displacement_mm).max()
    assert max(difference / found.force_N.max(), moved) > 0.01, "something was planted"
    assert np.abs(found.force_N - expected.force_N).max() < 0.005 * found.force_N.max()


@pytest.mark.parametrize("name", EFFECTS)
def test_nothing_is_planted_with_size_zero(name):
    true = recorded()
    found = planted(true, name, 0.0).curves[0]
    assert found.force_N.tolist() == true.curves[0].force_N.tolist()
    assert found.protocol.displacement_mm.tolist() == true.curves[0].protocol.displacement_mm.tolist()


def test_friction_turns_where_the_movement_turns_and_stays_in_holds():
    time = np.arange(60) / 10.0
    moved = np.interp(time, [0.0, 2.0, 4.0, 5.9], [0.0, 1.0, 1.0, 0.0])
    true = Specimen("bar", 10.0, 8.0, 4.0, (Curve(Protocol("one", time, moved), np.full(60, 10.0)),))
    added = planted(true, "friction", 0.1).curves[0].force_N - 10.0
    assert np.allclose(added[:39], 1.0) and np.allclose(added[42:], -1.0)


def test_strength_is_in_units_of_the_noise_and_of_what_nothing_imitates():
    true = recorded()
    quiet, loud = (strength(Candidate(Model()), Measured(true, Noise(sd, 0.0)), "time-lag") for sd in (0.5, 5.0))
    assert quiet == pytest.approx(10.0 * loud, rel=0.2)
    whole = planted(true, "time-lag", 1.0).curves[0].force_N - true.curves[0].force_N
    assert 0.0 < loud < np.sqrt(np.mean(whole**2)) / 5.0, "less than all of it"


@pytest.mark.thorough
def test_a_lag_is_named_where_it_is_planted(tmp_path):
    rng = np.random.default_rng(4)
    true = recorded(protocol=cyclic(10.0, 5.0))
    curve = true.curves[0]
    noisy = Curve(curve.protocol, curve.force_N + rng.normal(0.0, 1.0, curve.force_N.size))
    write_cohort(tmp_path / "cohort", [Specimen("bar", 10.0, 8.0, 4.0, (noisy,))])
    base = tmp_path / "base.yaml"
    base.write_text(
        "name: planted\nseed: 1\ncohort: cohort\nsimulator: uniaxial\ncluster: {name: local, workers: 1}\n"
        f"tasks: [discover]\ndiscover: {{effects: [time-lag, force-drift], starts: 1, laws: false}}\n{few.SECTION}",
        "utf-8",
    )
    arguments = [str(tmp_path / "cohort"), "--base", str(base), "--out", str(tmp_path / "out"), "--effect", "time-lag"]
    done = CliRunner().invoke(main, [*arguments, "--workers", "1"], catch_exceptions=False)
    assert done.exit_code == 0 and "1 of 1 differ by exactly the effect" in done.output
    (row,) = json.loads((tmp_path / "out" / "planted.json").read_text("utf-8"))["rows"]
    assert row["effects"] == ["time-lag"] and row["right"]
