"""What a worker does with a batch: outcomes, retries, failures as data, and rows that are tried apart."""

import os
from pathlib import Path

import numpy as np
import pytest

from sinew.runner.cluster.batch_systems import this_node
from sinew.runner.evaluation import batch as batch_module
from sinew.runner.evaluation import external
from sinew.runner.evaluation.batch import Batch, Carrier, Outcome, evaluations, run_batch, run_in_time
from sinew.runner.store.schema import STATUSES
from sinew.runner.store.segment import Segment

OK, CRASHED, DIVERGED = (STATUSES.index(name) for name in ("ok", "crashed", "diverged"))
PARAMETERS = np.array([[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]])
ROWS = np.array([4, 5, 7])


class Scripted:
    """An evaluation that does with each row what a script says, call by call."""

    def __init__(self, **script):
        self.script = {float(row[1:]): list(steps) for row, steps in script.items()}
        self.calls = []

    def __call__(self, parameters):
        self.calls.append(parameters[:, 0].tolist())
        status, messages = [], []
        values = parameters.sum(axis=1)
        for place, (first, _) in enumerate(parameters):
            step = self.script[first].pop(0) if self.script.get(first) else "ok"
            if isinstance(step, Exception):
                self.script[first].insert(0, step) if len(parameters) > 1 else None
                raise step
            if step == "nan":
                values[place], step = np.nan, "ok"
            status.append(STATUSES.index(step))
            messages.append(f"{step} {first:g}" if step != "ok" else "")
        numbers = {"sum": values, "pair": np.stack([values, values], axis=1)}
        return Outcome(numbers, np.array(status, dtype=np.int8), tuple(messages) if any(messages) else ())


@pytest.fixture
def batch(tmp_path):
    yield Batch("key", ROWS, PARAMETERS, tmp_path, retries=1)
    evaluations.clear()


def ran(batch: Batch, evaluation=None, **script) -> Segment:
    evaluations["key"] = evaluation or Scripted(**script)
    run_batch(batch)
    return Segment.read(batch.segment, whole=True)


def test_outcomes_are_in_the_journal(batch):
    found = ran(batch)
    assert found.rows.tolist() == [4, 5, 7]
    assert found.values["sum"].tolist() == [3.0, 7.0, 11.0]
    assert found.status.tolist() == [OK] * 3
    assert found.attempts.tolist() == [1] * 3
    assert found.messages == ()
    assert found.worker == f"{this_node()}:{os.getpid()}"
    assert ((found.wall_seconds >= 0) & (found.wall_seconds < 1)).all()


def test_a_job_is_named_with_its_worker(batch, monkeypatch):
    monkeypatch.setattr(batch_module, "current_job", lambda: "77")
    assert ran(batch).worker == f"{this_node()}:{os.getpid()} job 77"


def test_a_segment_is_called_by_its_rows(tmp_path):
    names = [Batch("key", np.array(rows), PARAMETERS, tmp_path, 1).segment for rows in ([4, 5, 7], [4, 6, 7], [4, 5])]
    assert {path.parent for path in names} == {tmp_path}
    assert names[0].name.startswith("rows-000000004-")
    assert names[0].name.endswith("-00003.safetensors")
    assert names[2].name.endswith("-00002.safetensors")
    assert len({path.name for path in names}) == 3
    assert len(names[0].name.split("-")[2]) == 12


def test_what_is_in_the_journal_is_not_evaluated_again(batch):
    ran(batch)
    never = Scripted()
    evaluations["key"] = never
    run_batch(batch)
    run_in_time(batch)
    assert never.calls == []
    batch.segment.write_bytes(b"half")
    run_in_time(batch)
    assert never.calls == [[1.0, 3.0, 5.0]]


def test_a_batch_is_announced_with_its_duration(batch, monkeypatch):
    said = []
    monkeypatch.setattr("sinew.runner.cluster.drain.enter", lambda seconds, *, kept: said.append((seconds, kept)))
    evaluations["key"] = Scripted()
    batch.expected_s = 3.5
    run_in_time(batch)
    run_in_time(batch)
    assert said == [(3.5, None)]


