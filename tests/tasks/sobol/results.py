"""A Sobol result of two parameters, as its tests need it."""

from typing import Any

import numpy as np

from sinew.tasks.sobol.result import Convergence, Failures, OfOutput, OfProtocol, SobolResult

NOTHING = np.zeros(2)
ZEROS = {"S1": NOTHING, "S1_conf": NOTHING, "ST": NOTHING, "ST_conf": NOTHING}


def sobol_result(**changed: Any) -> SobolResult:
    """Of one specimen and one protocol, with four base samples, unless ``changed`` says otherwise."""
    fields: dict[str, Any] = {
        **ZEROS, "names": ["E_f", "E_m"], "bounds": [[0, 1], [0, 1]], "seed": 4, "rows": 16, "failed": 0,
        "base_samples": 4, "scrambles": 1, "base_samples_used": 4, "points_asked": None, "confidence": 0.95,
        "objective": "sum over protocols of the RMSE in N", "field": "objective", "evaluations": 16,
        "protocols": {"pull": OfProtocol(**ZEROS)}, "specimens": {}, "failures": Failures("", 0, 0, {}),
        "convergence": Convergence([], *(np.empty((0, 2)),) * 4), "tables": {"s01": "s01-table"}, "inputs": "",
    }  # fmt: skip
    return SobolResult(**{**fields, **changed})


def of_output(*, is_force: bool = False) -> OfOutput:
    return OfOutput("max", "N", is_force, **ZEROS, protocols={})
