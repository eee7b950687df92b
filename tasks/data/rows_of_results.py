"""Rows that are no curve: results of many tests, a row for each, whose titles are those of a curve."""

import re
from typing import Any

import numpy as np

from sinew.runner.errors import BadInput, shown
from sinew.tasks.data.tables import Table

FEWEST = 12  # rows: fewer may be those of a coarse curve
FEWEST_NAMES = 3  # rows, each with another name
_RESULT = re.compile(
    r"\b(?:uts|yield|ultimate|strength|modulus|module|zugfestigkeit|streckgrenze|bruchkraft|rm|rp0[.,]2)\b",
    re.IGNORECASE,
)
_OSCILLATION = re.compile(
    r"\b(?:storage|loss) modulus\b|\btan ?[(\[]?(?:delta\b|δ)|(?<!\w)[GE]['\u2032\u00b4]{1,2}(?![\w'])",
    re.IGNORECASE,
)
_SHEAR = re.compile(
    r"\b(?:shear|scher|schub|cisaillement)[ _-]?(?:strain|stress|dehnung|spannung|verzerrung)", re.IGNORECASE
)
EXPECTED_ALONG = "a test in tension or compression, along the axis of the specimen"
EXPECTED_CURVE = "forces and displacements over time"
EXPECTED = "a curve, or --rate-hz if its rows follow each other in time"
UP_AND_DOWN = 0.25  # of their range: numbers in any order differ by a third of it from row to row
Array = np.ndarray[Any, np.dtype[Any]]


class Oscillations(BadInput):
    """A table of moduli by which a material answers to oscillations."""


def refuse_rows_of_results(table: Table, motion: str, moved: Array, load: Array) -> None:
    """Raises :class:`BadInput` for a table without times whose rows are results.

    Each has another name, or the ``motion`` goes up and down from row to row, and so does the load, if it is known.
    ``moved``, ``load``: their numbers ``[t]``, NaN where there is none.
    """
    for place, title in enumerate(table.titles):
        if title and _names_rows(table, place):
            problem = f"no times, and each row has another name in {shown(title)}: results of many tests, and no curve"
            raise BadInput(table.path, problem, EXPECTED)
    if _in_any_order(moved) and (_in_any_order(load) or not np.isfinite(load).any()):
        problem = f"no times, and the {motion} goes up and down from row to row: results of many tests, and no curve"
        raise BadInput(table.path, problem, EXPECTED)


def refuse_oscillations(table: Table) -> None:
    """Raises :class:`Oscillations` for a table of moduli by which a material answers to oscillations: no curve."""
    title = next((title for title in table.titles if _OSCILLATION.search(title)), None)
    if title is not None:
        problem = f"{shown(title)}: amplitudes of oscillations, and no curve"
        raise Oscillations(table.path, problem, EXPECTED_CURVE)


def refuse_shear(table: Table, motion: object, load: object) -> None:
    """Raises :class:`BadInput` for a table of shear strains and stresses without another motion or load."""
    titles = [title for title in table.titles if _SHEAR.search(title)]
    if len(titles) > 1 and (motion is None or load is None):
        raise BadInput(table.path, f"{' and '.join(map(shown, titles[:2]))}: a test in shear", EXPECTED_ALONG)


def refusal_of(table: Table) -> BadInput | None:
    """Why a table without the columns of a test is none, where its titles tell that."""
    try:
        refuse_oscillations(table)
        refuse_shear(table, None, None)
    except BadInput as refusal:
        return refusal
    return None


def refuse_shear_column(where: str, title: str) -> None:
    """Raises :class:`BadInput` for a column of a shear strain or stress that a person names."""
    if _SHEAR.search(title):
        raise BadInput(where, f"{shown(title)} is of a test in shear", EXPECTED_ALONG)


def refuse_results_by_titles(table: Table) -> None:
    """Raises :class:`BadInput` for a table without times and loads, several of whose titles are those of results."""
    titles = [title for title in table.titles if _RESULT.search(title.replace("_", " "))]
    if len(titles) > 1:
        problem = f"no titles of time and force, but {' and '.join(map(shown, titles[:2]))}: results, and no curve"
        raise BadInput(table.path, problem, EXPECTED_CURVE)


def _names_rows(table: Table, place: int) -> bool:
    """Whether all rows have different words in a column, which begin with a letter."""
    seen: set[str] = set()
    for _, row in table.rows:
        cell = row[place] if place < len(row) else ""
        if not cell[:1].isalpha() or cell in seen:
            return False
        seen.add(cell)
    return len(seen) >= FEWEST_NAMES


def _in_any_order(values: Array) -> bool:
    values = values[np.isfinite(values)]
    span = float(np.ptp(values)) if values.size >= FEWEST else 0.0
    return span > 0.0 and float(np.abs(np.diff(values)).mean()) > UP_AND_DOWN * span
