"""A real Grid Engine on one machine for tests: a master and one execution daemon in a private folder."""

import os
import pwd
import random
import signal
import socket
import subprocess
import time
from dataclasses import dataclass
from pathlib import Path

BINARIES = Path("/usr/lib/gridengine")
SHARE = Path("/usr/share/gridengine")
PROGRAMS = ("qsub", "qstat", "qdel", "qconf", "sge_qmaster", "sge_execd", "spoolinit", "spooldefaults.bin")
READY_S = 30.0
CELL = "testbed"

# All names of this machine become one: its address and its name may resolve differently.
HOST = "localhost"
QUEUE = f"""\
qname {{name}}
hostlist {HOST}
seq_no 0
load_thresholds NONE
suspend_thresholds NONE
nsuspend 1
suspend_interval 00:05:00
priority 0
min_cpu_interval 00:05:00
processors UNDEFINED
qtype BATCH
ckpt_list NONE
pe_list smp
rerun TRUE
slots 8
tmpdir /tmp
shell /bin/bash
prolog NONE
epilog NONE
shell_start_mode unix_behavior
starter_method NONE
suspend_method NONE
resume_method NONE
terminate_method NONE
notify 00:00:05
owner_list NONE
user_lists NONE
xuser_lists NONE
subordinate_list NONE
complex_values NONE
projects NONE
xprojects NONE
calendar NONE
initial_state default
s_rt INFINITY
h_rt 100:00:00
s_vmem INFINITY
h_vmem 16G
""" + "".join(
    f"{kind}_{limit} INFINITY\n" for limit in ("cpu", "fsize", "data", "stack", "core", "rss") for kind in "sh"
)
PARALLEL_ENVIRONMENT = """\
pe_name smp
slots 999
user_lists NONE
xuser_lists NONE
start_proc_args NONE
stop_proc_args NONE
allocation_rule $pe_slots
control_slaves FALSE
job_is_first_task TRUE
urgency_slots min
accounting_summary FALSE
qsort_args NONE
"""
CONFIGURATION = {
    "min_uid": "0",
    "min_gid": "0",
    "load_report_time": "00:00:01",
    "mailer": "/bin/true",
}
SCHEDULE = {
    "schedule_interval": "0:0:1",
    "flush_submit_sec": "1",
    "flush_finish_sec": "1",
    "load_adjustment_decay_time": "0:0:0",
    "job_load_adjustments": "NONE",
}


@dataclass(frozen=True)
class Testbed:
    """A running Grid Engine; everything that it writes is under ``root``."""

    __test__ = False  # not a class of tests

    root: Path
    environment: dict[str, str]


def missing() -> list[str]:
    """The programs that are not installed."""
    return [name for name in PROGRAMS if not (BINARIES / name).exists()]


def start(root: Path) -> Testbed:
    """Start Grid Engine in ``root``; returns when jobs can run."""
    master, daemon = _free_ports(2)
    arch = subprocess.run([SHARE / "util" / "arch"], capture_output=True, text=True, check=True).stdout.strip()
    names = {"SGE_ROOT": root / "root", "SGE_CELL": CELL, "SGE_ARCH": arch}
    ports = {"SGE_QMASTER_PORT": master, "SGE_EXECD_PORT": daemon}
    testbed = Testbed(root, {name: str(value) for name, value in (names | ports).items()})
    try:
        _lay_out(testbed, arch)
        _run(testbed, "sge_qmaster")
        _wait(testbed, "the master", lambda: HOST in _run(testbed, "qconf", "-sh"))
        _configure(testbed)
        _run(testbed, "sge_execd")
        _wait(testbed, "the execution daemon", lambda: " - " not in _run(testbed, "qhost", "-h", HOST).splitlines()[3])
    except BaseException:
        stop(testbed)
        raise
    return testbed


def stop(testbed: Testbed) -> None:
    """End all daemons and all jobs."""
    pids = [_pid(path) for path in testbed.root.glob("spool/**/*.pid")]
    for process in Path("/proc").glob("[0-9]*"):
        try:
            mine = f"SGE_ROOT={testbed.environment['SGE_ROOT']}\0".encode() in (process / "environ").read_bytes()
        except OSError:
            continue
        if mine and int(process.name) not in (os.getpid(), os.getppid()):
            pids.append(int(process.name))
    for pid in pids:
        try:
            if pid is not None:
                os.kill(pid, signal.SIGKILL)
        except ProcessLookupError:
            continue


