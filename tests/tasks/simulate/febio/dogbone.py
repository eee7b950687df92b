"""The dog-bone of the tutorial as a simulator, with an analytic stand-in for the solver."""

import sys
from pathlib import Path

import numpy as np

from sinew.tasks.model import Model, Protocol, Specimen
from sinew.tasks.model.parameters import own_parameter
from sinew.tasks.simulate.febio.output import Logged
from sinew.tasks.simulate.febio.simulator import FEBio
from sinew.tasks.simulate.febio.template import OwnTemplate
from sinew.tasks.study.resources import resource

BAR = Specimen("bar", 20.0, 4.0, 2.0)
RELAX = Protocol("relax", np.linspace(0.0, 12.0, 25), 0.3 * np.minimum(np.linspace(0.0, 12.0, 25), 4.0))
DOGBONE = resource("configs/dogbone/dogbone.feb.j2")
FORCE = Logged("force", "N", "max", "node_data", "Rz", (), "grip", "sum", 4.0)
STRESS = Logged("stress", "MPa", "max", "element_data", "sz", (), "gauge", "mean")
NARROWING = Logged("narrowing", "mm", "max", "node_data", "ux", (), "edge", "single", -2.0)
OWN = Model(
    (
        own_parameter("E_matrix", "MPa", 5.0, 50.0, 20.0),
        own_parameter("nu", "1", 0.1, 0.45, 0.3),
        own_parameter("g_1", "1", 0.1, 1.5, 0.8),
        own_parameter("tau_1", "s", 2.0, 30.0, 8.0),
    ),
    law="template",
)


def stand_in(folder: Path) -> Path:
    """The analytic bar of the tutorial as a program; it is not FEBio."""
    text = resource("configs/dogbone/analytic_bar.py").read_text()
    program = folder / "analytic-bar"
    program.write_text(text.replace("/usr/bin/env python3", f"{sys.executable} -I", 1))
    program.chmod(0o755)
    return program


def dogbone(folder: Path, text: str | None = None, program: Path | None = None) -> FEBio:
    """The dog-bone, or another template, with the stand-in or another solver."""
    program = program or stand_in(folder)
    files = {"model.feb.j2": DOGBONE.read_text() if text is None else text}
    template = OwnTemplate(files, "model.feb.j2", (FORCE, STRESS, NARROWING), "force")
    return FEBio(str(program), "test", template, folder / "attempts", timeout_s=120.0)
