"""Some of many rows, without a copy of them: of hundreds of tables, each may go on to the end of its file."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TypeVar, overload

T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class Part(Sequence[T]):
    """The items from ``start`` to ``end`` of ``every``."""

    every: Sequence[T]
    start: int
    end: int

    def __len__(self) -> int:
        return self.end - self.start

    def __iter__(self) -> Iterator[T]:
        return iter(self[:])

    @overload
    def __getitem__(self, at: int) -> T: ...

    @overload
    def __getitem__(self, at: slice) -> Sequence[T]: ...

    def __getitem__(self, at: int | slice) -> T | Sequence[T]:
        places = range(self.start, self.end)[at]
        if isinstance(places, int):
            return self.every[places]
        if places.step == 1:
            return self.every[places.start : places.stop]
        return [self.every[place] for place in places]
