"""Fixtures of the tests with real processes, and with a client that only plays a cluster."""

import secrets

import pytest

from sinew.runner.evaluation import on_cluster
from tests.runner.evaluation.solver_processes import sleeping
from tests.runner.evaluation.stand_in_client import Completed, StandIn


@pytest.fixture
def mark():
    """A number of seconds to sleep that no other process has; whatever still sleeps so is killed at the end."""
    word = str(10**9 + secrets.randbelow(10**9))
    yield word
    for process in sleeping(word):
        process.kill()


@pytest.fixture
def stand_in(monkeypatch):
    """A client of two slots whose batches are done at once, in this process."""
    monkeypatch.setattr(on_cluster, "as_completed", Completed)
    monkeypatch.setattr(on_cluster, "ASK_AGAIN_S", 0.0)
    return StandIn()
