"""Posterior of the parameters of each site by approximate Bayesian computation (ABC-SMC, pyABC), as in Pekedis (2025).

One parameter set is compared with all specimens of a site. Stores: a row for every evaluation, ``infer/SITE`` with all
generations. Leaves ``infer.json``, ``infer.csv`` (as table 3 of the paper), ``infer/SITE.db`` (pyABC's own history) and
``infer/SITE.nc`` (ArviZ). All sites share the cluster. A run that was interrupted asks again for what it had asked for,
finds it in the store, and goes on.
"""

import csv
import io
import logging
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import pyabc
import xarray as xr
from pyabc.sampler import Sampler

from runner.ensemble import Desk, Talk
from tasks.history import IN_MEMORY, close, keep
from tasks.model import Model, Specimen
from tasks.observations import SiteEvaluation, observed, root_mean_square
from tasks.priors import Alike, Normals, calibrated
from tasks.problems import BadInput
from tasks.sampler import Generation, StoredModel, StoreSampler
from tasks.simulate import Array
from tasks.stock_sampler import DirectModel, SimulationFailed, stock_sampler
from tasks.study import InferSettings
from tasks.transitions import DefensiveNormal
from tasks.workspace import Workspace, digest, read_result, write_json, write_text

DRAWS = 1000  # of equal weight, for those who do not know of weights
INTERVAL = 0.95


def infer(workspace: Workspace) -> dict[str, Any]:
    """Posterior by site. Returns ``infer.json``.

    Raises :class:`BadInput` when there is no calibration to take priors from, or no draw came within ``epsilon``.
    """
    settings = workspace.study.infer
    calibration = read_result(workspace.out / "calibrate.json")
    if calibration is None:
        raise BadInput(workspace.out / "calibrate.json", "is not there", "`sinew calibrate` on this study first")
    sites = by_site(workspace.specimens(settings.specimens, "infer.specimens"))
    evaluations = {site: _evaluation(workspace, site, members) for site, members in sites.items()}
    priors = {site: _prior(workspace, members, calibration) for site, members in sites.items()}
    inputs = digest(settings.model_dump(), workspace.seed, [e.table().key for e in evaluations.values()],
                    [[p.mean.tolist(), p.sd.tolist()] for p in priors.values()])  # fmt: skip
    previous = read_result(workspace.out / "infer.json")
    if previous is not None and previous.get("inputs") == inputs:
        return previous
    problems = [_Problem(workspace, site, evaluations[site], priors[site]) for site in sites]
    infer_all = _on_the_store if settings.sampler == "store" else _by_the_stock_sampler
    done = dict(zip(sites, infer_all(workspace, problems), strict=True))
    result: dict[str, Any] = {
        "sampler": settings.sampler,
        "names": [parameter.name for parameter in workspace.model.free],
        "units": [parameter.unit for parameter in workspace.model.free],
        "meanings": [parameter.description for parameter in workspace.model.free],
        "population": settings.population,
        "interval": INTERVAL,
        "sites": {site: _told(workspace, sites[site], priors[site], found) for site, found in done.items()},
        "inputs": inputs,
    }
    write_text(workspace.out / "infer.csv", _as_csv(result))
    write_json(workspace.out / "infer.json", result)
    return result


def site_of(specimen: Specimen) -> str:
    """What a specimen's site is called in results."""
    return specimen.site or "all"


def by_site(specimens: tuple[Specimen, ...]) -> dict[str, tuple[Specimen, ...]]:
    """Specimens by site; those without one are ``all``."""
    sites: dict[str, list[Specimen]] = {}
    for specimen in specimens:
        sites.setdefault(site_of(specimen), []).append(specimen)
    return {site: tuple(members) for site, members in sites.items()}


def _evaluation(workspace: Workspace, site: str, members: tuple[Specimen, ...]) -> SiteEvaluation:
    settings = workspace.study.infer
    protocols = None if settings.protocols == "all" else tuple(settings.protocols)
    cut = tuple(observed(specimen, protocols, tuple(settings.single_cycle)) for specimen in members)
    missing = [specimen.name for specimen in cut if not specimen.curves]
    if missing:
        raise BadInput(
            f"{workspace.study.path}: infer.protocols", f"no curve of {missing[0]} is among them", "protocols it has"
        )
    return SiteEvaluation(workspace.model, cut, workspace.simulator, workspace.study.store.points_per_curve, site)


def _prior(workspace: Workspace, members: tuple[Specimen, ...], calibration: dict[str, Any]) -> Normals:
    free = workspace.model.free
    found = calibration["specimens"]
    missing = [specimen.name for specimen in members if specimen.name not in found]
    if missing:
        raise BadInput(
            workspace.out / "calibrate.json", f"{missing[0]} is not calibrated", "`sinew calibrate` with this specimen"
        )
    values = [[found[specimen.name]["parameters"][p.name] for p in free] for specimen in members]
    return calibrated(free, np.array(values, dtype=float), workspace.study.infer.widening)


@dataclass(frozen=True)
class _Inferred:
    particles: xr.Dataset
    generations: list[Generation]
    weights: dict[str, list[float]]  # of an adaptive distance, by generation


