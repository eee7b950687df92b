"""Which tasks of a result folder failed, read from its log."""

import json
from dataclasses import replace

from sinew.runner.errors import LONGEST
from sinew.runner.store.store import Store
from sinew.tasks.report.status import _now, print_status, read_status, sign_of_life
from tests.runner.evaluations import table_spec
from tests.runner.stores import fill, some


def folder_with(tmp_path, *events):
    with Store.writing(tmp_path / "out", "study"):
        pass
    (tmp_path / "out" / "log.jsonl").write_text("".join(json.dumps(event) + "\n" for event in events))
    return tmp_path / "out"


def failed(task, reason):
    return {"task": task, "message": "task failed", "reason": reason}


def test_a_failed_task_is_named_with_its_reason(tmp_path, capsys):
    out = folder_with(tmp_path, failed("infer", "no draw came within \x1b[31m 0.1"), {"message": "run started"})
    found = read_status(out)
    assert list(found["failed_tasks"]) == ["infer"]
    print_status(found)
    said = capsys.readouterr().out
    assert "infer failed: no draw came within" in said
    assert "\x1b" not in said


def test_a_task_that_was_started_again_has_not_failed(tmp_path):
    again = [{"task": "infer", "message": word} for word in ("task started", "task finished")]
    for events in (again, again[:1]):
        assert read_status(folder_with(tmp_path, failed("infer", "x"), *events))["failed_tasks"] == {}
    events = (*again, failed("infer", "x"), failed("nothing", "no task"), "a text", {"task": ["infer"]})
    assert read_status(folder_with(tmp_path, *events))["failed_tasks"] == {"infer": "x"}


def test_the_reason_of_a_failed_task_is_one_short_line(tmp_path):
    reason = read_status(folder_with(tmp_path, failed("infer", "\n" + "x" * 100_000)))["failed_tasks"]["infer"]
    assert reason.startswith("\\n") and len(reason) == LONGEST


def test_texts_of_a_folder_are_short_on_the_terminal(tmp_path):
    """Words without end would be laid out line by line."""
    folder = folder_with(tmp_path, failed("sobol", "why"))
    facts = {"title": "word " * 100_000, "done": 0, "total": 1, "time": 1.0}
    (folder / "progress.json").write_text(json.dumps(facts))
    assert len(sign_of_life(folder, 2.0)["title"]) <= 300


def test_tables_of_one_title_are_told_apart(tmp_path):
    """A specimen has several tables where what its outcomes depend on has changed."""
    with Store.writing(tmp_path, "study") as store:
        for title, identity in (("a", {"noise": 1}), ("a", {"noise": 2}), ("b", {})):
            fill(store.table(replace(table_spec(title), identity=identity)), some(2))
        names = [table.name for table in store.tables()]
    told = [table["table"] for table in read_status(tmp_path)["tables"]]
    assert sorted(told) == sorted(
        [*(f"specimen a ({name.rpartition('-')[2][:6]})" for name in names if "-a-" in name), "specimen b"]
    )
    assert all("key" not in table for table in read_status(tmp_path)["tables"])


def test_what_is_left_of_a_stage_is_not_that_of_the_run():
    progress = {"title": "infer", "done": 3, "total": 9, "alive": True, "running": 2, "rows_per_s": 1.5, "eta_s": 4.0,
                "time": 100.0}  # fmt: skip
    run = {"expected_s": {"infer": 5.0, "discover": 60.0}, "tasks": {"discover": "waiting"}, "task": "infer"}
    assert _now(progress).endswith("1.5 rows/s, 4 s left for these")
    assert _now(progress | run).endswith("1.5 rows/s, 4 s left for these, about 65 s left of the run")
