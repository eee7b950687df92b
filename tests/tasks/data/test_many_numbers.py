"""The numbers of many cells at once are those of each of them."""

from random import Random

from hypothesis import example, given
from hypothesis import strategies as st

from sinew.tasks.data.text import are_plain, is_number, number, numbers

PLAIN = st.from_regex(r"[-+]?(\d{1,4}(\.\d{0,3})?|\.\d{1,3})([eE][-+]?\d{1,3})?", fullmatch=True)
LONG = "0." + "0" * 400
ODD = st.sampled_from(
    [
        "",
        "1,5",
        "1,367.91",
        "nan",
        "inf",
        "1_0",
        " 1",
        "0:12:01.5",
        "1\n2",
        "1e999",
        "9" * 401,
        "0." + "0" * 400,
        "x",
        "\u0663.\u0665",
    ]
)


@given(
    st.lists(PLAIN, max_size=30), st.lists(ODD, max_size=2), st.sampled_from(".,"), st.randoms(use_true_random=False)
)
@example(["1"], [LONG], ".", Random(0))
def test_many_cells_have_the_numbers_that_each_of_them_has(plain, odd, decimal, order):
    every = [cell.replace(".", decimal) for cell in plain] + odd
    order.shuffle(every)
    assert numbers(every, decimal) == [number(cell, decimal) for cell in every]
    if are_plain(every, decimal):
        assert all(is_number(cell, decimal) for cell in every)


def test_plain_numbers_are_looked_at_together(monkeypatch):
    cells = [f"{n}.25" for n in range(20_000)]
    monkeypatch.setattr("sinew.tasks.data.text.number", None)  # it is not called
    assert numbers(cells, ".") == [float(cell) for cell in cells]
