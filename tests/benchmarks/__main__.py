"""Benchmarks: ratios measured in one run, medians of several rounds. `make benchmarks`, or name some:

python -m tests.benchmarks kernel study durable memory febio resume scale calibration sampler sobol \\
    surrogate discrepancy fidelities
"""

import platform
import sys

from tests.benchmarks import (
    calibration,
    discrepancy,
    durable,
    febio,
    fidelities,
    kernel,
    memory,
    resume,
    sampler,
    scale,
    sobol,
    study,
    surrogate,
)

ALL = {
    "kernel": kernel.main,
    "study": study.main,
    "durable": durable.main,
    "memory": memory.main,
    "febio": febio.main,
    "resume": resume.main,
    "scale": scale.main,
    "calibration": calibration.main,
    "sampler": sampler.main,
    "sobol": sobol.main,
    "surrogate": surrogate.main,
    "discrepancy": discrepancy.main,
    "fidelities": fidelities.main,
}


def processor() -> str:
    with open("/proc/cpuinfo", encoding="utf-8") as file:
        names = [line.partition(":")[2].strip() for line in file if line.startswith("model name")]
    return f"{len(names)} x {names[0]}" if names else platform.processor()


if __name__ == "__main__":
    wanted = sys.argv[1:] or list(ALL)
    unknown = [name for name in wanted if name not in ALL]
    if unknown:
        sys.exit(f"no benchmark {', '.join(unknown)}; expected some of {', '.join(ALL)}")
    print(f"machine: {processor()}, Python {platform.python_version()}")
    for name in wanted:
        print(f"\n{name}", flush=True)
        ALL[name]()
