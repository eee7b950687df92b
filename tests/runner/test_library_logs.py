"""What libraries log does not reach the terminal, and everything is as before afterwards."""

import asyncio
import gc
import json
import logging
import warnings
from pathlib import Path

from distributed.utils import silence_logging_cmgr

from sinew.runner.library_logs import libraries_log_to, warnings_are_logged
from sinew.tasks.study.json_lines import LogFile


class Kept(logging.Handler):
    def __init__(self) -> None:
        super().__init__()
        self.words: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        self.words.append(record.getMessage())


def test_what_libraries_log_goes_to_the_handler_alone(capfd):
    """Dask's loggers may have handlers of their own, at any depth."""
    own = logging.StreamHandler()
    inner = logging.getLogger("tornado.application.of_a_test")
    inner.addHandler(own)
    names = ("distributed.worker", "tornado.application", "tornado.application.of_a_test", "asyncio")
    kept = Kept()
    before = {name: (logging.getLogger(name).handlers, logging.getLogger(name).propagate) for name in names}
    with libraries_log_to(kept):
        for name in names:
            logging.getLogger(name).error(name)
        logging.getLogger("somebody.else").error("not theirs")
    assert kept.words == list(names)
    assert "tornado" not in capfd.readouterr().err
    assert {n: (logging.getLogger(n).handlers, logging.getLogger(n).propagate) for n in names} == before
    inner.removeHandler(own)


def test_the_handler_keeps_its_own_level():
    """Dask sets the level of what it finds while a cluster is open."""
    kept = Kept()
    kept.setLevel(logging.INFO)
    with libraries_log_to(kept), silence_logging_cmgr(logging.ERROR):
        assert kept.level == logging.INFO


def logged(handler: logging.Handler, tmp_path: Path) -> list[dict]:
    handler.close()
    return [json.loads(line) for line in (tmp_path / "log").read_text().splitlines()]


def test_what_nobody_waited_for_is_one_clear_line(tmp_path):
    """Dask waits for workers without looking at how that ended."""

    async def fails() -> None:
        raise RuntimeError("Nanny failed to start worker process\nand more") from KeyError("this")

    async def run() -> None:
        await asyncio.wait([asyncio.create_task(fails())])
        gc.collect()

    handler = LogFile(tmp_path / "log")
    with libraries_log_to(handler):
        asyncio.run(run())
    (line,) = logged(handler, tmp_path)
    assert line["message"] == "a task of a library failed, and nobody waited for it"
    assert line["reason"] == "RuntimeError: Nanny failed to start worker process\\nand more"
    assert line["cause"] == "KeyError: 'this'"
    assert "exc_info" not in line


def test_an_error_of_a_library_is_logged_without_its_traceback(tmp_path):
    handler = LogFile(tmp_path / "log")
    with libraries_log_to(handler):
        log = logging.getLogger("distributed.nanny")
        try:
            raise ValueError("x" * 5000)
        except ValueError:
            log.exception("Failed %s\nfuture: <Task>", "here")
        log.error("of two lines\nthe second")
    first, second = logged(handler, tmp_path)
    assert (first["name"], first["message"], second["message"]) == ("distributed.nanny", "Failed here", "of two lines")
    assert first["where"].startswith("test_library_logs.py:")
    assert second["reason"] == "the second"
    assert len(json.dumps(first)) < 700


def test_warnings_of_libraries_are_logged_and_not_shown(tmp_path, capfd):
    handler = LogFile(tmp_path / "log")
    logger = logging.getLogger("sinew")
    logger.addHandler(handler)
    before = warnings.showwarning
    with warnings.catch_warnings(), warnings_are_logged():
        warnings.simplefilter("always")
        warnings.warn("Object at x\nis not recognized", UserWarning, stacklevel=1)
    logger.removeHandler(handler)
    assert warnings.showwarning is before
    (line,) = logged(handler, tmp_path)
    assert (line["message"], line["reason"]) == ("a library warns", "UserWarning: Object at x\\nis not recognized")
    assert capfd.readouterr().err == ""
