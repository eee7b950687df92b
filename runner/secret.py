"""A secret of this user: what was signed with it was written by this user's own runs, wherever it has been since."""

import os
from contextlib import suppress
from pathlib import Path

from sinew.runner.files import new_file, own_folder, read_regular

BYTES = 32


def state_folder() -> Path:
    """Where this program keeps what it knows of its user: below ``$XDG_STATE_HOME``, or ``~/.local/state``."""
    state = Path(os.environ.get("XDG_STATE_HOME", ""))
    return (state if state.is_absolute() else Path.home() / ".local" / "state") / "sinew"


def secret() -> bytes:
    """The user's secret, made when it is first asked for. Raises ``OSError``, and ``NotReadable``."""
    folder = state_folder()
    folder.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
    own_folder(folder)
    path = folder / "secret"
    if not path.exists():
        temporary = path.with_name(f".secret.{os.getpid()}")
        with new_file(temporary, 0o600) as file:
            file.write(os.urandom(BYTES))
        with suppress(FileExistsError):  # another process was first
            os.link(temporary, path)
        temporary.unlink()
    return read_regular(path, BYTES)
