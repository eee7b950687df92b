"""Bad profiles and bad use of SLURM end with exit code 2 and one line that says where, what, and what was expected.

The commands run in this process. In place of SLURM's commands stand shell scripts that note how they are called and
answer as a table here says. Every profile starts from ``slurm/site-template.yaml`` and breaks one thing.
"""

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import yaml
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from runner import slurm
from runner.jobs import slurm_time
from runner.store import Store
from tasks.cli import main
from tasks.problems import BadInput
from tasks.profile import Profile, read_profile
from tasks.study import Study
from tasks.submission import job_scripts
from tests.tasks.test_bad_input import (
    BOMB,
    FEBIO,
    fifo,
    folder_for_file,
    link,
    listing,
    sparse,
    write,
    write_specimen,
    write_study,
)
from tests.tasks.test_input_properties import read_or_refuse

SHIPPED = Path(__file__).parents[2] / "slurm"
SITE: dict[str, Any] = yaml.safe_load((SHIPPED / "site-template.yaml").read_text())
SUBMIT = ("submit", "study.yaml", "--profile", "profile.yaml", "--out", "out")
QUEUE = "5|RUNNING|None|n1|sinew-check"
FAKE = """#!/bin/sh
echo "{name} $*" >> {calls}
if [ -e {answer} ]; then . {answer}; fi
"""


# ---- a folder with all that is valid, and a SLURM that notes who calls


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


@pytest.fixture
def here(tmp_path, monkeypatch):
    folder, commands = tmp_path / "here", tmp_path / "bin"
    for name in ("sbatch", "squeue", "scancel"):
        write(str(commands / name), FAKE.format(name=name, calls=tmp_path / "calls", answer=commands / f"{name}-says"))
        (commands / name).chmod(0o755)
    write(str(commands / "sbatch-says"), "echo 123")
    folder.mkdir()
    for module in ("tasks.pipeline", "dask_jobqueue.slurm"):  # so that no case is charged for the time of its imports
        import_module(module)
    monkeypatch.chdir(folder)
    monkeypatch.setenv("PATH", str(commands))
    monkeypatch.delenv("SLURM_JOB_ID", raising=False)
    write_study()
    write_specimen("cohort/s01")
    write_specimen("cohort/s02", "7")
    write_profile()
    return folder


def answer(command: str, script: str) -> None:
    write(f"../bin/{command}-says", script)


def calls() -> list[str]:
    return Path("../calls").read_text().splitlines() if Path("../calls").exists() else []


@pytest.fixture
def sinew(here, monkeypatch, capfd) -> Callable[..., SimpleNamespace]:
    """Runs the command; what it printed never is a trace, and never moves a terminal's cursor."""

    def run(*arguments: str) -> SimpleNamespace:
        monkeypatch.setattr(sys, "argv", ["sinew", *arguments])
        started = time.process_time()
        try:
            main()
            code = 0
        except SystemExit as stopped:
            code = stopped.code
        seconds = time.process_time() - started
        out, err = capfd.readouterr()
        assert all(line.isprintable() for line in (out + err).split("\n")), "characters that a terminal obeys"
        assert seconds < 2, "too slow"
        return SimpleNamespace(code=code, out=out, err=err)

    return run


@pytest.fixture
def refused(sinew, here) -> Callable[..., str]:
    """Runs the command on bad input and returns the line it printed. Only asking is allowed, not submitting."""

    def run(arguments: tuple[str, ...], *told: str, asked: bool = False) -> str:
        before = listing(here)
        said = sinew(*arguments)
        assert said.code == 2, said
        assert said.out == ""
        assert said.err.startswith("sinew: ")
        assert said.err.count("\n") == 1
        assert said.err.endswith("\n")
        assert [words for words in told if words not in said.err] == [], said.err
        assert not re.search(r"; expected\s*$", said.err), "what was expected is not said"
        if asked:
            assert all(call.startswith("sbatch --test-only ") for call in calls())
            assert not Path("out/jobs/jobs.jsonl").exists()
        else:
            assert calls() == []
            assert listing(here) == before, "something was written"
        return str(said.err)

    return run


@pytest.fixture
def accepted(sinew) -> Callable[..., str]:
    def run(*arguments: str) -> str:
        said = sinew(*arguments)
        assert (said.code, said.err) == (0, ""), said
        return str(said.out)

    return run


@pytest.mark.parametrize("profile", [SHIPPED / "site-template.yaml", SHIPPED / "generic.yaml", Path("profile.yaml")])
def test_what_is_broken_below_was_valid(accepted, profile):
    said = accepted(*SUBMIT[:3], str(profile), *SUBMIT[4:])
    assert said.startswith("job 123 leads 'check'")
    *asked, submitted = (call.split()[1] for call in calls())
    assert set(asked) == {"--test-only"}
    assert submitted == "--parsable"
    assert list(slurm.JobTable(Path("out/jobs")).read()) == ["123"]
    for script in ("job.sh", "worker.sh"):
        assert_shell_accepts(Path("out/jobs", script).read_text())


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("mode", "allocation"),
        ("constraint", "[ivy|icelake]*2&ib"),
        ("account", None),
        ("directives", []),
        ("directives", ["--gres=gpu:a100:1", "--exclusive", "--mail-user=a.b@c.org"]),
        ("directives", ["--comment='two words'"]),
        ("modules", ["gcc/13.2.0+cuda-12", "FEBio:4@local"]),
        ("prologue", ["source ~/venv/bin/activate", 'set -e; ulimit -s unlimited # "it\'s"']),
        ("scratch", "/local/$USER"),
        ("scratch", "${TMPDIR}/x"),
        ("workers.walltime", "1-00:00:00"),
        ("workers.walltime", "90:00"),
        ("workers.memory", "256M"),
        ("workers.memory", "1t"),
        ("workers.minimum", 20),
    ],
)
def test_what_is_unusual_but_valid(accepted, field, value):
    write_profile(field, value)
    script, _, worker = accepted(*SUBMIT, "--dry-run").partition("# ---- ")
    assert_shell_accepts(script)
    assert_shell_accepts(f"# {worker}")
    assert calls() == []
    assert not Path("out").exists()


def assert_shell_accepts(script: str) -> None:
    done = subprocess.run(["/bin/bash", "-n"], input=script, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, ""), done.stderr


# ---- fields

OPTIONS = ("account", "partition", "qos", "constraint", "coordinator.partition", "workers.partition")
WHOLE = ("coordinator.cores", "workers.cores", "workers.jobs", "workers.minimum", "allocation.tasks")
TIMES = ("coordinator.walltime", "workers.walltime", "allocation.walltime")
MEMORIES = ("coordinator.memory", "workers.memory", "allocation.memory")
SECTIONS = ("coordinator", "workers", "allocation")
WRONG_TYPES = [
    *((field, "text", (5, 1.5, True, [], {}, ["a"])) for field in (*OPTIONS, "interface", "scratch", "job_script")),
    *((field, "text", (5, 1.5, True, None, [], {})) for field in (*TIMES, *MEMORIES, "name")),
    *((f"{field}.0", "text", (5, None, False, [], {})) for field in ("directives", "modules", "prologue")),
    *((field, "a list", (5, "--x", None, {})) for field in ("directives", "modules", "prologue")),
    *((field, "a whole number", (1.5, "4", True, None, [], {}, 2.0)) for field in WHOLE),
    ("workers.poll_s", "a number", ("15", True, None, [], {})),
    ("tls", "true or false", (1, 0, "yes", "no", "true", None, [], {})),
    ("mode", "one of 'jobs' or 'allocation'", ("Jobs", "", 1, None, [], {}, "jobs ")),
    *((field, "a mapping", (5, "small", None, [], True, [{"cores": 1}])) for field in SECTIONS),
]


