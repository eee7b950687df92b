"""pyABC's history is made without a look at the folder that the program runs in."""

import subprocess

import pyabc
import pytest

from sinew.tasks.infer.abc.history import IN_MEMORY, close

GIT = """
[extensions]
    partialClone = origin
[remote "origin"]
    url = {folder}
    promisor = true
    partialclonefilter = blob:none
    uploadpack = "touch {folder}/ran; git-upload-pack"
"""


@pytest.fixture
def hostile(tmp_path, monkeypatch):
    """The current folder is a Git repository whose missing commit is fetched by a program that its settings name."""
    monkeypatch.chdir(tmp_path)
    subprocess.run(["git", "init", "-q", "-b", "main"], check=True)
    with open(".git/config", "a") as file:
        file.write(GIT.format(folder=tmp_path))
    subprocess.run(["git", "config", "core.repositoryformatversion", "1"], check=True)
    (tmp_path / ".git" / "refs" / "heads" / "main").write_text("1234567890" * 4 + "\n")
    return tmp_path


def test_the_trap_works(hostile):
    subprocess.run(["git", "cat-file", "-p", "HEAD"], capture_output=True, check=False)
    assert (hostile / "ran").exists()


def test_no_program_that_a_repository_names_is_run(hostile):
    prior = pyabc.Distribution(a=pyabc.RV("uniform", 0, 1))
    abc = pyabc.ABCSMC(dict, prior, lambda *_: 0.0, sampler=pyabc.SingleCoreSampler())
    history = abc.new(IN_MEMORY, {"y": 0.0})
    close(history)
    assert not (hostile / "ran").exists()
