"""Kept fields of rows as files: of every kind of table, and with a damaged file of kept runs beside sound ones."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sinew.runner.errors import BadInput, SinewError
from sinew.runner.evaluation.ensemble import evaluate
from sinew.runner.store.store import Store
from sinew.tasks.infer.abc.observations import SiteEvaluation
from sinew.tasks.model import Curve, Protocol
from sinew.tasks.simulate.evaluation import SpecimenEvaluation
from sinew.tasks.simulate.febio import field_export, keeping
from sinew.tasks.simulate.febio.field_export import export_rows
from sinew.tasks.simulate.febio.kept_files import files
from tests.tasks.simulate.febio.dogbone import BAR, OWN, RELAX
from tests.tasks.simulate.febio.keeping_bar import LATERAL, PLOTTED, ROWS, keeping_bar
from tests.tasks.simulate.febio.plotting_bar import runs

FORCE = np.linspace(0.1, 2.0, RELAX.time_s.size)
SHORT = Protocol("short relax", RELAX.time_s[:9], RELAX.displacement_mm[:9])


@pytest.fixture(autouse=True)
def _no_memory(monkeypatch):
    monkeypatch.setattr(keeping, "_indexes", {})


def evaluated(folder: Path, evaluation, parameters: np.ndarray) -> str:
    """Evaluate rows into the store of a result folder; returns the name of the table."""
    with Store.writing(folder, "study") as store:
        table = store.table(evaluation.table())
        evaluate(lambda: None, table, evaluation, table.plan(parameters))
        assert not table.status.any()
        return table.name


def test_rows_of_an_inference_have_kept_fields(tmp_path):
    """Two specimens of one size and one of another, each with curves of its own; what they share is run once."""
    both = (Curve(RELAX, FORCE), Curve(SHORT, FORCE[:9]))
    one, two = replace(BAR, name="s/1", curves=both), replace(BAR, name="s/2", curves=both[:1])
    three = replace(BAR, name="s/3", length_mm=25.0, curves=both[1:])
    simulator = keeping_bar(tmp_path)
    site = evaluated(tmp_path, SiteEvaluation(OWN, (one, two, three), simulator, 96, "s"), ROWS[:2])
    assert runs(tmp_path) == 2 * 3
    done = export_rows(tmp_path, [1], tmp_path / "vtk", site)
    stem = site.replace(".", "_")[:80]
    assert [path.name.removeprefix(f"{stem}_row000001_") for path in done.paths] == [
        "s_1_relax.pvd",
        "s_1_short_relax.pvd",
        "s_2_relax.pvd",
        "s_3_short_relax.pvd",
    ]
    assert all(path.is_file() for path in done.paths)
    states = [len(list(path.with_suffix("").iterdir())) for path in done.paths]
    assert states[0] == states[2] > states[1]
    alone = evaluated(tmp_path, SpecimenEvaluation(OWN, one, simulator, 96), ROWS[1:2])
    assert runs(tmp_path) == 2 * 3  # a fit of the same specimen finds them, too
    assert len(export_rows(tmp_path, [0], tmp_path / "vtk", alone).paths) == 2


def test_of_several_runs_of_a_row_that_with_the_most_variables_is_written(tmp_path):
    one = replace(BAR, curves=(Curve(RELAX, FORCE),))
    few = replace(keeping_bar(tmp_path), plotted=("stress",))
    for rows in (ROWS[:2], ROWS[:3]):  # in files of their own
        few._rows(OWN, BAR, RELAX, rows)
    evaluated(tmp_path, SpecimenEvaluation(OWN, one, keeping_bar(tmp_path, LATERAL), 96), ROWS)
    assert runs(tmp_path) == 3 + 3
    paths = export_rows(tmp_path, [0, 1, 2], tmp_path / "vtk").paths
    assert len(paths) == 3
    for path in paths:
        written = next(path.with_suffix("").iterdir()).read_text("latin-1")
        assert all(f'Name="{name}"' in written for name in PLOTTED)


def test_a_damaged_file_is_named_and_costs_no_other_row(tmp_path):
    one = replace(BAR, curves=(Curve(RELAX, FORCE),))
    evaluation = SpecimenEvaluation(OWN, one, keeping_bar(tmp_path), 96)
    for number in range(3):
        evaluated(tmp_path, evaluation, ROWS[number : number + 1])
    _, second, third = sorted(files(tmp_path / "fields"), key=lambda path: path.stat().st_mtime_ns)
    second.write_bytes(second.read_bytes()[:-40])  # what is in it is not known
    done = export_rows(tmp_path, [0, 2], tmp_path / "vtk")
    assert [path.name[-16:] for path in done.paths] == ["000000_relax.pvd", "000002_relax.pvd"]
    assert not done.missing
    (line,) = done.damaged
    assert line.startswith(f"{second}: damaged (")
    done = export_rows(tmp_path, [1, 2], tmp_path / "vtk")
    assert [path.name[-16:] for path in done.paths] == ["000002_relax.pvd"]
    assert done.missing == ("--row 1: its fields were not kept, or are in a file that is damaged",)
    with pytest.raises(BadInput, match="the store has 3 rows"):
        export_rows(tmp_path, [3], tmp_path / "vtk")
    content = bytearray(third.read_bytes())
    content[content.index(b"run_0/displacement/c/0") + 60] ^= 255  # found when the run is read
    third.write_bytes(content)
    done = export_rows(tmp_path, [2, 0], tmp_path / "vtk")
    assert [path.name[-16:] for path in done.paths] == ["000000_relax.pvd"]
    assert len(done.missing) == 1
    assert "row000002_relax: its fields are in a file that is damaged" in done.missing[0]
    assert {line.split(": damaged")[0] for line in done.damaged} == {str(second), str(third)}


def test_protocols_whose_names_differ_in_odd_characters_have_files_of_their_own(tmp_path):
    every = tuple(
        Curve(replace(SHORT, name=name, displacement_mm=factor * SHORT.displacement_mm), FORCE[:9])
        for factor, name in ((1.0, "relax.1"), (0.9, "relax+1"), (0.8, "relax 1"))
    )
    table = evaluated(
        tmp_path, SpecimenEvaluation(OWN, replace(BAR, curves=every), keeping_bar(tmp_path), 96), ROWS[:1]
    )
    done = export_rows(tmp_path, [0], tmp_path / "vtk", table)
    stem = table.replace(".", "_")[:80]
    names = [path.name.removeprefix(f"{stem}_row000000_") for path in done.paths]
    assert names == ["relax_1.pvd", "relax_1__2.pvd", "relax_1__3.pvd"]


@pytest.mark.parametrize("limit", ["MOST_HISTORIES", "MAX_MODEL"])
def test_a_table_of_very_many_histories_or_of_a_huge_model_is_not_hashed(tmp_path, monkeypatch, limit):
    """Each history is hashed with the model."""
    simulator = keeping_bar(tmp_path)
    table = evaluated(
        tmp_path, SpecimenEvaluation(OWN, replace(BAR, curves=(Curve(RELAX, FORCE),)), simulator, 96), ROWS[:1]
    )
    assert export_rows(tmp_path, [0], tmp_path / "vtk", table).paths
    monkeypatch.setattr(field_export, limit, 0)
    with pytest.raises(SinewError, match="histories" if limit == "MOST_HISTORIES" else "row 0"):
        export_rows(tmp_path, [0], tmp_path / "more", table)
