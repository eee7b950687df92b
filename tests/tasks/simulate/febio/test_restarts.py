"""Runs of the solver that are interrupted, and go on where they were."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sinew.runner.evaluation import external
from sinew.runner.evaluation.interim import STATES, kept_count, kept_until_written
from sinew.tasks.simulate.febio import restarts
from sinew.tasks.simulate.febio.attempt import attempt
from sinew.tasks.simulate.febio.output import Logged, read_output
from sinew.tasks.simulate.febio.restarts import NotTheSame, joined, whole_steps
from sinew.tasks.simulate.febio.states import State, read_state
from sinew.tasks.simulate.row_by_row import Failed
from tests.tasks.simulate.febio.restarting import Interrupted, solver_in

FORCE = Logged("force", "N", ids=(5,))
COUNT = 40  # steps of a run; there is time for many looks behind the step at which one is interrupted
WHOLE = np.arange(1, COUNT + 1) ** 2.0
END_S = COUNT / 2


@pytest.fixture(autouse=True)
def _often(tmp_path, monkeypatch):
    """The solver is looked at all the time, and the user has a home of his own."""
    monkeypatch.setattr(external, "MEANWHILE_S", 0.02)
    monkeypatch.setattr(restarts, "WORTH", 0.0)
    monkeypatch.setattr(restarts, "_seconds_per_step", {})
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "home"))


@pytest.fixture
def solver(tmp_path):
    return solver_in(tmp_path, steps=COUNT, seconds=0.05)


def run(solver, text="<feb/>", end_s=END_S):
    """The forces ``[t]`` of a run."""

    def read(directory):
        return read_output(directory / "force.txt", FORCE, 2**20, end_s)[1]

    return attempt(solver, lambda directory: (directory / "model.feb").write_text(text), read, {}, ["force.txt"])


def interrupted(solver, monkeypatch, text="<feb/>", after=6):
    """A run in a batch that ends behind a step, when a state has been kept."""
    look, before = restarts.Interim.look, kept_count()

    def looked(self):
        look(self)
        if kept_count() > before and f"step {after}" in solver.noted:
            raise Interrupted

    with monkeypatch.context() as patch:
        patch.setattr(restarts.Interim, "look", looked)
        with pytest.raises(Interrupted), kept_until_written():
            run(solver, text)


def states(solver):
    return list((solver.scratch / STATES).iterdir()) if (solver.scratch / STATES).is_dir() else []


def begins(solver):
    """The steps from which runs began."""
    return [int(line.removeprefix("from ")) for line in solver.noted if line.startswith("from ")]


def test_an_interrupted_run_goes_on_where_it_was(solver, monkeypatch):
    interrupted(solver, monkeypatch)
    assert len(states(solver)) == 1
    before = len(solver.noted)
    with kept_until_written():
        found = run(solver)
        begin = begins(solver)[1]
        assert begin > 0
        assert solver.noted[before + 1 :] == [f"step {n}" for n in range(begin + 1, COUNT + 1)]
        np.testing.assert_array_equal(found, WHOLE)
        before = len(solver.noted)
        np.testing.assert_array_equal(run(solver), WHOLE)
        assert len(solver.noted) == before, "a run that has ended is not run again in its batch"
    assert not states(solver)
    assert [path.name for path in solver.scratch.iterdir()] == [STATES]


def test_it_may_be_interrupted_again(solver, monkeypatch):
    interrupted(solver, monkeypatch, after=5)
    interrupted(solver, monkeypatch, after=12)
    with kept_until_written():
        np.testing.assert_array_equal(run(solver), WHOLE)
    first, second, third = begins(solver)
    assert first == 0 < second <= third


@pytest.mark.parametrize("change", [{"off": 0.5}, {"fails": True}])
def test_one_that_does_not_go_on_as_before_starts_over(tmp_path, monkeypatch, change, caplog):
    solver = solver_in(tmp_path, steps=COUNT, seconds=0.05, **change)
    interrupted(solver, monkeypatch)
    with kept_until_written():
        np.testing.assert_array_equal(run(solver), WHOLE)
    first, tried, again = begins(solver)
    assert first == again == 0 < tried
    assert "it starts over" in caplog.records[-1].error
    assert [path.name for path in solver.scratch.iterdir()] == [STATES], "what was tried is no failed run"
    assert not states(solver)


def test_a_run_that_fails_in_any_case_starts_over_once_only(tmp_path, monkeypatch):
    solver = solver_in(tmp_path, steps=COUNT, seconds=0.05, fails_at=30)
    interrupted(solver, monkeypatch)
    with kept_until_written(), pytest.raises(Failed, match="exit code 1"):
        run(solver)
    first, tried, again = begins(solver)
    assert first == again == 0 < tried
    (kept,) = solver.scratch.glob("failed-*")
    assert not [path.name for path in kept.iterdir() if path.suffix == ".dmp"]


def test_that_it_has_started_over_is_known_in_the_next_job(tmp_path, monkeypatch):
    solver = solver_in(tmp_path, steps=COUNT, seconds=0.05, fails_at=30)
    interrupted(solver, monkeypatch)
    over = restarts.Interim.start_over

    def interrupted_then(self):
        over(self)
        raise Interrupted

    with monkeypatch.context() as patch:
        patch.setattr(restarts.Interim, "start_over", interrupted_then)
        with pytest.raises(Interrupted), kept_until_written():
            run(solver)
    interrupted(solver, monkeypatch)
    with kept_until_written(), pytest.raises(Failed, match="exit code 1"):
        run(solver)
    first, tried, again, last = begins(solver)
    assert first == again == 0 < tried
    assert last > 0, "it went on, failed again, and that counts"


def test_another_input_and_another_solver_start_at_the_beginning(solver, monkeypatch):
    interrupted(solver, monkeypatch, after=4)
    for other, text in ((solver, "<feb />"), (replace(solver, version="9"), "<feb/>")):
        with kept_until_written():
            np.testing.assert_array_equal(run(other, text), WHOLE)
    assert begins(solver) == [0, 0, 0]


def test_a_state_of_another_user_ends_the_run(solver, tmp_path, monkeypatch):
    """As it would start over in each job without end, where nodes have homes of their own."""
    interrupted(solver, monkeypatch, after=4)
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "another home"))
    with pytest.raises(PermissionError, match="was not signed by you, or with another home"), kept_until_written():
        run(solver)
    assert not list(solver.scratch.glob("attempt-*"))


def test_a_link_in_place_of_the_folder_is_refused(solver, tmp_path):
    (tmp_path / "elsewhere").mkdir()
    solver.scratch.mkdir()
    (solver.scratch / STATES).symlink_to(tmp_path / "elsewhere")
    with pytest.raises(OSError, match="is a link; remove it"), kept_until_written():
        run(solver)
    assert not list((tmp_path / "elsewhere").iterdir())


@pytest.mark.parametrize(("make", "kind"), [(os.mkfifo, "a named pipe"), (Path.touch, "a regular file")])
def test_what_is_no_folder_in_its_place_is_told(solver, make, kind):
    solver.scratch.mkdir()
    make(solver.scratch / STATES)
    with pytest.raises(OSError, match=f"is {kind}; remove it, it must be a folder"), kept_until_written():
        run(solver)


def test_without_restarts_or_a_batch_nothing_is_kept(tmp_path):
    solver = solver_in(tmp_path, steps=2, seconds=0.0)
    np.testing.assert_array_equal(run(solver, end_s=1.0), WHOLE[:2])
    with kept_until_written():
        np.testing.assert_array_equal(run(replace(solver, restart_s=None), end_s=1.0), WHOLE[:2])
    assert not (solver.scratch / STATES).exists()


def test_the_time_limit_counts_what_was_spent_before(tmp_path, monkeypatch):
    solver = replace(solver_in(tmp_path, steps=10_000), timeout_s=3.0)
    interrupted(solver, monkeypatch, after=8)
    given = []
    limited = external.run
    monkeypatch.setattr(external, "run", lambda *a, **o: given.append(o["timeout_s"]) or limited(*a, **o))
    with kept_until_written(), pytest.raises(Failed, match="no end after 3 s"):
        run(solver)
    assert len(given) == 1, "it does not start over"
    assert given[0] < 3.0


def test_a_state_that_cannot_be_kept_does_not_hide_why_the_disk_is_full(solver, monkeypatch):
    interrupted(solver, monkeypatch)
    monkeypatch.setattr("sinew.tasks.simulate.febio.attempt._is_full", lambda _: True)
    monkeypatch.setattr(restarts, "joined", lambda *_: (_ for _ in ()).throw(NotTheSame("cut short")))
    with pytest.raises(OSError, match="No space left"), kept_until_written():
        run(solver)
    assert states(solver), "hours of work stay"


# ---- when a state is kept


@pytest.fixture
def clock(monkeypatch):
    """The time, which stands still unless a test moves it."""
    now = [100.0]
    monkeypatch.setattr("sinew.tasks.simulate.febio.restarts.time.monotonic", lambda: now[0])
    return now


@pytest.fixture
def interim(tmp_path, clock):
    """Of a run whose state is due after 10 s."""
    (tmp_path / "run").mkdir()
    return restarts.Interim(tmp_path / "run", tmp_path / "a.state", 10.0, 2**20, ["f.txt"], b"s" * 32, began=clock[0])


def solved(interim, steps):
    """The solver has dumped and logged so many steps."""
    interim.dump.write_bytes(b"state %d" % steps)
    (interim.directory / "f.txt").write_bytes(b"".join(STEPS[:steps]))
    said = "".join(f"------- converged at time : {n}\n" for n in range(steps))
    (interim.directory / "model.log").write_text(said)


def kept(interim):
    """The state and the dump that are kept."""
    copy = interim.directory / "copy"
    found = read_state(interim.file, interim.secret, copy, 2**20)
    return found, copy.read_bytes() if copy.exists() else None


def test_a_state_is_kept_when_it_is_due_and_a_later_step_was_logged(interim, clock):
    """Of a dump that was taken before its own step was logged, as far as is known."""
    solved(interim, 1)
    interim.look()
    assert interim.dump.exists(), "it is not due"
    clock[0] += 10.0
    interim.look()
    assert not interim.dump.exists()
    for steps in (1, 2):
        solved(interim, steps)
        interim.look()
        assert not interim.file.exists(), "a run that goes on may have no step in common with it"
    solved(interim, 3)
    before = kept_count()
    interim.look()
    state, dump = kept(interim)
    assert dump == b"state 1"
    assert state == State({"f.txt": b"".join(STEPS[:3])}, 10.0, step=10.0 / 3)
    assert kept_count() == before + 1
    solved(interim, 5)
    clock[0] += 9.0
    interim.look()
    assert interim.dump.exists(), "the next is not due"


def test_of_a_dump_that_was_not_written_for_a_while_the_last_step_is_its_own(interim, clock):
    clock[0] += 10.0
    solved(interim, 1)
    for _ in range(3):  # taken away, looked at, unchanged
        interim.look()
    solved(interim, 1)
    interim.look()
    assert not interim.file.exists()
    solved(interim, 2)
    interim.look()
    assert kept(interim)[1] == b"state 1"


def test_a_dump_that_is_still_written_may_be_of_a_step_that_is_not_logged(interim, clock):
    clock[0] += 10.0
    solved(interim, 1)
    interim.look()
    for number in range(1, 4):
        os.utime(interim._taken, ns=(number, number))
        interim.look()
    solved(interim, 2)
    interim.look()
    assert not interim.file.exists()


def test_a_log_that_cannot_be_read_keeps_nothing(interim, clock):
    clock[0] += 10.0
    solved(interim, 1)
    interim.look()
    solved(interim, 4)
    (interim.directory / "f.txt").unlink()
    interim.look()
    (interim.directory / "f.txt").mkdir()
    interim.look()
    assert not interim.file.exists()


@pytest.mark.parametrize("kind", ["link", "pipe", "folder"])
def test_what_is_no_dump_is_left_alone(interim, clock, kind, tmp_path):
    solved(interim, 1)
    interim.dump.unlink()
    if kind == "link":
        interim.dump.symlink_to(tmp_path / "private")
    elif kind == "pipe":
        os.mkfifo(interim.dump)
    else:
        interim.dump.mkdir()
    clock[0] += 10.0
    interim.look()
    assert interim.taken is None
    assert os.path.lexists(interim.dump)


def test_dumps_have_names_that_no_template_knows(tmp_path):
    names = {restarts.Interim(tmp_path, tmp_path / "a", 1.0, 1, [], b"").dump.name for _ in range(20)}
    assert len(names) == 20


@pytest.mark.parametrize(("pace", "before", "stride"), [(0.0, None, 1), (2.0, None, 2), (0.1, None, 50), (9.0, None, 1),
                                                        (0.0, 0.5, 10), (1.0, 0.5, 5)])  # fmt: skip
def test_a_solver_whose_steps_are_known_dumps_twice_while_a_state_becomes_due(
    interim, monkeypatch, pace, before, stride
):
    if pace:
        monkeypatch.setattr(restarts, "_seconds_per_step", {interim.file.parent: pace})
    interim.before = None if before is None else State({}, 3.0, step=before)
    found = [word for word in interim.options if word.startswith("-dump_stride=")]
    assert found == ([f"-dump_stride={stride}"] if stride > 1 else [])


STEPS = [b"*Step  = %d\n*Time  = %r\n*Data  = f\n1,%r\n2,%r\n" % (n, n / 4, n * 1.0, n * 2.0) for n in range(1, 6)]


@pytest.mark.parametrize("cut", [1, 4, 8, 20])
def test_a_step_that_is_still_written_is_left_out(cut):
    assert whole_steps(b"".join(STEPS)) == b"".join(STEPS)
    assert whole_steps(b"".join(STEPS)[:-cut]) == b"".join(STEPS[:-1])
    assert whole_steps(b"") == b""


def test_logs_are_joined_at_the_first_step_of_the_later():
    assert joined(b"".join(STEPS[:4]), b"".join(STEPS[2:])) == b"".join(STEPS)
    assert joined(b"".join(STEPS[:3]), b"".join(STEPS[2:])) == b"".join(STEPS)


@pytest.mark.parametrize(
    ("earlier", "later", "words"),
    [
        (STEPS[:3], STEPS[3:], "no step is in both"),
        (STEPS, [], "no step is in both"),
        ([], STEPS, "no step is in both"),
        (STEPS[:4], [STEPS[2], STEPS[4]], "other numbers at 1 s"),
        (STEPS[:4], [STEPS[2], STEPS[2], STEPS[3]], "two steps at 0.75 s"),
        ([STEPS[0], STEPS[0], STEPS[1]], STEPS[1:], "two steps at 0.25 s"),
    ],
)
def test_logs_that_do_not_meet_are_not_joined(earlier, later, words):
    with pytest.raises(NotTheSame, match=words):
        joined(b"".join(earlier), b"".join(later))


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