@contextmanager
def collected(problems: dict[Any, str], case: Any) -> Iterator[None]:
    """Go on with the next case after one that is wrong, from a clean folder."""
    try:
        yield
    except Exception as error:
        problems[_id(case)] = f"{type(error).__name__}: {error}"[:300]
        shutil.rmtree("out", ignore_errors=True)
        Path("../calls").unlink(missing_ok=True)


def _id(value: Any) -> str:
    return (repr(value) if len(repr(value)) < 30 else repr(value)[:30]).encode("unicode_escape").decode()


@pytest.mark.parametrize(("field", "expected", "values"), WRONG_TYPES)
def test_wrong_types(refused, field, expected, values):
    problems: dict[Any, str] = {}
    for value in values:
        with collected(problems, value):
            line = write_profile(field, value)
            refused(SUBMIT, f"profile.yaml: line {line}, {field}: {value!r}; expected {expected}")
    assert problems == {}


WALLTIMES = ["24", "1:70:00", "1:00:70", "0:30", "0:59", "-1:00:00", "1-", "-", "", ":", "1:", ":30", "1::1", "1:0:0:0"]
WALLTIMES += [
    "1e3",
    "1.5:00:00",
    "+1:00:00",
    "1:00:00 ",
    " 1:00:00",
    "1:00:00\n",
    "1 day",
    "UNLIMITED",
    "1d",
    "0:00:00",
]
WALLTIMES += ["١:٠٠:٠٠", "１:00:00", "²:00:00", "367-00:00:00", "99999:00:00", "--1:00:00", "1-1-1:00:00", "0x1:00:00"]
WALLTIMES += ["1_0:00:00", "9" * 5000 + ":00:00", "9" * 5000 + "-00:00:00", "x" * 5000, "1-02:30", "1-90:00"]
MEMORY = [
    "4",
    "4X",
    "-4G",
    "1K",
    "４G",
    "4GB",
    "4.5G",
    "1e3M",
    "G",
    "",
    " 4G",
    "4G ",
    "4 G",
    "0G",
    "255M",
    "0x4G",
    "+4G",
]
MEMORY += ["٤G", "²G", "4Ｇ", "4G\n", "4G;id", "9" * 10 + "G", "9" * 5000 + "M", "all", "1_0G", "--mem=4G"]
TIME, SIZE = "D-HH:MM:SS, HH:MM:SS or MM:SS, of at least one minute and at most a year", "memory such as 4G or 4000M"
HOSTILE = ["a\nb", "a\n#SBATCH --array=1-9", "a; touch out", "$(touch out)", "`touch out`", 'a"b', "a'b", "a b", "a\\b"]
HOSTILE += ["a>b", "a<b", "a#b", "{a,b}", "~", "a?", "a\0b", "a\x1b[31mb", "a\tb", "é", "", "x" * 201]
OUTSIDE = ("tmp", "", "./tmp", "~/tmp", "$(id)", "`id`", "/a b", '/a"', "/a;b", "/a\nb", "/a\0", "/a\\", "/a&b", "/a|b")
NO_DIRECTIVES = ("", "-A x", "--", "--A=1", "array=1", "--a b", "--a;id", "-- x", "--comment=a\nid", "--x=\0", "---x")
LIMITS = [
    *((field, "at least 1", (0, -1)) for field in ("coordinator.cores", "workers.cores", "workers.jobs")),
    *((field, "at most 1024", (1025, 2**70)) for field in ("coordinator.cores", "workers.cores")),
    ("workers.jobs", "at most 10000", (10_001,)),
    ("workers.minimum", "at least 0", (-1,)),
    ("workers.minimum", "at most 10000", (10_001,)),
    ("allocation.tasks", "at least 3", (2, 0, -64)),
    ("allocation.tasks", "at most 100000", (100_001,)),
    ("allocation.cores", "at least 1", (0,)),
    ("workers.poll_s", "at least 1", (0, 0.999, -15.5)),
    ("workers.poll_s", "at most 600", (601, 1e300)),
    *((field, TIME, WALLTIMES) for field in TIMES),
    *((field, SIZE, MEMORY) for field in MEMORIES),
    *((field, "", HOSTILE) for field in (*OPTIONS, "allocation.partition", "modules.0")),
    ("interface", "", (*HOSTILE, "x" * 16, "ib0;id", "ib0&", "/dev/ib0")),
    ("name", "letters, digits", (*HOSTILE, "x" * 33, "-a", "_a", "a/b", "../a", "my.site", "a:b")),
    ("scratch", "", (*OUTSIDE, "/a>b", "/" + "x" * 200)),
    ("prologue.0", "", ("", "a\nb", "a\0b", "a\x1bb", "a\rb", "x" * 1001)),
    ("directives.0", "", (*NO_DIRECTIVES, "--x=a\n#SBATCH --array=1-9")),
]


@pytest.mark.parametrize(("field", "expected", "values"), LIMITS, ids=[case[0] for case in LIMITS])
def test_out_of_limits(refused, field, expected, values):
    problems: dict[Any, str] = {}
    for value in values:
        with collected(problems, value):
            line = write_profile(field, value)
            refused(SUBMIT, f"profile.yaml: line {line}, {field}: ", f"; expected {expected}")
    assert problems == {}


@pytest.mark.parametrize("field", ["name", *OPTIONS[:4], "interface"])
@pytest.mark.parametrize("value", ["x" * 10_000, "\u2028", "\u202e"])
def test_long_and_invisible_values_are_shown_short(refused, field, value):
    write_profile(field, value)
    assert len(refused(SUBMIT, f"{field}: ")) < 300


def test_what_is_expected_of_a_name_is_true(refused):
    write_profile("name", "my.site")
    assert "'.'" not in refused(SUBMIT, "name: 'my.site'; expected ")


UNKNOWN = ["shape", "coordinator.shape", "workers.shape", "allocation.shape", "coordinator.jobs", "allocation.minimum"]
UNKNOWN += ["Name", "worker", "coordinator.poll_s", "workers.tasks", "walltime", "workers.tls", "path", "_path"]
UNKNOWN += ["workers.walltime_s", "model_config", "__class__", "workers.__init__", "a\nb", "a\x1b[31m", "workers.a.b"]


@pytest.mark.parametrize("field", UNKNOWN, ids=_id)
def test_unknown_keys(refused, field):
    *parents, name = field.split(".", 1)
    profile = json.loads(json.dumps(SITE))
    (profile[parents[0]] if parents else profile)[name] = 1
    write("profile.yaml", as_yaml(profile))
    line = [*profile].index(parents[0] if parents else name) + 1
    said = refused(SUBMIT, f"profile.yaml: line {line}, ", ": unknown key; expected one of ")
    assert name not in said.rpartition("expected one of ")[2].strip().split(", ")


