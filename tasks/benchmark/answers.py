"""What is hidden in each case of a folder: ``answers.json`` beside the case folders. For scoring only.

The file is an object by case: ``truth`` (slugs of effects, or ``["OUTSIDE"]``, or nothing), ``magnitude`` (numbers by
name), and optionally ``case`` (a label), ``noise_fraction_of_peak``, ``noise_ar1``, ``specimens`` (their true
parameters), ``same_form`` (true values by the names of the library's parameters) and ``becomes``: the truth of a case
from outside once the library has what is hidden there. A compound case has ``outside``, what is hidden beside effects
of the library (kinds that the library has by now are effects), and ``strength`` by effect or kind: its trace in the
forces that neither the model's parameters nor the rest can imitate, root mean square in units of the noise.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from sinew.runner.errors import BadInput, shown
from sinew.tasks.data.cohort import NAME, read_json
from sinew.tasks.model.effects import library

ANSWERS = "answers.json"
OUTSIDE = "OUTSIDE"

#: By effect: parameter of the library -> magnitude in the answers, and its sign. Only where the hidden cohorts follow
#: the library's own equation: with these values and the true parameters, the embedded simulator leaves their noise and
#: nothing else. (preload: but for a start at which the fibres have not relaxed yet.) Softening, permanent set, fatigue
#: and slip are hidden in other forms, whose numbers have no counterpart in the library; the dashpot is one of nominal
#: stress and strain there, so that its viscosity is a few per cent larger.
SAME_FORM: Mapping[str, Mapping[str, tuple[str, float]]] = {
    "area-error": {"area_factor": ("factor", 1.0)},
    "force-drift": {"force_offset": ("offset_N", 1.0), "force_slope": ("N_per_s", 1.0)},
    "machine-compliance": {"compliance": ("mm_per_N", 1.0)},
    "preload": {"preload_stretch": ("stretch", 1.0)},
    "relaxation-mode": {"g_4f": ("g", 1.0), "tau_4f": ("tau", 1.0)},
    "strain-dependent-relaxation": {"slowing_per_strain": ("k", -1.0)},
    "time-lag": {"force_lag": ("seconds", 1.0)},
    "toe-exponent": {"toe_exponent": ("beta", 1.0)},
    "toe-slack": {"slack_stretch": ("stretch", 1.0)},
}


@dataclass(frozen=True)
class Answer:
    """What is hidden in a case. ``same_form``: true values of the library's parameters, where they have one.

    ``strength`` and what is hidden ``beside`` effects of the library are those of a compound case, empty for others.
    """

    folder: str
    case: str
    truth: tuple[str, ...]
    label: str = ""
    magnitude: Mapping[str, float] = field(default_factory=dict)
    same_form: Mapping[str, float] = field(default_factory=dict)
    strength: Mapping[str, float] = field(default_factory=dict)
    beside: tuple[str, ...] = ()

    @property
    def compound(self) -> bool:
        """Whether it is known how far each effect, and what is hidden beside them, can be seen."""
        return bool(self.strength)

    @property
    def name(self) -> str:
        return f"{self.folder}/{self.case}"

    @property
    def outside(self) -> bool:
        return self.truth == (OUTSIDE,)


def read_answers(folder: Path) -> list[Answer]:
    """All cases of a folder, in order of name. Raises :class:`BadInput` for the first thing that is wrong."""
    if not folder.is_dir():
        problem = "is a file" if folder.exists() else "is not there"
        raise BadInput(folder, problem, f"a folder with {ANSWERS} and case folders")
    path = folder / ANSWERS
    if not path.is_file():
        raise BadInput(path, "is not there", "an object with the truth of each case")
    content = read_json(path, folder)
    if not content:
        raise BadInput(path, "holds no case", 'an object such as {"case_01": {"truth": ["toe-slack"], ...}}')
    name = folder.resolve().name
    answers = [_answer(path, name, case, entry) for case, entry in sorted(content.items())]
    for answer in answers:
        if not (folder / answer.case).is_dir():
            raise BadInput(folder / answer.case, "is not there", f"the cohort of a case in {path}")
    return answers


def _answer(path: Path, folder: str, case: str, entry: Any) -> Answer:
    where = f"{path}: {shown(case)[1:-1]}"
    if not NAME.fullmatch(case):
        raise BadInput(where, "a name that cannot be used", "the name of a case folder")
    if not isinstance(entry, dict):
        raise BadInput(where, f"holds {shown(entry)}", "an object with truth and magnitude")
    truth = _truth(f"{where}.truth", entry)
    magnitude = _numbers(f"{where}.magnitude", entry.get("magnitude", {}))
    label = entry.get("case", "")
    if not isinstance(label, str):
        raise BadInput(f"{where}.case", shown(label), "a text")
    beside = entry.get("outside", [])
    if not isinstance(beside, list) or not all(isinstance(one, str) for one in beside):
        raise BadInput(f"{where}.outside", shown(beside), "a list of names")
    strength = _numbers(f"{where}.strength", entry.get("strength", {}))
    if strength and (unknown := sorted({*truth, *beside} - set(strength))):
        raise BadInput(f"{where}.strength.{shown(unknown[0])[1:-1]}", "missing", "a number for each effect and kind")
    if strength:
        truth = (*truth, *(one for one in beside if one in library() and one not in truth))
        beside = [one for one in beside if one not in library()]
    same_form = _same_form(truth, magnitude)
    if "same_form" in entry:
        same_form = _numbers(f"{where}.same_form", entry["same_form"])
        known = {parameter.name for effect in library().values() for parameter in effect.parameters}
        if unknown := sorted(set(same_form) - known):
            raise BadInput(f"{where}.same_form.{unknown[0]}", "unknown parameter", f"one of {', '.join(sorted(known))}")
    return Answer(folder, case, truth, label, magnitude, same_form, strength, tuple(beside))


def _truth(where: str, entry: Mapping[str, Any]) -> tuple[str, ...]:
    if "truth" not in entry:
        raise BadInput(where, "missing", f'a list of effects, ["{OUTSIDE}"], or []')
    truth = entry["truth"]
    if not isinstance(truth, list) or not all(isinstance(one, str) for one in truth):
        raise BadInput(where, shown(truth), f'a list of effects, ["{OUTSIDE}"], or []')
    if truth == [OUTSIDE]:
        becomes = entry.get("becomes") or []
        known = isinstance(becomes, list) and all(isinstance(slug, str) and slug in library() for slug in becomes)
        return tuple(becomes) if becomes and known else (OUTSIDE,)
    for slug in truth:
        if slug not in library():
            raise BadInput(where, f"{shown(slug)} is no effect", f"{OUTSIDE} alone, or some of {', '.join(library())}")
    if len(set(truth)) < len(truth):
        raise BadInput(where, shown(truth), "each effect once")
    return tuple(truth)


def _numbers(where: str, numbers: Any) -> dict[str, float]:
    if not isinstance(numbers, dict):
        raise BadInput(where, shown(numbers), "an object of numbers by name")
    for name, value in numbers.items():
        if isinstance(value, bool) or not isinstance(value, int | float) or not _is_finite(value):
            raise BadInput(f"{where}.{name}", shown(value), "a finite number")
    return {name: float(value) for name, value in numbers.items()}


def _is_finite(value: float) -> bool:
    try:
        return math.isfinite(value)
    except OverflowError:  # an integer of hundreds of digits
        return False


def _same_form(truth: Iterable[str], magnitude: Mapping[str, float]) -> dict[str, float]:
    """True values by the library's parameters, of the effects whose form is the library's."""
    return {
        parameter: sign * magnitude[name]
        for slug in truth
        for parameter, (name, sign) in SAME_FORM.get(slug, {}).items()
        if name in magnitude
    }
