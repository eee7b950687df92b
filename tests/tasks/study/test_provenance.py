"""How the program that made a result is installed again."""

import json

import pytest

from sinew.tasks.study import provenance


class Installed:
    version = "1.2.3"

    def __init__(self, origin: dict | None) -> None:
        self.origin = origin

    def read_text(self, name: str) -> str | None:
        assert name == "direct_url.json"
        return None if self.origin is None else json.dumps(self.origin)


@pytest.mark.parametrize(
    ("origin", "command"),
    [
        (None, "pip install sinew-fe==1.2.3"),
        (
            {"url": "https://host/sinew.git", "vcs_info": {"vcs": "git", "commit_id": "abc"}},
            "pip install git+https://host/sinew.git@abc",
        ),
        (
            {"url": "https://host/a b.git;rm", "vcs_info": {"vcs": "git", "commit_id": "abc"}},
            "pip install 'git+https://host/a b.git;rm@abc'",
        ),
    ],
)
def test_the_command_installs_from_where_it_came(monkeypatch, origin, command):
    monkeypatch.setattr(provenance, "distribution", lambda name: Installed(origin))
    assert provenance.install_command() == command


def test_from_a_checkout_a_wheel_is_made_and_the_code_is_named(monkeypatch):
    monkeypatch.setattr(provenance, "distribution", lambda name: Installed({"url": "file:///x", "dir_info": {}}))
    command = provenance.install_command()
    assert command.startswith("make wheel && pip install dist/sinew_fe-1.2.3-py3-none-any.whl ")
    assert provenance.code() in command
