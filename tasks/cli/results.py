"""Commands that look at a result folder or mend it, and the completion of a shell."""

import json
import logging
from pathlib import Path
from typing import Any

import click

from sinew.runner.errors import BadInput, SinewError, one_line
from sinew.runner.library_logs import libraries_log_to
from sinew.runner.printing import put
from sinew.tasks.cli.group import PATH, sinew, to_see
from sinew.tasks.cli.terminal import (
    SHELLS,
    command_line,
    completion_script,
    say_next,
)


@sinew.command()
@click.argument("folder", type=PATH)
@click.option("--json", "as_json", is_flag=True, help="Machine-readable.")
@click.option("--rows", is_flag=True, help="CSV: which node and job evaluated which row.")
def status(folder: Path, as_json: bool, rows: bool) -> None:
    """Rows done, failed, running and left; rate, cost, jobs, and why rows failed."""
    from sinew.tasks.report.status import print_status, read_status, rows_as_csv

    if rows:
        for line in rows_as_csv(folder):
            put(line)
        return
    found = read_status(folder)
    if as_json:
        put(json.dumps(found, indent=1))
        return
    print_status(found)
    alive = found["now"] is not None and found["now"]["alive"]
    say_next(command_line("watch", folder) if alive else to_see(folder))


@sinew.command()
@click.argument("folder", type=PATH)
@click.option("--once", is_flag=True, help="Show one picture and leave.")
@click.option("--json", "as_json", is_flag=True, help="A JSON object in a line for every change.")
@click.option("--every", type=click.FloatRange(0.1, 3600), default=1.0, show_default=True, help="Refresh interval (s).")
def watch(folder: Path, once: bool, as_json: bool, every: float) -> None:
    """A live view of a result folder, wherever its run is.

    Shows tasks, progress and time left, the best fit or threshold so far, workers and jobs, and the last failures.
    It reads files only and never writes. It waits for a folder that is not there yet, and leaves when the run is over;
    q or Ctrl-C leaves sooner, and whatever runs goes on.
    """
    from sinew.tasks.cli.watch import watch as watch_folder

    try:
        found = watch_folder(folder, form="json" if as_json else "picture", once=once, every_s=every)
    except KeyboardInterrupt:
        found = None
    if as_json:
        return
    if found is not None and found["state"] == "finished":
        say_next(to_see(folder))
    elif found is not None and found["state"] in ("failed", "interrupted"):
        say_next(command_line("status", folder))
    else:
        say_next(command_line("watch", folder))


@sinew.command()
@click.argument("shell", type=click.Choice(SHELLS))
def completion(shell: str) -> None:
    """Print what makes a shell complete commands, options and files."""
    put(completion_script(sinew, shell))


@sinew.command()
@click.argument("folder", type=PATH)
@click.argument("other", type=PATH, required=False)
@click.option("--out", type=PATH, help="The page about two folders (default: comparison.html).")
def report(folder: Path, other: Path | None, out: Path | None) -> None:
    """Write report.html: one page with the results of a folder, whatever state it is in.

    With a second folder, write one page about both: what was set otherwise, and how far their results are apart.
    """
    from sinew.tasks.report.comparison import compare
    from sinew.tasks.report.page import build

    if other is None and out is not None:
        raise BadInput("--out", "given with one folder, whose page lies in it", "a second folder, or no --out")
    with libraries_log_to(logging.NullHandler()):  # Bokeh names what is odd in a damaged result
        built = build(folder) if other is None else compare(folder, other, out or Path("comparison.html"))
    put(built.path)
    if built.trouble:
        more = f" (and {len(built.trouble) - 1} more on the page)" if len(built.trouble) > 1 else ""
        raise SinewError(f"{built.trouble[0]}{more}")


@sinew.command()
@click.argument("folder", type=PATH)
@click.option("--ro-crate", is_flag=True, required=True, help="As an RO-Crate 1.1, the only form there is.")
@click.option("--out", type=PATH, help="A zip if it ends in .zip, else a folder (default: NAME.crate.zip).")
@click.option("--store", is_flag=True, help="With all evaluations (store.zarr) and the log.")
@click.option("--study", type=PATH, help="Where the study file lies now (default: where it lay).")
@click.option("--data", type=PATH, help="Where the cohort lies now (default: where it lay).")
@click.option("--profile", type=PATH, help="With this profile of a cluster.")
@click.option("--license", "licence", help="An SPDX name such as CC-BY-4.0, or an address.")
@click.option("--author", multiple=True, help='"NAME" or "NAME <ORCID>"; several by several --author.')
def export(folder: Path, ro_crate: bool, out: Path | None, author: tuple[str, ...], **options: Any) -> None:
    """Write one file with all that a stranger needs to check and repeat a study.

    It holds the measured curves, the study, its template, the results, the versions of all packages, words for a
    methods section, and the SHA-256 of each file.
    """
    from sinew.tasks.report.crate.export import export as write_crate
    from sinew.tasks.report.crate.metadata import licence_of, person_of

    licence = options.pop("licence")
    done = write_crate(
        folder,
        out,
        licence=None if licence is None else licence_of(licence),
        authors=[person_of(one) for one in author],
        **options,
    )
    for line in done.remarks:
        put(one_line(line))
    put(one_line(f"{done.files:,} files, {done.bytes:,} bytes: {done.path}"))
    say_next("read README.md in it, which says how to run the study again")


@sinew.command()
@click.argument("folder", type=PATH)
def repair(folder: Path) -> None:
    """Make rows in damaged chunks pending; the next run computes them again, all others stay."""
    from sinew.tasks.study.pipeline import repair as repair_store

    done = repair_store(folder)
    for line in done.removed:
        put(one_line(line))
    put(one_line(f"{done.rows} rows are pending now: {folder}"))
    say_next("run the same study again; it computes these rows and no other")


@sinew.command()
@click.argument("folder", type=PATH)
@click.option("--row", "rows", type=click.IntRange(0), multiple=True, help="A row, as in the store.")
@click.option("--indices", is_flag=True, help="The Sobol indices of all fields, in place of rows.")
@click.option("--to", type=PATH, help="Folder for the files (default: FOLDER/vtk).")
@click.option("--table", help="Table of the store, where rows of several have fields.")
def fields(folder: Path, rows: tuple[int, ...], indices: bool, to: Path | None, table: str | None) -> None:
    """Write the kept fields of rows, or their Sobol indices, as VTK files for ParaView: open the .pvd files.

    Fields are kept by studies with `keep: fields`. There is a .pvd file for each row and protocol, and beside it a
    folder with a .vtu file for each state.
    """
    from sinew.tasks.simulate.febio.field_export import export_rows

    if indices == bool(rows):
        raise click.UsageError("Either some --row, or --indices.")
    if indices:
        from sinew.tasks.sobol.field_export import export_indices

        for path in export_indices(folder, to or folder / "vtk"):
            put(one_line(str(path)))
        return
    done = export_rows(folder, rows, to or folder / "vtk", table)
    for path in done.paths:
        put(one_line(str(path)))
    if done.left_out:
        put(one_line(f"not in these files: {', '.join(done.left_out)}"))
    for line in done.damaged:
        put(one_line(line))
    if done.missing:
        more = f" (and {len(done.missing) - 1} more)" if len(done.missing) > 1 else ""
        raise SinewError(f"{done.missing[0]}{more}")
