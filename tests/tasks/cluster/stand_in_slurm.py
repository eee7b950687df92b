"""A profile of a site, what is broken in it, and shell scripts that stand in for SLURM's commands.

They note how they are called, and answer as a test says. Every profile starts from ``slurm/site-template.yaml``.
"""

import json
import re
import shlex
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import yaml

from sinew.runner.cluster.job_table import COORDINATOR, JobTable
from sinew.tasks.study.study import Study
from tests.tasks.cli.bad_input import write

SHIPPED = Path(__file__).parents[3] / "slurm"
SITE: dict[str, Any] = yaml.safe_load((SHIPPED / "site-template.yaml").read_text())
SUBMIT = ("submit", "study.yaml", "--profile", "profile.yaml", "--out", "out")
FAKE = """#!/bin/sh
echo "{name} $*" >> {calls}
if [ -e {answer} ]; then . {answer}; fi
"""
OPTIONS = ("account", "partition", "qos", "constraint", "coordinator.partition", "workers.partition")


def write_profile(field: str = "", value: Any = None) -> int:
    """The site's profile, one line for each field; or what it says of one dotted field, set to ``value``, on line 3."""
    if not field:
        write("profile.yaml", as_yaml(SITE))
        return 0
    top, *others = field.split(".")
    lines = {"tls": True, "qos": "normal", top: json.loads(json.dumps(SITE.get(top)))}
    section: Any = lines
    for name in [top, *others][:-1]:
        section = section[name]
    section[int(others[-1]) if isinstance(section, list) else [top, *others][-1]] = value
    if top != "name":
        lines["name"] = "my-site"
    write("profile.yaml", as_yaml(lines))
    return list(lines).index(top) + 1


def as_yaml(profile: dict[str, Any]) -> str:
    return "".join(f"{json.dumps(name)}: {json.dumps(value, ensure_ascii=False)}\n" for name, value in profile.items())


def job_name() -> str:
    """The name in the queue of the job that leads the study ``check`` on the folder ``out``."""
    return JobTable(Path("out/jobs")).job_name("check", COORDINATOR)


def queue() -> str:
    """What squeue says of job 5."""
    return f"5|RUNNING|None|n1|{job_name()}"


def answer(command: str, script: str) -> None:
    write(f"../bin/{command}-says", script)


def calls() -> list[str]:
    return Path("../calls").read_text().splitlines() if Path("../calls").exists() else []


def assert_shell_accepts(script: str) -> None:
    done = subprocess.run(["/bin/bash", "-n"], input=script, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, ""), done.stderr


@contextmanager
def collected(problems: dict[Any, str], case: Any) -> Iterator[None]:
    """Go on with the next case after one that is wrong, from a clean folder."""
    try:
        yield
    except Exception as error:
        problems[short_id(case)] = f"{type(error).__name__}: {error}"[:300]
        shutil.rmtree("out", ignore_errors=True)
        Path("../calls").unlink(missing_ok=True)


def short_id(value: Any) -> str:
    return (repr(value) if len(repr(value)) < 30 else repr(value)[:30]).encode("unicode_escape").decode()


def study_at(path: Path) -> Study:
    study = Study(name="check")
    study._path = path
    return study


def assert_modules_are_words(script: str, names: list[str]) -> None:
    lines = [line for line in script.splitlines() if line.startswith("module load ")]
    assert len(lines) == len(names)
    for line, name in zip(lines, names, strict=True):
        reader = shlex.shlex(line, posix=True, punctuation_chars=True)
        reader.whitespace_split = True
        assert list(reader) == ["module", "load", name]
        assert line == f"module load {shlex.quote(name)}" or not re.search(r"[*?\[!]", name), "a pattern, unquoted"


def header_of(script: str) -> Iterator[str]:
    """The lines that sbatch obeys: those before the first command."""
    for line in script.split("\n"):
        if line and not line.startswith("#"):
            return
        if line.startswith("#SBATCH"):
            yield line
