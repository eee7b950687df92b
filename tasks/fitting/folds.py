"""Parts of the runs of a design: the folds of a cross-validation, and some runs that are spread over all."""

import numpy as np

from sinew.tasks.simulate import Array

FOLDS = 8
TRAINED = 200  # runs from which length scales are found, at most: their likelihood takes the cube of these


def folds_of(runs: int) -> list[Array]:
    """Whether each of so many runs is left out ``[n]``, for each fold: the runs in turn, as they were drawn."""
    return [np.arange(runs) % FOLDS == each for each in range(FOLDS)]


def some_of(runs: int) -> Array:
    """The numbers of ``TRAINED`` runs that are spread over so many, or of all."""
    return np.linspace(0, runs - 1, min(runs, TRAINED)).astype(int)