def test_the_least_number_of_jobs_is_at_most_the_largest(refused):
    line = write_profile("workers.minimum", 21)
    refused(SUBMIT, f"profile.yaml: line {line}, workers.minimum: 21 is above jobs 20; expected at most jobs")
    write("profile.yaml", "name: a\nworkers:\n  cores: 1\n  minimum: 5\n")
    refused(SUBMIT, "profile.yaml: line 4, workers.minimum: 5 is above jobs 4; expected at most jobs")
    write("profile.yaml", "name: a\nworkers:\n  minimum: 3\n  jobs: 2\n")
    refused(SUBMIT, "profile.yaml: line 3, workers.minimum: 3 is above jobs 2; expected at most jobs")


@pytest.mark.parametrize("text", ["24:00:00", "4:00:00", "1:30", "90:00"])
def test_a_walltime_without_quotes_is_read_or_explained(sinew, text):
    """YAML 1.1 takes 4:00:00 for a number to the base of 60."""
    write("profile.yaml", f"name: a\nworkers: {{walltime: {text}}}\n")
    said = sinew(*SUBMIT, "--dry-run")
    hours, minutes, seconds = [0, *map(int, text.split(":"))][-3:]
    if said.code == 0:
        assert f"#SBATCH -t {slurm_time(3600 * hours + 60 * minutes + seconds)}\n" in said.out
    else:
        assert text in said.err or "HH:MM:SS" in said.err, "a person cannot know from this what to write"


def test_every_field_is_broken_here():
    broken = {field.removesuffix(".0") for field, *_ in (*WRONG_TYPES, *LIMITS)}
    fields = {name for name in SITE if name not in SECTIONS} | {"job_script"}
    fields |= {f"{name}.{field}" for name in SECTIONS for field in SITE[name]}
    assert fields <= broken
    assert set(Profile.model_fields) == {field.partition(".")[0] for field in fields}


# ---- what the shell and sbatch would make of a value


@pytest.mark.parametrize("name", ["gcc&id", "gcc|id", "gcc&&id", "(id)", "!id", "*", "[a-z]*", "gcc/13&"])
def test_a_module_is_one_word_of_the_shell(sinew, name):
    write_profile("modules.0", name)
    said = sinew(*SUBMIT, "--dry-run")
    if said.code == 0:
        assert_modules_are_words(said.out, [name, *SITE["modules"][1:]] * 2)
    else:
        assert "profile.yaml: line " in said.err
        assert "modules.0: " in said.err


def assert_modules_are_words(script: str, names: list[str]) -> None:
    lines = [line for line in script.splitlines() if line.startswith("module load ")]
    assert len(lines) == len(names)
    for line, name in zip(lines, names, strict=True):
        reader = shlex.shlex(line, posix=True, punctuation_chars=True)
        reader.whitespace_split = True
        assert list(reader) == ["module", "load", name]
        assert line == f"module load {shlex.quote(name)}" or not re.search(r"[*?\[!]", name), "a pattern, unquoted"


@pytest.mark.parametrize("value", ["${TMPDIR", "/local/${USER", "${", "$TMPDIR/${x:-", "/a${b}${c"])
def test_a_scratch_folder_closes_what_it_opens(refused, value):
    write_profile("scratch", value)
    refused(SUBMIT, "scratch: ")


SECOND_OPTIONS = [
    "--comment=a --array=1-9",
    '--comment="a',
    "--comment='a",
    "--comment=a #b",
    "--comment=a\\",
    "--x= --y",
]


@pytest.mark.parametrize("value", SECOND_OPTIONS)
def test_a_directive_is_one_option(refused, value):
    line = write_profile("directives.0", value)
    refused(SUBMIT, f"profile.yaml: line {line}, directives.0: ", "; expected ")


OWN_OPTIONS = {
    "--array=1-9": "nine jobs would lead one study",
    "--job-name=mine": "cancel and the guard against a second coordinator know jobs by their name",
    "--time=1:00": "the job's deadline comes from walltime",
    "--output=/dev/null": "the last words of a job that failed are read from its output",
    "--ntasks=7": "seven jobs would lead one study",
    "--wrap=ls": "not in a script",
}


@pytest.mark.parametrize("value", OWN_OPTIONS)
def test_a_directive_takes_back_nothing_that_sinew_relies_on(refused, value):
    line = write_profile("directives.0", value)
    refused(SUBMIT, f"profile.yaml: line {line}, directives.0: ", "; expected ")


def test_scratch_is_used_in_an_allocation_or_refused(sinew):
    write("profile.yaml", as_yaml(SITE | {"mode": "allocation"}))
    said = sinew(*SUBMIT, "--dry-run")
    assert "export SINEW_SCRATCH=" in said.out or "scratch: " in said.err


def test_paths_are_quoted(here):
    folder = Path("my lab's $(touch pwned)\n#SBATCH --array=1-9").absolute()
    write(str(folder / "profile.yaml"), as_yaml(SITE))
    profile = read_profile(folder / "profile.yaml")
    script = job_scripts(study_at(folder / "study.yaml"), profile, Path("out"), ["--data", str(folder)]).leader
    assert_shell_accepts(script)
    assert "--array" not in "".join(header_of(script))
    words = shlex.split(script[script.index(sys.executable) : script.index("\ncode=$?")])
    paths = [str(folder / "study.yaml"), "--profile", str(folder / "profile.yaml"), "--out", str(here / "out")]
    assert words == [sys.executable, "-m", "tasks.cli", "run", *paths, "--data", str(folder)]


def study_at(path: Path) -> Study:
    study = Study(name="check")
    study._path = path
    return study


# ---- files that are no profile

