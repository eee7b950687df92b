"""What files of figures hold; apart from the figures, because matplotlib takes long to import."""

from typing import TYPE_CHECKING, Any

import xarray as xr

from sinew.runner.printing import no_formula

if TYPE_CHECKING:
    import pandas as pd

FORMATS = ("png", "pdf", "csv")  # of every figure
DRAWN = 2000  # points of a measured curve, at the most: more than a figure has pixels


def protocols_of(dataset: xr.Dataset) -> list[str]:
    """The protocols of a dataset with dimensions ``time_PROTOCOL``."""
    return sorted(str(name).removeprefix("time_") for name in dataset.dims if str(name).startswith("time_"))


def without_formulas(table: "pd.DataFrame") -> "pd.DataFrame":
    """A table for a CSV file in whose texts, titles and index no spreadsheet sees a formula."""
    from pandas.api.types import is_numeric_dtype  # slow to import

    def cell(value: Any) -> Any:
        return no_formula(value) if isinstance(value, str) else value

    def entry(value: Any) -> Any:
        return tuple(map(cell, value)) if isinstance(value, tuple) else cell(value)

    guarded = table.copy()
    for place, kind in enumerate(table.dtypes):
        if not is_numeric_dtype(kind):
            guarded.isetitem(place, table.iloc[:, place].map(cell).to_numpy())
    guarded.index = table.index.map(entry)
    return guarded.rename(columns=entry)
