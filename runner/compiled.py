"""Functions that numba compiles when they are first called: many processes need none, and importing it takes time."""

from collections.abc import Callable
from functools import cached_property
from typing import Any


class AtFirstCall:
    """A function that :func:`numba.njit` compiles with ``options`` when it is first called.

    It cannot be called by other compiled functions, which need a function that is compiled before them.
    """

    def __init__(self, function: Callable[..., Any], **options: Any) -> None:
        self.__wrapped__, self.__doc__, self._options = function, function.__doc__, options

    @cached_property
    def compiled(self) -> Callable[..., Any]:
        """The compiled function."""
        import numba

        return numba.njit(nogil=True, cache=True, **self._options)(self.__wrapped__)

    def __call__(self, *arguments: Any) -> Any:
        return self.compiled(*arguments)


def at_first_call(**options: Any) -> Callable[[Callable[..., Any]], AtFirstCall]:
    """Decorates a function that is compiled when it is first called."""
    return lambda function: AtFirstCall(function, **options)
