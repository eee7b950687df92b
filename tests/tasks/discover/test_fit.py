"""Fits with another solver than the embedded simulator follow that solver's forces."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from tasks.discover.fit import Candidate, fit
from tasks.discover.measured import Measured
from tasks.model import Curve, Model, Specimen
from tasks.model.protocols import cyclic, one_step
from tasks.noise import Noise
from tasks.simulate import Simulated
from tasks.simulate.febio import FEBio
from tasks.simulate.uniaxial import Uniaxial

SOFTER = 0.95


@dataclass(frozen=True)
class Softer(FEBio):
    """A solver whose bar is a little softer than the embedded one."""

    def simulate(self, model, specimen, protocol, parameters, *, stresses=False):
        done = Uniaxial().simulate(model, specimen, protocol, parameters)
        return Simulated(SOFTER * done.force_N, done.status, done.messages)


@pytest.fixture(scope="module")
def measured():
    model, rng = Model(), np.random.default_rng(5)
    bare = Specimen("one", 10.0, 8.0, 4.0)
    curves = []
    for make in (one_step, cyclic):
        protocol = make(bare.length_mm, 4.0)
        force = Uniaxial().simulate(model, bare, protocol, model.reference[np.newaxis]).force_N[0]
        curves.append(Curve(protocol, force + rng.normal(0.0, 1.0, force.size)))
    return Measured(Specimen("one", 10.0, 8.0, 4.0, tuple(curves)), Noise(1.0, 0.0))


def test_a_fit_ends_where_the_solver_fits(measured):
    embedded = Candidate(Model())
    with_solver = Candidate(Model(), solver=Softer("none", "none", "", Path()))
    middle = np.full(embedded.size, 0.5)
    own, softer = fit(embedded, measured, middle), fit(with_solver, measured, middle)
    assert softer.loss == pytest.approx(own.loss, abs=3.0), "both fit to the noise"
    values = [embedded.rows(found.at[np.newaxis])[0][0] for found in (own, softer)]
    names = list(Model().names)
    ratio = values[1][names.index("E_f")] / values[0][names.index("E_f")]
    assert ratio == pytest.approx(1.0 / SOFTER, rel=0.02)


def test_what_a_solver_cannot_run_is_far_away_and_never_not_a_number(measured):
    @dataclass(frozen=True)
    class Broken(FEBio):
        def simulate(self, model, specimen, protocol, parameters, *, stresses=False):
            shape = (len(parameters), protocol.time_s.size)
            return Simulated(np.full(shape, np.nan), np.ones(len(parameters), np.int8), ("it broke",) * len(parameters))

    found = fit(Candidate(Model(), solver=Broken("none", "none", "", Path())), measured, np.full(15, 0.5))
    assert np.isfinite(found.at).all()
    assert found.loss > 1e6
