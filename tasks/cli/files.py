"""Commands that make studies and cohorts from files."""

import json
import math
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from sinew.runner.errors import BadInput, one_line, shown
from sinew.runner.printing import put
from sinew.tasks.cli.group import PATH, sinew
from sinew.tasks.cli.reading_options import reading_options
from sinew.tasks.cli.terminal import (
    command_line,
    say_next,
)

if TYPE_CHECKING:
    from sinew.tasks.data.init import NewStudy
    from sinew.tasks.data.new_model_study import Choices

MOST_REMARKS = 20  # on a file of many tests, that are shown


@sinew.command()
@click.argument("files", type=PATH, nargs=-1)
@click.option("--out", type=PATH, required=True, help="Folder to write: study.yaml and cohort/.")
@click.option("--length-mm", type=float, help="Gauge length, where files do not say.")
@click.option("--width-mm", type=float, help="Width, where files do not say.")
@click.option("--thickness-mm", type=float, help="Thickness, where files do not say.")
@click.option("--diameter-mm", type=float, help="Diameter of a round specimen, instead of width and thickness.")
@click.option("--area-mm2", type=float, help="Cross-sectional area: the specimen becomes a square bar of this area.")
@click.option("--override", is_flag=True, help="Use these sizes even where files give others.")
@reading_options
@click.option("--answers", type=PATH, help="answers.yaml of an earlier study: what was told then is not asked again.")
@click.option("--yes", is_flag=True, help="Ask nothing, and take only what is certain; refuse the rest.")
@click.option("--vary", multiple=True, metavar="NAME[=MIN:MAX]", help="Of a FEBio model: a number that varies.")
@click.option("--move", metavar="NAME", help="Of a FEBio model: the displacement that follows the measured one.")
@click.option("--move-factor", type=float, default=1.0, help="How far it goes for 1 mm of the measured displacement.")
@click.option("--measure", multiple=True, metavar="NAME=ITEM@SET", help="Of a FEBio model: an output.")
@click.option("--fibre", metavar="NAME", help="Of a FEBio model: the material that is the fibre, for `discover`.")
@click.option("--matrix", metavar="NAME", help="Of a FEBio model: the material that is the matrix, for `discover`.")
@click.option("--json", "as_json", is_flag=True, help="What was made, as a JSON object.")
def init(
    files: tuple[Path, ...],
    out: Path,
    length_mm: float | None,
    width_mm: float | None,
    thickness_mm: float | None,
    diameter_mm: float | None,
    area_mm2: float | None,
    override: bool,
    answers: Path | None,
    yes: bool,
    vary: tuple[str, ...],
    move: str | None,
    move_factor: float,
    measure: tuple[str, ...],
    fibre: str | None,
    matrix: str | None,
    as_json: bool,
    **hints: Any,
) -> None:
    """Make a study of your own files: a cohort and a study.yaml.

    FILES are tables of tests (CSV, TSV, text, exports of testing machines), folders of them, or a cohort that has
    sinew's layout already. Columns, separators and names are guessed and listed. Units are read from the files or
    given, never guessed. On a terminal, the command asks for what no file tells. Answers are kept in answers.yaml
    beside the study.

    A FEBio model (model.feb) becomes a study with a template. Without --vary, what it holds is listed.
    """
    asks = _is_dialogue() and not (as_json or yes)
    if len(files) == 1 and files[0].suffix.lower() == ".feb":
        from sinew.tasks.data.new_model_study import Choices

        choices = Choices(vary, move, move_factor, measure, fibre, matrix)
        _init_model(files[0], out, choices, as_json=as_json, asks=asks)
        return
    _refuse_without_model(vary, move, measure, fibre, matrix)
    from sinew.tasks.data.answers import read_answers
    from sinew.tasks.data.hints import Hints
    from sinew.tasks.data.init import OVERVIEW
    from sinew.tasks.data.init import init as make
    from sinew.tasks.data.specimen_sizes import Sizes

    made = make(
        files,
        out,
        hints=Hints(**hints),
        sizes=Sizes.of(length_mm, width_mm, thickness_mm, diameter_mm, area_mm2, override=override),
        ask=_ask if asks else None,
        answers=None if answers is None else read_answers(answers),
        certain=yes,
        show=_show if asks else None,
    )
    _tell(made, out / OVERVIEW, as_json=as_json)


