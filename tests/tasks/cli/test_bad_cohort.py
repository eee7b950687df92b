"""Every mistake in a cohort is one line that says what was expected."""

import json
import shutil
from pathlib import Path

import pytest

from tests.tasks.cli.bad_input import (
    BAR,
    GEOMETRY,
    HEADER,
    JSON,
    MISSING,
    ROWS,
    RUN,
    _slashed,
    curve,
    fifo,
    folder_for_file,
    link,
    replaced,
    sparse,
    write,
    write_specimen,
)

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
    "crushed": (
        replaced(4, "2,-10,9"),
        f"{BAR}: row 4, displacement_mm: -10 mm leaves nothing of a gauge length of 10 mm",
    ),
    "binary": (b"\x00\x01\x02" * 99, f"{BAR}: not a text file; expected text"),
    "NUL far below": (curve(*(f"{i},0,1" for i in range(2000)), "2000,0,1\0"), f"{BAR}: row 2002, force_N"),
    "Latin-1": (replaced(4, "2,0.2,9µ").encode("latin-1"), f"{BAR}: row 4, force_N"),
    "UTF-16": (curve(*ROWS).encode("utf-16"), f"{BAR}: not a text file; expected text in UTF-8"),
    "a long line": (HEADER + "x" * 200_000, f"{BAR}: row 1: more than 120,000 characters"),
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
    "negative": ({"length_mm": -10}, f"{JSON}: length_mm: -10; expected a length in mm, at least 1e-06"),
    "zero": ({"thickness_mm": 0}, f"{JSON}: thickness_mm: 0; expected a length in mm, at least 1e-06"),
    "text": ({"length_mm": "10"}, f"{JSON}: length_mm: '10'; expected a length in mm"),
    "with its unit": ({"length_mm": "10 mm"}, f"{JSON}: length_mm: '10 mm'; expected a length in mm"),
    "truth": ({"length_mm": True}, f"{JSON}: length_mm: True; expected a length in mm"),
    "null": ({"length_mm": None}, f"{JSON}: length_mm: is not filled in; expected a length in mm"),
    "NaN": ({"length_mm": float("nan")}, f"{JSON}: length_mm: nan; expected a length in mm"),
    "infinite": ({"length_mm": float("inf")}, f"{JSON}: length_mm: inf; expected a length in mm"),
    "huge": ({"length_mm": 1e9}, f"{JSON}: length_mm: 1000000000.0; expected a length in mm, at least 1e-06"),
    "tiny": ({"width_mm": 1e-300}, f"{JSON}: width_mm: 1e-300; expected a length in mm, at least 1e-06 and below"),
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
    "huge CSV": (lambda: sparse(BAR), f"{BAR}: 10,240 MB; expected at most 64 MB"),
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
