"""The sampler of pyABC on the store: known posteriors, the same particles whatever happens, few superfluous rows."""

import numpy as np
import pyabc
import pytest
from scipy import stats

from sinew.runner.cluster.local import Local
from sinew.runner.evaluation.adaptive import AdaptiveRun, Session
from sinew.runner.evaluation.ensemble import run_adaptive
from sinew.runner.store.store import Store
from sinew.tasks.infer.abc.history import IN_MEMORY, close, keep
from sinew.tasks.infer.abc.pyabc_priors import Alike, Normals
from sinew.tasks.infer.abc.sampler import StoredModel, StoreSampler
from sinew.tasks.infer.abc.stock_sampler import DirectModel, SimulationFailed, stock_sampler
from sinew.tasks.infer.abc.transitions import DefensiveNormal
from sinew.tasks.study import workspace
from tests.runner.stores import contents
from tests.tasks.analytic import SD, NoisyMean

WIDE = 1e6


@pytest.fixture(scope="module")
def client():
    """Of the workers that tests of studies share."""
    with workspace.open_client(Local(2)) as client:
        yield client


def prior(mean: float = 0.0, sd: float = 1.0) -> Normals:
    return Normals(("mean",), np.array([mean]), np.array([sd]), np.array([-WIDE]), np.array([WIDE]))


def distance(x, observed):
    return abs(x["y"] - observed["y"])


def inference(
    store, evaluations, observed, *, seed=1, generations=3, population=60, pending=16, first=2.0, least=0.005
):
    """An adaptive run of pyABC with one model for each evaluation.

    ``first`` threshold; ``least`` rate of acceptance, which ends the run.
    """
    tables = [(store.table(evaluation.table()), evaluation) for evaluation in evaluations]

    def work(session):
        models = [
            StoredModel(f"m{i}", ["mean"], table=i, describe=lambda values: {"y": float(values["y"])})
            for i in range(len(tables))
        ]
        sampler = StoreSampler(session, (seed, 1), pending)
        priors = [prior() for _ in models]
        abc = pyabc.ABCSMC(
            models, priors, distance, model_prior=Alike(len(models)),
            transitions=[DefensiveNormal(p) for p in priors], population_size=population,
            eps=pyabc.QuantileEpsilon(initial_epsilon=first, alpha=0.5), sampler=sampler,
        )  # fmt: skip
        history = abc.new(IN_MEMORY, {"y": observed})
        abc.run(max_nr_populations=generations, min_acceptance_rate=least)
        frames = {m: history.get_distribution(m=m, t=history.max_t) for m in history.alive_models(history.max_t)}
        found = {
            "frames": {m: (frame["mean"].to_numpy(), w) for m, (frame, w) in frames.items()},
            "models": history.get_model_probabilities(history.max_t)["p"].to_dict(),
            "epsilon": float(history.get_all_populations()["epsilon"].iloc[-1]),
            "generations": sampler.generations,
        }
        close(history)  # the connection belongs to this thread
        return found

    return AdaptiveRun(tables, 10_000, work)


def test_the_same_particles_and_rows_on_any_cluster(tmp_path, client):
    found = {}
    for name, get in (("two", lambda: client), ("here", lambda: None)):
        with Store.writing(tmp_path / name, "study") as store:
            (found[name],) = run_adaptive(get, [inference(store, [NoisyMean(failing=0.05)], 0.7)])
    for a, b in zip(found["two"]["frames"][0], found["here"]["frames"][0], strict=True):
        assert a.tobytes() == b.tobytes()
    assert found["two"]["generations"] == found["here"]["generations"]
    assert contents(tmp_path / "two") == contents(tmp_path / "here")


def test_two_runs_at_once_have_particles_of_their_own(tmp_path, client):
    with Store.writing(tmp_path, "study") as store:
        adaptive = [inference(store, [NoisyMean(salt=i)], 0.7, seed=i, generations=2) for i in range(3)]
        found = run_adaptive(lambda: client, adaptive)
    first = [one["frames"][0][0][0] for one in found]
    assert len(set(first)) == 3


