"""Effects of the machine, planted in measured curves: the verdict with and without must differ by exactly the effect.

``python -m tests.hidden.planted COHORT --base STUDY --out FOLDER`` plants each effect in turn in the curves of a cohort
and runs ``discover`` on the curves as they are and on the planted ones. An effect is planted so large that what neither
the model's parameters nor another effect of the library can imitate is the asked times the noise. What a machine does
to a record needs no model of the tissue, so this works on curves of real tissue, whatever that is.
"""

import json
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import click
import numpy as np
from scipy.signal import savgol_filter

import sinew
from sinew.tasks.data.cohort import read_cohort, write_cohort
from sinew.tasks.data.noise import noise_of_all
from sinew.tasks.discover.fit.candidate import Candidate
from sinew.tasks.discover.fit.fit import WIDTH, derivatives, fit, residuals, starts
from sinew.tasks.discover.fit.sizes import library_for
from sinew.tasks.fitting.measured import Measured
from sinew.tasks.model import Curve, Specimen
from sinew.tasks.study.model import model_of
from sinew.tasks.study.study import Study, read_study

SMALL = 1e-3  # of the unit size, at which signatures are in proportion to the size
STARTS = 4
STILL = 0.02  # of the largest speed: a machine that is slower holds
WINDOW = 15  # points over which forces are smoothed that move something: a machine does not shake as a load cell does

Planted = Callable[[Curve, float], Curve]
"""A curve as the machine would have recorded it, with an effect of some size."""


def spring(curve: Curve, size: float) -> Curve:
    """Frame and grips give way by ``size`` of the largest displacement under the largest force."""
    moved, force = curve.protocol.displacement_mm, _smooth(curve)
    lost = size * np.abs(moved).max() * force / np.abs(force).max()
    return _moved(curve, moved + lost)


def slip(curve: Curve, size: float) -> Curve:
    """The specimen slips by ``size`` of the largest displacement, in proportion to the pull and the time so far."""
    time, moved, pull = curve.protocol.time_s, curve.protocol.displacement_mm, np.maximum(_smooth(curve), 0.0)
    impulse = np.cumsum(pull * np.diff(time, prepend=time[0]))
    return _moved(curve, moved + size * np.abs(moved).max() * impulse / impulse[-1])


def drift(curve: Curve, size: float) -> Curve:
    """The load cell drifts by ``size`` of the largest force until the end of the test."""
    past = curve.protocol.time_s - curve.protocol.time_s[0]
    return replace(curve, force_N=curve.force_N + size * np.abs(curve.force_N).max() * past / past[-1])


def lag(curve: Curve, size: float) -> Curve:
    """The force comes late by ``size`` seconds."""
    time = curve.protocol.time_s
    return replace(curve, force_N=np.interp(time - size, time, curve.force_N))


def rub(curve: Curve, size: float) -> Curve:
    """A bearing rubs with ``size`` of the largest force against the last movement, in holds as well."""
    speed = np.gradient(curve.protocol.displacement_mm, curve.protocol.time_s)
    moves = np.abs(speed) > STILL * np.abs(speed).max()
    last = np.maximum.accumulate(np.where(moves, np.arange(speed.size), 0))
    way = np.where(moves[last], np.sign(speed[last]), 0.0)
    return replace(curve, force_N=curve.force_N + size * np.abs(curve.force_N).max() * way)


EFFECTS: Mapping[str, Planted] = {
    "machine-compliance": spring,
    "grip-slip": slip,
    "force-drift": drift,
    "time-lag": lag,
    "friction": rub,
}


