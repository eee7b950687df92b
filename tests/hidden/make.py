"""Folders of cohorts with something hidden, as ``sinew benchmark discover`` takes them: same seed, same bytes."""

import json
import shutil
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from sinew.tasks.data.cohort import write_cohort
from sinew.tasks.model import Curve, Model, Protocol, Specimen
from sinew.tasks.model.effect import Effect, model_with
from sinew.tasks.model.effects import library
from sinew.tasks.model.protocols import STANDARD
from sinew.tasks.simulate.febio.attempt import solver_version
from sinew.tasks.simulate.febio.simulator import FEBio
from sinew.tasks.simulate.febio.tendon import read_template
from tests.hidden.bar import BARE, both, pull
from tests.hidden.forms import FORMS, OUTSIDE, PAIRS, Form, Hidden, Random

SIZE_MM, SCATTER = (10.0, 8.0, 4.0), 0.04
SPECIMENS = ("s01", "s02")
SMALL = 0.005  # of what can be seen
SOFTEST_TOE = 4000.0  # alpha_f, at most
#: What is hidden in 24 cases, in this order and over again.
KINDS = (
    *("one", "null", "one", "pair", "one", "outside", "one", "one", "small", "one", "outside", "one"),
    *("null", "one", "pair", "one", "outside", "one", "one", "pair", "one", "small", "one", "null"),
)


@dataclass(frozen=True)
class Plan:
    """What is hidden in a case: names of forms, none in a null, and how large it is."""

    forms: tuple[str, ...]
    size: float = 1.0


def plans(cases: int, rng: Random) -> list[Plan]:
    """What is hidden in each case: nulls, single effects, pairs, effects too small to be seen, and things outside."""
    deck = {"one": _deck(FORMS, rng), "outside": _deck(OUTSIDE, rng), "small": _deck(FORMS, rng)}
    pairs = [PAIRS[i] for i in rng.permutation(len(PAIRS))]
    found = []
    for number in range(cases):
        kind = KINDS[number % len(KINDS)]
        before = sum(KINDS[i % len(KINDS)] == kind for i in range(number))
        if kind == "null":
            found.append(Plan(()))
        elif kind == "pair":
            found.append(Plan(pairs[before % len(pairs)]))
        else:
            found.append(Plan((deck[kind][before % len(deck[kind])],), SMALL if kind == "small" else 1.0))
    return [found[i] for i in rng.permutation(cases)]


def _deck(forms: dict[str, Form], rng: Random) -> list[str]:
    return [list(forms)[i] for i in rng.permutation(len(forms))]


def write(folder: Path, chosen: Sequence[Plan], seed: int, rate_hz: float = 10.0, simulator: str = "own") -> None:
    """Write cases and ``answers.json``. ``simulator``: ``own``, or ``febio`` for what the solver can do."""
    answers = {}
    for number, plan in enumerate(chosen, 1):
        rng = np.random.default_rng([seed, number])
        case = f"case_{number:02d}"
        specimens, answers[case] = (febio_case if simulator == "febio" else own_case)(plan, rng, rate_hz)
        answers[case]["seed"] = seed
        write_cohort(folder / case, specimens)
    (folder / "answers.json").write_text(json.dumps(answers, indent=1) + "\n", "utf-8")


def hidden_in(plan: Plan, rng: Random) -> Hidden:
    """The physics of a case and its numbers."""
    physics, magnitude, same_form = BARE, {}, {}
    for name in plan.forms:
        made = {**FORMS, **OUTSIDE}[name].make(rng, plan.size)
        physics = both(physics, made.physics)
        magnitude |= made.magnitude
        same_form |= made.same_form
    return Hidden(physics, magnitude, same_form)


def own_case(plan: Plan, rng: Random, rate_hz: float) -> tuple[list[Specimen], dict[str, Any]]:
    """Specimens with noise, and the answer, by the integration of :mod:`tests.hidden.bar`."""
    hidden = hidden_in(plan, rng)
    bare, truth = _specimens(rng)
    pulled = []
    for one in bare:
        size = (one.length_mm, one.width_mm, one.thickness_mm)
        protocols = [make(one.length_mm, rate_hz) for make in STANDARD]
        pulled.append(
            [(p, pull(truth[one.name], size, p.time_s, p.displacement_mm, hidden.physics)) for p in protocols]
        )
    told = {
        "case": "+".join(plan.forms) or "none",
        "truth": [{**FORMS, **OUTSIDE}[name].truth for name in plan.forms],
        "magnitude": hidden.magnitude,
        "same_form": hidden.same_form,
        "size": plan.size,
    }
    return _measured(bare, pulled, truth, told, rng)