def test_pyabcs_own_sampler_is_there_to_compare_with(tmp_path, client):
    """The posterior mean is 0.56; 30 particles know it to 0.13. It says which proposals were superfluous."""

    def run(failing):
        model = DirectModel("m", ["mean"], NoisyMean(failing=failing), identity, described)
        sampler = stock_sampler(client)
        abc = pyabc.ABCSMC(
            model, prior(), distance, model_prior=Alike(1), transitions=DefensiveNormal(prior()), population_size=30,
            eps=pyabc.ListEpsilon([1.0, 0.4]), sampler=sampler,
        )  # fmt: skip
        abc.new(f"sqlite:///{tmp_path}/stock{failing}.db", {"y": 0.7})
        history = abc.run(max_nr_populations=2)
        frame, weight = history.get_distribution(m=0, t=1)
        history.done()
        return float(weight @ frame["mean"]), sampler.generations

    mean, generations = run(0.0)
    assert mean == pytest.approx(0.56, abs=0.4)
    assert [one.accepted for one in generations] == [30, 30]
    assert all(30 <= one.judged <= one.asked for one in generations)
    with pytest.raises(SimulationFailed, match="diverged: it diverged"):
        run(1.0)


def identity(values):
    return values


def described(values):
    return {"y": float(values["y"])}


class Killed(Exception):
    pass


def test_a_run_that_dies_in_mid_generation_goes_on_there(tmp_path, client, monkeypatch):
    whole = tmp_path / "whole"
    with Store.writing(whole, "study") as store:
        (undisturbed,) = run_adaptive(lambda: client, [inference(store, [NoisyMean()], 0.7)])
        rows = len(store.table(NoisyMean().table()))
    judged, judge = 0, StoreSampler._judge

    def dies(self, *arguments):
        nonlocal judged
        judged += 1
        if judged == 150:
            raise Killed
        return judge(self, *arguments)

    with Store.writing(tmp_path / "cut", "study") as store:
        monkeypatch.setattr(StoreSampler, "_judge", dies)
        with pytest.raises(Killed):
            run_adaptive(lambda: client, [inference(store, [NoisyMean()], 0.7)])
    monkeypatch.setattr(StoreSampler, "_judge", judge)
    with Store.writing(tmp_path / "cut", "study") as store:
        table = store.table(NoisyMean().table())
        assert 100 < table.finished() + table.waiting() < rows
        (resumed,) = run_adaptive(lambda: client, [inference(store, [NoisyMean()], 0.7)])
    assert resumed["frames"][0][0].tobytes() == undisturbed["frames"][0][0].tobytes()
    assert contents(tmp_path / "cut") == contents(whole)


def test_what_a_generation_did_not_need_is_the_first_of_the_next(tmp_path):
    """Workers have something to do between two generations; only the last one leaves what nobody needs."""
    with Store.writing(tmp_path, "study") as store:
        (found,) = run_adaptive(lambda: None, [inference(store, [NoisyMean()], 0.7, generations=5, pending=64)])
        asked = np.cumsum([g.asked for g in found["generations"]])
        judged = np.cumsum([g.judged for g in found["generations"]])
        left = asked - judged
        assert (left[:-1] >= 16).all()
        assert (left <= 64).all()
        assert asked[-1] <= 1.05 * judged[-1]
        assert len(store.table(NoisyMean().table())) == asked[-1]
    assert all(g.accepted == 60 for g in found["generations"])


class Wandering(pyabc.transition.Transition):
    """Proposes around the next of its centres in each generation, whatever the particles were."""

    CENTRES = (np.nan, 1.0, -1.0, 2.0)

    def __init__(self):
        self.generation = 0

    def fit(self, X, w):
        self.generation += 1

    def rvs_single(self):
        return pyabc.Parameter(mean=float(np.random.normal(self.CENTRES[self.generation], 1.5)))

    def pdf(self, x):
        return self.density(x["mean"], self.generation)

    @classmethod
    def density(cls, value, generation):
        return float(stats.norm.pdf(value, cls.CENTRES[generation], 1.5))


