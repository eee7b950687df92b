"""Functions that are compiled at their first call."""

import subprocess
import sys

import numpy as np

from sinew.runner.compiled import at_first_call


@at_first_call(error_model="numpy")
def _summed(values, total):
    """Adds up."""
    for i in range(values.size):
        total[0] += 1.0 / values[i]


def test_it_is_compiled_once_with_its_options():
    total = np.zeros(1)
    _summed(np.array([0.5, 0.25]), total)
    assert total[0] == 6.0
    assert _summed.compiled is _summed.compiled
    assert _summed.compiled.targetoptions["nogil"] is True
    assert _summed.__doc__ == "Adds up."
    _summed(np.array([0.0]), total)  # numpy's division
    assert total[0] == np.inf


def test_the_library_of_effects_is_read_without_numba():
    code = "import sinew.tasks.model.effects, sinew.tasks.simulate.build, sys; sys.exit('numba' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
