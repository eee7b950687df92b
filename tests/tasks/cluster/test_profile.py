"""Profiles: each field, broken in many ways, is one line that says where, what, and what was expected."""

import json
import shlex
import sys
from pathlib import Path
from typing import Any

import pytest

from sinew.runner.cluster import slurm
from sinew.runner.cluster.job_table import JobTable
from sinew.tasks.cluster.profile import Profile, read_profile
from sinew.tasks.cluster.submission import job_scripts
from tests.tasks.cli.bad_input import write
from tests.tasks.cluster.stand_in_slurm import (
    OPTIONS,
    SHIPPED,
    SITE,
    SUBMIT,
    as_yaml,
    assert_modules_are_words,
    assert_shell_accepts,
    calls,
    collected,
    header_of,
    short_id,
    study_at,
    write_profile,
)


@pytest.mark.parametrize("profile", [SHIPPED / "site-template.yaml", SHIPPED / "generic.yaml", Path("profile.yaml")])
def test_what_is_broken_below_was_valid(accepted, profile):
    said = accepted(*SUBMIT[:3], str(profile), *SUBMIT[4:])
    assert said.startswith("job 123 leads 'check'")
    *asked, submitted = (call.split()[1] for call in calls())
    assert set(asked) == {"--test-only"}
    assert submitted == "--parsable"
    assert list(JobTable(Path("out/jobs")).read()) == ["123"]
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


WHOLE = ("coordinator.cores", "workers.cores", "workers.jobs", "workers.minimum", "allocation.tasks")
TIMES = ("coordinator.walltime", "workers.walltime", "allocation.walltime")
MEMORIES = ("coordinator.memory", "workers.memory", "allocation.memory")
SECTIONS = ("coordinator", "workers", "allocation")
WRONG_TYPES = [
    *((field, "text", (5, 1.5, True, [], {}, ["a"])) for field in (*OPTIONS, "interface", "scratch", "job_script")),
    *((field, "text", (5, 1.5, True, None, [], {})) for field in (*TIMES, *MEMORIES, "name", "batch_system")),
    *((f"{field}.0", "text", (5, None, False, [], {})) for field in ("directives", "modules", "prologue")),
    *((field, "a list", (5, "--x", None, {})) for field in ("directives", "modules", "prologue")),
    *((field, "a whole number", (1.5, "4", True, None, [], {}, 2.0)) for field in WHOLE),
    ("workers.poll_s", "a number", ("15", True, None, [], {})),
    ("tls", "true or false", (1, 0, "yes", "no", "true", None, [], {})),
    ("batch_system", "one of 'slurm' or 'grid_engine'", ("SLURM", "", "slurm ", "pbs")),
    ("mode", "one of 'jobs' or 'allocation'", ("Jobs", "", 1, None, [], {}, "jobs ")),
    *((field, "a mapping", (5, "small", None, [], True, [{"cores": 1}])) for field in SECTIONS),
]


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


@pytest.mark.parametrize("field", UNKNOWN, ids=short_id)
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
        assert f"#SBATCH -t {slurm.walltime(3600 * hours + 60 * minutes + seconds)}\n" in said.out
    else:
        assert text in said.err or "HH:MM:SS" in said.err, "a person cannot know from this what to write"


def test_every_field_is_broken_here():
    broken = {field.removesuffix(".0") for field, *_ in (*WRONG_TYPES, *LIMITS)}
    fields = {name for name in SITE if name not in SECTIONS} | {"job_script"}
    fields |= {f"{name}.{field}" for name in SECTIONS for field in SITE[name]}
    assert fields <= broken
    assert set(Profile.model_fields) == {field.partition(".")[0] for field in fields}


@pytest.mark.parametrize("name", ["gcc&id", "gcc|id", "gcc&&id", "(id)", "!id", "*", "[a-z]*", "gcc/13&"])
def test_a_module_is_one_word_of_the_shell(sinew, name):
    write_profile("modules.0", name)
    said = sinew(*SUBMIT, "--dry-run")
    if said.code == 0:
        assert_modules_are_words(said.out, [name, *SITE["modules"][1:]] * 2)
    else:
        assert "profile.yaml: line " in said.err
        assert "modules.0: " in said.err


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
    folder = Path("my lab's $(touch pwned) #SBATCH --array=1-9").absolute()
    write(str(folder / "profile.yaml"), as_yaml(SITE))
    profile = read_profile(folder / "profile.yaml")
    script = job_scripts(study_at(folder / "study.yaml"), profile, Path("out"), ["--data", str(folder)]).leader
    assert_shell_accepts(script)
    assert "--array" not in "".join(header_of(script))
    words = shlex.split(script[script.index(sys.executable) : script.index("\ncode=$?")])
    paths = [str(folder / "study.yaml"), "--profile", str(folder / "profile.yaml"), "--out", str(here / "out")]
    assert words == [sys.executable, "-P", "-m", "sinew", "run", *paths, "--data", str(folder)]
