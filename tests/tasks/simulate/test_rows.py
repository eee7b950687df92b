"""Whatever stands in a file of parameters, it is read as possible parameters or refused in one line."""

from hypothesis import example, given
from hypothesis import strategies as st

from sinew.tasks.model import TENDON, Model
from sinew.tasks.simulate.rows import read_parameters
from tests.tasks.cli.bad_input import PARAMETERS
from tests.tasks.inputs import CELLS, mutated, quick, read_or_refuse, table


@quick
@given(
    st.binary()
    | mutated(PARAMETERS)
    | st.lists(CELLS, max_size=4).map(lambda cells: table("nu_m", [[c] for c in cells]))
)
@example(b"\xef\xbb\xbf")
@example(b"\n")
@example(b"E_f,nu_m\n200,0.3,1\n")
def test_any_bytes_as_parameters(content):
    model = Model()
    values = read_or_refuse(lambda path: read_parameters(path, model), "rows.csv", files={"rows.csv": content})
    if values is not None:
        assert values.shape[1] == len(TENDON)
        assert all(p.possible(value) for row in values for p, value in zip(model.parameters, row, strict=True))
