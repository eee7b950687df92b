"""Kill a study of all tasks at random, again and again, and see that nothing is lost: `make chaos MINUTES=30`.

Each round has a seed, which decides what is hit by which signal, though not what that process is about to do.
"""

import argparse
import os
import random
import shutil
import signal
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

from tests.chaos.round import Place, Round, play, total
from tests.chaos.study import prepare
from tests.chaos.victims import KINDS, WEIGHTS


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.chaos", description=__doc__)
    parser.add_argument("--minutes", type=float, default=5.0, help="how long signals are sent")
    parser.add_argument("--signals", type=int, help="how many to send in each round, at most")
    parser.add_argument("--rounds", type=int, default=10**6, help="how many, at most")
    parser.add_argument("--seed", type=int, help="of the first round; the next ones count on")
    parser.add_argument("--keep", action="store_true", help="keep the folder of the results")
    options = parser.parse_args()
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background jobs ignore it, and so would runs
    seed = random.SystemRandom().randrange(10**6) if options.seed is None else options.seed
    folder = Path(tempfile.mkdtemp(prefix="sinew-chaos-")).resolve()
    os.environ["XDG_STATE_HOME"] = str(folder / "state")
    rounds: list[Round] = []
    place = Place(folder, prepare(folder))
    started = time.monotonic()
    place.run_calm()
    print(f"calm: {time.monotonic() - started:.0f} s, in {folder}", flush=True)
    until = time.monotonic() + 60 * options.minutes
    while time.monotonic() < until and len(rounds) < options.rounds:
        place.begin()
        rounds.append(play(place, seed + len(rounds), until, options.signals))
        show(rounds[-1], place)
    trouble = sum(len(each.trouble) for each in rounds)
    summary(rounds, time.monotonic() - started)
    if not options.keep and not trouble:
        shutil.rmtree(folder)
    return 1 if trouble else 0


def show(done: Round, place: Place) -> None:
    runs = sum(done.ends.values())
    print(f"seed {done.seed}: {total(done.hits)} signals, {runs} runs, {len(done.trouble)} violations", flush=True)
    for end, count in done.ends.most_common():
        print(f"  {count} x exit {end}")
    for words in done.trouble:
        print(f"  VIOLATION: {words}")
    if done.trouble:
        print("  " + place.tail().replace("\n", "\n  "))
    sys.stdout.flush()


def summary(rounds: list[Round], seconds: float) -> None:
    hits: Counter[tuple[str, str]] = sum((each.hits for each in rounds), Counter())
    kinds = [kind.name for kind in KINDS]
    print(f"{'':8}" + "".join(f"{kind:>9}" for kind in kinds))
    for role in WEIGHTS:
        print(f"{role:8}" + "".join(f"{hits[role, kind]:9}" for kind in kinds))
    runs, trouble = sum(sum(each.ends.values()) for each in rounds), sum(len(each.trouble) for each in rounds)
    minutes = f"{seconds / 60:.0f} minutes"
    print(f"{total(hits)} signals hit a live process, in {runs} runs of {len(rounds)} studies, {minutes}")
    print(f"{trouble} violations")


if __name__ == "__main__":
    sys.exit(main())