def test_a_proposal_keeps_the_weight_of_the_density_it_was_drawn_from(tmp_path, monkeypatch):
    judged, judge = [], StoreSampler._judge

    def noted(self, how, proposed):
        particle = judge(self, how, proposed)
        if particle.accepted:  # pyABC changes weights afterwards: their sum is 1
            judged.append((len(self.generations) - 1, proposed.seed[-2], particle.parameter["mean"], particle.weight))
        return particle

    def work(session):
        abc = pyabc.ABCSMC(
            StoredModel("m", ["mean"], describe=described), prior(), distance, transitions=Wandering(),
            population_size=20, eps=pyabc.ListEpsilon([2.0, 1.5, 1.2, 1.0]), sampler=StoreSampler(session, (1, 1), 32),
        )  # fmt: skip
        history = abc.new(IN_MEMORY, {"y": 0.3})
        abc.run(max_nr_populations=4)
        close(history)

    monkeypatch.setattr(StoreSampler, "_judge", noted)
    evaluation = NoisyMean()
    with Store.writing(tmp_path, "study") as store:
        run_adaptive(lambda: None, [AdaptiveRun([(store.table(evaluation.table()), evaluation)], 1000, work)])
    assert len(judged) == 80
    assert sum(drawn < generation for generation, drawn, _, _ in judged) >= 10
    for _, drawn, value, weight in judged:
        of_prior = stats.norm.pdf(value)
        assert weight == pytest.approx(of_prior / Wandering.density(value, drawn) if drawn else 1.0)


def test_draws_to_learn_from_may_fail(tmp_path):
    """More of them are asked for than there are particles, and the first generation goes on with what is left."""
    with Store.writing(tmp_path, "study") as store:
        (found,) = run_adaptive(
            lambda: None, [inference(store, [NoisyMean(failing=0.2)], 0.7, generations=2, first="from_sample")]
        )
    learned, *generations = found["generations"]
    assert (learned.t, [g.t for g in generations]) == (-1, [0, 1])
    assert learned.failed > 0
    assert learned.accepted == 60
    assert all(g.accepted == 60 for g in generations)


def test_a_limit_need_not_be_a_whole_number(tmp_path):
    """Of 20 / 0.15 = 133.3 proposals too few are accepted."""
    with Store.writing(tmp_path, "study") as store:
        (found,) = run_adaptive(
            lambda: None, [inference(store, [NoisyMean()], 0.7, generations=9, population=20, least=0.15)]
        )
    *whole, last = found["generations"]
    assert all(g.accepted == 20 for g in whole)
    assert whole
    assert last.accepted < 20
    assert last.judged == 134


def test_a_threshold_out_of_reach_ends_the_run(tmp_path):
    with Store.writing(tmp_path, "study") as store:
        (found,) = run_adaptive(lambda: None, [inference(store, [NoisyMean()], 0.7, generations=1, population=4)])
        assert found["generations"][0].accepted == 4

        def work(session):
            model = StoredModel("m", ["mean"], describe=lambda values: {"y": float(values["y"])})
            sampler = StoreSampler(session, (1, 1), 16)
            abc = pyabc.ABCSMC(
                model, prior(), distance, population_size=10, eps=pyabc.ListEpsilon([1e-9]), sampler=sampler
            )
            history = abc.new(IN_MEMORY, {"y": 50.0})
            abc.run(max_nr_populations=1, min_acceptance_rate=0.1)
            found = history.n_populations, sampler.generations[-1]
            close(history)
            return found

        evaluation = NoisyMean(salt=9)
        ((populations, last),) = run_adaptive(
            lambda: None, [AdaptiveRun([(store.table(evaluation.table()), evaluation)], 200, work)]
        )
    assert populations == 0
    assert last.judged == 100
    assert last.asked == 100, "the limit holds for what is asked for, too"
    assert 40 < last.closest < 60


