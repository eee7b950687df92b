"""Files of kept runs that somebody else wrote: a mesh that cannot be is refused in one line."""

from dataclasses import replace

import numpy as np
import pytest

from sinew.runner.errors import StoreError
from sinew.tasks.simulate.febio import kept_files
from sinew.tasks.simulate.febio.kept import Run, entry_of, write_runs
from sinew.tasks.simulate.febio.kept_files import contents, count_variables, read_run
from sinew.tasks.simulate.febio.plot_file import plot_file_of
from tests.tasks.simulate.febio import plot_writer

PLOT = plot_file_of(plot_writer.plot_file(), 2**20)
BLOCK, TETS = PLOT.mesh.domains


def write(folder, *values, **changes):
    """A file of a run for each of ``values`` of a parameter, whose mesh has ``changes``."""
    plot = replace(PLOT, mesh=replace(PLOT.mesh, **changes))
    return write_runs(folder, [(entry_of("of", "pull", ("a",), np.array([one])), Run({}, plot)) for one in values])


def test_the_mesh_that_was_written_is_read(tmp_path):
    ((_, place),) = contents(write(tmp_path, 1.0))
    again = read_run(place).plot.mesh
    assert np.array_equal(again.nodes, PLOT.mesh.nodes)
    assert [one.shape for one in again.domains] == ["hex8", "tet4"]


def moved(values, place, value):
    changed = values.copy()
    changed[place] = value
    return changed


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"nodes": moved(PLOT.mesh.nodes, (3, 1), np.nan)}, "coordinates of nodes are not finite"),
        ({"domains": (replace(BLOCK, shape="hex27"), TETS)}, "mesh_0/domain_0 has elements of another shape than 'hex"),
        ({"domains": (replace(BLOCK, shape="brick"), TETS)}, "mesh_0/domain_0 has elements of another shape than 'bri"),
        ({"domains": (BLOCK, replace(TETS, corners=moved(TETS.corners, (0, 2), -1)))}, "mesh_0/domain_1 has elements"),
        ({"domains": (replace(BLOCK, part=2**31), TETS)}, "mesh_0/domain_0 is of part 2147483648"),
        ({"domains": (replace(BLOCK, part=-1), TETS)}, "mesh_0/domain_0 is of part -1"),
        ({"node_sets": {"side": np.array([1, 3, 1], np.int32)}}, "mesh_0/node_set_0 has an item twice"),
        ({"element_sets": {"upper": np.array([2, 2], np.int32)}}, "mesh_0/element_set_0 has an item twice"),
    ],
)
def test_a_mesh_that_cannot_be_is_refused(tmp_path, changes, problem):
    ((_, place),) = contents(write(tmp_path, 1.0, **changes))
    with pytest.raises(StoreError, match=rf"rows-\w+-00001\.zarr\.zip: damaged \({problem}"):
        read_run(place)


def test_a_run_is_listed_with_the_parameters_of_its_key(tmp_path):
    entry = entry_of("of", "pull", ("a", "b"), np.array([1.0, -0.0]))
    ((found, _),) = contents(write_runs(tmp_path / "right", [(entry, Run({}, PLOT))]))
    assert vars(found) == vars(entry)
    wrong = replace(entry, parameters={"a": 7.0, "b": 0.0})
    with pytest.raises(StoreError, match="it lists a run with parameters that are not those of its key"):
        contents(write_runs(tmp_path / "wrong", [(wrong, Run({}, PLOT))]))


def test_variables_and_parts_of_a_mesh_are_few(tmp_path, monkeypatch):
    """Each takes about a millisecond to read, however little it holds."""
    ((_, place),) = contents(write(tmp_path, 1.0))
    assert count_variables(place) == len(PLOT.variables)
    monkeypatch.setattr(kept_files, "MAX_VARIABLES", len(PLOT.variables) - 1)
    for read in (read_run, count_variables):
        with pytest.raises(StoreError, match=f"a run has {len(PLOT.variables)} variables"):
            read(place)
    monkeypatch.undo()
    monkeypatch.setattr(kept_files, "MAX_REGIONS", len(PLOT.mesh.domains) - 1)
    with pytest.raises(StoreError, match=f"a mesh has {len(PLOT.mesh.domains)} domains"):
        read_run(place)


def test_a_run_is_listed_once(tmp_path):
    assert len(contents(write(tmp_path, 1.0, 2.0))) == 2
    with pytest.raises(StoreError, match="it lists a run twice"):
        contents(write(tmp_path, 1.0, 2.0, 1.0))
