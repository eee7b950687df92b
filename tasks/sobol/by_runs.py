"""Sobol indices by surrogate: more and more runs, until the intervals are as narrow as asked.

With ``method: multifidelity``, cheaper versions of the model are run beside it, each at points of its own.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sinew.runner.errors import BadInput
from sinew.runner.evaluation.ensemble import failures
from sinew.tasks.model import Specimen
from sinew.tasks.simulate import Array, Simulator
from sinew.tasks.simulate.build import cheaper_of
from sinew.tasks.simulate.evaluation import SpecimenEvaluation
from sinew.tasks.simulate.growing import FIRST, sizes_up_to
from sinew.tasks.simulate.plain_design import plain_design
from sinew.tasks.simulate.studied_quantity import objectives_by_output, quantity
from sinew.tasks.sobol.analysed import analysed, known, ran
from sinew.tasks.sobol.by_chaos import FEWEST, LIMIT, ByChaos, Version
from sinew.tasks.sobol.evaluated import Evaluated
from sinew.tasks.sobol.method import Intervals
from sinew.tasks.sobol.polynomials import Fitted
from sinew.tasks.sobol.result import Analysis, OfVersion, SobolResult, Surrogate
from sinew.tasks.sobol.rows import sobol_rows
from sinew.tasks.sobol.settings import Settings
from sinew.tasks.study.files import digest
from sinew.tasks.study.workspace import Workspace, attempts_folder

OF_BAR = 2048  # runs of the embedded bar, which cost nothing beside those of a solver


@dataclass(frozen=True, eq=False)
class Cheaper:
    """A cheaper version of the model: how many ``rows`` for each of the model's (None: a fixed number of them)."""

    name: str
    simulator: Simulator
    number: int
    rows: int | None

    def size(self, size: int) -> int:
        """How many runs it has beside ``size`` of the model; as many as are worth a fit, at least."""
        return OF_BAR if self.rows is None else max(self.rows * size, 2 * FEWEST)


def by_surrogate(workspace: Workspace, settings: Settings) -> SobolResult:
    """Indices of polynomials, trained with more and more rows until their intervals are as narrow as asked."""
    versions = _versions(workspace) if settings.method == "multifidelity" else ()
    if not workspace.retry_failed and (last := _finished(workspace, settings, versions)) is not None:
        return last
    specimens = workspace.specimens(settings.specimens, "sobol.specimens")
    intervals = Intervals(settings.resamples, settings.confidence, workspace.seed)
    studied, _ = quantity(workspace.evaluation(specimens[0]), settings.output)
    looked: list[int] = []
    fits: dict[bytes, Fitted] = {}
    found: dict[str, Fitted | None] = {}
    planned: list[Evaluated] = []
    of_cheaper = 0  # the size of the design beside which cheaper versions are run: it grows while they help
    for size in sizes_up_to(settings.runs, settings.first if versions else FIRST):
        design, share = plain_design(workspace.model, size, workspace.seed, settings.scrambles, settings.inputs)
        of_cheaper = size if not looked or _help(found.values()) else of_cheaper
        beside = tuple(_design(workspace, settings, one, of_cheaper) for one in versions)
        before: Sequence[Evaluated | None] = planned or [None] * len(specimens)
        planned = [
            _with_cheaper(workspace, one, design.rows, list(zip(versions, beside, strict=True)), last)
            for one, last in zip(specimens, before, strict=True)
        ]
        looked.append(size)
        ok = ran(planned)
        if (~ok).mean() > LIMIT:
            raise BadInput(
                f"{workspace.study.path}: sobol.method", f"{(~ok).sum()} of {size} rows failed",
                f"at most {100 * LIMIT:g} % for a surrogate: narrower ranges, or method: saltelli",
            )  # fmt: skip
        estimate = ByChaos(
            design, share, ok, intervals, settings.second_order, tuple(looked), fits=fits, cheaper=beside
        )
        outcomes = objectives_by_output(specimens, [one.read(studied) for one in planned])
        found = {name: estimate.fitted(values) for name, values in outcomes.items()}
        widest = max(_widest(estimate.analysis(values)) for values in outcomes.values())
        words = f"{size} runs, intervals at most ± {widest:.3f}"
        workspace.note("sobol", "surrogate", words, value=widest, runs=size)
        if versions:
            workspace.say(f"sobol: {_gain(found['total'], versions, planned)}")
        workspace.say(f"sobol: {words} ({settings.error:g} asked)")
        if widest <= settings.error:
            break
    inputs, _ = known(workspace, settings, digest(design.rows), planned, _named(versions))
    return analysed(
        workspace, settings, estimate, planned, inputs, _surrogate(settings, widest, found, versions, planned)
    )


def _versions(workspace: Workspace) -> tuple[Cheaper, ...]:
    """The cheaper versions of the study's model, the cheapest first."""
    coarse = workspace.study.simulator.coarse_rows
    scratch = attempts_folder(workspace.out)
    simulators = cheaper_of(workspace.study, workspace.simulator, scratch)
    rows = {"bar": None, "coarse": coarse}
    return tuple(
        Cheaper(name, simulator, number, rows[name]) for number, (name, simulator) in enumerate(simulators.items(), 1)
    )


def _evaluated(
    workspace: Workspace, specimen: Specimen, rows: Array, before: Evaluated | None, version: Cheaper | None = None
) -> Evaluated:
    """A specimen's evaluations of a design, with the study's simulator or a cheaper version.

    ``before``: those of its first rows, which are not asked for again.
    """
    evaluation = _evaluation(workspace, specimen, version)
    known_rows = np.empty(0, dtype=int) if before is None else before.at
    if known_rows.size == len(rows) and before is not None:
        return before
    table, new = workspace.plan(evaluation, rows[known_rows.size :])
    planned = Evaluated(evaluation, table, np.concatenate([known_rows, new]))
    title = "sobol" if version is None else f"sobol, {version.name},"
    here = evaluation.simulator.capabilities.quick
    workspace.evaluate(evaluation, table, planned.at, f"{title} {specimen.name}", here=here)
    return planned


