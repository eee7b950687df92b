"""Provenance: which program, data and machine these results come from, what they cost, and how to make them again."""

import re
import shlex
from typing import Any

from sinew.runner.errors import brief, one_line
from sinew.tasks.drawing.blocks import Block, Code, Facts, Section, Table, Words, duration, number
from sinew.tasks.registry import TASKS
from sinew.tasks.report.folder import ResultFolder
from sinew.tasks.simulate.registry import of_own_models
from sinew.tasks.study.provenance import install_command
from sinew.tasks.study.resources import DISTRIBUTION

RUNS_SHOWN = 100


def section(found: ResultFolder) -> Section:
    """What the log, the store and the table of jobs hold."""
    title, question = "Provenance", "Which program, data and machine, at what cost, and how to make it again?"
    blocks: list[Block] = []
    if found.runs:
        run = found.runs[-1]
        blocks.append(Facts([*_program(run), *_costs(found)]))
        blocks.append(_again(found, run))
        if isinstance(run.get("study_text"), str):
            blocks.append(Code(f"The study, {one_line(str(run.get('study_file', '')))}", run["study_text"], open=False))
        packages = run.get("packages")
        if isinstance(packages, dict):
            rows = [[str(name), str(version)] for name, version in packages.items()]
            blocks.append(Table("Versions of packages", ["package", "version"], rows, words=(1,), open=False))
        if len(found.runs) > 1:
            rows = [[str(each.get("asctime", "")), _words(each.get("tasks")), str(each.get("version", "")),
                     str(each.get("machine", ""))] for each in found.runs[-RUNS_SHOWN:]]  # fmt: skip
            title = "All runs" if len(rows) == len(found.runs) else f"The last {RUNS_SHOWN} of {len(found.runs):,} runs"
            blocks.append(Table(title, ["began", "tasks", "sinew", "machine"], rows, words=(1, 2, 3), open=False))
    else:
        blocks.append(Words("The log does not say who ran this: it is missing, or of an older version.", "note"))
        blocks.append(Facts(_costs(found)))
    rows = [
        [task, state.word, duration(state.seconds), number(state.evaluations), str(_inputs(found, task))]
        for task, state in found.states.items()
        if state.word != "not run"
    ]
    if rows:
        header = ["task", "state", "time of the last run", "new evaluations", "hash of its inputs"]
        blocks.append(Table("Tasks", header, rows, words=(1, 4)))
    hashes = _hashes(found)
    if hashes:
        header = ["specimen", "simulator", "evaluations", "curves"]
        blocks.append(Table("Hashes of data and evaluations", header, hashes, words=(1, 2, 3), open=False))
    return Section("provenance", title, question, blocks)


def _program(run: dict[str, Any]) -> list[tuple[str, str]]:
    names = {
        "version": "sinew",
        "code": "hash of the program",
        "python": "Python",
        "machine": "machine",
        "system": "system",
        "processor": "processor",
        "cores": "cores",
        "memory_GB": "memory (GB)",
        "seed": "seed",
        "simulator": "simulator",
        "cluster": "cluster",
        "slurm_job": "job",
        "cohort": "cohort",
        "cohort_hash": "hash of the cohort",
        "study_hash": "hash of the study file",
        "template_hash": "hash of the template",
        "asctime": "last run began",
    }
    return [(label, one_line(str(run[name]))) for name, label in names.items() if run.get(name) not in (None, "")]


def _costs(found: ResultFolder) -> list[tuple[str, str]]:
    if found.status is None:
        return []
    cost = found.status["core_hours"]
    rows = sum(table["rows"] for table in found.status["tables"])
    done = sum(table["done"] for table in found.status["tables"])
    facts = [
        ("evaluations", f"{done:,} of {rows:,} planned"),
        ("core-hours in evaluations", number(cost["evaluations"])),
    ]
    if found.status["jobs"]:
        facts.append(("core-hours of jobs", number(cost["jobs"])))
        facts.append(("jobs", ", ".join(f"{job['job']} ({job['state']})" for job in found.status["jobs"][-12:])))
    return facts


def _again(found: ResultFolder, run: dict[str, Any]) -> Code:
    """Commands that make the same numbers again: seed and study decide them, not the number of workers."""
    study = shlex.quote(one_line(str(run.get("study_file", "study.yaml"))))
    simulator = None if run.get("simulator") in of_own_models() else run.get("simulator")  # the study names those
    options = {"--data": run.get("cohort") or None, "--seed": run.get("seed"), "--simulator": simulator}
    quoted = {name: shlex.quote(one_line(str(value))) for name, value in options.items() if value is not None}
    given = " ".join(f"{name} {value}" for name, value in quoted.items())
    asked = dict.fromkeys(
        tuple(map(str, each["tasks"]))
        for each in found.runs
        if isinstance(each.get("tasks"), list) and {*map(str, each["tasks"])} <= {*TASKS, "simulate"}
    )
    commands = [tasks[0] if len(tasks) == 1 else "run" for tasks in asked]
    lines = [_install(run["install"])] if run.get("install") else []  # logs of 0.1 do not say
    lines += [f"sinew {command} {study} {given} --out AGAIN" for command in dict.fromkeys(commands)]
    name = shlex.quote(found.folder.resolve().name)
    lines += [f"# compare with {name}, the folder of this page"] if found.results else []
    lines += [f"cmp AGAIN/{task}.json {name}/{task}.json" for task in found.results]
    return Code("How to make it again", "\n".join(lines))


def _install(said: Any) -> str:
    """The command that installed the program, as the log says; what anybody may have written there is a comment."""
    ours = re.fullmatch(rf"pip install {re.escape(DISTRIBUTION)}==[A-Za-z0-9][A-Za-z0-9.+!_-]*", str(said))
    return str(said) if ours or said == install_command() else f"# installed by: {brief(str(said))}"


def _inputs(found: ResultFolder, task: str) -> str:
    result = found.results.get(task)
    return "–" if result is None else result.inputs


def _hashes(found: ResultFolder) -> list[list[str]]:
    rows = []
    for name, tables in found.tables.items():
        for table in tables:
            identity = table.identity
            simulator = identity["simulator"]
            engine = f"{simulator.get('name', '')} {simulator.get('version', '')}".strip()
            curves = ", ".join(f"{protocol} {digest}" for protocol, digest in identity["specimen"]["curves"].items())
            rows.append([name, engine, table.key, curves])
    return rows


def _words(names: Any) -> str:
    return ", ".join(map(str, names)) if isinstance(names, list) else ""
