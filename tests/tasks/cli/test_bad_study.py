"""Every mistake in a study file, or in a template that it names, is one line that says what was expected."""

import json
from pathlib import Path
from typing import Any

import pytest

from sinew.tasks.model import TENDON
from tests.tasks.cli.bad_input import (
    BOMB,
    FEBIO,
    MISSING,
    RUN,
    STUDY,
    fifo,
    folder_for_file,
    link,
    sparse,
    write,
    write_study,
)
from tests.trusting import trusted


def _fixed(count: int) -> dict[str, Any]:
    return {parameter.name: {"fixed": parameter.maximum * 0.9} for parameter in TENDON[:count]}


FIELDS = [  # the field that is set, its value, what the line says of this field or (without a colon in front) in all
    ("shape", 1, ": unknown key; expected one of name, cohort"),
    ("model.shape", 1, ": unknown key; expected one of parameters, beta"),
    ("model.parameters.E_f.mni", 1, ": unknown key; expected one of min, max"),
    ("simulator.shape", 1, ": unknown key; expected one of name"),
    ("simulator.timeout_s", 9.0, ": unknown key; expected one of name"),
    ("simulator", {"name": "febio", "time_steps": {"ramp": 1}}, "simulator.time_steps.ramp: unknown key"),
    ("cluster.shape", 1, ": unknown key; expected one of name, workers"),
    ("store.shape", 1, ": unknown key; expected one of points_per_curve"),
    ("sobol.shape", 1, ": unknown key; expected one of method, error, runs, first, points"),
    ("importance.shape", 1, ": unknown key; expected one of trees, repeats"),
    ("name", MISSING, ": missing; expected a value"),
    ("name", "../evil", ": '../evil'; expected letters, digits"),
    ("name", "a/b", ": 'a/b'; expected letters, digits"),
    ("name", "", ": ''; expected letters, digits"),
    ("name", 7, ": 7; expected text"),
    ("name", "x" * 65, "; expected letters, digits"),
    ("cohort", MISSING, "study.yaml: cohort: missing; expected a cohort folder"),
    ("cohort", 5, ": 5; expected text"),
    ("cohort", "nowhere", "nowhere: is not there; expected a cohort folder"),
    ("cohort", "x" * 300, "xxx"),
    ("seed", -1, ": -1; expected at least 0"),
    ("seed", 2**32, ": 4294967296; expected below 4294967296"),
    ("seed", 1.5, ": 1.5; expected a whole number"),
    ("seed", "7", ": '7'; expected a whole number"),
    ("seed", True, ": True; expected a whole number"),
    ("seed", float("nan"), ": nan; expected a whole number"),
    ("retries", -1, ": -1; expected at least 0"),
    ("model", [], ": []; expected a mapping"),
    ("model.beta", 1.5, ": 1.5; expected at least 2"),
    ("model.lambda_0", 1, ": 1; expected above 1"),
    ("model.parameters", [], ": []; expected a mapping"),
    ("model.parameters", _fixed(16), ": every parameter is fixed; expected at least one"),
    ("model.parameters", _fixed(15), ": one free parameter; expected at least two"),
    ("model.parameters.E_g", {"fixed": 1}, ": unknown parameter; expected one of E_f"),
    ("model.parameters.E_f", 200, ": 200; expected a mapping"),
    ("model.parameters.E_f.unit", "GPa", ": 'GPa'; expected 'MPa'"),
    ("model.parameters.E_f.min", 275, "model.parameters.E_f.max: 275 is not above min 275; expected min below max"),
    ("model.parameters.E_f.min", 300, "model.parameters.E_f.max: 275 is not above min 300; expected min below max"),
    ("model.parameters.E_f.min", -1, ": -1; expected at least 0 MPa"),
    ("model.parameters.E_f.min", True, ": True; expected a number"),
    ("model.parameters.E_f.min", "160", ": '160'; expected a number"),
    ("model.parameters.E_f.min", float("nan"), ": nan; expected a finite number"),
    ("model.parameters.E_f.max", float("inf"), ": inf; expected a finite number"),
    ("model.parameters.E_f.reference", 300, ": 300; expected a value from 160 to 275"),
    ("model.parameters.E_f.fixed", 200, ": given beside min, max or reference; expected either fixed"),
    ("model.parameters.tau_1f", {"fixed": 0}, "model.parameters.tau_1f.fixed: 0; expected above 0 s"),
    ("model.parameters.nu_m", {"fixed": 0.5}, "nu_m.fixed: 0.5; expected above -1 and below 0.5"),
    ("infer", {"widening": 1e300}, "infer.widening: 1e+300; expected at most 100"),
    ("predict", {"probability": 0.99999}, "predict.probability: 0.99999; expected at most 0.9998"),
    (
        "compare",
        {"permutations": 100_000, "repeats": 1000, "folds": 100},
        "folds x (repeats + permutations) is 10,100,000; expected at most 100,000",
    ),
    ("simulator", "abaqus", "abaqus'}; expected one of 'uniaxial', 'febio'"),
    ("simulator", None, ": None; expected a name or settings"),
    ("simulator", {"timeout_s": 5.0}, "simulator.name: missing; expected which kind"),
    (
        "simulator",
        FEBIO | {"time_steps": {"ramp_s": 1e9}},
        "simulator.time_steps.ramp_s: 1000000000.0; expected at most",
    ),
    ("simulator", FEBIO | {"time_steps": {"still_mm": 2}}, "simulator.time_steps.still_mm: 2; expected at most 1"),
    ("simulator", FEBIO | {"timeout_s": 0}, "simulator.timeout_s: 0; expected above 0"),
    ("simulator", FEBIO | {"timeout_s": -5.0}, "simulator.timeout_s: -5.0; expected above 0"),
    ("simulator", FEBIO | {"timeout_s": float("inf")}, "simulator.timeout_s: inf; expected "),
    ("simulator", FEBIO | {"timeout_s": float("nan")}, "simulator.timeout_s: nan; expected "),
    ("simulator", FEBIO | {"restart_s": 0.5}, "simulator.restart_s: 0.5; expected at least 1"),
    ("simulator", FEBIO | {"timeout_s": "600"}, "simulator.timeout_s: '600'; expected a number"),
    ("simulator", FEBIO | {"max_file_mb": 0}, "simulator.max_file_mb: 0; expected above 0"),
    ("simulator", FEBIO | {"time_steps": {"ramp_s": -1}}, "simulator.time_steps.ramp_s: -1; expected at least 0"),
    (
        "simulator",
        {"name": "febio", "executable": "no-solver"},
        "simulator.executable: 'no-solver' was not found; expected feb",
    ),
    ("simulator", FEBIO | {"executable": ""}, "simulator.executable: ''; expected "),
    ("simulator", FEBIO | {"executable": "-rf"}, "simulator.executable: '-rf'; expected "),
    ("cluster", "cloud", "cloud'}; expected one of 'local', 'address'"),
    ("cluster.workers", 0, ": 0; expected at least 1"),
    ("cluster.tls", "yes", ": 'yes'; expected true or false"),
    ("cluster", {"name": "address", "address": "http://a:1"}, "cluster.address: 'http://a:1'; expected "),
    ("store.points_per_curve", 1, ": 1; expected 'all' or a whole number"),
    ("tasks", ["weather"], "tasks.0: 'weather'; expected one of 'sobol'"),
    ("tasks", "sobol", ": 'sobol'; expected a list"),
    ("tasks", [], ": []; expected at least one"),
    ("tasks", ["sobol", "sobol"], ": sobol is a duplicate; expected each task once"),
    ("tasks", ["importance", "sobol"], ": importance before sobol, whose results it uses; expected sobol first"),
    ("model", {"effects": ["magic"]}, "model.effects: no effect 'magic'; expected one of area-error"),
    ("model", {"effects": ["law/bone/strain:1/power"]}, "model.effects: 'law/bone/strain:1/power'; expected a law"),
    ("model", {"effects": ["law/fibres/strain:1/power", "law/fibres/strain:1/threshold"]}, "is a duplicate"),
    (
        "model",
        {"effects": [f"law/fibres/{x}:1/power" for x in ("strain", "path", "time")]},
        "3 laws; expected at most 2",
    ),
    ("sobol.points", 100, ": given beside base_samples; expected one of the two"),
    ("sobol", {"points": 0}, "sobol.points: 0; expected at least 1"),
    ("sobol.base_samples", 3, ": 3; expected a power of two"),
    ("sobol.resamples", 1, ": 1; expected at least 10"),
    ("sobol.confidence", 1, ": 1; expected below 1"),
    ("sobol.second_order", 1, ": 1; expected true or false"),
    ("sobol.specimens", ["nobody"], ": no specimen 'nobody' in cohort; expected one of s01, s02"),
    ("sobol.specimens", ["s01", "s01"], ": 's01' is a duplicate; expected each specimen once"),
    ("sobol.specimens", [1], "; expected 'all' or a list of"),
    ("sobol.specimens", "s01", ": 's01'; expected 'all' or a list of"),
    ("sobol.specimens", [], ": []; expected 'all' or a list of"),
]


