"""The copy of the project in which the mutants of one target are made and tested."""

import shutil
import tomllib
from dataclasses import dataclass
from pathlib import Path

from tests.mutants.decorators import without_decorators

ROOT = Path(__file__).resolve().parents[2]
HERE = ROOT / ".mutants"
#: A mutant may take (the time that its tests take + CONSTANT_S) x TIMES.
CONSTANT_S = 2.0
TIMES = 5.0
PYTEST = "-p tests.mutants.preload -p no:cacheprovider -p no:unraisableexception -n 0"
_LEFT_OUT = shutil.ignore_patterns("__pycache__", ".*", "*.pyc")


@dataclass(frozen=True)
class Target:
    """A few modules, and the tests that have to notice when one of them is wrong."""

    name: str
    mutate: tuple[str, ...]
    tests: tuple[str, ...]

    @property
    def folder(self) -> Path:
        """Where its working copy is."""
        return HERE / self.name


def targets() -> dict[str, Target]:
    """The targets of ``targets.toml`` by name."""
    table = tomllib.loads(Path(__file__).with_name("targets.toml").read_text())
    return {name: Target(name, tuple(one["mutate"]), tuple(one["tests"])) for name, one in table.items()}


def update(target: Target) -> None:
    """Bring the working copy up to date. Files that have not changed keep their time, so that their mutants stay."""
    folder = target.folder
    for stale in (folder / "tests", folder / "mutants" / "tests"):
        shutil.rmtree(stale, ignore_errors=True)
    shutil.copytree(ROOT / "tests", folder / "tests", ignore=_LEFT_OUT)
    (folder / "pyproject.toml").write_text((ROOT / "pyproject.toml").read_text() + _settings(target))
    mutated = {path for pattern in target.mutate for path in (ROOT / "sinew").glob(pattern)}
    for path in _files(ROOT / "sinew"):
        content = path.read_bytes()
        if path in mutated:
            content = without_decorators(content.decode()).encode()
        copy = folder / path.relative_to(ROOT)
        if not copy.is_file() or copy.read_bytes() != content:
            copy.parent.mkdir(parents=True, exist_ok=True)
            copy.write_bytes(content)
            if path.suffix != ".py":  # mutmut copies these only once
                (folder / "mutants" / path.relative_to(ROOT)).unlink(missing_ok=True)


def _files(folder: Path) -> list[Path]:
    """The package's files, through its links."""
    found = []
    for path in sorted(folder.iterdir()):
        if path.is_dir() and path.name != "__pycache__":
            found += _files(path)
        elif path.is_file():
            found.append(path)
    return found


def _settings(target: Target) -> str:
    return f"""
[tool.mutmut]
source_paths = ["sinew"]
only_mutate = {[f"sinew/{pattern}" for pattern in target.mutate]}
pytest_add_cli_args = {PYTEST.split()}
pytest_add_cli_args_test_selection = {list(target.tests)}
process_isolation = "forkserver"
timeout_constant = {CONSTANT_S}
timeout_multiplier = {TIMES}
use_git_change_detection = false
on_dependency_change = "ignore"
"""
