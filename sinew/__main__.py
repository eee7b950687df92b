"""``python -m sinew`` and ``sinew``: the command."""

import codecs
import logging
import os
import signal
import sys

_INTERRUPTED = signal.getsignal(signal.SIGINT)  # ignored by commands that a shell starts in the background
if _INTERRUPTED is signal.default_int_handler:
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # Ctrl-C during the imports would print a traceback

from sinew.runner.one_thread import use_one_thread  # noqa: E402

use_one_thread()

from sinew.runner.library_logs import let_libraries_log_to  # noqa: E402 - as the imports take their time
from sinew.tasks.cli.main import main  # noqa: E402


def command() -> None:
    """The command, which ends silently once it has said its last word."""
    _begin_again_in_utf8()
    signal.signal(signal.SIGINT, _INTERRUPTED)
    try:
        main()
    finally:
        let_libraries_log_to(logging.NullHandler())
        if _INTERRUPTED is signal.default_int_handler:
            signal.signal(signal.SIGINT, signal.SIG_DFL)


def _begin_again_in_utf8() -> None:
    """Start again in UTF-8 where the locale knows ASCII only: names of files could not be sent to workers or shown."""
    if not sys.flags.utf8_mode and codecs.lookup(sys.getfilesystemencoding()).name == "ascii" and sys.executable:
        os.environ["PYTHONUTF8"] = "1"  # also for the processes that are started from here
        os.execv(sys.executable, [sys.executable, "-X", "utf8", *sys.orig_argv[1:]])


if __name__ == "__main__":
    command()
