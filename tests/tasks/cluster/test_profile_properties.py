"""Profiles of any text: read as SLURM reads them, or refused; job scripts hold what they say and nothing else."""

import json
import re
import shlex
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from sinew.runner.cluster import slurm
from sinew.runner.errors import BadInput
from sinew.tasks.cluster.profile import Profile, read_profile
from sinew.tasks.cluster.submission import job_scripts
from tests.tasks.cluster.stand_in_slurm import (
    OPTIONS,
    SITE,
    as_yaml,
    assert_modules_are_words,
    assert_shell_accepts,
    header_of,
    study_at,
    write_profile,
)
from tests.tasks.inputs import read_or_refuse

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
        assert seconds_by_slurm(slurm.walltime(workers.walltime_s)) == workers.walltime_s


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


def test_bad_input_is_what_a_profile_raises(here):
    write_profile("mode", "x")
    with pytest.raises(BadInput):
        read_profile(Path("profile.yaml"))
