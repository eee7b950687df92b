"""A secret of this user: what was signed with it was written by this user's own runs, wherever it has been since."""

import errno
import os
import secrets
import stat
from contextlib import suppress
from pathlib import Path

from sinew.runner.files import NotReadable, new_file, open_regular, own_folder

BYTES = 32


def state_folder() -> Path:
    """Where this program keeps what it knows of its user: below ``$XDG_STATE_HOME``, or ``~/.local/state``."""
    state = Path(os.environ.get("XDG_STATE_HOME", ""))
    return (state if state.is_absolute() else Path.home() / ".local" / "state") / "sinew"


def secret() -> bytes:
    """The user's secret, made when it is first asked for. Raises ``OSError``."""
    try:
        folder = state_folder()
    except RuntimeError as error:  # a user without a home
        raise OSError(errno.ENOENT, str(error)) from None
    folder.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
    own_folder(folder)
    path = folder / "secret"
    if not os.path.lexists(path):
        temporary = folder / f".secret.{secrets.token_hex(8)}"
        with new_file(temporary, 0o600) as file:
            file.write(os.urandom(BYTES))
            file.flush()
            os.fsync(file.fileno())
        with suppress(FileExistsError):  # another process was first
            os.link(temporary, path)
        temporary.unlink(missing_ok=True)
    try:
        with open(open_regular(path, os.O_RDONLY | os.O_NOFOLLOW), "rb") as file:
            status, found = os.fstat(file.fileno()), file.read(BYTES + 1)
    except NotReadable as kind:
        raise OSError(errno.EINVAL, f"is {kind}; remove it", str(path)) from None
    if len(found) != BYTES:
        raise OSError(errno.EINVAL, f"has {status.st_size} bytes, not {BYTES}; remove it", str(path))
    if status.st_uid != os.geteuid() or status.st_mode & (stat.S_IRWXG | stat.S_IRWXO):
        raise PermissionError(errno.EACCES, "may be known to others (its owner or its mode); remove it", str(path))
    return found
