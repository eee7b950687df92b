"""What a command tells of its work: a file that is whole at any time, cheap, and says how it ended."""

import json
import os
import re
import socket
import threading

import pytest

from sinew.runner.cluster.dashboard import way_to
from sinew.runner.errors import WalltimeReached
from sinew.runner.progress import is_here, open_board, progress, read_progress
from tests.effort import at_most


def test_the_file_says_what_runs_and_how_far_it_is(tmp_path):
    with open_board(tmp_path) as board, progress("count", 4, board, of="fits", show="nothing") as report:
        board.put(tasks={"sobol": "running"}, dashboard={"host": "node7", "port": 8787})
        report(3, 1, 2)
        board.note("sobol", "s01", "best 2 N", value=2.0)
        board.write()
        told = read_progress(tmp_path)
        assert told is not None
        assert (told["state"], told["of"], told["done"], told["failed"], told["running"]) == (
            "running",
            "fits",
            3,
            1,
            2,
        )
        assert told["notes"] == {"sobol": {"s01": {"words": "best 2 N", "value": 2.0}}}
        assert told["process"]["pid"] == os.getpid()
    told = read_progress(tmp_path)
    assert told is not None
    assert (told["state"], told["dashboard"], told["error"]) == ("finished", None, "")
    assert [path.name for path in tmp_path.iterdir()] == ["progress.json"]


def test_more_rows_than_were_expected_are_no_part_of_fewer(tmp_path, capsys):
    with open_board(tmp_path) as board, progress("infer", 4, board) as report:
        for done, total in ((3, 4), (7, 7)):
            report(done, 0, 1)
            board.write()
            told = read_progress(tmp_path)
            assert told is not None
            assert (told["done"], told["total"], told["eta_s"] >= 0.0) == (done, total, True)
    assert "infer: 7 of 7 rows" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("error", "state", "words"),
    [
        (ValueError("boom"), "failed", "boom"),
        (KeyboardInterrupt(), "interrupted", ""),
        (SystemExit(143), "interrupted", ""),
        (WalltimeReached("the walltime is near"), "interrupted", "the walltime is near"),
    ],
)
def test_it_says_how_it_ended(tmp_path, error, state, words):
    with pytest.raises(type(error)), open_board(tmp_path):
        raise error
    told = read_progress(tmp_path)
    assert told is not None
    assert (told["state"], told["error"]) == (state, words)


@pytest.mark.parametrize("since", [10**400, -1, 1e300, float("nan"), "now"])
def test_a_process_that_began_at_no_time_is_not_judged(since):
    process = {"host": socket.gethostname(), "pid": os.getpid(), "since": since}
    assert is_here(process) is None


def test_notes_cost_next_to_nothing_and_threads_may_share_a_board(tmp_path):
    with open_board(tmp_path) as board:
        written = board._written
        with at_most(3):  # 150 us for each note would be felt
            threads = [
                threading.Thread(
                    target=lambda n=n: [board.note("t", f"s{n}-{i % 50}", "x", value=i) for i in range(5000)]
                )
                for n in range(4)
            ]
            for thread in threads:
                thread.start()
            for _ in range(20):
                board.write()
                json.loads((tmp_path / "progress.json").read_text())
            for thread in threads:
                thread.join()
        assert board._written > written
        board.write()
        told = read_progress(tmp_path)
    assert told is not None
    assert len(told["notes"]["t"]) == 200


def test_the_file_is_written_rarely(tmp_path, monkeypatch):
    writes = []
    monkeypatch.setattr(os, "replace", lambda source, target: writes.append(source))
    with open_board(tmp_path) as board, progress("count", 10_000, board, show="nothing") as report:
        for done in range(10_000):
            report(done, 0, 1)
        assert len(writes) <= 2 + 10


def test_lines_where_there_is_no_terminal(tmp_path, capsys):
    with open_board(tmp_path) as board, progress("count", 2, board, of="fits") as report:
        board.note("t", "s01", "best 2 N")
        report(2, 0, 0)
    said = capsys.readouterr()
    assert re.fullmatch(r"count: 2 of 2 fits, [\d.,e+]+ fits/s; s01: best 2 N\n", said.err)
    with open_board(tmp_path) as board, progress("count", 2, board, show="json") as report:
        report(2, 1, 0)
    said = capsys.readouterr()
    (line,) = said.out.splitlines()
    assert (said.err, json.loads(line)["event"], json.loads(line)["failed"]) == ("", "progress", 1)


def test_the_way_to_a_dashboard():
    there = {"host": "node7", "port": 8787}
    assert way_to(there, "node7") == "http://127.0.0.1:8787/status"
    assert way_to(there, "login") == "ssh -N -L 8787:127.0.0.1:8787 node7, then http://127.0.0.1:8787/status"
    assert way_to(None) is way_to({"host": "a; rm -rf", "port": 1}) is way_to({"host": "a"}) is None


@pytest.mark.parametrize("change", [{"done": -5}, {"running": -1}, {"total": 1e16}, {"failed": "no"}, {"time": None}])
def test_counts_that_cannot_be_are_no_progress(tmp_path, change):
    facts = {"title": "s01", "done": 3, "total": 9, "time": 1e9}
    (tmp_path / "progress.json").write_text(json.dumps(facts))
    assert read_progress(tmp_path) == facts
    (tmp_path / "progress.json").write_text(json.dumps(facts | change))
    assert read_progress(tmp_path) is None


def test_what_is_no_name_of_a_task_is_left_out(tmp_path):
    facts = {"title": "s01", "done": 3, "total": 9, "time": 1e9, "task": ["l"], "notes": {"a": {}}}
    (tmp_path / "progress.json").write_text(json.dumps(facts))
    assert read_progress(tmp_path) == {name: fact for name, fact in facts.items() if name != "task"}
