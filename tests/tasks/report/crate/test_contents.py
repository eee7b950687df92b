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
    ],
)  # fmt: skip
def test_only_what_tasks_write_goes_into_a_crate(name, goes):
    assert kept(PurePosixPath(name), store=True) == goes
