"""Variance-based sensitivity: Sobol indices by a Saltelli design (SALib), in total, by protocol and along time.

Stores: ``sobol`` (indices of the objectives, and how they converged) and ``sobol_time/SPECIMEN`` (indices of the force,
and of a template's other outputs, at each kept point). Leaves ``sobol.json``.

Failed rows. A Saltelli design comes in blocks of one base sample each. A block with a failed row is left out of every
estimate, and the result says how far the indices move when the failed rows are given the smallest, the mean and the
largest outcome instead.
"""

import logging
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import SALib.analyze.sobol as salib_analyze
import SALib.sample.sobol as salib_sample
import xarray as xr
from scipy.stats import norm

from runner.ensemble import failures
from tasks.evaluate import SpecimenEvaluation
from tasks.model import Model, Specimen
from tasks.problems import BadInput
from tasks.simulate import Array, outputs_of
from tasks.workspace import Workspace, digest, read_result, write_json

log = logging.getLogger("sinew")
KEYS = ("S1", "S1_conf", "ST", "ST_conf")
RULE = "base samples with a failed row are left out"


@dataclass(frozen=True, eq=False)
class Design:
    """A Saltelli design over a model's free parameters.

    ``rows`` ``[n, d]`` holds full parameter sets; ``block`` is the number of consecutive rows of one base sample.
    """

    names: tuple[str, ...]
    base_samples: int
    second_order: bool
    rows: Array

    @property
    def block(self) -> int:
        return (2 if self.second_order else 1) * len(self.names) + 2

    @property
    def problem(self) -> dict[str, Any]:
        """What SALib calls a problem; the bounds do not matter once the rows are drawn."""
        return {"num_vars": len(self.names), "names": list(self.names), "bounds": [[0, 1]] * len(self.names)}


def base_samples(points: int, parameters: int, second_order: bool) -> int:
    """The smallest power of two whose Saltelli design has at least ``points`` rows."""
    block = (2 if second_order else 1) * parameters + 2
    return int(2 ** max(1, int(np.ceil(np.log2(points / block)))))


def saltelli(model: Model, base: int, second_order: bool, seed: int) -> Design:
    """Saltelli's design from a scrambled Sobol sequence; the first half of a doubled design is the design itself."""
    free = model.free
    problem = {
        "num_vars": len(free),
        "names": [parameter.name for parameter in free],
        "bounds": [[parameter.minimum, parameter.maximum] for parameter in free],
    }
    rows = salib_sample.sample(problem, base, calc_second_order=second_order, scramble=True, seed=seed)
    names = tuple(parameter.name for parameter in free)
    return Design(names, base, second_order, model.full(names, rows))


