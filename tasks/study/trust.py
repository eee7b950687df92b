"""What a study asks of this machine that only its user may allow, and what the user has allowed.

A study file may come from somebody else. It may ask for the solver ``febio4`` by its plain name; any other program, a
scheduler at some address, or traffic without TLS could run code of the study's author here. Such requests are refused
until the user confirms them by ``sinew trust STUDY``. A confirmation holds for this very content: the study file at
this place, and the program and template that the request is about. It is kept by its hash in
``$XDG_STATE_HOME/sinew/trusted``, by default in ``~/.local/state``.
"""

import hashlib
import os
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from sinew.runner.errors import BadInput, shown
from sinew.runner.files import NotReadable, new_file, own_folder, read_regular, refuse_replaceable
from sinew.runner.secret import state_folder


@dataclass(frozen=True)
class Request:
    """What ``field`` of a study asks for, in ``words``.

    ``text`` is that of the study file as it was read: the file may have changed since. ``contents`` are the files that
    the request is about, as bytes. ``beside``: what a confirmation cannot hold, in words.
    """

    study: Path
    text: str
    field: str
    words: str
    instead: str
    contents: tuple[bytes, ...] = ()
    beside: str = ""

    @property
    def key(self) -> str:
        """The hash under which a confirmation is kept."""
        parts = (os.fsencode(self.study.resolve()), self.text.encode(), self.field.encode(), *self.contents)
        hashed = hashlib.blake2b(digest_size=32)
        for part in parts:
            hashed.update(len(part).to_bytes(8, "big") + part)
        return hashed.hexdigest()


def allow(requests: Sequence[Request]) -> None:
    """Remember that the user confirms these requests. Raises ``OSError``."""
    folder = _folder()
    folder.parent.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
    own_folder(own_folder(folder.parent) / folder.name)
    for request in requests:
        words = f"{request.key}\n{request.study.resolve()}: {request.field}\n"
        with new_file(folder / request.key, 0o600) as file:
            file.write(os.fsencode(words))


def is_allowed(request: Request) -> bool:
    """Whether the user has confirmed this very request; what others wrote, or moved there, does not count."""
    folder = _folder()
    path = folder / request.key
    try:
        if not folder.is_dir() or os.lstat(path).st_uid != os.geteuid():
            return False
        own_folder(own_folder(folder.parent) / folder.name)
        return read_regular(path, 2**16).partition(b"\n")[0] == request.key.encode()
    except (OSError, NotReadable):
        return False


def require(request: Request | None) -> None:
    """Refuse a request that the user has not confirmed. Raises :class:`BadInput`."""
    if request is not None and not is_allowed(request):
        expected = f"{request.instead}, or your consent: `sinew trust {request.study}`"
        raise BadInput(f"{request.study}: {request.field}", request.words, expected)


def refuse_program_of_others(where: str, program: str, instead: str) -> None:
    """Raises :class:`BadInput` for a program that others may replace once the user has confirmed it."""
    try:
        refuse_replaceable(Path(shutil.which(program) or program))
    except OSError as error:
        problem = f"{shown(program)} may be replaced by others: {error.filename} {error.strerror}"
        raise BadInput(where, problem, f"{instead}, or a program in a folder that is yours alone") from None


def _folder() -> Path:
    return state_folder() / "trusted"
