"""Ranges of effects go with the cohort's size, in steps of ten."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sinew.tasks.discover.fit.sizes import Size, library_for, size_of, sized
from sinew.tasks.model import Curve, Specimen
from sinew.tasks.model.effects import library
from sinew.tasks.model.protocols import one_step


def specimen(length_mm: float, peak_N: float, area_mm2: float) -> Specimen:
    protocol = one_step(length_mm, 1.0)
    return Specimen("one", length_mm, area_mm2, 1.0, (Curve(protocol, np.linspace(0.0, peak_N, protocol.time_s.size)),))


@pytest.mark.parametrize("peak_N", [350.0, 1000.0, 3000.0])
def test_whole_tendons_have_the_ranges_as_they_are_written(peak_N):
    for slug, effect in library_for([specimen(10.0, peak_N, peak_N / 1000.0 * 32.0)]).items():
        assert effect is library()[slug]


def test_a_fascicle_has_a_hundredth_of_the_newtons_and_what_has_no_newtons_stays():
    size = size_of([specimen(50.0, 6.0, 0.2), specimen(60.0, 9.0, 0.3)])
    assert size == Size(10.0, 0.01, 1.0)
    found = library_for([specimen(50.0, 6.0, 0.2)])
    assert [p.maximum for p in found["force-drift"].parameters] == pytest.approx([0.5, 0.002])
    assert found["machine-compliance"].parameters[0].maximum == pytest.approx(1.0)
    assert found["toe-slack"] is library()["toe-slack"]
    assert found["softening"] is library()["softening"]


@given(*[st.sampled_from([0.001, 0.01, 0.1, 1.0, 10.0, 100.0])] * 3, st.sampled_from([0.1, 1.0, 10.0]))
def test_sized_effects_do_nothing_at_their_null_values_and_keep_their_forms(length, force, stress, strain):
    for effect in library().values():
        found = sized(effect, Size(length, force, stress, strain))
        assert found.names == effect.names
        assert [form.name for form in found.other_forms] == [form.name for form in effect.other_forms]
        for parameter in found.parameters:
            if parameter.name in found.null:
                assert parameter.minimum <= found.null[parameter.name] <= parameter.maximum
            assert parameter.minimum <= parameter.reference <= parameter.maximum


def test_no_force_at_all_is_no_size():
    flat = specimen(10.0, 0.0, 32.0)
    assert size_of([flat]) == Size()
    assert size_of([replace(flat, length_mm=0.1)]).length == 0.01


def test_skin_has_ten_times_the_strains_and_a_tenth_of_what_is_per_strain():
    tendon = specimen(10.0, 1000.0, 32.0)
    (curve,) = tendon.curves
    pulled = replace(curve, protocol=replace(curve.protocol, displacement_mm=12.0 * curve.protocol.displacement_mm))
    skin = replace(tendon, curves=(pulled,))
    assert size_of([skin]) == Size(strain=10.0)
    found = library_for([skin])

    def ranged(slug: str, name: str, form: int | None = None) -> list[float]:
        effect = found[slug] if form is None else found[slug].other_forms[form]
        (one,) = (each for each in effect.parameters if each.name == name)
        return [one.minimum, one.reference, one.maximum]

    assert ranged("softening", "softening_strain") == pytest.approx([0.02, 0.3, 2.0])
    assert ranged("softening", "softening_loss") == [0.0, 0.3, 0.9]
    assert ranged("cyclic-fatigue", "fatigue_per_strain") == pytest.approx([0.0, 0.02, 0.1])
    assert ranged("strain-dependent-relaxation", "slowing_per_strain") == pytest.approx([-6.0, 2.5, 6.0])
    assert ranged("matrix-stiffening", "matrix_stiffening") == pytest.approx([0.0, 3.0, 10.0])
    assert ranged("toe-slack", "slack_stretch") == pytest.approx([0.7, 0.9, 1.0])
    assert ranged("preload", "preload_stretch") == pytest.approx([1.0, 1.04, 1.2])
    assert found["toe-slack"].null == {"slack_stretch": 1.0}
    assert found["machine-compliance"] is library()["machine-compliance"]
