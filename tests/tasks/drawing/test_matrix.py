"""Tables of two directions: all cells are there, whole, on a terminal of 80 columns."""

import io
import itertools

import pytest

from sinew.runner.console import Console
from sinew.tasks.drawing.matrix import COLUMNS, print_matrix


def said(rows: int, columns: int) -> str:
    out = io.StringIO()
    print_matrix(
        Console(file=out, width=80),
        "Indices",
        ("parameter", [f"row_{i}" for i in range(rows)]),
        ("output", [f"column_{j} (mm)" for j in range(columns)]),
        lambda i, j: f"0.{i:02d} ± 0.{j:02d}",
    )
    return out.getvalue()


@pytest.mark.parametrize(("rows", "columns"), [(1, 1), (4, 11), (16, 2), (16, 11), (11, 16), (3, 3)])
def test_every_cell_is_whole(rows, columns):
    text = said(rows, columns)
    lines = text.splitlines()
    assert max(map(len, lines)) <= 80
    assert text.count("Indices") == 1
    cells, heads = {}, []
    for line in lines:
        words = [word.strip() for word in line.replace("┃", "│").split("│")[1:-1]]
        if "┃" in line:
            heads = words[1:]
        elif words:
            cells |= {frozenset((words[0], head)): word for head, word in zip(heads, words[1:], strict=True)}
    assert cells == {
        frozenset((f"row_{i}", f"column_{j} (mm)")): f"0.{i:02d} ± 0.{j:02d}"
        for i, j in itertools.product(range(rows), range(columns))
    }
    assert text.count("┏") == -(-min(rows, columns) // COLUMNS)


def test_a_few_columns_stay_columns():
    (head,) = (line for line in said(3, 3).splitlines() if "┃" in line)
    assert "parameter" in head
    assert "column_2" in head


def test_long_names_are_whole():
    out = io.StringIO()
    names = [f"stress_of_the_gauge_section_{i}_MPa" for i in range(4)]
    print_matrix(Console(file=out, width=80), "Indices", ("parameter", names), ("output", names), lambda i, j: "0.5")
    columns = zip(*(line.replace("┃", "│").split("│")[1:-1] for line in out.getvalue().splitlines()
                    if "┃" in line), strict=True)  # fmt: skip
    assert ["".join(part.strip() for part in column) for column in columns] == ["parameter", *names]
