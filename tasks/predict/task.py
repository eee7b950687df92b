"""Forces that the posterior of a site predicts for each of its specimens: plan, evaluate, make bands, commit.

Every specimen is simulated with its own geometry and all of its displacement histories. The store keeps
``predict/SITE``.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
import xarray as xr

from sinew.runner.errors import BadInput
from sinew.runner.evaluation.adaptive import AdaptiveRun, Session
from sinew.runner.evaluation.ensemble import failures
from sinew.runner.store.table import Table
from sinew.tasks.calibrate.result import CalibrateResult, SpecimenFit
from sinew.tasks.data.sites import by_site, site_of
from sinew.tasks.drawing.blocks import plural
from sinew.tasks.infer.reading import draws_of, posteriors_of
from sinew.tasks.infer.result import (
    AbcResult,
    InferResult,
    LikelihoodResult,
    Posteriors,
    draws,
    draws_of_new,
    draws_of_specimen,
)
from sinew.tasks.model import FORCE, Specimen
from sinew.tasks.predict.method import FEWEST, Band, bands_of, coverage, noise_level, typical
from sinew.tasks.predict.result import (
    SIMULATED,
    PredictResult,
    QuantityPrediction,
    SitePrediction,
    bands_group,
    of_quantity,
)
from sinew.tasks.predict.settings import Settings, fewest_of_new
from sinew.tasks.simulate import Array
from sinew.tasks.simulate.evaluation import SpecimenEvaluation, kept_points
from sinew.tasks.simulate.retrying import simulate_patiently
from sinew.tasks.study import streams
from sinew.tasks.study.cached import cached, commit, key
from sinew.tasks.study.result import believed
from sinew.tasks.study.same_data import refuse_other_data
from sinew.tasks.study.streams import Stream
from sinew.tasks.study.workspace import Workspace


@dataclass(frozen=True, eq=False)
class Rows:
    """Full parameter sets ``[n, d]`` that are simulated for one specimen, by the band that they are for."""

    hdi: Array
    draws: Array
    new: Array

    @property
    def all(self) -> Array:
        return np.concatenate([self.hdi, self.draws, self.new])

    def split(self, values: Array) -> dict[str, Array]:
        """``values`` ``[n, ...]`` of all rows, by band."""
        ends = np.cumsum([len(self.hdi), len(self.draws)])
        return dict(zip(SIMULATED, np.split(values, ends), strict=True))


@dataclass(frozen=True, eq=False)
class Planned:
    """The simulations of one specimen: ``rows``, and their places ``at`` in the store's table."""

    evaluation: SpecimenEvaluation
    rows: Rows
    table: Table
    at: Array

    @property
    def specimen(self) -> Specimen:
        return self.evaluation.specimen


@dataclass(frozen=True, eq=False)
class CurvePoints:
    """Kept points of several curves, one after the other, with labels and arrays."""

    labels: dict[str, list[Any]] = field(default_factory=dict)  # one item for each curve
    sizes: list[int] = field(default_factory=list)
    arrays: dict[str, list[Array]] = field(default_factory=dict)

    def add(self, size: int, labels: dict[str, Any], arrays: dict[str, Array]) -> None:
        """Append a curve of ``size`` points."""
        self.sizes.append(size)
        for into, items in ((self.labels, labels), (self.arrays, arrays)):
            for name, item in items.items():
                into.setdefault(name, []).append(item)

    def dataset(self, dim: str, unit: str, prefix: str = "") -> xr.Dataset:
        """All points along ``dim``; ``unit`` is that of the bands."""
        units = {"time": "s", "displacement": "mm"}
        variables = {
            f"{prefix}{name}": (dim, np.concatenate(parts), {"units": units.get(name, unit)})
            for name, parts in self.arrays.items()
        }
        labels = {f"{prefix}{name}": (dim, np.repeat(items, self.sizes)) for name, items in self.labels.items()}
        return xr.Dataset(variables, labels)


