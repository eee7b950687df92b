"""Results of calibrations for tests of what reads them, made from numbers that are known."""

from collections.abc import Iterable, Mapping
from typing import Any

from sinew.tasks.calibrate.result import CalibrateResult, MethodFit, NoCorrelations, SpecimenFit


def fit_of(parameters: Mapping[str, float], **changes: Any) -> SpecimenFit:
    """The fit of a specimen, all of whose parameters are determined."""
    fit: dict[str, Any] = {
        "site": "distal",
        "donor": "1",
        "parameters": parameters,
        "rmse_N": {},
        "peak_N": {},
        "r2": {},
        "total_N": 1.0,
        "noise_N": 1.0,
        "above_noise": 0.0,
        "method": "hybrid",
        "on_bound": [],
        "sd_of_range": {},
        "determined": list(parameters),
        "confounded": [],
        "methods": {},
    }
    return SpecimenFit(**{**fit, **changes})


def method_of(trace: Iterable[tuple[int, float]]) -> MethodFit:
    """What a method found that came down a ``trace`` of evaluations and totals (N)."""
    steps = list(trace)
    return MethodFit(steps[-1][1], None, steps[-1][0], None, 1, {}, steps)


def calibration_of(specimens: Mapping[str, SpecimenFit], **changes: Any) -> CalibrateResult:
    """A calibration of these specimens; their parameters are those of the first of them."""
    names = list(next(iter(specimens.values())).parameters)
    found = [[fit.parameters[name] for fit in specimens.values()] for name in names]
    result: dict[str, Any] = {
        "names": names,
        "units": ["1"] * len(names),
        "meanings": [""] * len(names),
        "free": names,
        "bounds": [(min(0.0, *values), max(1.0, *values)) for values in found],
        "methods": ["bayesian", "hybrid"],
        "evaluations": 60,
        "bayesian_evaluations": 20,
        "specimens": specimens,
        "inputs": "known",
        "correlations": NoCorrelations("not computed"),
    }
    return CalibrateResult(**{**result, **changes})
