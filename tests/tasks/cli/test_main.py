"""What the command prints: in every locale, in lines of a bounded length, and nothing that steers the terminal."""

import os
import subprocess
import sys
import tempfile
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from sinew.runner.evaluation.external import Stopped
from sinew.runner.store.store import Store
from sinew.tasks.cli import main
from tests.runner.evaluations import table_spec
from tests.runner.stores import fill, some

LINE = (
    "from sinew.tasks.cli.main import _print_anything; _print_anything(); "
    "print('12 \\u00b1 3 \\u00b5m'); print('na\\u00efve \\u529b')"
)


@pytest.mark.parametrize(
    ("locale", "encoding", "printed"),
    [
        ({"LC_ALL": "C"}, "utf-8", "12 ± 3 µm\nnaïve 力\n"),
        ({"PYTHONIOENCODING": "latin-1"}, "latin-1", "12 ± 3 µm\nnaïve ?\n"),
        ({"LC_ALL": "C.UTF-8"}, "utf-8", "12 ± 3 µm\nnaïve 力\n"),
    ],
)
def test_units_are_printed_in_every_locale(locale, encoding, printed):
    plain = {name: value for name, value in os.environ.items() if not name.startswith(("LC_", "LANG", "PYTHON"))}
    environment = plain | {"PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"} | locale
    done = subprocess.run([sys.executable, "-c", LINE], env=environment, capture_output=True, check=True)
    assert done.stdout.decode(encoding) == printed
    assert done.stderr == b""


def test_an_error_without_a_file_is_said_without_one(monkeypatch, capsys):
    """A solver that somebody stopped has no file name."""
    monkeypatch.setattr(main, "sinew", type("Command", (), {"main": stops}))
    with pytest.raises(SystemExit, match="2"):
        main.main()
    assert capsys.readouterr().err == "sinew: solver was ended by SIGTERM\n"


def stops(**_: object) -> None:
    raise Stopped("solver was ended by SIGTERM")


def refused(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *words: str) -> str:
    monkeypatch.setattr(sys, "argv", ["sinew", *words])
    with pytest.raises(SystemExit) as left:
        main.main()
    assert left.value.code == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert len(line) <= 300
    return line


def test_a_long_error_is_shortened(monkeypatch, capsys, tmp_path):
    (tmp_path / "study.yaml").write_text(f"name: a\n? {'k' * 900}\n: 1\n")
    line = refused(monkeypatch, capsys, "run", str(tmp_path / "study.yaml"))
    assert line.startswith(f"sinew: {tmp_path}/study.yaml: ")
    assert refused(monkeypatch, capsys, "x" * 100_000)
    assert refused(monkeypatch, capsys, "run", "y" * 100_000)


@pytest.mark.parametrize(
    "words", [("cohort", "--out", ""), ("run", ""), ("status", ""), ("import", "a.csv", "--out", "")]
)
def test_an_empty_path_is_no_path(monkeypatch, capsys, tmp_path, words):
    monkeypatch.chdir(tmp_path)
    assert "an empty path; expected a name" in refused(monkeypatch, capsys, *words)
    assert not list(tmp_path.iterdir())


def test_titles_do_not_steer_the_terminal(monkeypatch, capsys, tmp_path):
    with Store.writing(tmp_path, "study \x1b[2J") as store:
        fill(store.table(table_spec("\x1b]0;title\x07")), some(2))
    for options in (["--rows"], [], ["--json"]):
        monkeypatch.setattr(sys, "argv", ["sinew", "status", str(tmp_path), *options])
        main.main()
        shown = capsys.readouterr().out
        assert "\x1b" not in shown
        assert "\x07" not in shown
        assert "title" in shown


@pytest.mark.parametrize("slow", [False, True])
def test_ctrl_c_in_a_callback_that_cannot_raise_is_not_lost(slow):
    """On a slow machine, the signal comes again before its first one is dealt with: here always, several times."""
    script = (
        "import gc, signal, threading, time\n"
        "from sinew.tasks.cli import main as cli\n"
        "class AtOnce(threading.Timer):\n"
        "    def start(self):\n"
        "        super().start() if len(done) > 3 else done.append(1) or signal.raise_signal(signal.SIGINT)\n"
        "def callback(phase, info):\n"
        "    if phase == 'start' and not done: done.append(1); signal.raise_signal(signal.SIGINT)\n"
        "def work(*_, **__):\n"
        "    gc.callbacks.append(callback); gc.collect(); print('went on', flush=True)\n"
        "    while True: time.sleep(0.01)\n"
        "done = []\n"
        f"if {slow}: threading.Timer = AtOnce\n"
        "cli.sinew.main = work\n"
        "cli.main()\n"
    )
    ended = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert ended.returncode == 130
    assert ended.stderr.splitlines() == [
        "sinew: interrupted; run the same command again; rows that were evaluated are kept"
    ]


def test_memory_that_is_not_there_is_one_line(monkeypatch, capsys):
    def work(*_, **__):
        np.empty(2**59)

    monkeypatch.setattr(main.sinew, "main", work)
    with pytest.raises(SystemExit) as ended:
        main.main()
    assert ended.value.code == 2
    assert capsys.readouterr().err.startswith("sinew: not enough memory (Unable to allocate 4.00 EiB")


def test_other_errors_that_cannot_be_raised_are_logged_and_not_printed():
    script = (
        "import gc, logging\n"
        "from sinew.tasks.cli import main as cli\n"
        "class Odd:\n"
        "    def __del__(self): raise ValueError('odd\\n')\n"
        "def work(*_, **__):\n"
        "    log = logging.getLogger('sinew'); log.addHandler(logging.FileHandler('log')); odd = Odd(); del odd\n"
        "cli.sinew.main = work\n"
        "cli.main()\n"
    )
    with tempfile.TemporaryDirectory() as folder:
        ended = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, cwd=folder)
        logged = Path(folder, "log").read_text()
    assert (ended.returncode, ended.stdout, ended.stderr) == (0, "", "")
    assert "an error that could not be raised" in logged


@pytest.mark.parametrize(("interrupted", "code"), [(True, 130), (False, 1)])
def test_an_error_that_ctrl_c_became_is_ctrl_c(interrupted, code):
    script = (
        "import signal\n"
        "from sinew.tasks.cli import main as cli\n"
        "def work(*_, **__):\n"
        "    try:\n"
        f"        signal.raise_signal(signal.SIGINT) if {interrupted} else None\n"
        "    except KeyboardInterrupt: pass\n"
        "    raise SystemError('initialization of _interpnd raised unreported exception')\n"
        "cli.sinew.main = work\n"
        "cli.main()\n"
    )
    ended = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert ended.returncode == code
    assert ("Traceback" in ended.stderr) != interrupted
    assert interrupted == (ended.stderr == f"sinew: {main.INTERRUPTED}\n")


def test_an_error_that_cannot_be_raised_is_logged_whatever_its_object_is(caplog):
    """Python refuses to print an integer of thousands of digits: that was a traceback from the hook itself."""
    huge = 10**20_000
    main._unraisable(SimpleNamespace(exc_type=ValueError, exc_value=ValueError(huge), object=huge))
    (record,) = caplog.records
    assert record.reason == "ValueError: a number of thousands of digits in a number of thousands of digits"