@pytest.mark.parametrize(("field", "value", "told"), FIELDS, ids=[f"{case[0]}-{case[2][:30]}" for case in FIELDS])
def test_study_field(refused, field, value, told):
    write_study(field, value)
    line = refused(RUN, f"{field}{told}" if told[0] == ":" else told, "; expected ")
    problem, _, known = line.rstrip().rpartition("unknown key; expected one of ")
    assert not problem or field.rpartition(".")[2] not in known.split(", ")


TEXTS = {
    "nothing": ("", "study.yaml: empty; expected a study"),
    "only a comment": ("# name: check\n", "study.yaml: empty; expected a study"),
    "a list": ("- name: check\n", "study.yaml: line 1: not a mapping; expected fields"),
    "one word": ("check\n", "study.yaml: line 1: not a mapping; expected fields"),
    "a bomb of aliases": (BOMB, "study.yaml: line 1: an anchor or alias; expected plain YAML"),
    "a merge key": ("name: check\n<<: {seed: 1}\n", "study.yaml: line 2: the key '<<'; expected a name as key"),
    "a deep nest": ("a: " + "[" * 5000, "study.yaml: line 1: nested deeper than 12 levels; expected"),
    "a key twice": ("name: a\nseed: 1\nname: b\n", "study.yaml: line 3, name: given twice; expected each key once"),
    "an inner key twice": (
        "sobol:\n  points: 1\n  points: 2\n",
        "line 3, sobol.points: given twice; expected each key",
    ),
    "a number as key": ("name: a\n1: b\n", "study.yaml: line 2: the key '1'; expected a name as key"),
    "an object": ("name: !!python/object:os.system {}\n", "study.yaml: line 1: "),
    "a call": ("name: !!python/object/apply:os.system [touch out]\n", "study.yaml: line 1: "),
    "a time that is none": ("name: a\nseed: !!timestamp abc\n", "study.yaml: line 2"),
    "a truth that is none": ("name: a\nseed: !!bool maybe\n", "study.yaml: line 2"),
    "a number that is none": ("name: a\nseed: !!int ''\n", "study.yaml: line 2"),
    "a number too long to print": (f"name: a\nseed: 0x{'f' * 5000}\n", "study.yaml: line 2, seed"),
    "two documents": ("name: a\n---\nname: b\n", "study.yaml: line 2: a second YAML document; expected one study"),
    "a tab": ("name: a\nsobol:\n\tpoints: 1\n", "study.yaml: line 3: not valid YAML"),
    "an open bracket": ("name: a\ntasks: [sobol\nseed: 1\n", "study.yaml: line 3: not valid YAML"),
    "a NUL": ("name: a\0b\n", "study.yaml: not valid YAML"),
    "binary": (b"\x7fELF\x02\x01\x00\xff\xfe", "study.yaml: not a text file; expected YAML in UTF-8"),
    "Latin-1": ("name: sehne\n# Prüfling\n".encode("latin-1"), "study.yaml: not a text file; expected YAML in UTF-8"),
    "UTF-16": ("name: check\n".encode("utf-16"), "study.yaml: not a text file; expected YAML in UTF-8"),
    "half a character": ('name: a\ncohort: "\\ud800"\n', r"\ud800"),
    "a quarter of a megabyte of numbers": ("name: a\nx: [" + "1," * 140_000 + "1]", "study.yaml"),
}


