"""``make fuzz MINUTES=30``: random inputs for as long as that; what breaks something is kept in the corpus.

Each input comes from the number of its turn, so ``--from`` continues, or repeats, an earlier run.
"""

import argparse
import hashlib
import tempfile
import time
import traceback
import warnings
from pathlib import Path
from random import Random

from tests.fuzz.limits import Broken, attempt
from tests.fuzz.mutations import mutated
from tests.fuzz.targets import targets

CORPUS = Path(__file__).parent / "corpus"


def main() -> int:
    """Returns 1 if an input broke something."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("--minutes", type=float, default=30.0)
    parser.add_argument("--from", dest="first", type=int, default=int(time.time()) * 1000)
    parser.add_argument("--only", help="one target, in place of all")
    asked = parser.parse_args()
    warnings.simplefilter("ignore")
    end, began, number, seen = time.monotonic() + 60 * asked.minutes, time.process_time(), asked.first, set()
    with tempfile.TemporaryDirectory() as folder:
        every = [one for one in targets(Path(folder)).values() if asked.only in (None, one.name)]
        weights = [one.share for one in every]
        while time.monotonic() < end:
            random = Random(number)
            (target,) = random.choices(every, weights)
            seed = random.choice(target.seeds)
            content = mutated(target.files[seed], random)
            number += 1
            try:
                attempt(target, seed, content)
            except Broken as broken:
                place = _place(broken)
                if place not in seen:
                    seen.add(place)
                    print(f"{number - 1}: {target.name}: {seed}: {broken} at {place}", flush=True)
                    kept = CORPUS / target.name / seed / f"{hashlib.blake2b(content, digest_size=6).hexdigest()}.bin"
                    kept.parent.mkdir(parents=True, exist_ok=True)
                    kept.write_bytes(content)
    took = time.process_time() - began
    print(f"{number - asked.first:,} inputs from {asked.first} on, {len(seen)} faults, {took:,.0f} s of a processor")
    return bool(seen)


def _place(broken: Broken) -> str:
    """Where an error came from: one fault is kept once."""
    frames = traceback.extract_tb((broken.__cause__ or broken).__traceback__)
    frames = [one for one in frames if one.name != "hangs"] or frames
    return f"{Path(frames[-1].filename).name}:{frames[-1].lineno}"


raise SystemExit(main())
