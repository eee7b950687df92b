"""All tests, in two runs side by side: those that compute, and those on a batch system, which wait most of the time.

Tests that compute give way: jobs of a batch system have time limits. What the other run said follows when both ended.
"""

import subprocess
import sys
import tempfile

COMPUTING = ("-m", "not slurm", "-n", "2", "--dist", "worksteal")
WAITING = (
    "-m",
    "slurm",
    "-n",
    "5",
    "--dist",
    "load",
    "--maxschedchunk",
    "1",
    "tests/tasks/cluster",
    "tests/runner/cluster",
)
NICE = 10


def main() -> int:
    """Run both; 0 if both passed."""
    pytest = (sys.executable, "-m", "pytest")
    with tempfile.TemporaryFile("w+") as said:
        waiting = subprocess.Popen([*pytest, *WAITING], stdout=said, stderr=subprocess.STDOUT)
        try:
            computing = subprocess.run(["nice", "-n", str(NICE), *pytest, *COMPUTING], check=False).returncode
            waited = waiting.wait()
        finally:
            waiting.terminate()
            waiting.wait()
        said.seek(0)
        print(f"\ntests on batch systems, which ran beside these:\n{said.read()}")
    return max(computing, waited)


if __name__ == "__main__":
    sys.exit(main())