@pytest.mark.parametrize(("text", "told"), TEXTS.values(), ids=TEXTS)
def test_study_text(refused, text, told):
    write("study.yaml", text)
    refused(RUN, told, "; expected ")


STUDY_FILES = {
    "ten gigabytes": ("study.yaml", sparse, "study.yaml: 10,240 MB; expected a study file of at most"),
    "a folder": ("study.yaml", folder_for_file, "study.yaml: is a folder; expected a study file"),
    "a fifo": ("study.yaml", fifo, "study.yaml: neither file nor link; expected a study file"),
    "a link to nothing": ("study.yaml", lambda path: link(path, "gone"), "study.yaml: is not there; expected a study"),
    "a link to itself": ("study.yaml", lambda path: link(path, path), "study.yaml: is not there; expected a study"),
    "missing": ("other.yaml", lambda _: None, "other.yaml: is not there; expected a study file"),
    "a long name": (f"{'x' * 300}.yaml", lambda _: None, "xxx"),
    "a pickle": ("study.pkl", lambda path: write(path, b"\x80\x04."), "study.pkl: pickled data are never read"),
}  # fmt: skip


@pytest.mark.parametrize(("study", "make", "told"), STUDY_FILES.values(), ids=STUDY_FILES)
def test_study_file(refused, study, make, told):
    make(study)
    refused(("run", study, "--out", "out"), told)


