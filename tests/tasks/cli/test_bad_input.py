"""Bad input of every kind ends with exit code 2 and one line that says where, what, and what was expected.

Each table starts from a valid study, cohort, parameter file or export and breaks one thing. The command runs in this
process; it must refuse before anything is written or evaluated.
"""

from pathlib import Path

import pytest

from sinew.tasks.data.cohort import read_cohort
from sinew.tasks.data.exports import read_export
from sinew.tasks.model import TENDON, Model
from sinew.tasks.simulate.rows import read_parameters
from sinew.tasks.study.study import read_study
from tests.tasks.cli.bad_input import EXPORT, IMPORT, RUN, folder_for_file, sparse, write, write_specimen


def test_what_is_broken_below_was_valid(here):
    study = read_study(Path("study.yaml"))
    cohort = read_cohort(study.cohort_path)
    assert [specimen.name for specimen in cohort.specimens] == ["s01", "s02"]
    assert read_parameters(Path("rows.csv"), Model()).shape == (2, len(TENDON))
    assert read_export(Path("test.csv")).curves[0].force_N.tolist() == [0.0, 5.0, 9.0]


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
    "no table": (EXPORT[: EXPORT.index("Time")], "test.csv: no table of numbers can be"),
    "no load": (EXPORT.replace("Load", "Stress"), "test.csv: row 6: no column of force or stress among 'Time, Extens"),
    "no Length": (EXPORT.replace("Length", "Lenght"), "test.csv: Length: missing in the lines above the table; "),
    "no Width": (EXPORT.replace("Width", "Breadth"), "test.csv: Width: missing in the lines above the table; "),
    "Length of zero": (EXPORT.replace('"10.0"', '"0"'), "test.csv: Length: '0 mm'; expected a number at least"),
    "Length is no number": (EXPORT.replace('"10.0"', "ten"), "test.csv: Length: 'ten mm'; expected a number"),
    "Length is NaN": (EXPORT.replace('"10.0"', "nan"), "test.csv: Length: 'nan mm'; expected a number at least"),
    "unit of Length": (EXPORT.replace('"10.0",mm', '"10.0",fur'), "test.csv: Length: '10.0 fur'; expected a number"),
    "unit of time": (EXPORT.replace("(s)", "(d)"), "test.csv: 'Time': unit 'd' of the time is not known; expected"),
    "unit of load": (EXPORT.replace("(N)", "(MN)"), "test.csv: 'Load': unit 'MN' may stand for milli or for mega; exp"),
    "no units": (EXPORT.replace("(s),(mm),(N)\n", ""), "test.csv: 'Time': no unit of the time can be found; expect"),
    "text": (EXPORT.replace('"5.0"', '"5.0 N"'), "test.csv: row 9, Load: '5.0 N'; expected a finite number"),
    "NaN": (EXPORT.replace('"0.1"', '"NaN"'), "test.csv: row 9, Extension: 'NaN'; expected a finite number"),
    "missing cell": (EXPORT.replace('"0.1","5.0"', '"0.1"'), "test.csv: row 9, Load: an empty cell; expected a finite"),
    "blank row": (EXPORT.replace('"1.0",', '\n"0.0",'), "test.csv: row 9: an empty row among the numbers"),
    "too large for newtons": (EXPORT.replace("(N)", "(kN)").replace('"5.0"', '"1e307"'), "test.csv: row 9, Load"),
    "two rows": (EXPORT[: EXPORT.index('"2.0"')], "test.csv: 2 rows of numbers; expected at least 3"),
    "time backwards": (EXPORT.replace('"2.0"', '"0.5"'), "test.csv: row 10, time: 0.5 s after 1 s; expected"),
    "crushed": (EXPORT.replace('"0.1"', '"-10.0"'), "test.csv: row 9, displacement: -10 mm leaves nothing of a gauge"),
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
    "huge": (lambda: [sparse("big.csv"), "big.csv"][1], (), "big.csv: 10,240 MB; expected at most 64 MB"),
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
    "no unit of time": (RATIOS, KPA[:2], "ramp.csv: 'Time': no unit of the time can be found; expected --time-unit, "),
    "no unit of force": (RATIOS, KPA[2:], "ramp.csv: 'F': no unit of the force can be found; expected --force-unit, "),
    "two units of time": (RATIOS.replace("Time", "Time (ms)"), KPA, "'Time (ms)': unit 'ms', but --time-unit says s; "),
    "two units of stress": (RATIOS.replace("F", "F (MPa)"), KPA, "'F (MPa)': unit 'MPa', but --force-unit says kPa; e"),
    "a unit given twice": (RATIOS, (*KPA, "--time-unit", "min"), "--time: s, but --time-unit says 'min'; expected one"),
    "a force for a stress": (RATIOS.replace("F", "F (N)"), KPA, "ramp.csv: row 1: no column of stress among 'Time, L"),
    "millipascal": (RATIOS.replace("F", "F (mPa)"), KPA, "'F (mPa)': unit 'mPa' may stand for milli or for mega; ex"),
    "a force for a ratio": (RATIOS.replace("L", "L (N)"), KPA, "ramp.csv: 'L (N)': unit 'N'; expected one of %"),
    "a unit that is none": (RATIOS, ("--stress", "stone"), "--stress: 'stone'; expected one of Pa, kPa, MPa, "),
    "no ratio": (RATIOS.replace("L", "Strain"), KPA, "ramp.csv: 'Strain': no unit of the strain can be found; expec"),
    "no stress": (RATIOS.replace("F", "G"), KPA, "ramp.csv: row 1: no column of stress among 'Time, L, G, SD'; expec"),
    "neither": (RATIOS.replace("F", "Stress"), KPA[2:], "ramp.csv: 'Stress': no unit of the stress can be found; exp"),
    "a ratio of zero": (RATIOS.replace("1.045", "0"), KPA, "ramp.csv: row 3, stretch: 0; expected a length over"),
    "percent": (RATIOS.replace("1.14,8", "114,8"), KPA, "ramp.csv: row 5, stretch: 114; expected a length over"),
    "text": (RATIOS.replace("10,", "ten,"), KPA, "ramp.csv: row 4, F: 'ten'; expected a finite number"),
    "short row": (RATIOS.replace(",10,0.3", ""), KPA, "ramp.csv: row 4, F: an empty cell; expected a finite number"),
    "time backwards": (RATIOS.replace("\n3,", "\n1,"), KPA, "ramp.csv: row 4, time: 1 s after 2.5 s; expected incr"),
    "reference of zero": (RATIOS, (*KPA, "--reference", "0"), "--reference: 0; expected above 0 and below 10"),
    "reference in percent": (RATIOS, (*KPA, "--reference", "95"), "--reference: 95; expected above 0 and below 10"),
    "reference is NaN": (RATIOS, (*KPA, "--reference", "nan"), "--reference: nan; expected above 0 and below 10"),
    "reference of an extension": (EXPORT, ("--reference", "0.95"), "ramp.csv: holds displacements, which --refe"),
    "length": (RATIOS, (*KPA, "--length-mm", "-1"), "--length-mm: -1; expected at least 1e-06 and below 10000 mm"),
    "area": (RATIOS, (*KPA, "--area-mm2", "inf"), "--area-mm2: inf; expected at least 1e-12 and below 1e+08 mm2"),
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