@pytest.mark.thorough
def test_simulation_based_calibration(tmp_path):
    """Ranks of the truth among posterior draws are uniform (Talts et al. 2018), with failures in every second run."""
    rng = np.random.default_rng(17)
    runs, kept = 24, 19
    truths = rng.standard_normal(runs)
    data = truths + SD * rng.standard_normal(runs)
    with Store.writing(tmp_path, "study") as store:
        table = [NoisyMean(failing=0.1 * (i % 2), salt=i) for i in range(runs)]
        found = []
        for start in range(0, runs, 8):
            adaptive = [
                inference(store, [table[i]], float(data[i]), seed=i, generations=3, population=24)
                for i in range(start, start + 8)
            ]
            found += run_adaptive(lambda: None, adaptive)
    ranks, means, epsilons = [], [], []
    for one, truth in zip(found, truths, strict=True):
        values, weight = one["frames"][0]
        draws = rng.choice(values, size=kept, p=weight)
        ranks.append(int((draws < truth).sum()))
        means.append(float(weight @ values))
        epsilons.append(one["epsilon"])
    counts = np.bincount(np.array(ranks) // 5, minlength=4)
    assert stats.chisquare(counts).pvalue > 0.01, counts
    exact = data / (1 + SD**2)
    assert np.median(epsilons) < 0.6
    assert np.mean(np.abs(np.array(means) - exact)) < 0.2
    assert np.corrcoef(means, exact)[0, 1] > 0.96
    for first, failing in ((0, 0.0), (1, 0.1)):
        failed = sum(g.failed for one in found[first::2] for g in one["generations"])
        judged = sum(g.judged for one in found[first::2] for g in one["generations"])
        assert failed / judged == pytest.approx(failing, abs=0.03)


def test_model_selection_finds_the_probabilities(tmp_path):
    """Two slopes, equal prior probabilities: the posterior ones follow from how likely each is within the threshold."""
    y = 1.5
    with Store.writing(tmp_path, "study") as store:
        evaluations = [NoisyMean(slope=1.0), NoisyMean(slope=0.0)]
        (found,) = run_adaptive(
            lambda: None, [inference(store, evaluations, y, generations=3, population=160, pending=100)]
        )
    ends = np.array([y - found["epsilon"], y + found["epsilon"]])
    within = [np.diff(stats.norm.cdf(ends, 0, np.hypot(slope, SD)))[0] for slope in (1.0, 0.0)]
    assert found["models"].get(0, 0.0) == pytest.approx(within[0] / sum(within), abs=0.07)


def test_the_mixture_bounds_the_weights():
    """In 16 dimensions, 40 particles: no weight exceeds five times that of a draw from the prior."""
    names = tuple(f"p{i}" for i in range(16))
    wide = Normals(names, np.zeros(16), np.ones(16), np.full(16, -WIDE), np.full(16, WIDE))
    rng = np.random.default_rng(3)
    particles = 0.5 * rng.standard_normal((40, 16))
    transition = DefensiveNormal(wide)
    import pandas as pd

    transition.fit(pd.DataFrame(particles, columns=list(names)), np.full(40, 1 / 40))
    state = np.random.get_state()
    np.random.seed(5)
    drawn = [transition.rvs() for _ in range(400)]
    np.random.set_state(state)
    weights = np.array([wide.pdf(x) / transition.pdf(x) for x in drawn])
    assert weights.max() <= 5.0 + 1e-9
    grid = np.array([list(x.values()) for x in drawn])
    assert weights @ grid / weights.sum() == pytest.approx(np.zeros(16), abs=0.5)
    assert np.mean(weights) == pytest.approx(1.0, rel=0.3), "both are densities of one"


def test_a_history_in_memory_is_kept_in_a_file(tmp_path):
    abc = pyabc.ABCSMC(
        pyabc.FunctionModel(lambda pars: {"y": pars["mean"]}), prior(), distance, model_prior=Alike(1),
        transitions=DefensiveNormal(prior()), population_size=8, eps=pyabc.ListEpsilon([1.0, 0.5]),
        sampler=pyabc.sampler.SingleCoreSampler(),
    )  # fmt: skip
    history = abc.new(IN_MEMORY, {"y": 0.3})
    abc.run(max_nr_populations=2)
    expected = history.get_distribution(m=0, t=1)[0]["mean"].tolist()
    for _ in range(2):  # one of an earlier run is replaced
        keep(history, tmp_path / "site.db")
    close(history)
    kept = pyabc.History(f"sqlite:///{tmp_path}/site.db", create=False)
    assert kept.get_distribution(m=0, t=1)[0]["mean"].tolist() == expected
    kept.done()
    assert [path.name for path in tmp_path.iterdir()] == ["site.db"]


def test_what_is_asked_goes_out_in_groups(tmp_path, monkeypatch):
    """An eighth of ``pending`` at least, but for the last ones of a generation."""
    sizes, ask = [], Session.ask

    def counted(self, parameters, table=0):
        sizes.append(len(parameters))
        ask(self, parameters, table)

    monkeypatch.setattr(Session, "ask", counted)
    with Store.writing(tmp_path, "study") as store:
        (found,) = run_adaptive(lambda: None, [inference(store, [NoisyMean()], 0.7, pending=64)])
    assert sum(sizes) == sum(g.asked for g in found["generations"])
    assert sizes[0] == 64
    assert np.mean(sizes) > 8
