"""A misfit of known shape is described as what it is, and noise as nothing."""

import json
from functools import cache

import numpy as np
import pytest

from sinew.tasks.data.noise import Noise
from sinew.tasks.data.virtual import autoregressive
from sinew.tasks.discover.fit.candidate import Candidate
from sinew.tasks.discover.fit.fit import fit, residuals
from sinew.tasks.discover.measure.shape import shape, similarities, smooth
from sinew.tasks.fitting.measured import Measured
from sinew.tasks.model import Curve, Model, Specimen
from sinew.tasks.model.effects import library
from sinew.tasks.model.phases import phases
from sinew.tasks.model.protocols import cyclic, one_step, two_step
from sinew.tasks.study.result import plain

NOISE = Noise(2.0, 0.3)
LENGTH = 10.0


def measured_with(errors, protocols=(one_step, two_step, cyclic), seed=0):
    """A specimen whose measured forces are ``errors`` of each protocol and noise."""
    rng = np.random.default_rng(seed)
    curves = []
    for make in protocols:
        protocol = make(LENGTH, 4.0)
        noise = NOISE.sd_N * autoregressive(rng, protocol.time_s.size, NOISE.ar1)
        curves.append(Curve(protocol, errors(protocol) + noise))
    return Measured(Specimen("one", LENGTH, 8.0, 4.0, tuple(curves)), NOISE)


def seen(measured):
    """Whitened errors of a model that has no force at all."""
    return np.concatenate([measured.thinned[curve.name].quantities["force"].target for curve in measured.curves])


def unloading(protocol, size, growth=0.0):
    """Newtons in unloading: largest at 2 % strain, more with every cycle."""
    found = np.zeros(protocol.time_s.size)
    strain = protocol.displacement_mm / LENGTH
    for phase in phases(protocol):
        if phase.kind == "unload":
            points = slice(phase.start + 1, phase.stop)
            bump = np.exp(-(((strain[points] - 0.02) / 0.01) ** 2))
            found[points] = size * (1.0 + growth * np.log(phase.number)) * bump
    return found


def test_a_misfit_in_unloading_is_told_in_newtons():
    measured = measured_with(lambda protocol: unloading(protocol, -6.0, 0.5))
    found = smooth(measured, seen(measured), 0)
    assert found.explained > 0.85
    middle = min((row for row in found.table if row.kind == "unload"), key=lambda row: abs(row.x - 0.021))
    expected = -6.0 * np.exp(-(((middle.x - 0.02) / 0.01) ** 2))
    assert (middle.first, middle.last) == (2, 12), "the first cycle went to 2 % only"
    assert middle.first_N == pytest.approx(expected * (1.0 + 0.5 * np.log(2)), abs=2.0)  # from few points
    assert middle.last_N == pytest.approx(expected * (1.0 + 0.5 * np.log(12)), abs=1.0)
    assert all(abs(row.last_N) < 4.0 * row.error_N + 0.3 for row in found.table if row.kind == "load")
    assert found.sentence.startswith("measured unloading lies 1")
    assert "N below the model at 2 % strain, growing: -" in found.sentence


def test_a_misfit_late_in_holds_is_told_in_seconds():
    def late(protocol):
        found = np.zeros(protocol.time_s.size)
        for phase in phases(protocol):
            if phase.kind == "hold":
                time = protocol.time_s[phase.points]
                found[phase.points] = 2.0 * np.log1p(time - time[0])
        return found

    measured = measured_with(late, (one_step, two_step))
    found = smooth(measured, seen(measured), 0)
    assert found.explained > 0.85
    row = [row for row in found.table if row.kind == "hold"][-1]
    assert row.first_N == pytest.approx(2.0 * np.log1p(row.x), abs=0.8)
    assert found.sentence.startswith("measured holds lie")
    assert "above the model 1" in found.sentence and "growing" not in found.sentence


def test_noise_has_no_shape():
    for seed in range(3):
        measured = measured_with(lambda protocol: np.zeros(protocol.time_s.size), seed=seed)
        found = smooth(measured, seen(measured), 0)
        assert found.explained == 0.0
        assert found.sentence == "what is left has no shape that returns from phase to phase"
        assert max(abs(row.last_N) for row in found.table) < 1.0


def test_what_does_not_return_is_no_shape():
    """One phase is off to one side, the next of its kind to the other."""

    def erratic(protocol):
        found = np.zeros(protocol.time_s.size)
        for phase in phases(protocol):
            found[phase.points] = 20.0 * (-1.0) ** phase.number
        return found

    measured = measured_with(erratic)
    found = smooth(measured, seen(measured), 0)
    assert found.beyond > 1000.0
    assert found.explained < 0.2


@cache
def pulled(slug, *values):
    """Forces of the model with an effect, and where the bare model fits them."""
    model = Model()
    true = Candidate(model, (library()[slug],))
    start = np.full(len(true.varied), 0.45)
    start[1] = 0.2
    at = np.concatenate([start, [true.unit(*each) for each in zip(true.effects[0].names, values, strict=True)]])
    bare = Specimen("one", LENGTH, 8.0, 4.0)
    measured = measured_with(lambda protocol: true.forces(bare, protocol, at[np.newaxis])[0], (one_step, cyclic))
    return model, measured, fit(Candidate(model), measured, start).at


@pytest.mark.parametrize(
    ("slug", "values", "parameter", "sign"),
    [
        ("force-drift", (0.0, 0.2), "force_slope", 1.0),
        ("force-drift", (0.0, -0.2), "force_slope", -1.0),
        ("cyclic-fatigue", (0.1,), "fatigue_per_strain", 1.0),
    ],
)
def test_the_effect_that_is_there_is_the_most_similar(slug, values, parameter, sign):
    model, measured, null = pulled(slug, *values)
    chosen = {
        name: library()[name] for name in ("force-drift", "cyclic-fatigue", "time-lag", "area-error", "toe-slack")
    }
    found = similarities(Candidate(model), [measured], [null], chosen)
    assert (found[0].effect, found[0].parameter) == (slug, parameter)
    errors = np.sum(residuals(Candidate(model), measured, null[np.newaxis], measured.curves) ** 2)
    assert sign * found[0].cosine > 0.8 * np.sqrt(1.0 - seen(measured).size / errors)
    by_name = {one.effect: one for one in found}
    assert by_name["area-error"].cosine == 0.0 or by_name["area-error"].own > 1e-3
    assert len(found) == 6  # force-drift has two


def test_all_of_it_can_be_told():
    model, measured, null = pulled("force-drift", 0.0, 0.2)
    found = shape(Candidate(model), [measured, measured], [null, null], {"time-lag": library()["time-lag"]})
    told = json.loads(json.dumps(plain(found)))
    assert told["what"].endswith("not its mechanism")
    assert told["similar"][0]["effect"] == "time-lag"
    assert [one["specimen"] for one in told["corrections"]] == ["one", "one"]
    assert told["corrections"][0]["explained"] > 0.1
    assert abs(told["similar"][0]["cosine"]) < told["largest_cosine"] < 1.0
