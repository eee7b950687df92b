"""Names of files and folders say specimen and protocol."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sinew.runner.errors import BadInput
from sinew.tasks.data.cohort import NAME
from sinew.tasks.data.names import PROTOCOLS, UNSURE, FileName, names_of, plain_name


@pytest.mark.parametrize(
    ("files", "found"),
    [
        (["T1_relax.csv", "T1_cyclic.csv", "T2_relax.csv"], ["T1 relax", "T1 cyclic", "T2 relax"]),
        (["relaxation-01.csv", "relaxation-02.csv"], ["bench relaxation_01", "bench relaxation_02"]),
        (["A/one_step.csv", "A/cyclic.csv", "B/cyclic.csv"], ["A one_step", "A cyclic", "B cyclic"]),
        (["d/1/ramp.csv", "d/2/ramp.csv", "p/1/ramp.csv"], ["d/1 ramp", "d/2 ramp", "p/1 ramp"]),
        (["d/x_ramp.csv", "p/y_ramp.csv"], ["d/x ramp", "p/y ramp"]),
        (["A_p1.csv", "A_p2.csv", "B_p1.csv", "B_p2.csv"], ["A p1", "A p2", "B p1", "B p2"]),
        (["d/A_p1.csv", "d/A_p2.csv", "p/B_p1.csv", "p/B_p2.csv"], ["d/A p1", "d/A p2", "p/B p1", "p/B p2"]),
        (["A_p1.csv", "A_p2.csv", "B_p1.csv"], ["A_p1 test", "A_p2 test", "B_p1 test"]),
        (["mouse one.csv", "Mäuse (2).csv"], ["mouse_one test", "Mause_2 test"]),
        (["hold2_S7.txt", "hold1_S7.txt"], ["S7 hold2", "S7 hold1"]),
        (["stress_relaxation_T1.csv"], ["T1 stress_relaxation"]),
        (["A_relax_2026_05_11_10_20_33.asc", "A_pull_2026_05_11_10_22_33.asc"], ["A relax", "A pull"]),
        (["Sehne1_Zug_2026_05_11.asc", "Sehne1_Zyklisch_2026_05_11.asc"], ["Sehne1 zug", "Sehne1 zyklisch"]),
        (["traccion_T1.csv", "T1_rel\u0061jaci\u00f3n.csv"], ["T1 traccion", "T1 relajacion"]),
        (["A-20260511T1020.asc", "B-20260511.asc"], ["A test", "B test"]),
        (["A_relax_2026-05-11.asc", "A_relax_2026-05-12.asc"], ["A_relax_2026-05-11 test", "A_relax_2026-05-12 test"]),
        (["relax_2024-05-01.csv", "relax_2024-05-02.csv"], ["2024_05_01 relax", "2024_05_02 relax"]),
        (["T1_cyclic_0001.csv", "T1_cyclic0002.csv"], ["T1 cyclic_0001", "T1 cyclic0002"]),
        (["A_relax_20260511.csv", "A_relax_20260512.csv"], ["A_relax_20260511 test", "A_relax_20260512 test"]),
        (["A_relax_b_20262811.asc"], ["A_relax_b_20262811 test"]),
        (["d/s/A_2024-05-01.csv", "e/s/A_2024-05-02.csv"], ["s/A_2024-05-01 test", "s/A_2024-05-02 test"]),
        (["muscle1_compression.csv", "film1_tension.csv"], ["muscle1 compression", "film1 tension"]),
    ],
)
def test_names_of_files_say_specimen_and_protocol(files, found):
    names = names_of([Path("bench", file) for file in files])
    assert [f"{name.specimen} {name.protocol}" for name in names.values()] == found


def test_a_number_behind_a_protocol_may_be_that_of_a_specimen():
    assert names_of([Path("bench/relax1.csv")])[Path("bench/relax1.csv")] == FileName("bench", "relax1", UNSURE)
    assert names_of([Path("bench/relax.csv")])[Path("bench/relax.csv")].how == "likely"


@pytest.mark.parametrize(
    ("files", "words"),
    [
        (["x_1.csv", "x 1.csv"], "x 1.csv: specimen x_1, protocol test, as x_1.csv; expected names such as"),
        (["T1_relax.csv", "t1_RELAX.txt"], "protocol relax, as T1_relax.csv"),
        (["___.csv"], "___.csv: a name from which no name of a specimen can be made"),
    ],
)
def test_names_that_cannot_be_told_apart(files, words):
    with pytest.raises(BadInput) as refused:
        names_of([Path(file) for file in files])
    assert words in str(refused.value)


@given(st.sets(st.text(st.characters(codec="utf-8", exclude_characters="/\0"), min_size=1, max_size=12), max_size=5))
def test_every_name_can_be_that_of_a_cohort(stems):
    paths = [Path("bench", f"{stem}.csv") for stem in stems]
    try:
        names = names_of(paths) if paths else {}
    except BadInput:
        return
    for name in names.values():
        assert all(NAME.fullmatch(part) for part in (*name.specimen.split("/"), name.protocol)), name
    assert len(set(names.values())) == len(names)


def test_plain_names():
    assert plain_name(" Mäuse (2).tar ") == "Mause_2_.tar"
    assert plain_name("x\\..\\y") == "x_.._y"
    assert len(plain_name("x" * 500)) == 80
    assert all(plain_name(protocol) == protocol for protocol in PROTOCOLS)
