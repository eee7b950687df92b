"""What the doctor sees: a cluster that will do, and everything about one that will not."""

import re
import subprocess
import sys

from tests.tasks.test_submission import ALLOCATION, PROFILE, live, prepare, sinew, until

LOOKED_AT = (
    "study and cohort",
    "disk",
    "quota",
    "clock of the disk",
    "SLURM",
    "profile",
    "TLS",
    "worker",
    "clock of the worker",
    "result folder",
    "threads",
    "network interface",
    "scratch",
    "solver",
    "canary",
    "size",
)


def examined(folder, *words, expect=0):
    """What the doctor says of a study in ``folder``: finding by name, without its ok or BAD."""
    study = folder / "study.yaml"
    profile = folder / "profile.yaml"
    said = sinew("doctor", study, "--profile", profile, "--out", folder / "out", *words, expect=expect)
    return said, dict(re.findall(r"^(?:ok  |BAD ) ([^:]+): (.*)$", said, re.MULTILINE))


def test_a_cluster_that_will_do(tmp_path, slurm_cluster):
    prepare(tmp_path, PROFILE + "scratch: /tmp\n")
    said, found = examined(tmp_path)
    assert tuple(found) == LOOKED_AT
    assert "BAD" not in said
    assert "slurm" in found["SLURM"]
    assert re.match(r"n\d, job \d+, Python 3", found["worker"])
    assert found["solver"] == f"{tmp_path / 'solver'}, version 9.9.9"
    assert found["canary"].startswith("distal/1: ok in ")
    assert found["threads"] == "2 workers with 1 thread each on 2 CPUs"
    assert found["scratch"].startswith("/tmp/sinew-")
    assert not (tmp_path / "out").exists(), "it leaves nothing behind"
    until(lambda: not live(), "the end of its job", 20)


def test_a_site_with_allocations_is_examined_by_a_job_of_the_same_kind(tmp_path, slurm_cluster):
    prepare(tmp_path, ALLOCATION)
    _, found = examined(tmp_path)
    assert found["threads"] == "1 workers with 1 thread each on 1 CPUs"
    assert found["canary"].startswith("distal/1: ok in ")


def bad(folder, *words):
    """The doctor's complaints, from what it printed before its exit code 2."""
    command = [sys.executable, "-m", "tasks.cli", "doctor", folder / "study.yaml", "--profile", folder / "profile.yaml"]
    done = subprocess.run([*command, "--out", folder / "out", *words], capture_output=True, text=True, timeout=120)
    assert done.returncode == 2
    assert re.fullmatch(r"sinew: \d+ of \d+ checks failed: .*\n", done.stderr)
    return dict(re.findall(r"^BAD  ([^:]+): (.*)$", done.stdout, re.MULTILINE))


def test_a_solver_that_fails_and_a_cluster_without_tls(tmp_path, slurm_cluster):
    prepare(tmp_path, PROFILE + "tls: false\n")
    solver = tmp_path / "solver"
    solver.write_text(solver.read_text().replace("stiffness = ", "sys.exit(139); stiffness = "))
    found = bad(tmp_path)
    assert set(found) == {"TLS", "canary"}
    assert "a stranger can connect" in found["TLS"]
    assert "exit code 139" in found["canary"]


def test_a_solver_that_is_not_there(tmp_path, slurm_cluster):
    study = prepare(tmp_path)
    (tmp_path / "solver").unlink()
    found = bad(tmp_path)
    assert set(found) == {"solver"}
    assert f"{study}: simulator.executable: " in found["solver"]


def test_jobs_that_do_not_start_or_are_refused(tmp_path, slurm_cluster):
    prepare(tmp_path, PROFILE + "prologue: ['echo the module system is away >&2', 'exit 3']\n")
    found = bad(tmp_path)
    assert "ended before it came to work: the module system is away" in found["worker"]
    (tmp_path / "profile.yaml").write_text(PROFILE + "partition: nowhere\n")
    found = bad(tmp_path)
    assert set(found) == {"profile", "worker"}
    assert "profile.yaml: partition: SLURM refuses the job" in found["profile"]


def test_an_interface_that_this_machine_does_not_have(tmp_path, slurm_cluster):
    prepare(tmp_path, PROFILE.replace("interface: lo", "interface: ib7"))
    assert "network interface 'ib7' is not on" in bad(tmp_path)["worker"]
