"""Sessions and adaptive runs without a cluster: order of results, computations, ends and errors."""

import contextvars
import threading

import numpy as np
import pytest
from threadpoolctl import threadpool_info

from sinew.runner.errors import WalltimeReached
from sinew.runner.evaluation.adaptive import AdaptiveRun, Message, RowResult, RunClosed, Session
from sinew.runner.evaluation.batch import evaluations
from sinew.runner.evaluation.ensemble import run_adaptive
from sinew.runner.store.store import Store
from tests.runner.evaluations import Quick, table_spec
from tests.runner.stores import fill, some

WHO = contextvars.ContextVar("WHO", default="nobody")


@pytest.fixture
def store(tmp_path):
    with Store.writing(tmp_path, "study") as opened:
        yield opened
    assert evaluations == {}


def here() -> None:
    """No cluster."""


def adaptive(store: Store, work, name: str = "quick", rows: int = 10, evaluation: Quick | None = None) -> AdaptiveRun:
    return AdaptiveRun([(store.table(table_spec(name)), evaluation or Quick())], rows, work)


def first_forces(results: list[RowResult]) -> list[float]:
    return [float(one.values["force"][0]) for one in results]


# ---- a session


def test_a_session_sends_what_is_asked_and_returns_what_is_told():
    sent: list[Message] = []
    session = Session(sent.append, here=True)
    session.ask([[1, 2]], 3)
    (message,) = sent
    assert message.session is session
    assert message.parameters.dtype == np.float64
    assert (message.parameters.tolist(), message.table) == ([[1.0, 2.0]], 3)
    results = [RowResult(status, {}) for status in range(3)]
    for result in results:
        session.tell(result)
    assert session.next() is results[0]
    assert session.ask_all(np.zeros((2, 2))) == results[1:]
    assert sent[-1].table == 0


def test_parameters_may_change_after_they_were_asked_for():
    sent: list[Message] = []
    parameters = np.ones((1, 2))
    Session(sent.append, here=True).ask(parameters)
    parameters[:] = 7.0
    assert sent[0].parameters.tolist() == [[1.0, 1.0]]


def test_a_session_that_is_closed_says_so_to_who_waits():
    session = Session(lambda message: None, here=True)
    session.tell(RunClosed())
    with pytest.raises(RunClosed):
        session.next()


def test_a_computation_elsewhere_is_answered_by_its_value_or_its_error():
    def send(message: Message) -> None:
        function, arguments = message.computation
        assert message.session is session
        message.answer.put(function(*arguments) if arguments[0] else LookupError("nothing"))

    session = Session(send, here=False)
    assert session.compute(max, 3, 5) == 5
    with pytest.raises(LookupError, match="nothing"):
        session.compute(max, 0, 5)


# ---- runs


def test_nothing_to_run_is_nothing(store):
    def never():
        raise AssertionError("no cluster is needed")

    assert run_adaptive(never, []) == []


def test_results_come_in_the_order_of_asking(store):
    parameters = some(12)

    def work(session):
        session.ask(parameters[6:])
        session.ask(parameters[:8])
        return first_forces([session.next() for _ in range(14)])

    (found,) = run_adaptive(here, [adaptive(store, work)])
    assert found == [*parameters[6:, 1], *parameters[:8, 1]]
    (table,) = store.tables()
    assert np.array_equal(table.parameters(np.arange(12)), parameters[[*range(6, 12), *range(6)]])
    assert (table.finished(), table.waiting()) == (12, 0)


def test_each_run_gets_its_own_results(store):
    runs = [
        adaptive(store, lambda session, seed=seed: first_forces(session.ask_all(some(4, seed=seed))), name)
        for seed, name in enumerate("abc")
    ]
    assert run_adaptive(here, runs) == [some(4, seed=seed)[:, 1].tolist() for seed in range(3)]


