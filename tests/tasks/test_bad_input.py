"""Bad input of every kind ends with exit code 2 and one line that says where, what, and what was expected.

Each table starts from a valid study, cohort, parameter file or export and breaks one thing. The command runs in this
process; it must refuse before anything is written or evaluated.
"""

import json
import os
import shutil
import sys
import time
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
import yaml

from tasks.bench_exports import read_export
from tasks.cli import main
from tasks.measurements import read_cohort
from tasks.model import TENDON, Model
from tasks.simulations import read_parameters
from tasks.study import read_study

STUDY: dict[str, Any] = {
    "name": "check",
    "cohort": "cohort",
    "seed": 7,
    "model": {"parameters": {"E_f": {"min": 160, "max": 275, "unit": "MPa"}, "nu_m": {"fixed": 0.3}}},
    "simulator": {"name": "uniaxial"},
    "cluster": {"name": "local", "workers": 1, "tls": False},
    "store": {"points_per_curve": 4},
    "retries": 0,
    "tasks": ["sobol"],
    "sobol": {"base_samples": 2, "specimens": ["s01"]},
    "importance": {"trees": 10},
}
GEOMETRY = {"length_mm": 10.0, "width_mm": 8.0, "thickness_mm": 4.0}
HEADER = "time_s,displacement_mm,force_N"
ROWS = ("0,0,0", "1,0.1,5", "2,0.2,9", "3,0.2,8")
PARAMETERS = "E_f,tau_1f,nu_m\n200,1,0.3\n210,1,0.3\n"
EXPORT = """Results Table 1
Specimen properties : Length,"10.0",mm
Specimen properties : Width,"8.0",mm
Specimen properties : Thickness,"4.0",mm

Time,Extension,Load
(s),(mm),(N)
"0.0","0.0","0.0"
"1.0","0.1","5.0"
"2.0","0.2","9.0"
"""
HUGE = 10 * 2**30
MISSING = object()
RUN = ("run", "study.yaml", "--out", "out")
IMPORT = ("import", "test.csv", "--out", "out")
BAR, JSON = "cohort/s01/pull.csv", "cohort/s01/specimen.json"
FEBIO = {"name": "febio", "executable": "true", "template": "bar.feb.j2"}  # the template is refused before it is run


# ---- one valid study, and what breaks it


def write(path: str, content: str | bytes) -> None:
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    Path(path).write_bytes(content.encode() if isinstance(content, str) else content)


def write_study(field: str = "", value: Any = None) -> None:
    """The valid study with one dotted field set, or removed."""
    study = json.loads(json.dumps(STUDY))
    if field:
        *parents, last = field.split(".")
        section = study
        for name in parents:
            section = section[name]
        if value is MISSING:
            del section[last]
        else:
            section[last] = value
    write("study.yaml", yaml.safe_dump(study, sort_keys=False, allow_unicode=True))


def write_specimen(folder: str, force: str = "8") -> None:
    write(f"{folder}/specimen.json", json.dumps(GEOMETRY))
    write(f"{folder}/pull.csv", curve(*ROWS, f"4,0.2,{force}"))


def _slashed(*names: str) -> None:
    for number, name in enumerate(names):
        write_specimen(f"cohort/{name}", str(6 + number))


def curve(*rows: str, header: str = HEADER) -> str:
    return "\n".join([header, *rows, ""])


def replaced(row: int, text: str) -> str:
    """The valid curve with the line ``row`` (the header is 1) in place of what stood there."""
    rows = list(ROWS)
    rows[row - 2] = text
    return curve(*rows)


def sparse(path: str) -> None:
    write(path, "")
    os.truncate(path, HUGE)


def link(path: str, target: str) -> None:
    shutil.rmtree(path) if Path(path).is_dir() else Path(path).unlink(missing_ok=True)
    Path(path).symlink_to(target)


def fifo(path: str) -> None:
    Path(path).unlink(missing_ok=True)
    os.mkfifo(path)


def folder_for_file(path: str) -> None:
    Path(path).unlink(missing_ok=True)
    Path(path).mkdir()


@pytest.fixture
def here(tmp_path, monkeypatch):
    """A working directory with everything that is valid. An evaluation would mean that the input was accepted."""

    def accepted(*_: Any) -> None:
        raise AssertionError("the input was accepted: an evaluation was started")

    import_module("tasks.pipeline")  # so that no case is charged for the time of its imports
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("tasks.workspace.evaluate", accepted)
    write_study()
    write_specimen("cohort/s01")
    write_specimen("cohort/s02", "7")
    write("rows.csv", PARAMETERS)
    write("test.csv", EXPORT)
    return tmp_path


