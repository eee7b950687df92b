"""How a run of the solver ends, what is kept of it, and which version the solver has."""

import errno
import json
import os
import shutil
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sinew.runner import confine
from sinew.runner.errors import BadInput
from sinew.runner.evaluation import external
from sinew.runner.store.schema import STATUSES
from sinew.tasks.simulate.febio import attempt
from sinew.tasks.simulate.febio.attempt import LARGEST_PROGRAM, program_hash, solver_version
from tests.runner.test_confine import CONFINED
from tests.tasks.simulate.febio.fake_solver import (
    BAR,
    BREAK,
    OK,
    PULL,
    attempts,
    outcome,
    rows_with,
    solver,
)

HANG = "import subprocess; subprocess.Popen(['sleep', '1000']); time.sleep(1000)"
NO_CONVERGENCE = (
    "log(STEP, box('Max nr of reformations reached.'), 'Max. nr of retries reached.\\n', ERROR); sys.exit(1)"
)
REFUSE = "log(box('Failed initializing material 1'), box('Model initialization failed')); sys.exit(1)"
ENDS = {
    "diverged": (NO_CONVERGENCE, "diverged", ["Max nr of reformations reached."]),
    "diverged after retries": (
        "for n in range(400): log(STEP, 'Retrying time step. ', box('Problem diverged.'))\nlog(ERROR); sys.exit(1)",
        "diverged",
        ["Problem diverged."],
    ),
    "diverged without a word": ("log(STEP, 'residual is 7\\n', ERROR); sys.exit(1)", "diverged", ["residual is 7"]),
    "negative jacobian": (BREAK, "negative_jacobian", ["Negative jacobian was detected at element 1. Gauss point 3"]),
    "exit code": ("log(STEP); sys.exit(3)", "crashed", ["exit code 3"]),
    "exit code and words": ("log(STEP); print('what a pity'); sys.exit(3)", "crashed", ["code 3", "what a pity"]),
    "no library": ("print('libmissing.so: cannot open'); sys.exit(127)", "crashed", ["code 127", "libmissing.so"]),
    "SIGSEGV": ("log(STEP); os.kill(os.getpid(), signal.SIGSEGV)", "crashed", ["ended by SIGSEGV"]),
    "SIGABRT": (
        "print('terminate called', flush=True); os.kill(os.getpid(), signal.SIGABRT)",
        "crashed",
        ["ended by SIGABRT", "terminate called"],
    ),
    "signal without a name": ("os.kill(os.getpid(), 40)", "crashed", ["40"]),
    "end without a word": ("write(reactions()); log(STEP)", "crashed", ["without NORMAL TERMINATION"]),
    "nothing at all": ("", "crashed", ["without NORMAL TERMINATION"]),
    "no reactions": ("log(STEP, NORMAL)", "bad_output", ["no reaction.txt"]),
    "empty reactions": ("write(''); log(NORMAL)", "bad_output", ["reaction.txt holds 0 steps and 0 lines"]),
    "half the reactions": (
        "text = reactions(); write(text[:len(text) // 2]); log(NORMAL)",
        "bad_output",
        ["reaction.txt", "of 8 steps"],
    ),
    "a step without its last line": (
        "write(reactions().rpartition('8,')[0]); log(NORMAL)",
        "bad_output",
        ["reaction.txt holds 8 steps and 31 lines"],
    ),
    "a number cut in two": ("write(reactions()[:-3]); log(NORMAL)", "bad_output", ["reaction.txt"]),
    "a node cut in two": ("write(reactions().rpartition(',')[0]); log(NORMAL)", "bad_output", ["reaction.txt"]),
    "steps without reactions": (
        "write(''.join(line + '\\n' for line in reactions().splitlines() if line[0] == '*')); log(NORMAL)",
        "bad_output",
        ["reaction.txt holds 8 steps and 0 lines"],
    ),
    "reactions of one step among another's": (
        "lines = reactions().splitlines(True); lines.insert(3, lines.pop(10)); write(''.join(lines)); log(NORMAL)",
        "bad_output",
        ["reaction.txt"],
    ),
    "words for numbers": ("write(reactions().replace('8,', '8,about ')); log(NORMAL)", "bad_output", ["about"]),
    "garbage": ("write('lorem ipsum\\n' * 50); log(NORMAL)", "bad_output", ["lorem ipsum"]),
    "binary garbage": (
        "open('reaction.txt', 'wb').write(bytes(range(256)) * 9); log(NORMAL)",
        "bad_output",
        ["not text"],
    ),
    "NaN": ("write(reactions(float('nan'))); log(NORMAL)", "bad_output", ["not finite"]),
    "one NaN": (
        "write(reactions().rpartition('8,')[0] + '8,-nan\\n'); log(NORMAL)",
        "bad_output",
        ["not finite"],
    ),
    "infinite": ("write(reactions(float('inf'))); log(NORMAL)", "bad_output", ["not finite"]),
    "infinities that cancel": (
        "write(reactions().rpartition('7,')[0] + '7,inf\\n8,-inf\\n'); log(NORMAL)",
        "bad_output",
        ["not finite"],
    ),
    "a sum that overflows": (
        "write(reactions().rpartition('7,')[0] + '7,1e308\\n8,1e308\\n'); log(NORMAL)",
        "bad_output",
        ["not finite"],
    ),
    "late": (
        "write(reactions().replace('*Time  = 0.5\\n', '*Time  = 0.51\\n')); log(NORMAL)",
        "bad_output",
        ["step 2 is at 0.51 s, not at 0.5 s"],
    ),
    "times that are no numbers": (
        "write(reactions().replace('*Time  = 0.5\\n', '*Time  = nan\\n')); log(NORMAL)",
        "bad_output",
        ["step 2"],
    ),
    "a step too many": (
        "write(reactions() + reactions()[-90:]); log(NORMAL)",
        "bad_output",
        ["reaction.txt"],
    ),
    "bad_alloc": (
        "log(STEP, \"terminate called after throwing an instance of 'std::bad_alloc'\\n\"); os.abort()",
        "out_of_memory",
        ["bad_alloc"],
    ),
    "no memory": (
        "log(STEP, box('Memory allocation failure in the linear solver'), ERROR); sys.exit(1)",
        "out_of_memory",
        ["Memory allocation failure"],
    ),
    "refused": (REFUSE, "bad_input", ["Failed initializing material 1; Model initialization failed"]),
    "refused before the first step": (
        "log(box('Invalid value for parameter E'), ERROR); sys.exit(1)",
        "bad_input",
        ["Invalid value for parameter E"],
    ),
}


