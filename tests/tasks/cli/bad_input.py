"""One valid study, and ways to break it: what tests of bad input share."""

import json
import os
import shutil
from pathlib import Path
from typing import Any

import yaml

STUDY: dict[str, Any] = {
    "name": "check",
    "cohort": "cohort",
    "seed": 7,
    "model": {"parameters": {"E_f": {"min": 160, "max": 275, "unit": "MPa"}, "nu_m": {"fixed": 0.3}}},
    "simulator": {"name": "uniaxial"},
    "cluster": {"name": "local", "workers": 1},
    "store": {"points_per_curve": 4},
    "retries": 0,
    "tasks": ["sobol"],
    "sobol": {"base_samples": 2, "specimens": ["s01"]},
    "importance": {"trees": 10},
}
GEOMETRY = {"length_mm": 10.0, "width_mm": 8.0, "thickness_mm": 4.0}
HEADER = "time_s,displacement_mm,force_N"
ROWS = ("0,0,0", "1,0.1,500", "2,0.2,900", "3,0.2,800")
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


def write_specimen(folder: str, force: str = "800") -> None:
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


def listing(folder: Path) -> dict[str, tuple[int, int, str]]:
    """Everything below a folder: its kind and when it was changed; links are not followed."""
    found = {}
    for parent, folders, files in os.walk(folder):
        for name in (*folders, *files):
            path = Path(parent, name)
            stat = path.lstat()
            found[str(path)] = (stat.st_mode, stat.st_mtime_ns, str(path.readlink()) if path.is_symlink() else "")
    return found


BOMB = "a: &a [x, x, x]\n" + "".join(
    f"{b}: &{b} [*{a}, *{a}, *{a}]\n" for a, b in zip("abcdefgh", "bcdefghi", strict=True)
)
