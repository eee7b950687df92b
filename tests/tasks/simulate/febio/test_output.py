"""Reading what the solver logged."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sinew.tasks.simulate.febio.output import (
    Logged,
    _lines,
    _numbers_of_steps,
    read_output,
    read_output_at,
    read_records,
)
from sinew.tasks.simulate.row_by_row import Failed
from tests.tasks.simulate.febio.dogbone import FORCE


def logged(times, ids, values) -> str:
    text = ""
    for step, (at, row) in enumerate(zip(times, values, strict=True), 1):
        text += f"*Step  = {step}\n*Time  = {at!r}\n*Data  = q\n"
        text += "".join(f"{each},{value!r}\n" for each, value in zip(ids, row, strict=True))
    return text


NUMBERS = st.floats(-1e6, 1e6, allow_nan=False)


@st.composite
def logs(draw):
    steps, count = draw(st.integers(1, 8)), draw(st.integers(1, 5))
    times = np.cumsum(draw(st.lists(st.floats(1e-3, 10.0), min_size=steps, max_size=steps)))
    ids = draw(st.lists(st.integers(1, 999), min_size=count, max_size=count, unique=True))
    values = draw(st.lists(st.lists(NUMBERS, min_size=count, max_size=count), min_size=steps, max_size=steps))
    return times, ids, np.array(values)


@given(logs(), st.sampled_from(["sum", "mean", "max", "min"]), st.floats(-10, 10))
@settings(deadline=None)
def test_what_was_logged_is_read(tmp_path_factory, log, reduce, scale):
    times, ids, values = log
    path = tmp_path_factory.mktemp("log") / "q.txt"
    path.write_text(logged(times.tolist(), ids, values.tolist()))
    at, found = read_output(
        path, Logged("q", "1", "max", "node_data", "uz", tuple(ids), None, reduce, scale), 10**6, times[-1]
    )
    assert np.array_equal(at, times)
    assert np.allclose(found, scale * getattr(np, reduce)(values, axis=1), rtol=1e-12, atol=1e-6)


@given(logs(), st.data())
@settings(deadline=None)
def test_a_log_with_a_piece_missing_is_never_read_as_a_whole(tmp_path_factory, log, data):
    times, ids, values = log
    text = logged(times.tolist(), ids, values.tolist())
    begin = data.draw(st.integers(0, len(text) - 1))
    cut = text[:begin] + text[data.draw(st.integers(begin + 1, len(text))) :]
    path = tmp_path_factory.mktemp("log") / "q.txt"
    path.write_text(cut)
    try:
        at, found = read_output(path, Logged("q", "1", "max", "node_data", "uz", tuple(ids), None, "sum"), 10**6, 0.0)
    except Failed as failed:
        assert failed.status == "bad_output"
    else:  # whole steps or digits can be missing without a trace
        assert 1 <= at.size <= times.size
        assert np.isfinite(found).all()


@given(st.binary(max_size=300))
@settings(deadline=None)
def test_garbage_is_a_failure(tmp_path_factory, garbage):
    path = tmp_path_factory.mktemp("log") / "q.txt"
    path.write_bytes(garbage)
    with pytest.raises(Failed) as failed:
        read_output(path, FORCE, 10**6, 1.0)
    assert failed.value.status == "bad_output"


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (logged([1.0, 2.0], [1], [[1.0], [float("nan")]]), "not finite at 2 s"),
        (logged([1.0], [1, 2], [[1e308, 1e308]]), "not finite"),
        (logged([2.0, 1.0], [1], [[1.0], [1.0]]), "times do not increase"),
        (logged([1.0], [3], [[1.0]]), "other ids"),
        (logged([1.0], [1], [[1.0]]).replace("1,1.0", "1,1.0,2.0"), "3 numbers"),
        (logged([1.0], [1], [[1.0]]).replace("1,1.0", "1,2 *5"), r"something else than numbers \('\*' behind a number"),
        ("", "q: q.txt holds 0 steps"),
        (logged([1.0], [1, 1], [[5.0, 5.0]]), "q: 2 lines a step, of 1 ids"),
        ("1,999\n" + logged([1.0, 2.0], [1], [[5.0], [6.0]]).replace("1,6.0", ""), "2 steps and 2 lines"),
        ("1,999\n" + logged([1.0, 2.0], [1], [[5.0], [6.0]]).replace("1,6.0", "*Data  = q"), "2 steps and 2 lines"),
        ("1,999\n" + logged([1.0, 2.0], [1], [[5.0], [6.0]]).replace("1,6.0\n", ""), "2 steps and 2 lines"),
        (logged([0.5], [1], [[1.0]]), "q ends at 0.5 s, the protocol at 1 s"),
    ],
)
def test_what_is_amiss_in_a_log_is_told(tmp_path, text, told):
    (tmp_path / "q.txt").write_text(text)
    ids = (1, 2) if "1e+308" in text else (1,)
    with pytest.raises(Failed, match=told):
        read_output(tmp_path / "q.txt", Logged("q", "1", "max", "node_data", "uz", ids, None, "sum"), 10**6, 1.0)


def test_blank_lines_are_none_of_a_step(tmp_path):
    text = logged([1.0, 2.0], [1], [[5.0], [6.0]])
    (tmp_path / "q.txt").write_text(text.replace("*Data", "\n*Data", 1) + " \n")
    one = Logged("q", "1", "max", "node_data", "uz", (1,), None, "single")
    assert read_output(tmp_path / "q.txt", one, 10**6, 2.0)[1].tolist() == [5.0, 6.0]


@pytest.mark.parametrize("read", [read_output, read_output_at])
def test_several_values_are_no_single_one(tmp_path, read):
    (tmp_path / "q.txt").write_text(logged([1.0], [1, 2], [[5.0, 5.0]]))
    single = Logged("q", "1", "max", "node_data", "uz", (), "a set", "single")
    with pytest.raises(Failed, match="q: 2 values a step in place of a single one"):
        read(tmp_path / "q.txt", single, 10**6, np.array([1.0]) if read is read_output_at else 1.0)


def test_what_stands_before_the_first_step_is_none_of_any(tmp_path):
    """Two lines more, and the steps would have two lines each."""
    (tmp_path / "q.txt").write_text("1,999\n1,998\n" + logged([1.0, 2.0], [1], [[5.0], [6.0]]))
    one = Logged("q", "1", "max", "node_data", "uz", (), "a set", "sum")
    with pytest.raises(Failed, match=r"q\.txt holds 2 steps and 4 lines"):
        read_output_at(tmp_path / "q.txt", one, 10**6, np.array([1.0, 2.0]))


def test_a_log_of_gigabytes_is_not_read(tmp_path):
    path = tmp_path / "reaction.txt"
    with path.open("wb") as file:
        file.truncate(3 * 2**30)
    with pytest.raises(Failed, match="is a file of 3,221,225,472 bytes, more than 268,435,456"):
        read_records(path, 2**40)


LONG = {
    "a line of many numbers": "*Step  = 1\n*Time  = 1\n" + "1," * 50_000 + "1\n",
    "many lines beside a long one": "*Step  = 1\n*Time  = 1\n" + "1," * 4_000 + "1\n" + "1\n" * 10_000,
    "a long one behind blank lines": " \n" * 9_000 + "*Step  = 1\n*Time  = 1\n" + "1," * 6_000 + "1\n",
    "many times": "*Step  = 1\n" + "*Time=1\n" * 1_000_001 + "1\n",
    "many steps": "*Step" * 1_000_001 + "\n*Time  = 1\n1\n",
}


@pytest.mark.parametrize("kind", LONG)
def test_what_would_become_a_table_of_gigabytes_is_not_parsed(tmp_path, kind, monkeypatch):
    (tmp_path / "log.txt").write_text(LONG[kind])
    monkeypatch.setattr("pandas.read_csv", lambda *_, **__: pytest.fail("it is parsed"))
    with pytest.raises(Failed, match=r"log\.txt holds too many numbers"):
        read_records(tmp_path / "log.txt", 2**28)


@pytest.mark.parametrize("odd", ['1,"2\n3"\n', "1\r2\n"])
def test_line_ends_that_are_none_are_refused(tmp_path, odd):
    (tmp_path / "log.txt").write_text(f"*Step  = 1\n*Time  = 1\n{odd}", newline="")
    with pytest.raises(Failed, match=r"log\.txt holds a quotation mark, or half a line end"):
        read_records(tmp_path / "log.txt", 2**28)


@given(
    st.lists(st.sampled_from(["*Step  = 1\n", "*Time  = 2\n", "*Data\n", "1,2\n", "3,4.5\n", " -1,2\n"]), max_size=12)
)
def test_lines_of_numbers_are_counted_for_each_step(lines):
    counts = []
    for line in lines:
        if line.startswith("*Step"):
            counts.append(0)
        elif counts and not line.startswith("*"):
            counts[-1] += 1
    content = "".join(lines).encode()
    letters, starts = _lines(content)
    assert _numbers_of_steps(content, starts, letters[starts] == ord("*")).tolist() == counts


@pytest.mark.parametrize("blank", ["\n", "  \n", "\t\n", " \t \n"])
@pytest.mark.parametrize("at", [0, 1, 3, -1])
def test_blank_lines_do_not_count(tmp_path, blank, at):
    lines = logged([0.5, 1.0], [1, 2], [[1.0, 2.0], [3.0, 4.0]]).splitlines(keepends=True)
    path = tmp_path / "q.txt"
    path.write_text("".join([*lines[:at], blank, *lines[at:]]))
    times, table, even = read_records(path, 10**6)
    assert (times.tolist(), table[:, 1].tolist(), even) == ([0.5, 1.0], [1.0, 2.0, 3.0, 4.0], True)
