"""The power fails at any moment: what was synchronised is there, the store opens, and the work goes on."""

import os
import random
from pathlib import Path

import numpy as np
import pytest
from zarr.core.buffer import default_buffer_prototype

from sinew.runner.evaluation.batch import Batch
from sinew.runner.store import durable
from sinew.runner.store.schema import PENDING
from sinew.runner.store.segment import Segment
from sinew.runner.store.store import Store, open_store
from sinew.runner.store.table import Table
from tests.runner.evaluations import Quick, table_spec
from tests.runner.store.power import Disk
from tests.runner.stores import fill, some

STEPS = 14
PART = 0.03  # of all moments before and after a call; the power fails at each of these

Row = tuple[float, ...]


@pytest.fixture(autouse=True)
def chunks_of_16(monkeypatch):
    monkeypatch.setattr("sinew.runner.store.schema.CHUNK_ROWS", 16)


class Work:
    """A run on a store: rows are planned, finished by workers, synchronised, folded in, in any order."""

    def __init__(self, folder: Path, dice: random.Random) -> None:
        self.folder, self.dice = folder, dice
        self.design = some(60, seed=dice.randrange(1000))
        self.planned = 0
        self.promised: set[Row] = set()

    def run(self) -> None:
        for _ in range(2):  # the second time as after a kill
            with Store.writing(self.folder, "study") as store:
                table = store.table(table_spec())
                for _ in range(STEPS // 2):
                    self.dice.choice([self.plan, self.finish, self.finish, self.sync, self.fold])(table)

    def plan(self, table: Table) -> None:
        count = self.dice.randint(1, 20)
        settle = self.dice.random() < 0.5
        table.plan(self.design[self.planned : self.planned + count], settle=settle)
        self.planned += count

    def finish(self, table: Table) -> None:
        """As a worker does, which synchronises nothing."""
        waiting = [row for path in table.segments() for row in Segment.read(path).rows.tolist()]
        pending = np.setdiff1d(np.flatnonzero(table.status == PENDING), waiting)
        if pending.size:
            first = self.dice.randrange(pending.size)
            rows = pending[first : first + self.dice.randint(1, 8)]
            rows = rows[rows // 16 == rows[0] // 16]
            table.journal.mkdir(parents=True, exist_ok=True)
            batch = Batch(table.key, rows, table.parameters(rows), table.journal, 0)
            outcome, ones = Quick()(batch.parameters), np.ones(rows.size)
            segment = Segment(rows, outcome.status, ones.astype(np.int16), ones, outcome.values, (), "worker")
            segment.write(batch.segment)

    def sync(self, table: Table) -> None:
        table.sync()
        self.promise(table, [row for path in table.segments() for row in Segment.read(path).rows.tolist()])

    def fold(self, table: Table) -> None:
        paths = table.segments()
        table.fold(paths[: self.dice.randint(0, len(paths))])
        self.promise(table, np.flatnonzero(table.status != PENDING).tolist())

    def promise(self, table: Table, rows: list[int]) -> None:
        if rows:
            self.promised |= {tuple(values) for values in table.parameters(np.array(rows)).tolist()}


def check(folder: Path, work: Work, promised: set[Row]) -> None:
    """The store opens, has all that was promised, no wrong number, and takes up the work."""
    with Store.writing(folder, "study") as store:
        table = store.table(table_spec())
        table.fold(table.segments())
        done = np.flatnonzero(table.status != PENDING)
        values = table.parameters(done)
        assert promised <= {tuple(row) for row in values.tolist()}
        if done.size:
            assert np.array_equal(table.read("force", done), Quick()(values).values["force"])
        rows = fill(table, work.design)
        assert np.array_equal(table.read("force", rows), Quick()(work.design).values["force"])
        assert np.array_equal(table.read("objective", rows), Quick()(work.design).values["objective"])


@pytest.mark.parametrize("seed", range(6))
def test_the_power_fails_at_any_moment(tmp_path, seed):
    dice = random.Random(seed)
    work = Work(tmp_path / "out", dice)
    cuts: list[tuple[Path, set[Row]]] = []
    choose = random.Random(seed + 1000)

    def at_risk(disk: Disk) -> None:
        if choose.random() < PART:
            cuts.append((tmp_path / f"cut-{len(cuts)}", set(work.promised)))
            disk.lose_power(cuts[-1][0], choose)

    work.folder.mkdir()
    with Disk(work.folder, at_risk).watched():
        work.run()
    assert cuts
    for folder, promised in cuts:
        check(folder, work, promised)


def test_a_file_that_cannot_be_written_leaves_nothing(tmp_path, monkeypatch):
    monkeypatch.setattr(os, "fsync", fails)
    with pytest.raises(OSError, match="No space"):
        durable.write_whole(tmp_path / "file", tmp_path / "partial", b"content")
    assert not list(tmp_path.iterdir())


def test_a_file_is_read_at_once_unless_it_is_larger_than_any(tmp_path, monkeypatch):
    store = durable.DurableStore(tmp_path)
    (tmp_path / "c").write_bytes(b"0123456789")
    prototype = default_buffer_prototype()
    assert store.get_sync("c", prototype=prototype).to_bytes() == b"0123456789"
    assert store.get_sync("d", prototype=prototype) is None
    monkeypatch.setattr(durable, "MAX_CHUNK_FILE_BYTES", 9)
    with pytest.raises(ValueError, match="c has 10 bytes"):
        store.get_sync("c", prototype=prototype)


def test_a_store_that_is_read_is_not_written(tmp_path):
    with Store.writing(tmp_path, "study") as store:
        store.table(table_spec()).plan(some(3))
    with pytest.raises(ValueError, match="read-only"):
        open_store(tmp_path).root.create_group("x")


def test_what_is_gone_need_not_be_synchronised(tmp_path):
    durable.sync_file(tmp_path / "gone")
    durable.sync_folder(tmp_path / "gone")


@pytest.mark.parametrize(("number", "refused"), [(22, False), (28, True)])
def test_a_file_system_that_cannot_synchronise_folders_is_used_all_the_same(tmp_path, monkeypatch, number, refused):
    monkeypatch.setattr(os, "fsync", lambda _: fails(number))
    if refused:
        with pytest.raises(OSError, match="No space"):
            durable.sync_folder(tmp_path)
    else:
        durable.sync_folder(tmp_path)


def fails(number: int) -> None:
    number = number if number in (22, 28) else 28
    raise OSError(number, os.strerror(number))


def test_rows_that_are_only_in_the_journal_are_safe_once_it_is_synchronised(tmp_path):
    """Their plan and their outcomes; whatever else is lost."""
    dice, work = random.Random(1), Work(tmp_path / "out", random.Random(1))
    work.folder.mkdir()
    disk = Disk(work.folder, lambda _: None)
    with disk.watched(), Store.writing(work.folder, "study") as store:
        table = store.table(table_spec())
        table.plan(work.design[:9], settle=False)
        work.finish(table)
        work.finish(table)
        work.sync(table)
        for number in range(20):
            disk.lose_power(tmp_path / f"cut-{number}", dice)
    assert work.promised
    for number in range(20):
        check(tmp_path / f"cut-{number}", work, work.promised)


def test_outcomes_of_rows_whose_plan_is_lost_are_not_those_of_later_rows(tmp_path, caplog):
    work = Work(tmp_path, random.Random(1))
    with Store.writing(tmp_path, "study") as store:
        table = store.table(table_spec())
        table.plan(work.design[:9], settle=False)
        work.finish(table)
        work.finish(table)
        assert table.segments()
        (table.journal / "planned").write_bytes(b"")
    with Store.writing(tmp_path, "study") as store:
        table = store.table(table_spec())
        assert not table.segments()
        assert [record.message for record in caplog.records] == ["segment"] * 2
        assert all(
            record.error.endswith("its rows were not planned; they are computed again") for record in caplog.records
        )
        table.plan(some(9, seed=2000))
    check(tmp_path, work, set())
