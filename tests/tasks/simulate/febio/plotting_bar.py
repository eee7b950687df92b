"""The analytic bar of the tutorial as a solver that writes a plot file too, as FEBio does, and counts its runs."""

import importlib.util
import struct
import sys
import zlib
from pathlib import Path
from typing import Any

import defusedxml.ElementTree as ElementTree
import numpy as np

from tests.tasks.simulate.febio import plot_writer as w

ROOT = Path(__file__).parents[4]
COUNT = "runs.count"
VARIABLES = ("displacement", "stress", "reaction forces")


def plotting_bar(folder: Path) -> Path:
    """The program; ``runs(folder)`` says how often it ran."""
    program = folder / "plotting-bar"
    if program.exists():  # other processes may be running it
        return program
    program.write_text(
        f"#!{sys.executable} -I\nimport sys\nsys.path.insert(0, {str(ROOT)!r})\n"
        f"from tests.tasks.simulate.febio.plotting_bar import main\nsys.exit(main({str(folder / COUNT)!r}))\n"
    )
    program.chmod(0o755)
    return program


def runs(folder: Path) -> int:
    count = folder / COUNT
    return count.stat().st_size if count.exists() else 0


def main(count: str) -> int:
    spec = importlib.util.spec_from_file_location("analytic_bar", ROOT / "configs/dogbone/analytic_bar.py")
    assert spec is not None and spec.loader is not None
    bar = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(bar)
    if sys.argv[1:] == ["-info"]:
        return int(bar.main())
    with open(count, "ab") as file:
        file.write(b".")
    root = ElementTree.parse("model.feb").getroot()
    if root.findtext("Control/plot_level") != "PLOT_NEVER":
        Path("model.xplt").write_bytes(_plot(bar, root))
    return int(bar.main())


def _all(bar: Any, root: Any, data: str, ids: list[int]) -> tuple[list[float], np.ndarray]:
    """Times, and what the bar logs for all ``ids``, ``[step, id]``."""
    log = root.find("Output/logfile")
    asked = ElementTree.fromstring(
        f'<node_data data="{data}" name="x" file="all.txt">{",".join(map(str, ids))}</node_data>'
    )
    kept = list(log)
    log[:] = [asked]
    Path("all.feb").write_bytes(ElementTree.tostring(root))
    bar.solve(Path(), "all.feb")
    log[:] = kept
    lines = Path("all.txt").read_text().splitlines()
    times = [float(line.split("=")[1]) for line in lines if line.startswith("*Time")]
    found = [float(line.split(",")[1]) for line in lines if not line.startswith("*")]
    return times, np.array(found).reshape(len(times), len(ids))


def _plot(bar: Any, root: Any) -> bytes:
    nodes = [(int(node.get("id")), [float(x) for x in node.text.split(",")]) for node in root.iter("node")]
    at = {number: position for position, (number, _) in enumerate(nodes)}
    blocks = [
        (e.get("name"), [(int(one.get("id")), one.text) for one in e.iter("elem")]) for e in root.iter("Elements")
    ]
    coords = b"".join(struct.pack("<i3f", number, *place) for number, place in nodes)
    header = w.chunk(0x01041100, w.whole(0x01041101, len(nodes)), w.whole(0x01041102, 3))
    domains = [
        w.domain(0, 1, name, [[at[int(i)] for i in text.split(",")] for _, text in elements], elements[0][0])
        for name, elements in blocks
    ]
    sets = [(e.get("name"), [at[int(i)] for i in e.text.split(",")]) for e in root.iter("NodeSet")]
    named = [w.named_set(0x01044000, i, name, items) for i, (name, items) in enumerate(sets, 1)]
    mesh = w.chunk(
        0x01040000,
        w.chunk(0x01041000, header, w.chunk(0x01041200, coords)),
        w.chunk(0x01042000, *domains),
        w.chunk(0x01044000, *named),
    )
    asked = [var.get("type") for var in root.find("Output/plotfile")]
    times, ux = _all(bar, root, "ux", list(at))
    top = [number for number, place in nodes if place[2] == max(z for _, (_, _, z) in nodes)]
    _, Rz = _all(bar, root, "Rz", top)
    stresses = [_all(bar, root, "sz", [number for number, _ in elements])[1] for _, elements in blocks]
    nodal = {
        "displacement": np.zeros((len(times), len(nodes), 3)),
        "reaction forces": np.zeros((len(times), len(nodes), 3)),
    }
    nodal["displacement"][:, :, 0] = ux
    nodal["reaction forces"][:, [at[number] for number in top], 2] = Rz
    there = [name for name in nodal if name in asked]
    words = [w.chunk(0x01023000, *(w.item(1, 0, name) for name in there))]
    words += [w.chunk(0x01024000, w.item(2, 1, "stress"))] if "stress" in asked else []

    def state(step: int) -> bytes:
        data = [w.chunk(0x02020300, *(w.value(i, w.floats(0, nodal[name][step])) for i, name in enumerate(there, 1)))]
        if "stress" in asked:
            tensors = [np.pad(one[step][:, np.newaxis], ((0, 0), (2, 3))) for one in stresses]
            data += [w.chunk(0x02020400, w.value(1, *(w.floats(i, one) for i, one in enumerate(tensors, 1))))]
        head = w.chunk(0x02010000, w.floats(0x02010002, [times[step]]))
        return zlib.compress(w.chunk(0x02000000, head, w.chunk(0x02020000, *data)))

    header = w.chunk(0x01010000, w.whole(0x01010001, 0x35), w.whole(0x01010004, 1))
    states = b"".join(state(step) for step in range(len(times)))
    return b"BEF\0" + w.chunk(0x01000000, header, w.chunk(0x01020000, *words)) + mesh + states
