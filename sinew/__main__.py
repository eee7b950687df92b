"""``python -m sinew`` and ``sinew``: the command."""

import logging
import signal

_INTERRUPTED = signal.getsignal(signal.SIGINT)  # ignored by commands that a shell starts in the background
if _INTERRUPTED is signal.default_int_handler:
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # Ctrl-C during the imports would print a traceback

from sinew.runner.library_logs import let_libraries_log_to  # noqa: E402 - as the imports take their time
from sinew.tasks.cli.main import main  # noqa: E402


def command() -> None:
    """The command, which ends silently once it has said its last word."""
    signal.signal(signal.SIGINT, _INTERRUPTED)
    try:
        main()
    finally:
        let_libraries_log_to(logging.NullHandler())
        if _INTERRUPTED is signal.default_int_handler:
            signal.signal(signal.SIGINT, signal.SIG_DFL)


if __name__ == "__main__":
    command()
