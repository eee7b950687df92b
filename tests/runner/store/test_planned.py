"""The journal of planned rows ends at its first damaged record."""

import numpy as np
import pytest

from sinew.runner.errors import StoreError
from sinew.runner.store.planned import PlannedRows
from sinew.runner.store.store import Store
from tests.runner.evaluations import table_spec
from tests.runner.stores import some


@pytest.mark.parametrize("harm", ["cut", "flip", "twice"])
def test_damaged_notes_of_planned_rows_end_the_plan_there(tmp_path, harm):
    with Store.writing(tmp_path, "study") as store:
        table = store.table(table_spec())
        table.plan(some(6), settle=False)
        notes = table.journal / "planned"
    whole = notes.read_bytes()
    size = len(whole) // 6
    if harm == "cut":
        notes.write_bytes(whole[: 3 * size + 5])
    elif harm == "flip":
        notes.write_bytes(whole[: 3 * size + 9] + bytes([whole[3 * size + 9] ^ 1]) + whole[3 * size + 10 :])
    else:
        notes.write_bytes(whole[: 3 * size] * 2)
    with Store.writing(tmp_path, "study") as store:
        table = store.table(table_spec())
        assert len(table) == 3
        assert np.array_equal(table.parameters(np.arange(3)), some(3))
        assert table.plan(some(6), settle=False).tolist() == [0, 1, 2, 3, 4, 5]


def test_rows_that_are_noted_are_read(tmp_path):
    notes = PlannedRows(tmp_path / "journal" / "table" / "planned")
    assert list(notes.read(2)) == []
    notes.append(7, np.array([[1, 2], [3, 4]]))
    notes.append(9, np.array([[0.5, 1.5]], dtype=np.float32))
    assert [(row, values.tolist()) for row, values in notes.read(2)] == [(7, [1, 2]), (8, [3, 4]), (9, [0.5, 1.5])]
    notes.remove()
    notes.remove()
    assert list(notes.read(2)) == []


def test_notes_that_cannot_be_written_are_named(tmp_path):
    (tmp_path / "planned").mkdir()
    with pytest.raises(StoreError, match=f"^{tmp_path / 'planned'}: is a folder; remove it, it must be a file$"):
        PlannedRows(tmp_path / "planned").append(0, np.zeros((1, 2)))


def test_noted_parameters_that_are_no_numbers_end_the_plan_there(tmp_path):
    with Store.writing(tmp_path, "study") as store:
        table = store.table(table_spec())
        notes = PlannedRows(table.journal / "planned")
        width = some(1).shape[1]
    notes.append(0, some(2))
    notes.append(2, np.full((1, width), np.nan))
    notes.append(3, some(4)[3:])
    with Store.writing(tmp_path, "study") as store:
        assert len(store.table(table_spec())) == 2


def test_a_link_that_appears_is_not_followed(tmp_path):
    (tmp_path / "victim").write_text("precious")
    (tmp_path / "planned").symlink_to(tmp_path / "victim")
    with pytest.raises(StoreError, match="is a link; remove it"):
        PlannedRows(tmp_path / "planned").append(0, np.ones((1, 2)))
    assert (tmp_path / "victim").read_text() == "precious"