@pytest.fixture
def refused(here, monkeypatch, capfd):
    """Runs the command on bad input and returns the line it printed."""

    def run(arguments: tuple[str, ...], *told: str) -> str:
        before = listing(here)
        monkeypatch.setattr(sys, "argv", ["sinew", *arguments])
        started = time.process_time()
        with pytest.raises(SystemExit) as stopped:
            main()
        seconds = time.process_time() - started
        out, err = capfd.readouterr()
        assert stopped.value.code == 2
        assert out == ""
        assert err.startswith("sinew: ")
        assert err.endswith("\n")
        assert err[:-1].isprintable(), "more than one line, or characters that a terminal obeys"
        assert "Traceback" not in err
        assert [words for words in told if words not in err] == [], err
        assert listing(here) == before, "something was written"
        assert seconds < 2, "too slow"
        return err

    return run


def listing(folder: Path) -> dict[str, tuple[int, int, str]]:
    """Everything below a folder: its kind and when it was changed; links are not followed."""
    found = {}
    for parent, folders, files in os.walk(folder):
        for name in (*folders, *files):
            path = Path(parent, name)
            stat = path.lstat()
            found[str(path)] = (stat.st_mode, stat.st_mtime_ns, str(path.readlink()) if path.is_symlink() else "")
    return found


def test_what_is_broken_below_was_valid(here):
    study = read_study(Path("study.yaml"))
    cohort = read_cohort(study.cohort_path)
    assert [specimen.name for specimen in cohort.specimens] == ["s01", "s02"]
    assert read_parameters(Path("rows.csv"), Model()).shape == (2, len(TENDON))
    assert read_export(Path("test.csv")).curves[0].force_N.tolist() == [0.0, 5.0, 9.0]


# ---- the study file


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
    ("sobol.shape", 1, ": unknown key; expected one of points, base_samples"),
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
    ("simulator", "abaqus", "abaqus'}; expected one of 'uniaxial', 'febio'"),
    ("simulator", None, ": None; expected a name or settings"),
    ("simulator", {"timeout_s": 5.0}, "simulator.name: missing; expected which kind"),
    ("simulator", FEBIO | {"timeout_s": 0}, "simulator.timeout_s: 0; expected above 0"),
    ("simulator", FEBIO | {"timeout_s": -5.0}, "simulator.timeout_s: -5.0; expected above 0"),
    ("simulator", FEBIO | {"timeout_s": float("inf")}, "simulator.timeout_s: inf; expected "),
    ("simulator", FEBIO | {"timeout_s": float("nan")}, "simulator.timeout_s: nan; expected "),
    ("simulator", FEBIO | {"timeout_s": "600"}, "simulator.timeout_s: '600'; expected a number"),
    ("simulator", FEBIO | {"max_file_mb": 0}, "simulator.max_file_mb: 0; expected above 0"),
    ("simulator", FEBIO | {"time_steps": {"ramp_s": -1}}, "simulator.time_steps.ramp_s: -1; expected at least 0"),
    ("simulator", FEBIO | {"executable": "no-solver"}, "simulator.executable: 'no-solver' was not found; expected feb"),
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


BOMB = "a: &a [x, x, x]\n" + "".join(
    f"{b}: &{b} [*{a}, *{a}, *{a}]\n" for a, b in zip("abcdefgh", "bcdefghi", strict=True)
)
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
    "unknown variable": ("bar.feb.j2", "<febio_spec>{{ modulus }}</febio_spec>", "bar.feb.j2: cannot be rendered"),
    "unknown parameter": ("bar.feb.j2", "<febio_spec>{{ parameters.E | full }}", "bar.feb.j2: cannot be rendered"),
    "endless macro": ("bar.feb.j2", "{% macro m() %}{{ m() }}{% endmacro %}{{ m() }}", "bar.feb.j2: cannot be rende"),
    "too few to format": ("bar.feb.j2", "{{ '{} {}'.format(1) }}", "bar.feb.j2: cannot be rendered"),
    "escape from the sandbox": ("bar.feb.j2", "{{ ''.__class__.__mro__[1].__subclasses__() }}", "bar.feb.j2: cannot"),
    "no XML": ("bar.feb.j2", "force = 1", "bar.feb.j2: renders to no XML"),
    "no FEBio": ("bar.feb.j2", "<html></html>", "bar.feb.j2: renders to <html>; expected <febio_spec>"),
    "entity": ("bar.feb.j2", '<!DOCTYPE x [<!ENTITY a "b">]><febio_spec>&a;</febio_spec>', "bar.feb.j2: renders to no"),
    "half a character": ("bar.feb.j2", "<febio_spec>{{ '\\ud800' }}</febio_spec>", "bar.feb.j2: "),
    "file elsewhere": ("bar.feb.j2", '<febio_spec><a file="/etc/x"/></febio_spec>', "bar.feb.j2: <a file='/etc/x'>"),
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
    refused(RUN, "solver: cannot be run (Exec format error); expected a solver program")


# ---- the cohort