def sobol(workspace: Workspace, *, extend: bool = False) -> dict[str, Any]:
    """Sobol indices of the study; ``extend`` doubles the base samples of the last result. Returns ``sobol.json``."""
    settings = workspace.study.sobol
    specimens = workspace.specimens(settings.specimens, "sobol.specimens")
    previous = read_result(workspace.out / "sobol.json")
    count = len(workspace.model.free)
    base = settings.base_samples or base_samples(settings.points or 20_000, count, settings.second_order)
    if extend:
        assert previous is not None, "checked before the store was opened"
        base = 2 * int(previous["base_samples"])
    design = saltelli(workspace.model, base, settings.second_order, workspace.seed)
    rows = len(design.rows)
    drawn = digest(design.rows)
    log.info("sobol", extra={"rows": rows, "base_samples": base, "specimens": len(specimens)})
    evaluations = [workspace.evaluation(specimen) for specimen in specimens]
    evaluated = [workspace.plan(evaluation, design.rows) for evaluation in evaluations]
    design = replace(design, rows=design.rows[:0])  # they are in the store now; a large design need not stay in memory
    for evaluation, (table, at) in zip(evaluations, evaluated, strict=True):
        workspace.evaluate(evaluation, table, at, f"sobol {evaluation.specimen.name}")
    bounds = [[parameter.minimum, parameter.maximum] for parameter in workspace.model.free]
    inputs = digest(
        settings.model_dump(),
        workspace.seed,
        drawn,
        bounds,
        [table.key for table, _ in evaluated],
        *(table.status[at] for table, at in evaluated),
    )
    if previous is not None and previous.get("inputs") == inputs == _stored_inputs(workspace):
        return previous
    status = np.stack([table.status[at] for table, at in evaluated])
    ok = (status == 0).all(axis=0)
    whole = ok.reshape(base, design.block).all(axis=1)
    if whole.sum() < 2:
        raise BadInput(
            workspace.out, f"{int((~ok).sum())} of {rows} rows failed and no two base samples are whole",
            "a model that can be evaluated within its bounds (see `sinew status`)",
        )  # fmt: skip
    studied, words = quantity(evaluations[0], settings.output)
    by_specimen = [table.read(studied, at) for table, at in evaluated]
    outputs = objectives_by_output(specimens, by_specimen)
    result: dict[str, Any] = {
        "names": list(design.names),
        "bounds": bounds,
        "seed": workspace.seed,
        **_analyse(design, outputs["total"], whole, settings.resamples, settings.confidence, workspace.seed),
        "rows": rows,
        "failed": int((~ok).sum()),
        "base_samples": base,
        "base_samples_used": int(whole.sum()),
        "points_asked": settings.points,
        "confidence": settings.confidence,
        "objective": words + (", mean of the specimens" if len(specimens) > 1 else ""),
        "field": studied,
        "evaluations": rows * len(specimens),
    }
    analyses = {"total": {key: result[key] for key in KEYS}}
    result["protocols"] = {}
    for name in protocol_names(specimens):
        found = _analyse(design, outputs[name], whole, settings.resamples, settings.confidence, workspace.seed)
        analyses[name] = found
        result["protocols"][name] = {**found, "rows": rows, "failed": result["failed"], "base_samples": base}
    result["specimens"] = {}
    boot = _resampling(int(whole.sum()), settings.resamples, workspace.seed)
    z = float(norm.ppf(0.5 + settings.confidence / 2))
    for output in outputs_of(workspace.simulator):
        summaries = [table.read(f"summary_{output.name}", at) for table, at in evaluated]
        by_name = {}
        for name, values in objectives_by_output(specimens, summaries).items():
            found = indices(_split(values[:, np.newaxis], design, whole), boot, z)
            by_name[name] = analyses[f"{output.name} {name}"] = {key: found[key][:, 0] for key in KEYS}
        told = {"summary": output.summary, "unit": output.unit, "is_force": output.name == workspace.study.force}
        result.setdefault("outputs", {})[output.name] = told | by_name.pop("total") | {"protocols": by_name}
    for specimen, values, (table, at) in zip(specimens, by_specimen, evaluated, strict=True):
        columns = np.column_stack([values.sum(axis=1), values])
        found = indices(_split(columns, design, whole), boot, z)
        result["specimens"][specimen.name] = {
            **{key: found[key][:, 0] for key in KEYS},
            "failed": failures(table, at),
            "protocols": {
                curve.name: {key: found[key][:, 1 + i] for key in KEYS} for i, curve in enumerate(specimen.curves)
            },
        }
    result["failures"] = {
        "rule": RULE,
        "rows": result["failed"],
        "base_samples_left_out": base - result["base_samples_used"],
        "by_status": {name: failures(table, at) for (table, at), name in _named(evaluated, specimens)},
        **_failure_range(design, outputs["total"], ok),
    }
    result["convergence"] = _convergence(design, outputs["total"], whole, settings.resamples, z, workspace.seed)
    for evaluation, (table, at) in zip(evaluations, evaluated, strict=True):
        _store_time_resolved(workspace, design, evaluation, table, at, whole, boot, z)
    result["tables"] = {specimen.name: table.name for specimen, (table, _) in zip(specimens, evaluated, strict=True)}
    result["inputs"] = inputs
    _store(workspace, design, analyses, result["convergence"], inputs)
    write_json(workspace.out / "sobol.json", result)
    return result


def quantity(evaluation: SpecimenEvaluation, output: str | None) -> tuple[str, str]:
    """Of which field of the store a study asks, ``[n, protocols]``, and what its sum over the protocols is, in words.

    That is the objective where there is one, or else the summary of an output: the named or the first one.
    """
    if output is None and evaluation.scored:
        return "objective", "sum over protocols of the RMSE in N"
    outputs = outputs_of(evaluation.simulator)
    chosen = next(each for each in outputs if output in (None, each.name))
    summary = {"max": "largest", "min": "smallest", "mean": "mean", "last": "last"}[chosen.summary]
    unit = "" if chosen.unit == "1" else f" in {chosen.unit}"
    words = f"{summary} {chosen.name.replace('_', ' ')}{unit}"
    several = len(evaluation.specimen.curves) > 1
    return f"summary_{chosen.name}", f"sum over protocols of the {words}" if several else words