def _lay_out(testbed: Testbed, arch: str) -> None:
    """Make the folders that a Grid Engine expects, and its first files."""
    root, user = testbed.root, pwd.getpwuid(os.geteuid()).pw_name
    top, spool = root / "root", root / "spool"
    common = top / CELL / "common"
    for folder in (common, spool / "qmaster" / "job_scripts", spool / "execd"):
        folder.mkdir(parents=True)
    (top / "util").symlink_to(SHARE / "util")
    for name in ("bin", "lib", "utilbin"):
        (top / name).mkdir()
        (top / name / arch).symlink_to(BINARIES)
    spooling = f"{common};{spool / 'qmaster'}"
    (common / "bootstrap").write_text(
        _edited(
            (SHARE / "default-bootstrap").read_text(),
            {
                "admin_user": user,
                "spooling_method": "classic",
                "spooling_lib": "libspoolc",
                "spooling_params": spooling,
                "binary_path": str(BINARIES),
                "qmaster_spool_dir": str(spool / "qmaster"),
            },
        )
    )
    host = socket.gethostname()
    (common / "host_aliases").write_text(f"{HOST} {' '.join({host, socket.getfqdn()} - {HOST})}\n")
    (common / "act_qmaster").write_text(f"{HOST}\n")
    configuration = CONFIGURATION | {"execd_spool_dir": str(spool / "execd")}
    (root / "configuration").write_text(_edited((SHARE / "default-configuration").read_text(), configuration))
    _run(testbed, "spoolinit", "classic", "libspoolc", spooling, "init")
    defaults = "spooldefaults.bin"
    _run(testbed, defaults, "configuration", str(root / "configuration"))
    _run(testbed, defaults, "complexes", str(SHARE / "util" / "resources" / "centry"))
    _run(testbed, defaults, "usersets", str(SHARE / "util" / "resources" / "usersets"))
    _run(testbed, defaults, "adminhosts", HOST)
    _run(testbed, defaults, "managers", user)


def _configure(testbed: Testbed) -> None:
    """Tell the running master of its host, its queue and how often to schedule.

    The queue's name is this testbed's alone: a job's temporary folder is named after the job's number and the queue,
    and two testbeds that run at once both begin with job 1.
    """
    _run(testbed, "qconf", "-as", HOST)
    queue = QUEUE.format(name=f"work{testbed.environment['SGE_QMASTER_PORT']}.q")
    for option, text in (("-Ap", PARALLEL_ENVIRONMENT), ("-Aq", queue)):
        path = testbed.root / f"qconf{option}"
        path.write_text(text)
        _run(testbed, "qconf", option, str(path))
    schedule = testbed.root / "schedule"
    schedule.write_text(_edited(_run(testbed, "qconf", "-ssconf"), SCHEDULE))
    _run(testbed, "qconf", "-Msconf", str(schedule))


def _edited(text: str, changes: dict[str, str]) -> str:
    """A configuration with other values."""
    lines = []
    for line in text.splitlines():
        name = line.split(None, 1)[0] if line.strip() else ""
        lines.append(f"{name} {changes[name]}" if name in changes else line)
    return "\n".join(lines) + "\n"


def _run(testbed: Testbed, program: str, *arguments: str) -> str:
    """Run a program of Grid Engine; its output. Raises ``RuntimeError`` with the program's words."""
    done = subprocess.run(
        [str(BINARIES / program), *arguments],
        env=os.environ | testbed.environment | {"LD_LIBRARY_PATH": str(BINARIES)},
        cwd=testbed.root,
        capture_output=True,
        text=True,
        timeout=60,
    )
    if done.returncode:
        raise RuntimeError(f"{program} {' '.join(arguments)}: {done.stderr.strip() or done.stdout.strip()}")
    return done.stdout


def _wait(testbed: Testbed, what: str, ready) -> None:
    until = time.monotonic() + READY_S
    while True:
        try:
            if ready():
                return
            problem = "no answer"
        except (RuntimeError, IndexError) as error:
            problem = str(error)
        if time.monotonic() > until:
            logs = "\n".join(path.read_text()[-2000:] for path in testbed.root.glob("spool/**/messages"))
            raise RuntimeError(f"{what} is not ready after {READY_S:g} s: {problem}\n{logs}")
        time.sleep(0.1)


def _pid(path: Path) -> int | None:
    """The daemon that a file names, if it lives."""
    try:
        pid = int(path.read_text())
        return pid if b"sge_" in Path(f"/proc/{pid}/cmdline").read_bytes() else None
    except (OSError, ValueError):
        return None


def _free_ports(count: int) -> list[int]:
    ports: list[int] = []
    for port in random.sample(range(15000, 32000), 1000):
        with socket.socket() as candidate:
            candidate.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                candidate.bind(("0.0.0.0", port))
            except OSError:
                continue
            ports.append(port)
        if len(ports) == count:
            return ports
    raise RuntimeError("no free ports")
