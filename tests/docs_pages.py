"""The pages are tested: each command of README.md and docs/*.md is run, or listed below with the reason why not.

Commands are in blocks marked ``sh``, Python is in blocks marked ``python``. The blocks of a page run in order, in one
folder per page: commands of sinew in the tests' process, without a cluster and without figures, which have tests of
their own; other commands, and Python blocks that follow each other, in processes of their own. An invisible comment
names what the folder holds first: ``<!-- commands: study, exports -->``. A command that takes long, or needs what a
test machine does not have, is listed in ``NOT_RUN``; its arguments are still checked against the command line. Options
and files of the project that a text names must exist.
"""

import contextlib
import io
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from unittest import mock

import numpy as np

from sinew.tasks.cli import main as cli
from sinew.tasks.data.cohort import write_cohort
from sinew.tasks.data.virtual import virtual_cohort
from sinew.tasks.study import pipeline
from sinew.tasks.study.workspace import Workspace
from tests.tasks.few_parameters import held_but
from tests.tasks.simulate.febio.model_file.cube import CUBE

ROOT = Path(__file__).resolve().parents[1]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md", *sorted((ROOT / "docs").glob("*.md"))]
LANGUAGES = {"sh", "python", "yaml", "text", "{toctree}", "{eval-rst}"}
SHARED = "/shared/me"  # what slurm.md calls a folder that all nodes see

NEEDS_SLURM = "needs a SLURM cluster; tests/tasks/cluster/test_submission.py and test_doctor.py run it on one"
LONG = "takes minutes to hours"
NOT_RUN = {
    "make demo": "sets up its own environment and takes minutes; CI runs it by itself",
    "sinew demo": "takes minutes; CI runs it by itself, as make demo",
    "make test": "these are the tests; CI runs it by itself",
    "make setup": LONG,
    "make check": "CI runs it by itself",
    "make wheel": "tests/supply/test_wheel.py builds one",
    "python3 -m venv sinew-env": LONG,
    "sinew-env/bin/pip install --require-hashes -r sinew_fe-0.1.0.requirements.txt": LONG,
    "sinew-env/bin/pip install --no-deps sinew_fe-0.1.0-py3-none-any.whl": LONG,
    "rattler-build build --recipe packaging/conda/recipe.yaml --channel conda-forge": "needs conda-forge",
    "apptainer build sinew.sif packaging/apptainer/sinew.def": "needs Apptainer",
    "apptainer run --bind /opt/febio:/opt/febio sinew.sif run study.yaml --solver /opt/febio/bin/febio4": "the same",
    ".venv/bin/python -m pytest tests/runner/store -q -x": "these are tests; make test-all runs them all",
    ".venv/bin/python -m pytest tests/tasks/sobol -q -k convergence": "these are tests; make test-all runs them all",
    "git clone <where you got sinew> sinew && cd sinew": "the reader fills in the place",
    'export PATH="$PWD/.venv/bin:$PATH"': "changes the reader's shell only",
    "sinew simulate study.yaml --parameters rows.csv --out forces --simulator febio": "needs febio4",
    "sinew fields results/dogbone --row 3 --row 7": "the solver of these tests writes no plot file; "
    "tests/tasks/simulate/febio/test_kept.py exports",
    "sinew compare study.yaml": "the study of running.md has one site; tests/tasks/infer/test_infer.py compares sites",
    "sinew benchmark discover HIDDEN --out scores": "fits the whole library to each case: hours",
    "sinew doctor study.yaml --profile my-site.yaml": NEEDS_SLURM,
    "sinew submit study.yaml --profile my-site.yaml": NEEDS_SLURM,
    "sinew doctor study.yaml --profile my-site.yaml --out /shared/me/study1": NEEDS_SLURM,
    "sinew submit study.yaml --profile my-site.yaml --out /shared/me/study1": NEEDS_SLURM,
    "sinew cancel /shared/me/study1": NEEDS_SLURM,
    "sinew reproduce paper": "takes a quarter of an hour",
    "sinew run study/study.yaml": LONG,
    'eval "$(sinew completion bash)"': "changes the reader's shell; tests/tasks/cli/test_completion.py tries it",
    'eval "$(sinew completion zsh)"': "changes the reader's shell; tests/tasks/cli/test_completion.py tries it",
    "sinew completion fish > ~/.config/fish/completions/sinew.fish": "writes to the reader's home",
    "sinew watch /shared/me/study1": NEEDS_SLURM,
    "sinew discover configs/rattail.yaml": LONG,
    "sinew run configs/dogbone_measured.yaml": LONG,
    "sinew discover configs/titin.yaml": LONG,
    "sinew discover configs/titin_fibres.yaml": LONG,
}


