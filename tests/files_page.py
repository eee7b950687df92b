"""docs/files.md: every file of the program and of the test tools, with the first sentence of its docstring.

``python -m tests.files_page`` writes it anew; a test compares it with the files.
"""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "files.md"
FOLDERS = ("sinew", "runner", "tasks", "tests")
HEAD = """# Every file
What each file is about: the first sentence of its docstring. Made by `python -m tests.files_page`; edit the docstrings
instead. `CONTRIBUTING.md` has the map of the folders and the common changes.
"""


def text() -> str:
    """The page as it should be."""
    parts = [HEAD]
    for folder, files in _folders():
        rows = "".join(f"| `{path.relative_to(ROOT)}` | {about(path)} |\n" for path in files)
        parts.append(f"\n## {folder.as_posix()}\n| file | what it is about |\n|---|---|\n{rows}")
    return "".join(parts)


def _folders() -> Iterator[tuple[Path, list[Path]]]:
    """Folders with their modules; of the tests, only tools and what tests share."""
    for top in FOLDERS:
        folders = sorted({path.parent for path in (ROOT / top).rglob("*.py")})
        for folder in folders:
            if folder.is_relative_to(ROOT / "tests" / "tasks") or folder.is_relative_to(ROOT / "tests" / "runner"):
                continue
            files = sorted(path for path in folder.glob("*.py") if not re.match(r"test_|__init__|conftest", path.name))
            if files and not folder.is_relative_to(ROOT / "tests" / "data"):
                yield folder.relative_to(ROOT), files


def about(path: Path) -> str:
    """The first paragraph of a module's docstring, in Markdown."""
    first = (ast.get_docstring(ast.parse(path.read_text("utf-8"))) or "").split("\n\n")[0]
    plain = re.sub(r":\w+:`~?([^`]+)`", r"`\1`", " ".join(first.split()))
    return plain.replace("``", "`").replace("|", "\\|")


if __name__ == "__main__":
    PAGE.write_text(text(), "utf-8")
