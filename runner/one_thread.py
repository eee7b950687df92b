"""One thread for linear algebra: our matrices are small, so threads would wait for each other.

With one, sums also have one order, so that the command and its workers compute the same bytes.
"""

import os

ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")


def use_one_thread() -> None:
    """For this process, before it imports NumPy, and for those that it starts."""
    os.environ.update(ONE_THREAD)
