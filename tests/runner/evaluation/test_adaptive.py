"""Adaptive runs that share a cluster: results in the order of asking, reproducible bytes, errors that come through."""

import statistics
import threading
import time
from dataclasses import dataclass, replace

import dask
import numpy as np
import pytest
from distributed import Client, LocalCluster

from sinew.runner.cluster.client import open_client
from sinew.runner.cluster.dask_settings import SETTINGS
from sinew.runner.cluster.local import Local
from sinew.runner.errors import WalltimeReached
from sinew.runner.evaluation.adaptive import AdaptiveRun
from sinew.runner.evaluation.ensemble import evaluate, run_adaptive
from sinew.runner.evaluation.policy import Policy
from sinew.runner.evaluation.source import Source
from sinew.runner.store.store import Store
from tests.runner.evaluations import Quick, table_spec
from tests.runner.stores import contents, some


@pytest.fixture(scope="module")
def client():
    with open_client(Local(2)) as client:
        yield client


def double(number: float) -> float:
    return 2 * number


def wrong(number: float) -> float:
    raise ArithmeticError(f"no double of {number}")


@dataclass(frozen=True)
class Together:
    """As Quick, but the objective is how many rows came together."""

    seconds_per_row: float

    def __call__(self, parameters):
        outcome = Quick(seconds_per_row=self.seconds_per_row)(parameters)
        together = np.full((len(parameters), 1), float(len(parameters)))
        return replace(outcome, values={**outcome.values, "objective": together})


def walk(start: float, steps: int, ahead: int = 1):
    """Ask for points that depend on earlier results, with up to ``ahead`` results outstanding."""

    def work(session):
        a, results = start, []
        for _ in range(ahead):
            session.ask(np.array([[a, float(len(results))]]))
            a += 1.0
        while len(results) < steps:
            result = session.next()
            results.append(float(result.values["force"][-1]))
            if len(results) + ahead <= steps:
                a = session.compute(double, results[-1]) % 17.0 + start
                session.ask(np.array([[a, float(len(results))]]))
        return results

    return work


def runs(store, steps=12, ahead=1):
    tables = [store.table(table_spec(name)) for name in "abc"]
    return [
        AdaptiveRun([(table, Quick(seconds_per_row=0.01 * (3 - i)))], steps, walk(10.0 * i + 1, steps, ahead))
        for i, table in enumerate(tables)
    ]


@pytest.mark.parametrize("ahead", [1, 4])
def test_what_is_asked_and_stored_does_not_depend_on_the_cluster(tmp_path, client, ahead):
    results = {}
    for name, get in (("two", lambda: client), ("here", lambda: None)):
        with Store.writing(tmp_path / name, "study") as store:
            results[name] = run_adaptive(get, runs(store, ahead=ahead))
            assert all(len(one) == 12 for one in results[name])
            assert not list((tmp_path / name / "journal").glob("*/rows-*")), "all is committed"
    assert results["two"] == results["here"]
    assert contents(tmp_path / "two") == contents(tmp_path / "here")


def test_known_rows_come_from_the_store(tmp_path, client):
    with Store.writing(tmp_path, "study") as store:
        first = run_adaptive(lambda: client, runs(store))
        again = [AdaptiveRun(adaptive.tables, adaptive.rows, adaptive.work) for adaptive in runs(store)]
        never = [
            AdaptiveRun([(adaptive.tables[0][0], Quick(bad="raise"))], adaptive.rows, adaptive.work)
            for adaptive in again
        ]
        assert run_adaptive(lambda: None, never) == first
        table = store.table(table_spec("a"))
        assert len(table) == len(np.unique(table.parameters(np.arange(len(table))), axis=0))


