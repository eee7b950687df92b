"""When a verdict is judged again, and when it is kept."""

import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr

from sinew.runner.cluster.local import Local
from sinew.runner.store.store import Store
from sinew.tasks.data.cohort import write_cohort
from sinew.tasks.discover import known as known_module
from sinew.tasks.discover.known import inputs_of, known_verdict
from sinew.tasks.discover.result import DiscoverResult
from sinew.tasks.discover.settings import Settings
from sinew.tasks.model import Curve, Protocol, Specimen
from sinew.tasks.model.effects import library, named
from sinew.tasks.study.result import plain
from sinew.tasks.study.study import read_study
from sinew.tasks.study.workspace import open_workspace
from tests.tasks.discover.results import MODEL, candidate, discovery


def a_study(folder, effects=("toe-slack",)):
    """One specimen of one short curve, and a study of it."""
    time = np.arange(40.0)
    protocol = Protocol("ramp", time, 0.02 * np.minimum(time, 10.0))
    write_cohort(folder / "cohort", [Specimen("a/1", 10.0, 4.0, 1.0, (Curve(protocol, time),))])
    study = folder / "study.yaml"
    study.write_text(f"name: small\nseed: 3\ncohort: cohort\ndiscover: {{effects: [{', '.join(effects)}]}}\n")
    return study


def key_of(study, settings=None, **changes):
    """The key of a study's discovery, in a result folder beside it."""
    out = study.parent / "out"
    with open_workspace(read_study(study), out=out, cluster=Local(1), quiet=True) as workspace:
        chosen = settings or workspace.study.section(Settings)
        return inputs_of(replace(workspace, **changes), chosen, workspace.cohort.specimens)


def noting(read, original):
    """A method of a path that notes which kinds of files are read."""

    def noted(path, *how, **more):
        read.append(path.suffix)
        return original(path, *how, **more)

    return noted


def test_a_comment_or_a_place_changes_no_key(tmp_path, monkeypatch):
    (tmp_path / "one").mkdir()
    study = a_study(tmp_path / "one")
    first = key_of(study)
    read = []
    with monkeypatch.context() as patch:
        for name in ("read_text", "read_bytes"):
            patch.setattr(Path, name, noting(read, getattr(Path, name)))
        assert key_of(study) == first
    assert read
    assert ".py" not in read, "what the code's files hold does not matter"
    study.write_text(study.read_text().replace("name: small", "name: small  # a comment"))
    assert key_of(study) == first
    (tmp_path / "one").rename(tmp_path / "two")
    assert key_of(tmp_path / "two" / "study.yaml") == first


def test_whatever_a_verdict_depends_on_changes_its_key(tmp_path, monkeypatch):
    study = a_study(tmp_path)
    keys = [key_of(study)]
    keys.append(key_of(study, Settings(effects=["toe-slack"], starts=2)))
    keys.append(key_of(study, simulator=SimpleNamespace(identity=lambda: {"name": "another"})))
    curve = next((tmp_path / "cohort").rglob("ramp.csv"))
    text = curve.read_text()
    for old, new in (("seed: 3", "seed: 4"), ("name: small", "model: {parameters: {E_f: {min: 170}}}\nname: small")):
        changed = tmp_path / "changed.yaml"
        changed.write_text(study.read_text().replace(old, new))
        keys.append(key_of(changed))
    curve.write_text(text.replace(",39", ",38"))
    keys.append(key_of(study))
    curve.write_text(text)
    specimen = curve.parent
    specimen.rename(specimen.with_name("7"))
    keys.append(key_of(study))
    specimen.with_name("7").rename(specimen)
    assert key_of(study) == keys[0]
    monkeypatch.setattr(DiscoverResult, "VERSION", DiscoverResult.VERSION + 1)
    keys.append(key_of(study))
    assert len(set(keys)) == len(keys) == 8


def test_a_changed_range_of_an_effect_is_another_method(monkeypatch):
    first = DiscoverResult.versions()
    slack = library()["toe-slack"]
    (parameter,) = slack.parameters
    wider = replace(slack, parameters=(replace(parameter, minimum=0.9),))
    monkeypatch.setattr("sinew.tasks.discover.result.named", lambda: {**named(), "toe-slack": wider})
    assert DiscoverResult.versions() != first
    reworded = replace(slack, description="in other words")
    monkeypatch.setattr("sinew.tasks.discover.result.named", lambda: {**named(), "toe-slack": reworded})
    assert DiscoverResult.versions() == first


@pytest.mark.parametrize(
    ("spoil", "kept"),
    [
        (lambda out, work: None, True),
        (lambda out, work: (out / "one.feb").unlink(), False),
        (lambda out, work: (out / "verdict.json").unlink(), False),
        (lambda out, work: (out / "verdict.json").write_text('{"inputs": "former"}'), False),
        (lambda out, work: shutil.rmtree(out / "store.zarr" / "discover" / "a_1"), False),
        (lambda out, work: (out / "store.zarr" / "discover" / "a_1" / "force" / "c" / "0").unlink(), False),
        (lambda out, work: setattr(work, "retry_failed", True), False),
    ],
)
def test_a_verdict_is_kept_with_all_that_goes_with_it(tmp_path, monkeypatch, spoil, kept):
    slack = candidate("toe-slack", loss=1010.0)
    found = discovery("NAMED", effects=("toe-slack",), shown=("toe-slack",), model=MODEL, candidates=(slack,))
    found.write(tmp_path)
    (tmp_path / "one.feb").write_text("input")
    specimens = [SimpleNamespace(name="a/1")]
    monkeypatch.setattr(known_module, "by_name", lambda *_: ())
    monkeypatch.setattr(known_module, "study_with", lambda _, effects: (MODEL.path, MODEL.difference))
    arrays = xr.Dataset({"force": ("point", np.ones(3))}, attrs={"inputs": "these"})
    with Store.writing(tmp_path, "study") as store:
        store.write_result("discover/a_1", arrays)
    work = SimpleNamespace(out=tmp_path, retry_failed=False, store=store)
    spoil(tmp_path, work)
    found_again = known_verdict(work, specimens, "these")
    assert (found_again is not None and plain(found_again) == plain(found)) is kept
    assert known_verdict(work, specimens, "others") is None


@pytest.mark.parametrize("without", [{"model": None}, {"candidates": ()}])
@pytest.mark.parametrize("word", ["NAMED", "PARTLY"])
def test_a_name_without_its_study_or_candidate_is_judged_again(tmp_path, monkeypatch, word, without):
    whole = {"model": MODEL, "candidates": (candidate("toe-slack", loss=1010.0),)} | without
    discovery(word, effects=("toe-slack",), shown=("toe-slack",), **whole).write(tmp_path)
    (tmp_path / "one.feb").write_text("input")
    monkeypatch.setattr(known_module, "cached", lambda workspace, kind, *_: kind.read(workspace.out))
    monkeypatch.setattr(known_module, "study_with", lambda *_: pytest.fail("not reached"))
    assert known_verdict(SimpleNamespace(out=tmp_path, retry_failed=False), [], "these") is None
