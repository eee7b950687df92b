"""Runs of the solver that are interrupted, and go on where they were."""

from dataclasses import replace

import numpy as np
import pytest

from sinew.runner.evaluation import external
from sinew.runner.evaluation.interim import STATES, kept_until_written
from sinew.tasks.simulate.febio import restarts
from sinew.tasks.simulate.febio.attempt import attempt
from sinew.tasks.simulate.febio.output import Logged, read_output
from sinew.tasks.simulate.febio.restarts import NotTheSame, joined, whole_steps
from sinew.tasks.simulate.row_by_row import Failed
from tests.tasks.simulate.febio.restarting import solver_in

FORCE = Logged("force", "N", ids=(5,))


class Interrupted(BaseException):
    """As a signal that ends a worker."""


@pytest.fixture(autouse=True)
def _often(tmp_path, monkeypatch):
    """The solver is looked at all the time, and the user has a home of his own."""
    monkeypatch.setattr(external, "MEANWHILE_S", 0.02)
    monkeypatch.setattr(restarts, "WORTH", 0.0)
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "home"))


def run(solver, text="<feb/>", end_s=6.0):
    """The forces ``[t]`` of a run."""

    def read(directory):
        return read_output(directory / "force.txt", FORCE, 2**20, end_s)[1]

    return attempt(solver, lambda directory: (directory / "model.feb").write_text(text), read, {}, ["force.txt"])


def interrupted(solver, monkeypatch, text="<feb/>", after=6):
    """A run in a batch that ends behind a step, when a state has been kept."""
    look = restarts.Interim.look

    def looked(self):
        look(self)
        if self.file.exists() and f"step {after}" in solver.noted:
            raise Interrupted

    with monkeypatch.context() as patch:
        patch.setattr(restarts.Interim, "look", looked)
        with pytest.raises(Interrupted), kept_until_written():
            run(solver, text)


def states(solver):
    return list((solver.scratch / STATES).iterdir()) if (solver.scratch / STATES).is_dir() else []


WHOLE = np.arange(1, 13) ** 2.0


def test_an_interrupted_run_goes_on_where_it_was(tmp_path, monkeypatch):
    solver = solver_in(tmp_path)
    interrupted(solver, monkeypatch)
    assert len(states(solver)) == 1
    before = len(solver.noted)
    with kept_until_written():
        found = run(solver)
        (begin, *steps) = solver.noted[before:]
        assert int(begin.removeprefix("from ")) >= 2
        assert len(steps) == 12 - int(begin.removeprefix("from "))
        np.testing.assert_array_equal(found, WHOLE)
        np.testing.assert_array_equal(run(solver), WHOLE)
        assert len(solver.noted) == before + 1 + len(steps), "a run that has ended is not run again in its batch"
    assert not states(solver)
    assert [path.name for path in solver.scratch.iterdir()] == [STATES]


def test_it_may_be_interrupted_again(tmp_path, monkeypatch):
    solver = solver_in(tmp_path, seconds=0.15)
    interrupted(solver, monkeypatch, after=4)
    interrupted(solver, monkeypatch, after=9)
    with kept_until_written():
        np.testing.assert_array_equal(run(solver), WHOLE)
    first, second, third = (int(line.removeprefix("from ")) for line in solver.noted if line.startswith("from "))
    assert first == 0 < second < third


@pytest.mark.parametrize("change", [{"off": 0.5}, {"fails": True}])
def test_one_that_does_not_go_on_as_before_starts_over(tmp_path, monkeypatch, change, caplog):
    solver = solver_in(tmp_path, **change)
    interrupted(solver, monkeypatch)
    with kept_until_written():
        np.testing.assert_array_equal(run(solver), WHOLE)
    begins = [line for line in solver.noted if line.startswith("from ")]
    assert begins[-1] == "from 0"
    assert begins[-2] != "from 0", "it was tried"
    assert "it starts over" in caplog.records[-1].error
    assert [path.name for path in solver.scratch.iterdir()] == [STATES], "what was tried is no failed run"


def test_another_input_another_solver_and_another_user_start_at_the_beginning(tmp_path, monkeypatch):
    solver = solver_in(tmp_path, steps=8)
    interrupted(solver, monkeypatch, after=4)
    (kept,) = states(solver)
    content = kept.read_bytes()
    for other, text, home in ((solver, "<feb />", "home"), (replace(solver, version="9"), "<feb/>", "home"),
                              (solver, "<feb/>", "another home")):  # fmt: skip
        kept.write_bytes(content)
        monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / home))
        with kept_until_written():
            np.testing.assert_array_equal(run(other, text, end_s=4.0), WHOLE[:8])
    assert [line for line in solver.noted if line.startswith("from ")] == ["from 0"] * 4


