"""How the totals of fits are told: in newton, or for several quantities beside what noise alone leaves."""

import io
from dataclasses import replace
from pathlib import Path

import pytest
from rich.console import Console

from sinew.tasks.calibrate.prose import methods
from sinew.tasks.calibrate.result import MethodFit, QuantityFit
from sinew.tasks.calibrate.show import headline, in_words, summary, unfinished
from sinew.tasks.drawing.blocks import span
from tests.tasks.calibrations import calibration_of, fit_of

PROTOCOLS = {"one_step": 1.0, "two_step": 1.0, "cyclic": 1.0}
BOTH = {"force": QuantityFit("N", 1.0, PROTOCOLS, {}), "lateral_strain": QuantityFit("1", 0.001, PROTOCOLS, {})}


def alone(total_N: float):
    return fit_of({"E_f": 200.0}, total_N=total_N, noise_N=3.0)


def compared(objective: float, **changes):
    return fit_of({"E_f": 200.0}, total_N=9.0, objective=objective, quantities=BOTH, **changes)


def test_long_names_of_specimens_are_whole_on_a_narrow_terminal():
    names = ("Haut_Rohdaten_Haut_01", "Haut_Rohdaten_Haut_02")
    said = io.StringIO()
    summary(calibration_of({name: alone(3.2) for name in names}), Path(), Console(file=said, width=80))
    column = "".join(line.split("│")[1].strip() for line in said.getvalue().splitlines() if line.startswith("│"))
    assert column == "".join(names)


@pytest.mark.parametrize(
    ("fits", "words"),
    [
        ([alone(3.2)], "1 specimen, RMSE 3.2 N"),
        ([alone(3.2), alone(3.2001)], "2 specimens, RMSE 3.2 N"),
        ([alone(3.3), alone(3.2)], "2 specimens, RMSE 3.2 to 3.3 N"),
        ([compared(6.02)], "1 specimen, objective 6.02 (noise alone: 6)"),
        ([compared(6.5), compared(5.9)], "2 specimens, objective 5.9 to 6.5 (noise alone: 6)"),
        ([compared(0.1, above_noise=None)], "1 specimen, objective 0.1"),
    ],
)
def test_the_headline(fits, words):
    assert headline(calibration_of({str(number): fit for number, fit in enumerate(fits)})) == words


def test_what_noise_leaves_is_told_where_specimens_differ():
    one = {name: QuantityFit(each.unit, each.noise, {"cyclic": 1.0}, {}) for name, each in BOTH.items()}
    fits = [compared(6.0), fit_of({"E_f": 200.0}, objective=2.0, quantities=one)]
    assert in_words([4.0], fits) == "4 (noise alone: 2 to 6)"


def test_the_words_for_a_methods_section():
    text = methods(calibration_of({"a": alone(3.2)}))
    assert "At the best fits it is 3.2 N." in text
    assert "[@patterson], is 3 N by the same measure." in text
    text = methods(calibration_of({"a": compared(6.02)}))
    assert "At the best fits it is 6.02. Noise alone would leave 6." in text
    assert "of the quantity (force, lateral strain)" in text


def test_a_span_of_one_number_is_that_number():
    assert span([3.2, 3.2]) == span([3.2004, 3.2]) == "3.2"
    assert span([3.25, 1.0]) == "1 to 3.25"


@pytest.mark.parametrize(("converged", "told"), [(True, False), (None, False), (False, True)])
def test_a_search_that_was_cut_short_is_said(converged, told):
    fit = alone(3.2)
    one = MethodFit(3.2, None, 600, converged, 1, {}, [])
    result = calibration_of({"a": replace(fit, methods={fit.method: one}), "b": alone(3.2)})
    said = io.StringIO()
    summary(result, Path(), Console(file=said, width=400))
    words = "The search had used up its evaluations before it converged in a: parameters may be farther"
    assert (words in said.getvalue()) == told
    assert unfinished(result).startswith(words) == told
