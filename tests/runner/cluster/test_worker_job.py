"""The shell lines of a worker job that make its folder on the node."""

import subprocess
from pathlib import Path

import pytest

from sinew.runner.cluster.jobs import Jobs, _own_folder
from sinew.runner.cluster.network import Network

SHOW = 'echo "$SINEW_WORKER_FILES"; stat -c "%a %F" "$SINEW_WORKER_FILES"'


def begins(folder: Path, scratch: str | None, *more: str) -> subprocess.CompletedProcess[str]:
    spec = Jobs("study", folder, 1, 1, 1, 1000, 3600.0, Network(), scratch=scratch)
    script = "\n".join([*_own_folder(spec), *more])
    environment = {"PATH": "/usr/bin:/bin", "SLURM_JOB_ID": "7", "TMPDIR": str(folder)}
    return subprocess.run(["bash", "-c", script], env=environment, capture_output=True, text=True, check=False)


@pytest.mark.parametrize("scratch", [None, "$TMPDIR"])
def test_a_job_has_a_folder_of_its_own_which_it_removes(tmp_path, scratch):
    done = begins(tmp_path, scratch, SHOW)
    folder, kind = done.stdout.splitlines()
    assert Path(folder).parent == tmp_path
    assert kind == "700 directory"
    assert list(tmp_path.iterdir()) == [], "it is removed"


@pytest.mark.parametrize("kind", ["link", "file"])
def test_a_job_uses_no_folder_that_somebody_else_made(tmp_path, kind):
    """Numbers of jobs can be guessed. That a folder of another user is refused needs another user: see below."""
    (tmp_path / "theirs").mkdir()
    planted = tmp_path / "sinew-7"
    planted.symlink_to("theirs") if kind == "link" else planted.write_text("")
    done = begins(tmp_path, "$TMPDIR", "echo began")
    assert (done.returncode, done.stdout) == (1, "")
    assert (tmp_path / "theirs").is_dir()


def test_the_owner_of_a_folder_is_asked_for(tmp_path):
    (tmp_path / "sinew-7").mkdir()
    own = begins(tmp_path, "$TMPDIR", "echo began")
    assert own.stdout == "began\n"
    (line,) = [each for each in _own_folder(Jobs("s", tmp_path, 1, 1, 1, 1000, 3600.0, Network(), scratch="/x"))
               if each.startswith("mkdir")]  # fmt: skip
    assert '[ -O "$SINEW_SCRATCH" ]' in line
