"""The result of random forest importance: what ``importance.json`` holds."""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from sinew.tasks.simulate.studied_quantity import panels
from sinew.tasks.study.result import OMIT, R2, Count, NotNegatives, Numbers, Result, check_lengths

MOST_PERCENT = 100.1  # of all parameters together, rounding aside
KEYS = ("impurity_percent", "impurity_sd", "permutation", "permutation_sd")


@dataclass(frozen=True, eq=False)
class Forest:
    """Importance ``[d]`` of each parameter for one output, and how well its forest predicts unseen rows.

    Impurity importance in percent with its standard deviation over the trees; permutation importance as a loss of R2
    with its standard deviation over the permutations.
    """

    impurity_percent: NotNegatives
    impurity_sd: NotNegatives
    permutation: Numbers
    permutation_sd: NotNegatives
    r2_on_unseen: R2


@dataclass(frozen=True, eq=False)
class ImportanceResult(Result):
    """Importance of the free parameters for the total objective, each protocol's, and each of a template's outputs.

    ``field`` is what the store calls the quantity under study and ``objective`` says it in words.
    """

    TASK = "importance"
    LIBRARIES = ("scikit-learn", "SALib")

    names: list[str]
    impurity_percent: NotNegatives
    impurity_sd: NotNegatives
    permutation: Numbers
    permutation_sd: NotNegatives
    r2_on_unseen: R2
    objective: str
    field: str
    protocols: Mapping[str, Forest]
    rows_grown: Count
    rows_tested: Count
    failed: Count
    new_simulations: Count
    inputs: str
    outputs: Mapping[str, Forest] | None = dataclasses.field(default=None, metadata=OMIT)

    def __post_init__(self) -> None:
        """Raises :class:`ValueError` for numbers that contradict each other."""
        for one in self.by_output().values():
            check_lengths(self.names, one, KEYS)
            if (total := float(one.impurity_percent.sum())) > MOST_PERCENT:
                raise ValueError(f"impurity_percent: {total:g} % in all")

    def by_output(self) -> dict[str, Any]:
        """Importance by name: all together (``total``), each protocol, each of a template's outputs."""
        return {"total": self, **self.protocols, **(self.outputs or {})}

    def panels(self) -> dict[str, Any]:
        """Importance by the title under which a person sees it; what would be shown twice is left out."""
        return panels(self, self.protocols, self.outputs or {}, self.field, self.objective)


RESULT = ImportanceResult
