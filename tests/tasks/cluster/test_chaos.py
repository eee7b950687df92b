"""A study of 512 solver runs on a real SLURM, with everything that a cluster does to long runs at once.

Four nodes, worker jobs of one minute (they have to leave by themselves in between), a random worker job cancelled or
killed every ten seconds, and the process that leads killed once. `pytest -s` prints the report of docs/chaos.md.
"""

import random
import subprocess
import time
from dataclasses import dataclass, field
from pathlib import Path

import psutil
import pytest

from sinew.runner.store.store import open_store
from tests.runner.stores import contents
from tests.tasks import stand_in
from tests.tasks.cluster.slurm_studies import (
    JOB_SCRIPT,
    Moment,
    RunHere,
    begun,
    finish,
    leading_processes,
    live,
    log_of,
    prepare,
    submit,
    until,
    worker_jobs,
)

PROFILE = """
name: chaos
interface: lo
coordinator: {memory: 500M, walltime: "30:00"}
workers: {jobs: 4, cores: 1, memory: 2500M, walltime: "1:00", poll_s: 1}
"""
ROWS = 512
EVERY_S = 10.0
LONGEST_S = 900.0


@dataclass
class Damage:
    """What was done to a study, and what was committed in the meantime."""

    struck: list[str] = field(default_factory=list)
    leader_killed: bool = False
    moments: list[Moment] = field(default_factory=list)


def strike(dice: random.Random) -> str | None:
    """End a worker job that runs, politely or not; returns its number, or None when it had just ended by itself."""
    running = [job for job in live() if job.name.endswith("worker") and job.state == "RUNNING"]
    if not running:
        return None
    job = dice.choice(running).job
    how = ("--signal=KILL", "--full") if dice.random() < 0.5 else ()
    done = subprocess.run(["scancel", *how, job], capture_output=True, text=True)
    assert done.returncode == 0 or "Invalid job id" in done.stderr, done.stderr
    return job if done.returncode == 0 else None


def disturb(study: Path, out: Path) -> Damage:
    """Do all the damage to a study while it runs; returns when its jobs have ended."""
    dice, damage = random.Random(3), Damage()
    started = following = time.monotonic()
    while live():
        assert time.monotonic() - started < LONGEST_S, log_of(out)
        rows = stand_in.committed(out)
        damage.moments.append((rows, len(study.with_name("begun").read_text().splitlines())))
        if not damage.leader_killed and len(rows) > ROWS // 8:
            (leader,) = leading_processes(study)
            leader.kill()
            damage.leader_killed = True
        if time.monotonic() > following + EVERY_S:
            following += EVERY_S
            damage.struck += [job] if (job := strike(dice)) else []
        time.sleep(1.0)
    return damage


@pytest.mark.takes(150)
@pytest.mark.thorough
def test_chaos(tmp_path, slurm_cluster):
    study = prepare(tmp_path, PROFILE + JOB_SCRIPT, seconds=0.5, base_samples=32)
    started = time.monotonic()
    out = submit(study)
    calm = RunHere(prepare(tmp_path / "calm", base_samples=32))
    damage = disturb(study, out)
    seconds = time.monotonic() - started
    finish(out)

    runs = begun(out)
    again = [row for rows, count in damage.moments for row in runs[count:] if row in rows]
    table = open_store(out).tables()[0]
    workers = worker_jobs(out)
    left = until(lambda: not stand_in.leftovers(tmp_path / "solver"), "the end of all solvers", 30)
    same = contents(out / "store.zarr") == contents(calm.finished() / "store.zarr")
    lost = int((table.status != 0).sum())
    print(
        f"\nrows {len(table)}, solver runs {len(runs)}, seconds {seconds:.0f}"
        f"\nworker jobs {len(workers)}, of which struck {len(damage.struck)}; ends: {sorted({w.end for w in workers})}"
        f"\nleading process killed {int(damage.leader_killed)} time"
        f"\nlost {lost}, committed and evaluated again {len(again)}, orphans {0 if left else 'some'}"
        f"\nequal to the undisturbed run to the byte: {same}"
    )
    assert damage.leader_killed
    assert len(damage.struck) >= 4
    assert len(workers) > 4 + len(damage.struck), "those that ended are replaced"
    assert lost == 0
    assert not again
    assert set(runs) == set(range(ROWS))
    assert same
    assert not [p for p in psutil.process_iter(["cmdline"]) if str(out) in " ".join(p.info["cmdline"] or [])]
