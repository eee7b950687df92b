"""How well parameter sets agree with all that was measured of one specimen: whitened errors, and the sum of squares.

Minus half the sum of squares is the logarithm of the likelihood, up to a constant, for errors as the noise is
estimated from the curves themselves (:mod:`sinew.tasks.data.noise`): generalised least squares. With a discrepancy
(:mod:`sinew.tasks.infer.likelihood.discrepancy`), an error of the model itself is expected beside the noise.

Points are on the unit cube of the free parameters: 0 is the lower bound of a parameter, 1 the upper. Chains and fits
move as scores (:mod:`sinew.tasks.infer.likelihood.scores`).

A quick simulator is called where a likelihood is needed. Another's runs are rows of the store: a :class:`RowTarget`
asks for them.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Protocol as Interface

import numba
import numpy as np

from sinew.runner.evaluation.adaptive import RowResult, Session
from sinew.tasks.fitting.measured import Measured
from sinew.tasks.model import Model
from sinew.tasks.model.parameters import Parameter, scaled
from sinew.tasks.simulate import Array, Courses, Simulator

STEP, SOLVER_STEP = 1e-5, 3e-3  # of a difference quotient; a solver's forces are less exact


class Squares(Interface):
    """What chains ask of a likelihood."""

    def squares(self, at: Array) -> Array:
        """Sums of squares ``[n]`` at points ``[n, k]``: minus twice the log likelihoods, up to a constant."""
        ...


@dataclass(frozen=True, eq=False)
class Target:
    """The likelihood of one specimen's curves, by ``k`` parameters that vary; all others are at their reference.

    ``whitening``: of the noise's whitened errors ``[n, g]``, where the model has an error as well; ``near``: scores
    ``[k]`` of the best fit beside that error.
    """

    model: Model
    varied: tuple[Parameter, ...]
    simulator: Simulator
    measured: Measured
    whitening: Callable[[Array], Array] | None = None
    near: Array | None = None

    step = STEP

    @property
    def size(self) -> int:
        return len(self.varied)

    @property
    def points(self) -> int:
        """How many whitened errors there are."""
        return sum(one.size for one in self.measured.thinned.values())

    @property
    def parts(self) -> tuple[Array, ...]:
        """Where each quantity that is compared stands among the whitened errors."""
        return tuple(self.measured.places.values())

    def errors(self, at: Array) -> Array:
        """Whitened errors ``[n, g]`` at points ``[n, k]``; NaN where the model fails."""
        courses = self.courses(at)
        every = [one.residuals(courses[name]) for name, one in self.measured.thinned.items()]
        errors = np.concatenate(every, axis=1)
        return errors if self.whitening is None else self.whitening(errors)

    def squares(self, at: Array) -> Array:
        """Sums of squares ``[n]`` of the whitened errors at points ``[n, k]``; infinite where the model fails."""
        if self.whitening is not None:
            total = np.square(self.errors(at)).sum(axis=1)
            return np.where(np.isfinite(total), total, np.inf)
        total, courses = np.zeros(len(at)), self.courses(at)
        for name, curve in self.measured.thinned.items():
            for quantity, one in curve.quantities.items():
                weights = one.weights
                total += _squares(weights.data, weights.indices, weights.indptr, one.target, courses[name][quantity])
        return np.where(np.isfinite(total), total, np.inf)

    def slopes(self, at: Array) -> tuple[Array, Array]:
        """Whitened errors ``[g]`` at a point ``[k]``, and their derivatives ``[g, k]``."""
        steps = np.where(at + self.step <= 1.0, self.step, -self.step)
        errors = self.errors(np.concatenate([at[np.newaxis], at + np.diag(steps)]))
        return errors[0], ((errors[1:] - errors[0]) / steps[:, np.newaxis]).T

    def blind(self) -> Array:
        """Which parameters ``[k]`` the curves do not depend on at all, as the force on Poisson's ratio."""
        rng = np.random.default_rng(0)
        here = rng.uniform(0.3, 0.7, self.size)
        moved = here + np.diag(rng.uniform(0.1, 0.2, self.size))
        errors = self.errors(np.concatenate([here[np.newaxis], moved]))
        return np.asarray((errors[1:] == errors[0]).all(axis=1))

    def courses(self, at: Array) -> Mapping[str, Courses]:
        """What is compared along each curve by its name, at the points of fits; NaN where the model fails."""
        rows, specimen, found = self.rows(at), self.measured.specimen, {}
        for name, one in self.measured.thinned.items():
            done = self.simulator.simulate(self.model, specimen, one.protocol, rows)
            found[name] = done.courses(self.measured.others)
        return found

    def rows(self, at: Array) -> Array:
        """Parameter sets ``[n, d]`` of the model at points ``[n, k]``."""
        return self.model.full(tuple(parameter.name for parameter in self.varied), scaled(self.varied, at))


@dataclass(frozen=True, eq=False)
class RowTarget(Target):
    """A likelihood that asks its ``session`` for rows of the store, which hold courses at all measured points."""

    session: Session = field(kw_only=True)

    step = SOLVER_STEP

    def courses(self, at: Array) -> Mapping[str, Courses]:
        every: list[RowResult] = self.session.ask_all(self.rows(at))
        return {
            name: {
                quantity: np.array([row.values[f"{quantity}_{name}"][one.rows] for row in every])
                for quantity in self.measured.quantities
            }
            for name, one in self.measured.thinned.items()
        }


@numba.njit(nogil=True, cache=True, error_model="numpy")
def _squares(data, indices, starts, target, force):  # type: ignore[no-untyped-def]
    """For each row of ``force`` the squared length of a sparse matrix times it, less ``target``."""
    total = np.zeros(force.shape[0])
    for row in range(force.shape[0]):
        for group in range(target.size):
            error = -target[group]
            for entry in range(starts[group], starts[group + 1]):
                error += data[entry] * force[row, indices[entry]]
            total[row] += error * error
    return total
