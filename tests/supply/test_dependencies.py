"""docs/dependencies.md says what every package is for; it agrees with pyproject.toml, the lock file and the imports."""

import ast
import re
import sys
from functools import cache
from pathlib import Path

import pytest

from tests.supply.lock import LOCK, ROOT, needed, of_the_run, pins, project

PAGE = (ROOT / "docs" / "dependencies.md").read_text("utf-8")
RUN, DEV = (part.split("\n## ")[0] for part in re.split(r"## When it runs|## To work on it", PAGE)[1:])
IMPORTED_AS = {"pyyaml": "yaml", "salib": "SALib", "scikit-learn": "sklearn", "scikit-optimize": "skopt"}
PARTS = ("cycler", "mpl_toolkits", "pydantic_core")  # of matplotlib and pydantic, whose interfaces name them
LOADED_BY = {  # packages that nothing imports, and what loads them
    "cryptography": "Security.temporary()",
    "dask-jobqueue": '"dask_jobqueue.',
    "h5netcdf": 'engine="h5netcdf"',
    "pyarrow": ".to_parquet(",
}


def rows(table: str) -> list[list[str]]:
    found = [[cell.strip() for cell in line.strip("|").split("|")] for line in table.splitlines() if line[:1] == "|"]
    return found[2:]


USED_IN = {name: re.findall(r"`([^`]+)`", cells[-1]) for name, *cells in rows(RUN)}


def test_the_page_lists_what_the_project_asks_for():
    assert list(USED_IN) == sorted(project()["run"])
    assert sorted(", ".join(name for name, _ in rows(DEV)).split(", ")) == sorted(project()["dev"])


@cache
def uses() -> dict[str, set[str]]:
    """The folders that use each package, by the name it is imported as or by what loads it."""
    found: dict[str, set[str]] = {}
    for room in ("runner", "tasks", "sinew"):
        for path in (ROOT / room).rglob("*.py"):
            folder, text = str(path.relative_to(ROOT).parent), path.read_text("utf-8")
            for node in ast.walk(ast.parse(text)):
                names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
                names += [node.module] if isinstance(node, ast.ImportFrom) and node.module and not node.level else []
                for name in names:
                    found.setdefault(name.partition(".")[0], set()).add(folder)
            for name, words in LOADED_BY.items():
                if words in text:
                    found.setdefault(name, set()).add(folder)
    return found


@pytest.mark.parametrize("name", USED_IN)
def test_a_package_is_used_where_the_page_says(name):
    folders = uses().get(name if name in LOADED_BY else IMPORTED_AS.get(name, name.replace("-", "_")), set())
    inside = {said: {each for each in folders if Path(each).is_relative_to(said)} for said in USED_IN[name]}
    assert all(inside.values()), f"nothing in {[said for said, there in inside.items() if not there]} uses {name}"
    assert folders == set().union(*inside.values()), "it is used elsewhere, too"


def test_every_import_is_asked_for():
    """Nothing is imported that only another package brings."""
    ours = {IMPORTED_AS.get(name, name.replace("-", "_")) for name in USED_IN}
    assert set(uses()) - ours - set(LOADED_BY) - set(sys.stdlib_module_names) - {"sinew", *PARTS} == set()


def test_the_lock_file_has_exact_versions_with_hashes():
    locked = pins(LOCK.read_text("utf-8"))
    assert {*project()["run"], *project()["dev"]} <= set(locked)
    assert [pin.name for pin in locked.values() if not pin.hashes] == []
    with pytest.raises(ValueError, match="no exact version"):
        pins("numpy>=2\n")


def test_what_a_release_needs_leaves_out_the_tools():
    run = {pin.name for pin in needed(pins(LOCK.read_text("utf-8")), project()["run"])}
    assert set(project()["run"]) <= run
    assert {"tornado", "sqlalchemy", "llvmlite"} <= run, "what they need is there"
    assert not {"pytest", "sphinx", "ruff", "pip-audit"} & run


def test_the_requirements_of_a_release_are_a_part_of_the_lock_file():
    text, whole = of_the_run(LOCK.read_text("utf-8")), LOCK.read_text("utf-8")
    assert set(text.splitlines()) <= set(whole.splitlines())
    assert set(pins(text)) == {pin.name for pin in needed(pins(whole), project()["run"])}
    for name in ("numpy", "scipy"):  # there are several versions, each for some versions of Python
        heads = [line for line in whole.splitlines() if line.startswith(f"{name}==")]
        assert len(heads) > 1
        assert [line for line in text.splitlines() if line.startswith(f"{name}==")] == heads
