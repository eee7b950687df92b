"""The measured curves that a result folder keeps for its page."""

from dataclasses import replace

import numpy as np
import pytest

from sinew.runner.errors import StoreError
from sinew.runner.store.store import Store, open_store
from sinew.tasks.data.cohort import Cohort
from sinew.tasks.data.virtual import virtual_cohort
from sinew.tasks.model import Curve, Protocol, Specimen
from sinew.tasks.study.curves import GROUP, MOST, POINTS, keep_curves, kept_curves

SPECIMENS, _ = virtual_cohort(seed=3, per_site=1, rate_hz=20.0)


@pytest.fixture
def folder(tmp_path):
    with Store.writing(tmp_path, "study") as store:
        keep_curves(store, Cohort(tmp_path, SPECIMENS))
    return tmp_path


def test_they_are_those_of_the_cohort_with_their_peaks(folder):
    kept = kept_curves(open_store(folder))
    assert list(kept) == [one.name for one in SPECIMENS]
    for specimen in SPECIMENS:
        for curve in specimen.curves:
            drawn = kept[specimen.name][curve.name]
            assert drawn.total == curve.force_N.size > POINTS >= drawn.time_s.size > POINTS / 3
            assert (drawn.force_N.min(), drawn.force_N.max()) == (curve.force_N.min(), curve.force_N.max())
            at = np.searchsorted(curve.protocol.time_s, drawn.time_s)
            assert np.array_equal(curve.protocol.displacement_mm[at], drawn.displacement_mm)
            assert np.array_equal(curve.force_N[at], drawn.force_N)


def test_curves_that_are_there_are_not_written_again(folder):
    group = folder / "store.zarr" / GROUP / "zarr.json"
    before = group.stat().st_mtime_ns
    with Store.writing(folder, "study") as store:
        keep_curves(store, Cohort(folder, SPECIMENS))
        assert group.stat().st_mtime_ns == before
        changed = replace(SPECIMENS[0], curves=SPECIMENS[0].curves[:1])
        keep_curves(store, Cohort(folder, (changed,)))
    (specimen,) = kept_curves(open_store(folder)).values()
    assert list(specimen) == [SPECIMENS[0].curves[0].name]


def test_a_curve_that_was_measured_again_is_kept_anew(folder):
    first, *others = SPECIMENS[0].curves
    again = replace(SPECIMENS[0], curves=(Curve(first.protocol, 2.0 * first.force_N), *others))
    with Store.writing(folder, "study") as store:
        keep_curves(store, Cohort(folder, (again, *SPECIMENS[1:])))
    assert kept_curves(open_store(folder))[again.name][first.name].force_N.max() == 2.0 * first.force_N.max()


def test_sources_are_kept_and_a_changed_one_is_kept_anew(folder):
    def kept(source):
        first, *others = SPECIMENS[0].curves
        specimen = replace(SPECIMENS[0], curves=(replace(first, source=source), *others))
        with Store.writing(folder, "study") as store:
            keep_curves(store, Cohort(folder, (specimen, *SPECIMENS[1:])))
        found = kept_curves(open_store(folder))
        assert {curve.source for curve in found[SPECIMENS[1].name].values()} == {""}
        return found[specimen.name][first.name].source

    assert kept("") == ""
    assert kept("T1.csv: force from 'Load' in N") == "T1.csv: force from 'Load' in N"
    assert kept("T2.csv") == "T2.csv"
    first, second, *others = SPECIMENS[0].curves
    moved = replace(SPECIMENS[0], curves=(first, replace(second, source="T2.csv"), *others))
    with Store.writing(folder, "study") as store:
        keep_curves(store, Cohort(folder, (moved, *SPECIMENS[1:])))
    assert kept_curves(open_store(folder))[moved.name][second.name].source == "T2.csv", "of another curve"
    assert kept("\x1b[31m" + "x" * 5000) == "\\x1b[31m" + "x" * 992


def test_a_protocol_without_forces_is_drawn_too(tmp_path):
    protocol = Protocol("ramp", np.linspace(0.0, 1.0, 5), np.linspace(0.0, 0.1, 5))
    pulled = Specimen("a", 10.0, 5.0, 2.0, curves=(Curve(protocol, np.full(5, np.nan)),))
    with Store.writing(tmp_path, "study") as store:
        keep_curves(store, Cohort(tmp_path, (pulled, Specimen("b", 10.0, 5.0, 2.0))))
    (curve,) = kept_curves(open_store(tmp_path))["a"].values()
    assert np.isnan(curve.force_N).all()
    assert curve.displacement_mm.tolist() == protocol.displacement_mm.tolist()


def test_a_cohort_without_curves_keeps_none(tmp_path):
    with Store.writing(tmp_path, "study") as store:
        keep_curves(store, Cohort(tmp_path, (Specimen("b", 10.0, 5.0, 2.0),)))
        assert GROUP not in store.root
        assert kept_curves(store) == {}


def damaged_arrays(folder, name, value):
    with Store.writing(folder, "study") as store:
        found = store.read_result(GROUP)
        if value is None:
            found = found.drop_vars(name)
        else:
            numbers = found[name].to_numpy().astype(type(value))
            numbers[0] = value
            found = found.assign({name: ("curve", numbers)})
        store.write_result(GROUP, found.assign_attrs(content="of others"))


def is_one_line_and_mended(folder):
    with pytest.raises(StoreError, match=r"measured: damaged \(.*run the study again") as caught:
        kept_curves(open_store(folder))
    assert len(str(caught.value).splitlines()) == 1
    with Store.writing(folder, "study") as store:
        keep_curves(store, Cohort(folder, SPECIMENS))
    assert list(kept_curves(open_store(folder))) == [one.name for one in SPECIMENS]


@pytest.mark.parametrize(
    ("name", "value"),
    [("row_size", -1), ("row_size", 10**6), ("row_size", 1.5), ("force", None), ("total", 1), ("time", None)],
)
def test_arrays_that_are_no_curves_are_one_line_and_written_again(folder, name, value):
    damaged_arrays(folder, name, value)
    is_one_line_and_mended(folder)


def test_lengths_whose_sum_runs_over_are_refused(folder):
    with Store.writing(folder, "study") as store:
        found = store.read_result(GROUP)
        sizes = found["row_size"].to_numpy().copy()
        sizes[:3] = [2**63 - 1, 2**63 - 1, 2 + sizes[:3].sum()]
        assert int(sizes.sum()) == found["time"].size
        store.write_result(GROUP, found.assign(row_size=("curve", sizes)).assign_attrs(content="of others"))
    is_one_line_and_mended(folder)


def test_a_curve_of_more_points_than_are_drawn_is_refused(folder):
    with Store.writing(folder, "study") as store:
        found = store.read_result(GROUP)
        whole = found["time"].size
        assert whole > MOST
        one = found.isel(curve=[0]).assign(row_size=("curve", [whole]), total=("curve", [whole]))
        store.write_result(GROUP, one.assign_attrs(content="of others"))
    is_one_line_and_mended(folder)


@pytest.mark.parametrize("place", ["zarr.json", "force/zarr.json", "force/c/0"])
def test_a_damaged_file_is_one_line_and_written_again(folder, place):
    path = folder / "store.zarr" / GROUP / place
    assert path.is_file()
    path.write_text("{")
    is_one_line_and_mended(folder)
