"""Named random streams: every random number of a study comes from its seed and one of these.

Streams are independent of each other (:class:`numpy.random.SeedSequence`). NumPy pads keys with zeros, so a stream and
its part 0 are the same: use a stream as a whole or in parts, not both. A stream is one of :class:`Stream`, or any other
name, from which its number is derived: a new task needs no entry here. Numbers and names are never changed, as the same
seed must give the same results in later versions, too.
"""

import hashlib
from enum import IntEnum

import numpy as np


class Stream(IntEnum):
    """What random numbers are for."""

    SOBOL_BOOTSTRAP = 1
    FOREST_SPLIT = 2
    FOREST = 3
    CALIBRATION = 4
    INFERENCE = 5
    POSTERIOR_DRAWS = 6
    PREDICTION = 7
    COMPARISON = 8
    BARE_FIT_STARTS = 9
    MISFIT_BEFORE = 10
    MISFIT_AFTER = 11
    FRESH_FIT_STARTS = 12


def key(seed: int, stream: Stream | str, *more: int) -> tuple[int, ...]:
    """What seeds a stream; ``more`` numbers parts of it, such as specimens."""
    return (seed, _number(stream), *more)


def generator(seed: int, stream: Stream | str, *more: int) -> np.random.Generator:
    """A generator of numpy for a stream."""
    return np.random.default_rng(key(seed, stream, *more))


def state(seed: int, stream: Stream | str, *more: int) -> int:
    """One integer of 32 bits for a library that takes no more than that."""
    return int(np.random.SeedSequence(key(seed, stream, *more)).generate_state(1)[0])


def _number(stream: Stream | str) -> int:
    """The number of a stream; of a name, one far above those of :class:`Stream`."""
    if isinstance(stream, str):
        return 2**32 + int.from_bytes(hashlib.blake2b(stream.encode(), digest_size=4).digest(), "big")
    return int(stream)
