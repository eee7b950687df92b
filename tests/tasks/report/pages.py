"""What tests of the page share: reading it, the command, and names that try to do harm."""

import json
import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest

from sinew.runner.store.store import Store
from tests.tasks.report.conftest import edit

SECTIONS = ("data", "calibration", "sensitivity", "importance", "posterior", "prediction", "sites", "discovery",
            "failures", "provenance")  # fmt: skip
TASKS = ("sobol", "importance", "calibrate", "infer", "predict", "compare", "discover")
SCRIPT, IMAGE, END = (
    "<script>window.hit=1</script>",
    '"><img src=x onerror="window.hit=1">',
    "</script><script>window.hit=1</script>",
)


class Reader(HTMLParser):
    """Text of each section, elements by name, and what scripts hold, as a browser would see it."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.sections: dict[str, str] = {}
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.scripts: list[tuple[dict[str, str | None], str]] = []
        self._section, self._open = "", ""
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        found = dict(attrs)
        self.elements.append((tag, found))
        self._open = tag
        if tag == "section":
            self._section = found["id"]
            self.sections[self._section] = ""
        if tag == "script":
            self.scripts.append((found, ""))

    def handle_endtag(self, tag):
        self._open = ""
        if tag == "section":
            self._section = ""

    def handle_data(self, data):
        if self._open == "script":
            found, before = self.scripts[-1]
            self.scripts[-1] = (found, before + data)
        elif self._section:
            self.sections[self._section] += data


def read(folder: Path) -> Reader:
    return Reader((folder / "report.html").read_text())


def keep_only(folder: Path, *tasks: str) -> None:
    """Drop the results of all other tasks: plots take time."""
    for task in TASKS:
        if task not in tasks:
            (folder / f"{task}.json").unlink()


def hostile(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Names and messages as an attacker would choose them, in results, log, and the store's own words."""
    names = {"distal": SCRIPT, "middle": IMAGE, "cyclic": END, "small": f"{END}$$x$$", "toe-slack": SCRIPT}

    def spoilt(text: str) -> str:
        for name, evil in names.items():
            words = json.dumps(evil)[1:-1]
            text = re.sub(f"{name}(?!est)", lambda _, words=words: words, text)  # "smallest" is a key, no name
        return text

    for path in [*folder.glob("*.json"), folder / "log.jsonl"]:
        path.write_text(spoilt(path.read_text()))
    for path in folder.glob("store.zarr/**/zarr.json"):
        content = json.loads(path.read_text())
        attributes = content.get("attributes", {})
        for key in ("title", "study"):
            if key in attributes:
                attributes[key] = json.loads(f'"{spoilt(attributes[key])}"')
        path.write_text(json.dumps(content))

    def renamed(found: dict[str, Any]) -> None:
        old, found["names"][1], found["units"][0] = found["names"][1], END, IMAGE
        for site in found["sites"].values():
            site["parameters"] = {END if name == old else name: one for name, one in site["parameters"].items()}

    edit(folder / "infer.json", renamed)
    kept = Store.read_result

    def read_result(self, name, **_):  # an attacker writes the same names into the store
        for true, evil in names.items():
            name = name.replace(evil.replace("/", "_"), true).replace(evil, true)
        return kept(self, name)

    monkeypatch.setattr(Store, "read_result", read_result)
