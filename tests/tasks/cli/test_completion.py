"""Real shells complete the command: bash, zsh and fish are asked for what a person would see after a tab."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pexpect
import pytest

R = {"run", "report", "repair", "reproduce"}  # what begins with it


@pytest.fixture
def place(tmp_path: Path) -> Path:
    """A folder with the command ``sinew``, to be put before the PATH."""
    command = tmp_path / "sinew"
    command.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m sinew "$@"\n')
    command.chmod(0o755)
    return tmp_path


def environment(place: Path) -> dict[str, str]:
    """A terminal of no tricks, and a home without settings of anybody."""
    path = f"{place}{os.pathsep}{os.environ['PATH']}"
    return {
        **os.environ,
        "PATH": path,
        "HOME": str(place),
        "ZDOTDIR": str(place),
        "TERM": "dumb",
        "XDG_CONFIG_HOME": str(place),
    }


def said(place: Path, shell: str, script: str) -> str:
    if shutil.which(shell) is None:
        pytest.skip(f"no {shell}")
    done = subprocess.run(
        [shell, "-c", script], capture_output=True, text=True, timeout=120, env=environment(place), cwd=place
    )
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout


@pytest.mark.parametrize(
    ("words", "found"), [("sinew ru", {"run"}), ("sinew r", R), ("sinew run --dry", {"--dry-run"})]
)
def test_bash(place, words, found):
    script = f"""
        eval "$(sinew completion bash)"
        COMP_WORDS=({words}); COMP_CWORD=$((${{#COMP_WORDS[@]}} - 1))
        $(complete -p sinew | sed 's/.*-F \\([^ ]*\\).*/\\1/') sinew
        printf '%s\\n' "${{COMPREPLY[@]}}"
    """
    assert set(said(place, "bash", script).split()) == found


@pytest.mark.parametrize(
    ("words", "found"), [("sinew ru", {"run"}), ("sinew r", R), ("sinew run --dry", {"--dry-run"})]
)
def test_fish(place, words, found):
    script = f"sinew completion fish | source; complete -C '{words}'"
    assert {line.split("\t")[0] for line in said(place, "fish", script).splitlines()} == found


def test_zsh(place):
    if shutil.which("zsh") is None:
        pytest.skip("no zsh")
    with pexpect.spawn(
        "zsh", ["-f", "-i"], env=environment(place), cwd=str(place), timeout=120, encoding="utf-8"
    ) as shell:
        shell.sendline("PS1='' ; unsetopt zle_bracketed_paste 2>/dev/null; autoload -Uz compinit && compinit -u -D")
        shell.sendline('eval "$(sinew completion zsh)"; echo re""ady')
        shell.expect("ready")
        shell.send("sinew ru\t--help\n")  # a tab completes the word and adds a space
        shell.expect("Usage: sinew run ")
        shell.send("sinew run --dry\t--help\n")
        shell.expect("Usage: sinew run ")
        shell.sendline("exit")
