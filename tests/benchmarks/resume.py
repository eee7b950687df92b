"""`sinew run` when everything is stored already: 20,000 points for three specimens."""

import subprocess
import sys
import tempfile
from pathlib import Path

from sinew.tasks.study.resources import resource
from tests.benchmarks.common import median_line, seconds

ROUNDS = 3


def main() -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        sinew = [sys.executable, "-m", "sinew"]
        cohort = ["cohort", "--out", str(folder / "cohort"), "--per-site", "1", "--seed", "2503"]
        subprocess.run([*sinew, *cohort], check=True, stdout=subprocess.DEVNULL)
        run = [
            "run",
            str(resource("configs/demo.yaml")),
            "--data",
            str(folder / "cohort"),
            "--out",
            str(folder / "out"),
        ]

        def work() -> None:
            subprocess.run([*sinew, *run, "--quiet"], check=True)

        print(f"  first run, cluster start and forests included: {seconds(work):.1f} s")
        median_line("again", [seconds(work) for _ in range(ROUNDS)], "s")
