"""A study of 512 solver runs on a real SLURM, with everything that a cluster does to long runs at once.

Four nodes, worker jobs of one minute (they have to leave by themselves in between), a random worker job cancelled or
killed every ten seconds, and the process that leads killed once. `pytest -s` prints the report of docs/chaos.md.
"""

import random
import subprocess
import time

import psutil

from runner import slurm
from runner.store import open_store
from tests.runner.test_store import contents
from tests.tasks import test_survival as survival
from tests.tasks.test_submission import finish, live, log_of, prepare, sinew, submit, until

PROFILE = """
name: chaos
interface: lo
coordinator: {memory: 500M, walltime: "30:00"}
workers: {jobs: 4, cores: 1, memory: 2500M, walltime: "1:00", poll_s: 1}
"""
ROWS = 512


def leader_process(study) -> psutil.Process | None:
    for process in psutil.process_iter(["cmdline"]):
        words = process.info["cmdline"] or []
        if "tasks.cli" in words and "run" in words and str(study) in words:
            return process
    return None


def strike(dice: random.Random) -> str | None:
    """End a worker job that runs, politely or not; returns its number."""
    running = [job for job in live() if job.name.endswith("worker") and job.state == "RUNNING"]
    if not running:
        return None
    job = dice.choice(running).job
    how = ("--signal=KILL", "--full") if dice.random() < 0.5 else ()
    subprocess.run(["scancel", *how, job], check=True)
    return job


def test_chaos(tmp_path, slurm_cluster):
    calm = prepare(tmp_path / "calm", seconds=0.02, base_samples=32)
    calm.write_text(calm.read_text().replace("cluster: slurm", "cluster: {name: local, workers: 1}"))
    sinew("run", calm, "--out", tmp_path / "calm" / "out", "--quiet")
    order = (tmp_path / "calm" / "notes").read_text().splitlines()  # one worker: the rows in their order
    row_of = {line.split()[0]: row for row, line in enumerate(order)}
    assert len(row_of) == len(order) == ROWS

    dice = random.Random(3)
    study = prepare(tmp_path / "chaos", PROFILE, seconds=0.5, base_samples=32)
    notes, solver = tmp_path / "chaos" / "notes", tmp_path / "chaos" / "solver"
    started = time.monotonic()
    out = submit(study)
    struck: list[str] = []
    snapshots: list[tuple[set[int], int]] = []
    killed_at = None
    until(lambda: notes.exists(), "the first run of the solver")
    following = time.monotonic() + 10.0
    while live():
        assert time.monotonic() - started < 700, log_of(out)
        done = survival.committed(out)
        snapshots.append((done, len(notes.read_text().splitlines())))
        if killed_at is None and len(done) > ROWS // 8:
            leader = leader_process(study)
            assert leader is not None
            leader.kill()
            killed_at = time.monotonic()
        if time.monotonic() > following:
            following += 10.0
            struck += [job] if (job := strike(dice)) else []
        time.sleep(0.5)
    seconds = time.monotonic() - started
    finish(out)

    runs = [row_of[line.split()[0]] for line in notes.read_text().splitlines()]
    again = [row for rows, count in snapshots for row in runs[count:] if row in rows]
    table = open_store(out).tables()[0]
    jobs = slurm.JobTable(out / "jobs").read().values()
    workers = [job for job in jobs if job.role == slurm.WORKER]
    ends = sorted({job.end for job in workers})
    left = until(lambda: not survival.leftovers(solver), "the end of all solvers", 10)
    same = contents(out / "store.zarr") == contents(tmp_path / "calm" / "out" / "store.zarr")
    lost = int((table.status != 0).sum())
    print(
        f"\nrows {len(table)}, solver runs {len(runs)}, seconds {seconds:.0f}"
        f"\nworker jobs {len(workers)}, of which struck {len(struck)}; ends: {', '.join(ends)}"
        f"\nleading process killed {int(killed_at is not None)} time"
        f"\nlost {lost}, committed and evaluated again {len(again)}, orphans {0 if left else 'some'}"
        f"\nequal to the undisturbed run to the byte: {same}"
    )
    assert killed_at is not None
    assert len(struck) >= 4
    assert len(workers) > 4 + len(struck), "those that ended are replaced"
    assert lost == 0
    assert not again
    assert set(runs) == set(range(ROWS))
    assert same
    assert not [p for p in psutil.process_iter(["cmdline"]) if str(out) in " ".join(p.info["cmdline"] or [])]
