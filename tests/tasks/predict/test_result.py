"""What a prediction says of its bands."""

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