def test_without_restarts_or_a_batch_nothing_is_kept(tmp_path):
    solver = solver_in(tmp_path, steps=2, seconds=0.0)
    np.testing.assert_array_equal(run(solver, end_s=1.0), WHOLE[:2])
    with kept_until_written():
        np.testing.assert_array_equal(run(replace(solver, restart_s=None), end_s=1.0), WHOLE[:2])
    assert not (solver.scratch / STATES).exists()


def test_the_time_limit_counts_what_was_spent_before(tmp_path, monkeypatch):
    solver = replace(solver_in(tmp_path, steps=10_000), timeout_s=2.0)
    interrupted(solver, monkeypatch, after=8)
    monkeypatch.setattr(restarts.Interim, "seconds", 0.0)
    given = []
    limited = external.run
    monkeypatch.setattr(external, "run", lambda *a, **o: given.append(o["timeout_s"]) or limited(*a, **o))
    with kept_until_written(), pytest.raises(Failed, match="no end after 2 s"):
        run(solver)
    assert given[0] < 1.5, "of the run that goes on"
    assert given[1] == 2.0, "of the one that starts over, as one that fails does"


def test_a_state_is_kept_no_more_often_than_is_asked_for(tmp_path, monkeypatch):
    kept = []
    write = restarts.write_state
    monkeypatch.setattr(restarts, "write_state", lambda *given: kept.append(given[2].ended) or write(*given))
    with kept_until_written():
        run(replace(solver_in(tmp_path, steps=20, seconds=0.05), restart_s=30.0), end_s=10.0)
    assert kept == []
    with kept_until_written():
        run(replace(solver_in(tmp_path, steps=20, seconds=0.05), restart_s=0.4), end_s=10.0)
    assert kept[-1] is True
    assert 1 <= kept.count(False) <= 3


def test_a_solver_whose_steps_are_known_dumps_less_often(tmp_path, monkeypatch):
    """At least twice in the time after which a state is due."""
    monkeypatch.setattr(restarts, "_seconds_per_step", {})
    solver = replace(solver_in(tmp_path, steps=20, seconds=0.02), restart_s=0.5)
    given = []
    limited = external.run
    monkeypatch.setattr(external, "run", lambda *a, **o: given.append(a[0]) or limited(*a, **o))
    for _ in range(3):
        with kept_until_written():
            np.testing.assert_array_equal(run(solver, end_s=10.0), np.arange(1, 21) ** 2.0)
    first, *later = ([word for word in command if "stride" in word] for command in given)
    assert first == []
    ((pace,),) = [restarts._seconds_per_step.values()]
    assert 0.02 <= pace < 0.25
    assert 2 <= int(later[0][0].removeprefix("-dump_stride=")) <= 0.25 / 0.02
    assert len(later[1]) == 1


STEPS = [b"*Step  = %d\n*Time  = %r\n*Data  = f\n1,%r\n2,%r\n" % (n, n / 4, n * 1.0, n * 2.0) for n in range(1, 6)]


@pytest.mark.parametrize("cut", [1, 4, 8, 20])
def test_a_step_that_is_still_written_is_left_out(cut):
    assert whole_steps(b"".join(STEPS)) == b"".join(STEPS)
    assert whole_steps(b"".join(STEPS)[:-cut]) == b"".join(STEPS[:-1])
    assert whole_steps(b"") == b""


def test_logs_are_joined_at_the_first_step_of_the_later():
    assert joined(b"".join(STEPS[:3]), b"".join(STEPS[3:])) == b"".join(STEPS)
    assert joined(b"".join(STEPS[:4]), b"".join(STEPS[2:])) == b"".join(STEPS)
    assert joined(b"".join(STEPS), b"") == b"".join(STEPS)
    assert joined(b"", b"".join(STEPS)) == b"".join(STEPS)


def test_the_last_digits_may_differ_and_the_later_log_has_them():
    off = STEPS[2].replace(b"6.0", b"6.0000001")
    assert joined(b"".join(STEPS[:3]), off + b"".join(STEPS[3:])) == b"".join([*STEPS[:2], off, *STEPS[3:]])


@pytest.mark.parametrize(
    "later",
    [
        STEPS[2].replace(b"6.0", b"6.001"),
        STEPS[2].replace(b"1,3.0\n", b""),
        STEPS[2].replace(b"6.0", b"six"),
        STEPS[2].replace(b"*Time", b"*When"),
        STEPS[2].replace(b"0.75", b"late"),
        b"something else\n",
    ],
)
def test_what_does_not_go_on_as_before_is_noticed(later):
    with pytest.raises(NotTheSame):
        joined(b"".join(STEPS[:4]), later + STEPS[3])