TEXTS = {
    "nothing": ("", "profile.yaml: empty; expected a profile"),
    "only a comment": ("# name: a\n", "profile.yaml: empty; expected a profile"),
    "only a byte order mark": (b"\xef\xbb\xbf", "profile.yaml: empty; expected a profile"),
    "null": ("~\n", "profile.yaml: line 1: not a mapping; expected fields"),
    "a list": ("- name: a\n", "profile.yaml: line 1: not a mapping; expected fields"),
    "one word": ("generic\n", "profile.yaml: line 1: not a mapping; expected fields"),
    "no name": ("account: a\n", "profile.yaml: line 1, name: missing; expected"),
    "a bomb of aliases": (BOMB, "profile.yaml: line 1: an anchor or alias; expected plain YAML"),
    "an anchor": ("name: a\nworkers: &w {cores: 1}\n", "profile.yaml: line 2: an anchor or alias; expected plain"),
    "a merge key": ("name: a\n<<: {tls: true}\n", "profile.yaml: line 2: the key '<<'; expected a name as key"),
    "a deep nest": ("workers: " + "[" * 5000, "profile.yaml: line 1: nested deeper than 12 levels; expected a profile"),
    "a deep mapping": ("workers: " + "{a: " * 5000, "profile.yaml: line 1: nested deeper than 12 levels; expected"),
    "a key twice": ("name: a\ntls: true\nname: b\n", "profile.yaml: line 3, name: given twice; expected each key once"),
    "an inner key twice": ("workers:\n  jobs: 1\n  jobs: 2\n", "line 3, workers.jobs: given twice; expected each key"),
    "a number as key": ("name: a\n1: b\n", "profile.yaml: line 2: the key '1'; expected a name as key"),
    "a list as key": ("name: a\n? [x]\n: b\n", "profile.yaml: line 2: the key "),
    "an object": ("name: !!python/object:os.system {}\n", "profile.yaml: line 1: the tag "),
    "a call": ("name: !!python/object/apply:os.system [touch out]\n", "profile.yaml: line 1: the tag "),
    "a harmless tag": ("name: a\nworkers: {cores: !!int '4'}\n", "profile.yaml: line 2: the tag "),
    "an own tag": ("name: a\nworkers: !w {}\n", "profile.yaml: line 2: the tag "),
    "two documents": ("name: a\n---\nname: b\n", "profile.yaml: line 2: a second YAML document; expected one profile"),
    "a tab": ("name: a\nworkers:\n\tjobs: 1\n", "profile.yaml: line 3: not valid YAML"),
    "an open bracket": ("name: a\nmodules: [gcc\ntls: true\n", "profile.yaml: line 3: not valid YAML"),
    "an open quote": ('name: "a\n', "profile.yaml: line "),
    "a NUL": ("name: a\0b\n", "profile.yaml: not valid YAML"),
    "an escape": ("name: a\x1b[31m\n", "profile.yaml: not valid YAML"),
    "binary": (b"\x7fELF\x02\x01\x00\xff\xfe", "profile.yaml: not a text file; expected YAML in UTF-8"),
    "Latin-1": ("name: a\n# Pr\u00fcfling\n".encode("latin-1"), "profile.yaml: not a text file; expected YAML"),
    "UTF-16": ("name: a\n".encode("utf-16"), "profile.yaml: not a text file; expected YAML in UTF-8"),
    "half a character": ('name: a\naccount: "\\ud800"\n', "profile.yaml: line 2, account: "),
    "NaN": ("name: a\nworkers: {poll_s: .nan}\n", "profile.yaml: line 2, workers.poll_s: nan; expected "),
    "infinity": ("name: a\nworkers: {poll_s: .inf}\n", "profile.yaml: line 2, workers.poll_s: inf; expected at most"),
    "no number of cores": ("name: a\nworkers: {cores: .nan}\n", "line 2, workers.cores: nan; expected a whole number"),
    "a number too long to print": (f"name: a\nworkers: {{cores: 0x{'f' * 5000}}}\n", "line 2, workers.cores"),
    "a walltime in seconds": ("name: a\nworkers: {walltime: 3600}\n", "line 2, workers.walltime: 3600; expected text"),
    "a walltime with an exponent": ("name: a\nworkers: {walltime: 1e3}\n", "line 2, workers.walltime: 1000.0; exp"),
    "memory in megabytes": ("name: a\nworkers: {memory: 4096}\n", "line 2, workers.memory: 4096; expected text"),
    "a study": ("name: check\ncohort: cohort\n", "profile.yaml: line 2, cohort: unknown key; expected one of name"),
    "a job script": ("#!/bin/bash\n#SBATCH --time=1:00\nsrun sinew\n", "profile.yaml: line 3: not a mapping; expected"),
    "a quarter of a megabyte of modules": ("name: a\nmodules: [" + "1," * 131_100 + "1]", "profile.yaml"),
}  # fmt: skip


@pytest.mark.parametrize(("text", "told"), TEXTS.values(), ids=TEXTS)
def test_profile_text(refused, text, told):
    write("profile.yaml", text)
    refused(SUBMIT, told, "; expected ")


FILES = {
    "ten gigabytes": ("profile.yaml", sparse, "profile.yaml: 10,240 MB; expected a profile file of at most 256 kB"),
    "a folder": ("profile.yaml", folder_for_file, "profile.yaml: is a folder; expected a profile file"),
    "a fifo": ("profile.yaml", fifo, "profile.yaml: neither file nor link; expected a profile file"),
    "a link to nothing": ("profile.yaml", lambda path: link(path, "gone"), "profile.yaml: is not there; expected"),
    "a link to itself": ("profile.yaml", lambda path: link(path, path), "profile.yaml: is not there; expected"),
    "a device": ("profile.yaml", lambda path: link(path, "/dev/zero"), "profile.yaml: neither file nor link; expected"),
    "missing": ("gone.yaml", None, "gone.yaml: is not there; expected a profile file"),
    "a pickle": ("profile.pkl", lambda path: write(path, b"\x80\x04."), "profile.pkl: pickled data are never read;"),
    "a PICKLE": ("profile.PICKLE", lambda path: write(path, "name: a"), "profile.PICKLE: pickled data are never read;"),
    "a long name": ("x" * 300, None, "xxx: is not there; expected a profile file"),
    "a line break in its name": ("a\nb.yaml", None, "a\\nb.yaml: is not there; expected a profile file"),
    "an escape in its name": ("\x1b[31m.yaml", None, "\\x1b[31m.yaml: is not there; expected a profile file"),
    "no name": ("", None, "expected a profile file"),
}  # fmt: skip


@pytest.mark.parametrize(("name", "make", "told"), FILES.values(), ids=FILES)
@pytest.mark.parametrize("command", ["submit", "run"])
def test_profile_file(refused, command, name, make, told):
    if make:
        make(name)
    refused((command, "study.yaml", "--profile", name, "--out", "out"), told)


# ---- the job script of a site


def _outside() -> str:
    write("../outside.j2", "#!/bin/sh\n{{ command }}\n")
    return "../outside.j2"


JOB_SCRIPTS = {
    "above": (_outside, "'../outside.j2' "),
    "absolute": (lambda: str(Path(_outside()).resolve()), ""),
    "far away": (lambda: "/etc/hostname", "'/etc/hostname' "),
    "a link out": (lambda: [_outside(), link("mine.j2", "../outside.j2"), "mine.j2"][2], "'mine.j2' "),
    "a linked folder": (lambda: [_outside(), link("sub", ".."), "sub/outside.j2"][2], "'sub/outside.j2' "),
    "a link to nothing": (lambda: [link("mine.j2", "gone"), "mine.j2"][1], "'mine.j2' "),
    "a link to itself": (lambda: [link("mine.j2", "mine.j2"), "mine.j2"][1], "'mine.j2' "),
    "a fifo": (lambda: [fifo("mine.j2"), "mine.j2"][1], "'mine.j2' "),
    "a device": (lambda: [link("mine.j2", "/dev/zero"), "mine.j2"][1], "'mine.j2' "),
    "a folder": (lambda: "cohort", "'cohort' "),
    "its own folder": (lambda: ".", "'.' "),
    "no name": (lambda: "", "'' "),
    "missing": (lambda: "gone.j2", "'gone.j2' "),
    "a long name": (lambda: "x" * 300, "'xxx"),
    "a NUL": (lambda: "a\0b", ""),
    "a line break": (lambda: "a\nb", "'a\\nb' "),
    "below a file": (lambda: "study.yaml/mine.j2", "'study.yaml/mine.j2' "),
    "a home": (lambda: "~/mine.j2", "'~/mine.j2' "),
}


