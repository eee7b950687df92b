"""Saltelli's design: which sizes there are."""

import pytest

from sinew.runner.errors import BadInput
from sinew.tasks.model import Model
from sinew.tasks.simulate.saltelli import saltelli


@pytest.mark.parametrize(("base", "scrambles"), [(2**26, 8), (0, 1), (-1, 1), (64, 0), (64, 65)])
def test_a_design_that_cannot_be_is_one_line(base, scrambles):
    with pytest.raises(BadInput, match=r"sobol\.base_samples: .* base samples are .* rows of 16 parameters"):
        saltelli(Model(), base, False, 1, scrambles)
