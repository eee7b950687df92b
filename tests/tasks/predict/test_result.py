"""What a prediction says of its bands."""

from dataclasses import replace

import pytest

from sinew.tasks.predict.result import Coverage, PredictResult, SitePrediction


def prediction(**shares: float | None) -> PredictResult:
    """One site, 100 points, and these shares inside its bands."""
    coverage = {
        band: Coverage(share, 0 if share is None else 100, {"ramp": share}, {"a": share}, share)
        for band, share in shares.items()
    }
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


def test_too_few_draws_for_a_band_are_remarked_on():
    found = replace(prediction(hdi=1.0, draws=1.0), probability=0.9998)
    assert found.narrow == []
    (remark,) = found.remarks
    assert remark == (
        "40 draws hold 95.122 % of a posterior between them, not 99.98 %: 9,999 are needed (predict.draws)"
    )


@pytest.mark.parametrize(
    "change", [{"typical": "nobody"}, {"stresses_of": "nobody"}, {"failed": {"nobody": {"crashed": 1}}}]
)
def test_specimens_of_no_site_are_refused(change):
    (site,) = prediction(hdi=0.9).sites.values()
    assert replace(site, failed={"a": {"crashed": 1}}).typical == "a"
    with pytest.raises(ValueError, match="nobody: not among its specimens a"):
        replace(site, **change)


GOOD = Coverage(0.9, 100, {"ramp": 0.9}, {"a": 0.9}, 0.5)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"protocols": {"ramp": 0.1, "hold": 0.2}}, "0.9 of all points, but 0.1 to 0.2 of their parts"),
        ({"specimens": {"a": 1.0}}, "0.9 of all points, but 1 to 1 of their parts"),
        ({"points": 0}, "0.9 of 0 points and 0.5 of the curves"),
        ({"all": None}, "None of 100 points and 0.5 of the curves"),
        ({"curves": None}, "0.9 of 100 points and None of the curves"),
        ({"curves": 1.0}, "0.9 of all points, but 1 of the curves with all of theirs"),
    ],
)
def test_shares_that_contradict_each_other_are_refused(change, told):
    with pytest.raises(ValueError, match=told):
        replace(GOOD, **change)


@pytest.mark.parametrize(
    ("bands", "failed", "points", "told"),
    [
        (("draws",), 2, 100, "coverage of a: of draws, not of hdi"),
        (("hdi", "all"), 2, 100, "coverage of a: of hdi, all, not of hdi"),
        (("hdi",), 7, 100, "failed: 7 simulations, but 2 of the specimens"),
        (("hdi",), 2, 30, "coverage of all, hdi: 30 points, but 100 of the sites"),
    ],
)
def test_a_site_that_contradicts_the_whole_is_refused(bands, failed, points, told):
    def site(bands: tuple[str, ...]) -> SitePrediction:
        return SitePrediction(["a"], {"a": {"crashed": 2}}, None, dict.fromkeys(bands, GOOD), "a", "a", None)

    PredictResult(0.95, 40, 43, 2, {"a": site(("hdi", "draws"))}, {"hdi": GOOD}, "known")
    with pytest.raises(ValueError, match=told):
        PredictResult(0.95, 40, 43, failed, {"a": site(bands)}, {"hdi": replace(GOOD, points=points)}, "known")
