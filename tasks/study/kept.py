"""Arrays that an unfinished task keeps beside the store, so that an interrupted run need not compute them again.

Chains go on from them, and nothing that is found afterwards shows whether they were right. So each file is signed with
the user's secret (:mod:`sinew.runner.secret`): what somebody else wrote, or under another name, is computed again.
"""

import hashlib
import hmac
import logging
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import safetensors.numpy
from safetensors import SafetensorError

from sinew.runner.errors import BadInput
from sinew.runner.files import NotReadable, new_file, read_regular
from sinew.runner.secret import secret
from sinew.tasks.simulate import Array

MAX_BYTES = 2**28
LARGEST = 1e75  # of a number: its cube does not overflow
INPUTS = "inputs"  # the array that holds the key of what all others were made from
SIGNATURE = "signature"  # the array that holds the signature of all others

log = logging.getLogger("sinew")


@dataclass(frozen=True)
class KeptArrays:
    """Arrays of float64 in one file, which belong to one set of ``inputs``."""

    path: Path
    inputs: str

    def read(self, shapes: Mapping[str, tuple[int | str, ...]]) -> dict[str, Array] | None:
        """The arrays, if all of them have the ``shapes`` that they must have and are numbers.

        A length that is a name may be any, the same wherever it stands. None where there is no such file; one of other
        inputs, of somebody else, a damaged one or one with other arrays does not count.
        """
        try:
            found = safetensors.numpy.load(read_regular(self.path, MAX_BYTES))
        except (FileNotFoundError, SafetensorError, ValueError, KeyError):
            return None
        except NotReadable as problem:
            raise BadInput(self.path, str(problem), "arrays of an unfinished run; delete it") from None
        signature = found.pop(SIGNATURE, np.empty(0)).tobytes()
        inputs = found.pop(INPUTS, np.empty(0))
        if inputs.tobytes() != self.inputs.encode() or set(found) != set(shapes):
            return None
        key = _secret()
        if key is None or not hmac.compare_digest(signature, self._signed(found, key)):
            return None
        lengths: dict[str, int] = {}
        whole = all(_fits(found[name], shape, lengths) for name, shape in shapes.items())
        return found if whole else None

    def write(self, arrays: Mapping[str, Array]) -> None:
        """Write the arrays, all or none; none without a secret to sign them with."""
        if (own := _secret()) is None:
            return
        content = {name: np.asarray(array, dtype=np.float64, order="C") for name, array in arrays.items()}
        key, signature = (
            np.frombuffer(each, dtype=np.uint8) for each in (self.inputs.encode(), self._signed(content, own))
        )
        self.path.parent.mkdir(parents=True, exist_ok=True)
        temporary = self.path.with_name(f".{self.path.name}.{os.getpid()}")
        try:
            with new_file(temporary) as file:
                file.write(safetensors.numpy.save({**content, INPUTS: key, SIGNATURE: signature}))
            os.replace(temporary, self.path)
        finally:
            temporary.unlink(missing_ok=True)

    def _signed(self, arrays: Mapping[str, Array], secret: bytes) -> bytes:
        """The signature of arrays in a file of this name."""
        signed = hashlib.blake2b(key=secret, digest_size=32)
        for name, array in sorted(arrays.items()):
            head = repr((self.path.name, self.inputs, name, array.dtype.str, array.shape))
            signed.update(head.encode() + b"\0" + array.tobytes())
        return signed.digest()


def _secret() -> bytes | None:
    """The user's secret; None, with a line in the log, where there is none."""
    try:
        return secret()
    except OSError as error:
        words = f"nothing is kept of an unfinished task: {error.filename or 'the home folder'}: {error.strerror}"
        log.warning("kept", extra={"error": words})
        return None


def _fits(array: Array, shape: tuple[int | str, ...], lengths: dict[str, int]) -> bool:
    """Whether an array has the shape; ``lengths`` are those of names so far, to which its own are added."""
    if array.ndim != len(shape) or array.dtype != np.float64:
        return False
    for want, have in zip(shape, array.shape, strict=True):
        if (lengths.setdefault(want, have) if isinstance(want, str) else want) != have:
            return False
    return bool((np.abs(array) <= LARGEST).all())  # not true of NaN