CURVES = {
    "nothing": ("", f"{BAR}: empty; expected a header and numbers"),
    "header only": (curve(), f"{BAR}: holds a header but no numbers; expected rows of numbers"),
    "two rows": (curve(*ROWS[:2]), f"{BAR}: 2 rows of numbers; expected at least 3"),
    "no header": (ROWS[0] + curve(*ROWS), f"{BAR}: row 1: header '0,0,0{HEADER}'; expected {HEADER}"),
    "other header": (curve(*ROWS, header="t,u,F"), f"{BAR}: row 1: header 't,u,F'; expected {HEADER}"),
    "milliseconds": (curve(*ROWS, header=HEADER.replace("_s", "_ms")), f"{BAR}: row 1: header 'time_ms,"),
    "order of columns": (curve(*ROWS, header="force_N,time_s,displacement_mm"), f"{BAR}: row 1: header 'force_N,"),
    "semicolons": (curve(*ROWS).replace(",", ";"), f"{BAR}: row 1: header 'time_s;displacement_mm;force_N'; expected"),
    "NaN": (replaced(3, "1,NaN,5"), f"{BAR}: row 3, displacement_mm: 'NaN'; expected a finite number"),
    "inf": (replaced(5, "3,0.2,-inf"), f"{BAR}: row 5, force_N: '-inf'; expected a finite number"),
    "too large": (replaced(5, "3,0.2,1e999"), f"{BAR}: row 5, force_N: '1e999'; expected a finite number"),
    "text in a number": (replaced(4, "2,0.2,9 N"), f"{BAR}: row 4, force_N: '9 N'; expected a finite number"),
    "underscore": (replaced(4, "2,0.2,1_0"), f"{BAR}: row 4, force_N: '1_0'; expected a finite number"),
    "truth": (replaced(4, "2,0.2,True"), f"{BAR}: row 4, force_N: 'True'; expected a finite number"),
    "empty cell": (replaced(4, "2,,9"), f"{BAR}: row 4, displacement_mm: ''; expected a finite number"),
    "missing cell": (replaced(3, "1,0.1"), f"{BAR}: row 3: 2 cells; expected 3, as in the header"),
    "extra cell": (replaced(3, "1,0.1,5,6"), f"{BAR}: row 3: 4 cells; expected 3, as in the header"),
    "an extra cell in every row": (curve(*(f"{row},7" for row in ROWS)), f"{BAR}: row 2: 4 cells; expected 3"),
    "a comma behind every row": (curve(*(f"{row}," for row in ROWS)), f"{BAR}: row 2: 4 cells; expected 3"),
    "blank row": (curve(*ROWS[:2], "", *ROWS[2:]), f"{BAR}: row 4: a blank row between rows of numbers; expected"),
    "open quote": (replaced(3, '1,"0.1,5'), f"{BAR}: row 3"),
    "time backwards": (replaced(4, "0.5,0.2,9"), f"{BAR}: row 4, time_s: time runs backwards (1 s, then 0.5 s); exp"),
    "time still": (replaced(4, "1,0.2,9"), f"{BAR}: row 4, time_s: time stands still (1 s, then 1 s); expected incr"),
    "times too far apart": (curve("-1e308,0,0", "1e308,0,1", "1.1e308,0,2"), f"{BAR}: row "),
    "crushed": (replaced(4, "2,-10,9"), f"{BAR}: row 4, displacement_mm: -10 mm shortens a gauge of 10 mm"),
    "binary": (b"\x00\x01\x02" * 99, f"{BAR}: not a text file; expected text"),
    "NUL far below": (curve(*(f"{i},0,1" for i in range(2000)), "2000,0,1\0"), f"{BAR}: row 2002, force_N"),
    "Latin-1": (replaced(4, "2,0.2,9µ").encode("latin-1"), f"{BAR}: row 4, force_N"),
    "UTF-16": (curve(*ROWS).encode("utf-16"), f"{BAR}: not a text file; expected text in UTF-8"),
    "a long line": (HEADER + "x" * 200_000, f"{BAR}: row 1: header"),
    "a long cell": (replaced(4, "2,0.2," + "9" * 200_000), f"{BAR}"),
}


@pytest.mark.parametrize(("text", "told"), CURVES.values(), ids=CURVES)
def test_curve(refused, text, told):
    write(BAR, text)
    refused(RUN, told, "; expected ")


