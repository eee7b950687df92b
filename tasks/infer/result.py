"""The result of an inference, by whichever method: what ``infer.json`` holds, and how its arrays are read."""

from pathlib import Path
from typing import Any, cast

from sinew.tasks.infer.abc.result import FEW, AbcResult, are_weights, draws, particles_group
from sinew.tasks.infer.likelihood.result import LikelihoodResult, draws_of_mean, draws_of_new, draws_of_specimen
from sinew.tasks.study.result import Result

__all__ = [
    "FEW",
    "AbcResult",
    "InferResult",
    "LikelihoodResult",
    "Posteriors",
    "are_weights",
    "draws",
    "draws_of_mean",
    "draws_of_new",
    "draws_of_specimen",
    "particles_group",
    "read_posteriors",
]

Posteriors = AbcResult | LikelihoodResult


class InferResult(Result):
    """Reads the result of either method: an :class:`AbcResult` or a :class:`LikelihoodResult`."""

    TASK = "infer"

    @classmethod
    def parse(cls, content: Any, where: Path) -> Any:
        by_likelihood = isinstance(content, dict) and content.get("method") == "likelihood"
        return (LikelihoodResult if by_likelihood else AbcResult).parse(content, where)


def read_posteriors(folder: Path) -> Posteriors | None:
    """The result in a folder, or None. Raises :class:`sinew.runner.errors.BadInput` when it is damaged."""
    return cast(Posteriors | None, InferResult.read(folder))


RESULT = InferResult
