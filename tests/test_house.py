"""The shape of the house: which way arrows point, how large its pieces are, and what an installed package holds."""

import ast
import subprocess
import sys
import zipfile
from functools import cache
from importlib import import_module
from pathlib import Path

import pytest

from sinew.tasks.registry import TASKS
from tests.benchmarks.__main__ import NAMES

ROOT = Path(__file__).resolve().parents[1]
LINES, FUNCTION_LINES, ENTRIES = 400, 60, 22
METHODS = ("scipy.stats", "scipy.optimize", "sklearn", "SALib", "skopt", "matplotlib", "bokeh")
PUBLIC = {"work", "result", "settings", "rows", "reading"}  # modules of a task's folder that other tasks may use


@cache
def modules() -> dict[str, ast.Module]:
    """The program's modules by name, parsed."""
    paths = [path for room in ("runner", "tasks") for path in (ROOT / room).rglob("*.py")]
    paths += (ROOT / "sinew").glob("*.py")
    return {_name(path): ast.parse(path.read_text("utf-8")) for path in paths}


def _name(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    parts = parts if parts[0] == "sinew" else ("sinew", *parts)
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


@cache
def imports(name: str) -> frozenset[str]:
    """Modules of the program that a module imports anywhere, but for those that only type checkers see."""
    found = set()
    hidden = {
        id(inner)
        for node in ast.walk(modules()[name])
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"
        for inner in ast.walk(node)
    }
    for node in ast.walk(modules()[name]):
        if id(node) in hidden:
            continue
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            inner = {f"{node.module}.{alias.name}" for alias in node.names}
            found |= {each if each in modules() else node.module for each in inner}
    return frozenset(found & modules().keys())


def test_runner_knows_nothing_of_tasks():
    assert [(name, other) for name in modules() if name.startswith("sinew.runner") for other in imports(name)
            if other.startswith("sinew.tasks")] == []  # fmt: skip


def test_no_task_uses_the_inside_of_another():
    wrong = []
    for name in modules():
        task = name.split(".")[2] if name.startswith("sinew.tasks.") else ""
        for other in imports(name) if task in TASKS else ():
            parts = other.split(".")
            if len(parts) > 3 and parts[2] in TASKS and parts[2] != task and parts[3] not in PUBLIC:
                wrong.append(f"{name} -> {other}")
    assert wrong == []


def test_no_import_goes_in_a_circle():
    state: dict[str, int] = {}

    def visit(name: str, path: list[str]) -> None:
        state[name] = 1
        for other in imports(name):
            if state.get(other) == 1:
                pytest.fail(" -> ".join([*path[path.index(other) :], other]))
            if other not in state:
                visit(other, [*path, other])
        state[name] = 2

    for name in modules():
        if name not in state:
            visit(name, [name])


def test_the_top_of_tasks_can_be_taken_in_at_a_glance():
    entries = [path.name for path in (ROOT / "tasks").iterdir() if path.name != "__pycache__"]
    assert len(entries) <= ENTRIES, sorted(entries)


def test_no_file_and_no_function_is_long():
    long = []
    for path in [
        path for room in ("runner", "tasks", "sinew", "tests", "slurm") for path in (ROOT / room).rglob("*.py")
    ]:
        lines = len(path.read_text("utf-8").splitlines())
        long += [f"{path.relative_to(ROOT)}: {lines} lines"] if lines > LINES else []
        if path.is_relative_to(ROOT / "tests"):  # a test of a whole study says what happens from its begin to its end
            continue
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                lines = (node.end_lineno or 0) - node.lineno + 1
                long += [f"{path.relative_to(ROOT)}: {node.name}: {lines} lines"] if lines > FUNCTION_LINES else []
    assert long == []


def test_every_benchmark_can_be_run():
    """They use what tests use, and no test runs them."""
    places = [path.stem for path in (ROOT / "tests" / "benchmarks").glob("*.py") if not path.stem.startswith("__")]
    assert {*NAMES, "common"} == set(places)
    for name in NAMES:
        assert callable(import_module(f"tests.benchmarks.{name}").main)


def test_a_study_and_its_results_are_read_without_the_libraries_of_methods():
    """Every command reads the settings of all tasks, and `sinew status` their results."""
    parts = [f"sinew.tasks.{task}.{module}" for task in TASKS for module in ("settings", "result")]
    code = f"import {', '.join(parts)}, sys; print([name for name in {METHODS} if name in sys.modules])"
    found = subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=True, capture_output=True, text=True)
    assert found.stdout == "[]\n"


def test_a_wheel_holds_one_package(tmp_path):
    command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(tmp_path)]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    (wheel,) = tmp_path.glob("sinew_fe-*.whl")
    names = zipfile.ZipFile(wheel).namelist()
    assert {name.split("/")[0] for name in names} == {
        "sinew",
        wheel.name.removesuffix("-py3-none-any.whl") + ".dist-info",
    }
    for needed in ("__main__.py", "runner/errors.py", "tasks/sobol/method.py", "templates/tendon.feb.j2",
                   "configs/demo.yaml", "slurm/generic.yaml"):  # fmt: skip
        assert f"sinew/{needed}" in names


@pytest.mark.parametrize("code", ["import sinew", "import sinew.tasks.registry"])
def test_imports_that_everything_begins_with_load_no_library(code):
    libraries = {"numpy", "pandas", "distributed", "matplotlib", "pydantic", "zarr"}
    told = f"{code}; import sys; print(sorted({libraries!r} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", told], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_reading_a_finished_study_loads_no_library_that_only_computing_and_drawing_need():
    parts = [f"sinew.tasks.{task}.{part}" for task in TASKS for part in ("task", "show")]
    code = f"import sinew.tasks.study.pipeline, {', '.join(parts)}"
    libraries = {"SALib", "arviz", "bokeh", "matplotlib", "pingouin", "pyabc", "sklearn", "skopt"}
    shown = f"{code}; import sys; print(sorted({libraries!r} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", shown], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_workers_load_no_library_that_only_the_main_process_needs():
    """There are many of them, and what they import is most of their work until the first row."""
    code = "import sinew.runner.evaluation.batch, sinew.tasks.simulate.evaluation, sinew.tasks.simulate.febio.simulator"
    libraries = {"bokeh", "matplotlib", "scipy", "xarray", "zarr"}
    shown = f"{code}; import sys; print(sorted({libraries!r} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", shown], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_beside_a_file_of_the_users_own_called_tasks_the_command_runs(tmp_path):
    for name in ("tasks", "runner", "tests"):
        (tmp_path / f"{name}.py").write_text("raise SystemExit('the wrong module')\n")
    done = subprocess.run([sys.executable, "-m", "sinew", "--help"], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0
    assert "Run a study" in done.stdout


def test_only_one_place_prints():
    """Names and messages come from files of others, so all that is printed passes one function."""
    wrong = []
    for name, tree in modules().items():
        for node in ast.walk(tree):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "print":
                wrong.append(f"{name}:{node.lineno}: print()")
            if isinstance(node, ast.ImportFrom) and node.module == "rich.console":
                wrong += [f"{name}:{node.lineno}: rich's Console" for each in node.names if each.name == "Console"]
    assert [one for one in wrong if not one.startswith("sinew.runner.printing:")] == []
