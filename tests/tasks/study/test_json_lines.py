"""Log records as lines of JSON."""

import json
import logging
import sys

import pytest

from sinew.tasks.study.json_lines import JsonLines, LogFile


def record(message: str, arguments: tuple = (), extra: dict | None = None, error=None) -> logging.LogRecord:
    return logging.getLogger("sinew").makeRecord("sinew", 30, "f", 1, message, arguments, error, extra=extra)


def test_a_record_is_one_line_with_its_fields_in_order():
    line = JsonLines().format(record("job %s", ("a\n",), {"rows": (1, 2.5), "error": "\u2028é"}))
    assert "\n" not in line
    assert list(json.loads(line).items())[1:] == [
        *(("levelname", "WARNING"), ("name", "sinew"), ("message", "job a\n")),
        *(("rows", [1, 2.5]), ("error", "\u2028é")),
    ]
    assert line.isascii()


def test_an_exception_is_a_field():
    try:
        raise ValueError("wrong")
    except ValueError:
        found = json.loads(JsonLines().format(record("m", error=sys.exc_info())))
    assert found["exc_info"].endswith("ValueError: wrong")


def test_a_full_disk_leaves_no_traceback_on_the_terminal(tmp_path, capsys):
    handler = LogFile(tmp_path / "log.jsonl")
    with open("/dev/full", "w") as full:
        handler.setStream(full).close()
        handler.handle(record("lost"))
        handler.close()
    assert capsys.readouterr() == ("", "")


def test_the_lines_are_in_the_file(tmp_path):
    handler = LogFile(tmp_path / "log.jsonl")
    handler.handle(record("kept"))
    handler.close()
    (line,) = (tmp_path / "log.jsonl").read_text().splitlines()
    assert json.loads(line)["message"] == "kept"


def test_a_link_that_appears_is_not_followed(tmp_path):
    (tmp_path / "victim").write_text("precious")
    (tmp_path / "log.jsonl").symlink_to(tmp_path / "victim")
    with pytest.raises(OSError, match="is a link; remove it"):
        LogFile(tmp_path / "log.jsonl")
    assert (tmp_path / "victim").read_text() == "precious"
