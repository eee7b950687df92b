"""A real SLURM on one machine for tests: munged, slurmctld and one slurmd per virtual node, in a private folder."""

import argparse
import json
import os
import pwd
import random
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

PROGRAMS = ("munged", "slurmctld", "slurmd", "sbatch", "srun", "squeue", "sinfo", "scancel", "scontrol", "sacct")
SEARCH_PATH = os.pathsep.join([os.environ.get("PATH", os.defpath), "/usr/sbin", "/sbin", "/usr/local/sbin"])
READY_SECONDS = 30
PID_SECONDS = 5
STOP_SECONDS = 3
TRIES = 5  # with other ports: between the choice of a port and its use, another program may take it
TAKEN = "Address already in use"
LONGEST_ROOT = (
    60  # a step's socket is <root>/run/spool/n10/n10_123456.4294967291; a socket's path has at most 107 bytes
)

HERE = Path(__file__).resolve().parent
NODE = (
    "NodeName={name} NodeHostname={host} NodeAddr=127.0.0.1 Port={port} CPUs={cpus} Boards=1 SocketsPerBoard=1"
    " CoresPerSocket={cpus} ThreadsPerCore=1 RealMemory=4000\n"
)


@dataclass(frozen=True)
class Testbed:
    """A running SLURM; everything it writes is under `root`."""

    __test__ = False  # not a class of tests, whatever pytest thinks of its name

    root: Path
    nodes: int
    cpus: int

    @property
    def configuration(self) -> Path:
        """The slurm.conf."""
        return self.root / "slurm.conf"

    @property
    def environment(self) -> dict[str, str]:
        """What a client command needs, to be merged over os.environ."""
        return {"SLURM_CONF": str(self.configuration)}

    @property
    def names(self) -> list[str]:
        """The nodes' names."""
        return [f"n{number}" for number in range(1, self.nodes + 1)]

    def run(self, *command: str) -> str:
        """Run a SLURM command; its standard output."""
        return _execute(self, command)


class CommandFailed(subprocess.CalledProcessError):
    """A command failed; unlike its base it says why."""

    def __str__(self) -> str:
        return f"{super().__str__()} {self.stderr.strip()}"


def missing() -> list[str]:
    """The programs that are not installed."""
    return [name for name in PROGRAMS if shutil.which(name, path=SEARCH_PATH) is None]


def start(root: Path, nodes: int = 4, cpus: int = 2) -> Testbed:
    """Start SLURM in the folder `root`, made if need be; returns when all nodes are idle."""
    if absent := missing():
        raise RuntimeError(f"not installed: {', '.join(absent)}")
    if nodes < 1 or cpus < 1:
        raise RuntimeError("a testbed needs at least one node and one cpu")
    root = root.resolve()
    if any(character.isspace() or character in '#"%,=' for character in str(root)):
        raise RuntimeError(f"slurm.conf cannot hold this folder's name: {root}")
    root.mkdir(parents=True, exist_ok=True)
    if (root / "slurm.conf").exists():
        raise RuntimeError(f"there is a testbed in {root} already; stop it and use another folder")
    testbed = Testbed(root, nodes, cpus)
    try:
        _make_folders(testbed)
        _start_munge(testbed)
        for ports_left in reversed(range(TRIES)):
            _configure(testbed, _free_ports(nodes + 1))
            try:
                _start_slurm(testbed)
                break
            except RuntimeError as error:
                if TAKEN not in str(error) or not ports_left:
                    raise
                for path in testbed.root.glob("slurm*.pid"):
                    _kill(path)
    except BaseException:
        stop(testbed)
        raise
    return testbed


def load(root: Path) -> Testbed:
    """The testbed that was started in the folder `root`."""
    root = root.resolve()
    try:
        return Testbed(root, **json.loads((root / "testbed.json").read_text()))
    except FileNotFoundError:
        raise RuntimeError(f"no testbed in {root}") from None


