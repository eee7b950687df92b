"""The software bill of materials of a release (CycloneDX): every package that the program needs when it runs."""

import json
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

from tests.supply.lock import LOCK, ROOT, needed, pins, project


def write(folder: Path) -> Path:
    """Write the bill of materials beside the wheel in ``folder``; returns its path.

    It lists the pins of the lock file, of every platform, with the hashes of their files. The same lock file gives the
    same bytes.
    """
    version = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["version"]
    path = folder / f"sinew_fe-{version}.cdx.json"
    folder.mkdir(parents=True, exist_ok=True)
    locked = pins(LOCK.read_text("utf-8"))
    with tempfile.TemporaryDirectory() as scratch:
        chosen = Path(scratch) / "requirements.txt"
        chosen.write_text("\n".join(pin.text for pin in needed(locked, project()["run"])) + "\n", "utf-8")
        command = ["-m", "cyclonedx_py", "requirements", str(chosen), "--pyproject", str(ROOT / "pyproject.toml")]
        options = ["--output-reproducible", "--spec-version", "1.6", "--output-file", str(path)]
        subprocess.run([sys.executable, "-W", "ignore", *command, *options], check=True)
    bill = json.loads(path.read_bytes())
    bill["dependencies"] = _graph(bill)
    path.write_text(json.dumps(bill, indent=1) + "\n", "utf-8")
    return path


def _graph(bill: dict) -> list[dict]:
    """Who needs whom: cyclonedx-py knows no graph from a list of requirements, but the lock file says it."""
    locked, direct = pins(LOCK.read_text("utf-8")), project()["run"]
    refs = {
        component["name"].lower().replace("_", "-").replace(".", "-"): component["bom-ref"]
        for component in bill["components"]
    }
    root = bill["metadata"]["component"]["bom-ref"]
    needs = {
        ref: [refs[pin.name] for pin in locked.values() if name in pin.needed_by and pin.name in refs]
        for name, ref in refs.items()
    }
    return [
        {"ref": ref, "dependsOn": sorted(needed)}
        for ref, needed in {root: [refs[name] for name in direct], **needs}.items()
    ]
