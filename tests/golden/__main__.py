"""Golden results by hand: ``python -m tests.golden compare``, or ``accept`` once a method has a new version."""

import sys
import tempfile
from pathlib import Path

from tests.golden.compare import accept, compare
from tests.golden.study import make

SHOWN = 20


def main() -> None:
    """Run the golden study, then compare or accept."""
    verb = sys.argv[1] if len(sys.argv) == 2 else ""
    if verb not in ("compare", "accept"):
        sys.exit("usage: python -m tests.golden compare | accept")
    with tempfile.TemporaryDirectory() as folder:
        out = make(Path(folder))
        if verb == "accept":
            try:
                changed = accept(out)
            except ValueError as error:
                sys.exit(f"not accepted: {error}")
            print(f"accepted: {', '.join(changed) or 'nothing changed'}")
            return
        found = compare(out)
        for task, lines in found.items():
            print(f"{task}: {len(lines)} differences")
            for line in lines[:SHOWN]:
                print(f"  {line}")
        sys.exit(1 if found else print("no differences"))


if __name__ == "__main__":
    main()