def stop(testbed: Testbed) -> None:
    """End all daemons and all processes of jobs; the folder with its logs stays."""
    daemons = [pid for path in testbed.root.glob("*.pid") if (pid := _pid(path))]
    # The nodes' daemons lose their munged, if it ends first, and then wait for it.
    _signal(daemons, signal.SIGTERM)
    _signal(_job_processes(testbed), signal.SIGKILL)
    _gone(daemons, STOP_SECONDS)
    _signal(daemons, signal.SIGKILL)
    # A job may have begun after the first look.
    jobs = _job_processes(testbed)
    _signal(jobs, signal.SIGKILL)
    _gone([*daemons, *jobs], STOP_SECONDS)
    for path in testbed.root.glob("*.pid"):
        path.unlink(missing_ok=True)
    run = testbed.root / "run"
    if run.is_symlink():
        shutil.rmtree(run.readlink(), ignore_errors=True)
        run.unlink()


def kill_controller(testbed: Testbed) -> None:
    """End slurmctld the hard way."""
    _kill(testbed.root / "slurmctld.pid")


def start_controller(testbed: Testbed) -> None:
    """Start slurmctld again, with the jobs it knew; returns when the nodes that live have told it of theirs."""
    _daemon(testbed, "slurmctld")
    alive = ",".join(name for name in testbed.names if _pid(testbed.root / f"slurmd.{name}.pid"))
    _wait_until(testbed, lambda: _answers(testbed, f"sinfo -h -p work -t unknown -n {alive} -o %D") == "", [])


def fail_node(testbed: Testbed, node: str) -> None:
    """End a node's daemon and all its jobs' processes the hard way, as a power cut does, and set it down."""
    _kill(testbed.root / f"slurmd.{node}.pid")
    processes = _job_processes(testbed, node)
    _signal(processes, signal.SIGKILL)
    _gone(processes, STOP_SECONDS)
    testbed.run("scontrol", "update", f"NodeName={node}", "State=DOWN", "Reason=failed by the testbed")


def restore_node(testbed: Testbed, node: str) -> None:
    """Bring a failed node back; returns when jobs can use it."""
    # ReturnToService=2: it is up again when its slurmd registers, and State=RESUME would then be an error.
    _daemon(testbed, "slurmd", "-N", node)
    usable = ("idle", "mixed", "allocated")
    _wait_until(testbed, lambda: _answers(testbed, f"sinfo -h -p work -n {node} -o %T") in usable, [node])


def _make_folders(testbed: Testbed) -> None:
    """Make the folders that daemons need, and write what `load` reads."""
    root = testbed.root
    if len(os.fsencode(root)) > LONGEST_ROOT:
        (root / "run").symlink_to(tempfile.mkdtemp(prefix="slurm-"))
    run = (root / "run").resolve()
    for folder in (run, root / "munge", root / "state", *(run / "spool" / name for name in testbed.names)):
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    (root / "jobcomp.log").touch()
    (root / "testbed.json").write_text(json.dumps({"nodes": testbed.nodes, "cpus": testbed.cpus}))
    (root / "job_submit.lua").write_text((HERE / "job_submit.lua").read_text())


def _configure(testbed: Testbed, ports: Sequence[int]) -> None:
    """Write slurm.conf, with a port for the controller and one for each node."""
    root, host = testbed.root, socket.gethostname().split(".")[0]
    run, user = (root / "run").resolve(), pwd.getpwuid(os.geteuid()).pw_name
    nodes = [
        NODE.format(name=name, host=host, port=port, cpus=testbed.cpus)
        for name, port in zip(testbed.names, ports[1:], strict=True)
    ]
    head, partitions = (HERE / "slurm.conf.template").read_text().split("PartitionName", 1)
    text = f"{head}{''.join(nodes)}\nPartitionName{partitions}"
    for key, value in {"host": host, "controller_port": ports[0], "user": user, "run": run, "root": root}.items():
        text = text.replace(f"{{{key}}}", str(value))
    testbed.configuration.write_text(text)


