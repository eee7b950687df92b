"""Rendering in a process of its own, with limits of memory and processor time: a loop or a constant has no other limit.

The program reads one job per line and writes one answer per line, both JSON, until its input ends.
"""

import json
import math
import re
import resource
import sys
import time
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, tostring

from .check import check
from .outputs import add_outputs
from .sandbox import Compiled, included, job_script, rendered, used_names, variables_of
from .wrong import Wrong

SECONDS, MEMORY_BYTES = 10, 2**30  # processor time of a job, memory of the process
WORDS = 140  # letters of each part of a message


def answer(job: dict[str, Any], files: dict[str, str], compiled: Compiled | None = None) -> dict[str, Any]:
    """Render the template ``main`` of ``files`` with each of the job's ``renders`` (variables by name).

    Returns, for each, whether it is the ``same`` input as the first and, if the job asks for ``texts``, the input.
    With ``known`` names, it also returns which of them the template has ``used``, and refuses all others. ``outputs``
    None adds none. Inputs are written anew from what was checked: FEBio ends comments and instructions elsewhere than
    XML does. Raises :class:`Wrong`.
    """
    main = job["main"]
    found: dict[str, Any] = {"texts": [], "same": []}
    if job.get("known") is not None:
        found["used"] = sorted(used_names(files))
        if unknown := [name for name in found["used"] if name not in job["known"]]:
            raise Wrong(main, f"unknown variable {unknown[0]}", f"some of {', '.join(job['known'])}")
    first: tuple[str, Element] | None = None
    for variables in job["renders"]:
        text, root = rendered(files, main, variables, compiled)
        check(main, root)
        if job["outputs"] is not None:
            add_outputs(main, root, job["outputs"])
        first = first or (text, root)
        found["same"].append(text == first[0] or _are_same(root, first[1]))
        if job.get("texts"):
            written = '<?xml version="1.0" encoding="UTF-8"?>\n' + tostring(root, encoding="unicode") + "\n"
            found["texts"].append(written)
    return found


def _are_same(one: Element, other: Element) -> bool:
    """Whether two inputs differ in nothing that a solver reads: in more than comments."""
    both = ([(each.tag, each.attrib, each.text, each.tail, len(each)) for each in root.iter()] for root in (one, other))
    return next(both) == next(both)


def _limit_processor(seconds: float) -> None:
    """Let the kernel end this process once it has used so many further seconds of a processor."""
    used = resource.getrusage(resource.RUSAGE_SELF)
    most = math.ceil(used.ru_utime + used.ru_stime + seconds)
    hard = resource.getrlimit(resource.RLIMIT_CPU)[1]
    resource.setrlimit(resource.RLIMIT_CPU, (most if hard == resource.RLIM_INFINITY else min(most, hard), hard))


def _most_memory() -> int:
    """The largest memory (bytes) of this process; Linux has that of the one that started it in ``ru_maxrss``."""
    status = Path("/proc/self/status")
    if status.exists():
        return int(re.findall(r"VmHWM:\s+(\d+) kB", status.read_text())[0]) * 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def _reply(job: dict[str, Any], files: dict[str, str], compiled: Compiled) -> bytes:
    """The answer to a job, as a line of JSON; for a template that is ``wrong``, the three parts of a message."""
    name = job["main"]
    try:
        match job["kind"]:
            case "render":
                reply = answer(job, files, compiled)
            case "variables":
                reply = variables_of(name, files)
            case "included":
                reply = included(name, job["text"])
            case _:
                reply = job_script(name, job["text"], job["variables"])
        return json.dumps(reply).encode()
    except Wrong as wrong:
        parts = wrong.args
    except MemoryError:
        parts = (name, f"takes more than {MEMORY_BYTES / 2**30:g} GB", "a smaller template")
    except RecursionError:
        parts = (name, "cannot be rendered (RecursionError)", "a simpler template")
    except Exception as error:  # noqa: BLE001 - Jinja2 and Python raise many kinds for what they cannot read
        parts = (name, f"cannot be read ({type(error).__name__}: {error})", "a Jinja2 template")
    return json.dumps({"wrong": [part if len(part) <= WORDS else f"{part[: WORDS - 3]}..." for part in parts]}).encode()


def main() -> None:
    """Answer jobs until the input ends. A job to render without ``files`` uses those of the job before.

    Each answer is two lines: the processor time (s) and whether the process ends, for it took much memory; the answer.
    """
    sys.setrecursionlimit(2000)
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
    much = max(MEMORY_BYTES // 2, _most_memory())
    files: dict[str, str] = {}
    compiled = Compiled()
    for line in sys.stdin.buffer:
        job = json.loads(line)
        del line
        if "files" in job:
            files, compiled = job["files"], Compiled()
        before = time.process_time()
        _limit_processor(job["seconds"])
        reply = _reply(job, files, compiled)
        facts = {"took": time.process_time() - before, "last": _most_memory() > much}
        sys.stdout.buffer.write(json.dumps(facts).encode() + b"\n" + reply + b"\n")
        sys.stdout.buffer.flush()