@pytest.mark.parametrize(("make", "told"), JOB_SCRIPTS.values(), ids=JOB_SCRIPTS)
def test_job_script_file(refused, make, told):
    write_profile("job_script", make())
    refused(SUBMIT, "profile.yaml: ", f"job_script: {told}", "; expected ")


def test_job_script_says_its_line(refused):
    line = write_profile("job_script", "gone.j2")
    refused(SUBMIT, f"profile.yaml: line {line}, job_script: ")


TEMPLATES = {
    "syntax": ("{% if %}", "mine.j2: line 2: "),
    "never ended": ("{% for a in options %}", "mine.j2: line "),
    "an open brace": ("{{ command", "mine.j2: line "),
    "unknown filter": ("{{ command | shout }}", "mine.j2: line 2: "),
    "unknown tag": ("{% system 'id' %}", "mine.j2: line 2: "),
    "undefined": ("{{ nothing }}", "mine.j2: 'nothing' is undefined; expected a Jinja2 template"),
    "attribute of undefined": ("{{ name.nothing.more }}", "mine.j2: "),
    "the classes of a text": ("{{ ''.__class__.__mro__ }}", "mine.j2: "),
    "subclasses": ("{{ ''.__class__.__mro__[1].__subclasses__() }}", "mine.j2: "),
    "globals": ("{{ cycler.__init__.__globals__.os.system('touch out') }}", "mine.j2: "),
    "attr": ("{{ (''|attr('__class__'))|attr('__mro__') }}", "mine.j2: "),
    "format": ("{{ '{0.__class__.__mro__}'.format(name) }}", "mine.j2: "),
    "format_map": ("{{ '{a.__class__.__mro__}'.format_map({'a': name}) }}", "mine.j2: "),
    "self": ("{{ self.__init__.__globals__ }}", "mine.j2: "),
    "include": ("{% include '/etc/passwd' %}", "mine.j2: "),
    "import": ("{% import 'os' as os %}", "mine.j2: "),
    "extends": ("{% extends 'job.sh.j2' %}", "mine.j2: "),
    "division by zero": ("{{ 1 / 0 }}", "mine.j2: "),
    "a sum of text and number": ("{{ name + 1 }}", "mine.j2: "),
    "a call of a text": ("{{ name() }}", "mine.j2: "),
    "no number": ("{{ 1 + cores.nothing }}", "mine.j2: "),
    "a bad format": ("{{ '%d' % name }}", "mine.j2: "),
    "an index out of range": ("{{ options[99].x }}", "mine.j2: "),
    "too large a range": ("{{ range(10**9) | list }}", "mine.j2: "),
    "calls itself": ("{% macro a() %}{{ a() }}{% endmacro %}{{ a() }}", "mine.j2: "),
    "many brackets": ("{{ " + "(" * 5000 + "1" + ")" * 5000 + " }}", "mine.j2: "),
    "escape sequence": ("{{ nothing\x1b }}", "mine.j2: "),
    "binary": (b"\x7fELF\xff\xfe", "mine.j2: "),
    "Latin-1": ("# Pr\u00fcfling".encode("latin-1"), "mine.j2: "),
}


@pytest.mark.parametrize(("text", "told"), TEMPLATES.values(), ids=TEMPLATES)
def test_job_script_template(refused, text, told):
    write("mine.j2", text if isinstance(text, bytes) else f"#!/bin/sh\n{text}\n{{{{ command }}}}\n")
    write_profile("job_script", "mine.j2")
    refused(SUBMIT, told, "; expected ")


def test_huge_job_script(refused):
    sparse("mine.j2")
    os.truncate("mine.j2", 2**22)
    write_profile("job_script", "mine.j2")
    refused(SUBMIT, "mine.j2", "; expected ")


# ---- sinew submit

USAGES = [
    (("submit", "study.yaml"), "--profile: missing; expected the profile of a cluster"),
    (("submit",), "Missing argument 'STUDY'"),
    (("submit", "study.yaml", "--profile"), "'--profile' requires an argument"),
    ((*SUBMIT, "--fast"), "--fast"),
    ((*SUBMIT, "more"), "unexpected extra argument (more)"),
    ((*SUBMIT, "--seed", "-1"), "'--seed': -1 is not in the range"),
    ((*SUBMIT, "--simulator", "abaqus"), "'--simulator': 'abaqus' is not one of"),
    (("submit", "gone.yaml", *SUBMIT[2:]), "gone.yaml: is not there; expected a study file"),
    (("submit", "cohort", *SUBMIT[2:]), "cohort: is a folder; expected a study file"),
    (("submit", "profile.yaml", *SUBMIT[2:]), "profile.yaml: line 2, mode: unknown key; expected one of name, cohort"),
    (("submit", "study.yaml", "--profile", "study.yaml"), "study.yaml: line 2, cohort: unknown key; expected one of"),
    ((*SUBMIT, "--data", "gone"), "gone: is not there; expected a cohort folder"),
    ((*SUBMIT[:4], "--out", "study.yaml"), "--out study.yaml: study.yaml is a file; expected a folder"),
    ((*SUBMIT[:4], "--out", "study.yaml/out"), "study.yaml is a file; expected a folder"),
    ((*SUBMIT[:4], "--out", "cohort/out"), "--out cohort/out: lies inside the cohort cohort; expected a folder beside"),
    ((*SUBMIT[:4], "--out", "cohort"), "--out cohort: lies inside the cohort cohort; expected a folder beside"),
    ((*SUBMIT[:4], "--out", "my out"), "--out my out: SLURM's scripts cannot hold this path; expected letters"),
    ((*SUBMIT[:4], "--out", "o'ut"), "--out o'ut: SLURM's scripts cannot hold this path; expected letters"),
    ((*SUBMIT[:4], "--out", 'o"ut'), '--out o"ut: SLURM\'s scripts cannot hold this path; expected letters'),
    ((*SUBMIT[:4], "--out", "o\nut"), "--out o\\nut: SLURM's scripts cannot hold this path; expected letters"),
    ((*SUBMIT[:4], "--out", "out\n"), "--out out\\n: SLURM's scripts cannot hold this path; expected letters"),
    ((*SUBMIT[:4], "--out", "out%j"), "--out out%j: SLURM's scripts cannot hold this path; expected letters"),
    ((*SUBMIT[:4], "--out", "out;id"), "--out out;id: SLURM's scripts cannot hold this path; expected letters"),
    ((*SUBMIT[:4], "--out", "$(id)"), "--out $(id): SLURM's scripts cannot hold this path; expected letters"),
    ((*SUBMIT[:4], "--out", "o\\ut"), "--out o\\ut: SLURM's scripts cannot hold this path; expected letters"),
    ((*SUBMIT[:4], "--out", "érgebnis"), "SLURM's scripts cannot hold this path; expected letters"),
    ((*SUBMIT[:4], "--out", "x" * 300), "xxx"),
]  # fmt: skip


@pytest.mark.parametrize(("arguments", "told"), USAGES, ids=[" ".join(case[0])[:60] for case in USAGES])
def test_usage(refused, arguments, told):
    refused(arguments, told)


