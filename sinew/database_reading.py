"""The process that looks at an SQLite database before anything else opens it: what is wrong with it, as JSON.

The schema alone may fill the memory or have no end, and SQLite reads it with the first question. So the look has a
process of its own, with limits.
"""

import json
import sqlite3
import sys
from collections.abc import Mapping
from contextlib import closing
from pathlib import Path
from typing import Any

from sinew.runner.limits import limit

MEMORY_BYTES, SECONDS = 2**31, 60  # of the process
MAX_TABLES = 100  # and as many indexes
MOST_ROWS = {"version": 1, "abc_smc": 1, "populations": 10_000}  # pyABC asks for each of them once more
MAX_TEXT_BYTES = 2**16
#: What is averaged: a missing or infinite one would make means of nothing.
NUMBERS = {"particles": ("w",), "parameters": ("value",)}
NO_NUMBER = "{0} IS NULL OR abs({0}) > 1.7976931348623157e308"
DAMAGED = "damaged ({})"
#: What SQLite, which keeps any value in any column, may hold where SQLAlchemy expects a type of Python.
HELD = {
    "int": ("integer", "null"),
    "float": ("real", "integer", "null"),
    "str": ("text", "null"),
    "datetime": ("text", "null"),
    "object": ("blob", "null"),
}
NO_TIME = "{} NOT GLOB '[0-9][0-9][0-9][0-9]-[01][0-9]-[0-3][0-9] [0-2][0-9]:[0-5][0-9]:[0-5][0-9]*'"

Schema = Mapping[str, Mapping[str, str]]  # the types of Python of the columns of each table


def fault(uri: str, steps: int, step: int, schema: Schema) -> str | None:
    """Why a database is not one of plain tables that can be read in so many steps of instructions, or None.

    All else is a program, which may fill the memory or never end. It has all tables and columns of ``schema``.
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
            if any(one for (one,) in computed):
                return "holds a table that computes its content"
            return next(filter(None, (_other(database, *table) for table in schema.items())), None)
    except (sqlite3.Error, MemoryError) as error:
        return DAMAGED.format(str(error)[:80] or "takes too much memory")


def _other(database: sqlite3.Connection, table: str, columns: Mapping[str, str]) -> str | None:
    """What a table does not hold of what it should, or None. The names are those of the schema, not of the file."""

    def found(query: str) -> list[Any]:
        return [one for (one,) in database.execute(query)]

    there = {name for (name,) in database.execute("SELECT name FROM pragma_table_info(?)", (table,))}
    if missing := [column for column in columns if column not in there]:
        return f"has no {table}.{missing[0]}"
    if found(f"SELECT EXISTS (SELECT 1 FROM {table})") == [0]:  # noqa: S608
        return f"holds nothing in {table}"
    if table in MOST_ROWS and (rows := found(f"SELECT count(*) FROM {table}")[0]) > MOST_ROWS[table]:  # noqa: S608
        return f"holds {rows:,} rows in {table}"
    for column, kind in columns.items():
        held = found(f"SELECT DISTINCT typeof({column}) FROM {table}")  # noqa: S608
        wrong = sorted(set(held) - set(HELD[kind]))
        if not wrong and kind == "datetime":
            wrong = found(f"SELECT 'text' FROM {table} WHERE {NO_TIME.format(column)}")  # noqa: S608
        if not wrong and kind == "str":
            longest = f"SELECT 'a text of ' || max(length(CAST({column} AS BLOB))) || ' bytes' FROM {table}"  # noqa: S608
            wrong = found(f"{longest} HAVING max(length(CAST({column} AS BLOB))) > {MAX_TEXT_BYTES}")
        if not wrong and column in NUMBERS.get(table, ()):
            wrong = found(f"SELECT 'no finite number' FROM {table} WHERE {NO_NUMBER.format(column)} LIMIT 1")  # noqa: S608
        if wrong:
            return f"holds {wrong[0]} in {table}.{column}"
    return None


def main() -> None:
    """Look at the database of the first argument.

    The others say in how many steps, of how many instructions, and its schema as JSON.
    """
    limit(MEMORY_BYTES, SECONDS)
    path, steps, step, schema = sys.argv[1:5]
    wrong = fault(f"{Path(path).as_uri()}?mode=ro", int(steps), int(step), json.loads(schema))
    sys.stdout.write(json.dumps(wrong or _unreadable(path)))


def _unreadable(path: str) -> str | None:
    """Why pyABC cannot read the whole file; or None."""
    import pyabc

    try:
        history = pyabc.History(f"sqlite:///{path}", create=False)
        populations = history.get_all_populations()["t"]
        if (populations >= 0).sum() != history.max_t + 1:  # the one before them is the calibration
            return DAMAGED.format("generations are missing")
        for generation in range(history.max_t + 1):
            history.get_weighted_distances(generation)
            for model in history.alive_models(generation):
                history.get_distribution(int(model), generation)
    except Exception as error:  # noqa: BLE001 - what libraries raise for damaged files is no closed list
        return DAMAGED.format(error)
    return None
