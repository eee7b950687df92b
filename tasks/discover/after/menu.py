"""Tests that a laboratory could do next: variations of what was done so far."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sinew.tasks.model import Protocol, Specimen
from sinew.tasks.model.phases import is_compression, phases
from sinew.tasks.model.protocols import HOLD_S, STRAIN_RATE

AT_ALL = 0.1  # of the median strain: a specimen that moved less was not tested
BEYOND = 0.01  # strain on the other side of the gauge length
REST_S = 600.0
CYCLES, FAST_CYCLES, STEPS = 30, 10, 5


@dataclass(frozen=True)
class Usual:
    """What was done so far.

    ``strain``: the largest that every specimen has borne, below 0 in compressions. ``rate``: of strain (1/s).
    ``hold_s``: the longest hold. ``interval_s``: between samples.
    """

    strain: float
    rate: float
    hold_s: float
    interval_s: float


@dataclass(frozen=True)
class Leg:
    """Move to ``strain`` at a strain ``rate`` (1/s), and stay for ``hold_s``."""

    strain: float
    rate: float
    hold_s: float = 0.0


@dataclass(frozen=True)
class Test:
    """A test that could be done: ``legs`` from the gauge length on, and ``words`` for the one who does it.

    ``length`` and ``width``: of the specimen in parts of its present ones.
    """

    __test__ = False  # for pytest: this is no test of the code

    name: str
    words: str
    legs: tuple[Leg, ...]
    interval_s: float
    length: float = 1.0
    width: float = 1.0

    def protocol(self, length_mm: float) -> Protocol:
        """The displacement history for a gauge length (mm) as it is in this test."""
        times, strains = [0.0], [0.0]
        for leg in self.legs:
            times.append(times[-1] + abs(leg.strain - strains[-1]) / leg.rate)
            strains.append(leg.strain)
            if leg.hold_s:
                times.append(times[-1] + leg.hold_s)
                strains.append(leg.strain)
        time_s = self.interval_s * np.arange(int(np.floor(times[-1] / self.interval_s + 1e-9)) + 1)
        return Protocol(self.name, time_s, length_mm * np.interp(time_s, times, strains))

    def specimen(self, specimen: Specimen) -> Specimen:
        """The specimen as it is in this test, without curves."""
        return replace(
            specimen,
            length_mm=self.length * specimen.length_mm,
            width_mm=self.width * specimen.width_mm,
            curves=(),
        )


def usual(specimens: Sequence[Specimen]) -> Usual:
    """What was done to specimens so far: medians over them, but the smallest of their strains, which none breaks at.

    Without holds or ramps, those of the published tests.
    """
    strains, rates, holds, intervals = [], [], [], []
    for specimen in specimens:
        longest = []
        for curve in specimen.curves:
            time, strain = curve.protocol.time_s, curve.protocol.displacement_mm / specimen.length_mm
            intervals.append(float(np.median(np.diff(time))))
            for phase in phases(curve.protocol):
                lasts = float(time[phase.stop - 1] - time[phase.start])
                if phase.kind == "hold":
                    longest.append(lasts)
                elif phase.kind == "load":
                    rates.append(abs(float(strain[phase.stop - 1] - strain[phase.start])) / lasts)
        moved = np.concatenate([curve.protocol.displacement_mm for curve in specimen.curves])
        squeezed = all(is_compression(curve.protocol) for curve in specimen.curves)
        strains.append(float(moved.min() if squeezed else moved.max()) / specimen.length_mm)
        holds += [max(longest)] if longest else []
    sign = np.sign(np.sum(np.sign(strains))) or 1.0  # that of most specimens
    usual_strain = float(np.median([strain for strain in strains if strain * sign >= 0.0]))
    moved_at_all = [strain for strain in strains if strain * sign >= AT_ALL * abs(usual_strain)]
    return Usual(
        float(min(moved_at_all, key=abs)),
        float(np.median(rates)) if rates else STRAIN_RATE,
        float(np.median(holds)) if holds else HOLD_S,
        float(np.median(intervals)),
    )


def menu(known: Usual) -> tuple[Test, ...]:
    """Tests that a machine can do that did what is ``known``; none where nothing moved."""
    s, r, h = known.strain, known.rate, known.hold_s
    if not s or not r:
        return ()
    squeezed = s < 0.0
    verb, beyond = ("compress", BEYOND) if squeezed else ("stretch", -BEYOND)
    to, hold = f"{verb} to {_percent(s)} strain at {_percent(r)} per second", f"hold for {h:.0f} s"
    faster, slower = (f"{verb} to {_percent(s)} strain at {_percent(one)} per second" for one in (10 * r, r / 10))
    back = f"back to the gauge length at {_percent(r)} per second"
    up, down = Leg(s, r), Leg(0.0, r)
    steps = tuple(Leg(s * i / STEPS, r, h / STEPS) for i in range(1, STEPS + 1))
    once = (Leg(s, r, h), down)
    tests = (
        ("the usual test again", f"{to}, {hold}, {back}", once),
        ("faster ramp", f"{faster}, {hold}", (Leg(s, 10 * r, h),)),
        ("slower ramp", f"{slower}, {hold}", (Leg(s, r / 10, h),)),
        ("longer hold", f"{to}, hold for {5 * h:.0f} s", (Leg(s, r, 5 * h),)),
        (
            "larger compression" if squeezed else "larger stretch",
            f"{verb} to {_percent(1.25 * s)} strain at {_percent(r)} per second, {hold}, {back}",
            (Leg(1.25 * s, r, h), down),
        ),
        ("many cycles", f"{CYCLES} times: {to}, {back}, without pauses", (up, down) * CYCLES),
        (
            "fast cycles",
            f"{FAST_CYCLES} times: {faster} and back to the gauge length as fast, without pauses",
            (Leg(s, 10 * r), Leg(0.0, 10 * r)) * FAST_CYCLES,
        ),
        (
            "tension" if squeezed else "compression",
            f"{to}, unload at the same rate beyond the gauge length to {_percent(beyond)} strain, "
            f"hold for {h / 10:.0f} s, return to the gauge length",
            (up, Leg(beyond, r, h / 10), down),
        ),
        (
            "rest and repetition",
            f"{to}, {hold}, {back}, rest there for {REST_S:.0f} s, then the same once more",
            (Leg(s, r, h), Leg(0.0, r, REST_S), Leg(s, r, h), down),
        ),
        ("five steps", f"{verb} in {STEPS} steps to {_percent(s)} strain at {_percent(r)} per second, hold for "
         f"{h / STEPS:.0f} s after each", steps),
        (
            "recovery",
            f"{to}, {hold}, unload at the same rate to {_percent(s / 2)} strain, hold there for {2 * h:.0f} s",
            (Leg(s, r, h), Leg(s / 2, r, 2 * h)),
        ),
    )  # fmt: skip
    chosen = [Test(name, words, legs, known.interval_s) for name, words, legs in tests]
    chosen.append(
        Test("half the gauge length", f"grip the specimen at half its gauge length, {to}, {hold}, {back}", once,
             known.interval_s, length=0.5)
    )  # fmt: skip
    chosen.append(
        Test("half the width", f"cut the specimen to half its width along the fibres, {to}, {hold}, {back}", once,
             known.interval_s, width=0.5)
    )  # fmt: skip
    return tuple(chosen)


def _percent(strain: float) -> str:
    return f"{100 * strain:.3g} %"