@pytest.mark.parametrize(
    "cluster", [{"name": "local", "workers": 1}, "slurm", {"name": "address", "address": "tls://a:1"}]
)
def test_the_profile_comes_before_the_cluster_of_a_study(accepted, cluster):
    write_study("cluster", cluster)
    assert accepted(*SUBMIT).startswith("job 123 leads")


@pytest.mark.parametrize("command", ["run", "sobol"])
@pytest.mark.parametrize("cluster", ["slurm", {"name": "slurm"}])
def test_slurm_without_a_profile(refused, command, cluster):
    write_study("cluster", cluster)
    told = "study.yaml: cluster: slurm without a profile; expected `sinew submit STUDY --profile PROFILE.yaml`"
    refused((command, "study.yaml", "--out", "out"), told)


def test_a_study_says_nothing_to_slurm(refused):
    write_study("cluster", {"name": "slurm", "partition": "cpu"})
    refused(SUBMIT, "study.yaml: line ", "cluster.partition: unknown key; expected one of name")


@pytest.mark.parametrize("field", ["", "modules", "prologue", "directives"])
def test_a_solver_that_only_the_node_has(sinew, refused, field):
    write_study("simulator", FEBIO | {"executable": "no-solver", "template": None})
    profile = {"name": "a"} | ({field: SITE[field]} if field else {})
    write("profile.yaml", as_yaml(profile))
    if field in ("modules", "prologue"):
        assert sinew(*SUBMIT).code == 0
    else:
        refused(SUBMIT, "study.yaml: simulator.executable: 'no-solver' was not found; expected febio4 on the PATH")


@pytest.mark.parametrize("executable", ["no-solver", "/bin/true"])
def test_a_template_is_not_brought_by_a_module(refused, executable):
    write_study("simulator", FEBIO | {"executable": executable, "template": "gone.feb.j2"})
    refused(SUBMIT, "gone.feb.j2: is not there; expected")


@pytest.mark.parametrize("command", ["sbatch", "squeue"])
def test_slurm_is_not_here(refused, monkeypatch, command):
    """A study that was submitted before is looked up by squeue first."""
    if command == "squeue":
        write("out/jobs/jobs.jsonl", '{"time": 1, "job": "5", "event": "submitted"}\n')
    monkeypatch.setenv("PATH", "/nowhere")
    write_study("name", "other")  # nothing of the study has to do with it
    told = f"{command} was not found; run this on a login node, where SLURM is"
    if command == "squeue":
        refused(SUBMIT, told)
    else:
        refused(SUBMIT, told, asked=True)


@pytest.mark.parametrize(
    ("make", "told"),
    [
        (lambda path: path.chmod(0o644), "sbatch cannot be run (Permission denied)"),
        (lambda path: path.write_bytes(b"\x7fELF"), "sbatch cannot be run (Exec format error)"),
        (lambda path: path.write_text("#!/nowhere\n"), "sbatch "),
        (lambda path: path.with_name("sbatch-says").write_text("exec /bin/sleep 60"), "sbatch gave no answer within"),
    ],
    ids=["not executable", "no program", "no interpreter", "hangs"],
)  # fmt: skip
def test_sbatch_that_is_broken(refused, monkeypatch, make, told):
    monkeypatch.setattr(slurm, "COMMAND_TIMEOUT_S", 0.3)
    make(Path("../bin/sbatch"))
    refused(SUBMIT, told, asked=True)


REFUSALS = {
    "Batch job submission failed: Invalid partition name specified": "partition",
    "Batch job submission failed: Requested partition configuration not available now": "partition",
    "Batch job submission failed: User's group not permitted to use this partition": "partition",
    "Batch job submission failed: Invalid account or account/partition combination specified": "account",
    "AssocMaxSubmitJobLimit\nsbatch: error: Batch job submission failed: Job violates accounting/QOS policy "
    "(job submit limit, user's size and/or time limits)": "account",
    "QOSMaxSubmitJobPerUserLimit\nsbatch: error: Batch job submission failed: Job violates accounting/QOS policy "
    "(job submit limit, user's size and/or time limits)": "qos",
    "Batch job submission failed: Invalid qos specification": "qos",
    "Batch job submission failed: Invalid feature specification": "constraint",
    "Batch job submission failed: Requested reservation is invalid": "directives",
    "Memory specification can not be satisfied": "workers.memory",
    "Batch job submission failed: Requested time limit is invalid (missing or exceeds some limit)": "workers.walltime",
    "CPU count per node can not be satisfied": "workers.cores",
    "Batch job submission failed: More processors requested than permitted": "workers.cores",
    "Batch job submission failed: Requested node configuration is not available": "workers.cores",
    "something that nobody has seen before": "workers",
    "": "workers",
    "\x1b[31mInvalid partition\x07\r\x1b[2J": "partition",
    "a\n" * 500 + "Invalid qos specification": "qos",
}


@pytest.mark.parametrize(("words", "field"), REFUSALS.items(), ids=_id)
def test_slurm_refuses(refused, words, field):
    write("../bin/words", f"sbatch: error: {words}\n" if words else "")
    answer("sbatch", "/bin/cat ../bin/words >&2; exit 1")
    said = refused(SUBMIT, f"profile.yaml: {field}: SLURM refuses the job (", "nothing was submitted", asked=True)
    assert len(said) < 1000


def test_slurm_refuses_the_memory_without_saying_so(refused):
    said = "case $* in *--mem=1*) exit 0;; esac; echo 'Requested node configuration is not available' >&2; exit 1"
    answer("sbatch", said)
    refused(SUBMIT, "profile.yaml: workers.memory: SLURM refuses the job (", asked=True)


def test_slurm_refuses_for_a_policy_that_it_does_not_name(refused):
    """SLURM's words for every limit of an account; they only happen to hold the words time limit."""
    words = "Job violates accounting/QOS policy (job submit limit, user's size and/or time limits)"
    answer("sbatch", f'echo "sbatch: error: Batch job submission failed: {words}" >&2; exit 1')
    assert "workers.walltime" not in refused(SUBMIT, "SLURM refuses the job (", asked=True)


@pytest.mark.parametrize(
    "words",
    [
        "Unable to contact slurm controller (connect failure)",
        "Batch job submission failed: Socket timed out on send/recv operation",
        "Zero Bytes were transmitted or received: communication failure",
        "connect: Connection refused",
    ],
)
def test_the_controller_does_not_answer(refused, words):
    answer("sbatch", f"echo 'sbatch: error: {words}' >&2; exit 1")
    refused(SUBMIT, "SLURM's controller does not answer (", "try again when it is back", asked=True)


def test_a_refusal_leaves_nothing_behind(refused):
    answer("sbatch", "echo 'sbatch: error: Invalid qos specification' >&2; exit 1")
    refused(SUBMIT, "profile.yaml: qos: ", asked=True)
    assert not Path("out").exists()


@pytest.mark.parametrize("answered", ["", "Submitted batch job 123", "12x", "\x1b[31m", "-1"])
def test_an_answer_without_a_number(sinew, answered):
    """sbatch took the job, so nobody may be told that nothing was submitted."""
    write("../bin/words", answered)
    answer("sbatch", "case $* in *--parsable*) /bin/cat ../bin/words;; esac")
    said = sinew(*SUBMIT)
    assert said.code == 2
    assert said.err.count("\n") == 1
    assert "nothing was submitted" not in said.err


