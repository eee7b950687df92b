"""What a comparison cannot find."""

import numpy as np
import pytest

from sinew.tasks.compare.result import (
    CompareResult,
    Contrast,
    Densities,
    Interval,
    Loadings,
    Pair,
    Roc,
    Separability,
    SiteParticles,
)


def test_an_interval_ends_after_it_begins():
    assert Interval(1.0, 0.5, 0.5, 0.9).exponential().high > 1.0
    Interval(float("nan"), float("nan"), float("nan"), float("nan"))
    with pytest.raises(ValueError, match=r"an interval from 2 to 0\.5"):
        Interval(1.0, 2.0, 0.5, 0.9)


def compared(
    sites=("a", "b"), parameter="E_f", auc=0.8, ends=(0.7, 0.9), of_pair=(0.7, 0.9), worth=8.0
) -> CompareResult:
    """A comparison of two sites with these numbers."""
    none = np.empty(0)
    every = Separability(auc, np.array(ends), None, None, 5, 1, 0)
    contrast = Contrast(
        list(sites), parameter, False, Interval(1.0, 0.5, 2.0, 0.9), Interval(1.0, 0.5, 2.0, 0.5), None, None
    )
    return CompareResult(
        names=["E_f"],
        confidence=0.95,
        contrasts=[contrast],
        component=Loadings(1.0, {"E_f": 1.0}, {"E_f": 1.0}, {"E_f": 1.0}),
        sites={"a": SiteParticles(8, worth), "b": SiteParticles(8, 8.0)},
        pairs=[Pair(["a", "b"], 0.8, np.array(of_pair), Roc(none, none), every)],
        densities=Densities(none, {}),
        note="",
        inputs="",
    )


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"sites": ("a", "a")}, "sites a, a, which are not compared"),
        ({"sites": ("a", "c")}, "sites a, c, which are not compared"),
        ({"parameter": "E_g"}, "a contrast of E_g, which is no parameter"),
        ({"ends": (0.9, 0.7)}, "an area of 0.8 with the interval"),
        ({"ends": (0.9, 0.95)}, "an area of 0.8 with the interval"),
        ({"ends": (0.7,)}, "an area of 0.8 with the interval"),
        ({"of_pair": (0.9, 0.95)}, "an area of 0.8 with the interval"),
        ({"worth": 9.0}, "8 particles worth 9"),
    ],
)
def test_a_comparison_that_contradicts_itself_is_refused(changed, words):
    compared()
    with pytest.raises(ValueError, match=words):
        compared(**changed)
