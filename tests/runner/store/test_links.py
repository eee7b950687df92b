"""Result folders lead nowhere else: one with a link, a pipe or a device in it is refused, and nothing is touched."""

import os

import pytest

from sinew.runner.errors import StoreError
from sinew.runner.store.store import Store, open_store
from sinew.tasks.report.folder import read_folder

PLACES = ["log.jsonl", "figures", "attempts", "sobol.json", "store.zarr/evaluations", "store.zarr/zarr.json", "journal"]


@pytest.fixture
def out(tmp_path):
    with Store.writing(tmp_path / "out", "study"):
        pass
    (tmp_path / "victim").mkdir()
    (tmp_path / "victim" / "mine").write_text("mine")
    return tmp_path / "out"


def replace(path, make):
    if path.is_dir():
        path.rename(path.with_name("before"))
    else:
        path.unlink(missing_ok=True)
    make(path)


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("kind", ["link", "pipe", "device"])
def test_a_folder_that_leads_elsewhere_is_refused_by_name(out, tmp_path, place, kind):
    def make(path):
        if kind == "pipe":
            os.mkfifo(path)
        else:
            path.symlink_to("/dev/zero" if kind == "device" else tmp_path / "victim")

    replace(out / place, make)
    words = (
        f"out/{place}: is a {'named pipe' if kind == 'pipe' else 'link'}; a result folder holds files and folders only"
    )
    with pytest.raises(StoreError, match=words), Store.writing(out, "study"):
        pass
    for read in (open_store, read_folder):
        with pytest.raises(StoreError, match=words):
            read(out)
    assert [path.name for path in (tmp_path / "victim").iterdir()] == ["mine"]


def test_what_a_solver_leaves_in_its_attempt_is_no_reason_to_refuse_the_folder(out, tmp_path):
    (out / "attempts" / "attempt-x").mkdir(parents=True)
    (out / "attempts" / "attempt-x" / "link").symlink_to(tmp_path)
    open_store(out)