SPECIMENS = {
    "nothing": ("", f"{JSON}: empty; expected"),
    "no JSON": ("{length_mm: 10}", f"{JSON}: line 1: not valid JSON; expected an object"),
    "cut off": ('{"length_mm": 10.0,\n', f"{JSON}: line 2: not valid JSON; expected an object"),
    "a list": ("[]", f"{JSON}: holds []; expected an object"),
    "unknown key": ({"lenght_mm": 10.0}, f"{JSON}: lenght_mm: unknown key; expected one of length_mm"),
    "missing length": ({"length_mm": MISSING}, f"{JSON}: length_mm: missing; expected a length in mm"),
    "missing width": ({"width_mm": MISSING}, f"{JSON}: width_mm: missing; expected a length in mm"),
    "negative": ({"length_mm": -10}, f"{JSON}: length_mm: -10; expected a length in mm, above 0"),
    "zero": ({"thickness_mm": 0}, f"{JSON}: thickness_mm: 0; expected a length in mm, above 0"),
    "text": ({"length_mm": "10"}, f"{JSON}: length_mm: '10'; expected a length in mm"),
    "with its unit": ({"length_mm": "10 mm"}, f"{JSON}: length_mm: '10 mm'; expected a length in mm"),
    "truth": ({"length_mm": True}, f"{JSON}: length_mm: True; expected a length in mm"),
    "null": ({"length_mm": None}, f"{JSON}: length_mm: is not filled in; expected a length in mm"),
    "NaN": ({"length_mm": float("nan")}, f"{JSON}: length_mm: nan; expected a length in mm"),
    "infinite": ({"length_mm": float("inf")}, f"{JSON}: length_mm: inf; expected a length in mm"),
    "huge": ({"length_mm": 1e9}, f"{JSON}: length_mm: 1000000000.0; expected a length in mm, above 0 and below 10000"),
    "a key twice": ('{"length_mm": 10, "length_mm": 20}', f"{JSON}: length_mm: given twice; expected each key once"),
    "deep nest": ("[" * 100_000, f"{JSON}: not valid JSON; expected an object"),
    "5000 digits": (f'{{"length_mm": {"9" * 5000}}}', f"{JSON}: "),
    "binary": (b"\x80\x04K\x01.", f"{JSON}: not valid JSON; expected an object"),
    "many keys": (json.dumps({f"key{i}": 0 for i in range(20_000)}), f"{JSON}: key0: unknown key; expected one of"),
}  # fmt: skip


@pytest.mark.parametrize(("content", "told"), SPECIMENS.values(), ids=SPECIMENS)
def test_specimen(refused, content, told):
    if isinstance(content, dict):
        content = json.dumps({key: value for key, value in (GEOMETRY | content).items() if value is not MISSING})
    write(JSON, content)
    refused(RUN, told)


def _cohort_of_nothing() -> None:
    shutil.rmtree("cohort")
    Path("cohort").mkdir()


def _outside(path: str, *, folder: bool = False) -> None:
    write_specimen("outside")
    link(path, str(Path("outside" if folder else f"outside/{Path(path).name}").absolute()))


def _same_again(name: str) -> None:
    shutil.copytree("cohort/s01", f"cohort/{name}")


COHORTS = {
    "missing": (lambda: shutil.rmtree("cohort"), "cohort: is not there; expected a cohort folder"),
    "a file": (lambda: link("cohort", "study.yaml"), "cohort: is a file; expected a cohort folder"),
    "a link to nothing": (lambda: link("cohort", "gone"), "cohort: is not there; expected a cohort folder"),
    "empty": (_cohort_of_nothing, "cohort: holds no specimen; expected folders SPECIMEN"),
    "empty specimen": (lambda: Path("cohort/s03").mkdir(), "cohort/s03: holds no CSV file and no specimen; expected"),
    "no CSV": (lambda: Path(BAR).unlink(), "cohort/s01: holds no CSV file; expected one PROTOCOL.csv"),
    "no specimen.json": (lambda: Path(JSON).unlink(), f"{JSON}: is not there; expected a JSON object with length_mm"),
    "huge CSV": (lambda: sparse(BAR), f"{BAR}: 10,240 MB; expected at most 512 MB"),
    "huge specimen.json": (lambda: sparse(JSON), f"{JSON}: 10,240 MB; expected at most 1 MB"),
    "folder as CSV": (lambda: folder_for_file(BAR), f"{BAR}: not a regular file; expected"),
    "folder as specimen.json": (lambda: folder_for_file(JSON), f"{JSON}: not a regular file; expected"),
    "fifo": (lambda: fifo(BAR), f"{BAR}: neither a file nor a folder; expected a regular file"),
    "fifo as specimen.json": (lambda: fifo(JSON), f"{JSON}: neither a file nor a folder; expected a regular file"),
    "fifo as specimen": (lambda: fifo("cohort/s03"), "cohort/s03: neither a file nor a folder; expected"),
    "file linked from outside": (lambda: _outside(BAR), f"{BAR}: a link that leaves "),
    "specimen.json linked from outside": (lambda: _outside(JSON), f"{JSON}: a link that leaves "),
    "folder linked from outside": (lambda: _outside("cohort/s03", folder=True), "cohort/s03: a link that leaves "),
    "link to nothing": (lambda: link(BAR, "gone.csv"), f"{BAR}: a link to nothing; expected a file"),
    "link to itself": (lambda: link(BAR, "pull.csv"), f"{BAR}: a link to "),
    "link to the cohort": (lambda: link("cohort/s01/up", ".."), "cohort/s01/up: a link to a folder that contains it"),
    "specimen linked twice": (lambda: link("cohort/s03", "s01"), "cohort/s03: a duplicate of specimen s01"),
    "pickle beside": (lambda: write("cohort/s01/m.pkl", b"\x80\x04."), "cohort/s01/m.pkl: pickled and binary data"),
    "PICKLE beside": (lambda: write("cohort/s01/M.PKL", b"\x80\x04."), "cohort/s01/M.PKL: pickled and binary data"),
    "NumPy beside": (lambda: write("cohort/s01/pull.npy", b"\x93NUMPY"), "cohort/s01/pull.npy: pickled and binary"),
    "pickle at the top": (lambda: write("cohort/all.pickle", b""), "cohort/all.pickle: pickled and binary data"),
    "same numbers": (lambda: _same_again("s03"), "cohort/s03: a duplicate of specimen s01: its curves are the same"),
    "same but for case": (lambda: write_specimen("cohort/S01", "6"), "cohort/s01: a duplicate of specimen S01 but for"),
    "same but for a slash": (lambda: _slashed("a/1", "a_1"), "cohort/a_1: would be called a_1 in results, as a/1 is"),
    "blank in a name": (lambda: write_specimen("cohort/my bar", "6"), "cohort/my bar: a name that"),
    "line break in a name": (lambda: write_specimen("cohort/my\nbar", "6"), "cohort/my\\nbar: a name that"),
    "escape in a name": (lambda: write_specimen("cohort/\x1b[31m", "6"), "cohort/\\x1b[31m: a name that"),
    "dash before a name": (lambda: write_specimen("cohort/-rf", "6"), "cohort/-rf: a name that cannot be used"),
    "long name": (lambda: write_specimen(f"cohort/{'s' * 101}", "6"), "sss: a name that cannot be used"),
    "blank in a site": (lambda: write_specimen("cohort/my site/s03", "6"), "cohort/my site: a name that"),
    "line break in a site": (lambda: write_specimen("cohort/a\nb/s03", "6"), "cohort/a\\nb: a name that"),
    "blank in a protocol": (lambda: write("cohort/s01/my pull.csv", curve(*ROWS)), "s01/my pull.csv: a name that"),
    "accent in a protocol": (lambda: write("cohort/s01/é.csv", curve(*ROWS)), "cohort/s01/é.csv: a name that"),
}  # fmt: skip


