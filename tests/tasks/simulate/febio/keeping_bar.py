"""The dog-bone with a solver that writes plot files, whose runs are kept; processes that tests start import it fast."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from sinew.tasks.simulate.febio.field_output import FieldOutput
from sinew.tasks.simulate.febio.simulator import FEBio
from tests.tasks.simulate.febio.dogbone import OWN, dogbone
from tests.tasks.simulate.febio.plotting_bar import plotting_bar

ROWS = OWN.full(("E_matrix", "nu"), np.array([[10.0, 0.2], [30.0, 0.4], [45.0, 0.45]]))
LATERAL = FieldOutput("lateral", "mm", "max", "displacement", "x", (), "edge", "single", -2.0)
PLOTTED = ("displacement", "stress", "reaction forces")


def keeping_bar(folder: Path, *fields: FieldOutput) -> FEBio:
    found = dogbone(folder, program=plotting_bar(folder))
    template = replace(found.template, fields=fields)
    return replace(found, template=template, plotted=PLOTTED, kept=folder / "fields")
