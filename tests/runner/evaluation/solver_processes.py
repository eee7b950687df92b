"""Helpers for tests with real processes: programs, daemons, and what is left of them."""

import sys
import time
from collections.abc import Callable
from pathlib import Path

import psutil
import pytest

ROOT = Path(__file__).resolve().parents[3]
LINUX = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="needs Linux")
LONG_S = 20.0


def program(folder: Path, text: str, name: str = "program") -> list[str]:
    """A command that runs a shell script."""
    path = folder / name
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(0o755)
    return [str(path)]


def sleeping(mark: str) -> list[psutil.Process]:
    found = []
    for process in psutil.process_iter():
        try:
            if mark in process.cmdline() and process.status() != psutil.STATUS_ZOMBIE:
                found.append(process)
        except psutil.Error:
            continue
    return found


def zombies() -> set[int]:
    found = set()
    for process in psutil.Process().children():
        try:
            if process.status() == psutil.STATUS_ZOMBIE:
                found.add(process.pid)
        except psutil.Error:
            continue
    return found


def becomes(condition: Callable[[], bool], within_s: float) -> bool:
    deadline = time.monotonic() + within_s
    while time.monotonic() < deadline:
        if condition():
            return True
        time.sleep(0.02)
    return condition()


def daemon(mark: str, pid_file: str = "daemon.pid") -> str:
    """Shell lines that leave a process in a session of its own, and go on when it is there."""
    return f"""(setsid sh -c 'echo $$ > {pid_file}.new; mv {pid_file}.new {pid_file}; exec sleep {mark}' &)
while [ ! -s {pid_file} ]; do sleep 0.01; done"""
