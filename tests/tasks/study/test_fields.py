"""What fields that several sections share accept."""

import pytest
from pydantic import TypeAdapter, ValidationError

from sinew.tasks.study.fields import Unit
from sinew.tasks.study.model import ParameterSettings


@pytest.mark.parametrize(
    "hidden", ["\x1b[31m", "a\nb", "\x00", "\x9b31m", "\x7f", "\u202e", "\u2028", "\u200b", "\U000e0041"]
)
def test_units_hold_nothing_that_is_not_shown(hidden):
    with pytest.raises(ValidationError, match="pattern"):
        TypeAdapter(Unit).validate_python(f"mm{hidden}")
    with pytest.raises(ValidationError, match="pattern"):
        ParameterSettings(unit=f"mm{hidden}")


@pytest.mark.parametrize("unit", ["MPa", "1", "µm", "N/mm²", "°C", "N·m", "kPa/√Hz", "毫米", "%"])
def test_units_of_any_language_are_taken(unit):
    assert ParameterSettings(unit=unit).unit == unit
    with pytest.raises(ValidationError, match="at most 24"):
        ParameterSettings(unit=unit * 25)