TEMPLATES = {
    "above the study": ("../bar.feb.j2", "", "../bar.feb.j2: lies outside the study's folder; expected"),
    "somewhere else": ("/etc/hostname", "", "/etc/hostname: lies outside the study's folder; expected"),
    "missing": ("gone.feb.j2", "", "gone.feb.j2: is not there; expected"),
    "NUL in its name": ("b\0r", "", "simulator.template"),
    "half a character in its name": ("b\ud800r", "", "simulator.template"),
    "open block": ("bar.feb.j2", "<febio_spec>\n{% if %}", "bar.feb.j2: line 2: "),
    "25 loops": ("bar.feb.j2", "{% for i in [1] %}" * 25 + "{% endfor %}" * 25, "bar.feb.j2"),
    "unknown variable": ("bar.feb.j2", "<febio_spec>{{ modulus }}</febio_spec>", "bar.feb.j2: line 1: cannot be "),
    "unknown parameter": ("bar.feb.j2", "<febio_spec>{{ parameters.E | full }}", "bar.feb.j2: line 1: cannot be"),
    "endless macro": ("bar.feb.j2", "{% macro m() %}{{ m() }}{% endmacro %}{{ m() }}", "bar.feb.j2: line 1: cannot"),
    "too few to format": ("bar.feb.j2", "{{ '{} {}'.format(1) }}", "bar.feb.j2: line 1: cannot be rendered"),
    "escape from the sandbox": ("bar.feb.j2", "{{ ''.__class__.__mro__[1].__subclasses__() }}", "bar.feb.j2: line 1"),
    "no XML": ("bar.feb.j2", "force = 1", "bar.feb.j2: renders to no XML"),
    "no FEBio": ("bar.feb.j2", "<html></html>", "bar.feb.j2: renders to <html>; expected <febio_spec>"),
    "entity": ("bar.feb.j2", '<!DOCTYPE x [<!ENTITY a "b">]><febio_spec>&a;</febio_spec>', "bar.feb.j2: renders to no"),
    "half a character": ("bar.feb.j2", "<febio_spec>{{ '\\ud800' }}</febio_spec>", "bar.feb.j2: "),
    "file elsewhere": ("bar.feb.j2", '<febio_spec><a file="/etc/x"/></febio_spec>', 'bar.feb.j2: <a file="/etc/x">'),
    "binary": ("bar.feb.j2", b"\x7fELF\xff\xfe", "bar.feb.j2: not a text file; expected"),
}


@pytest.mark.parametrize(("name", "text", "told"), TEMPLATES.values(), ids=TEMPLATES)
def test_template(refused, name, text, told):
    if text:
        write(name, text)
    write("study.yaml", json.dumps(STUDY | {"simulator": FEBIO | {"template": name}}))
    refused(RUN, told, "; expected ")


@pytest.mark.parametrize(("target", "told"), [("/etc/hostname", "lies outside"), ("bar.feb.j2", "; expected ")])
def test_template_that_is_a_link(refused, target, told):
    link("bar.feb.j2", target)
    write_study("simulator", FEBIO)
    refused(RUN, "bar.feb.j2", told)


def test_solver_that_is_no_program(refused):
    write("solver", "no program")
    Path("solver").chmod(0o755)
    write_study("simulator", {"name": "febio", "executable": "./solver"})
    refused(
        RUN, "study.yaml: simulator.executable: './solver' would run on this machine; expected febio4, --solver, or"
    )
    trusted(Path("study.yaml"))
    refused(RUN, "solver: cannot be run (Exec format error); expected a solver program")