@pytest.mark.parametrize(("break_it", "told"), COHORTS.values(), ids=COHORTS)
def test_cohort(refused, break_it, told):
    break_it()
    refused(RUN, told, "; expected ")


# ---- parameters, exports, the command line

PARAMETER_FILES = {
    "nothing": ("rows.csv", "", "rows.csv: empty; expected"),
    "only a byte order mark": ("rows.csv", b"\xef\xbb\xbf", "rows.csv: "),
    "only a line break": ("rows.csv", "\n", "rows.csv: "),
    "header only": ("rows.csv", "E_f\n", "rows.csv: holds a header but no numbers; expected"),
    "unknown column": ("rows.csv", "E_f,E_g\n1,2\n", "rows.csv: row 1, E_g: unknown parameter; expected some of E_f"),
    "no header": ("rows.csv", "200,1\n", "rows.csv: row 1, 200: unknown parameter; expected some of E_f"),
    "repeated column": ("rows.csv", "E_f,E_f\n1,2\n", "rows.csv: row 1, E_f: given twice; expected each parameter"),
    "no name": ("rows.csv", "E_f,\n1,2\n", "rows.csv: row 1, "),
    "tau of zero": ("rows.csv", "tau_1f\n1\n0\n", "rows.csv: row 3, tau_1f: 0; expected above 0 s"),
    "negative modulus": ("rows.csv", "E_f\n-1\n", "rows.csv: row 2, E_f: -1; expected at least 0 MPa"),
    "Poisson's ratio": ("rows.csv", "nu_m\n0.6\n", "rows.csv: row 2, nu_m: 0.6; expected above -1 and below 0.5"),
    "NaN": ("rows.csv", "E_f\n200\nnan\n", "rows.csv: row 3, E_f: 'nan'; expected a finite number"),
    "inf": ("rows.csv", "E_f\ninf\n", "rows.csv: row 2, E_f: 'inf'; expected a finite number"),
    "text": ("rows.csv", "E_f\nstiff\n", "rows.csv: row 2, E_f: 'stiff'; expected a finite number"),
    "missing cell": ("rows.csv", "E_f,E_m\n200,20\n200\n", "rows.csv: row 3: 1 cells; expected 2"),
    "extra cell": ("rows.csv", "E_f,E_m\n200,20,1\n", "rows.csv: row 2: 3 cells; expected 2"),
    "binary": ("rows.csv", b"\0\1\2", "rows.csv: not a text file; expected text in UTF-8"),
    "huge": ("rows.csv", None, "rows.csv: 10,240 MB; expected at most 256 MB"),
    "missing": ("gone.csv", None, "gone.csv: no such file or directory; expected a file"),
    "a pickle": ("rows.pkl", b"\x80\x04.", "rows.pkl: not a CSV file; expected"),
    "YAML": ("rows.yaml", "E_f: 200", "rows.yaml: not a CSV file; expected"),
    "a folder": ("cohort", None, "cohort: not a regular file; expected"),
}


