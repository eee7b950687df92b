"""Which rows were committed when, and which of them the solver was asked for again, or are gone."""

from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from sinew.runner.errors import StoreError
from sinew.runner.store.schema import PENDING
from sinew.runner.store.segment import Segment
from sinew.runner.store.store import open_store
from sinew.tasks.data.cohort import read_cohort
from sinew.tasks.simulate.build import febio_of
from sinew.tasks.study.model import model_of
from sinew.tasks.study.study import read_study
from tests.chaos.study import named

Row = tuple[str, int]


@dataclass
class Ledger:
    """Committed rows at the times when somebody looked, each with the number of solver runs that had begun by then."""

    out: Path
    begun: Path
    committed: set[Row] = field(default_factory=set)
    since: dict[Row, int] = field(default_factory=dict)
    lost: set[Row] = field(default_factory=set)

    def look(self, *, running: bool) -> None:
        """Note what is committed now. While a run goes on, its files may change under the eyes of who looks."""
        try:
            now = committed(self.out, running=running)
        except (StoreError, FileNotFoundError):
            if running:
                return
            raise
        count = len(self.runs())
        if not running:
            self.lost |= self.committed - now
        self.committed |= now
        for row in now:
            self.since.setdefault(row, count)

    def runs(self) -> list[str]:
        return self.begun.read_text().split() if self.begun.exists() else []

    def again(self, study: Path, calm: Counter[str]) -> list[Row]:
        """Rows of which the solver began a run after they were seen committed.

        Several tables may ask for the same input; it is done again when all rows that need it were committed. Inputs
        that a calm run asks for more often than for rows, as figures do, tell nothing. ``calm``: its runs by input.
        """
        last = {name: place for place, name in enumerate(self.runs())}
        latest: dict[str, tuple[int, Row]] = {}
        names = row_names(study, self.out)
        needed = Counter(names.values())
        for row, name in names.items():
            latest[name] = max(latest.get(name, (-1, row)), (self.since[row], row))
        return sorted(
            row for name, (count, row) in latest.items() if last[name] >= count and calm[name] <= needed[name]
        )


def committed(out: Path, *, running: bool) -> set[Row]:
    """The rows with an outcome, in chunks or in the journal."""
    if not (out / "store.zarr" / "zarr.json").exists():
        return set()
    rows: set[Row] = set()
    for table in open_store(out).tables():
        for path in table.segments():
            try:
                rows.update((table.key, row) for row in Segment.read(path).rows.tolist())
            except StoreError:
                if not running:
                    raise
        rows.update((table.key, row) for row in np.flatnonzero(table.status != PENDING).tolist())
    return rows


def row_names(study_file: Path, out: Path) -> dict[Row, str]:
    """The solver's name of each row of a finished study. Tables are named after a specimen, or a site with only one."""
    study = read_study(study_file)
    model = model_of(study.model, study.simulator.law)
    simulator = febio_of(study, (), out / "attempts")
    specimens = read_cohort(study_file.parent / "cohort").specimens
    names = {}
    for table in open_store(out).tables():
        (specimen,) = (one for one in specimens if table.title in (f"{one.name} febio", f"site {one.site} febio"))
        (curve,) = specimen.curves
        for row, values in enumerate(table.parameters(np.arange(len(table)))):
            names[table.key, row] = named(simulator.rendered(model, specimen, curve.protocol, values))
    return names