def _evaluation(workspace: Workspace, specimen: Specimen, version: Cheaper | None) -> SpecimenEvaluation:
    """What is asked of a specimen; where a version has no other outputs to compare, its force alone is compared."""
    evaluation = workspace.evaluation(specimen)
    if version is None:
        return evaluation
    outputs = {output.name for output in version.simulator.capabilities.outputs}
    compared = specimen if set(specimen.others) <= outputs else replace(specimen, noise={})
    return replace(evaluation, simulator=version.simulator, specimen=compared)


def _with_cheaper(
    workspace: Workspace,
    specimen: Specimen,
    rows: Array,
    beside: Sequence[tuple[Cheaper, Version]],
    before: Evaluated | None,
) -> Evaluated:
    """A specimen's evaluations of the design, and those of each cheaper version."""
    planned = _evaluated(workspace, specimen, rows, before)
    earlier = [None] * len(beside) if before is None else before.cheaper
    others = tuple(
        _evaluated(workspace, specimen, version.design.rows, last, cheaper)
        for (cheaper, version), last in zip(beside, earlier, strict=True)
    )
    return replace(planned, cheaper=others)


def _design(workspace: Workspace, settings: Settings, one: Cheaper, size: int) -> Version:
    count = one.size(size)
    return Version(
        *plain_design(workspace.model, count, workspace.seed, settings.scrambles, settings.inputs, one.number)
    )


def _help(found: Iterable[Fitted | None]) -> bool:
    """Whether a cheaper version is used for some outcome."""
    return any(one is not None and one.used for one in found)


def _widest(found: Analysis) -> float:
    """The largest half-width of an interval; 0 where nothing varies."""
    every = [half.ravel() for half in (found.S1_conf, found.ST_conf, found.S2_conf) if half is not None]
    return float(np.nanmax(np.concatenate(every), initial=0.0))


def _gain(total: Fitted | None, versions: Sequence[Cheaper], planned: Sequence[Evaluated]) -> str:
    """What cheaper versions bring, and what they cost, for a person."""
    if total is None:
        return "the total varies too little"
    costs = []
    for number, one in enumerate(versions):
        part = float(np.mean([_seconds(each.cheaper[number]) / _seconds(each) for each in planned]))
        costs.append(f"{one.name} takes {f'{part:.2g}' if part >= 0.001 else 'less than 0.001'}")
    left = f"{100 * total.unexplained:.2g} % of the total's variance is unexplained"
    with_them = f"with {' and '.join(one.name for one in versions)}, {100 * total.alone:.2g} % by the model alone"
    used = "" if total.used else "; they do not help"
    return f"{left} {with_them}{used} ({', '.join(costs)} of its time for a run)"


def _seconds(one: Evaluated) -> float:
    """How long a run takes."""
    return max(float(np.nanmedian(one.table.read("wall_seconds", one.at))), 1e-6)


def _surrogate(
    settings: Settings,
    widest: float,
    found: Mapping[str, Fitted | None],
    versions: Sequence[Cheaper],
    planned: Sequence[Evaluated],
) -> Surrogate:
    left = {name: 0.0 if one is None else one.unexplained for name, one in found.items()}
    reached = widest <= settings.error
    if not versions:
        return Surrogate(settings.error, reached, left)
    runs = {}
    for number, one in enumerate(versions):
        of = [each.cheaper[number] for each in planned]
        failed = sum(sum(failures(each.table, each.at).values()) for each in of)
        runs[one.name] = OfVersion(runs=sum(each.at.size for each in of), failed=failed)
    alone = {name: 0.0 if one is None else one.alone for name, one in found.items()}
    return Surrogate(settings.error, reached, left, alone, runs)


def _finished(workspace: Workspace, settings: Settings, versions: Sequence[Cheaper]) -> SobolResult | None:
    """The last result, if it is of the same study and all that it was made of is there."""
    try:
        last = sobol_rows(workspace)
    except BadInput:
        return None
    planned = [
        Evaluated(workspace.evaluation(one), *each) for one, each in zip(last.specimens, last.evaluated, strict=True)
    ]
    result = SobolResult.read(workspace.out)
    told = None if result is None or result.surrogate is None else result.surrogate.versions
    if (told is None) != (not versions):
        return None
    for one in versions:
        of = (told or {}).get(one.name)
        size = 0 if of is None else of.runs // len(planned)
        if not 0 < size <= one.size(settings.runs):
            return None
        design, _ = plain_design(workspace.model, size, workspace.seed, settings.scrambles, settings.inputs, one.number)
        others = [_found(workspace, each.specimen, design.rows, one) for each in planned]
        planned = [
            replace(each, cheaper=(*each.cheaper, other))
            for each, other in zip(planned, others, strict=True) if other is not None
        ]  # fmt: skip
        if len(planned) < len(others):
            return None
    return known(workspace, settings, digest(last.design.rows), planned, _named(versions))[1]


def _found(workspace: Workspace, specimen: Specimen, rows: Array, version: Cheaper) -> Evaluated | None:
    """A specimen's finished evaluations by a version; None if some are missing. Nothing is planned."""
    evaluation = _evaluation(workspace, specimen, version)
    table = workspace.store.table(evaluation.table())
    at = table.find(rows)
    return None if (at < 0).any() or table.pending(at).size else Evaluated(evaluation, table, at)


def _named(versions: Sequence[Cheaper]) -> list[tuple[str, int]]:
    return [(one.name, one.rows or 0) for one in versions]