@pytest.mark.parametrize(("name", "content", "told"), PARAMETER_FILES.values(), ids=PARAMETER_FILES)
def test_parameters(refused, name, content, told):
    if content is not None:
        write(name, content)
    elif name == "rows.csv":
        sparse(name)
    refused(("simulate", "study.yaml", "--parameters", name, "--out", "out"), told, "; expected ")


EXPORTS = {
    "nothing": ("", "test.csv: empty; expected"),
    "no table": (EXPORT[: EXPORT.index("Time")], "test.csv: no row with Time, Extension and Load; expected an Instron"),
    "no load": (EXPORT.replace("Load", "Stress"), "test.csv: no row with Time, Extension and Load; expected"),
    "no Length": (EXPORT.replace("Length", "Lenght"), "test.csv: Length: missing in the header block; expected"),
    "no Width": (EXPORT.replace("Width", "Breadth"), "test.csv: Width: missing in the header block; expected"),
    "Length of zero": (EXPORT.replace('"10.0"', '"0"'), "test.csv: Length: 0 mm; expected above 0"),
    "Length is no number": (EXPORT.replace('"10.0"', "ten"), "test.csv: Length: 'ten mm'; expected a number"),
    "Length is NaN": (EXPORT.replace('"10.0"', "nan"), "test.csv: Length: nan mm; expected above 0"),
    "unit of Length": (EXPORT.replace('"10.0",mm', '"10.0",ft'), "test.csv: Length: '10.0 ft'; expected a number and"),
    "unit of time": (EXPORT.replace("(s)", "(h)"), "test.csv: row 6, time: unit 'h'; expected one of s"),
    "unit of load": (EXPORT.replace("(N)", "(MN)"), "test.csv: row 6, force: unit 'MN'; expected one of n"),
    "no units": (EXPORT.replace("(s),(mm),(N)\n", ""), "test.csv: row 6, time: no unit; expected one of s"),
    "text": (EXPORT.replace('"5.0"', '"5.0 N"'), "test.csv: row 9, force: '5.0 N'; expected a finite number"),
    "NaN": (EXPORT.replace('"0.1"', '"NaN"'), "test.csv: row 9, displacement: 'NaN'; expected a finite number"),
    "missing cell": (EXPORT.replace('"0.1","5.0"', '"0.1"'), "test.csv: row 9, force: ''; expected a finite number"),
    "blank row": (EXPORT.replace('"1.0",', '\n"1.0",'), "test.csv: row 9, time: ''; expected a finite number"),
    "too large for newtons": (EXPORT.replace("(N)", "(kN)").replace('"5.0"', '"1e307"'), "test.csv: row 9, force"),
    "two rows": (EXPORT[: EXPORT.index('"2.0"')], "test.csv: 2 rows of numbers; expected at least 3"),
    "time backwards": (EXPORT.replace('"2.0"', '"0.5"'), "test.csv: row 10, time: 0.5 s after 1 s; expected"),
    "crushed": (EXPORT.replace('"0.1"', '"-10.0"'), "test.csv: an extension that shortens the gauge to nothing; expec"),
    "a long line": ("x" * 200_000 + EXPORT, "test.csv"),
    "open quote": ('"' + EXPORT + "x" * 200_000, "test.csv"),
    "a carriage return in a row": (EXPORT.replace('"0.1"', "0\r1"), "test.csv: "),
    "binary": (b"\0\1\2", "test.csv: not a text file; expected"),
    "no encoding": (b"Time \x81", "test.csv: neither UTF-8 nor Windows text; expected"),
}  # fmt: skip


@pytest.mark.parametrize(("content", "told"), EXPORTS.values(), ids=EXPORTS)
def test_export(refused, content, told):
    write("test.csv", content)
    refused(IMPORT, told, "; expected ")


def _beside(name: str, force: str = "9.0") -> str:
    write(name, EXPORT.replace('"9.0"', f'"{force}"'))
    return name


IMPORTS = {
    "missing": (lambda: "gone.csv", (), "gone.csv: no such file or directory; expected a file"),
    "a folder": (lambda: "cohort", (), "cohort: not a regular file; expected"),
    "a pickle": (lambda: _beside("test.pkl"), (), "test.pkl: pickled and binary data are never read; expected"),
    "huge": (lambda: [sparse("big.csv"), "big.csv"][1], (), "big.csv: 10,240 MB; expected at most 512 MB"),
    "same name": (lambda: _beside("b/test.csv", "8.0"), (), "b/test.csv: a duplicate of specimen test"),
    "same once written": (lambda: _beside("te st.csv", "8.0"), ("te_st.csv",), "te_st.csv: "),
    "same but for case": (lambda: _beside("Test.csv", "8.0"), (), "Test.csv: a duplicate of specimen test"),
    "same numbers": (lambda: _beside("copy.csv"), (), "copy.csv: a duplicate of specimen test"),
    "no name": (lambda: _beside("...csv", "8.0"), (), "...csv: "),
    "dash before a name": (lambda: _beside("_.csv", "8.0"), (), "_.csv: "),
    "there already": (lambda: [write_specimen("out/test"), "test.csv"][1], (), "out/test: is there already; expected"),
    "out is a file": (lambda: [write("out", ""), "test.csv"][1], (), "--out out: "),
    "protocol above": (lambda: "test.csv", ("--protocol", "../../evil"), "--protocol"),
    "protocol with a folder": (lambda: "test.csv", ("--protocol", "a/b"), "--protocol"),
    "protocol with a blank": (lambda: "test.csv", ("--protocol", "my pull"), "--protocol"),
}  # fmt: skip


