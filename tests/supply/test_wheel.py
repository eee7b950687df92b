"""A wheel holds all that the demo and the commands of a checkout need, far from any checkout."""

import re
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from tests.supply.lock import ROOT

LEFT_OUT = "slurm/testbed/"


@pytest.fixture(scope="module")
def unpacked(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    (wheel,) = folder.glob("sinew_fe-*.whl")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder / "site")
    return folder / "site"


def inside(site: Path, folder: Path, code: str) -> str:
    """What a program prints that has only the unpacked wheel, in an empty folder."""
    told = f"import sys; sys.path.insert(0, {str(site)!r}); import sinew; assert {str(site)!r} in sinew.__file__; "
    done = subprocess.run([sys.executable, "-P", "-c", told + code], cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_every_file_that_is_no_python_is_there(unpacked):
    listed = subprocess.run(
        ["git", "ls-files", "templates", "configs", "slurm"], cwd=ROOT, capture_output=True, text=True
    )
    names = [name for name in listed.stdout.splitlines() if not name.startswith(LEFT_OUT)]
    assert "configs/demo.yaml" in names
    assert [name for name in names if not (unpacked / "sinew" / name).is_file()] == []


def test_every_file_that_the_code_asks_for_is_there(unpacked):
    asked = {
        name
        for room in ("runner", "tasks", "sinew")
        for path in (ROOT / room).rglob("*.py")
        for name in re.findall(r'resource\("([^"]+)"\)', path.read_text("utf-8"))
    }
    assert len(asked) > 3
    assert [name for name in asked if not (unpacked / "sinew" / name).exists()] == []


def test_the_studies_of_the_demo_are_written_and_read_without_a_checkout(unpacked, tmp_path):
    code = (
        "from pathlib import Path; from sinew.tasks.data.demo import demo_studies; "
        "from sinew.tasks.study.study import read_study; from sinew.tasks.study.cohort import cohort_of; "
        "print([(one.stem, len(cohort_of(read_study(one)).specimens)) for one in demo_studies(Path('results'))])"
    )
    assert inside(unpacked, tmp_path, code).strip() == "[('demo', 3), ('hidden', 3), ('partly', 3)]"
