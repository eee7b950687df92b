"""Advisories are compared with the lock file; the bill of materials lists what the program needs."""

import json
import zipfile
from collections.abc import Sequence

import pytest
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
    record = advisory([{"introduced": "0"}])
    other = json.loads(json.dumps(record).replace("Some_Package", "numpy"))
    with zipfile.ZipFile(tmp_path / "all.zip", "w") as archive:
        archive.writestr("a.json", json.dumps(record))
    assert audit.audit(tmp_path / "all.zip") == 0
    assert "1 advisories: 0 known" in capsys.readouterr().out
    (tmp_path / "copy").mkdir()
    assert audit.audit(tmp_path / "copy") == 1, "nothing was compared"
    (tmp_path / "copy" / "b.json").write_text(json.dumps(other))
    assert audit.audit(tmp_path / "copy") == 1
    assert f"numpy {numpy.version}: X-1" in capsys.readouterr().out


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
