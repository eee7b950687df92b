"""A crate is complete, keeps to the rules of RO-Crate, has the same bytes each time, and a stranger can repeat it."""

import contextlib
import hashlib
import json
import os
import re
import shlex
import shutil
import sys
import zipfile
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import pytest

from sinew.runner.errors import BadInput, SinewError, StoreError
from sinew.tasks.cli.main import main
from sinew.tasks.report.crate.export import SUMS, export
from sinew.tasks.report.crate.metadata import METADATA, Person
from sinew.tasks.study import pipeline
from sinew.tasks.study.workspace import Workspace
from tests.tasks.report.conftest import edit


@pytest.fixture(scope="module")
def crate(whole_run: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The crate of a study with all tasks, unpacked far from where it was made."""
    folder = tmp_path_factory.mktemp("crate")
    author = Person("Ada Lovelace", "https://orcid.org/0000-0002-1825-0097")
    export(whole_run, folder / "small.zip", licence="https://spdx.org/licenses/CC-BY-4.0", authors=[author])
    with zipfile.ZipFile(folder / "small.zip") as archive:
        archive.extractall(folder / "elsewhere")
    return folder / "elsewhere"


def files(folder: Path) -> set[str]:
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}


def graph(folder: Path) -> dict[str, Any]:
    """The entities of a crate's description by id."""
    found = json.loads((folder / METADATA).read_text("utf-8"))["@graph"]
    assert len({one["@id"] for one in found}) == len(found)
    return {one["@id"]: one for one in found}


def read_again(folder: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Run the commands of a crate's README in the crate, without a cluster and figures; returns what was compared."""
    monkeypatch.setattr(Workspace, "client", lambda self: None)
    monkeypatch.setattr(pipeline, "_draw", lambda *_: None)
    *_, block = re.findall(r"```sh\n(.*?)```", (folder / "README.md").read_text("utf-8"), re.DOTALL)
    compared = []
    for line in block.splitlines():
        program, *words = shlex.split(line)
        if program == "cmp":
            first, second = (folder / word for word in words)
            assert first.read_bytes() == second.read_bytes(), line
            compared.append(first.stem)
            continue
        assert program == "sinew"
        monkeypatch.setattr(sys, "argv", [program, *words, "--quiet"])
        with contextlib.chdir(folder):
            main()
    return compared


@pytest.mark.thorough
def test_a_stranger_runs_it_again_and_gets_the_same_bytes(crate, whole_run, tmp_path, monkeypatch):
    here = Path(shutil.copytree(crate, tmp_path / "of a stranger"))
    hidden = whole_run.parent.with_name("hidden-from-the-stranger")
    whole_run.parent.rename(hidden)  # nothing may be read from where the study was
    try:
        compared = read_again(here, monkeypatch)
    finally:
        hidden.rename(whole_run.parent)
    assert compared == ["sobol", "importance", "calibrate", "infer", "predict", "compare", "discover"]


def test_it_holds_what_is_needed_and_nothing_else(crate, whole_run):
    found = files(crate)
    assert {"README.md", "METHODS.md", SUMS, METADATA, "study.yaml", "cohort/distal/1/specimen.json",
            "cohort/distal/1/cyclic.csv", "out/sobol.json", "out/verdict.json", "out/report.html", "out/calibrate.csv",
            "out/infer/distal.nc", "tables/predict.csv", "environment/environment.json",
            "environment/requirements.txt"} <= found  # fmt: skip
    left_out = {path.relative_to(whole_run).parts[0] for path in whole_run.rglob("*")} - {
        Path(name).parts[1] for name in found if name.startswith("out/")
    }
    only_checkpoints = {"figures", "calibrate", "discover"}  # and hidden files
    assert left_out == {"store.zarr", "journal", "log.jsonl", "lock", "progress.json", *only_checkpoints}
    assert not [name for name in found if name.endswith(".jsonl")]
    assert "cohort/truth.json" not in found


def test_the_description_keeps_to_the_rules_of_ro_crate(crate):
    """https://www.researchobject.org/ro-crate/specification/1.1/root-data-entity.html and data-entities.html."""
    context = json.loads((crate / METADATA).read_text("utf-8"))["@context"]
    assert context[0] == "https://w3id.org/ro/crate/1.1/context"
    found = graph(crate)
    descriptor, root = found[METADATA], found["./"]
    assert descriptor["@type"] == "CreativeWork"
    assert descriptor["about"] == {"@id": "./"}
    assert descriptor["conformsTo"] == {"@id": "https://w3id.org/ro/crate/1.1"}
    assert root["@type"] == "Dataset"
    assert re.fullmatch(r"\d{4}-\d\d-\d\d", root["datePublished"])
    assert root["name"] == "small" and root["description"]
    assert root["license"]["@id"] == "https://spdx.org/licenses/CC-BY-4.0"
    assert root["author"] == [{"@id": "https://orcid.org/0000-0002-1825-0097"}]
    parts = [one["@id"] for one in root["hasPart"]]
    assert {unquote(part) for part in parts} == files(crate) - {METADATA}
    for part in parts:
        entity, content = found[part], (crate / unquote(part)).read_bytes()
        assert entity["@type"] == "File"
        assert entity["name"] and entity["description"]
        assert entity["sha256"] == hashlib.sha256(content).hexdigest()
        assert entity["contentSize"] == str(len(content))
    for entity in found.values():  # flat, and every reference leads to an entity
        for values in entity.values():
            for value in values if isinstance(values, list) else [values]:
                if isinstance(value, dict):
                    assert set(value) == {"@id"}
                    assert value["@id"] in found or value["@id"].startswith("https://w3id.org/ro/crate")
    run = found["#run"]
    assert {"@id": "study.yaml"} in run["object"]
    assert {"@id": "out/sobol.json"} in run["result"]
    assert found["#sinew"]["softwareVersion"]


def test_the_sums_are_those_of_all_files(crate):
    lines = (crate / SUMS).read_text("utf-8").splitlines()
    told = {name: digest for digest, name in (line.split("  ", 1) for line in lines)}
    assert set(told) == files(crate) - {SUMS, METADATA}
    assert all(hashlib.sha256((crate / name).read_bytes()).hexdigest() == digest for name, digest in told.items())


def test_the_environment_is_told(crate):
    told = json.loads((crate / "environment" / "environment.json").read_text("utf-8"))
    assert (told["solver"], told["seed"]) == ({"name": "uniaxial", "version": "1"}, 3)
    pins = (crate / "environment" / "requirements.txt").read_text("utf-8").splitlines()
    named = {line.partition("==")[0] for line in pins[1:]}
    assert {"numpy", "zarr", "pyabc", "tornado"} <= named, "what sinew asks for, and what that needs"
    assert all(re.fullmatch(r"[a-z0-9._-]+==[^=]+", line) for line in pins[1:])
    assert str(Path.home()) not in json.dumps(told)


def test_the_same_folder_gives_the_same_bytes(whole_run, tmp_path):
    for name in ("one.zip", "two.zip"):
        export(whole_run, tmp_path / name)
        os.utime(whole_run / "sobol.json")
    assert (tmp_path / "one.zip").read_bytes() == (tmp_path / "two.zip").read_bytes()
    export(whole_run, tmp_path / "folder")
    with zipfile.ZipFile(tmp_path / "one.zip") as archive:
        names = archive.namelist()
        assert {info.date_time for info in archive.infolist()} == {(1980, 1, 1, 0, 0, 0)}
        assert all((tmp_path / "folder" / name).read_bytes() == archive.read(name) for name in names)
    assert names[:-2] == sorted(names[:-2])
    assert set(names) == files(tmp_path / "folder")


def test_with_the_store_it_is_a_result_folder_again(whole_run, tmp_path, monkeypatch):
    export(whole_run, tmp_path / "crate", store=True)
    assert "out/log.jsonl" in files(tmp_path / "crate")
    with contextlib.chdir(tmp_path / "crate"):
        monkeypatch.setattr(sys, "argv", ["sinew", "status", "out"])
        main()
    assert "log.jsonl" in (tmp_path / "crate" / "README.md").read_text("utf-8")


def test_what_no_task_wrote_stays_where_it_is(run_folder, whole_run, tmp_path):
    (run_folder / "diary.txt").write_text("private")
    (run_folder / "figures").mkdir(exist_ok=True)
    (run_folder / "figures" / "sobol_indices.png").write_bytes(b"\x89PNG")
    told = export(
        run_folder, tmp_path / "crate", study=whole_run.parent / "study.yaml", data=whole_run.parent / "cohort"
    )
    names = {Path(name).name for name in files(tmp_path / "crate")}
    assert "sobol_indices.png" in names
    assert "diary.txt" not in names
    assert "left out, no task wrote it: diary.txt" in told.remarks


def test_links_and_odd_files_are_refused(run_folder, whole_run, tmp_path):
    where = {"study": whole_run.parent / "study.yaml", "data": whole_run.parent / "cohort"}
    (run_folder / "figures").mkdir(exist_ok=True)
    (run_folder / "figures" / "sobol.png").symlink_to("/etc/passwd")
    with pytest.raises(StoreError, match="is a link"):
        export(run_folder, tmp_path / "crate", **where)
    (run_folder / "figures" / "sobol.png").unlink()
    os.mkfifo(run_folder / "figures" / "sobol.png")
    with pytest.raises(StoreError, match="is a named pipe"):
        export(run_folder, tmp_path / "crate", **where)
    assert not (tmp_path / "crate").exists()


@pytest.mark.parametrize(
    ("spoil", "told"),
    [
        (lambda folder: (folder / "sobol.json").write_text("{"), "sobol.json: line 1: damaged"),
        (lambda folder: edit(folder / "sobol.json", lambda content: content.pop("names")), "names: missing"),
        (lambda folder: (folder / "log.jsonl").unlink(), "does not say which run made"),
        (
            lambda folder: edit(folder / "calibrate.json", lambda told: told.update(names=["other"])),
            "are no parameters",
        ),
        (lambda folder: edit(folder / "verdict.json", lambda told: told.update(why="")), "not a copy of discover.json"),
    ],
    ids=["damaged", "field missing", "no log", "contradiction", "another verdict"],
)
def test_a_damaged_folder_is_refused(run_folder, whole_run, tmp_path, spoil, told):
    spoil(run_folder)
    with pytest.raises(SinewError, match=told):
        export(run_folder, tmp_path / "crate.zip", study=whole_run.parent / "study.yaml")
    assert [path.name for path in tmp_path.iterdir()] == ["out"], "something was written"


def test_half_a_character_is_escaped(run_folder, whole_run, tmp_path):
    edit(run_folder / "sobol.json", lambda told: told.update(objective="\ud800half"))
    where = {"study": whole_run.parent / "study.yaml", "data": whole_run.parent / "cohort"}
    export(run_folder, tmp_path / "crate", **where)
    assert "\\ud800half" in (tmp_path / "crate" / "METHODS.md").read_text("utf-8")


def test_a_place_that_is_taken_is_refused(whole_run, tmp_path):
    (tmp_path / "crate.zip").write_text("mine")
    with pytest.raises(BadInput, match="is there already; expected a name that is free"):
        export(whole_run, tmp_path / "crate.zip")
    with pytest.raises(BadInput, match="its folder is not there"):
        export(whole_run, tmp_path / "nowhere" / "crate.zip")
    assert (tmp_path / "crate.zip").read_text() == "mine"
