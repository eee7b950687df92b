"""Helpers for tests with a store: parameters, evaluation in this process, and the files of a store."""

from pathlib import Path

import numpy as np

from sinew.runner.evaluation.ensemble import evaluate
from sinew.runner.store.table import Table
from tests.runner.evaluations import Quick


def fill(table: Table, parameters: np.ndarray, evaluation: Quick | None = None) -> np.ndarray:
    """Evaluate in this process."""
    rows = table.plan(parameters)
    evaluate(lambda: None, table, evaluation or Quick(), rows)
    return rows


def some(count: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).random((count, 2))


def contents(folder: Path) -> dict[str, bytes]:
    """Every file of a store except what differs between equal runs: when, where and how often rows were tried."""
    provenance = ("wall_seconds", "worker", "attempts")
    files = [file for file in sorted(folder.rglob("*")) if file.is_file()]
    return {str(f.relative_to(folder)): f.read_bytes() for f in files if not set(f.parts) & set(provenance)}
