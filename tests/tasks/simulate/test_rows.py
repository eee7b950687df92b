"""Whatever stands in a file of parameters, it is read as possible parameters or refused in one line."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from sinew.runner.cluster.local import Local
from sinew.runner.errors import BadInput
from sinew.tasks.data.cohort import write_cohort
from sinew.tasks.model import TENDON, Curve, Model, Protocol, Specimen
from sinew.tasks.simulate.rows import _write_curves, read_parameters, simulate_rows
from sinew.tasks.study.study import read_study
from sinew.tasks.study.workspace import open_workspace
from tests.tasks.cli.bad_input import PARAMETERS
from tests.tasks.inputs import CELLS, mutated, quick, read_or_refuse, table


@quick
@given(
    st.binary()
    | mutated(PARAMETERS)
    | st.lists(CELLS, max_size=4).map(lambda cells: table("nu_m", [[c] for c in cells]))
)
@example(b"\xef\xbb\xbf")
@example(b"\n")
@example(b"E_f,nu_m\n200,0.3,1\n")
def test_any_bytes_as_parameters(content):
    model = Model()
    values = read_or_refuse(lambda path: read_parameters(path, model), "rows.csv", files={"rows.csv": content})
    if values is not None:
        assert values.shape[1] == len(TENDON)
        assert all(p.possible(value) for row in values for p, value in zip(model.parameters, row, strict=True))


def simulated(folder: Path, *names: tuple[str, str], out: str = "out") -> list[str]:
    """The files of a row along protocols of specimens."""
    for number, (specimen, protocol) in enumerate(names):
        moved = np.array([0.0, 0.1, 0.2]) * (1 + number)
        curve = Curve(Protocol(protocol, np.arange(3.0), moved), 2000.0 * moved)
        write_cohort(folder / "cohort", [Specimen(specimen, 10.0, 8.0, 4.0, (curve,))])
    (folder / "study.yaml").write_text("name: rows\ncohort: cohort\n")
    study = read_study(folder / "study.yaml")
    with open_workspace(study, out=folder / out, cluster=Local(workers=1), quiet=True) as workspace:
        return list(simulate_rows(workspace, workspace.model.reference[np.newaxis])["files"])


def test_a_result_folder_may_have_any_name(tmp_path):
    assert simulated(tmp_path, ("A", "pull"), out="figures") == ["A.pull.csv"]


def test_each_curve_has_a_file(tmp_path):
    assert simulated(tmp_path, ("d/A", "pull"), ("d/B", "pull.2")) == ["d/A.pull.csv", "d/B.pull.2.csv"]


@pytest.mark.parametrize("second", [("A.b", "c"), ("a.B", "c")])
def test_files_that_would_overwrite_each_other_are_refused_before_anything_is_evaluated(tmp_path, second):
    with pytest.raises(BadInput, match=r"would both be written to A\.b\.c\.csv|would both be written to a\.B\.c\.csv"):
        simulated(tmp_path, ("A", "b.c"), second)
    assert not list((tmp_path / "out").rglob("*.csv"))


@pytest.mark.parametrize("site", ["store.zarr", "journal", "lock", "Adopted", "log.jsonl"])
def test_a_site_is_no_part_of_the_result_folder(tmp_path, site):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "log.jsonl").touch()
    with pytest.raises(BadInput, match=f"cohort/{site}: a name that result folders use; expected another name"):
        simulated(tmp_path, (f"{site}/x", "pull"))


def test_a_link_that_appears_is_not_followed(tmp_path):
    """Somebody makes it after the folder was looked at."""
    time = np.arange(4.0)
    curve = Curve(Protocol("pull", time, 0.1 * time), time)
    (tmp_path / "mine").write_text("mine")
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / ".a.pull.csv.partial").symlink_to(tmp_path / "mine")
    _write_curves(tmp_path / "out" / "a.pull.csv", curve, np.array([time]))
    assert (tmp_path / "mine").read_text() == "mine"
    assert (tmp_path / "out" / "a.pull.csv").read_text().startswith("time_s,displacement_mm,row_0\n0,")
