"""How far a run has come, for progress reports."""

from dataclasses import dataclass

from sinew.runner.progress import Report


@dataclass
class Counts:
    """Rows of a run: ``total`` (at most, for adaptive runs), ``done`` (earlier calls included), failed, running."""

    report: Report | None
    total: int
    failed: int
    done: int = 0
    running: int = 0

    def show(self) -> None:
        """Report the numbers."""
        if self.report is not None:
            self.report(self.done, self.failed, self.running)
