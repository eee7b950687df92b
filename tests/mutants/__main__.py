"""Mutation testing: ``python -m tests.mutants [TARGET ...]`` breaks the code in small ways and runs the tests.

A mutant that no test notices has survived. Interrupt a run at any time: the next one goes on from there.
``--sample N`` tests N mutants of each target, drawn at random, the same in each run.
"""

import argparse
import os
import subprocess
import sys
from pathlib import Path

from tests.mutants.outcome import (
    SURVIVORS,
    Outcome,
    drawn,
    exit_codes,
    forget,
    outcome,
    row,
    survivors,
    table,
    unlisted,
)
from tests.mutants.working_copy import HERE, Target, targets, update

PROCESSES = os.environ.get("PROCESSES", "2")
LEAST_PERCENT = 90.0


def main() -> None:
    """Test the mutants of the named targets, of all where none is named; fails where too few are killed."""
    known = targets()
    parser = argparse.ArgumentParser(prog="python -m tests.mutants", description=__doc__)
    parser.add_argument("target", nargs="*", help=f"{', '.join(known)}; all, unless named")
    parser.add_argument("--sample", type=int, metavar="N", help="how many mutants of each target; all by default")
    options = parser.parse_args()
    if wrong := [name for name in options.target if name not in known]:
        parser.error(f"no target {wrong[0]}; there are {', '.join(known)}")
    outcomes = [_test(known[name], options.sample) for name in options.target or known]
    print(table(outcomes))
    sys.exit(1 if any(one.percent < LEAST_PERCENT for one in outcomes) else 0)


def _test(target: Target, sample: int | None) -> Outcome:
    update(target)
    forget(target.folder)
    subprocess.run([sys.executable, "-m", "tests.mutants.generate"], cwd=target.folder, check=True)
    names = drawn(exit_codes(target.folder), sample)
    if left := [name for name in names if exit_codes(target.folder)[name] is None]:
        mutmut = Path(sys.executable).with_name("mutmut")
        subprocess.run([mutmut, "run", "--max-children", PROCESSES, *left], cwd=target.folder, check=True)
    found = exit_codes(target.folder)
    codes = {name: found[name] for name in names}
    diffs = _diffs(target.folder, survivors(codes))
    file = HERE / f"{target.name}.survivors"
    file.write_text("\n\n".join(diffs) + "\n")
    new = unlisted([row(diff) for diff in diffs], SURVIVORS.read_text())
    print(f"{target.name}: {len(diffs)} survivors in {file}, {len(new)} of them not in {SURVIVORS}")
    for one in new:
        print(f"  {one}")
    return outcome(target.name, codes, of=len(found))


def _diffs(folder: Path, names: list[str]) -> list[str]:
    """What the named mutants change."""
    from mutmut.configuration import reset_config
    from mutmut.mutation.diff_apply import get_diff_for_mutant

    reset_config()  # it is that of another target
    os.chdir(folder)
    try:
        return [f"# {name}\n{get_diff_for_mutant(name)}" for name in names]
    finally:
        os.chdir(HERE.parent)


if __name__ == "__main__":
    main()
