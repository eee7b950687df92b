#!/usr/bin/env python3
"""NOT FEBio: a stand-in that computes the pulled dog-bone as a bar in one dimension, where FEBio is not installed.

It is called as febio4 is, and writes the log files that the input asks for, so that studies with a template can be
tried and tested without the solver. It knows one material, `viscoelastic` neo-Hookean with one Prony term, and bars of
rectangular cross-section along z of which an eighth is modelled. The stress is uniaxial everywhere and the material of
the shoulders is as compliant as that of the gauge: for a straight bar this is exact, for a dog-bone an approximation.

Source: Maas et al., FEBio theory manual, sections 5.2 (neo-Hookean) and 5.6 (viscoelastic).
"""

import math
import sys
from itertools import pairwise
from pathlib import Path
from typing import Any

import defusedxml.ElementTree as ElementTree


def lateral(stretch: float, mu: float, lame: float) -> float:
    """The lateral stretch at which a neo-Hookean bar has no lateral stress: mu (t2 - 1) + lame ln(stretch t2) = 0."""
    square = 1.0
    for _ in range(60):
        wrong = mu * (square - 1.0) + lame * math.log(stretch * square)
        step = wrong / (mu + lame / square)
        square -= step
        if abs(step) < 1e-15:
            break
    return math.sqrt(square)


def uniaxial(stretches: list[float], times: list[float], E: float, nu: float, g: float, tau: float) -> list[float]:
    """Nominal stress (MPa) along a history; the relaxation acts on the second Piola-Kirchhoff stress."""
    mu, lame = E / (2 * (1 + nu)), E * nu / ((1 + nu) * (1 - 2 * nu))
    found, before, memory = [0.0], 0.0, 0.0
    for i in range(1, len(times)):
        step = times[i] - times[i - 1]
        volume = stretches[i] * lateral(stretches[i], mu, lame) ** 2
        elastic = (mu * (stretches[i] ** 2 - 1.0) + lame * math.log(volume)) / stretches[i] ** 2
        decay = math.exp(-step / tau)
        memory = memory * decay + (elastic - before) * (1.0 - decay) * tau / step
        before = elastic
        found.append(stretches[i] * (elastic + g * memory))
    return found


def number(root: Any, path: str) -> float:
    """The number at a path."""
    return float(root.find(path).text)


def solve(folder: Path, name: str) -> None:
    """Write what the log file section of an input asks for."""
    root = ElementTree.parse(folder / name).getroot()
    nodes = {int(node.get("id")): tuple(map(float, node.text.split(","))) for node in root.iter("node")}
    parts = {int(e.get("id")): [nodes[int(corner)] for corner in e.text.split(",")] for e in root.iter("elem")}
    heights = sorted({z for _, _, z in nodes.values()})
    areas = {h: max(x for x, _, z in nodes.values() if z == h) * max(y for _, y, _ in nodes.values()) for h in heights}
    gauge = areas[heights[0]]
    length = sum((b - a) * gauge * (1 / areas[a] + 1 / areas[b]) / 2 for a, b in pairwise(heights))
    controllers = root.findall("LoadData/load_controller")
    points = [tuple(map(float, point.text.split(","))) for point in controllers[0].iter("pt")]
    times, pulled = [t for t, _ in points], [u * number(root, ".//bc[@name='pulled']/value") for _, u in points]
    E, nu = number(root, ".//elastic/E"), number(root, ".//elastic/v")
    stretches = [1.0 + u / length for u in pulled]
    nominal = uniaxial(stretches, times, E, nu, number(root, ".//material/g1"), number(root, ".//material/t1"))
    mu, lame = E / (2 * (1 + nu)), E * nu / ((1 + nu) * (1 - 2 * nu))
    narrowed = [lateral(stretch, mu, lame) for stretch in stretches]
    top = heights[-1]
    for asked in root.findall("Output/logfile/*"):
        ids = [int(each) for each in asked.text.split(",")]
        lines = []
        for step in range(1, len(times)):
            lines += [f"*Step  = {step}", f"*Time  = {times[step]:.9g}", f"*Data  = {asked.get('name')}"]
            for each in ids:
                if asked.get("data") == "Rz":
                    value = gauge * nominal[step] / sum(node[2] == top for node in nodes.values())
                elif asked.get("data") == "ux":
                    value = nodes[each][0] * (narrowed[step] - 1.0)
                elif asked.get("data") in ("sz", "s1"):
                    at = min(z for _, _, z in parts[each])
                    value = nominal[step] * gauge / areas[at] / narrowed[step] ** 2
                else:
                    raise ValueError(f"the stand-in does not know {asked.get('data')}")
                lines.append(f"{each},{value!r}")
        (folder / asked.get("file")).write_text("\n".join(lines) + "\n")


def main() -> int:
    """As febio4: -info tells the version; -i INPUT -o LOG solves."""
    if sys.argv[1:] == ["-info"]:
        print("This is the analytic bar, a stand-in and not FEBio; version 1.0.analytic_bar")
        return 0
    given = dict(zip(sys.argv[1::2], sys.argv[2::2], strict=False))
    try:
        solve(Path(), given["-i"])
    except (ArithmeticError, AttributeError, ElementTree.ParseError, KeyError, TypeError, ValueError) as error:
        print(f"the analytic bar cannot compute this input: {error!r}")
        return 1
    Path(given["-o"]).write_text("by the analytic bar, not by FEBio\n N O R M A L   T E R M I N A T I O N\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
