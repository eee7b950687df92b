"""Authors and licences, as options give them and as the description has them."""

import pytest

from sinew.runner.errors import BadInput
from sinew.tasks.report.crate.metadata import Person, licence_of, person_of


@pytest.mark.parametrize(
    ("text", "person"),
    [
        ("Ada Lovelace", Person("Ada Lovelace")),
        ("Ada Lovelace <0000-0002-1825-0097>", Person("Ada Lovelace", "https://orcid.org/0000-0002-1825-0097")),
        ("Ada <https://orcid.org/0000-0002-1694-233X>", Person("Ada", "https://orcid.org/0000-0002-1694-233X")),
        ("Łukasz Müller", Person("Łukasz Müller")),
    ],
)
def test_authors(text, person):
    assert person_of(text) == person


@pytest.mark.parametrize(
    ("text", "address"),
    [
        ("CC-BY-4.0", "https://spdx.org/licenses/CC-BY-4.0"),
        ("https://creativecommons.org/licenses/by/4.0/", "https://creativecommons.org/licenses/by/4.0/"),
    ],
)
def test_licences(text, address):
    assert licence_of(text) == address


@pytest.mark.parametrize("text", ["", "<0000-0002-1825-0097>", "Ada <mail@example.org>", "A" * 201, "Ada\nB"])
def test_what_is_no_author_is_refused(text):
    with pytest.raises(BadInput, match="--author"):
        person_of(text)


@pytest.mark.parametrize("text", ["", "a b", "javascript:alert(1)", "http://a b", "-x"])
def test_what_is_no_licence_is_refused(text):
    with pytest.raises(BadInput, match="--license"):
        licence_of(text)
