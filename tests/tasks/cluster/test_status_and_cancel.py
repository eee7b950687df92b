"""``sinew status`` and ``sinew cancel`` on damaged folders and with a SLURM that does not answer."""

import csv
import json
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zarr

from sinew.runner.store.store import Store
from sinew.tasks.report.status import rows_as_csv
from tests.runner.evaluations import table_spec
from tests.runner.stores import fill, some
from tests.tasks.cli.bad_input import folder_for_file, link, listing, write
from tests.tasks.cluster.stand_in_slurm import (
    SUBMIT,
    answer,
    calls,
    job_name,
    queue,
)


def make_results() -> None:
    """A result folder without any table, which a job leads."""
    with Store.writing(Path("out"), "check"):
        pass
    write_jobs()


def write_jobs(*damages: bytes) -> None:
    """The table of jobs of the folder ``out``, with ``damages`` between its two lines."""
    first = JOB_LINES[0].replace("sinew-check", job_name()).encode()
    write("out/jobs/jobs.jsonl", b"".join([first, *damages, b"\n", JOB_LINES[1].encode()]))


JOB_LINES = (
    '{"time": 1000.5, "job": "5", "event": "submitted", "role": "coordinator", "name": "sinew-check", "cores": 1}\n',
    '{"time": 2000.5, "job": "5", "event": "started", "role": "coordinator", "nodes": "n1"}\n',
)
PROGRESS = {
    "title": "s01",
    "done": 3,
    "total": 9,
    "failed": 1,
    "running": 2,
    "rows_per_s": 1.5,
    "eta_s": 4.0,
    "time": 1e9,
}
ALIVE = PROGRESS | {"time": 1e11}


def strict_json(text: str) -> Any:
    def not_json(name: str) -> None:
        raise AssertionError(f"{name} is no JSON")

    return json.loads(text, parse_constant=not_json)


@pytest.mark.parametrize("command", ["status", "cancel"])
@pytest.mark.parametrize("name", ["nowhere", "study.yaml", "cohort", "no\nwhere", "x" * 300, "empty"])
def test_no_result_folder(refused, command, name):
    folder_for_file("empty")
    refused((command, name), "")


def test_cancel_where_no_jobs_are(sinew):
    """Results of a run on this machine."""
    with Store.writing(Path("out"), "check"):
        pass
    sinew("cancel", "out")
    assert calls() == []
    assert "nothing runs" in sinew("status", "out").out


def test_status_of_a_study_that_waits_in_the_queue(accepted):
    assert "follow it by `sinew status out`" in accepted(*SUBMIT)
    assert "waiting" in accepted("status", "out")
    assert strict_json(accepted("status", "out", "--json"))["jobs"][0]["job"] == "123"


DAMAGE = {
    "nothing": b"",
    "empty lines": b"\n\n\n",
    "garbage": b"garbage\n",
    "binary": bytes(range(256)) * 4,
    "UTF-16": JOB_LINES[0].encode("utf-16"),
    "a cut line": JOB_LINES[0][:40].encode(),
    "a cut line and more": JOB_LINES[0][:40].encode() + JOB_LINES[0].encode(),
    "null": b"null\n",
    "a number": b"5\n",
    "a text": b'"job"\n',
    "a list": b"[1, 2]\n",
    "no fields": b"{}\n",
    "deep": b"[" * 100_000 + b"\n",
    "deep in a field": b'{"time": 1, "event": "ended", "job": ' + b"[" * 100_000 + b"\n",
    "a long line": b'{"time": 1, "job": "' + b"9" * 10**6 + b'", "event": "submitted"}\n',
}
FACT = {"time": 3.0, "job": "7", "event": "started", "role": "worker", "nodes": "n2", "cores": 2, "end": "done"}
ODD = [
    "null",
    "true",
    "[]",
    "{}",
    '""',
    '"x"',
    "-1",
    "0",
    "NaN",
    "Infinity",
    "-Infinity",
    "1e308",
    "1e999",
    f"1{'0' * 400}",
]
ODD += [
    f"-1{'0' * 400}",
    f"1{'0' * 5000}",
    '"\\u001b[31m\\u0007"',
    '"a\\nb"',
    '"\\ud800"',
    '"[red]x[/red]"',
    '"[/]"',
    '"\\u202e"',
]


def with_fact(facts: dict[str, Any], field: str, value: str) -> bytes:
    """A line of JSON with the text ``value`` for a field."""
    cells = (f'"{name}": {value if name == field else json.dumps(fact)}' for name, fact in facts.items())
    return f"{{{', '.join(cells)}}}\n".encode()


TABLES = {
    **{name: [damage] for name, damage in DAMAGE.items()},
    **{field: [with_fact(FACT, field, value) for value in ODD] for field in FACT},
}


@pytest.mark.parametrize("damages", TABLES.values(), ids=TABLES)
def test_damaged_table_of_jobs(sinew, damages):
    make_results()
    answer("squeue", f"echo '{queue()}'")
    problems: dict[Any, str] = {}
    for damage in damages:
        write_jobs(damage)
        with collected_from(problems, damage):
            said = sinew("status", "out")
            assert (said.code, said.err) == (0, "")
            assert "coordinator" in said.out
            found = strict_json(sinew("status", "out", "--json").out)
            assert [job["state"] for job in found["jobs"] if job["job"] == "5"] == ["running"]
            assert all(job["core_hours"] >= 0 for job in found["jobs"])
    assert problems == {}
    assert calls() == []