def febio_case(plan: Plan, rng: Random, rate_hz: float) -> tuple[list[Specimen], dict[str, Any]]:
    """The same by the real solver, for effects of the library that it has; others become a null."""
    effects = tuple(e for e in (_in_febio(name) for name in plan.forms) if e is not None)
    values = {name: value for effect in effects for name, value in _values(effect, plan.size, rng).items()}
    bare, truth = _specimens(rng)
    model = model_with(Model(), effects)
    pulled = []
    scratch = Path(tempfile.mkdtemp(prefix="hidden-"))
    try:
        solver = _solver(scratch).with_effects(effects)
        for one in bare:
            row = np.array([[(truth[one.name] | values)[name] for name in model.names]])
            protocols = [make(one.length_mm, rate_hz) for make in STANDARD]
            done = [(p, solver.simulate(model, one, p, row)) for p in protocols]
            if failed := [result.messages[0] for _, result in done if result.status[0]]:
                raise RuntimeError(f"{plan}: {failed[0]}")
            pulled.append([(p, result.force_N[0]) for p, result in done])
    finally:
        shutil.rmtree(scratch, ignore_errors=True)
    told = {
        "case": "+".join(f"febio-{effect.slug}" for effect in effects) or "none",
        "truth": [effect.slug for effect in effects],
        "magnitude": values,
        # the solver's plastic flow is in three dimensions, so its numbers are not those of the embedded form
        "same_form": {} if any(effect.slug == "permanent-set" for effect in effects) else values,
        "size": plan.size,
    }
    return _measured(bare, pulled, truth, told, rng)


def _in_febio(name: str) -> Effect | None:
    effect = library().get({**FORMS, **OUTSIDE}[name].truth)
    return effect if effect is not None and effect.febio else None


def _values(effect: Effect, size: float, rng: Random) -> dict[str, float]:
    """Values between the null and what is typical, or a third beyond."""
    found = {}
    for parameter, null in zip(effect.parameters, effect.null_values, strict=True):
        share = size * rng.uniform(0.7, 1.3) if parameter.name in effect.null else rng.uniform(0.7, 1.3)
        reference = null + share * (parameter.reference - null)
        if parameter.name not in effect.null:
            reference = parameter.reference * share
        found[parameter.name] = float(np.clip(reference, parameter.minimum, parameter.maximum))
    return found


def _solver(scratch: Path) -> FEBio:
    executable = shutil.which("febio4")
    if executable is None:
        raise SystemExit("febio4 is not on the PATH")
    return FEBio(executable, solver_version(Path(executable)), read_template(Path(), None), scratch)


def _specimens(rng: Random) -> tuple[list[Specimen], dict[str, dict[str, float]]]:
    """Bars that nobody has seen before, and their parameters, inside the ranges of the model."""
    bars, truth = [], {}
    for name in SPECIMENS:
        length, width, thickness = (round(float(size * (1 + SCATTER * rng.standard_normal())), 4) for size in SIZE_MM)
        bars.append(Specimen(name, length, width, thickness))
        truth[name] = {
            p.name: float(rng.uniform(p.minimum, min(p.maximum, SOFTEST_TOE) if p.name == "alpha_f" else p.maximum))
            for p in Model().parameters
        }
    return bars, truth


def _measured(
    bare: Sequence[Specimen],
    pulled: Sequence[Sequence[tuple[Protocol, np.ndarray]]],
    truth: dict[str, dict[str, float]],
    told: dict[str, Any],
    rng: Random,
) -> tuple[list[Specimen], dict[str, Any]]:
    """The specimens with noise on their forces, and the answer."""
    level, ar1 = float(rng.uniform(0.001, 0.006)), float(rng.uniform(0.0, 0.9))
    scale = level * max(float(force.max()) for each in pulled for _, force in each)
    specimens = [
        replace(one, curves=tuple(Curve(p, force + scale * _noise(rng, force.size, ar1)) for p, force in each))
        for one, each in zip(bare, pulled, strict=True)
    ]
    return specimens, {**told, "noise_fraction_of_peak": level, "noise_ar1": ar1, "specimens": truth}


def _noise(rng: Random, count: int, ar1: float) -> np.ndarray:
    """Stationary noise of unit variance, whose neighbours correlate by ``ar1``."""
    found = rng.standard_normal(count)
    for i in range(1, count):
        found[i] = ar1 * found[i - 1] + np.sqrt(1.0 - ar1**2) * found[i]
    return found
