"""What the rendering program answers."""

import pytest

from sinew.tasks.simulate.febio.rendering.program import answer
from sinew.tasks.simulate.febio.rendering.wrong import Wrong


@pytest.mark.parametrize("outputs", [None, []])
def test_nothing_is_passed_on_that_was_not_looked_at(outputs):
    """FEBio ends an instruction behind ``?`` and ``&gt;``, which XML does not: the rest would be read by FEBio only."""
    hidden = "<x file='/etc/x'/>"
    body = f"<?x ?&gt;{hidden}<?y ?><!-- &gt;{hidden} --><a>1 &amp; 2</a>"
    job = {"main": "a", "renders": [{}], "outputs": outputs, "texts": True}
    (text,) = answer(job, {"a": f"<febio_spec>{body}</febio_spec>"})["texts"]
    start, _, rest = text.partition("\n")
    assert start == '<?xml version="1.0" encoding="UTF-8"?>'
    assert (
        rest.startswith("<febio_spec><a>1 &amp; 2</a>") and "etc" not in rest and "<?" not in rest and "<!" not in rest
    )


def test_unknown_names_are_refused():
    with pytest.raises(Wrong, match="unknown variable"):
        answer({"main": "a", "known": ["E"], "renders": []}, {"a": "{{ E * nu }}"})
