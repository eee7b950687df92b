"""Errors that a user can act on. The command prints each as one line and exits with code 2."""

import errno
from pathlib import Path


class SinewError(Exception):
    """What went wrong, where, and what to do, in one line."""


class BadInput(SinewError):
    """Invalid input: ``where`` names the file and the field or row, ``expected`` describes valid input."""

    def __init__(self, where: str | Path, problem: str, expected: str) -> None:
        super().__init__(one_line(f"{where}: {problem}; expected {expected}"))
        self.problem, self.expected = problem, expected


class StoreError(SinewError):
    """The result store cannot be used: it is damaged, foreign or locked, or its disk is full."""


class ClusterError(SinewError):
    """The cluster could not be started or was lost."""


class WalltimeReached(BaseException):
    """The job of this process must end soon. ``worked``: it had workers and time to finish some rows.

    An alarm raises it wherever the program is. As ``KeyboardInterrupt``, it is no ``Exception``: code that copes with
    failures of its own must not take it for one.
    """

    def __init__(self, words: str, *, worked: bool | None = None) -> None:
        super().__init__(words)
        self._worked = worked

    @property
    def worked(self) -> bool:
        """What the last one knew that knew it: an alarm does not, and may come before a run says so, or behind it."""
        one: BaseException | None = self
        while one is not None:
            if isinstance(one, WalltimeReached) and one._worked is not None:
                return one._worked
            one = one.__context__
        return True


def of_the_system(error: OSError) -> str:
    """The system's message, and for a full disk what to do about it."""
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        return "no space left on the disk; free some and run the same command again, nothing is lost"
    return error.strerror or str(error)


def shown(value: object, width: int = 60) -> str:
    """A value from a file, shortened for an error message."""
    try:
        text = repr(value)
    except ValueError:  # Python does not print integers of thousands of digits
        text = "a number of thousands of digits"
    except RecursionError:
        text = "lists in lists without end"
    return text if len(text) <= width else f"{text[: width - 3]}..."


LONGEST = 300  # characters of an error as the command prints it


def brief(text: str, longest: int = LONGEST) -> str:
    """Text as one printable line of at most ``longest`` characters: the middle of a longer one is left out."""
    line = one_line(text if len(text) <= 2 * longest else text[:longest] + text[-longest:])
    return line if len(line) <= longest else f"{line[: longest * 2 // 3]} ... {line[-(longest // 3 - 5) :]}"


def one_line(text: str) -> str:
    """Text as one printable line; unprintable characters are escaped."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)
