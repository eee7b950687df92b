"""Reading a template's files, which must lie inside a folder."""

from pathlib import Path

from sinew.runner.errors import BadInput, shown
from sinew.runner.files import read_input, what_is
from sinew.tasks.simulate.febio.renderer import Allowance, WrongTemplate, included
from sinew.tasks.simulate.row_by_row import Failed

MAX_FILES = 100
MAX_TEMPLATE_BYTES = 64 * 2**20


def read_files(folder: Path, name: str, allowance: Allowance) -> tuple[str, dict[str, str]]:
    """A template inside ``folder`` and what it includes: its own name, and the texts of all files by name.

    What it includes, by plain names, must lie in the template's own folder or below. Raises :class:`BadInput`.
    """
    main = checked_path(folder / name, folder, "simulator.file", "the study's folder")
    home, files = main.parent, dict[str, str]()
    waiting = [main.name]
    while waiting:
        each = waiting.pop()
        path = checked_path(home / each, home, "simulator.file", "the template's folder")
        if Path(each).is_absolute() or any(part.startswith(".") for part in Path(each).parts):
            # copies of the files keep their names, and hidden ones would stay behind
            raise BadInput(
                path, f"is named {shown(each)}", "a name as seen from the template's folder, no part with a dot first"
            )
        files[each] = read_text(path)
        waiting += [
            other for other in _included(path, files[each], allowance) if other not in files and other not in waiting
        ]
        if len(files) > MAX_FILES or sum(map(len, files.values())) > MAX_TEMPLATE_BYTES:
            raise BadInput(main, "with all that it includes is too large", f"at most {MAX_FILES} files and 64 MB")
    return main.name, dict(sorted(files.items()))


def _included(path: Path, text: str, allowance: Allowance) -> list[str]:
    try:
        found = included(path.name, text, allowance)
    except WrongTemplate as wrong:
        where, problem, expected = wrong.parts
        raise BadInput(path.parent / where, problem, expected) from None
    except Failed as failed:
        raise BadInput(path, failed.words, "a template that can be read") from None
    if None in found:
        raise BadInput(path, "an include whose name is computed", '{% include "name" %}')
    return [name for name in found if name is not None]


def checked_path(path: Path, folder: Path, field: str, what: str) -> Path:
    """The path of an existing file inside ``folder``. Raises :class:`BadInput`, of ``field`` for what is no path."""
    try:
        inside = path.resolve().is_relative_to(folder.resolve())
    except (ValueError, RuntimeError, OSError):
        raise BadInput(field, f"{shown(str(path))} cannot be a file", "a template beside the study") from None
    if not inside:
        raise BadInput(path, f"lies outside {what}", "a file inside it")
    if not path.is_file():
        problem = f"is {what_is(path.stat().st_mode)}" if path.exists() else "is not there"
        raise BadInput(path, problem, "a FEBio input template")
    return path


def read_text(path: Path, encoding: str = "utf-8-sig") -> str:
    """The text of a template's file. Raises :class:`BadInput`."""
    try:
        return read_input(path, MAX_TEMPLATE_BYTES, "a FEBio input template of at most 64 MB").decode(encoding)
    except UnicodeDecodeError:
        raise BadInput(path, "not a text file", "a FEBio input template in UTF-8") from None
