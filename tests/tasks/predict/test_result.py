"""What a prediction says of its bands."""

from dataclasses import replace

import pytest

from sinew.tasks.predict.result import Coverage, PredictResult, SitePrediction


def prediction(**shares: float | None) -> PredictResult:
    """One site, 100 points, and these shares inside its bands."""
    coverage = {band: Coverage(share, 100, {"ramp": share}, {"a": share}, share) for band, share in shares.items()}
    site = SitePrediction(["a"], {}, None, coverage, "a", "a", None)
    return PredictResult(0.95, 40, 43, 0, {"all": site}, coverage, "known")


@pytest.mark.parametrize("share", [1.0, 0.95, 0.86, None])
def test_bands_that_hold_about_what_they_should_need_no_remark(share):
    assert prediction(hdi=share, draws=share, new=share).remarks == []


def test_each_band_that_holds_far_fewer_points_is_explained():
    assert prediction(hdi=0.95, draws=0.27, new=0.5).remarks == [
        "all: the 95 % band of draws from the posterior holds 27 % of the points: it shows the spread of the "
        "parameters only, not the noise and not what the model lacks",
        "all: the 95 % band of a new specimen holds 50 % of the points: specimens differ by more than this band knows",
    ]


@pytest.mark.parametrize(
    "change", [{"typical": "nobody"}, {"stresses_of": "nobody"}, {"failed": {"nobody": {"crashed": 1}}}]
)
def test_specimens_of_no_site_are_refused(change):
    (site,) = prediction(hdi=0.9).sites.values()
    assert replace(site, failed={"a": {"crashed": 1}}).typical == "a"
    with pytest.raises(ValueError, match="nobody: not among its specimens a"):
        replace(site, **change)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"protocols": {"ramp": 0.1, "hold": 0.2}}, "a, hdi: 0.9 of all points, but 0.1 to 0.2 of their parts"),
        ({"specimens": {"a": 1.0}}, "a, hdi: 0.9 of all points, but 1 to 1 of their parts"),
    ],
)
def test_shares_that_contradict_each_other_are_refused(change, told):
    fields = {"all": 0.9, "points": 100, "protocols": {"ramp": 0.9}, "specimens": {"a": 0.9}, "curves": None}
    good, wrong = Coverage(**fields), Coverage(**(fields | change))
    for coverage in ({"hdi": good, "draws": good}, {"draws": good}, {"hdi": good, "all": good}, {"hdi": wrong}):
        site = SitePrediction(["a"], {}, None, coverage, "a", "a", None)
        if coverage == {"hdi": good, "draws": good}:
            PredictResult(0.95, 40, 43, 0, {"a": site}, {"hdi": good}, "known")
            continue
        with pytest.raises(ValueError, match=told if coverage == {"hdi": wrong} else "coverage of a: of "):
            PredictResult(0.95, 40, 43, 0, {"a": site}, {"hdi": good}, "known")
