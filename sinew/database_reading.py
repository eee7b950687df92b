"""The process that looks at an SQLite database before anything else opens it: what is wrong with it, as JSON.

The schema alone may fill the memory or have no end, and SQLite reads it with the first question. So the look has a
process of its own, with limits.
"""

import json
import sqlite3
import sys
from contextlib import closing

from sinew.runner.limits import limit

MEMORY_BYTES, SECONDS = 2**30, 60  # of the process
MAX_TABLES = 100  # and as many indexes
DAMAGED = "damaged ({})"


def fault(uri: str, steps: int, step: int) -> str | None:
    """Why a database is not one of plain tables that can be read in so many steps of instructions, or None.

    All else is a program, which may fill the memory or never end.
    """
    left = iter(range(steps))
    try:
        with closing(sqlite3.connect(uri, uri=True)) as database:
            database.set_progress_handler(lambda: next(left, None) is None, step)
            kinds = dict(database.execute("SELECT type, count(*) FROM sqlite_master GROUP BY type").fetchall())
            if more := sorted(set(kinds) - {"table", "index"}):
                return f"holds a {more[0]!r}".replace("'", "")
            if max(kinds.values(), default=0) > MAX_TABLES:
                return f"holds {max(kinds.values()):,} tables or indexes"
            (sound,) = database.execute("PRAGMA quick_check(1)").fetchone()  # a page that is named twice has no end
            if sound != "ok":
                return DAMAGED.format(str(sound)[:80])
            computed = database.execute(
                "SELECT sql LIKE 'create virtual%' OR EXISTS "
                "(SELECT 1 FROM pragma_table_xinfo(tables.name) WHERE hidden) "
                "FROM sqlite_master AS tables WHERE type = 'table'"
            ).fetchall()
    except (sqlite3.Error, MemoryError) as error:
        return DAMAGED.format(str(error)[:80] or "takes too much memory")
    return "holds a table that computes its content" if any(one for (one,) in computed) else None


def main() -> None:
    """Look at the database of the first argument; the others say in how many steps, and of how many instructions."""
    limit(MEMORY_BYTES, SECONDS)
    sys.stdout.write(json.dumps(fault(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]))))