def run(workspace: Workspace, settings: Settings) -> PredictResult:
    """Bands of the force for every specimen, their coverage, and bands of the stresses by site.

    Raises :class:`BadInput` when there is no inference, or when it was of another model.
    """
    inferred = _posteriors(workspace)
    sites = _planned(workspace, settings, inferred)
    every = [one for planned in sites.values() for one in planned]
    _evaluate(workspace, every)
    if all((one.table.status[one.at] > 0).all() for one in every):
        problem = "every simulation with its parameters failed (`sinew status` tells why)"
        raise BadInput(InferResult.path(workspace.out), problem, "posteriors within the study's ranges")
    inputs = key(
        PredictResult,
        settings.model_dump(),
        {site: [one.specimen.name for one in planned] for site, planned in sites.items()},
        [one.table.key for one in every],
        *(one.rows.all for one in every),
        *(one.table.status[one.at] for one in every),
    )
    arrays = [bands_group(site) for site in sites]
    if (known := cached(workspace, PredictResult, inputs, arrays)) is not None:
        return known
    of_population = isinstance(inferred, LikelihoodResult)
    predicted = [
        _site(workspace, planned, settings.probability, from_population=of_population) for planned in sites.values()
    ]
    forces = [_only(dataset, "point") for _, dataset in predicted]
    result = PredictResult(
        probability=settings.probability,
        draws=settings.draws,
        rows=sum(len(one.rows.all) for one in every),
        failed=sum(int((one.table.status[one.at] > 0).sum()) for one in every),
        sites={site: found for site, (found, _) in zip(sites, predicted, strict=True)},
        coverage=coverage(xr.concat(forces, "point")),
        inputs=inputs,
        others=_others_of([dataset for _, dataset in predicted], every[0].evaluation),
        from_population=of_population,
    )
    commit(workspace, result, {name: dataset for name, (_, dataset) in zip(arrays, predicted, strict=True)})
    return result


def _posteriors(workspace: Workspace) -> Posteriors:
    """What was inferred, of this model and with the specimens of each site."""
    path = InferResult.path(workspace.out)
    inferred = posteriors_of(workspace)
    names = tuple(parameter.name for parameter in workspace.model.free)
    if tuple(inferred.names) != names:
        problem = f"is of the parameters {', '.join(inferred.names)}"
        raise BadInput(path, problem, f"{', '.join(names)} (`sinew infer` again)")
    return inferred


def _planned(workspace: Workspace, settings: Settings, inferred: Posteriors) -> dict[str, list[Planned]]:
    """The simulations of each specimen by site, from the posterior and the calibration."""
    path = InferResult.path(workspace.out)
    by_likelihood = isinstance(inferred, LikelihoodResult)
    calibration = None if by_likelihood else CalibrateResult.read(workspace.out)
    calibrated = isinstance(inferred, AbcResult) and inferred.priors != "ranges"
    if calibration is None and calibrated:
        raise BadInput(CalibrateResult.path(workspace.out), "is not there", "`sinew calibrate` on this study first")
    members = [name for posterior in inferred.sites.values() for name in posterior.specimens]
    if calibration is not None:
        calibrated_ones = workspace.cohort.choose(
            [name for name in members if name in calibration.specimens], str(path)
        )
        again = "`sinew calibrate` again"
        refuse_other_data(workspace, calibration.path(workspace.out), calibration.data, calibrated_ones, again)
    planned: dict[str, list[Planned]] = {}
    for number, (site, specimens) in enumerate(by_site(workspace.cohort.choose(members, str(path))).items()):
        seed = streams.key(workspace.seed, Stream.PREDICTION, number)
        planned[site] = []
        with believed(path):
            kept = draws_of(workspace, inferred, site)
        for one in specimens:
            with believed(path):
                rows = _rows(workspace, inferred, kept, calibration, specimens, one, settings, seed)
            evaluation = workspace.evaluation(one)
            planned[site].append(Planned(evaluation, rows, *workspace.plan(evaluation, rows.all)))
    return planned


def _rows(
    workspace: Workspace,
    inferred: Posteriors,
    kept: xr.Dataset,
    calibration: CalibrateResult | None,
    specimens: Sequence[Specimen],
    specimen: Specimen,
    settings: Settings,
    seed: tuple[int, ...],
) -> Rows:
    """The simulations of one of the ``specimens`` of a site: draws of a posterior, and those of a new one.

    ABC has one posterior for all specimens of a site, and a new one is like the others' calibrations. By likelihood,
    each specimen has its own posterior, and a new one is drawn from the population.
    """
    site = site_of(specimen)
    marginals = [inferred.sites[site].parameters[name] for name in inferred.names]
    three = np.array([[each.mean, *each.hdi] for each in marginals], dtype=float).T
    full = partial(workspace.model.full, tuple(inferred.names))
    if isinstance(inferred, LikelihoodResult):
        varied = tuple(str(name) for name in kept["parameter"].values)
        full_varied = partial(workspace.model.full, varied)
        own = draws_of_specimen(kept, specimen.name, settings.draws, seed)
        new = draws_of_new(kept, settings.of_new(quick=workspace.simulator.capabilities.quick), seed)
        return Rows(full(three), full_varied(own), full_varied(new))
    drawn = draws(kept.sel(parameter=inferred.names), settings.draws, seed)
    if calibration is None:
        return Rows(full(three), full(drawn), np.empty((0, len(workspace.model.names))))
    with believed(CalibrateResult.path(workspace.out)):
        return Rows(full(three), full(drawn), _others(workspace, calibration.specimens, specimens, specimen))


