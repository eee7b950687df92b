"""A scripted solver for every way in which a run can end, and what tests need around it."""

import sys
from pathlib import Path

import numpy as np

from sinew.runner.store.schema import STATUSES
from sinew.tasks.model import Model, Protocol, Specimen
from sinew.tasks.simulate.febio.simulator import FEBio
from sinew.tasks.simulate.febio.tendon import read_template

BAR = Specimen("bar", 10.0, 8.0, 4.0)
PULL = Protocol("pull", np.linspace(0.0, 2.0, 9), np.linspace(0.0, 0.4, 9))
BUILT_IN = read_template(Path(), None)
TEMPLATE = BUILT_IN.text

FAKE = """#!{python} -IS
import os, re, signal, sys, time

if sys.argv[1:] == ["-info"]:
    print("FEBio version  = 4.77.fake")
    sys.exit(0)
assert sys.argv[1:] == ["-i", "model.feb", "-o", "model.log", "-silent"], sys.argv
assert os.environ["OMP_NUM_THREADS"] == "1"
signal.signal(signal.SIGXFSZ, signal.SIG_DFL)
model = open("model.feb").read()
E_m = float(re.search("<E>(.*?)</E>", model)[1])
points = [tuple(map(float, pair)) for pair in re.findall("<pt>(.*?),(.*?)</pt>", model.split("solver steps")[0])]
NORMAL = " N O R M A L   T E R M I N A T I O N\\n"
ERROR = " E R R O R   T E R M I N A T I O N\\n"
STEP = "===== beginning time step 1 : 0.25 =====\\n"


def log(*parts):
    with open("model.log", "a") as file:
        file.write("".join(parts))


def box(*lines, kind="ERROR"):
    rule = " " + "*" * 73 + "\\n"
    return rule + f" *{{kind:^71}}*\\n" + "".join(f" * {{line:<70}}*\\n" for line in lines) + rule


def reactions(scale=E_m):
    text = ""
    for step, (at, moved) in enumerate(points[1:], 1):
        text += f"*Step  = {{step}}\\n*Time  = {{at:.9g}}\\n*Data  = reaction\\n"
        text += "".join(f"{{node}},{{scale * moved / 4!r}}\\n" for node in (5, 6, 7, 8))
    return text


def write(text):
    with open("reaction.txt", "w") as file:
        file.write(text)


"""

OK = "write(reactions()); log(STEP, NORMAL)"
BREAK = "log(STEP, box('Negative jacobian was detected at element 1.', 'Gauss point 3'), ERROR); sys.exit(1)"


def solver(folder: Path, play: str = OK) -> FEBio:
    """A simulator whose solver is a script: it gives E_m x displacement as the sum of reactions, unless ``play``."""
    program = folder / "febio4"
    program.write_text(FAKE.format(python=sys.executable) + play + "\n")
    program.chmod(0o755)
    return FEBio(str(program), "fake", BUILT_IN, folder / "attempts", timeout_s=30.0)


def rows_with(model: Model, name: str, *values: float) -> np.ndarray:
    return model.full((name,), np.array(values)[:, np.newaxis])


def attempts(simulator: FEBio) -> list[str]:
    return sorted(path.name for path in simulator.scratch.iterdir()) if simulator.scratch.is_dir() else []


def outcome(simulator: FEBio, model: Model, protocol: Protocol = PULL) -> tuple[str, str]:
    """Status and message of one row."""
    simulated = simulator.simulate(model, BAR, protocol, model.reference[np.newaxis])
    assert np.isnan(simulated.force_N).all() == bool(simulated.status[0])
    return STATUSES[simulated.status[0]], simulated.messages[0]