@pytest.mark.parametrize("name", ENDS)
def test_a_failed_run_has_a_status_and_the_solvers_words(tmp_path, model, name):
    play, status, words = ENDS[name]
    simulator = solver(tmp_path, play)
    found, message = outcome(simulator, model)
    assert found == status
    for word in words:
        assert word in message
    (kept,) = attempts(simulator)
    assert kept.startswith(f"failed-{status}-")
    told = json.loads((simulator.scratch / kept / "failure.json").read_text())
    assert (told["status"], told["message"]) == (status, message)
    assert "\n" not in message


def test_silent_refusal_of_the_input_is_bad_input(tmp_path, model):
    """What febio4 4.11 does when it cannot read its input: with -silent it says nothing and opens no log."""
    simulator = solver(tmp_path, "print('Reading configuration file: /opt/febio/bin/febio.xml'); sys.exit(1)")
    assert outcome(simulator, model)[0] == "bad_input"


def test_a_run_that_hangs_is_a_timeout(tmp_path, model):
    simulator = replace(solver(tmp_path, f"log('half way\\n')\n{HANG}"), timeout_s=0.5)
    status, message = outcome(simulator, model)
    assert status == "timeout"
    assert message.startswith("no end after 0.5 s. half way")


def test_a_run_that_says_it_failed_but_then_hangs_is_a_timeout(tmp_path, model):
    simulator = replace(
        solver(tmp_path, f"log(STEP, box('Negative jacobian detected.'), ERROR)\n{HANG}"), timeout_s=0.5
    )
    status, message = outcome(simulator, model)
    assert status == "timeout"
    assert "Negative jacobian detected." in message


@pytest.mark.parametrize("file", ["reaction.txt", "model.log", "solver-output.txt"])
def test_a_file_that_is_too_large_is_bad_output(tmp_path, model, file):
    play = f"with open({file!r}, 'a') as file:\n    for _ in range(9000): file.write('x' * 999 + '\\n')\n{OK}"
    simulator = replace(solver(tmp_path, play), max_file_bytes=1_000_000)
    status, message = outcome(simulator, model)
    assert status == "bad_output"
    assert "larger than max_file_mb" in message
    (kept,) = simulator.scratch.iterdir()
    assert max(path.stat().st_size for path in kept.iterdir()) <= 1_000_000


def test_every_status_has_been_tried():
    tried = {status for _, status, _ in ENDS.values()} | {"ok", "timeout"}
    assert tried == set(STATUSES)