def test_known_rows_are_not_evaluated_again(store):
    fill(store.table(table_spec()), some(4))
    work = lambda session: first_forces(session.ask_all(some(4)))  # noqa: E731
    assert run_adaptive(here, [adaptive(store, work, evaluation=Quick(bad="raise"))]) == [some(4)[:, 1].tolist()]


def test_progress_counts_results_and_failures(store):
    parameters = some(5)
    parameters[[1, 3], 0] *= -1
    said: list[tuple[int, ...]] = []
    work = lambda session: len(session.ask_all(np.concatenate([parameters, parameters[:2]])))  # noqa: E731
    run = adaptive(store, work, evaluation=Quick(bad="diverged"))
    assert run_adaptive(here, [run], lambda *numbers: said.append(numbers)) == [7]
    assert said[-1] == (7, 3, 0), "a row that is asked for twice has two results"
    assert said == sorted(said)


def test_computations_run_in_this_process_one_at_a_time(store):
    inside, most = [], []

    def compute(number):
        inside.append(number)
        most.append(len(inside))
        inside.remove(number)
        return 2 * number

    runs = [
        adaptive(store, lambda session, n=n: [session.compute(compute, n) for _ in range(20)], name)
        for n, name in enumerate("ab")
    ]
    assert run_adaptive(here, runs) == [[0] * 20, [2] * 20]
    assert max(most) == 1
    (found,) = run_adaptive(here, [adaptive(store, lambda session: session.compute(threading.get_ident))])
    assert found != threading.get_ident(), "the thread of its session"


def test_work_sees_what_its_caller_set_and_uses_one_thread_for_linear_algebra(store):
    token = WHO.set("me")

    def work(session):
        return (
            WHO.get(),
            {pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"},
            threading.current_thread(),
        )

    try:
        ((who, threads, thread),) = run_adaptive(here, [adaptive(store, work)])
    finally:
        WHO.reset(token)
    assert who == "me"
    assert threads <= {1}
    assert (thread.name, thread.daemon) == ("sinew-session", True)


@pytest.mark.parametrize("error", [LookupError("lost"), KeyboardInterrupt()])
def test_an_error_of_one_ends_all(store, error):
    ended = []

    def fails(session):
        session.ask_all(some(2))
        raise error

    def waits(session):
        try:
            session.next()
        finally:
            ended.append("waits")

    with pytest.raises(type(error)):
        run_adaptive(here, [adaptive(store, fails, "a"), adaptive(store, waits, "b")])
    assert ended == ["waits"]
    assert not [thread for thread in threading.enumerate() if thread.name == "sinew-session"]
    assert store.tables()[0].waiting() + store.tables()[0].finished() == 2


def test_rows_that_nobody_waits_for_are_evaluated(store):
    run_adaptive(here, [adaptive(store, lambda session: session.ask(some(3)))])
    (table,) = store.tables()
    assert table.finished() == 3


def test_a_walltime_is_said_with_the_most_rows_that_the_runs_may_ask_for(store):
    def walltime(session):
        session.ask_all(some(2))
        raise WalltimeReached("the alarm")

    runs = [adaptive(store, walltime, "a", rows=30), adaptive(store, lambda session: None, "b", rows=12)]
    with pytest.raises(WalltimeReached) as error:
        run_adaptive(here, runs)
    assert str(error.value) == (
        "the walltime is near: 2 of at most 42 rows are finished and kept; run the same command again to go on"
    )


def test_an_interrupted_run_is_folded_in_first(store):
    def breaks_off(session):
        session.ask_all(some(3))
        raise LookupError

    with pytest.raises(LookupError):
        run_adaptive(here, [adaptive(store, breaks_off)])
    (table,) = store.tables()
    assert table.waiting() == 3
    done = []
    work = lambda session: done.append((table.finished(), table.waiting()))  # noqa: E731
    run_adaptive(here, [AdaptiveRun([(table, Quick())], 0, work)])
    assert done == [(3, 0)]
