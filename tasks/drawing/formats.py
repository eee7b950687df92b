"""What files of figures hold; apart from the figures, because matplotlib takes long to import."""

import xarray as xr

FORMATS = ("png", "pdf", "csv")  # of every figure
DRAWN = 2000  # points of a measured curve, at the most: more than a figure has pixels


def protocols_of(dataset: xr.Dataset) -> list[str]:
    """The protocols of a dataset with dimensions ``time_PROTOCOL``."""
    return sorted(str(name).removeprefix("time_") for name in dataset.dims if str(name).startswith("time_"))