def test_impossible_parameters_never_start_the_solver(tmp_path, model):
    simulator = solver(tmp_path, f"open({str(tmp_path / 'started')!r}, 'w')\n{OK}")
    rows = np.concatenate([rows_with(model, "tau_2f", 0.0, -1.0), rows_with(model, "nu_m", 0.5)])
    rows = np.concatenate([rows, rows_with(model, "E_f", np.nan, np.inf)])
    simulated = simulator.simulate(model, BAR, PULL, rows)
    assert [STATUSES[s] for s in simulated.status] == ["bad_input"] * 5
    assert "tau_2f = 0; expected above 0 s" in simulated.messages[0]
    assert "nu_m = 0.5" in simulated.messages[2]
    assert np.isnan(simulated.force_N).all()
    assert not (tmp_path / "started").exists()
    assert attempts(simulator) == []


def test_a_failed_row_does_not_touch_its_neighbours(tmp_path, model):
    play = f"if E_m == 20:\n    {BREAK}\nif E_m == 30:\n    os.kill(os.getpid(), signal.SIGSEGV)\n{OK}"
    simulator = solver(tmp_path, play)
    rows = np.concatenate([rows_with(model, "E_m", 12.0, 20.0, 13.0, 30.0, 14.0), rows_with(model, "tau_1m", 0.0)])
    rows = np.concatenate([rows, rows_with(model, "E_m", 15.0)])
    simulated = simulator.simulate(model, BAR, PULL, rows)
    names = ["ok", "negative_jacobian", "ok", "crashed", "ok", "bad_input", "ok"]
    assert [STATUSES[s] for s in simulated.status] == names
    good = simulated.status == 0
    alone = solver(tmp_path).simulate(model, BAR, PULL, rows[good])
    assert simulated.force_N[good].tobytes() == alone.force_N.tobytes()
    assert np.isnan(simulated.force_N[~good]).all()
    assert [bool(message) for message in simulated.messages] == (~good).tolist()


@pytest.mark.parametrize("keep_failed", [0, 1, 3])
def test_failed_attempts_are_kept_up_to_a_number(tmp_path, model, keep_failed):
    simulator = replace(solver(tmp_path, f"if E_m < 50:\n    {BREAK}\n{OK}"), keep_failed=keep_failed)
    rows = rows_with(model, "E_m", 60.0, 11.0, 61.0, 12.0, 13.0, 14.0)
    simulated = simulator.simulate(model, BAR, PULL, rows)
    assert (simulated.status > 0).sum() == 4
    kept = attempts(simulator)
    assert len(kept) == keep_failed
    for name in kept:
        files = {path.name for path in (simulator.scratch / name).iterdir()}
        assert files == {"model.feb", "model.log", "solver-output.txt", "failure.json"}
    simulator.simulate(model, BAR, PULL, rows)
    assert attempts(simulator) == kept


def test_a_long_message_is_cut(tmp_path, model):
    lines = ", ".join(repr(f"line {n} of a long complaint that a solver makes") for n in range(30))
    simulator = solver(tmp_path, f"log(STEP, box({lines}), ERROR); sys.exit(1)")
    status, message = outcome(simulator, model)
    assert status == "diverged"
    assert message.startswith("line 0 of a long complaint")
    assert len(message) == 500


def full_disk(monkeypatch) -> None:
    nothing = shutil.disk_usage(Path.cwd())._replace(free=0)
    monkeypatch.setattr(attempt.shutil, "disk_usage", lambda path: nothing)


@pytest.mark.parametrize("name", ["half the reactions", "diverged", "end without a word", "SIGSEGV"])
def test_a_full_disk_fails_no_row(tmp_path, model, monkeypatch, name):
    full_disk(monkeypatch)
    simulator = solver(tmp_path, ENDS[name][0])
    with pytest.raises(OSError, match="No space left") as caught:
        simulator.simulate(model, BAR, PULL, model.reference[np.newaxis])
    assert caught.value.errno == errno.ENOSPC
    assert attempts(simulator) == [], "they take room on a disk that is full"


def test_a_full_disk_does_not_matter_to_a_row_that_succeeds(tmp_path, model, monkeypatch):
    full_disk(monkeypatch)
    assert outcome(solver(tmp_path), model) == ("ok", "")


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EDQUOT, errno.EIO])
def test_input_that_cannot_be_written_fails_no_row(tmp_path, model, monkeypatch, number):
    write_text = Path.write_text

    def refuse(path: Path, *arguments, **options):
        if path.name == "model.feb":
            raise OSError(number, os.strerror(number), str(path))
        return write_text(path, *arguments, **options)

    simulator = solver(tmp_path)
    monkeypatch.setattr(Path, "write_text", refuse)
    with pytest.raises(OSError) as caught:
        simulator.simulate(model, BAR, PULL, model.reference[np.newaxis])
    assert caught.value.errno == number
    assert attempts(simulator) == []


