"""The same study gives the same bytes wherever it runs, but for the files that docs/running.md lists."""

import re
import shutil
from pathlib import Path, PurePosixPath

import pytest

from sinew.tasks.report.page import build
from tests.golden.study import make
from tests.shared_folders import made_once

DOCS = Path(__file__).parents[1] / "docs" / "running.md"


def may_differ() -> list[str]:
    """The patterns of the table in docs/running.md."""
    table = DOCS.read_text("utf-8").partition("| files that may differ |")[2].partition("\n\n")[0]
    cells = [line.split("|")[1] for line in table.splitlines()[2:]]
    return [pattern for cell in cells for pattern in re.findall(r"`([^`]+)`", cell)]


def files(out: Path) -> dict[str, bytes]:
    return {path.relative_to(out).as_posix(): path.read_bytes() for path in out.rglob("*") if path.is_file()}


def listed(name: str) -> bool:
    """Whether a file is one of those that may differ; ``**`` stands for whatever is below a folder."""
    path = PurePosixPath(name)
    for pattern in may_differ():
        folder = pattern.removesuffix("/**")
        places = path.parents if folder != pattern else [path]
        if any(place.match(folder) and len(place.parts) == len(PurePosixPath(folder).parts) for place in places):
            return True
    return False


@pytest.fixture(scope="module")
def twice(golden_run: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """The result folders of two runs, each with a page, to be read only."""

    def made(folder: Path) -> None:
        deeper = folder / "another" / "deeper"
        deeper.mkdir(parents=True)
        for out in (Path(shutil.copytree(golden_run, folder / "one" / "out")), make(deeper)):
            build(out)

    folder = made_once(tmp_path_factory, "golden twice", made)
    return folder / "one" / "out", folder / "another" / "deeper" / "out"


def test_only_listed_files_differ(twice):
    one, another = map(files, twice)
    assert one.keys() == another.keys()
    different = {name for name in one if one[name] != another[name]}
    assert not sorted(name for name in different if not listed(name))
    assert "log.jsonl" in different
    assert {"infer/distal.db", "infer/distal.nc", "discover.json"} <= one.keys()


def test_the_list_is_no_longer_than_it_must_be():
    assert len(may_differ()) == 9
    for name in ("sobol.json", "infer/distal.db", "store.zarr/evaluations/a/force/c/0/0", "x/log.jsonl", "jobs"):
        assert not listed(name), name
    for name in ("log.jsonl", "jobs/jobs.jsonl", "jobs/a/b", "store.zarr/evaluations/a/worker/c/0", "report.html"):
        assert listed(name), name


def test_the_page_depends_on_log_and_store_alone(twice, tmp_path):
    """Built from the other run's files that may differ, the page is that of the other run."""
    one, another = twice
    mixed = Path(shutil.copytree(one, tmp_path / "out"))
    for name in files(another):
        if listed(name) and name != "report.html":
            shutil.copyfile(another / name, mixed / name)
    build(mixed)
    assert (mixed / "report.html").read_bytes() == (another / "report.html").read_bytes()