def test_failures_that_may_be_accidental_are_tried_again(batch):
    evaluation = Scripted(r1=["crashed"], r3=["diverged"], r5=["out_of_memory", "bad_output", "ok"])
    found = ran(batch, evaluation)
    assert evaluation.calls == [[1.0, 3.0, 5.0], [1.0, 5.0]]
    assert [STATUSES[status] for status in found.status] == ["ok", "diverged", "bad_output"]
    assert found.attempts.tolist() == [2, 1, 2]
    assert found.messages == ("", "diverged 3", "bad_output 5")
    assert found.values["sum"].tolist()[0] == 3.0
    assert np.isnan(found.values["sum"][1:]).all()
    assert np.isnan(found.values["pair"][1:]).all()


@pytest.mark.parametrize(("retries", "calls"), [(0, 1), (2, 3), (5, 4)])
def test_retries_end_when_all_is_well_or_enough(batch, retries, calls):
    batch.retries = retries
    evaluation = Scripted(r3=["crashed"] * 3)
    found = ran(batch, evaluation)
    assert len(evaluation.calls) == calls
    assert found.attempts.tolist() == [1, calls, 1]
    assert found.status.tolist() == [OK, OK if retries == 5 else CRASHED, OK]


def test_time_is_shared_by_the_rows_of_a_call(batch, monkeypatch):
    clock = iter([10.0, 16.0, 20.0, 25.0])
    monkeypatch.setattr("time.perf_counter", lambda: next(clock))
    assert ran(batch, r3=["crashed"]).wall_seconds.tolist() == [2.0, 7.0, 2.0]


@pytest.mark.parametrize(
    ("error", "status", "words"),
    [
        (ArithmeticError("no such tissue"), "crashed", "ArithmeticError: no such tissue"),
        (MemoryError("too much"), "out_of_memory", "MemoryError: too much"),
    ],
)
def test_an_exception_fails_its_row_alone(batch, error, status, words):
    batch.retries = 0
    evaluation = Scripted(r3=[error] * 3)
    found = ran(batch, evaluation)
    assert evaluation.calls == [[1.0, 3.0, 5.0], [1.0], [3.0], [5.0]]
    assert [STATUSES[each] for each in found.status] == ["ok", status, "ok"]
    assert found.messages == ("", words, "")
    assert found.values["sum"][[0, 2]].tolist() == [3.0, 11.0]
    assert np.isnan(found.values["pair"][1]).all()
    assert found.values["pair"].shape == (3, 2)


def test_a_row_that_raises_at_first_has_its_numbers_in_the_end(tmp_path):
    found = ran(Batch("key", ROWS[:1], PARAMETERS[:1], tmp_path, 1), r1=[ArithmeticError("once")])
    assert found.values["sum"].tolist() == [3.0]
    assert found.values["pair"].tolist() == [[3.0, 3.0]]
    assert (found.status.tolist(), found.attempts.tolist(), found.messages) == ([OK], [2], ("",))


def test_where_all_rows_raise_there_are_no_numbers(batch):
    found = ran(batch, **{f"r{n}": [ArithmeticError("no")] * 9 for n in (1, 3, 5)})
    assert dict(found.values) == {}
    assert found.status.tolist() == [CRASHED] * 3
    assert found.messages == ("ArithmeticError: no",) * 3


def test_numbers_that_are_not_finite_are_a_failure_unless_there_is_one(batch):
    batch.retries = 0
    found = ran(batch, r1=["nan"], r3=["diverged"])
    assert [STATUSES[status] for status in found.status] == ["bad_output", "diverged", "ok"]
    assert found.messages == ("the outcome holds numbers that are not finite", "diverged 3", "")
    assert np.isnan(found.values["pair"]).tolist() == [[True, True], [True, True], [False, False]]
    assert found.values["sum"][2] == 11.0


def test_an_evaluation_keeps_the_arrays_that_it_returned(batch):
    shared = {"sum": np.array([1.0, 2.0, 3.0])}
    batch.retries = 0
    ran(batch, lambda parameters: Outcome(shared, np.array([0, DIVERGED, 0], dtype=np.int8)))
    assert shared["sum"].tolist() == [1.0, 2.0, 3.0]


