"""How a FEBio model is loaded as its author saved it: how long, in how many steps, and how far a part is moved."""

import math
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from itertools import pairwise

from sinew.runner.errors import BadInput, shown
from sinew.tasks.simulate.febio.model_file.contents import Moved, is_id
from sinew.tasks.simulate.febio.model_file.source import Element, Source
from sinew.tasks.simulate.febio.units import MILLIMETRES, UNITS

MOST_POINTS = 5_000  # of the history in a study


@dataclass(frozen=True)
class Loading:
    """The time of a run (s), its ``points`` in time, and the corners of a displacement history (mm)."""

    time_s: tuple[float, ...]
    displacement_mm: tuple[float, ...]
    points: int
    step_s: float


def controls(source: Source) -> list[Element]:
    """The control sections of a model: its own, or those of its steps."""
    found = source.section("Control")
    steps = [step.find("Control") for section in source.root.all("Step") for step in (*section.all("step"), section)]
    return [one for one in (found, *steps) if one is not None]


def units(source: Source) -> tuple[str, float, float]:
    """The model's system of units, a millimetre in its unit of length and its unit of force in newtons.

    A model that names none has millimetres and newtons. Raises :class:`BadInput` for a system that is not known.
    """
    module = source.section("Module")
    named = module.find("units") if module is not None else None
    name = named.text if named is not None and named.text else MILLIMETRES
    if name not in UNITS:
        raise BadInput(source.path, f"units {shown(name)} are not known", f"one of {', '.join(UNITS)}")
    return name, *UNITS[name]


def loading_of(source: Source, moved: Moved | None, factor: float) -> Loading:
    """The run as saved, and how far ``moved`` goes in it, divided by ``factor``. Raises :class:`BadInput`."""
    spans = [_span(source, control) for control in controls(source)]
    if not spans:
        raise BadInput(source.path, "has no Control section", "a model that FEBio can run")
    end, steps = sum(n * dt for n, dt in spans), round(sum(n for n, _ in spans))
    points = min(max(steps + 1, 3), MOST_POINTS)
    if moved is None:
        return Loading((0.0, end), (0.0, 0.0), points, end / (points - 1))
    corners = [(t, moved.factor * value / factor) for t, value in _curve(source, moved)]
    within = [(t, u) for t, u in corners if 0 < t < end]
    history = [(0.0, _at(corners, 0.0)), *within, (end, _at(corners, end))]
    if history[0][1] != 0:
        problem = f"{shown(moved.name)} starts displaced, by {history[0][1]:g} mm"
        raise BadInput(source.path, problem, "a displacement that starts at 0 at time 0")
    times, displacements = zip(*history, strict=True)
    return Loading(times, displacements, points, end / (points - 1))


def _span(source: Source, control: Element) -> tuple[float, float]:
    """The number of steps of a control section and their length (s)."""
    numbers = {}
    for tag, default in (("time_steps", math.nan), ("step_size", math.nan), ("final_time", 0.0)):
        element = control.find(tag)
        try:
            numbers[tag] = default if element is None else float(element.text)
        except ValueError:
            numbers[tag] = math.nan
    steps, step, end = numbers["time_steps"], numbers["step_size"], numbers["final_time"]
    if steps <= 0 < end and step > 0:
        steps = end / step
    if not (0 < steps < 1e9 and 0 < step < 1e12):
        raise BadInput(source.path, "its Control section tells no duration", "time_steps and step_size")
    return steps, step


def _curve(source: Source, moved: Moved) -> list[tuple[float, float]]:
    """The points of the load curve that moves something. Raises :class:`BadInput` for what is no such curve."""
    expected = "a load curve with LINEAR or SMOOTH interpolation and constant ends"
    controller = next(_controllers(source, moved.controller), None)
    if controller is None or controller.attributes.get("type") != "loadcurve":
        raise BadInput(source.path, f"{shown(moved.name)} follows no load curve", expected)
    kinds = [found.text for tag in ("interpolate", "extend") if (found := controller.find(tag)) is not None]
    if not set(kinds) <= {"LINEAR", "SMOOTH", "CONSTANT"}:
        raise BadInput(source.path, f"the load curve of {shown(moved.name)} is {shown(' and '.join(kinds))}", expected)
    points = controller.find("points")
    curve: list[tuple[float, float]] = []
    with suppress(ValueError):
        for one in points.children if points is not None else ():
            time, value = map(float, one.text.split(","))
            curve.append((time, value))
    if not curve or any(b[0] <= a[0] for a, b in pairwise(curve)) or len(curve) > MOST_POINTS:
        raise BadInput(source.path, f"the points of {shown(moved.name)}'s load curve cannot be read", expected)
    return curve


def _controllers(source: Source, number: int) -> Iterator[Element]:
    section = source.section("LoadData")
    for one in section.all("load_controller") if section is not None else ():
        if one.attributes.get("id") == str(number):
            yield one


def next_controller(source: Source) -> int:
    """A number that no load controller has."""
    section = source.section("LoadData")
    taken = [one.attributes.get("id", "") for one in section.children] if section is not None else []
    return 1 + max((int(number) for number in taken if is_id(number)), default=0)


def _at(corners: list[tuple[float, float]], time: float) -> float:
    before = [corner for corner in corners if corner[0] <= time]
    after = [corner for corner in corners if corner[0] > time]
    if not before or not after:
        return (before[-1] if before else after[0])[1]
    (t0, u0), (t1, u1) = before[-1], after[0]
    return u0 + (u1 - u0) * (time - t0) / (t1 - t0)
