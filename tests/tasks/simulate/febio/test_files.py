"""Which files a template may consist of."""

import pytest

from sinew.runner.errors import BadInput
from sinew.tasks.simulate.febio.files import read_files
from sinew.tasks.simulate.febio.renderer import Allowance


def test_files_stay_in_their_folders(tmp_path):
    (tmp_path / "study" / "sub").mkdir(parents=True)
    (tmp_path / "secret").write_text("x")
    home = tmp_path / "study"
    (home / "sub" / "a.feb").write_text("{% include 'b.xml' %}")
    (home / "sub" / "b.xml").write_text("b")
    (home / "sub" / "x").mkdir()
    (home / "sub" / ".hid.xml").write_text("b")
    assert read_files(home, "sub/a.feb", Allowance()) == ("a.feb", {"a.feb": "{% include 'b.xml' %}", "b.xml": "b"})
    for text, told in [
        ("{% include '../../secret' %}", "lies outside the template's folder"),
        ("{% include '/etc/hostname' %}", "lies outside the template's folder"),
        ("{% include 'x/../b.xml' %}", "b.xml: is named 'x/../b.xml'; expected a name as seen from"),
        ("{% include HERE %}", "is named '/"),
        ("{% include '.hid.xml' %}", "is named '.hid.xml'; expected .*no part with a dot first"),
        ("{% include x %}", "whose name is computed"),
        ("{% include 'gone' %}", "is not there"),
        ("{% if %}", "line 1"),
    ]:
        (home / "sub" / "a.feb").write_text(text.replace("HERE", repr(str(home / "sub" / "b.xml"))))
        with pytest.raises(BadInput, match=told):
            read_files(home, "sub/a.feb", Allowance())
    (home / "link.feb").symlink_to(tmp_path / "secret")
    for name in ("../secret", "link.feb", "a\0b"):
        with pytest.raises(BadInput):
            read_files(home, name, Allowance())
