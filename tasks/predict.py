"""Forces that the posterior of a site predicts for each of its specimens, and how many measured points it covers.

Every specimen is simulated with its own geometry and all of its displacement histories. Three bands, at the kept
points:

- ``hdi``: from the lowest to the highest of three simulations, at the posterior mean and at the low and at the high
  bounds of the highest density intervals of all parameters (Pekedis 2025, first case);
- ``draws``: pointwise 95 % of 40 simulations with draws from the posterior (second case; both numbers are settings);
- ``new``: for a specimen that was not measured yet.

The first two are the paper's, and neither is about a single tendon. One parameter set for all specimens of a site is
one for their mean, and the more of them there are, the narrower its posterior: see what ``coverage`` says. The third
takes its spread from the specimens themselves: those of the site *but this one*, each with its calibrated parameters,
are simulated as if they had this one's geometry and displacements. With n - 1 such curves, the next one lies within
mean ± t sd sqrt(1 + 1 / (n - 1)), t with n - 2 degrees of freedom: the prediction interval of a normal sample (Geisser
1993, Predictive Inference). Stiffnesses scatter by factors rather than by newtons, and where a tendon is unloaded its
force changes sign, hence asinh: a logarithm for large forces, linear near zero. Noise, as the others' curves have it,
is added in squares. Nothing measured on the specimen itself enters but its geometry and displacements.

Leaves ``predict.json`` and the store results ``predict/SITE``.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import xarray as xr
from scipy.stats import norm
from scipy.stats import t as student

from runner.ensemble import Desk, Talk, failures
from tasks.evaluate import SpecimenEvaluation, kept_points
from tasks.infer import by_site, draws, site_of
from tasks.model import Specimen
from tasks.noise import noise_of
from tasks.problems import BadInput
from tasks.simulate import Array
from tasks.simulate.uniaxial import Uniaxial
from tasks.workspace import Workspace, digest, read_result, write_json

FEWEST = 4  # specimens of a site, for the band of a new one: of two others nothing is known of the spread
BENDS = 0.2  # of the largest force: where asinh turns from a line to a logarithm
BANDS = ("hdi", "draws", "new")
Band = tuple[Array, Array]


@dataclass(frozen=True, eq=False)
class _Rows:
    """Full parameter sets ``[n, d]`` that are simulated for one specimen, by what they are for."""

    hdi: Array
    draws: Array
    new: Array

    @property
    def all(self) -> Array:
        return np.concatenate([self.hdi, self.draws, self.new])

    def split(self, values: Array) -> dict[str, Array]:
        """``values`` ``[n, ...]`` of all rows, by what they are for."""
        ends = np.cumsum([len(self.hdi), len(self.draws)])
        return dict(zip(BANDS, np.split(values, ends), strict=True))


@dataclass(frozen=True, eq=False)
class _Points:
    """Kept points of curves, one after the other, and bands there."""

    labels: dict[str, list[Any]] = field(default_factory=dict)  # one item for each curve
    sizes: list[int] = field(default_factory=list)
    arrays: dict[str, list[Array]] = field(default_factory=dict)

    def add(self, size: int, labels: dict[str, Any], arrays: dict[str, Array]) -> None:
        self.sizes.append(size)
        for into, items in ((self.labels, labels), (self.arrays, arrays)):
            for name, item in items.items():
                into.setdefault(name, []).append(item)


def predict(workspace: Workspace) -> dict[str, Any]:
    """Bands of the force for every specimen, their coverage, and bands of the stresses by site.

    Returns ``predict.json``. Raises :class:`BadInput` when there is no inference, or when it was of another model.
    """
    settings = workspace.study.predict
    inferred, calibration = (_needed(workspace, task) for task in ("infer", "calibrate"))
    names = tuple(parameter.name for parameter in workspace.model.free)
    if tuple(inferred["names"]) != names:
        problem = f"is of the parameters {', '.join(inferred['names'])}"
        raise BadInput(workspace.out / "infer.json", problem, f"{', '.join(names)} (`sinew infer` again)")
    members = [name for told in inferred["sites"].values() for name in told["specimens"]]
    sites = by_site(workspace.cohort.choose(members, str(workspace.out / "infer.json")))
    planned = {
        site: [
            _rows(workspace, names, inferred["sites"][site], calibration, specimens, one, (workspace.seed, 7, number))
            for one in specimens
        ]
        for number, (site, specimens) in enumerate(sites.items())
    }
    evaluations = [workspace.evaluation(one) for specimens in sites.values() for one in specimens]
    rows = [each.all for site in sites for each in planned[site]]
    tables = [workspace.plan(evaluation, each) for evaluation, each in zip(evaluations, rows, strict=True)]
    _evaluate(workspace, evaluations, tables)
    inputs = digest(
        settings.model_dump(),
        [FEWEST, BENDS],
        {site: [one.name for one in specimens] for site, specimens in sites.items()},
        [table.key for table, _ in tables],
        *rows,
        *(table.status[at] for table, at in tables),
    )
    previous = read_result(workspace.out / "predict.json")
    if previous is not None and previous.get("inputs") == inputs and "predict" in workspace.store.root:
        return previous
    result: dict[str, Any] = {
        "probability": settings.probability,
        "draws": settings.draws,
        "rows": sum(len(each) for each in rows),
        "failed": sum(int((table.status[at] > 0).sum()) for table, at in tables),
        "sites": {},
    }
    every = []
    for site, specimens in sites.items():
        mine = [tables[[e.specimen.name for e in evaluations].index(one.name)] for one in specimens]
        points = _forces(workspace, specimens, planned[site], mine)
        typical = _typical(specimens)
        stresses, why_not = _stresses(workspace, typical, planned[site][specimens.index(typical)])
        dataset = xr.merge([_dataset(points, "point", "N"), _dataset(stresses, "stress_point", "MPa")])
        workspace.store.write_result(f"predict/{site}", dataset)
        result["sites"][site] = {
            "specimens": [one.name for one in specimens],
            "failed": {one.name: failures(table, at) for one, (table, at) in zip(specimens, mine, strict=True)},
            "no_new": _why_no_new(specimens),
            "coverage": coverage(dataset),
            "typical": typical.name,
            "stresses_of": typical.name if why_not is None else None,
            "no_stresses": why_not,
        }
        every.append(dataset.drop_dims("stress_point", errors="ignore"))
    result["coverage"] = coverage(xr.concat(every, "point"))
    result["inputs"] = inputs
    write_json(workspace.out / "predict.json", result)
    return result


def _needed(workspace: Workspace, task: str) -> dict[str, Any]:
    path = workspace.out / f"{task}.json"
    result = read_result(path)
    if result is None:
        raise BadInput(path, "is not there", f"`sinew {task}` on this study first")
    return result


def _rows(
    workspace: Workspace,
    names: tuple[str, ...],
    posterior: dict[str, Any],
    calibration: dict[str, Any],
    specimens: Sequence[Specimen],
    specimen: Specimen,
    seed: tuple[int, ...],
) -> _Rows:
    found = [posterior["parameters"][name] for name in names]
    three = np.array([[each["mean"], *each["hdi"]] for each in found], dtype=float).T
    particles = workspace.store.read_result(f"infer/{site_of(specimen)}")
    drawn = draws(particles.sel(parameter=list(names)), workspace.study.predict.draws, seed)
    others = [one.name for one in specimens if one.name != specimen.name]
    missing = [name for name in others if name not in calibration["specimens"]]
    if missing:
        raise BadInput(workspace.out / "calibrate.json", f"{missing[0]} is not calibrated", "`sinew calibrate` with it")
    if len(specimens) < FEWEST:
        others = []
    model = workspace.model
    calibrated = [[calibration["specimens"][name]["parameters"][each] for each in model.names] for name in others]
    return _Rows(
        model.full(names, three),
        model.full(names, drawn),
        np.array(calibrated, dtype=float).reshape(-1, len(model.names)),
    )


def _evaluate(workspace: Workspace, evaluations: list[SpecimenEvaluation], tables: list[tuple[Any, Array]]) -> None:
    """See to it that all rows have outcomes: all specimens at once, unless they take less time than a cluster."""
    if isinstance(workspace.simulator, Uniaxial):
        for evaluation, (table, at) in zip(evaluations, tables, strict=True):
            title = f"predict {evaluation.specimen.name}"
            workspace.evaluate(evaluation, table, at, title, here=True, brief=True)
        return
    talks = [
        Talk([(table, evaluation)], pending.size, _asking(table.parameters(pending)))
        for evaluation, (table, at) in zip(evaluations, tables, strict=True)
        if (pending := table.pending(np.unique(at))).size
    ]
    if talks:
        workspace.converse(talks, "predict")


def _asking(parameters: Array) -> Any:
    def work(desk: Desk) -> None:
        desk.all_of(parameters)

    return work


def _why_no_new(specimens: Sequence[Specimen]) -> str | None:
    if len(specimens) >= FEWEST:
        return None
    return f"{len(specimens)} specimens; a band for a new one needs {FEWEST} or more"


def _forces(
    workspace: Workspace, specimens: Sequence[Specimen], planned: list[_Rows], tables: list[tuple[Any, Array]]
) -> _Points:
    points = _Points()
    for specimen, rows, (table, at) in zip(specimens, planned, tables, strict=True):
        ok = rows.split(table.status[at] == 0)
        for curve in specimen.curves:
            keep = kept_points(curve.protocol, workspace.study.store.points_per_curve)
            force = rows.split(table.read(f"force_{curve.name}", at))
            noise = noise_of_others(specimens, specimen, curve.name)
            probability = workspace.study.predict.probability
            bands = _bands({name: force[name][ok[name]] for name in BANDS}, noise, probability)
            labels = {"specimen": specimen.name, "protocol": curve.name}
            arrays = {
                "time": curve.protocol.time_s[keep],
                "displacement": curve.protocol.displacement_mm[keep],
                "measured": curve.force_N[keep],
                **_named_bands(bands, keep.size),
            }
            points.add(keep.size, labels, arrays)
    return points


def _bands(simulated: dict[str, Array], noise: float, probability: float) -> dict[str, Band | None]:
    """From simulations ``[n, t]`` for each band; None where too few of them are left."""
    three, drawn, others = (simulated[name] for name in BANDS)
    return {
        "hdi": (three.min(axis=0), three.max(axis=0)) if len(three) > 1 else None,
        "draws": pointwise(drawn, probability) if len(drawn) > 1 else None,
        "new": next_curve(others, noise, probability) if len(others) >= FEWEST - 1 else None,
    }


def _named_bands(bands: dict[str, Band | None], size: int, prefix: str = "") -> dict[str, Array]:
    """``NAME_low`` and ``NAME_high`` ``[t]`` of every band; NaN for one that is not given."""
    nothing = np.full(size, np.nan)
    named = {}
    for name, band in bands.items():
        for bound, values in zip(("low", "high"), band or (nothing, nothing), strict=True):
            named[f"{prefix}{name}_{bound}"] = values
    return named


def pointwise(curves: Array, probability: float) -> Band:
    """Bounds ``[t]`` that hold the middle ``probability`` of ``curves`` ``[n, t]`` at each point."""
    low, high = np.quantile(curves, [(1 - probability) / 2, (1 + probability) / 2], axis=0)
    return low, high


def next_curve(curves: Array, noise: float, probability: float) -> Band:
    """Bounds ``[t]`` for one more of ``curves`` ``[n, t]`` that is measured with ``noise`` (standard deviation).

    The prediction interval of a normal sample, of asinh of the curves; the bend is at ``BENDS`` of their largest
    values' mean.
    """
    n = len(curves)
    bend = 2.0 * BENDS * float(np.abs(curves).max(axis=1).mean()) or 1.0
    bent = np.arcsinh(curves / bend)
    mean = bent.mean(axis=0)
    reach = float(student.ppf(0.5 + probability / 2, n - 1)) * np.sqrt(1.0 + 1.0 / n) * bent.std(axis=0, ddof=1)
    middle, low, high = (bend * np.sinh(each) for each in (mean, mean - reach, mean + reach))
    measured = float(norm.ppf(0.5 + probability / 2)) * noise
    return middle - np.hypot(middle - low, measured), middle + np.hypot(high - middle, measured)


def noise_of_others(specimens: Sequence[Specimen], specimen: Specimen, protocol: str) -> float:
    """Standard deviation (N) of the noise of the other specimens' curves of a protocol; 0 where none can tell."""
    sd = [
        noise_of(curve, other.curves).sd_N
        for other in specimens
        if other.name != specimen.name
        for curve in other.curves
        if curve.name == protocol
    ]
    known = np.array([value for value in sd if np.isfinite(value)])
    return float(np.sqrt(np.mean(known**2))) if known.size else 0.0


