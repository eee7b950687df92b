"""Files that are no profile, and job scripts of a site that are none: one line says where and what."""

import os
from pathlib import Path

import pytest

from sinew.tasks.simulate.febio.rendering import program
from tests.tasks.cli.bad_input import BOMB, fifo, folder_for_file, link, sparse, write
from tests.tasks.cluster.stand_in_slurm import SUBMIT, write_profile

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
    "no name": ("", None, "an empty path; expected a name"),
}  # fmt: skip


@pytest.mark.parametrize(("name", "make", "told"), FILES.values(), ids=FILES)
@pytest.mark.parametrize("command", ["submit", "run"])
def test_profile_file(refused, command, name, make, told):
    if make:
        make(name)
    refused((command, "study.yaml", "--profile", name, "--out", "out"), told)


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
    "include": ("{% include '/etc/passwd' %}", "mine.j2: includes '/etc/passwd'; expected "),
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


def test_a_job_script_without_the_command_is_refused(refused):
    write("mine.j2", "#!/bin/sh\necho {{ name }}\n")
    write_profile("job_script", "mine.j2")
    refused(SUBMIT, "mine.j2: makes a job script that does not run the study; expected {{ command }}")


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("{{ 'x' * 3 * 10**9 }}", "more than 1 GB"),
        ("{{ 'x' | center(3 * 10**9) }}", "more than 1 GB"),
        ("{{ '%3000000000d' | format(1) }}", "more than 1 GB|OverflowError|ValueError"),
        (
            "{% for a in range(99999) %}{% for b in range(99999) %}{% endfor %}{% endfor %}",
            "more than 1 s of a processor",
        ),
        ("{{ 10 ** (10 ** 9) }}", "more than 1 s of a processor"),
    ],
)
def test_a_job_script_is_bounded_in_time_and_memory(refused, monkeypatch, text, told):
    monkeypatch.setattr(program, "SECONDS", 1)
    write("mine.j2", text)
    write_profile("job_script", "mine.j2")
    message = refused(SUBMIT, "mine.j2: ", "; expected ")
    assert any(each in message for each in told.split("|"))


def test_huge_job_script(refused):
    sparse("mine.j2")
    os.truncate("mine.j2", 2**22)
    write_profile("job_script", "mine.j2")
    refused(SUBMIT, "mine.j2", "; expected ")
