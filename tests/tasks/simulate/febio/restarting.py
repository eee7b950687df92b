"""A solver that dumps its state after each step and goes on from there, in place of febio4."""

import os
import stat
import sys
from dataclasses import dataclass
from pathlib import Path

# A step n takes `seconds` and logs n * n.
PROGRAM = """#!{python} -IS
import json, os, signal, sys, time
args = sys.argv[1:]
def note(line):
    os.write(os.open({notes!r}, os.O_WRONLY | os.O_APPEND | os.O_CREAT), (line + "\\n").encode())
def after(option):
    return args[args.index(option) + 1] if option in args else None
if args == ["-info"]:
    print("version 9.9.9")
    sys.exit()
begin = 0
if "-r" in args:
    begin = json.load(open(after("-r")))["step"]
    assert "-noappend" in args and "-i" not in args and after("-p") and after("-r").endswith(".dmp")
else:
    assert after("-i") == "model.feb"
stride = int(([1] + [word.split("=")[1] for word in args if word.startswith("-dump_stride=")])[-1])
note("from %d" % begin)
if "-r" in args and {fails!r}:
    sys.exit(1)
off = {off!r} if "-r" in args else 0.0
log = open("force.txt", "w", 1)
for step in range(begin + 1, {steps} + 1):
    time.sleep({seconds})
    if "-dump=1" in args and step % stride == 0:  # as FEBio does: before it logs the step
        with open(after("-dump=1"), "w") as file:
            json.dump({{"step": step}}, file)
    log.write("*Step  = %d\\n*Time  = %r\\n*Data  = force\\n5,%r\\n" % (step, 0.5 * step, step * step + off))
    with open(after("-o"), "a") as said:
        said.write("------- converged at time : %r\\n" % (0.5 * step))
    note("step %d" % step)
    if step == {fails_at}:
        sys.exit(1)
open(after("-o"), "a").write(" N O R M A L   T E R M I N A T I O N\\n")
"""


class Interrupted(BaseException):
    """As a signal that ends a worker."""


@dataclass(frozen=True)
class RestartingSolver:
    """The solver's settings, as :class:`sinew.tasks.simulate.febio.attempt.Solver` has them, and its ``notes``."""

    executable: str
    scratch: Path
    notes: Path
    restart_s: float | None = 0.2
    timeout_s: float = 60.0
    version: str = "9.9.9"
    confirmed: bytes | None = None
    max_file_bytes: int = 2**24
    keep_failed: int = 5

    @property
    def noted(self) -> list[str]:
        """What it has done: ``from N`` when it began, ``step N``."""
        return self.notes.read_text().splitlines()


def restarting(
    folder: Path, steps: int = 12, seconds: float = 0.1, off: float = 0.0, fails: bool = False, fails_at: int = 0
) -> Path:
    """Write the program; ``off``: what a run that goes on is wrong by; ``fails``: it cannot go on.

    ``fails_at``: the step behind which every run fails.
    """
    program = folder / "restarting"
    values = {"notes": str(folder / "notes"), "steps": steps, "seconds": seconds, "off": off, "fails": fails}
    program.write_text(PROGRAM.format(python=sys.executable, fails_at=fails_at, **values))
    program.chmod(program.stat().st_mode | stat.S_IXUSR)
    return program


def solver_in(folder: Path, **settings: object) -> RestartingSolver:
    """The solver in ``folder``, with its runs beside it."""
    program = restarting(folder, **settings)  # type: ignore[arg-type]
    return RestartingSolver(os.fspath(program), folder / "runs", folder / "notes")


# Plays febio4 with a linear spring, as tests.tasks.stand_in does. The first row that it meets takes `seconds`, step by
# step; it notes these steps, and where each of its runs began. Other rows take no time.
SPRING = """#!{python} -IS
import json, os, sys, time, zlib
args = sys.argv[1:]
if args == ["-info"]:
    print("version 9.9.9")
    sys.exit()
def note(file, line):
    os.write(os.open(file, os.O_WRONLY | os.O_APPEND | os.O_CREAT), (line + "\\n").encode())
def inside(tag, text):
    return [part.split("</" + tag + ">")[0] for part in text.split("<" + tag + ">")[1:]]
text = open("model.feb").read()
row = "%08x" % zlib.crc32(inside("Material", text)[0].encode())
stiffness = float(inside("E", text)[0])
points = [point.split(",") for point in inside("pt", text.split("solver steps")[0])]
note({begun!r}, row)
if not os.path.exists({slow!r}):
    note({slow!r}, row)
slow = open({slow!r}).read().split()[0] == row
begin = json.load(open(args[args.index("-r") + 1]))["step"] if "-r" in args else 0
if slow:
    note({notes!r}, "from %d" % begin)
with open("reaction.txt", "w", 1) as file:
    for step, (t, u) in enumerate(points[1:], 1):
        if step <= begin:
            continue
        if slow:
            time.sleep({seconds} / (len(points) - 1))
            note({notes!r}, "step %d" % step)
        with open(args[args.index("-dump=1") + 1], "w") as dump:
            json.dump({{"step": step}}, dump)
        file.write("*Step  = %d\\n*Time  = %s\\n*Data  = reaction\\n5,%r\\n" % (step, t, stiffness * float(u)))
open("model.log", "w").write(" N O R M A L   T E R M I N A T I O N\\n")
"""


def with_long_runs(study: Path, seconds: float) -> Path:
    """The study of :func:`tests.tasks.stand_in.prepare` with this solver, whose runs go on; returns its notes."""
    folder = study.parent
    files = {name: str(folder / name) for name in ("begun", "slow", "notes")}
    (folder / "solver").write_text(SPRING.format(python=sys.executable, seconds=seconds, **files))
    study.write_text(study.read_text().replace("timeout_s: 600", "timeout_s: 600, restart_s: 1"))
    return folder / "notes"
