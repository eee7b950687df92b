"""Marks of what was not measured are refused, and large numbers are not."""

import re

import numpy as np
import pytest

from sinew.runner.errors import BadInput
from sinew.tasks.data.hints import Hints
from sinew.tasks.data.recordings import read_recordings
from tests.tasks.data.one_test_file import FORCE, TIME, TITLES, WAY, changed, read


@pytest.mark.parametrize("mark", [-999.0, 9999.0, -9999.99, -999.25, 9.9e37, 32767.0, -99.9])
@pytest.mark.parametrize("column", ["moved", "force"])
def test_a_mark_of_what_was_not_measured_is_refused(tmp_path, mark, column):
    values = {"moved": WAY, "force": FORCE}[column]
    told = {column: changed(values, [7, 8], mark)}
    with pytest.raises(BadInput, match=rf"row 9: {re.escape(f'{mark:.10g}')}, a usual marker of missing data"):
        read(tmp_path, **told)


def test_large_numbers_beside_others_are_measurements(tmp_path):
    force = np.linspace(0.0, 999.0, 40)
    assert read(tmp_path, force=force).numbers[-1, 2] == 999.0
    alone = changed(np.zeros(40), 39, 999.0)
    assert read(tmp_path, force=alone).numbers[-1, 2] == 999.0, "there is nothing to compare it with"


@pytest.mark.parametrize("mark", [-999.0, -9999.0])
def test_the_only_number_below_zero_need_not_be_far_beyond_the_others(tmp_path, mark):
    force = np.linspace(0.0, 500.0, 40)
    with pytest.raises(BadInput, match="a usual marker of missing data, where other numbers reach 500"):
        read(tmp_path, force=changed(force, [7], mark))
    compressed = -np.linspace(0.0, 999.0, 40)
    assert read(tmp_path, force=compressed).numbers[-1, 2] == -999.0


def test_two_marks_in_a_column_are_seen(tmp_path):
    for first, second in ((-999.0, -9999.0), (32767.0, 65535.0), (999.0, 9999.0)):
        with pytest.raises(BadInput, match=r"row [78]: .* where other numbers reach 50"):
            read(tmp_path, force=changed(changed(FORCE, [5], first), [6], second))


def test_a_column_that_is_kept_may_hold_none(tmp_path):
    path = tmp_path / "test.csv"
    widths = [4.5, 4.4, -9999, 4.3, *[4.2] * 36]
    rows = zip(TIME, WAY, FORCE, widths, strict=True)
    path.write_text(f"{TITLES},Width (mm)\n" + "".join(f"{t:.3f},{u:.4f},{f:.2f},{w}\n" for t, u, f, w in rows))
    assert read_recordings(path, Hints())[0].further.values == {}
    with pytest.raises(BadInput, match=r"'Width \(mm\)': row 4: -9999, a usual marker"):
        read_recordings(path, Hints(keep_column=("Width (mm)=width_mm",)))
