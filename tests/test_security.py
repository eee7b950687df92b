"""docs/security.md names, for every attempt, what stops it and the test that shows it; the tests are there."""

import ast
import re
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGE = (ROOT / "docs" / "security.md").read_text("utf-8")
NAMED = re.findall(r"`(tests/[^`]*)`", PAGE.partition("\n## ")[2])


@cache
def functions_of(path: str) -> frozenset[str]:
    tree = ast.parse((ROOT / path).read_text("utf-8"))
    return frozenset(node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef))


def test_every_test_that_the_page_names_exists():
    assert len(NAMED) > 30
    missing = []
    for name in NAMED:
        path, _, test = name.partition("::")
        if not (ROOT / path).is_file() or test not in functions_of(path):
            missing.append(name)
    assert missing == []


def test_every_attempt_has_a_test():
    """In the tables of attempts; that of what is not protected has reasons instead."""
    bare = []
    for section in PAGE.split("\n## ")[1:]:
        rows = [line for line in section.splitlines() if line.startswith("| ")]
        if rows and rows[0].endswith("| test |"):
            bare += [row for row in rows[1:] if not re.search(r"`tests/[^`]+::test_\w+` \|$", row)]
    assert bare == []
