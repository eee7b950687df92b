"""Failures: rows without a number, tasks without a result, files that cannot be read."""

from sinew.tasks.drawing.blocks import Block, Section, Table, Words, plural
from sinew.tasks.report.folder import ResultFolder


def section(found: ResultFolder) -> Section:
    """What failed in this folder, and what can be done."""
    title, question = "Failures", "What went wrong, and does it matter?"
    blocks: list[Block] = [Words(line, "warning") for line in found.trouble]
    for task, state in found.states.items():
        if state.word in ("failed", "stopped") or (state.word == "done" and state.why):
            blocks.append(Words(f"{task}: {state.word}; {state.why}", "warning"))
    tables = found.status["tables"] if found.status else []
    failed = sum(sum(table["failed"].values()) for table in tables)
    rows = sum(table["rows"] for table in tables)
    left = sum(table["rows"] - table["done"] for table in tables)
    if failed:
        lines = [
            [table["table"], f"{table['rows']:,}", status, f"{count:,}"]
            for table in tables
            for status, count in table["failed"].items()
        ]
        blocks.append(Table("Failed rows by reason", ["evaluations", "rows", "status", "failed"], lines, words=(2,)))
        words = [
            [failure["table"], str(failure["row"]), failure["status"], failure["message"], failure["node"]]
            for failure in (found.status or {}).get("last_failures", [])
        ]
        header = ["evaluations", "row", "status", "the solver's last words", "node"]
        blocks.append(Table("The last of them", header, words, words=(2, 3, 4)))
        again = "Failed rows hold no numbers and nothing computes with them. `--retry-failed` evaluates them again."
        blocks.append(Words(again, "note"))
    if left:
        words_left = f"{plural(left, 'row')} of {rows:,} planned rows have no outcome yet: run the same command again."
        blocks.append(Words(words_left, "note"))
    if not blocks:
        blocks.append(Words(f"Nothing failed: {plural(rows, 'row')}, all with an outcome."))
    return Section("failures", title, question, blocks)
