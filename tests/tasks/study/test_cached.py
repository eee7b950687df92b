"""Results of an earlier run are taken only where all that they left is there and whole."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import xarray as xr

from sinew.runner.store.store import Store
from sinew.tasks.importance.result import ImportanceResult
from sinew.tasks.study.cached import cached, commit
from tests.golden.compare import EXPECTED


def change(key: str, value: Any) -> Callable[[Path], None]:
    def damage(out: Path) -> None:
        path = out / "importance.json"
        path.write_text(json.dumps(json.loads(path.read_text()) | {key: value}))

    return damage


def mark(out: Path, attributes: dict[str, str]) -> None:
    path = out / "store.zarr" / "importance" / "zarr.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {"attributes": attributes}))


DAMAGE: dict[str, Callable[[Path], Any]] = {
    "no array": lambda out: shutil.rmtree(out / "store.zarr" / "importance" / "loss"),
    "no metadata": lambda out: (out / "store.zarr" / "importance" / "loss" / "zarr.json").unlink(),
    "no chunk": lambda out: (out / "store.zarr" / "importance" / "loss" / "c" / "0").unlink(),
    "no group": lambda out: shutil.rmtree(out / "store.zarr" / "importance"),
    "no file": lambda out: (out / "table.csv").unlink(),
    "an emptied list": change("permutation", []),
    "other inputs": change("inputs", "others"),
    "unmarked arrays": lambda out: mark(out, {}),
    "arrays of others": lambda out: mark(out, {"inputs": "others"}),
    "no names": change("names", ["a"]),
}


@pytest.mark.parametrize("kind", [None, *DAMAGE])
def test_what_is_not_whole_is_made_again(tmp_path, kind):
    content = {"inputs": "key"} | json.loads((EXPECTED / "importance.json").read_text())
    result = ImportanceResult.parse(content, tmp_path)
    (tmp_path / "table.csv").touch()
    with Store.writing(tmp_path, "study") as store:
        workspace: Any = SimpleNamespace(out=tmp_path, store=store)
        commit(workspace, result, {"importance": xr.Dataset({"loss": ("parameter", [1.0, 2.0])})})
        DAMAGE.get(kind or "", lambda out: None)(tmp_path)
        found = cached(workspace, ImportanceResult, "key", ["importance"], ["table.csv"])
    assert (found is not None) == (kind is None)