def _others(
    workspace: Workspace, calibrated: Mapping[str, SpecimenFit], specimens: Sequence[Specimen], specimen: Specimen
) -> Array:
    """Calibrated parameters ``[n - 1, d]`` of the other specimens; none where they are too few."""
    others = [one.name for one in specimens if one.name != specimen.name]
    missing = [name for name in others if name not in calibrated]
    if missing:
        raise BadInput(
            CalibrateResult.path(workspace.out), f"{missing[0]} is not calibrated", "`sinew calibrate` with it"
        )
    names = list(workspace.model.names)
    chosen = others if len(specimens) >= FEWEST else []
    rows = [calibrated[name].values(names) for name in chosen]
    return np.array(rows, dtype=float).reshape(-1, len(names))


def _evaluate(workspace: Workspace, every: Sequence[Planned]) -> None:
    """Evaluate all rows: all specimens at once, unless that takes less time than starting a cluster."""
    if workspace.simulator.capabilities.quick:
        for one in every:
            title = f"predict {one.specimen.name}"
            workspace.evaluate(one.evaluation, one.table, one.at, title, here=True, brief=True)
        return
    runs = [
        AdaptiveRun([(one.table, one.evaluation)], pending.size, _ask_all(one.table.parameters(pending)))
        for one in every
        if (pending := one.table.pending(np.unique(one.at))).size
    ]
    if runs:
        workspace.run_adaptive(runs, "predict")


def _ask_all(parameters: Array) -> Callable[[Session], None]:
    def work(session: Session) -> None:
        session.ask_all(parameters)

    return work


def _site(
    workspace: Workspace, planned: Sequence[Planned], probability: float, *, from_population: bool
) -> tuple[SitePrediction, xr.Dataset]:
    """The bands of one site and what they cover."""
    specimens = [one.specimen for one in planned]
    bands = partial(bands_of, probability=probability, from_population=from_population)
    points = _points(workspace, planned, bands, from_population=from_population)
    units = planned[0].evaluation.units()
    others = {
        name: _points(workspace, planned, bands, name, from_population=from_population)
        for name in units
        if name != FORCE
    }
    shown = typical(specimens)
    stresses, no_stresses = _stresses(workspace, planned[specimens.index(shown)], bands)
    beside = [each.dataset(f"{name}_point", units[name], f"{name}_") for name, each in others.items()]
    dataset = xr.merge([points.dataset("point", "N"), stresses.dataset("stress_point", "MPa", "stress_"), *beside])
    prediction = SitePrediction(
        specimens=[one.name for one in specimens],
        failed={one.specimen.name: failures(one.table, one.at) for one in planned},
        no_new=_no_band_of_new(planned, probability, from_population=from_population),
        coverage=coverage(_only(dataset, "point")),
        typical=shown.name,
        stresses_of=shown.name if no_stresses is None else None,
        no_stresses=no_stresses,
        others=_others_of([dataset], planned[0].evaluation),
    )
    return prediction, dataset


def _no_band_of_new(planned: Sequence[Planned], probability: float, *, from_population: bool) -> str | None:
    """Why there is no band for a new specimen; None where there is one."""
    if from_population:
        ran = min(int((one.rows.split(one.table.status[one.at])["new"] == 0).sum()) for one in planned)
        fewest = fewest_of_new(probability)
        words = (
            f"{plural(ran, 'simulation')} of a new specimen; a band of {100 * probability:g} % needs {fewest} or more"
        )
        return None if ran >= fewest else f"{words} (predict.new)"
    if all(len(one.rows.new) for one in planned):
        return None
    if len(planned) < FEWEST:
        return f"{plural(len(planned), 'specimen')}; a band for a new one needs {FEWEST} or more"
    return "no calibration, from which a band for a new specimen is made after ABC (`sinew calibrate`)"