def _start_slurm(testbed: Testbed) -> None:
    """Start the controller and the nodes; returns when all nodes are idle."""
    _daemon(testbed, "slurmctld", "-c")
    for name in testbed.names:
        _daemon(testbed, "slurmd", "-N", name)
    idle = str(testbed.nodes)
    _wait_until(testbed, lambda: _answers(testbed, "sinfo -h -p work -t idle -o %D") == idle, testbed.names)


def _free_ports(count: int) -> list[int]:
    """Ports nobody listens on, below those the system gives to outgoing connections."""
    ports: list[int] = []
    for port in random.sample(range(15000, 32000), 1000):
        with socket.socket() as candidate:
            # As the daemons do: a port whose last connection lingers is free.
            candidate.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                candidate.bind(("0.0.0.0", port))  # noqa: S104 (nothing ever listens here)
            except OSError:
                continue
            ports.append(port)
        if len(ports) == count:
            return ports
    raise RuntimeError("no free ports")


def _start_munge(testbed: Testbed) -> None:
    """Start munged with its own key, and wait for its socket."""
    folder = testbed.root / "munge"
    key, run = folder / "key", (testbed.root / "run").resolve()
    with open(os.open(key, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o400), "wb") as file:
        file.write(os.urandom(128))
    options = {
        "key-file": key,
        "socket": run / "munge.socket",
        "pid-file": testbed.root / "munged.pid",
        "log-file": testbed.root / "munged.log",
        "seed-file": folder / "seed",
    }
    # --force: a private folder is enough here, munged would like one that other users can enter.
    _daemon(testbed, "munged", "--force", *(f"--{name}={value}" for name, value in options.items()))


def _daemon(testbed: Testbed, program: str, *arguments: str) -> None:
    """Start a program that goes to the background by itself."""
    try:
        _execute(testbed, (program, *arguments))
    except CommandFailed as error:
        log = f"slurmd.{arguments[-1]}" if program == "slurmd" else program
        raise RuntimeError(f"{error}\n{_tail(testbed, log)}") from None


def _execute(testbed: Testbed, command: Iterable[str]) -> str:
    """Run a program to its end; its standard output."""
    name, *arguments = command
    # Settings of a job or a shell this runs in are not meant for this SLURM.
    environment = {
        key: value for key, value in os.environ.items() if not key.startswith(("SLURM", "SBATCH_", "SQUEUE_", "SINFO_"))
    }
    done = subprocess.run(
        [shutil.which(name, path=SEARCH_PATH) or name, *arguments],
        env=environment | testbed.environment,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )
    if done.returncode:
        raise CommandFailed(done.returncode, [name, *arguments], done.stdout, done.stderr)
    return done.stdout


def _answers(testbed: Testbed, command: str) -> str | None:
    """A client command's answer, or None when it fails."""
    try:
        return testbed.run(*command.split()).strip()
    except subprocess.CalledProcessError:
        return None


def _wait_until(testbed: Testbed, ready: Callable[[], bool], nodes: Iterable[str]) -> None:
    """Wait for `ready`, while slurmctld and the slurmd of these nodes live."""
    daemons = ["slurmctld", *(f"slurmd.{node}" for node in nodes)]
    begin = time.monotonic()
    while not ready():
        seconds = time.monotonic() - begin
        for daemon in daemons:
            path = testbed.root / f"{daemon}.pid"
            # One that has just started has not written its pid yet, one that gives up may remove it.
            if not _pid(path) and (path.exists() or seconds > PID_SECONDS):
                raise RuntimeError(f"{daemon} died: {_tail(testbed, daemon)}")
        if seconds > READY_SECONDS:
            tails = "\n".join(f"{daemon}: {_tail(testbed, daemon)}" for daemon in daemons)
            raise RuntimeError(f"not ready after {READY_SECONDS} s\n{tails}")
        time.sleep(0.05)