def indices(blocks: Array, weights: Array, z: float) -> dict[str, Array]:
    """First and total order indices of many outputs at once, with bootstrap intervals.

    ``blocks`` ``[n, d + 2, m]``: outcomes A, AB_1 ... AB_d, B of n base samples for m outputs; ``weights`` ``[r, n]``:
    how often each base sample is drawn in each resample. Returns S1, S1_conf, ST, ST_conf ``[d, m]``, NaN for outputs
    that do not vary. The estimators are those of :mod:`SALib.analyze.sobol` (Saltelli et al. 2010), which takes one
    output at a time; with the same resamples the numbers are equal.
    """
    n, width, m = blocks.shape
    mean = blocks.mean(axis=(0, 1))
    spread = blocks.std(axis=(0, 1))
    varies = spread > 1e-12 * np.maximum(np.abs(mean), np.finfo(float).tiny)
    scaled = (blocks - mean) / np.where(varies, spread, 1.0)
    a, b = scaled[:, 0], scaled[:, -1]
    draws = np.concatenate([np.ones((1, n)), weights]) / n  # the first "resample" is the sample itself
    mean_ab = draws @ (a + b) / 2
    variance = draws @ (a**2 + b**2) / 2 - mean_ab**2
    found = {key: np.full((width - 2, m), np.nan) for key in KEYS}
    with np.errstate(divide="ignore", invalid="ignore"):
        for j in range(width - 2):
            ab = scaled[:, 1 + j]
            first = (draws @ (b * (ab - a))) / variance
            total = 0.5 * (draws @ ((a - ab) ** 2)) / variance
            for key, value in (("S1", first), ("ST", total)):
                found[key][j] = np.where(varies, value[0], np.nan)
                found[f"{key}_conf"][j] = np.where(varies, z * value[1:].std(axis=0, ddof=1), np.nan)
    return found


def _analyse(
    design: Design, output: Array, whole: Array, resamples: int, confidence: float, seed: int
) -> dict[str, Any]:
    """SALib's own analysis of one output ``[n]``."""
    used = output.reshape(design.base_samples, design.block)[whole].ravel()
    if not np.isfinite(used).all():  # SALib would turn one of them into zeros everywhere
        raise ValueError("outcomes of whole base samples must be numbers")
    if np.ptp(used) <= 1e-12 * np.abs(used).max():
        return {key: np.full(len(design.names), np.nan) for key in KEYS}
    found = salib_analyze.analyze(
        design.problem,
        used,
        design.second_order,
        num_resamples=resamples,
        conf_level=confidence,
        seed=_salib_seed(seed),
    )
    keys = (*KEYS, "S2", "S2_conf") if design.second_order else KEYS
    return {key: np.asarray(found[key]) for key in keys}


def _salib_seed(seed: int) -> int:
    """SALib takes 0 for no seed at all."""
    return int(np.random.SeedSequence([seed, 1]).generate_state(1)[0]) | 1


def _resampling(n: int, resamples: int, seed: int) -> Array:
    """SALib's bootstrap as weights ``[resamples, n]``."""
    drawn = np.random.default_rng(_salib_seed(seed)).integers(n, size=(n, resamples))
    return np.stack([np.bincount(column, minlength=n) for column in drawn.T]).astype(float)


def protocol_names(specimens: tuple[Specimen, ...]) -> list[str]:
    return list(dict.fromkeys(curve.name for specimen in specimens for curve in specimen.curves))


def objectives_by_output(specimens: tuple[Specimen, ...], objectives: list[Array]) -> dict[str, Array]:
    """Objectives ``[n]``: total and by protocol, mean over the specimens that have it."""
    found: dict[str, list[Array]] = {"total": [values.sum(axis=1) for values in objectives]}
    for specimen, values in zip(specimens, objectives, strict=True):
        for column, curve in enumerate(specimen.curves):
            found.setdefault(curve.name, []).append(values[:, column])
    return {name: np.mean(values, axis=0) for name, values in found.items()}


def _split(columns: Array, design: Design, whole: Array) -> Array:
    """Outcomes ``[n, m]`` as blocks ``[whole, d + 2, m]`` of A, AB and B."""
    blocks = columns.reshape(design.base_samples, design.block, -1)[whole]
    d = len(design.names)
    return blocks[:, [*range(d + 1), design.block - 1]]