@pytest.mark.parametrize("damages", TABLES.values(), ids=TABLES)
def test_cancel_with_a_damaged_table_of_jobs(sinew, here, damages):
    write_jobs(*damages)
    answer("squeue", f"echo '{queue()}'")
    before = listing(here)
    said = sinew("cancel", "out")
    assert (said.code, said.err) == (0, "")
    assert said.out.startswith(f"job 5 ({job_name()}, RUNNING) is cancelled\n1 jobs cancelled; ")
    assert calls()[-1] == "scancel --quiet 5"
    assert listing(here) == before


@contextmanager
def collected_from(problems: dict[Any, str], damage: bytes) -> Iterator[None]:
    try:
        yield
    except Exception as error:
        problems[damage[:150].decode(errors="replace")] = f"{type(error).__name__}: {error}"[:200]


def test_a_number_that_belongs_to_another_job_now(accepted):
    make_results()
    answer("squeue", f"echo '5|RUNNING|None|n1|a colleague'; echo '6|RUNNING|None|n1|{job_name()}'")
    assert accepted("cancel", "out").startswith("0 jobs cancelled")
    assert len(calls()) == 1


@pytest.mark.parametrize("answered", ["garbage", "||||", "5", "5|RUNNING", "", "\x1b[31m", "5|GONE|None|n1|NAME"])
def test_squeue_that_talks_nonsense(accepted, answered):
    make_results()
    write("../bin/words", answered.replace("NAME", job_name()))
    answer("squeue", "/bin/cat ../bin/words")
    assert accepted("cancel", "out").startswith("0 jobs cancelled")


@pytest.mark.parametrize(
    ("command", "said", "told"),
    [
        ("squeue", "echo 'slurm_load_jobs error: Unable to contact slurm controller' >&2; exit 1", "does not answer"),
        ("squeue", "echo 'squeue: error: odd' >&2; exit 1", "odd"),
        ("scancel", "echo 'scancel: error: Kill job error on job id 5: Access denied' >&2; exit 1", "Access denied"),
    ],
)
def test_cancel_that_slurm_refuses(sinew, command, said, told):
    make_results()
    answer("squeue", f"echo '{queue()}'")
    answer(command, said)
    result = sinew("cancel", "out")
    assert (result.code, result.out, result.err.count("\n")) == (2, "", 1)
    assert told in result.err
    assert "submit" not in result.err
    assert "SLURM refuses the job:" not in result.err, "no job was refused"


@pytest.mark.parametrize("kind", ["a folder", "a link to itself"])
def test_table_of_jobs_that_is_no_file(refused, kind):
    make_results()
    folder_for_file("out/jobs/jobs.jsonl") if kind == "a folder" else link("out/jobs/jobs.jsonl", "jobs.jsonl")
    refused(("cancel", "out"), "out/jobs/jobs.jsonl: ")
    refused(("status", "out"), "out/jobs/jobs.jsonl: ")


PROGRESSES = {
    **{name: [damage] for name, damage in DAMAGE.items()},
    "a field missing": [
        json.dumps({name: fact for name, fact in PROGRESS.items() if name != field}).encode() for field in PROGRESS
    ],
    **{field: [with_fact(PROGRESS, field, value) for value in ODD] for field in PROGRESS},
    **{f"{field}, alive": [with_fact(ALIVE, field, value) for value in ODD] for field in PROGRESS},
}


@pytest.mark.parametrize("contents", PROGRESSES.values(), ids=PROGRESSES)
def test_damaged_progress(sinew, contents):
    make_results()
    problems: dict[Any, str] = {}
    for content in contents:
        write("out/progress.json", content)
        with collected_from(problems, content):
            said = sinew("status", "out")
            assert (said.code, said.err) == (0, "")
            assert "finished: nothing yet" in said.out
            assert strict_json(sinew("status", "out", "--json").out)["study"] == "check"
    assert problems == {}


def test_words_of_a_worker_are_one_cell_and_no_formula(tmp_path):
    with Store.writing(tmp_path, "study") as store:
        table = store.table(table_spec('a,b "c"'))
        fill(table, some(2))
        group = zarr.open_group(tmp_path / "store.zarr", mode="r+")
        group[f"evaluations/{table.name}/worker"][:] = np.array(["=cmd|'/C calc',x:1,2 job 7\n8", "-1:2"], dtype=object)
    rows = list(csv.DictReader(rows_as_csv(tmp_path)))
    assert [row["table"] for row in rows] == ['specimen a,b "c"'] * 2
    assert [row["node"] for row in rows] == ["'=cmd|'/C calc',x", "'-1"]
    assert [row["job"] for row in rows] == ["7\\n8", ""]
    assert [row["status"] for row in rows] == ["ok", "ok"]


def test_of_very_many_jobs_some_are_shown(sinew):
    make_results()
    line = JOB_LINES[0].encode()
    number = json.loads(line)["job"]
    lines = [line.replace(f'"{number}"'.encode(), f'"{i}"'.encode()) for i in range(30_000)]
    write("out/jobs/jobs.jsonl", b"\n".join(lines) + b"\n")
    said = sinew("status", "out")
    assert said.code == 0
    assert len(said.out.splitlines()) < 60
    assert re.search(r"29,9\d\d more jobs: see --json", said.out)
