"""How one specimen is calibrated, and what its curves say of each parameter at the best fit."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sinew.tasks.calibrate.result import SEARCHES, ConfoundedPair, MethodFit, QuantityFit, SpecimenFit
from sinew.tasks.calibrate.settings import Settings
from sinew.tasks.data.noise import Noise, noise_of
from sinew.tasks.fitting.bayesian import Search
from sinew.tasks.fitting.fits import (
    BestFit,
    FitSession,
    best_apart,
    jacobians_at,
    polished,
    search,
    uncertainty,
    weighing_of,
)
from sinew.tasks.model import FORCE, Model
from sinew.tasks.model.parameters import from_unit
from sinew.tasks.simulate import Array
from sinew.tasks.simulate.evaluation import SpecimenEvaluation
from sinew.tasks.study.checkpoint import Checkpoint

ON_BOUND = 1e-3  # of a parameter's range
DETERMINED = 0.25  # of a parameter's range; a uniform distribution over it has a standard deviation of 0.29
CONFOUNDED = 0.95  # correlation of the errors of two parameters
OVERFITTED = 0.8  # of the estimated noise: a fit that leaves less than this shows that the estimate was wrong


@dataclass(frozen=True)
class Fits:
    """The best point of each method for one specimen, the Bayesian search, and the derivatives at the best fit."""

    methods: Mapping[str, BestFit]
    search: Search | None
    jacobians: tuple[Array, ...]

    @property
    def best(self) -> str:
        """The method with the lowest total objective."""
        return min(self.methods, key=lambda name: self.methods[name].total)


def most_evaluations(settings: Settings, size: int) -> int:
    """How many evaluations a specimen takes at the most; ``size`` is the number of free parameters."""
    bayesian = settings.bayesian.evaluations if SEARCHES & set(settings.methods) else 0
    polish = max(0, settings.evaluations - settings.bayesian.evaluations) if "hybrid" in settings.methods else 0
    least_squares = settings.evaluations if "least_squares" in settings.methods else 0
    return bayesian + polish + least_squares + size + 1


def calibrated(
    session: FitSession, settings: Settings, seeds: Search, seed: tuple[int, ...], checkpoint: Checkpoint
) -> Fits | None:
    """Fit one specimen by each method. None when the model fails at every start.

    ``seeds`` are evaluations that the surrogate knows from the start; ``checkpoint`` keeps the proposed points.
    """
    fits: dict[str, BestFit | None] = {}
    evaluated = None
    if SEARCHES & set(settings.methods):
        bo = settings.bayesian
        budget = min(bo.evaluations, settings.evaluations)
        evaluated, fits["bayesian"] = search(
            session,
            budget=budget,
            initial=bo.initial,
            pending=bo.pending,
            seeds=seeds,
            seed=seed,
            checkpoint=checkpoint,
        )
    if "hybrid" in settings.methods and evaluated is not None:
        left = settings.evaluations - len(evaluated.totals)
        fits["hybrid"] = polished(session, best_apart(evaluated), left, settings.starts, before=fits["bayesian"])
    if "least_squares" in settings.methods:
        rng = np.random.default_rng((*seed, 1))
        starts = [np.full(session.size, 0.5), *rng.random((settings.starts - 1, session.size))]
        fits["least_squares"] = polished(session, starts, settings.evaluations, settings.starts)
    methods: dict[str, BestFit] = {n: fit for n, fit in fits.items() if fit is not None and n in settings.methods}
    if not methods:
        return None
    best = min(methods.values(), key=lambda fit: fit.total)
    return Fits(methods, evaluated, jacobians_at(session, best.at))


def specimen_fit(model: Model, evaluation: SpecimenEvaluation, fits: Fits, settings: Settings) -> SpecimenFit:
    """The best of the fits: its parameters, how far it is above the noise, and how well each parameter is known."""
    best, specimen = fits.methods[fits.best], evaluation.specimen
    free = [parameter.name for parameter in model.free]
    values = from_unit(model, best.at[np.newaxis])[0]
    noise = [noise_of(curve, specimen.curves) for curve in specimen.curves]
    inflation = [each.inflation for each in noise]
    for name in specimen.others:
        along = [curve.of(name) for curve in specimen.curves]
        inflation += [noise_of(curve, along).inflation for curve in along]
    sd, correlation = uncertainty(fits.jacobians, best.objective, weighing_of(evaluation), inflation)
    forces = best.objective[: len(specimen.curves)] * specimen.noise.get(FORCE, 1.0)
    total = float(forces.sum())
    noise_N = noise_floor(noise, total)
    floor = noise_N
    if evaluation.several:  # each RMSE is in multiples of its noise
        floor = float(best.objective.size) if best.total >= OVERFITTED * best.objective.size else None
    compared_at = sorted({settings.bayesian.evaluations, settings.evaluations})
    return SpecimenFit(
        site=specimen.site,
        donor=specimen.donor,
        parameters=dict(zip(model.names, values, strict=True)),
        rmse_N=dict(zip([curve.name for curve in specimen.curves], forces, strict=True)),
        peak_N={curve.name: float(np.abs(curve.force_N).max()) for curve in specimen.curves},
        r2={curve.name: explained(curve.force_N, rmse) for curve, rmse in zip(specimen.curves, forces, strict=True)},
        total_N=total,
        noise_N=noise_N,
        above_noise=above_noise(best.total, floor),
        method=fits.best,
        on_bound=[name for name, at in zip(free, best.at, strict=True) if min(at, 1 - at) < ON_BOUND],
        sd_of_range=dict(zip(free, sd, strict=True)),
        determined=[name for name, value in zip(free, sd, strict=True) if value < DETERMINED],
        confounded=confounded(free, sd, correlation),
        methods={name: _method_fit(fit, floor, compared_at) for name, fit in fits.methods.items()},
        objective=best.total if evaluation.several else None,
        quantities=_quantities(evaluation, best.objective) if evaluation.several else None,
    )


def _quantities(evaluation: SpecimenEvaluation, objective: Array) -> dict[str, QuantityFit]:
    """Each quantity that is compared, from the parts ``[s]`` of the objective at the best fit."""
    found = {}
    for name, unit in evaluation.units().items():
        own = [(one, part * one.level) for one, part in zip(evaluation.series(), objective, strict=True)]
        own = [(one, rmse) for one, rmse in own if one.output == name]
        rmse = {one.protocol: float(error) for one, error in own}
        r2 = {one.protocol: explained(one.values[one.there], float(error)) for one, error in own}
        found[name] = QuantityFit(unit, evaluation.specimen.noise[name], rmse, r2)
    return found


def explained(force_N: Array, rmse_N: float) -> float | None:
    """R2, the share of the variance of a measured force ``[t]`` that a model with this error explains.

    None where the force is constant.
    """
    variance = float(np.var(force_N))
    return 1.0 - rmse_N**2 / variance if variance > 0 else None


def _method_fit(fit: BestFit, floor: float | None, compared_at: Sequence[int]) -> MethodFit:
    return MethodFit(
        total_N=fit.total,
        above_noise=above_noise(fit.total, floor),
        evaluations=fit.trace[-1][0],
        converged=fit.converged,
        starts=fit.starts,
        above_noise_after={str(count): above_noise(fit.total_after(count), floor) for count in compared_at},
        trace=list(fit.trace),
    )


def confounded(names: Sequence[str], sd: Array, correlation: Array) -> list[ConfoundedPair]:
    """The pairs of determined parameters whose errors correlate nearly wholly.

    ``sd`` ``[d]`` are parts of each range, ``correlation`` is ``[d, d]``.
    """
    return [
        ConfoundedPair([names[i], names[j]], correlation[i, j])
        for i in range(len(names))
        for j in range(i)
        if sd[i] < DETERMINED and sd[j] < DETERMINED and abs(correlation[i, j]) > CONFOUNDED
    ]


def noise_floor(noise: Sequence[Noise], total: float) -> float | None:
    """The objective (N) that noise alone would leave; None where the curves do not show their noise.

    What a model follows is no noise: a ``total`` (N) far below the estimate shows that the estimate is wrong.
    """
    floor = float(sum(each.sd_N for each in noise))
    return floor if total >= OVERFITTED * floor else None  # an unknown noise is NaN, and not below anything


def above_noise(total: float | None, floor: float | None) -> float | None:
    """How far a total objective (N) is above the noise, as a part of the noise."""
    return total / floor - 1.0 if total is not None and floor else None