def _only(dataset: xr.Dataset, dim: str) -> xr.Dataset:
    """What a dataset holds along ``dim``, and nothing else."""
    return dataset.drop_dims([str(each) for each in dataset.dims if each != dim])


def _others_of(datasets: Sequence[xr.Dataset], evaluation: SpecimenEvaluation) -> dict[str, QuantityPrediction] | None:
    """Coverage of the quantities beside the force; None where there are none."""
    units = {name: unit for name, unit in evaluation.units().items() if name != FORCE}
    found = {}
    for name, unit in units.items():
        points = xr.concat([of_quantity(dataset, name) for dataset in datasets], "point")
        found[name] = QuantityPrediction(unit, coverage(points))
    return found or None


def _points(
    workspace: Workspace,
    planned: Sequence[Planned],
    bands: Callable[..., dict[str, Band | None]],
    quantity: str = FORCE,
    *,
    from_population: bool,
) -> CurvePoints:
    """What was measured of a quantity, and its bands, at the kept points of every curve of a site, in its unit.

    A new specimen of a population has the noise of all of them, one that is like the others' calibrations that of the
    others.
    """
    points = CurvePoints()
    specimens = [one.specimen for one in planned]
    for one in planned:
        ok = one.rows.split(one.table.status[one.at] == 0)
        for curve in one.specimen.curves:
            keep = kept_points(curve.protocol, workspace.study.store.points_per_curve)
            field = next(
                each.field for each in one.evaluation.series() if (each.output, each.protocol) == (quantity, curve.name)
            )
            force = one.rows.split(one.table.read(field, one.at))
            of = [each for each in specimens if from_population or each.name != one.specimen.name]
            noise = noise_level(of, curve.name, quantity)
            found = bands({name: force[name][ok[name]] for name in SIMULATED}, noise)
            arrays = {
                "time": curve.protocol.time_s[keep],
                "displacement": curve.protocol.displacement_mm[keep],
                "measured": (curve.force_N if quantity == FORCE else curve.others[quantity])[keep],
                **_bounds(found, keep.size),
            }
            points.add(keep.size, {"specimen": one.specimen.name, "protocol": curve.name}, arrays)
    return points


def _bounds(bands: dict[str, Band | None], size: int, prefix: str = "") -> dict[str, Array]:
    """``NAME_low`` and ``NAME_high`` ``[t]`` of every band; NaN for one that is not given."""
    nothing = np.full(size, np.nan)
    named = {}
    for name, band in bands.items():
        for bound, values in zip(("low", "high"), band or (nothing, nothing), strict=True):
            named[f"{prefix}{name}_{bound}"] = values
    return named


def _stresses(
    workspace: Workspace, planned: Planned, bands: Callable[..., dict[str, Band | None]]
) -> tuple[CurvePoints, str | None]:
    """Bands of both constituents' second Piola-Kirchhoff stress (MPa) along a specimen's protocols, or why not.

    ``new`` comes from the other specimens' parameters as for forces, but without noise: nobody measures these stresses.
    """
    points = CurvePoints()
    if not workspace.simulator.capabilities.stresses:
        return points, f"the simulator {workspace.simulator.name} does not give the constituents' stresses"
    specimen, rows = planned.specimen, planned.rows
    for curve in specimen.curves:
        keep = kept_points(curve.protocol, workspace.study.store.points_per_curve)
        done = simulate_patiently(
            workspace.simulator, workspace.model, specimen, curve.protocol, rows.all,
            retries=workspace.study.retries, stresses=True,
        )  # fmt: skip
        assert done.matrix_MPa is not None
        assert done.fibre_MPa is not None
        ok = rows.split(done.status == 0)
        arrays = {"time": curve.protocol.time_s[keep], "displacement": curve.protocol.displacement_mm[keep]}
        for constituent, stress in (("matrix", done.matrix_MPa), ("fibre", done.fibre_MPa)):
            each = rows.split(stress[:, keep])
            found = bands({name: each[name][ok[name]] for name in SIMULATED}, 0.0)
            arrays |= _bounds(found, keep.size, f"{constituent}_")
        points.add(keep.size, {"specimen": specimen.name, "protocol": curve.name}, arrays)
    return points, None