def _tell(made: "NewStudy", overview: Path, *, as_json: bool) -> None:
    """Say what was made, and draw it."""
    from sinew.tasks.data.overview import draw_overview

    drawn = draw_overview(overview, made.specimens)
    if as_json:
        fill_in = [str(path) for path in made.to_fill_in]
        put(json.dumps({"study": str(made.study), "told": made.lines, "fill_in": fill_in}))
        return
    for line in made.lines:
        put(line)
    for path in made.to_fill_in:
        put(f"fill in: {path}")
    put(f"look at {_drawn(drawn, sum(len(one.curves) for one in made.specimens))}: {overview}")
    put(f"study: {made.study}")
    if made.to_fill_in:
        folder = made.study.parent
        beside = folder if folder.name else folder.resolve()  # "."
        scaled = command_line("init", folder / "cohort", "--out", beside.parent / f"{beside.name}-scaled")
        say_next(f"fill in what is marked null there; then, for ranges that fit the tests: {scaled}")
    else:
        say_next(command_line("run", made.study))


def _init_model(path: Path, out: Path, choices: "Choices", *, as_json: bool, asks: bool) -> None:
    from sinew.tasks.data.new_model_study import init_model
    from sinew.tasks.simulate.febio.model_file import listing
    from sinew.tasks.simulate.febio.model_file.contents import contents_of
    from sinew.tasks.simulate.febio.model_file.source import read_source

    if not 1e-100 <= abs(choices.factor) <= 1e100:
        raise BadInput("--move-factor", str(choices.factor), "a number that is not 0, of at most 1e100")
    source = read_source(path)
    contents = contents_of(source)
    if not choices.vary:
        if as_json:
            put(json.dumps(listing.as_json(source, contents)))
            return
        for line in listing.lines(source, contents):
            put(line)
        if not asks:
            say_next(command_line("init", path, "--out", out, "--vary", "NAME", "--move", "NAME"))
            return
        vary = _several("what varies? (NAME or NAME=MIN:MAX; several with ';')")
        move = choices.move or _ask("what is moved by the measured displacement? (empty: nothing)", ()) or None
        measure = choices.measure or _several("which outputs beside its force? (NAME=ITEM@SET; empty: none)")
        choices = replace(choices, vary=vary, move=move, measure=measure)
    made = init_model(source, contents, choices, out)
    if as_json:
        put(json.dumps({"study": str(made.study), "told": made.lines}))
        return
    for line in made.lines:
        put(line)
    put(f"study: {made.study}")
    say_next(command_line("doctor", made.study))


def _drawn(drawn: int, tests: int) -> str:
    return "the tests" if drawn == tests else f"the first {drawn} of {tests:,} tests"


def _refuse_without_model(*choices: object) -> None:
    if any(choices):
        raise BadInput("--vary, --move, --measure, --fibre and --matrix", "without a FEBio model", "one file model.feb")


def _several(question: str) -> list[str]:
    return [part.strip() for part in _ask(question, ()).split(";") if part.strip()]


def _is_dialogue() -> bool:
    return sys.stdin.isatty() and sys.stdout.isatty()