def _typical(specimens: Sequence[Specimen]) -> Specimen:
    """The specimen of most protocols and, of these, median cross-section: stresses depend on strains only."""
    most = max(len(one.curves) for one in specimens)
    able = sorted((one for one in specimens if len(one.curves) == most), key=lambda one: one.area_mm2)
    return able[(len(able) - 1) // 2]


def _stresses(workspace: Workspace, specimen: Specimen, rows: _Rows) -> tuple[_Points, str | None]:
    """Bands of both constituents' second Piola-Kirchhoff stress (MPa) along a specimen's protocols, or why not.

    ``new`` is as for forces, from the other specimens' parameters, without noise: nobody measures these stresses.
    """
    points = _Points()
    if not isinstance(workspace.simulator, Uniaxial):
        return points, f"the simulator {workspace.simulator.name} does not tell the constituents' stresses"
    for curve in specimen.curves:
        keep = kept_points(curve.protocol, workspace.study.store.points_per_curve)
        done = workspace.simulator.simulate(workspace.model, specimen, curve.protocol, rows.all, stresses=True)
        assert done.matrix_MPa is not None
        assert done.fibre_MPa is not None
        ok = rows.split(done.status == 0)
        arrays = {"time": curve.protocol.time_s[keep], "displacement": curve.protocol.displacement_mm[keep]}
        for constituent, stress in (("matrix", done.matrix_MPa), ("fibre", done.fibre_MPa)):
            each = rows.split(stress[:, keep])
            bands = _bands({name: each[name][ok[name]] for name in BANDS}, 0.0, workspace.study.predict.probability)
            arrays |= _named_bands(bands, keep.size, f"{constituent}_")
        points.add(keep.size, {"specimen": specimen.name, "protocol": curve.name}, arrays)
    return points, None


def _dataset(points: _Points, dim: str, unit: str) -> xr.Dataset:
    """Points of all curves along ``dim``; names of what belongs to stresses begin with ``stress_``."""
    prefix = "" if dim == "point" else "stress_"
    units = {"time": "s", "displacement": "mm"}
    variables = {
        f"{prefix}{name}": (dim, np.concatenate(parts), {"units": units.get(name, unit)})
        for name, parts in points.arrays.items()
    }
    labels = {f"{prefix}{name}": (dim, np.repeat(items, points.sizes)) for name, items in points.labels.items()}
    return xr.Dataset(variables, labels)


def coverage(dataset: xr.Dataset) -> dict[str, Any]:
    """The part of the measured points inside each band, each point once: all, by protocol and by specimen.

    None for a band that is not given anywhere; points where it is not given do not count (``points`` says how many do).
    """
    measured = dataset["measured"].to_numpy()
    told = {}
    for name in BANDS:
        low, high = dataset[f"{name}_low"].to_numpy(), dataset[f"{name}_high"].to_numpy()
        given = np.isfinite(low)
        inside = given & (measured >= low) & (measured <= high)

        def part(among: Array, inside: Array = inside, given: Array = given) -> float | None:
            count = int((among & given).sum())
            return float((among & inside).sum() / count) if count else None

        told[name] = {
            "all": part(np.ones(measured.size, dtype=bool)),
            "points": int(given.sum()),
            **{
                f"{label}s": {
                    str(value): part(dataset[label].to_numpy() == value)
                    for value in dict.fromkeys(dataset[label].to_numpy())
                }
                for label in ("protocol", "specimen")
            },
        }
    return told
