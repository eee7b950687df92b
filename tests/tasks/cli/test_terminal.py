"""What the command line says: help in groups with examples, completion, suggestions, closing lines, JSON and quiet."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import click
import pytest

from sinew.tasks.cli import main as cli
from sinew.tasks.cli.terminal import EXAMPLES, GROUPS, SHELLS, completion_script
from sinew.tasks.data.cohort import write_cohort
from sinew.tasks.data.virtual import virtual_cohort
from sinew.tasks.study.workspace import Workspace

CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f]")


def sinew(*words: object, **environment: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "sinew", *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, timeout=200, env={**os.environ, **environment})


@pytest.fixture
def here(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Any:
    """Runs the command in this process; returns exit code, output and errors."""
    monkeypatch.setattr(Workspace, "client", lambda self: None)

    def run(*words: object) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["sinew", *map(str, words)])
        code = 0
        try:
            cli.main()
        except SystemExit as stopped:
            code = int(stopped.code or 0)
        said = capsys.readouterr()
        return code, said.out, said.err

    return run


@pytest.fixture
def study(tmp_path: Path) -> Path:
    specimens, truth = virtual_cohort(seed=3, per_site=1, rate_hz=1)
    write_cohort(tmp_path / "cohort", specimens[:1], truth)
    path = tmp_path / "study.yaml"
    path.write_text(
        "name: small\ncohort: cohort\ncluster: {name: local, workers: 1}\nsobol: {base_samples: 4, resamples: 10}\n"
    )
    return path


def test_every_command_is_in_a_group_and_has_examples_that_click_understands(here):
    code, said, _ = here("--help")
    grouped = [name for group in GROUPS.values() for name in group]
    assert code == 0
    assert set(cli.sinew.commands) == set(grouped)
    assert [title for title in GROUPS if f"\n{title}:\n" in said] == list(GROUPS)
    for name, command in cli.sinew.commands.items():
        if isinstance(command, click.Group):
            continue
        _, told, _ = here(name, "--help")
        assert "Examples:\n" in told
        for example in EXAMPLES[name]:
            assert example in told
            words = (
                re.sub(r'^eval "\$\((.*)\)".*', r"\1", example).partition("#")[0].partition("|")[0].partition(">")[0]
            )
            program, first, *rest = words.split()
            assert (program, first) == ("sinew", name)
            command.make_context(name, rest)


@pytest.mark.parametrize("shell", SHELLS)
def test_completion(shell, here):
    code, said, _ = here("completion", shell)
    assert (code, said.strip()) == (0, completion_script(cli.sinew, shell).strip())
    assert "_SINEW_COMPLETE" in said


def test_the_script_for_bash_completes(here):
    if shutil.which("bash") is None:
        pytest.skip("no bash")
    done = sinew(_SINEW_COMPLETE="bash_complete", COMP_WORDS="sinew w", COMP_CWORD="1")
    assert done.stdout.split() == ["plain,watch"]
    done = sinew(_SINEW_COMPLETE="bash_complete", COMP_WORDS="sinew run --si", COMP_CWORD="2")
    assert done.stdout.split() == ["plain,--simulator"]
    done = sinew(_SINEW_COMPLETE="bash_complete", COMP_WORDS="sinew run --simulator f", COMP_CWORD="3")
    assert done.stdout.split() == ["plain,febio"]
    _, script, _ = here("completion", "bash")
    assert subprocess.run(["bash", "-n"], input=script, text=True, timeout=60).returncode == 0


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("clibrate", "x"), "Did you mean 'calibrate'? `sinew --help` says more"),
        (("run", "x.yaml", "--quite"), "'--quiet'?); `sinew run --help` says more"),
        (("run",), "Missing argument 'STUDY'; `sinew run --help` says more"),
        (("watch",), "Missing argument 'FOLDER'; `sinew watch --help` says more"),
        (("run", "x.yaml", "--simulator", "abaqus"), "'abaqus' is not one of 'uniaxial', 'febio'; `sinew run"),
        (("run", "x.yaml", "--simulator", "template"), "'template' is not one of"),
        (("completion", "tcsh"), "'tcsh' is not one of 'bash', 'zsh', 'fish'"),
    ],
)
def test_mistakes_are_answered_with_the_next_step(here, words, told):
    code, out, err = here(*words)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert told in err


@pytest.mark.parametrize(
    ("content", "told"), [("tasks: [sobl]", "did you mean 'sobol'"), ("sobel: {}", "did you mean 'sobol'")]
)
def test_a_misspelled_task_or_field_of_a_study(here, study, content, told):
    study.write_text(f"name: small\n{content}\n")
    code, _, err = here("run", study, "--out", study.parent / "out")
    assert code == 2
    assert told in err


def test_quiet_is_the_last_line_only(here, study):
    out = study.parent / "out"
    assert here("sobol", study, "--out", out, "--quiet") == (0, f"next: sinew report {out}\n", "")


@pytest.mark.estimate
def test_json_is_objects_only(here, study):
    out = study.parent / "out"
    code, said, err = here("sobol", study, "--out", out, "--json")
    events = [json.loads(line) for line in said.splitlines()]
    assert (code, err) == (0, "")
    names = [event["event"] for event in events]
    assert (names[:2], names[-2:]) == (["estimate", "task started"], ["task finished", "next"])
    assert set(names[2:-2]) <= {"progress"}
    assert events[-2]["new_simulations"] == 72
    assert json.loads(Path(events[-2]["result"]).read_text())["rows"] == 72
    assert events[-1]["commands"] == [f"sinew report {out}"]


def test_nothing_moves_a_cursor_that_is_not_there(here, study):
    code, said, err = here("run", study, "--out", study.parent / "out")
    assert code == 0
    assert "R2 on unseen" in said
    assert "72 of 72 rows" in err
    assert not CONTROL.search((said + err).replace("\n", ""))
    assert said.splitlines()[-1] == f"next: sinew report {study.parent / 'out'}"


@pytest.mark.page
def test_what_is_looked_at_next(here, study):
    out = study.parent / "out"
    assert here("sobol", study, "--out", out, "--quiet")[1] == f"next: open {out}/report.html in a browser\n"
    looks = [("status", out), ("watch", out), ("watch", out, "--once")]
    for look in looks:
        assert here(*look)[1].splitlines()[-1] == f"next: open {out}/report.html in a browser"
    page = (out / "report.html").stat().st_mtime_ns
    os.utime(out / "sobol.json", ns=(page + 1, page + 1))
    for look in looks:
        assert here(*look)[1].splitlines()[-1] == f"next: sinew report {out}", "the page is older than a result"
    theirs = (out / "report.html").read_text().replace("script-src ", "script-src &#39;unsafe-inline&#39; ", 1)
    (out / "report.html").write_text(theirs)
    assert here("status", out)[1].splitlines()[-1] == f"next: sinew report {out}", "other scripts may run in it"
    away = theirs.replace("script-src &#39;unsafe-inline&#39; ", "script-src ", 1)
    (out / "report.html").write_text(away)
    assert here("status", out)[1].splitlines()[-1] == f"next: open {out}/report.html in a browser"
    (out / "report.html").write_text(away.replace("<title>", '<META HTTP-EQUIV="refresh" content="0;url=/"><title>', 1))
    assert here("status", out)[1].splitlines()[-1] == f"next: sinew report {out}", "it leads elsewhere"
    (out / "report.html").unlink()
    assert here("status", out)[1].splitlines()[-1] == f"next: sinew report {out}"
    assert (
        here("cohort", "--out", study.parent / "more", "--per-site", 1, "--rate", 1)[1]
        .splitlines()[-1]
        .startswith("next: ")
    )
    named = {word for line in (here("repair", out)[1],) for word in re.findall(r"sinew (\w+)", line)}
    assert named <= set(cli.sinew.commands)
