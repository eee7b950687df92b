"""Errors a person can act on. The command prints each as one line and exits with code 2."""


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