@pytest.mark.parametrize(("make", "more", "told"), IMPORTS.values(), ids=IMPORTS)
def test_import(refused, make, more, told):
    write("te_st.csv", EXPORT.replace('"9.0"', '"6.0"'))
    second = make()
    first = () if second == "test.csv" else ("test.csv",)
    refused(("import", *first, second, *more, "--out", "out"), told, "; expected ")


RATIOS = "Time,L,F,SD\n2,0.95,0.5,0.1\n2.5,1.045,4,0.2\n3,1.14,10,0.3\n4,1.14,8,0.3\n"
KPA = ("--stress", "kPa", "--time", "s")
NORMALISED = {
    "no unit of time": (RATIOS, KPA[:2], "ramp.csv: row 1, time: no unit; expected one of s, sec, ms, min in brackets, "
                        "or --time"),
    "no unit of force": (RATIOS, KPA[2:], "ramp.csv: row 1, force: no unit; expected one of n"),
    "two units of time": (RATIOS.replace("Time", "Time (ms)"), KPA, "row 1, time: unit 'ms', but --time says s; expec"),
    "two units of stress": (RATIOS.replace("F", "F (MPa)"), KPA, "row 1, stress: unit 'MPa', but --stress says kPa; e"),
    "a force for a stress": (RATIOS.replace("F", "F (N)"), KPA, "row 1, stress: unit 'N'; expected one of pa, kpa"),
    "millipascal": (RATIOS.replace("F", "F (mPa)"), KPA, "row 1, stress: unit 'mPa'; expected one of pa, kpa"),
    "a length for a ratio": (RATIOS.replace("L", "L (mm)"), KPA, "row 1, length ratio: unit 'mm'; expected one of 1"),
    "no ratio": (RATIOS.replace("L", "Strain"), KPA, "ramp.csv: no row with Time, Stretch and Stress; expected"),
    "no stress": (RATIOS.replace("F", "G"), KPA, "ramp.csv: no row with Time, Stretch and Stress; expected columns"),
    "neither": (RATIOS.replace("F", "Stress"), KPA[2:], "ramp.csv: no row with Time, Extension and Load; expected"),
    "a ratio of zero": (RATIOS.replace("1.045", "0"), KPA, "ramp.csv: row 3, length ratio: 0; expected a length over"),
    "percent": (RATIOS.replace("1.14,8", "114,8"), KPA, "ramp.csv: row 5, length ratio: 114; expected a length over"),
    "text": (RATIOS.replace("10,", "ten,"), KPA, "ramp.csv: row 4, stress: 'ten'; expected a finite number"),
    "short row": (RATIOS.replace(",10,0.3", ""), KPA, "ramp.csv: row 4, stress: ''; expected a finite number"),
    "time backwards": (RATIOS.replace("\n3,", "\n1,"), KPA, "ramp.csv: row 4, time: 1 s after 2.5 s; expected incr"),
    "reference of zero": (RATIOS, (*KPA, "--reference", "0"), "--reference: 0; expected above 0 and below 10"),
    "reference in percent": (RATIOS, (*KPA, "--reference", "95"), "--reference: 95; expected above 0 and below 10"),
    "reference is NaN": (RATIOS, (*KPA, "--reference", "nan"), "--reference: nan; expected above 0 and below 10"),
    "reference of an extension": (EXPORT, ("--reference", "0.95"), "ramp.csv: holds displacements, which --refe"),
    "length": (RATIOS, (*KPA, "--length-mm", "-1"), "--length-mm: -1; expected above 0 and below 10000 mm"),
    "area": (RATIOS, (*KPA, "--area-mm2", "inf"), "--area-mm2: inf; expected above 0 and below 1e+08 mm2"),
    "specimen": (RATIOS, (*KPA, "--specimen", "../evil"), "--specimen: '../evil'; expected letters, digits"),
}  # fmt: skip


@pytest.mark.parametrize(("content", "options", "told"), NORMALISED.values(), ids=NORMALISED)
def test_normalised_export(refused, content, options, told):
    write("ramp.csv", content)
    refused(("import", "ramp.csv", *options, "--out", "out"), told, "; expected ")


