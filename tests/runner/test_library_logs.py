"""What libraries log does not reach the terminal, and everything is as before afterwards."""

import logging

from distributed.utils import silence_logging_cmgr

from sinew.runner.library_logs import libraries_log_to


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
