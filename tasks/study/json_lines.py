"""Log records as lines of JSON."""

import io
import json
import logging
import sys
from contextlib import suppress
from pathlib import Path

from sinew.runner.files import append_file

_OF_EVERY_RECORD = frozenset(vars(logging.makeLogRecord({}))) | {"message", "asctime", "taskName"}


class JsonLines(logging.Formatter):
    """One object a line: the time, the level, the logger and the message, then the ``extra`` fields of the record."""

    def format(self, record: logging.LogRecord) -> str:
        line = {
            "asctime": self.formatTime(record),
            "levelname": record.levelname,
            "name": record.name,
            "message": record.getMessage(),
        }
        line |= {name: value for name, value in vars(record).items() if name not in _OF_EVERY_RECORD}
        if record.exc_info:
            line["exc_info"] = self.formatException(record.exc_info)
        return json.dumps(line, default=str)


class LogFile(logging.FileHandler):
    """A file of such lines. What cannot be written, because the disk is full, is lost without a word.

    Results are on the same disk: who cannot write those says so in one line, which tracebacks of the log would hide.
    Raises ``OSError`` for a link, a pipe or a device.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path, encoding="utf-8")
        self.setFormatter(JsonLines())

    def _open(self) -> io.TextIOWrapper:
        return io.TextIOWrapper(append_file(Path(self.baseFilename)), encoding="utf-8")

    def handleError(self, record: logging.LogRecord) -> None:
        """Nothing for a disk that takes no more; a traceback for mistakes of the program."""
        if not isinstance(sys.exc_info()[1], OSError):
            super().handleError(record)

    def close(self) -> None:
        """Close the file; lines that the disk did not take are still in its buffer."""
        with suppress(OSError):
            super().close()
