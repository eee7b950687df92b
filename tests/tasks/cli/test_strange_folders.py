"""The folder in which the command is started, and that for temporary files, may hold what somebody else wrote."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from sinew.tasks.cli.main import main
from sinew.tasks.data.cohort import write_cohort
from sinew.tasks.data.virtual import virtual_cohort
from tests.tasks.stand_in import WITHOUT_FIGURES

COMMAND = Path(sys.executable).with_name("sinew")
MODULES = ("multiprocessing", "signal", "psutil", "bokeh", "matplotlib", "numba", "pandas", "SALib", "skopt")


def plant(folder: Path, marks: Path) -> None:
    """Modules that leave a mark and then fail, by the names of those that the program imports."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in MODULES:
        (folder / f"{name}.py").write_text(f"open({str(marks / name)!r}, 'w').close()\nraise ImportError\n")


@pytest.fixture
def study(tmp_path) -> Path:
    specimens, truth = virtual_cohort(seed=1, per_site=1, rate_hz=1.0)
    write_cohort(tmp_path / "study" / "cohort", specimens[:1], truth)
    path = tmp_path / "study" / "study.yaml"
    path.write_text(
        "name: strange\ncohort: cohort\nsobol: {base_samples: 2, resamples: 20}\nstore: {points_per_curve: 8}\n"
        "tasks: [sobol]\ncluster: {name: local, workers: 1}\n"
    )
    return path


def test_no_module_is_imported_from_there(study, tmp_path):
    """Dask puts its own folder below the temporary one on the path, and starts workers by ``python -c``.

    So it does with a folder in the result folder, where local workers keep their files; it is removed unread.
    """
    marks, shared, out = tmp_path / "marks", tmp_path / "tmp", tmp_path / "out"
    places = {"here": study.parent, "temporary": shared / "dask-scratch-space",
              "results": out / ".workers" / "dask-scratch-space"}  # fmt: skip
    for name, folder in places.items():
        (marks / name).mkdir(parents=True)
        plant(folder, marks / name)
    places["temporary"].chmod(0o777)
    environment = {**os.environ, "TMPDIR": str(shared)}
    command = [COMMAND, "sobol", "study.yaml", "--out", out]
    done = subprocess.run(command, cwd=study.parent, env=environment, capture_output=True, text=True)
    assert [str(path.relative_to(marks)) for path in marks.glob("*/*")] == [], done.stderr
    assert done.returncode == 0, done.stderr
    assert not (out / ".workers").exists()


@pytest.mark.parametrize("name", ["matplotlibrc", ".numba_config.yaml", "arvizrc"])
def test_settings_of_libraries_that_lie_there_are_refused(name, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["sinew", "status", "out"])
    (tmp_path / name).symlink_to("gone")
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    assert capsys.readouterr().err.startswith(f"sinew: {tmp_path / name}: ")


@pytest.mark.parametrize(
    ("command", "linked"),
    [(command, place) for command in ("sobol", "doctor", "submit") for place in ("results", "results/strange")]
    + [("demo", "results"), ("demo", "results/demo"), ("benchmark", "results/benchmark")],
)
def test_a_link_for_the_default_result_folder_is_refused(study, tmp_path, monkeypatch, capsys, command, linked):
    mine = tmp_path / "mine"
    (mine / "attempts" / "attempt-1").mkdir(parents=True)
    (mine / "report.html").write_text("mine")
    monkeypatch.chdir(study.parent)
    Path(linked).parent.mkdir(exist_ok=True)
    Path(linked).symlink_to(mine)
    profile = ["--profile", str(Path(__file__).parents[3] / "slurm" / "generic.yaml")] if command == "submit" else []
    words = {"demo": ["demo"], "benchmark": ["benchmark", "discover", "cohort"]}.get(command, [command, "study.yaml"])
    monkeypatch.setattr(sys, "argv", ["sinew", *words, *profile])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    assert f"sinew: {linked}: is a link, and nobody named it; expected" in capsys.readouterr().err
    assert sorted(path.name for path in mine.rglob("*")) == ["attempt-1", "attempts", "report.html"]


@pytest.mark.parametrize("entry", ["", ".", "bin"])
def test_no_program_is_looked_for_in_this_folder(tmp_path, monkeypatch, capsys, entry):
    """A table of jobs that names Grid Engine, and a ``qstat`` beside it."""
    jobs = tmp_path / "out" / "jobs"
    jobs.mkdir(parents=True)
    event = {"time": 1000.5, "job": "5", "event": "submitted", "role": "coordinator", "name": "sinew-x", "cores": 1}
    (jobs / "jobs.jsonl").write_text(json.dumps(event | {"batch_system": "grid_engine"}) + "\n")
    (tmp_path / "bin").mkdir()
    for place in (tmp_path, tmp_path / "bin"):
        (place / "qstat").write_text(f"#!/bin/sh\necho ran > {tmp_path}/mark\n")
        (place / "qstat").chmod(0o755)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", f"{entry}:/nowhere")
    monkeypatch.setattr(sys, "argv", ["sinew", "cancel", "out"])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    assert "qstat was not found" in capsys.readouterr().err
    assert not (tmp_path / "mark").exists()


@pytest.mark.thorough
def test_names_that_a_locale_does_not_know_do_no_harm(study, tmp_path):
    """With ASCII alone, Python reads other names as what it cannot send to a worker."""
    there = study.parent.rename(tmp_path / "st\u00fcdie \u529b")
    plain = {name: value for name, value in os.environ.items() if not name.startswith(("LC_", "LANG", "PYTHON"))}
    environment = plain | {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    for command in (["sobol", "study.yaml", "--out", "\u00f6ut"], ["status", "\u00f6ut"], ["sobol", "k\u00e4se.yaml"]):
        done = subprocess.run(
            [sys.executable, WITHOUT_FIGURES, *command], cwd=there, env=environment, capture_output=True
        )
        said = done.stdout.decode("utf-8"), done.stderr.decode("utf-8")
        assert done.returncode == (2 if "k\u00e4se.yaml" in command else 0), said
        assert command[-1] in "".join(said)