class _Problem:
    """The inference of one site: distance, prior and data for pyABC, whoever samples."""

    def __init__(self, workspace: Workspace, site: str, evaluation: SiteEvaluation, prior: Normals) -> None:
        self.study = workspace.study
        self.note = partial(workspace.note, "infer", site)
        self.evaluation = evaluation
        self.prior = prior
        self.row = partial(_row, workspace.model, prior.names)
        self.distance, self.describe, self.data = _distance(self.study.infer, evaluation)
        self.database = workspace.out / "infer" / f"{site}.db"

    def _tell(self, threshold: Callable[[int], float], t: int, took: Generation) -> None:
        """Tell those who look on which generation this is, and its threshold."""
        if t < 0:
            self.note(f"learning the distance: {took.judged:,} draws")
            return
        settings, epsilon = self.study.infer, float(threshold(t))
        self.note(
            f"generation {t + 1} of at most {settings.generations}, threshold {epsilon:.4g}: "
            f"{took.accepted} of {settings.population} accepted, {took.judged:,} judged",
            generation=int(t) + 1, value=epsilon, accepted=took.accepted, judged=took.judged,
        )  # fmt: skip

    def run(self, model: pyabc.Model, sampler: Sampler) -> tuple[xr.Dataset, dict[str, list[float]]] | None:
        """The particles of all generations, and the weights of the distance; None when not even the first is full."""
        settings = self.study.infer
        relative = settings.distance == "relative"
        abc = pyabc.ABCSMC(
            model,
            self.prior,
            self.distance,
            model_prior=Alike(1),
            transitions=DefensiveNormal(self.prior),
            population_size=settings.population,
            eps=pyabc.QuantileEpsilon(
                initial_epsilon=settings.epsilon if relative else "from_sample", alpha=settings.quantile
            ),
            sampler=sampler,
        )
        if isinstance(sampler, StoreSampler):
            sampler.tell = partial(self._tell, abc.eps)
        history = abc.new(IN_MEMORY, self.data)
        try:
            abc.run(
                minimum_epsilon=settings.smallest_epsilon,
                max_nr_populations=settings.generations,
                min_acceptance_rate=settings.smallest_acceptance,
            )
            if history.n_populations == 0:
                return None
            self.database.parent.mkdir(exist_ok=True)
            keep(history, self.database)
            weights = getattr(self.distance, "scale_weights", None) or {}
            told = {str(t): np.asarray(w).tolist() for t, w in weights.items() if 0 <= t <= history.max_t}
            return _particles(history, self.prior.names), told
        finally:
            close(history)


def _row(model: Model, names: tuple[str, ...], values: Array) -> Array:
    full: Array = model.full(names, values[np.newaxis])[0]
    return full


def _on_the_store(workspace: Workspace, problems: Sequence[_Problem]) -> list[_Inferred]:
    """All sites at once."""
    settings = workspace.study.infer
    talks = []
    for number, problem in enumerate(problems):
        table, _ = workspace.plan(problem.evaluation, np.empty((0, len(workspace.model.names))))
        work = partial(_talk, problem, (workspace.seed, 5, number))
        talks.append(Talk([(table, problem.evaluation)], settings.generations * settings.population * 10, work))
    return workspace.converse(talks, "infer")


def _talk(problem: _Problem, seed: tuple[int, ...], desk: Desk) -> _Inferred:
    settings = problem.study.infer
    sampler = StoreSampler(desk, seed, settings.pending)
    title = problem.evaluation.title
    found = problem.run(StoredModel(title, problem.prior.names, row=problem.row, describe=problem.describe), sampler)
    if found is None:
        last = sampler.generations[-1]
        raise BadInput(
            f"{problem.study.path}: infer.epsilon",
            f"of {last.judged:,} draws for {title} {last.accepted} came within {settings.epsilon:g}, "
            f"the closest was at {last.closest:.3g}, {last.failed} failed",
            "a larger epsilon, or another prior",
        )
    return _Inferred(found[0], sampler.generations, found[1])


def _by_the_stock_sampler(workspace: Workspace, problems: Sequence[_Problem]) -> list[_Inferred]:
    """One site after the other: pyABC's sampler mixes up what runs on one scheduler at the same time."""
    done = []
    for problem in problems:
        model = DirectModel(
            problem.evaluation.title, problem.prior.names, problem.evaluation, problem.row, problem.describe
        )
        sampler = stock_sampler(workspace.client())
        try:
            found = problem.run(model, sampler)
        except SimulationFailed as failed:
            raise BadInput(
                f"{workspace.study.path}: infer.sampler", f"a simulation failed ({failed}), and dask ends", "store"
            ) from None
        assert found is not None, "it draws until a generation is full"
        done.append(_Inferred(found[0], sampler.generations, found[1]))
    return done


