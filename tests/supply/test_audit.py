"""Advisories are compared with the lock file; the bill of materials lists what the program needs."""

import json
import zipfile
from collections.abc import Sequence
from datetime import date
from pathlib import Path
from types import SimpleNamespace

import pytest
import yaml
from packaging.version import Version

from tests.supply import audit, sbom
from tests.supply.lock import LOCK, Pin, pins, project


def advisory(events: Sequence[dict[str, str]] = (), versions: tuple[str, ...] = (), **more) -> dict:
    ranges = [{"type": "ECOSYSTEM", "events": list(events)}]
    package = {"ecosystem": "PyPI", "name": "Some_Package"}
    return {"id": "X-1", "affected": [{"package": package, "ranges": ranges, "versions": versions}]} | more


@pytest.mark.parametrize(
    ("record", "hit"),
    [
        (advisory([{"introduced": "0"}]), True),
        (advisory([{"introduced": "0"}, {"fixed": "2.0"}]), True),
        (advisory([{"introduced": "0"}, {"fixed": "1.5"}]), False),
        (advisory([{"introduced": "1.6"}, {"fixed": "2.0"}]), False),
        (advisory([{"introduced": "0"}, {"last_affected": "1.5"}]), True),
        (advisory([{"introduced": "0"}, {"last_affected": "1.4"}]), False),
        (advisory([{"fixed": "1.2"}, {"introduced": "0"}, {"introduced": "1.4"}, {"fixed": "1.6"}]), True),
        (advisory([{"introduced": "0"}, {"fixed": "1.2"}, {"introduced": "1.6"}]), False),
        (advisory(versions=("1.4", "1.5.0")), True),
        (advisory(versions=("1.4", "oldest")), False),
        (advisory([{"introduced": "0"}], withdrawn="2020-01-01T00:00:00Z"), False),
        ({"id": "X-2"}, False),
    ],
)
def test_an_advisory_is_about_its_versions(record, hit):
    pin = Pin("some-package", Version("1.5"), 1, (), "")
    assert [found["id"] for _, found in audit.vulnerable([pin], [record])] == (["X-1"] if hit else [])


def test_the_lock_is_compared_with_a_copy_of_the_database(tmp_path, capsys):
    numpy = pins(LOCK.read_text("utf-8"))["numpy"]
    old = json.dumps(advisory([{"introduced": "0"}, {"fixed": "1.0"}])).replace("Some_Package", "numpy")
    other = old.replace('"fixed": "1.0"', '"fixed": "999"')
    with zipfile.ZipFile(tmp_path / "all.zip", "w") as archive:
        archive.writestr("a.json", json.dumps(advisory([{"introduced": "0"}])))
        archive.writestr("b.json", old)
    assert audit.audit(tmp_path / "all.zip") == 0
    assert "2 advisories, 1 of them about some version of these: 0 known" in capsys.readouterr().out
    (tmp_path / "copy").mkdir()
    (tmp_path / "copy" / "b.json").write_text(other)
    assert audit.audit(tmp_path / "copy") == 1
    assert f"numpy {numpy.version}: X-1" in capsys.readouterr().out


def test_the_sources_of_the_database_are_a_copy_too(tmp_path, capsys):
    numpy = pins(LOCK.read_text("utf-8"))["numpy"]
    known = advisory([{"introduced": "0"}]) | {"published": date(2024, 1, 1)}
    (tmp_path / "numpy").mkdir()
    path = tmp_path / "numpy" / "PYSEC-2024-1.yaml"
    path.write_text(yaml.safe_dump(known).replace("Some_Package", "numpy"))
    (tmp_path / "config.yaml").write_text("- no advisory")
    assert audit.audit(tmp_path) == 1
    assert f"numpy {numpy.version}: X-1" in capsys.readouterr().out
    path.write_text("id: [")
    assert audit.audit(tmp_path) == 2
    assert "not audited" in capsys.readouterr().out


def test_a_copy_that_says_nothing_is_no_audit(tmp_path, capsys):
    (tmp_path / "empty").mkdir()
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "a.json").write_text(json.dumps(advisory([{"introduced": "0"}])))
    (tmp_path / "broken.zip").write_bytes(b"PK")
    for name in ("empty", "other", "broken.zip", "gone.zip"):
        assert audit.audit(tmp_path / name) == 2
        (line,) = capsys.readouterr().out.splitlines()
        assert line.startswith("not audited: ")
        assert name in line


def test_each_of_two_versions_of_a_package_is_compared(monkeypatch, tmp_path, capsys):
    """They are for two versions of Python."""
    lock = "a==1.0 ; python_version < '3.12' \\\n    --hash=sha256:0\na==2.0 ; python_version >= '3.12'\n"
    monkeypatch.setattr(audit, "LOCK", SimpleNamespace(read_text=lambda _: lock))
    record = json.dumps(advisory([{"introduced": "0"}, {"fixed": "1.5"}])).replace("Some_Package", "A")
    (tmp_path / "a.json").write_text(record)
    assert audit.audit(tmp_path) == 1
    assert capsys.readouterr().out.startswith("a 1.0: X-1\n2 packages")


def asked(name: str, **more) -> dict:
    return {"name": name, "version": "1.0", "vulns": []} | more


@pytest.mark.parametrize(
    ("code", "report", "result", "words"),
    [
        (0, [asked("numpy"), asked("Jinja2")], 0, "2 packages asked about by pip-audit: 0 known, 1 for other systems"),
        (1, [asked("numpy"), asked("jinja2", vulns=[{"id": "X-1"}])], 1, "jinja2 1.0: X-1"),
        (0, [asked("numpy"), {"name": "jinja2", "skip_reason": "none"}], 2, "exit code 0, without 1 of 3 packages"),
        (1, None, 2, "not audited: pip-audit ended with exit code 1, it could not ask about them"),
        (0, None, 2, "not audited: pip-audit ended with exit code 0"),
    ],
)
def test_whether_pip_audit_could_ask_is_said(monkeypatch, capsys, code, report, result, words):
    """It ends in the same way with vulnerabilities and where it reaches no database."""
    lock = (
        "numpy==1.0 \\\n    --hash=sha256:0\njinja2==1.0\nwin==1.0 ; sys_platform == 'win32' \\\n    --hash=sha256:0\n"
    )

    def run(command, **_):
        if report is not None:
            Path(command[command.index("--output") + 1]).write_text(json.dumps({"dependencies": report}))
        return SimpleNamespace(returncode=code)

    monkeypatch.setattr(audit, "LOCK", SimpleNamespace(read_text=lambda _: lock))
    monkeypatch.setattr(audit.subprocess, "run", run)
    assert audit.audit(None) == result
    said = capsys.readouterr().out
    assert words in said
    assert ("not audited" in said) == (result == 2)


@pytest.mark.thorough
def test_the_bill_of_materials_says_what_and_who_needs_it(tmp_path):
    bill = json.loads(sbom.write(tmp_path / "one").read_bytes())
    assert sbom.write(tmp_path / "two").read_bytes() == next((tmp_path / "one").iterdir()).read_bytes()
    names = {part["bom-ref"]: part["name"] for part in bill["components"]}
    needs = {
        names.get(each["ref"], "sinew"): {names[ref] for ref in each["dependsOn"]} for each in bill["dependencies"]
    }
    assert needs["sinew"] == set(project()["run"])
    assert "tornado" in needs["distributed"]
    assert "pytest" not in names.values()
    assert all(part["externalReferences"][0]["hashes"] for part in bill["components"])