@dataclass(frozen=True)
class Block:
    page: str
    line: int
    language: str
    text: str


def blocks(page: Path) -> Iterator[Block]:
    """The fenced blocks of a page."""
    language, opened, lines = None, 0, []
    for number, line in enumerate(page.read_text("utf-8").splitlines(), start=1):
        if language is None and line.startswith("```"):
            language, opened, lines = line[3:].strip(), number, []
        elif language is not None and line.startswith("```"):
            yield Block(page.name, opened, language, "\n".join(lines))
            language = None
        elif language is not None:
            lines.append(line)
    assert language is None, f"{page.name}: line {opened}: the block does not end"


def commands(page: Path) -> list[str]:
    """The commands of a page, in order; a backslash at the end of a line continues it."""
    found = []
    for block in blocks(page):
        if block.language == "sh":
            found += [line for line in block.text.replace("\\\n", " ").splitlines() if line.split("#")[0].strip()]
    return found


def bare(command: str) -> str:
    """A command without its comment."""
    return re.sub(r"\s+#.*$", "", command).strip()


# ---- what a page can ask for

FREE = ("E_f", "E_m", "g_3f")
FIXED = held_but(FREE)
STUDY = f"""
name: demo
seed: 11
cohort: cohort
cluster: {{name: local, workers: 1}}
model:
  parameters:
{FIXED}
tasks: [sobol, importance, calibrate, infer, predict, compare, discover]
sobol: {{base_samples: 4, resamples: 20}}
store: {{points_per_curve: 16}}
importance: {{trees: 10, repeats: 2}}
calibrate: {{evaluations: 14, methods: [bayesian]}}
infer: {{paper: true, population: 6, generations: 1, epsilon: 9.0}}
predict: {{draws: 4}}
compare: {{permutations: 20, repeats: 1}}
discover: {{effects: [toe-slack], starts: 1, laws: false}}
"""


def study(folder: Path) -> None:
    (folder / "study.yaml").write_text(STUDY)
    (folder / "rows.csv").write_text("E_f\n200\n")


def by_likelihood(folder: Path) -> None:
    """The study with posteriors of populations."""
    of_abc = "infer: {paper: true, population: 6, generations: 1, epsilon: 9.0}"
    assert of_abc in STUDY
    (folder / "study.yaml").write_text(
        STUDY.replace(of_abc, "infer: {method: likelihood, discrepancy: false, ess: 100, rhat: 1.1}")
    )


def one_site(folder: Path) -> None:
    """A study of the specimens that ``sinew import`` makes, which have no sites to compare."""
    study(folder)
    text = STUDY.replace("cohort: cohort", "cohort: data/tails").replace("compare, ", "")
    (folder / "study.yaml").write_text(text)


def cohort(folder: Path) -> None:
    specimens, truth = virtual_cohort(seed=1, per_site=1, rate_hz=2.0)
    write_cohort(folder / "cohort", specimens[:2], truth)


def exports(folder: Path) -> None:
    """The tests of two tendons, as a testing machine exports them."""
    (folder / "bench").mkdir()
    for number in (1, 2):
        _export(folder / "bench" / f"tail{number}.csv", stiffness=100.0 * number)


def _export(path: Path, stiffness: float) -> None:
    time_s = np.linspace(0.0, 30.0, 61)
    extension = 0.5 * np.minimum(time_s / 6.0, 1.0)
    load = stiffness * extension * (0.7 + 0.3 * np.exp(-np.maximum(time_s - 6.0, 0.0) / 8.0))
    load += 0.002 * stiffness * np.sin(1e4 * time_s)
    lines = ["Length,14.2,mm", "Diameter,1.5,mm", "Time (s),Extension (mm),Load (N)"]
    lines += [f"{t:.3f},{u:.6f},{f:.6f}" for t, u, f in zip(time_s, extension, load, strict=True)]
    path.write_text("\n".join(lines) + "\n")


def hidden(folder: Path) -> None:
    (folder / "HIDDEN").mkdir()
    (folder / "HIDDEN" / "answers.json").write_text(json.dumps({"case_01": {"truth": []}}))


def real_exports(folder: Path) -> None:
    """Files with the columns of the measurements of real_data.md, which are not part of the project."""
    (folder / "RATTAIL").mkdir()
    (folder / "TITIN").mkdir()
    for number in (1, 2, 3):
        _export(folder / "RATTAIL" / f"fascicle{number}.csv", stiffness=4.0 * number)
    for rate, ramp in (("1s", 4), ("100s", 8)):
        rows = [f"{t},{0.95 + 0.2 * min(t / ramp, 1)},{10 * min(t / ramp, 1)},0.1" for t in range(20)]
        (folder / "TITIN" / f"AvgRelaxed_{rate}.csv").write_text("\n".join(["Time,L,F,SD", *rows]) + "\n")