def _distance(
    settings: InferSettings, evaluation: SiteEvaluation
) -> tuple[Any, Callable[[Mapping[str, Array]], dict[str, Any]], dict[str, Any]]:
    """PyABC's distance, the summary statistics of an outcome, and those of the measurements."""
    curves = evaluation.curves()
    if settings.distance == "relative":
        return (
            relative_distance,
            lambda values: {"relative_error": values["relative_error"]},
            {"relative_error": np.zeros(len(curves))},
        )
    of, measured = evaluation.points()
    scale = np.array([root_mean_square(curve.force_N) for _, curve in curves])[of]

    def describe(values: Mapping[str, Array]) -> dict[str, Any]:
        return {"force": values["force"] / scale}

    return pyabc.AdaptivePNormDistance(p=2), describe, {"force": measured / scale}


def relative_distance(x: Mapping[str, Array], observed: Mapping[str, Array]) -> float:
    """Root mean square over curves of their relative errors: every curve counts the same, however long it is."""
    return float(np.sqrt(np.mean(np.square(x["relative_error"]))))


def _particles(history: pyabc.History, names: tuple[str, ...]) -> xr.Dataset:
    """Every generation: parameters, weights (their sum is 1) and distances of its particles."""
    parameters, weights, distances, thresholds = [], [], [], []
    populations = history.get_all_populations().set_index("t")
    for t in range(history.max_t + 1):
        frame, weight = history.get_distribution(m=0, t=t)
        parameters.append(frame[list(names)].to_numpy())
        weights.append(weight / weight.sum())
        distances.append(history.get_weighted_distances(t=t)["distance"].to_numpy())
        thresholds.append(float(populations.loc[t, "epsilon"]))
    return xr.Dataset(
        {
            "parameters": (("generation", "particle", "parameter"), np.array(parameters)),
            "weight": (("generation", "particle"), np.array(weights)),
            "distance": (("generation", "particle"), np.array(distances)),
            "epsilon": ("generation", np.array(thresholds)),
        },
        coords={"parameter": list(names)},
    )


def draws(particles: xr.Dataset, count: int, seed: tuple[int, ...]) -> Array:
    """Draws ``[count, d]`` of equal weight from the last generation, by systematic resampling, in random order."""
    rng = np.random.default_rng(seed)
    weight = particles["weight"].values[-1]
    places = (np.arange(count) + rng.random()) / count
    chosen = np.minimum(np.searchsorted(np.cumsum(weight), places), weight.size - 1)
    values: Array = particles["parameters"].values[-1][rng.permutation(chosen)]
    return values


def _arviz() -> Any:
    """ArviZ, which says each time that it will change."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", r"[\s\S]*ArviZ is undergoing a major refactor", FutureWarning)
        import arviz
    return arviz


def _told(workspace: Workspace, members: tuple[Specimen, ...], prior: Normals, found: _Inferred) -> dict[str, Any]:
    site = site_of(members[0])
    workspace.store.write_result(f"infer/{site}", found.particles)
    sample = draws(found.particles, DRAWS, (workspace.seed, 6))
    units = {parameter.name: parameter.unit for parameter in workspace.model.free}
    posterior = {name: sample[np.newaxis, :, j] for j, name in enumerate(prior.names)}
    arviz = _arviz()
    data = arviz.from_dict(posterior=posterior, posterior_attrs={"units": str(units), "site": site})
    data.to_netcdf(str(workspace.out / "infer" / f"{site}.nc"), engine="h5netcdf")
    weight = found.particles["weight"].values[-1]
    mean = weight @ found.particles["parameters"].values[-1]
    sd = np.sqrt(weight @ (found.particles["parameters"].values[-1] - mean) ** 2)
    hdi = np.array([arviz.hdi(sample[:, j], hdi_prob=INTERVAL) for j in range(len(prior.names))])
    whole = range(found.particles.sizes["generation"])  # what was drawn to learn from, or given up, has no particles
    return {
        "specimens": [specimen.name for specimen in members],
        "parameters": {
            name: {
                "mean": mean[j],
                "sd": sd[j],
                "hdi": hdi[j],
                "prior_mean": prior.mean[j],
                "prior_sd": prior.sd[j],
            }
            for j, name in enumerate(prior.names)
        },
        "effective_sample_size": float(1.0 / np.sum(weight**2)),
        "epsilon": found.particles["epsilon"].values,
        "distance": {"smallest": found.particles["distance"].values[-1].min()},
        "distance_weights": found.weights,
        "generations": [
            {"judged": g.judged, "accepted": g.accepted, "failed": g.failed, "asked": g.asked}
            for g in found.generations
            if g.t in whole
        ],
    }


def _as_csv(result: dict[str, Any]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    columns = ("mean", "sd", "hdi_low", "hdi_high")
    writer.writerow(["parameter", "unit", *(f"{site}_{column}" for site in result["sites"] for column in columns)])
    for name, unit in zip(result["names"], result["units"], strict=True):
        cells: list[str] = []
        for told in result["sites"].values():
            found = told["parameters"][name]
            cells += [f"{value:.6g}" for value in (found["mean"], found["sd"], *found["hdi"])]
        writer.writerow([name, unit, *cells])
    return text.getvalue()


logging.getLogger("ABC").setLevel(logging.ERROR)  # its progress is told by a bar; weights need not be near one