def test_errors_of_the_system_fail_no_row(batch):
    with pytest.raises(OSError, match="disk"):
        ran(batch, r3=[OSError("disk")])
    assert not batch.segment.exists()


@pytest.mark.parametrize("times", [1, 4, 5])
def test_a_solver_that_is_stopped_from_outside_is_started_again(batch, monkeypatch, times):
    slept = []
    monkeypatch.setattr("time.sleep", slept.append)
    stops = [external.Stopped("SIGTERM")] * times

    def evaluation(parameters):
        if stops:
            raise stops.pop()
        return Scripted()(parameters)

    found = ran(batch, evaluation)
    assert slept == [2.0] * times
    if times < 5:
        assert found.status.tolist() == [OK] * 3
        return
    assert found.status.tolist() == [CRASHED] * 3
    assert found.messages == ("the solver was stopped 5 times from outside (SIGTERM)",) * 3
    assert found.attempts.tolist() == [5] * 3
    assert np.isnan(found.wall_seconds).all()
    assert dict(found.values) == {}


def test_rows_are_tried_apart(batch):
    parts = batch.rows_apart()
    assert [part.rows.tolist() for part in parts] == [[4], [5], [7]]
    assert [part.parameters.tolist() for part in parts] == [[[1.0, 2.0]], [[3.0, 4.0]], [[5.0, 6.0]]]
    assert {(part.key, part.retries, part.apart, part.segment.parent) for part in parts} == {
        ("key", 1, 1, batch.segment.parent)
    }
    assert parts[0].rows_apart()[0].apart == 2
    assert batch.apart == 0


def test_a_process_that_dies_with_its_row_is_its_failure(batch, monkeypatch):
    batch.apart = 2
    monkeypatch.setattr("sinew.runner.evaluation.isolation.run_apart", lambda work: "SIGKILL")
    found = ran(batch)
    assert found.status.tolist() == [CRASHED] * 3
    assert found.messages == ("its process died while it evaluated this row alone (SIGKILL)",) * 3
    assert found.attempts.tolist() == [2] * 3
    assert np.isnan(found.wall_seconds).all()
    assert found.worker == f"{this_node()}:{os.getpid()}"
    assert found.rows.tolist() == [4, 5, 7]


@pytest.mark.parametrize(("times", "status"), [(2, OK), (batch_module.STOPPED_SOLVERS, CRASHED)])
def test_a_process_that_somebody_stops_is_started_again(batch, monkeypatch, times, status):
    calls = []

    def stopped(work):
        calls.append(1)
        if len(calls) <= times:
            raise external.Stopped("python was ended by SIGTERM")
        work()

    monkeypatch.setattr(batch_module.isolation, "run_apart", stopped)
    monkeypatch.setattr(batch_module, "AGAIN_S", 0.0)
    batch.apart = 1
    assert ran(batch).status.tolist() == [status] * 3


def test_a_process_that_lives_has_written_the_outcome(batch, monkeypatch):
    batch.apart = 1
    monkeypatch.setattr("sinew.runner.evaluation.isolation.run_apart", lambda work: work())
    assert ran(batch).status.tolist() == [OK] * 3


def test_a_process_that_ends_without_a_segment_has_failed(batch, monkeypatch):
    batch.apart = 1
    monkeypatch.setattr("sinew.runner.evaluation.isolation.run_apart", lambda work: None)
    assert ran(batch).status.tolist() == [CRASHED] * 3


def test_evaluations_come_and_go_with_their_carrier():
    carrier = Carrier("abc", {"one": Scripted(), "two": Scripted()})
    assert carrier.name == "sinew-evaluations-abc"
    carrier.setup(None)
    assert evaluations == carrier.carried
    del evaluations["one"]
    evaluations["other"] = Scripted()
    carrier.teardown(None)
    assert list(evaluations) == ["other"]
    evaluations.clear()


def test_a_journal_may_be_anywhere():
    assert Batch("key", ROWS, PARAMETERS, Path("/a/b"), 1).rows_apart()[0].segment.parent == Path("/a/b")