ONE = {
    "the same name": (("a/test.csv", '"8.0"'), (), "a/test.csv: has protocol test, as test.csv; expected each"),
    "the same numbers": (("a/copy.csv", '"9.0"'), (), "a/copy.csv: has the numbers of test.csv; expected each"),
    "the sum's name": (("a/total.csv", '"8.0"'), (), "a/total.csv: its name cannot be used for a protocol: 'total'"),
    "no name": (("a/_.csv", '"8.0"'), (), "a/_.csv: its name cannot be used for a protocol: '_'; expected a letter"),
    "one protocol": (("b.csv", '"8.0"'), ("--protocol", "p"), "--protocol: one name for 2 files of one specimen; exp"),
    "another length": (("b.csv", '"8.0"\n'), (), "b.csv: a bar of 5 mm, 32 mm2, but 10 mm, 32 mm2 in test.csv; expect"),
}  # fmt: skip


@pytest.mark.parametrize(("second", "options", "told"), ONE.values(), ids=ONE)
def test_files_of_one_specimen(refused, second, options, told):
    name, force = second
    content = EXPORT.replace('"10.0"', '"5.0"') if force.endswith("\n") else EXPORT
    write(name, content.replace('"9.0"', force.strip()))
    refused(("import", "test.csv", name, "--specimen", "bar", *options, "--out", "out"), told, "; expected ")


USAGES = [
    (("run",), "Missing argument 'STUDY'"),
    (("cohort",), "Missing option '--out'"),
    (("cohort", "--out"), "'--out' requires an argument"),
    (("simulate", "study.yaml", "--out", "out"), "Missing option '--parameters'"),
    (("import", "--out", "out"), "Missing argument 'FILES...'"),
    ((*RUN, "--fast"), "--fast"),
    ((*RUN, "more"), "unexpected extra argument (more)"),
    ((*RUN, "--fa\x1bst"), "No such option"),
    (("run", "my  study.yaml"), "sinew: my  study.yaml: is not there; expected a study file"),
    (("walk", "study.yaml"), "No such command 'walk'"),
    ((*RUN, "--seed", "-1"), "'--seed': -1 is not in the range 0<=x<=4294967295"),
    ((*RUN, "--seed", "4294967296"), "'--seed': 4294967296 is not in the range"),
    ((*RUN, "--seed", "1.5"), "'--seed': '1.5' is not a valid integer range"),
    ((*RUN, "--workers", "0"), "'--workers': 0 is not in the range 1<=x<=1024"),
    ((*RUN, "--workers", "two"), "'--workers': 'two' is not a valid integer range"),
    ((*RUN, "--simulator", "abaqus"), "'--simulator': 'abaqus' is not one of 'uniaxial', 'febio'"),
    ((*RUN, "--data", "gone"), "gone: is not there; expected a cohort folder"),
    ((*RUN, "--data", "study.pkl"), "study.pkl: pickled and binary data are never read; expected a folder of CSV"),
    (("run", "study.yaml", "--out", "rows.csv"), "--out rows.csv: rows.csv is a file; expected a folder"),
    (("run", "study.yaml", "--out", "rows.csv/out"), "/rows.csv is a file; expected a folder"),
    (("run", "study.yaml", "--out", "x" * 300), "xxx"),
    (("sobol", "study.yaml", "--out", "out", "--extend"), "out/sobol.json: is not there; expected a finished"),
    (("importance", "study.yaml", "--out", "out"), "out/sobol.json: is not there; expected `sinew sobol`"),
    (("cohort", "--out", "rows.csv"), "--out rows.csv: rows.csv is a file; expected a folder"),
    (("cohort", "--out", "out", "--rate", "0"), "'--rate': 0.0 is not in the range 0.5<=x<=1000"),
    (("cohort", "--out", "out", "--rate", "nan"), "--rate: nan"),
    (("cohort", "--out", "out", "--rate", "1", "--per-site", "1", "--noise", "nan"), "--noise: nan"),
    (("cohort", "--out", "out", "--rate", "1", "--per-site", "1", "--ar1", "nan"), "--ar1: nan"),
    (("status", "out"), "out: holds no store.zarr; name a result folder"),
    (("status", "cohort"), "cohort: holds no store.zarr; name a result folder"),
    (("status", "rows.csv", "--json"), "rows.csv: holds no store.zarr; name a result folder"),
    (("status", "no\nwhere"), "no\\nwhere: holds no store.zarr; name a result folder"),
    (("status", "x" * 300), "xxx"),
    (("repair", "out"), "out: holds no store.zarr; name a result folder"),
    (("repair", "cohort"), "cohort: holds no store.zarr; name a result folder"),
]  # fmt: skip


@pytest.mark.parametrize(("arguments", "told"), USAGES, ids=[" ".join(case[0])[:60] for case in USAGES])
def test_usage(refused, arguments, told):
    refused(arguments, told)


@pytest.mark.parametrize("command", ["status", "repair"])
@pytest.mark.parametrize("inside", ["", "zarr.json"])
def test_store_that_is_none(refused, command, inside):
    folder_for_file("out")
    folder_for_file("out/store.zarr")
    if inside:
        write(f"out/store.zarr/{inside}", '{"zarr_format": 3, "node_type": "group", "attributes": {}}')
    refused((command, "out"), "out/store.zarr: ", "give another --out")