def test_the_number_of_a_job_in_a_federation(accepted):
    answer("sbatch", "echo '123;north'")
    assert accepted(*SUBMIT).startswith("job 123 leads")


# ---- sinew status and sinew cancel


def make_results() -> None:
    """A result folder without any table, which a job leads."""
    with Store.writing(Path("out"), "check"):
        pass
    write("out/jobs/jobs.jsonl", "".join(JOB_LINES))


JOB_LINES = (
    '{"time": 1000.5, "job": "5", "event": "submitted", "role": "coordinator", "name": "sinew-check", "cores": 1}\n',
    '{"time": 2000.5, "job": "5", "event": "started", "role": "coordinator", "nodes": "n1"}\n',
)
PROGRESS = {
    "title": "s01",
    "done": 3,
    "total": 9,
    "failed": 1,
    "running": 2,
    "rows_per_s": 1.5,
    "eta_s": 4.0,
    "time": 1e9,
}
ALIVE = PROGRESS | {"time": 1e11}


def strict_json(text: str) -> Any:
    def not_json(name: str) -> None:
        raise AssertionError(f"{name} is no JSON")

    return json.loads(text, parse_constant=not_json)


@pytest.mark.parametrize("command", ["status", "cancel"])
@pytest.mark.parametrize("name", ["nowhere", "study.yaml", "cohort", "no\nwhere", "x" * 300, "empty"])
def test_no_result_folder(refused, command, name):
    folder_for_file("empty")
    refused((command, name), "")


def test_cancel_where_no_jobs_are(sinew):
    """Results of a run on this machine."""
    with Store.writing(Path("out"), "check"):
        pass
    sinew("cancel", "out")
    assert calls() == []
    assert "nothing runs" in sinew("status", "out").out


def test_status_of_a_study_that_waits_in_the_queue(accepted):
    assert "follow it by `sinew status out`" in accepted(*SUBMIT)
    assert "waiting" in accepted("status", "out")
    assert strict_json(accepted("status", "out", "--json"))["jobs"][0]["job"] == "123"


DAMAGE = {
    "nothing": b"",
    "empty lines": b"\n\n\n",
    "garbage": b"garbage\n",
    "binary": bytes(range(256)) * 4,
    "UTF-16": JOB_LINES[0].encode("utf-16"),
    "a cut line": JOB_LINES[0][:40].encode(),
    "a cut line and more": JOB_LINES[0][:40].encode() + JOB_LINES[0].encode(),
    "null": b"null\n",
    "a number": b"5\n",
    "a text": b'"job"\n',
    "a list": b"[1, 2]\n",
    "no fields": b"{}\n",
    "deep": b"[" * 100_000 + b"\n",
    "deep in a field": b'{"time": 1, "event": "ended", "job": ' + b"[" * 100_000 + b"\n",
    "a long line": b'{"time": 1, "job": "' + b"9" * 10**6 + b'", "event": "submitted"}\n',
}
FACT = {"time": 3.0, "job": "7", "event": "started", "role": "worker", "nodes": "n2", "cores": 2, "end": "done"}
ODD = [
    "null",
    "true",
    "[]",
    "{}",
    '""',
    '"x"',
    "-1",
    "0",
    "NaN",
    "Infinity",
    "-Infinity",
    "1e308",
    "1e999",
    f"1{'0' * 400}",
]
ODD += [
    f"-1{'0' * 400}",
    f"1{'0' * 5000}",
    '"\\u001b[31m\\u0007"',
    '"a\\nb"',
    '"\\ud800"',
    '"[red]x[/red]"',
    '"[/]"',
    '"\\u202e"',
]


def with_fact(facts: dict[str, Any], field: str, value: str) -> bytes:
    """A line of JSON with the text ``value`` for a field."""
    cells = (f'"{name}": {value if name == field else json.dumps(fact)}' for name, fact in facts.items())
    return f"{{{', '.join(cells)}}}\n".encode()


TABLES = {
    **{name: [damage] for name, damage in DAMAGE.items()},
    **{field: [with_fact(FACT, field, value) for value in ODD] for field in FACT},
}


@pytest.mark.parametrize("damages", TABLES.values(), ids=TABLES)
def test_damaged_table_of_jobs(sinew, damages):
    make_results()
    answer("squeue", f"echo '{QUEUE}'")
    problems: dict[Any, str] = {}
    for damage in damages:
        write("out/jobs/jobs.jsonl", b"".join([JOB_LINES[0].encode(), damage, b"\n", JOB_LINES[1].encode()]))
        with collected_from(problems, damage):
            said = sinew("status", "out")
            assert (said.code, said.err) == (0, "")
            assert "coordinator" in said.out
            found = strict_json(sinew("status", "out", "--json").out)
            assert [job["state"] for job in found["jobs"] if job["job"] == "5"] == ["running"]
            assert all(job["core_hours"] >= 0 for job in found["jobs"])
    assert problems == {}
    assert calls() == []


@pytest.mark.parametrize("damages", TABLES.values(), ids=TABLES)
def test_cancel_with_a_damaged_table_of_jobs(sinew, here, damages):
    write("out/jobs/jobs.jsonl", b"".join([JOB_LINES[0].encode(), *damages, b"\n", JOB_LINES[1].encode()]))
    answer("squeue", f"echo '{QUEUE}'")
    before = listing(here)
    said = sinew("cancel", "out")
    assert (said.code, said.err) == (0, "")
    assert said.out.startswith("job 5 (sinew-check, RUNNING) is cancelled\n1 jobs cancelled; ")
    assert calls()[-1] == "scancel --quiet 5"
    assert listing(here) == before


@contextmanager
def collected_from(problems: dict[Any, str], damage: bytes) -> Iterator[None]:
    try:
        yield
    except Exception as error:
        problems[damage[:150].decode(errors="replace")] = f"{type(error).__name__}: {error}"[:200]


def test_a_number_that_belongs_to_another_job_now(accepted):
    make_results()
    answer("squeue", "echo '5|RUNNING|None|n1|a colleague'; echo '6|RUNNING|None|n1|sinew-check'")
    assert accepted("cancel", "out").startswith("0 jobs cancelled")
    assert len(calls()) == 1


@pytest.mark.parametrize(
    "answered", ["garbage", "||||", "5", "5|RUNNING", "", "\x1b[31m", "5|GONE|None|n1|sinew-check"]
)
def test_squeue_that_talks_nonsense(accepted, answered):
    make_results()
    write("../bin/words", answered)
    answer("squeue", "/bin/cat ../bin/words")
    assert accepted("cancel", "out").startswith("0 jobs cancelled")