def configs(folder: Path) -> None:
    (folder / "configs").mkdir()
    for path in (ROOT / "configs").glob("*.yaml"):
        (folder / "configs" / path.name).write_bytes(path.read_bytes())


def dogbone(folder: Path) -> None:
    """The dog-bone with fewer rows, a model as FEBio Studio saves it, and as febio4 the stand-in of the notebook."""
    (folder / "configs").mkdir()
    shutil.copytree(ROOT / "configs" / "dogbone", folder / "configs" / "dogbone")
    text = (ROOT / "configs" / "dogbone.yaml").read_text()
    for said, small in (("base_samples: 32", "base_samples: 4"), ("points: 131", "points: 14"),
                        ("evaluations: 120", "evaluations: 10")):  # fmt: skip
        assert said in text
        text = text.replace(said, small)
    assert "importance:" not in text
    (folder / "configs" / "dogbone.yaml").write_text(text + "importance: {trees: 10, repeats: 2}\n")
    program = (ROOT / "configs" / "dogbone" / "analytic_bar.py").read_text()
    (folder / "bin" / "febio4").write_text(program.replace("/usr/bin/env python3", f"{sys.executable} -I", 1))
    (folder / "bin" / "febio4").chmod(0o755)
    (folder / "model.feb").write_text(CUBE.replace("gel \u00e4", "tendon"))


def slurm(folder: Path) -> None:
    """The profiles of a checkout."""
    (folder / "slurm").mkdir()
    for name in ("generic.yaml", "site-template.yaml"):
        (folder / "slurm" / name).write_bytes((ROOT / "slurm" / name).read_bytes())


def demo(folder: Path) -> None:
    """A finished study in ``results/demo``."""
    study(folder)
    cohort(folder)
    run(folder, "sinew sobol study.yaml --out results/demo --quiet")


def shared(folder: Path) -> None:
    """A folder that all nodes see, with results of an unfinished study."""
    (folder / "shared").mkdir()
    run(folder, f"sinew sobol study.yaml --out {SHARED}/study1 --quiet")


FIXTURES = {
    "study": study, "by likelihood": by_likelihood, "one site": one_site, "cohort": cohort, "exports": exports,
    "hidden": hidden, "real exports": real_exports, "configs": configs, "dogbone": dogbone, "slurm": slurm,
    "demo": demo, "shared": shared,
}  # fmt: skip


def prepared(page: Path, folder: Path) -> None:
    asked = re.search(r"<!-- commands: (.*?) -->", page.read_text("utf-8"))
    (folder / "bin").mkdir()
    command = folder / "bin" / "sinew"
    command.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m sinew "$@"\n')
    command.chmod(0o755)
    for name in asked.group(1).split(", ") if asked else ():
        assert name in FIXTURES, f"{page.name}: there is no fixture {name!r}; expected some of {', '.join(FIXTURES)}"
        FIXTURES[name](folder)


def run(folder: Path, command: str) -> None:
    """Run a command in the page's folder: one of sinew in this process, any other in a shell."""
    line = bare(command).replace(SHARED, str(folder / "shared"))
    if line.startswith("sinew ") and not set(line) & set("|&;<>$`"):
        _run_here(folder, line)
    else:
        ended(folder, ["bash", "-euc", line], command)


def _run_here(folder: Path, line: str) -> None:
    """The command without a cluster and without figures; globs stand for the files that a shell would list."""
    words = [found for word in shlex.split(line) for found in (sorted(folder.glob(word)) if "*" in word else [word])]
    said = io.StringIO()
    with (
        contextlib.chdir(folder),
        contextlib.redirect_stderr(said),
        mock.patch.dict(os.environ, {"PATH": _path(folder)}),
        mock.patch.object(sys, "argv", [str(word) for word in words]),
        mock.patch.object(Workspace, "client", lambda _: None),
        mock.patch.object(pipeline, "_draw", lambda *_: None),
    ):
        try:
            cli.main()
        except SystemExit as end:
            raise AssertionError(f"{line}\nended with exit code {end.code}\n{said.getvalue()}") from end


def _path(folder: Path) -> str:
    """The folders of programs, those of the page first."""
    return f"{folder / 'bin'}{os.pathsep}{os.environ['PATH']}"


def ended(folder: Path, arguments: list[str], what: str) -> None:
    environment = {
        **os.environ,
        "PATH": _path(folder),
        "PYTHONPATH": str(ROOT),
        "MPLBACKEND": "agg",
    }
    done = subprocess.run(arguments, cwd=folder, env=environment, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, f"{what}\n{done.stdout}\n{done.stderr}"