def test_answers_come_in_the_order_of_asking_with_failures_among_them(tmp_path, client):
    parameters = some(40)
    parameters[[3, 17], 0] *= -1

    def work(session):
        session.ask(parameters[:30])
        session.ask(parameters[:5])  # known or on their way already
        return [session.next() for _ in range(35)] + session.ask_all(parameters[30:])

    with Store.writing(tmp_path, "study") as store:
        table = store.table(table_spec())
        (result,) = run_adaptive(lambda: client, [AdaptiveRun([(table, Quick(bad="diverged"))], 45, work)])
        expected = np.concatenate([parameters[:30], parameters[:5], parameters[30:]])
        for one, (a, b) in zip(result, expected, strict=True):
            if a < 0:
                assert one.status > 0
                assert np.isnan(one.values["force"]).all()
            else:
                assert one.status == 0
                assert one.values["force"].tolist() == (a * np.arange(7) + b).tolist()
        assert len(table) == 40


def test_one_adaptive_run_can_ask_several_tables(tmp_path, client):
    def work(session):
        session.ask(np.array([[1.0, 2.0]]), 1)
        session.ask(np.array([[3.0, 4.0]]), 0)
        return [float(session.next().values["force"][0]) for _ in range(2)]

    with Store.writing(tmp_path, "study") as store:
        tables = [(store.table(table_spec(name)), Quick()) for name in "ab"]
        assert run_adaptive(lambda: client, [AdaptiveRun(tables, 2, work)]) == [[2.0, 4.0]]
        assert [len(table) for table, _ in tables] == [1, 1]


def test_slow_rows_that_somebody_waits_for_are_not_put_one_after_the_other(tmp_path, client, monkeypatch):
    """Six rows of 0.15 s on two workers: each is a batch of its own, once it is known how long one takes."""
    sizes: list[int] = []
    take = Source.take

    def noted(self, size, retries):
        batch = take(self, size, retries)
        sizes.append(batch.rows.size)
        return batch

    def work(session):
        for seed in range(2):
            session.ask(some(6, seed=seed))
            for _ in range(6):
                session.next()

    monkeypatch.setattr(Source, "take", noted)
    with Store.writing(tmp_path, "study") as store:
        tables = [(store.table(table_spec()), Quick(seconds_per_row=0.15))]
        run_adaptive(lambda: client, [AdaptiveRun(tables, 12, work)])
    assert sum(sizes) == 12
    assert sizes[-6:] == [1] * 6


def test_slow_rows_are_single_however_many_wait(tmp_path, client):
    """What a batch has finished is kept when all of it is."""

    def work(session):
        return [
            float(result.values["objective"][0]) for seed in range(2) for result in session.ask_all(some(10, seed=seed))
        ]

    with Store.writing(tmp_path, "study") as store:
        (found,) = run_adaptive(lambda: client, [AdaptiveRun([(store.table(table_spec()), Together(0.55))], 20, work)])
    assert found == [1.0] * 20


