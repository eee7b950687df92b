"""Whatever a solver leaves in its folder does no harm."""

import json
import os

import pytest

from sinew.runner.evaluation import external
from tests.tasks.simulate.febio.fake_solver import (
    OK,
    attempts,
    outcome,
    solver,
)
from tests.tasks.simulate.febio.test_attempt import ODD


@pytest.mark.timeout(60)
@pytest.mark.parametrize("file", ["reaction.txt", "model.log"])
@pytest.mark.parametrize("left", ODD.values(), ids=ODD)
def test_whatever_a_solver_leaves_for_a_file_fails_its_row(tmp_path, model, file, left):
    other = {"reaction.txt": "log(STEP, NORMAL)", "model.log": "write(reactions())"}[file]
    simulator = solver(tmp_path, f"{left.format(file=file)}; {other}")
    status, message = outcome(simulator, model)
    assert status == "bad_output"
    assert message.startswith(f"{'force: ' if file == 'reaction.txt' else ''}{file} is a")
    kept = simulator.scratch / attempts(simulator)[0]
    assert not os.path.lexists(kept / file) or (kept / file).is_dir()


@pytest.mark.parametrize("file", ["failure.json", "solver-output.txt"])
@pytest.mark.parametrize("left", ODD.values(), ids=ODD)
def test_nothing_is_written_through_what_a_solver_leaves(tmp_path, model, file, left):
    mine = tmp_path / "mine"
    mine.write_text("mine")
    left = left.replace("/etc/hostname", str(mine)).format(file=file)
    simulator = solver(tmp_path, f"os.path.exists('{file}') and os.unlink('{file}'); {left}; sys.exit(3)")
    assert outcome(simulator, model)[0] == "crashed"
    kept = simulator.scratch / attempts(simulator)[0]
    assert json.loads((kept / "failure.json").read_text())["status"] == "crashed"
    assert mine.read_text() == "mine"


@pytest.mark.timeout(60)
@pytest.mark.parametrize("left", [*ODD.values(), "os.chmod('.', 0)", "os.chmod('.', 0o500)"])
def test_a_second_run_meets_nothing_of_the_first(tmp_path, model, left):
    """A solver that says nothing with ``-silent`` is asked again without it."""
    mine = tmp_path / "mine"
    mine.write_text("mine")
    file = "solver-output.txt"
    left = left.replace("/etc/hostname", str(mine)).format(file=file)
    end = f"'-silent' in sys.argv or print('FATAL ERROR: a reason'); os.unlink('{file}'); {left}; sys.exit(1)"
    simulator = solver(tmp_path, end)
    assert outcome(simulator, model)[0] == "bad_input"
    assert mine.read_text() == "mine"
    assert len(attempts(simulator)) <= 1


def test_a_folder_that_is_removed_meanwhile_is_no_fault_of_the_row(tmp_path, model):
    """As by the end of a job that shares it: the row is tried again elsewhere."""
    end = "here = os.getcwd(); import shutil; os.chdir('/'); shutil.rmtree(here)"
    with pytest.raises(external.Stopped, match="the folder of the run was removed meanwhile"):
        outcome(solver(tmp_path, end), model)


@pytest.mark.parametrize("then", ["os.symlink('/tmp', here)", "open(here, 'w')"], ids=["link", "file"])
def test_a_solver_that_replaces_its_own_folder_fails_its_row(tmp_path, model, then):
    end = f"here = os.getcwd(); import shutil; os.chdir('/'); shutil.rmtree(here); {then}"
    status, message = outcome(solver(tmp_path, end), model)
    assert status == "crashed"
    assert message.startswith("the solver replaced its own folder.")


DEEP = "here = os.getcwd()\nfor i in range(3000): os.mkdir('d'); os.chdir('d')\nos.chdir(here)\n"
OWN_FOLDER = {
    "folders in each other": DEEP,
    "a folder that nobody may enter": "os.mkdir('a'); open('a/b', 'w'); os.chmod('a', 0)\n",
    "its own folder closed": "os.chmod('.', 0)\n",
    "many files": "for i in range(5000): open(f'f{i}', 'w')\n",
    "many links": "for i in range(500): os.symlink('/', f'l{i}')\n",
    "its input replaced by a pipe": "os.unlink('model.feb'); os.mkfifo('model.feb')\n",
}


@pytest.mark.parametrize(("end", "status"), [(OK, "ok"), ("sys.exit(3)", "crashed")])
@pytest.mark.parametrize("left", OWN_FOLDER.values(), ids=OWN_FOLDER)
def test_whatever_a_solver_makes_of_its_folder_ends_no_run(tmp_path, model, left, end, status):
    simulator = solver(tmp_path, f"{left}{end}")
    assert outcome(simulator, model)[0] == status
    assert all(name.startswith("failed-crashed-") for name in attempts(simulator))
