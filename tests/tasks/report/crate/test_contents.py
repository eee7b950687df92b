"""Which files of a result folder go into a crate."""

from pathlib import PurePosixPath

import pytest

from sinew.tasks.report.crate.contents import kept


@pytest.mark.parametrize(
    ("name", "goes"),
    [
        ("sobol.json", True), ("report.html", True), ("figures/sobol.png", True), ("infer/distal.nc", True),
        ("sobol_more.html", False), ("figures/run.sh", False), ("figures/page.html", False), ("infer.sh", False),
        ("notes.txt", False), ("figures/report.html", False), ("discover/template/bone.feb.j2", False),
        ("store.zarr/evil.html", False), ("store.zarr/extra/words.txt", False), ("store.zarr/c/0/evil.py", False),
        ("store.zarr/one/force/c/12/0", True), ("store.zarr/one/zarr.json", True), ("store.zarr/one/scale/c", True),
        ("journal/run.sh", False), ("journal/0123/evil.py", False), ("journal/a/b/rows-1.safetensors", False),
        ("journal/0123/planned", True), ("log.jsonl/evil.html", False), ("adopted/log.jsonl/evil.html", False),
        ("adopted/log.jsonl", True),
    ],
)  # fmt: skip
def test_only_what_tasks_write_goes_into_a_crate(name, goes):
    assert kept(PurePosixPath(name), store=True) == goes
