"""The quantity that a study of many rows examines: the objective of all specimens, or an output of a template."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from sinew.tasks.model import Specimen
from sinew.tasks.simulate import Array
from sinew.tasks.simulate.evaluation import SpecimenEvaluation

_SUMMARY = {"max": "largest", "min": "smallest", "mean": "mean", "last": "last"}


def quantity(evaluation: SpecimenEvaluation, output: str | None) -> tuple[str, str]:
    """The field of the store that a study is about, ``[n, protocols]``, and what its sum over the protocols is.

    That is the objective where there is one, or else the summary of an output: the named or the first one.
    """
    if output is None and evaluation.scored:
        if evaluation.several:
            return "objective", "sum over protocols and quantities of RMSE over noise"
        return "objective", "sum over protocols of the RMSE in N"
    outputs = evaluation.simulator.capabilities.outputs
    chosen = next(each for each in outputs if output in (None, each.name))
    unit = "" if chosen.unit == "1" else f" in {chosen.unit}"
    words = f"{_SUMMARY[chosen.summary]} {chosen.name.replace('_', ' ')}{unit}"
    several = len(evaluation.specimen.curves) > 1
    return f"summary_{chosen.name}", f"sum over protocols of the {words}" if several else words


def objectives_by_output(specimens: Sequence[Specimen], objectives: Sequence[Array]) -> dict[str, Array]:
    """Objectives ``[n]``: total and by protocol, each the mean over the specimens that have it.

    ``objectives`` holds ``[n, protocols]`` of each specimen.
    """
    found: dict[str, list[Array]] = {"total": [values.sum(axis=1) for values in objectives]}
    for specimen, values in zip(specimens, objectives, strict=True):
        for column, curve in enumerate(specimen.curves):
            found.setdefault(curve.name, []).append(values[:, column])
    return {name: np.mean(values, axis=0) for name, values in found.items()}


def panels(
    total: Any, protocols: Mapping[str, Any], outputs: Mapping[str, Any], studied: str, words: str
) -> dict[str, Any]:
    """What a sensitivity study found, by the title under which a person sees it: all together, by protocol, by output.

    ``studied`` and ``words`` are those of :func:`quantity`. What would be shown twice is left out.
    """
    scored = studied == "objective"
    shown = {"total objective" if scored else words: total, **protocols, **outputs}
    if scored:
        return shown
    same = {studied.removeprefix("summary_")}  # what all together are of; with one protocol, that is the same
    same |= set(protocols) if len(protocols) == 1 else set()
    return {name: values for name, values in shown.items() if name not in same}
