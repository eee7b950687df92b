"""Benchmarks: ratios measured in one run, medians of several rounds. `make benchmarks`, or name some.

python -m tests.benchmarks kernel study
"""

import platform
import sys
from importlib import import_module

NAMES = (
    "kernel", "study", "durable", "memory", "febio", "resume", "scale", "calibration", "sampler", "sobol", "surrogate",
    "discrepancy", "fidelities", "restarts", "dependent", "population",
)  # fmt: skip


def processor() -> str:
    with open("/proc/cpuinfo", encoding="utf-8") as file:
        names = [line.partition(":")[2].strip() for line in file if line.startswith("model name")]
    return f"{len(names)} x {names[0]}" if names else platform.processor()


if __name__ == "__main__":
    wanted = sys.argv[1:] or list(NAMES)
    unknown = [name for name in wanted if name not in NAMES]
    if unknown:
        sys.exit(f"no benchmark {', '.join(unknown)}; expected some of {', '.join(NAMES)}")
    print(f"machine: {processor()}, Python {platform.python_version()}")
    for name in wanted:
        print(f"\n{name}", flush=True)
        import_module(f"tests.benchmarks.{name}").main()