def _smooth(curve: Curve) -> np.ndarray:
    return np.asarray(savgol_filter(curve.force_N, min(WINDOW, curve.force_N.size // 2 * 2 - 1), 2))


def _moved(curve: Curve, displacement: np.ndarray) -> Curve:
    return replace(curve, protocol=replace(curve.protocol, displacement_mm=displacement))


def planted(specimen: Specimen, effect: str, size: float) -> Specimen:
    """The specimen with an effect in all of its curves."""
    return replace(specimen, curves=tuple(EFFECTS[effect](curve, size) for curve in specimen.curves))


def strength(base: Candidate, measured: Measured, effect: str) -> float:
    """Root mean square of an effect of size one, in units of the noise, less what can imitate it.

    That are the model's parameters together with any one other effect of the library, to first order at the fit of the
    bare model; the effect that imitates best counts.
    """
    fits = (fit(base, measured, start) for start in starts(base, np.random.default_rng(0), STARTS))
    at = min(fits, key=lambda one: one.loss).at
    trace = _signature(base, measured, at, effect) / SMALL
    left = []
    for other in library_for([measured.specimen]).values():
        for form in (other, *other.other_forms):
            if other.slug != effect:
                candidate = base.having(form)
                point = np.concatenate([at, candidate.typical()])
                _, slopes = derivatives(candidate, measured, point, measured.curves)
                left.append(_unlike(trace, slopes))
    return min(left)


def _signature(base: Candidate, measured: Measured, at: np.ndarray, effect: str) -> np.ndarray:
    """How whitened residuals ``[g]`` of a fit change with an effect of a small size."""
    changed = planted(measured.specimen, effect, SMALL)
    found = []
    for one in (measured, Measured(changed, measured.noise)):
        groups = [residuals(base, one, at[np.newaxis], [curve])[0] for curve in one.curves]
        found.append(groups)
    return np.concatenate([after - before for before, after in zip(*found, strict=True)])


def _unlike(trace: np.ndarray, slopes: np.ndarray) -> float:
    """Root mean square of what is left of a trace ``[g]`` where slopes ``[g, k]`` imitate it as well as they can."""
    basis, sizes, _ = np.linalg.svd(slopes, full_matrices=False)
    along = basis.T @ trace
    rest = trace - basis @ (along * sizes**2 / (sizes**2 + WIDTH))
    return float(np.sqrt(np.mean(rest**2)))


@click.command()
@click.argument("cohort", type=click.Path(exists=True, file_okay=False, path_type=Path))
@click.option("--base", type=click.Path(exists=True, path_type=Path), required=True, help="Study that is asked.")
@click.option("--out", type=click.Path(path_type=Path), required=True, help="Folder to write.")
@click.option("--effect", "effects", multiple=True, type=click.Choice(list(EFFECTS)), help="Only these.")
@click.option("--strength", "wanted", default=3.0, show_default=True, help="Times the noise, of what nothing imitates.")
@click.option("--workers", type=click.IntRange(1), default=2, show_default=True)
def main(cohort: Path, base: Path, out: Path, effects: tuple[str, ...], wanted: float, workers: int) -> None:
    """Write ``planted.json``: a row for each effect, with the verdicts with and without it."""
    specimens = read_cohort(cohort).specimens
    study = read_study(base)
    bare = Candidate(model_of(study.model, study.simulator.law))
    measured = [Measured(one, noise_of_all(one.curves)) for one in specimens]
    without = _verdict(study, cohort, out / "as_is", workers)
    print(json.dumps({"effect": None, **without}), flush=True)
    rows = []
    for effect in effects or EFFECTS:
        size = wanted / float(np.median([strength(bare, one, effect) for one in measured]))
        write_cohort(out / f"{effect}-cohort", [planted(one, effect, size) for one in specimens])
        having = _verdict(study, out / f"{effect}-cohort", out / effect, workers)
        added = sorted(set(having["effects"]) ^ set(without["effects"]))
        rows.append({"effect": effect, "size": size, **having, "differs_by": added, "right": added == [effect]})
        print(json.dumps(rows[-1]), flush=True)
        (out / "planted.json").write_text(json.dumps({"as_is": without, "rows": rows}, indent=1) + "\n", "utf-8")
    print(f"{sum(row['right'] for row in rows)} of {len(rows)} differ by exactly the effect")


def _verdict(study: Study, cohort: Path, out: Path, workers: int) -> dict[str, Any]:
    """The verdict on a cohort, and which effects it names."""
    try:
        results = sinew.run(study, "discover", out=out, data=cohort, workers=workers)
    except sinew.BadInput as problem:  # such as a size that the study's ranges cannot reach
        raise click.UsageError(str(problem)) from None
    told = json.loads((results.folder / "verdict.json").read_text("utf-8"))
    return {"verdict": told["verdict"], "effects": sorted(told["effects"]), "explained": told["explained"]}


if __name__ == "__main__":
    main()
