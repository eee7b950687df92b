"""Noise of simulated measurements: relative errors are those of simulations to which noise was really added."""

import numpy as np
import pytest

from sinew.tasks.data.noise import Noise
from sinew.tasks.data.virtual import autoregressive
from sinew.tasks.infer.abc.method import comparison
from sinew.tasks.infer.abc.noise import noise_of_curves, noise_of_site
from sinew.tasks.infer.abc.observations import SiteEvaluation, root_mean_square
from sinew.tasks.model import Curve, Model
from sinew.tasks.model.protocols import one_step
from sinew.tasks.simulate.uniaxial import Uniaxial
from sinew.tasks.study.cohort import cohort_of
from sinew.tasks.study.study import read_study
from tests.tasks.measured import study_of, write_measured

SD = 0.05


def test_where_the_noise_is_unknown_or_nothing_none_is_simulated():
    protocol = one_step(10.0, 5.0)
    curve = Curve(protocol, np.ones(protocol.time_s.size))
    noise = noise_of_curves([(curve, Noise(np.nan, np.nan, np.nan)), (curve, Noise(0.0, 0.0))])
    np.testing.assert_array_equal(noise.relative_errors(np.array([0.3, 0.1])), [0.3, 0.1])


@pytest.mark.parametrize("ar1", [0.0, 0.4, 0.9])
@pytest.mark.parametrize("part", [0.0, 0.02, 0.5])
def test_errors_are_distributed_as_those_of_noisy_simulations(part, ar1):
    """The measured curve has noise of its own, and differs from the simulated one by a smooth part of the force."""
    protocol = one_step(10.0, 5.0)
    force = 1.0 + np.sin(np.linspace(0, 3, protocol.time_s.size))
    rng = np.random.default_rng(3)
    exact, drawn = [], []
    noise = noise_of_curves([(Curve(protocol, force), Noise(SD, ar1))])
    np.random.seed(4)
    for _ in range(3000):
        measured, simulated = (SD * autoregressive(rng, force.size, ar1) for _ in range(2))
        apart = part * force + measured
        exact.append(np.sqrt(np.mean((apart + simulated) ** 2)) / root_mean_square(force))
        error = np.sqrt(np.mean(apart**2)) / root_mean_square(force)
        drawn.append(noise.relative_errors(np.array([error]))[0])
    assert np.mean(drawn) == pytest.approx(np.mean(exact), rel=0.01)
    assert np.std(drawn) == pytest.approx(np.std(exact), rel=0.12)


def test_what_is_measured_beside_the_force_has_noise_of_its_own(tmp_path):
    """Simulations with the true parameters differ from what was measured by two noises, not by one."""
    truth = write_measured(tmp_path)
    (one,) = cohort_of(read_study(study_of(tmp_path, ""))).specimens
    model, simulator = Model(), Uniaxial(compared=("lateral_strain",))
    evaluation = SiteEvaluation(model, (one,), simulator, 96, "distal")
    noise = noise_of_site(evaluation)
    measured = [curve.others["lateral_strain"] for curve in one.curves]
    sizes = [one.noise["lateral_strain"] / root_mean_square(values[np.isfinite(values)]) for values in measured]
    assert noise.size[3:] == pytest.approx(sizes)
    row = np.array([[truth[one.name][name] for name in model.names]])
    done = {name: values[0] for name, values in evaluation(row).values.items()}
    np.random.seed(5)
    described = [comparison("relative", evaluation, noise).describe(done)["relative_error"] for _ in range(300)]
    twice = np.sqrt(np.mean(np.square(described), axis=0))[3:]
    assert twice == pytest.approx(np.sqrt(2.0) * np.array(sizes), rel=0.1)
    points = comparison("adaptive", evaluation, noise)
    drawn = np.std([points.describe(done)["others"] for _ in range(300)], axis=0)
    assert drawn == pytest.approx(noise.size[evaluation.curves_of_others()], rel=0.3)
    assert comparison("relative", evaluation).describe(done)["relative_error"][3:] == pytest.approx(sizes, rel=0.1)
