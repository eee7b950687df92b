"""The shell lines of a worker job that make its folders on the node."""

import subprocess
from pathlib import Path

import pytest

from sinew.runner.cluster.jobs import Jobs, _own_folders
from sinew.runner.cluster.network import Network

SHOW = 'echo "$SINEW_WORKER_FILES"; stat -c "%a %F" "$SINEW_WORKER_FILES"; echo "$SINEW_SCRATCH"'


def begins(folder: Path, scratch: str | None, *more: str) -> subprocess.CompletedProcess[str]:
    spec = Jobs("study", folder, 1, 1, 1, 1000, 3600.0, Network(), scratch=scratch)
    script = "\n".join([*_own_folders(spec), *more])
    environment = {"PATH": "/usr/bin:/bin", "SLURM_JOB_ID": "7", "TMPDIR": str(folder)}
    return subprocess.run(["bash", "-c", script], env=environment, capture_output=True, text=True, check=False)


@pytest.mark.parametrize("scratch", [None, "$TMPDIR"])
def test_a_job_has_folders_of_its_own_which_it_removes(tmp_path, scratch):
    done = begins(tmp_path, scratch, SHOW, 'if [ "$SINEW_SCRATCH" ]; then mkdir "$SINEW_SCRATCH"; fi')
    folder, kind, of_solvers = done.stdout.splitlines()
    assert Path(folder).parent == tmp_path
    assert kind == "700 directory"
    assert of_solvers == (str(tmp_path / "sinew-7") if scratch else "")
    assert list(tmp_path.iterdir()) == [], "they are removed"


def test_files_of_workers_never_lie_in_a_folder_that_somebody_else_made(tmp_path):
    """Numbers of jobs can be guessed: Dask imports modules that lie beside its files."""
    planted = tmp_path / "sinew-7"
    planted.mkdir(mode=0o777)
    done = begins(tmp_path, "$TMPDIR", SHOW)
    assert Path(done.stdout.splitlines()[0]) != planted


def test_a_link_in_place_of_the_solvers_folder_is_removed_and_not_followed(tmp_path):
    (tmp_path / "theirs").mkdir()
    (tmp_path / "sinew-7").symlink_to("theirs")
    begins(tmp_path, "$TMPDIR", "true")
    assert [path.name for path in tmp_path.iterdir()] == ["theirs"]
