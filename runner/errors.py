"""Errors a person can act on. The command prints each as one line and exits with code 2."""

import errno


class SinewError(Exception):
    """What went wrong, where, and what to do, in one line."""


class StoreError(SinewError):
    """The result store cannot be used as it is: damaged, foreign, locked, or its disk is full."""


class ClusterError(SinewError):
    """The cluster could not be started or was lost."""


class WalltimeReached(SinewError):
    """The job of this process must end soon. ``worked``: it had what it needed to get something done."""

    def __init__(self, words: str, *, worked: bool = True) -> None:
        super().__init__(words)
        self.worked = worked


def of_the_system(error: OSError) -> str:
    """What the system says, and where the disk is full what to do about it."""
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        return "no space left on the disk; free some and run the same command again, nothing is lost"
    return error.strerror or str(error)