def _failure_range(design: Design, total: Array, ok: Array) -> dict[str, Any]:
    """The indices of the total objective if all failed rows had the smallest, mean or largest outcome: not a bound."""
    if ok.all():
        return {}
    every: Array = np.ones(design.base_samples, dtype=bool)
    found: dict[str, Any] = {}
    for name, value in (("smallest", total[ok].min()), ("mean", total[ok].mean()), ("largest", total[ok].max())):
        filled = np.where(ok, total, value)[:, np.newaxis]
        candidate = indices(_split(filled, design, every), np.ones((2, design.base_samples)), 1.0)
        found |= {f"{key}_if_{name}": candidate[key][:, 0] for key in ("S1", "ST")}
    return found


def _stored_inputs(workspace: Workspace) -> str | None:
    """What the arrays in the store were computed from."""
    group = workspace.store.root.get("sobol")
    return None if group is None else str(group.attrs.get("inputs"))


def _convergence(design: Design, total: Array, whole: Array, resamples: int, z: float, seed: int) -> dict[str, Any]:
    """Indices of the total objective from the first 32, 64, ... base samples."""
    sizes = [2**k for k in range(5, 31) if 2**k <= design.base_samples] or [design.base_samples]
    curve: dict[str, list[Array]] = {key: [] for key in KEYS}
    used = []
    for size in sizes:
        among = whole.copy()
        among[size:] = False
        if among.sum() < 2:
            continue
        blocks = _split(total[:, np.newaxis], design, among)
        found = indices(blocks, _resampling(len(blocks), resamples, seed), z)
        used.append(size)
        for key in KEYS:
            curve[key].append(found[key][:, 0])
    return {"base_samples": used, **curve}


def _store(
    workspace: Workspace, design: Design, analyses: dict[str, Any], convergence: dict[str, Any], inputs: str
) -> None:
    names = np.array(design.names, dtype=str)
    outputs = list(analyses)
    dataset = xr.Dataset(
        {
            **{key: (("output", "parameter"), np.stack([analyses[o][key] for o in outputs])) for key in KEYS},
            **{f"convergence_{key}": (("base_samples", "parameter"), np.stack(convergence[key])) for key in KEYS},
        },
        {"parameter": names, "output": outputs, "base_samples": convergence["base_samples"]},
        {
            "rows": design.base_samples * design.block,
            "method": "Saltelli 2010 by SALib",
            "failed_rows": RULE,
            "inputs": inputs,
        },
    )
    workspace.store.write_result("sobol", dataset)


def _store_time_resolved(
    workspace: Workspace,
    design: Design,
    evaluation: SpecimenEvaluation,
    table: Any,
    at: Array,
    whole: Array,
    boot: Array,
    z: float,
) -> None:
    """Indices of the force, and of other outputs, at each kept point, a few points at a time: memory stays flat."""
    variables: dict[str, Any] = {}
    coordinates: dict[str, Any] = {"parameter": np.array(design.names, dtype=str)}
    dataset = table.dataset()
    per_pass = max(1, 2**26 // (8 * max(1, at.size)))
    for curve in evaluation.specimen.curves:
        dim = f"time_{curve.name}"
        points = dataset.sizes[dim]
        for field, name in evaluation.courses(curve.name).items():
            parts = []
            for start in range(0, points, per_pass):
                columns = table.read(field, at, slice(start, start + per_pass))
                parts.append(indices(_split(columns, design, whole), boot, z))
            of = curve.name if field == f"force_{curve.name}" else f"{name}_{curve.name}"
            for key in KEYS:
                both = np.concatenate([part[key] for part in parts], axis=1)
                variables[f"{key}_{of}"] = (("parameter", dim), both)
        for name in (dim, f"displacement_{curve.name}", f"measured_{curve.name}"):
            if name in dataset:
                coordinates[name] = (dim, dataset[name].to_numpy(), {"units": dataset[name].attrs["units"]})
    specimen = evaluation.specimen.name
    workspace.store.write_result(f"sobol_time/{table.name}", xr.Dataset(variables, coordinates, {"specimen": specimen}))


def _named(evaluated: list[Any], specimens: tuple[Specimen, ...]) -> list[Any]:
    return [(pair, specimen.name) for pair, specimen in zip(evaluated, specimens, strict=True)]