def _show(titles: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print a table. Its cells come from files of others: nothing in them steers the terminal."""
    from rich.table import Table as Grid

    from sinew.runner.console import Console

    grid = Grid(title="what the files are taken for", show_lines=True)
    for title in titles:
        grid.add_column(one_line(title), overflow="fold")
    for row in rows:
        grid.add_row(*(one_line(cell) for cell in row))
    Console(highlight=False).print(grid)


def _ask(question: str, choices: Sequence[str]) -> str:
    """The answer to a question. Names in it come from files of others: nothing in them steers the terminal."""
    shown = {one_line(choice): choice for choice in choices}
    kind = click.Choice(list(shown)) if choices else None
    answer = str(click.prompt(one_line(question), type=kind, default=None if choices else "", show_default=False))
    return shown.get(answer, answer)


@sinew.command()
@click.option("--out", type=PATH, required=True, help="Folder to write.")
@click.option("--seed", type=click.IntRange(0, 2**32 - 1), default=0, show_default=True)
@click.option("--per-site", type=click.IntRange(1, 9), default=9, show_default=True, help="Specimens of each site.")
@click.option("--rate", type=click.FloatRange(0.5, 1000), default=100.0, show_default=True, help="Samples per second.")
@click.option(
    "--noise", type=click.FloatRange(0, 1), default=0.003, show_default=True, help="Fraction of the peak force."
)
@click.option(
    "--ar1", type=click.FloatRange(0, 0.999), default=0.3, show_default=True, help="Correlation of neighbours."
)
@click.option("--effect", help="Hide an effect of the library in all specimens, at its typical size.")
@click.option(
    "--screw",
    type=click.FloatRange(0, 1),
    default=0.0,
    help="Hide an uneven lead screw, which the library does not have: its largest error over the largest displacement.",
)
def cohort(
    out: Path, seed: int, per_site: int, rate: float, noise: float, ar1: float, effect: str | None, screw: float
) -> None:
    """Make a virtual cohort from the 27 published specimens; its truth is known."""
    from sinew.tasks.data.cohort import write_cohort
    from sinew.tasks.data.virtual import virtual_cohort
    from sinew.tasks.model.effects import named
    from sinew.tasks.study.workspace import check_folder

    for name, value in (("--rate", rate), ("--noise", noise), ("--ar1", ar1), ("--screw", screw)):
        if not math.isfinite(value):
            raise BadInput(name, str(value), "a finite number")
    check_folder(out)
    if effect is not None and effect not in named():
        raise BadInput("--effect", f"{shown(effect)} is no effect", f"one of {', '.join(named())}")
    hidden = () if effect is None else (named()[effect],)
    specimens, truth = virtual_cohort(
        seed=seed, per_site=per_site, rate_hz=rate, noise=noise, ar1=ar1, effects=hidden, screw=screw
    )
    write_cohort(out, specimens, truth)
    curves = sum(len(specimen.curves) for specimen in specimens)
    put(f"{len(specimens)} specimens, {curves} curves, truth.json: {out}")
    say_next(command_line("init", out, "--out", f"{out.name}-study"))


@sinew.command("import")
@click.argument("files", type=PATH, nargs=-1, required=True)
@click.option("--out", type=PATH, help="Cohort folder to write.")
@click.option("--dry-run", is_flag=True, help="Only say what each file is taken for, and what it does not tell.")
@click.option("--json", "as_json", is_flag=True, help="With --dry-run: as JSON, a list with an object for each file.")
@click.option("--protocol", help="Name of the protocol (default: relaxation if the file mentions a hold, else test).")
@click.option("--specimen", help="All files are protocols of one specimen of this name, each named after its file.")
@click.option("--tare", is_flag=True, help="The same as --zero-force first.")
@click.option("--time", help="The same as --time-unit.")
@click.option("--stress", help="The same as --force-unit, for stresses.")
@click.option("--reference", type=float, help="Stretch at zero displacement (default: 1).")
@click.option("--length-mm", type=float, help="Gauge length at the reference, in place of the file's.")
@click.option("--area-mm2", type=float, help="Cross-section, in place of the file's.")
@reading_options
def import_(
    files: tuple[Path, ...],
    out: Path | None,
    dry_run: bool,
    as_json: bool,
    protocol: str | None,
    specimen: str | None,
    tare: bool,
    time: str | None,
    stress: str | None,
    reference: float | None,
    length_mm: float | None,
    area_mm2: float | None,
    **hints: Any,
) -> None:
    """Read the files of tests into a cohort, each file a specimen.

    FILES are tables of tests (CSV, TSV, text, spreadsheets, exports of testing machines), as for `sinew init`.
    Columns are time,
    displacement (or stretch or strain) and force (or stress). Without a gauge length in the file, a stretch or strain
    is that of a bar of 1 mm. Without a cross-section, a stress is that of a bar of 1 mm2: forces in N are then mean
    stresses in MPa.
    """
    from sinew.tasks.data.cohort import write_cohort
    from sinew.tasks.data.exports import Reading, read_exports
    from sinew.tasks.data.hints import Hints
    from sinew.tasks.study.workspace import check_folder

    reading = Reading(stress, time, reference, length_mm, area_mm2, tare, Hints(**hints))
    if dry_run:
        sys.exit(_inspect(files, reading, as_json))
    if out is None:
        raise click.UsageError("Missing option '--out'.")
    found = read_exports(files, protocol=protocol, specimen=specimen, reading=reading)
    check_folder(out)
    write_cohort(out, list(found.specimens))
    for one in found.specimens:
        for curve in one.curves:
            stretch = one.stretch(curve.protocol)
            peak_N = max(curve.force_N.max(), curve.force_N.min(), key=abs)
            put(
                f"{one.name}: {curve.name}, {curve.force_N.size:,} points, "
                f"{one.length_mm:g} x {one.width_mm:.4g} x {one.thickness_mm:.4g} mm, "
                f"stretch {stretch.min():.4g} to {stretch.max():.4g}, peak {peak_N:.4g} N"
                f"{', with ' if curve.others else ''}{', '.join(curve.others)}"
            )
            put(one_line(f"    from {curve.source}"))
    for where, names in found.spreads.items():
        put(one_line(f"{where}: {', '.join(names)} left out; a cohort holds curves, and noise is estimated from them"))
    for where, remarks in found.remarks.items():
        for remark in remarks:
            put(one_line(f"{where}: {remark}"))
    say_next(command_line("init", out, "--out", f"{out.name}-study"))


def _inspect(files: Sequence[Path], reading: Any, as_json: bool) -> int:
    """Print what each file is taken for. The exit code: 2 if one of them cannot be read, else 0."""
    from sinew.tasks.data.inspection import inspect

    found: list[dict[str, Any]] = []
    for path in files:
        try:
            found.append(inspect(path, reading).content())
        except BadInput as error:
            found.append({"file": str(path), "error": str(error)})
    if as_json:
        put(json.dumps(found, indent=1))
    for one in [] if as_json else found:
        put(one_line(_sentence(one)))
        for question in one.get("ask", ()):
            put(one_line(f"  ask: {question}"))
        remarks = one.get("remarks", ())
        for remark in remarks[:MOST_REMARKS]:
            put(one_line(f"  remark: {remark}"))
        if len(remarks) > MOST_REMARKS:
            put(f"  remark: {len(remarks) - MOST_REMARKS:,} more; --json lists all")
    return 2 if any("error" in one for one in found) else 0


def _sentence(one: dict[str, Any]) -> str:
    if "error" in one:
        return f"refused: {one['error']}"
    columns = [
        f"{name} from '{value['column']}' ({value['unit'] or 'unit?'})"
        for name, value in one.items()
        if isinstance(value, dict)
    ]
    sizes = [
        f"{name.rpartition('_')[0]} {value:g} mm{'2' if name.endswith('2') else ''}"
        for name, value in one.items()
        if name.endswith(("_mm", "_mm2")) and value is not None
    ]
    where = f"{one['file']}, sheet {shown(one['sheet'])}" if one.get("sheet") else one["file"]
    return f"{where}: {', '.join([*columns, *sizes])}; {one['rows']:,} rows, tests: {one['specimens']}"
