"""Options of the commands that read measurements: how a file is read."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from sinew.tasks.data.hints import Title


def _title(option: str, told: str) -> Callable[..., Any]:
    """An option for the title of a column, or several where files have different ones."""

    def one_or_each(_context: click.Context, _option: click.Parameter, given: tuple[str, ...]) -> "Title | None":
        return given[0] if len(given) == 1 else given or None

    return click.option(option, metavar="NAME", multiple=True, callback=one_or_each, help=told)


_OPTIONS = (
    click.option("--time-unit", metavar="UNIT", help="Unit of times without one: s, ms, min, ..."),
    click.option("--displacement-unit", metavar="UNIT", help="The same for displacements (mm, ...), strains (%, 1)."),
    click.option("--force-unit", metavar="UNIT", help="The same for forces (N, kN, ...) or stresses (kPa, MPa, ...)."),
    _title("--time-column", "Title or number (from 1) of the column of time; repeat it for files with other titles."),
    _title("--displacement-column", "The same for displacement, strain or stretch."),
    _title("--force-column", "The same for force or stress."),
    click.option(
        "--test-column",
        metavar="NAME",
        help="Column that distinguishes the tests in a table, or two with a comma between; 'none' for a single test.",
    ),
    click.option("--cycle-column", metavar="NAME", help="Column of cycles, if times start again with a cycle."),
    click.option(
        "--tables",
        type=click.Choice(["join", "apart", "first"]),
        help="Whether tables that may go on from each other are one test; 'first' leaves out tests with other titles.",
    ),
    click.option(
        "--keep-column",
        metavar="COLUMN=NAME",
        multiple=True,
        callback=lambda _context, _option, value: value or None,
        help="Keep a further column beside the force, such as 'Lateral strain=lateral_strain'; "
        "NAME:UNIT where the file gives no unit.",
    ),
    click.option("--sheet", metavar="NAME", help="Sheet of a spreadsheet that holds the tests; the others tell sizes."),
    click.option("--rate-hz", type=float, help="Rows per second, for files without times."),
    click.option("--speed", type=float, help="Speed of the motion (mm/s; 1/s for strains), for files without times."),
    click.option("--speed-column", metavar="NAME[=UNIT]", help="Column of speeds, for files without times, or 'none'."),
    click.option(
        "--zero-displacement",
        type=click.Choice(["first", "none"]),
        help="Count displacements from their first value.",
    ),
    click.option("--zero-force", type=click.Choice(["first", "none"]), help="The same for forces."),
    click.option(
        "--negate",
        type=click.Choice(["none", "displacement", "force", "both"]),
        help="Reverse the sign of displacements, forces or both; sinew takes tension as positive.",
    ),
    click.option(
        "--preload",
        type=click.Choice(["leave-out", "keep"]),
        help="Leave out the rows before a displacement is set to zero again, or keep them and go on from there.",
    ),
    click.option(
        "--end",
        type=click.Choice(["leave-out", "keep"]),
        help="Leave out the rows after a break, or after a jump of the displacement at the end, or keep them.",
    ),
    click.option(
        "--same-times",
        type=click.Choice(["spread"]),
        help="Spread rows to which a coarse clock gives one time evenly up to its next step.",
    ),
)


def reading_options(function: Callable[..., None]) -> Callable[..., None]:
    """A command with the options that say how a file is read: its columns, units, tests, zeros and signs."""
    for option in reversed(_OPTIONS):
        function = option(function)
    return function
