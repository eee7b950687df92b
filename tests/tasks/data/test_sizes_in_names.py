"""Sizes that names of files may tell."""

import pytest

from sinew.tasks.data.sizes_in_names import sizes_in_name


@pytest.mark.parametrize(
    ("name", "sizes"),
    [
        ("T1_L10mm_W8.1mm_relax", {"length": 10.0, "width": 8.1}),
        ("tendon-l0=12,5-b0=8-t3p9", {"length": 12.5, "width": 8.0, "thickness": 3.9}),
        ("A length_1cm", {"length": 10.0}),
        ("A_d2mm", {"diameter": 2.0}),
        ("A_10x8x4mm_relax", {"length": 10.0, "width": 8.0, "thickness": 4.0}),
        ("A_8.1x3.9", {"width": 8.1, "thickness": 3.9}),
        ("T1_L10_W8_T4", {"length": 10.0, "width": 8.0}),
        ("T1_relax", {}),
        ("L2_cyclic", {}),
        ("test2024_step10", {}),
        ("0x3f_T12", {}),
        ("A_L0mm", {}),
        ("", {}),
    ],
)
def test_what_a_name_may_tell(name, sizes):
    assert sizes_in_name(name) == pytest.approx(sizes)
