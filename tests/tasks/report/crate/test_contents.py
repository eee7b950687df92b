"""Which files of a result folder go into a crate."""

from pathlib import PurePosixPath
from types import SimpleNamespace

import pytest

from sinew.runner.errors import BadInput
from sinew.tasks.report.crate.contents import kept, study_items


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


@pytest.mark.parametrize(
    ("name", "taken"),
    [
        ("bone/own.feb.j2", True), ("x\\..\\evil.bat", False), ("a\nb", False), ("\x1b[31m", False),
        ("mpl`id`/a", False),
    ],
)  # fmt: skip
def test_names_of_templates_that_not_every_archive_can_hold_are_refused(tmp_path, monkeypatch, name, taken):
    own = SimpleNamespace(own_template="own.feb.j2")
    study = SimpleNamespace(text="name: a\n", path=tmp_path / "study.yaml", simulator=own)
    monkeypatch.setattr("sinew.tasks.report.crate.contents.changed_fields", lambda source, layout: {})
    monkeypatch.setattr("sinew.tasks.report.crate.contents.template_texts", lambda study: {name: "text"})
    items = study_items(SimpleNamespace(study=study), SimpleNamespace(study=PurePosixPath("study.yaml")))
    if taken:
        assert [item.name for item in items] == ["study.yaml", name]
    else:
        with pytest.raises(BadInput, match="holds a file called"):
            list(items)