@pytest.mark.parametrize(("a_slot", "together"), [(2, 1), (4, 2)])
def test_short_rows_for_many_slots_go_out_together_when_enough_are_asked_for(tmp_path, a_slot, together):
    """A scheduler would not keep up with 32 slots that get one row of 0.1 s at a time."""
    slots, rows = 32, 512

    def work(session):
        points, results = some(rows), []
        session.ask(points[: a_slot * slots])
        for row in range(a_slot * slots, rows, 8):
            results += [session.next() for _ in range(8)]
            session.ask(points[row : row + 8])
        results += [session.next() for _ in range(a_slot * slots)]
        return [float(result.values["objective"][0]) for result in results]

    with (
        dask.config.set(SETTINGS),
        LocalCluster(n_workers=1, threads_per_worker=slots, dashboard_address=None) as cluster,
        Client(cluster) as client,
        Store.writing(tmp_path, "study") as store,
    ):
        client.wait_for_workers(1)
        table = store.table(table_spec())
        (found,) = run_adaptive(lambda: client, [AdaptiveRun([(table, Together(0.1))], rows, work)])
    assert statistics.median(found[rows // 2 :]) == together
    assert max(found) <= 2 * together


@pytest.mark.parametrize("here", [True, False])
def test_an_error_of_one_adaptive_run_ends_the_others(tmp_path, client, here):
    before = threading.active_count()

    def broken(session):
        session.ask_all(some(3))
        raise LookupError("lost the thread")

    def computes(session):
        session.ask_all(some(2))
        session.compute(wrong, 3.0)

    def patient(session):
        session.next()  # of nothing: waits for ever

    with Store.writing(tmp_path, "study") as store:
        for work, error in ((broken, LookupError), (computes, ArithmeticError)):
            tables = [[(store.table(table_spec(name)), Quick())] for name in "ab"]
            with pytest.raises(error):
                run_adaptive(
                    (lambda: None) if here else (lambda: client),
                    [AdaptiveRun(tables[0], 3, work), AdaptiveRun(tables[1], 1, patient)],
                )
            assert not [thread for thread in threading.enumerate() if thread.name == "sinew-session"]
    assert threading.active_count() <= before + 2


def test_rows_of_an_interrupted_run_are_known_to_the_next(tmp_path, client):
    def impatient(session):
        for row in some(20):
            session.ask_all(row[np.newaxis])
            if row[0] == some(20)[9, 0]:
                raise WalltimeReached("enough", worked=True)

    with Store.writing(tmp_path / "cut", "study") as store, pytest.raises(WalltimeReached):
        run_adaptive(lambda: client, [AdaptiveRun([(store.table(table_spec()), Quick())], 20, impatient)])
    for name in ("cut", "whole"):
        with Store.writing(tmp_path / name, "study") as store:
            table = store.table(table_spec())
            done = len(table.segments()) + table.finished()
            assert done == (10 if name == "cut" else 0)
            work = lambda session: [session.ask_all(row[np.newaxis]) for row in some(20)]  # noqa: E731
            run_adaptive(lambda: client, [AdaptiveRun([(table, Quick())], 20, work)])
    assert contents(tmp_path / "cut") == contents(tmp_path / "whole")


def test_many_single_rows_leave_few_files(tmp_path, monkeypatch):
    monkeypatch.setattr("sinew.runner.evaluation.source.SEGMENTS_KEPT", 16)
    most = 0

    def work(session):
        nonlocal most
        for row in some(100):
            session.ask_all(row[np.newaxis])
            most = max(most, len(list((tmp_path / "journal").glob("*/rows-*"))))

    with Store.writing(tmp_path, "study") as store:
        run_adaptive(lambda: None, [AdaptiveRun([(store.table(table_spec()), Quick())], 100, work)])
    assert 8 <= most <= 16


def test_slow_and_fast_runs_do_not_wait_for_each_other(tmp_path, client):
    def work(session):
        started = time.monotonic()
        for row in some(8):
            session.ask_all(row[np.newaxis])
        return time.monotonic() - started

    with Store.writing(tmp_path, "study") as store:
        tables = [store.table(table_spec(name)) for name in "ab"]
        evaluations = Quick(seconds_per_row=0.4), Quick()
        slow, fast = run_adaptive(
            lambda: client, [AdaptiveRun([(table, e)], 8, work) for table, e in zip(tables, evaluations, strict=True)]
        )
    assert fast < slow / 2


def test_an_adaptive_run_and_known_rows_share_a_table(tmp_path, client):
    with Store.writing(tmp_path, "study") as store:
        table = store.table(table_spec())
        rows = table.plan(some(50))
        evaluate(lambda: client, table, Quick(), rows, policy=Policy())
        work = lambda session: [float(one.values["force"][0]) for one in session.ask_all(some(60)[::-1])]  # noqa: E731
        (results,) = run_adaptive(lambda: client, [AdaptiveRun([(table, Quick())], 60, work)])
        assert results == some(60)[::-1, 1].tolist()
        assert len(table) == 60