def _tail(testbed: Testbed, daemon: str) -> str:
    """The last lines of a daemon's log."""
    try:
        lines = (testbed.root / f"{daemon}.log").read_text(errors="replace").splitlines()
    except FileNotFoundError:
        return ""
    return "\n".join(lines[-10:])


def _kill(path: Path) -> None:
    """SIGKILL to the daemon of a pid file."""
    if pid := _pid(path):
        _signal([pid], signal.SIGKILL)
        _gone([pid], STOP_SECONDS)
    path.unlink(missing_ok=True)


def _pid(path: Path) -> int | None:
    """The daemon a pid file names, if it lives; a number that went to another program does not count."""
    try:
        pid = int(path.read_text())
        name = Path(f"/proc/{pid}/comm").read_text(errors="replace").strip()
    except (OSError, ValueError):
        return None
    return pid if _alive(pid) and name == path.name.split(".")[0] else None


def _alive(pid: int) -> bool:
    """Whether a process lives; one that waits to be reaped does not."""
    try:
        state = Path(f"/proc/{pid}/stat").read_bytes().rpartition(b")")[2].split()[0]
    except OSError:
        return False
    return state not in (b"Z", b"X")


def _signal(pids: Iterable[int], number: signal.Signals) -> None:
    """Send a signal to those that live."""
    for pid in pids:
        try:
            os.kill(pid, number)
        except ProcessLookupError:
            continue


def _gone(pids: list[int], seconds: float) -> None:
    """Wait until all have ended, at most so long."""
    end = time.monotonic() + seconds
    while any(_alive(pid) for pid in pids) and time.monotonic() < end:
        time.sleep(0.02)


def _job_processes(testbed: Testbed, node: str | None = None) -> list[int]:
    """The processes of jobs: each slurmstepd, what descends from it, and what left it by a double fork."""
    parents: dict[int, int] = {}
    found: set[int] = set()
    for folder in Path("/proc").glob("[0-9]*"):
        pid = int(folder.name)
        try:
            parents[pid] = int((folder / "stat").read_bytes().rpartition(b")")[2].split()[1])
            if _belongs(folder, testbed, node):
                found.add(pid)
        except OSError:  # it ended, or is another user's
            continue
    while more := {pid for pid, parent in parents.items() if parent in found} - found:
        found |= more
    return sorted(found - {os.getpid()})


def _belongs(process: Path, testbed: Testbed, node: str | None) -> bool:
    """Whether a process, a folder of /proc, is a slurmstepd or was started by one."""
    if (process / "comm").read_bytes() == b"slurmstepd\n":
        # It overwrites its environment, but keeps its node's log open.
        logs = {str(testbed.root / f"slurmd.{name}.log") for name in ([node] if node else testbed.names)}
        return any(str(entry.readlink()) in logs for entry in (process / "fd").iterdir())
    variables = dict(entry.partition(b"=")[::2] for entry in (process / "environ").read_bytes().split(b"\0"))
    name = variables.get(b"SLURMD_NODENAME")  # only what a job started has it
    ours = variables.get(b"SLURM_CONF") == os.fsencode(testbed.configuration)
    return ours and name is not None and (node is None or name == os.fsencode(node))


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    starting = commands.add_parser("start", help="start SLURM in a new folder")
    stopping = commands.add_parser("stop", help="end it")
    for command in (starting, stopping):
        command.add_argument("folder", type=Path)
    starting.add_argument("--nodes", type=int, default=4)
    starting.add_argument("--cpus", type=int, default=2)
    arguments = parser.parse_args()
    try:
        if arguments.command == "start":
            testbed = start(arguments.folder, arguments.nodes, arguments.cpus)
            print(f"export SLURM_CONF={testbed.configuration}")
        else:
            stop(load(arguments.folder))
    except (RuntimeError, OSError, subprocess.SubprocessError) as error:
        print(f"testbed: {' '.join(str(error).split())}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
