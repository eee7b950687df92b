"""Import every FEBio model of a folder and compare what the solver says of it and of its template.

    python -m tests.febio_models FOLDER --seconds 60 --workers 2

FEBio's own collection (febiosoftware/TestSuite) is such a folder. For each model of solid mechanics: does it import; is
every number of its materials exposed; and does the solver give the same log of all nodes' displacements, digit by
digit, for the model and for its template at the model's own values? Needs ``febio4`` on the PATH.
"""

import argparse
import json
import multiprocessing
import os
import re
import subprocess
import tempfile
import xml.etree.ElementTree as ET
from collections import Counter
from functools import partial
from pathlib import Path
from typing import Any

from sinew.runner.errors import SinewError
from sinew.tasks.data.new_model_study import Choices, init_model
from sinew.tasks.simulate.build import simulator_of
from sinew.tasks.simulate.febio.model_file.contents import contents_of
from sinew.tasks.simulate.febio.model_file.source import read_source
from sinew.tasks.simulate.febio.simulator import FEBio
from sinew.tasks.study.cohort import cohort_of
from sinew.tasks.study.model import model_of
from sinew.tasks.study.study import read_study

LOG = "sinew-0.txt"
DECLARATION = '<?xml version="1.0" encoding="UTF-8"?>\n'
NUMBERS = re.compile(r"[-+0-9.eE, \t\r\n]*[0-9][-+0-9.eE, \t\r\n]*")


def numbers_of_materials(path: Path) -> int:
    """How many numbers the elements of a model's materials hold, counted without sinew's reader."""
    root = ET.parse(path).getroot()
    count = 0
    for leaf in root.findall("./Material/material//*") + root.findall("./Material/material"):
        text = leaf.text or ""
        if not len(leaf) and NUMBERS.fullmatch(text):
            try:
                count += len([float(part) for part in text.split(",")])
            except ValueError:
                continue
    return count


def solved(folder: Path, text: str, seconds: float) -> tuple[str, bytes]:
    """How a run ended, and the log of its output without the date."""
    folder.mkdir()
    (folder / "model.feb").write_text(text, "utf-8")
    try:
        done = subprocess.run(
            ["febio4", "-i", "model.feb", "-silent"], cwd=folder, capture_output=True, timeout=seconds, env=ENVIRONMENT
        )
        end = "normal" if done.returncode == 0 else f"exit code {done.returncode}"
    except subprocess.TimeoutExpired:
        end = "too slow"
    log = folder / LOG
    return end, log.read_bytes() if log.exists() else b""


ENVIRONMENT = {"OMP_NUM_THREADS": "1", "PATH": os.environ["PATH"]}


def looked_at(path: Path, seconds: float) -> dict[str, Any]:
    """What became of one model."""
    found: dict[str, Any] = {"model": path.name, "module": "", "exposed": 0, "numbers": 0}
    try:
        source = read_source(path)
        module = source.section("Module")
        found["module"] = module.attributes.get("type", "") if module is not None else ""
        contents = contents_of(source)
        found["exposed"], found["numbers"] = len(contents.materials), numbers_of_materials(path)
        vary = next((one for one in contents.materials if one.value != 0), None)
        if vary is None:
            return found | {"end": "no number in materials that is not 0"}
        with tempfile.TemporaryDirectory() as folder:
            choices = Choices([vary.path], measure=[f"probe=ux@{contents.sets.nodes[0]}"])
            study = init_model(source, contents, choices, Path(folder) / "study").study
            found["end"] = _compared(path, study, Path(folder), seconds)
    except SinewError as error:
        found["end"] = f"refused: {error}"
    return found


def _compared(path: Path, file: Path, folder: Path, seconds: float) -> str:
    """The solver's log of the model and of what the study renders at its reference values."""
    study = read_study(file)
    model = model_of(study.model, study.simulator.law)
    (specimen,) = cohort_of(study, None).specimens
    simulator = simulator_of(study, None, folder)
    assert isinstance(simulator, FEBio)
    rendered = simulator.rendered(model, specimen, specimen.curves[0].protocol, model.reference)
    root = ET.parse(path).getroot()
    ids = [node.get("id") for node in next(root.iter("Nodes")).iter("node")]
    output = root.find("Output")
    output = ET.SubElement(root, "Output") if output is None else output
    log = output.find("logfile")
    log = ET.SubElement(output, "logfile") if log is None else log
    entry = ET.SubElement(log, "node_data", {"data": "ux", "name": "probe", "file": LOG, "delim": ","})
    entry.text = ",".join(map(str, ids))
    saved = solved(folder / "saved", DECLARATION + ET.tostring(root, encoding="unicode"), seconds)
    again = solved(folder / "again", rendered, seconds)
    if "too slow" in (saved[0], again[0]):
        return "too slow"
    if saved != again:
        return f"differs: {saved[0]} and {again[0]}"
    return "same" if saved[1] else f"same, without a log ({saved[0]})"


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seconds", type=float, default=60.0, help="the longest run of the solver")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, help="a JSON file for what became of each model")
    asked = parser.parse_args()
    paths = sorted(asked.folder.rglob("*.feb"), key=lambda path: path.stat().st_size)
    with multiprocessing.Pool(asked.workers, maxtasksperchild=10) as pool:
        found = list(pool.imap(partial(looked_at, seconds=asked.seconds), paths))
    if asked.out is not None:
        asked.out.write_text(json.dumps(found, indent=1))
    for module in sorted({one["module"] for one in found}):
        these = [one for one in found if one["module"] == module]
        ends = Counter(one["end"].partition(":")[0] for one in these)
        exposed = sum(one["exposed"] == one["numbers"] > 0 for one in these)
        print(f"{module or 'no module'}: {len(these)} models, all numbers of materials in {exposed}; {dict(ends)}")


if __name__ == "__main__":
    main()
