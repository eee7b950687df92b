"""The specimens of a study: measured ones, or one that the study describes."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from sinew.runner.errors import BadInput
from sinew.tasks.data.cohort import Cohort, read_cohort
from sinew.tasks.model import Specimen
from sinew.tasks.study.measured import with_measured
from sinew.tasks.study.study import Study


def cohort_of(study: Study, data: Path | None = None) -> Cohort:
    """The specimens in ``data``, else those in the study's cohort, else one that follows the study's protocols.

    Raises :class:`BadInput`.
    """
    if data is not None or study.protocols is None:
        cohort = read_cohort(data or study.cohort_path)
        specimens = with_measured(study.path, cohort.folder, cohort.specimens, study.measured)
        cohort = replace(cohort, specimens=specimens)
    else:
        one = study.specimen
        size = (one.length_mm, one.width_mm, one.thickness_mm) if one is not None else (np.nan,) * 3
        curves = tuple(history.curve(name) for name, history in study.protocols.items())
        cohort = Cohort(study.path, (Specimen(study.name, *size, curves),))
    _check_names(study.path, sorted({*study.simulator.output_names, *study.compared}), cohort)
    return cohort


def _check_names(study: Path, outputs: Sequence[str], cohort: Cohort) -> None:
    """Raises :class:`BadInput` when two arrays of the store, or two lines of a table, would have the same name."""
    if not outputs:
        return
    for specimen in cohort.specimens:
        protocols = [curve.name for curve in specimen.curves]
        names = ["total", *outputs, *protocols, *(f"{kind}_{name}" for kind in ("summary", "rmse") for name in outputs)]
        for kind in (
            "time",
            "displacement",
            "measured",
            "conf",
            *outputs,
            *(f"{of}_{name}" for of in ("conf", "measured") for name in outputs),
        ):
            names += [f"{kind}_{protocol}" for protocol in protocols]
        if twice := [name for name, count in Counter(names).items() if count > 1]:
            problem = f"two things are called {twice[0]} in the store"
            raise BadInput(f"{study}: simulator.outputs", problem, "other names of outputs or protocols")