def test_a_solver_that_has_gone_fails_no_row(tmp_path, model):
    simulator = replace(solver(tmp_path), executable=str(tmp_path / "gone"))
    with pytest.raises(FileNotFoundError):
        simulator.simulate(model, BAR, PULL, model.reference[np.newaxis])
    assert attempts(simulator) == []


def test_version(tmp_path):
    solver(tmp_path)
    assert solver_version(tmp_path / "febio4") == "4.77.fake"


def test_a_file_larger_than_any_program_is_refused_unread(tmp_path):
    program = tmp_path / "febio4"
    with open(program, "wb") as file:
        file.truncate(LARGEST_PROGRAM + 1)  # sparse: it takes no space
    with pytest.raises(BadInput, match=r"febio4: 2\.0 GB; expected a solver program of at most 2 GB"):
        program_hash(program)


def test_version_of_a_solver_that_does_not_say(tmp_path):
    program = tmp_path / "febio4"
    versions = set()
    for text in ("echo hello", "echo what", "true"):
        program.write_text(f"#!/bin/sh\n{text}\n")
        program.chmod(0o755)
        versions.add(solver_version(program))
    assert len(versions) == 3
    assert all(version.startswith("unknown-") for version in versions)


@pytest.mark.parametrize("text", ["exit 3", "kill -SEGV $$", "kill -KILL $$", "kill -TERM $$", "sleep 60"])
def test_a_solver_that_does_not_answer_gets_no_identity(tmp_path, monkeypatch, text):
    monkeypatch.setattr(attempt, "VERSION_S", 0.5)
    monkeypatch.setattr(external, "_KILLED_TOO_S", 0.0)
    program = tmp_path / "febio4"
    program.write_text(f"#!/bin/sh\necho x >> {tmp_path}/asked\n{text}\n")
    program.chmod(0o755)
    with pytest.raises(BadInput, match=r"febio4: asked 3 times for its version by `-info`, it does not answer \("):
        solver_version(program)
    assert (tmp_path / "asked").read_text().count("x") == 3


@pytest.mark.parametrize("text", ["sleep 60", "kill -KILL $$", "kill -TERM $$", "exit 1"])
def test_a_solver_that_answers_late_keeps_its_identity(tmp_path, monkeypatch, text):
    monkeypatch.setattr(attempt, "VERSION_S", 0.5)
    monkeypatch.setattr(external, "_KILLED_TOO_S", 0.0)
    program = tmp_path / "febio4"
    failed = tmp_path / "failed"
    program.write_text(f"#!/bin/sh\ntest -e {failed} && echo version 4.11.0 && exit\ntouch {failed}\n{text}\n")
    program.chmod(0o755)
    assert solver_version(program) == "4.11.0"


ODD = {
    "a pipe": "os.mkfifo('{file}')",
    "an endless device": "os.symlink('/dev/zero', '{file}')",
    "a device of random numbers": "os.symlink('/dev/urandom', '{file}')",
    "a folder": "os.mkdir('{file}')",
    "a link to itself": "os.symlink('{file}', '{file}')",
    "a link out of the folder": "os.symlink('/etc/hostname', '{file}')",
}


def test_version_of_what_cannot_run(tmp_path):
    (tmp_path / "text").write_text("no program")
    for path in (tmp_path / "nothing", tmp_path / "text"):
        with pytest.raises(BadInput, match=f"{path.name}: cannot be run"):
            solver_version(path)


# ---- what a run can do


@CONFINED
def test_a_compiled_solver_writes_in_its_own_folder_only(tmp_path):
    """Python itself stands for such a solver: it takes its input, ``-i model.feb``, for a program."""
    ours = replace(solver(tmp_path), executable=sys.executable)
    NORMAL = " N O R M A L   T E R M I N A T I O N\n"
    text = f"""
open("model.log", "w").write({NORMAL!r})
try:
    open({str(tmp_path / "outside")!r}, "w")
except PermissionError as error:
    open("told", "w").write(str(error))
"""

    def prepare(folder: Path) -> None:
        (folder / "model.feb").write_text(text)

    told = attempt.attempt(ours, prepare, lambda folder: (folder / "told").read_text(), {}, ())
    assert "Permission denied" in told
    assert not (tmp_path / "outside").exists()
    assert "own folder only (Landlock" in ours.confinement


def test_a_script_may_start_a_container_of_its_own(tmp_path, monkeypatch):
    assert solver(tmp_path).confinement.startswith("a script")
    monkeypatch.setattr(confine, "_landlock", lambda: 5)  # which keeps no signals inside
    assert attempt.confinement(Path(sys.executable)).startswith("this system cannot confine its runs, or not wholly")