@pytest.mark.parametrize(
    ("command", "said", "told"),
    [
        ("squeue", "echo 'slurm_load_jobs error: Unable to contact slurm controller' >&2; exit 1", "does not answer"),
        ("squeue", "echo 'squeue: error: odd' >&2; exit 1", "odd"),
        ("scancel", "echo 'scancel: error: Kill job error on job id 5: Access denied' >&2; exit 1", "Access denied"),
    ],
)
def test_cancel_that_slurm_refuses(sinew, command, said, told):
    make_results()
    answer("squeue", f"echo '{QUEUE}'")
    answer(command, said)
    result = sinew("cancel", "out")
    assert (result.code, result.out, result.err.count("\n")) == (2, "", 1)
    assert told in result.err
    assert "submit" not in result.err
    assert "SLURM refuses the job:" not in result.err, "no job was refused"


@pytest.mark.parametrize("kind", ["a folder", "a link to itself"])
def test_table_of_jobs_that_is_no_file(refused, kind):
    make_results()
    folder_for_file("out/jobs/jobs.jsonl") if kind == "a folder" else link("out/jobs/jobs.jsonl", "jobs.jsonl")
    refused(("cancel", "out"), "out/jobs/jobs.jsonl: ")
    refused(("status", "out"), "out/jobs/jobs.jsonl: ")


PROGRESSES = {
    **{name: [damage] for name, damage in DAMAGE.items()},
    "a field missing": [
        json.dumps({name: fact for name, fact in PROGRESS.items() if name != field}).encode() for field in PROGRESS
    ],
    **{field: [with_fact(PROGRESS, field, value) for value in ODD] for field in PROGRESS},
    **{f"{field}, alive": [with_fact(ALIVE, field, value) for value in ODD] for field in PROGRESS},
}


@pytest.mark.parametrize("contents", PROGRESSES.values(), ids=PROGRESSES)
def test_damaged_progress(sinew, contents):
    make_results()
    problems: dict[Any, str] = {}
    for content in contents:
        write("out/progress.json", content)
        with collected_from(problems, content):
            said = sinew("status", "out")
            assert (said.code, said.err) == (0, "")
            assert "finished: nothing yet" in said.out
            assert strict_json(sinew("status", "out", "--json").out)["study"] == "check"
    assert problems == {}


# ---- properties

quick = settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.too_slow])


def seconds_by_slurm(text: str) -> float | None:
    """What ``man sbatch`` says of --time; None for what it does not name."""
    if found := re.fullmatch("([0-9]+)-([0-9]+)(?::([0-9]+))?(?::([0-9]+))?", text):
        days, hours, minutes, seconds = (int(part or 0) for part in found.groups())
    elif found := re.fullmatch("([0-9]+):([0-9]+):([0-9]+)", text):
        days, (hours, minutes, seconds) = 0, map(int, found.groups())
    elif found := re.fullmatch("([0-9]+)(?::([0-9]+))?", text):
        days, hours, (minutes, seconds) = 0, 0, (int(part or 0) for part in found.groups())
    else:
        return None
    return float(((days * 24 + hours) * 60 + minutes) * 60 + seconds)


def read_workers(field: str, text: str) -> Any:
    content = as_yaml({"name": "a", "workers": {field: text}})
    profile = read_or_refuse(read_profile, "profile.yaml", files={"profile.yaml": content})
    return profile and profile.workers


@quick
@given(
    st.text()
    | st.from_regex(r"\A(\d{1,3}-)?\d{1,3}(:\d{1,2}){0,2}\Z")
    | st.from_regex(r"\A([0-9]-)?[0-9]{1,2}(:[0-5][0-9]){1,2}\Z")
)
@example("1-02:30")
@example("90:00")
@example("366-00:00:00")
def test_any_text_as_walltime(text):
    workers = read_workers("walltime", text)
    if workers is not None:
        assert workers.walltime_s == seconds_by_slurm(text)
        assert 60 <= workers.walltime_s <= 366 * 86_400
        assert seconds_by_slurm(slurm_time(workers.walltime_s)) == workers.walltime_s


@quick
@given(st.text() | st.from_regex(r"\A\d{1,12}[KMGTPkmgt]?\Z") | st.from_regex(r"\A[0-9]{1,5}[MGT]\Z"))
def test_any_text_as_memory(text):
    workers = read_workers("memory", text)
    if workers is not None:
        found = re.fullmatch("([0-9]+)([MGT])", text.upper())
        assert found is not None
        assert workers.memory_mb == int(found[1]) * 1024 ** "MGT".index(found[2])
        assert workers.memory_mb >= 256


SCRIBBLES = st.text(st.sampled_from("ab1  $$`'\"\\;&|<>()[]{}*?!#%,=:@/.-+~\n\té\u2028"), max_size=7)
PLACES: dict[str, st.SearchStrategy[str]] = {
    **dict.fromkeys((*OPTIONS, "name", "interface", "modules.0"), SCRIBBLES),
    "scratch": st.builds("{}{}".format, st.sampled_from(["/", "$", "/tmp/", "$TMPDIR", "${"]), SCRIBBLES),
    "directives.0": st.builds("{}{}".format, st.sampled_from(["--comment=", "--x", "--mail-user="]), SCRIBBLES),
}


@st.composite
def scribbled_profiles(draw: st.DrawFn) -> dict[str, Any]:
    profile = json.loads(json.dumps(SITE))
    profile["mode"] = draw(st.sampled_from(["jobs", "allocation"]))
    for place in draw(st.lists(st.sampled_from(list(PLACES)), min_size=1, max_size=2, unique=True)):
        first, _, second = place.partition(".")
        value = draw(PLACES[place])
        if second:
            profile[first][0 if second == "0" else second] = value
        else:
            profile[first] = value
    return profile


def with_value(field: str, value: Any) -> dict[str, Any]:
    return json.loads(json.dumps(SITE)) | {field: value}


@settings(quick, max_examples=200)
@given(scribbled_profiles())
@example(SITE)
@example(with_value("modules", ["a&b"]))
@example(with_value("scratch", "${"))
@example(with_value("directives", ["--comment=a b"]))
@example(with_value("directives", ['--comment="']))
def test_job_scripts_hold_what_the_profile_says_and_nothing_else(content):
    profile = read_or_refuse(read_profile, "profile.yaml", files={"profile.yaml": as_yaml(content)})
    if profile is None:
        return
    scripts = job_scripts(study_at(Path("/data/it's/study.yaml")), profile, Path("/data/out"), [])
    assert_script_is_whole(scripts.leader, profile, profile.leader, own=8)
    if profile.mode == "jobs":
        assert_script_is_whole(scripts.worker, profile, profile.workers, own=7)
    else:
        assert scripts.worker is None


def assert_script_is_whole(script: str, profile: Profile, size: Any, own: int) -> None:
    assert_shell_accepts(script)
    options = profile.options(size)
    directives = [line.removeprefix("#SBATCH ") for line in header_of(script)]
    assert len(directives) == own + len(options)
    assert tuple(directives[own:]) == options
    assert [len(shlex.split(option, comments=True)) for option in options] == [1] * len(options), options
    assert_modules_are_words(script, list(profile.modules))


def header_of(script: str) -> Iterator[str]:
    """The lines that sbatch obeys: those before the first command."""
    for line in script.split("\n"):
        if line and not line.startswith("#"):
            return
        if line.startswith("#SBATCH"):
            yield line


def test_bad_input_is_what_a_profile_raises(here):
    write_profile("mode", "x")
    with pytest.raises(BadInput):
        read_profile(Path("profile.yaml"))
