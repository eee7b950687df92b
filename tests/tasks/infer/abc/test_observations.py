"""The curves that an inference uses."""

import numpy as np
import pytest

from sinew.tasks.infer.abc.observations import SiteEvaluation, first_cycle
from sinew.tasks.model import Curve, Model, Protocol
from sinew.tasks.model.protocols import cyclic
from sinew.tasks.simulate.uniaxial import Uniaxial
from sinew.tasks.study.cohort import cohort_of
from sinew.tasks.study.study import read_study
from tests.tasks.measured import study_of, write_measured


@pytest.mark.parametrize("noise", [0.0, 0.002])
def test_the_first_cycle_ends_where_the_second_begins(noise):
    protocol = cyclic(10.0, 20.0)
    moved = protocol.displacement_mm + noise * np.random.default_rng(1).standard_normal(protocol.time_s.size)
    curve = Curve(Protocol("cyclic", protocol.time_s, moved), np.zeros(moved.size))
    cut = first_cycle(curve)
    assert cut.protocol.time_s[-1] == pytest.approx(2 * 0.02 / 0.006, abs=0.4)
    assert cut.protocol.displacement_mm.max() == pytest.approx(0.2, abs=0.01)
    hold = Curve(Protocol("hold", np.arange(10.0), np.minimum(np.arange(10.0), 3.0)), np.zeros(10))
    assert first_cycle(hold) is hold


def test_what_is_measured_beside_the_force_has_relative_errors_of_its_own(tmp_path):
    truth = write_measured(tmp_path)
    (one,) = cohort_of(read_study(study_of(tmp_path, ""))).specimens
    simulator, model = Uniaxial(compared=("lateral_strain",)), Model()
    evaluation = SiteEvaluation(model, (one,), simulator, 96, "distal")
    rows = np.array([[truth[one.name][name] for name in model.names]] * 2)
    rows[1, model.names.index("nu_m")] = 0.0
    done = evaluation(rows)
    assert done.values["relative_error"].shape == (2, 6)
    for number, curve in enumerate(one.curves):
        seen = curve.others["lateral_strain"]
        rms = np.sqrt(np.nanmean(seen**2))
        noise = one.noise["lateral_strain"] / rms
        assert done.values["relative_error"][0, 3 + number] == pytest.approx(noise, rel=0.1)
        assert done.values["relative_error"][1, 3 + number] == pytest.approx(1.0), "no lateral strain at all"
    assert done.values["others"].shape == (2, 3 * 96)
    np.testing.assert_allclose(done.values["others"][0], evaluation.points_of_others(), atol=6 * noise)
    spec = evaluation.table()
    names = next(each for each in spec.coordinates if each.name == "curve").values
    assert list(names[:1]) == [f"{one.name} {one.curves[0].name}"]
    assert list(names[3:4]) == [f"{one.name} {one.curves[0].name} lateral_strain"]
    assert {field.name for field in spec.fields} == {"relative_error", "force", "others"}
    dims = {each.dim: each.values.size for each in spec.coordinates}
    for field in spec.fields:
        assert done.values[field.name].shape == (2, *(dims[dim] for dim in field.dims))


def test_the_first_cycle_keeps_what_was_measured_in_it():
    protocol = cyclic(10.0, 20.0)
    rows = np.arange(protocol.time_s.size)
    early, late = (np.where(part, 0.1 * rows, np.nan) for part in (rows < 20, rows > rows.size - 5))
    nothing = np.where(rows > rows.size - 5, 1.0, 0.0)
    whole = Protocol("cyclic", protocol.time_s, protocol.displacement_mm, rows[::7])
    cut = first_cycle(Curve(whole, np.zeros(rows.size), {"early": early, "late": late, "nothing": nothing}))
    assert list(cut.others) == ["early"]
    assert cut.others["early"].size == cut.force_N.size
    assert cut.protocol.seen.max() < cut.force_N.size
