"""Commands that score sinew where the answer is known, and that reproduce published work."""

from pathlib import Path

import click

from sinew.runner.printing import put
from sinew.tasks.cli.group import PATH, own_folder, sinew
from sinew.tasks.cli.terminal import say_next


@sinew.group("benchmark")
def benchmark_() -> None:
    """How often is sinew right where the answer is known?"""


@benchmark_.command("discover")
@click.argument("folders", metavar="FOLDER...", type=PATH, nargs=-1, required=True)
@click.option("--out", type=PATH, show_default="results/benchmark", help="Result folder.")
@click.option("--study", type=PATH, help="Settings of every case (default: configs/discover.yaml).")
@click.option("--workers", type=click.IntRange(1, 1024), help="Local worker processes.")
@click.option("--only", multiple=True, metavar="CASE", help="Case to run; may be given several times.")
@click.option("--quiet", is_flag=True, help="No progress and no table.")
def benchmark_discover(
    folders: tuple[Path, ...],
    out: Path | None,
    study: Path | None,
    workers: int | None,
    only: tuple[str, ...],
    quiet: bool,
) -> None:
    """Run `sinew discover` blind on cohorts whose truth is known, and score its verdicts."""
    from sinew.runner.console import Console
    from sinew.tasks.benchmark.discover import benchmark
    from sinew.tasks.benchmark.show import markdown, tell
    from sinew.tasks.study.files import write_text

    def say(line: str) -> None:
        if not quiet:
            put(line)

    out = out or own_folder("benchmark")
    result = benchmark(folders, out, study=study, workers=workers, only=only, say=say)
    write_text(out / "benchmark.md", markdown(result))
    tell(result, Console(quiet=quiet, highlight=False))
    if not quiet:
        put(f"results: {out / 'benchmark.json'}, {out / 'benchmark.md'}")
    say_next(f"read {out / 'benchmark.md'}")


@benchmark_.command("infer")
@click.option("--out", type=PATH, show_default="results/benchmark-infer", help="Result folder.")
@click.option("--study", type=PATH, help="Its model, seed and infer section are used (default: configs/infer.yaml).")
@click.option("--cohorts", type=click.IntRange(1, 9999), default=200, show_default=True, help="How many to draw.")
@click.option("--specimens", type=click.IntRange(2, 99), default=4, show_default=True, help="Of each of two sites.")
@click.option(
    "--protocol",
    "protocols",
    multiple=True,
    metavar="NAME",
    help="Protocol of each specimen; may be repeated (default: all).",
)
@click.option("--rate-hz", type=click.FloatRange(1, 1000), default=20.0, show_default=True, help="Samples per second.")
@click.option("--noise", type=click.FloatRange(1e-5, 0.5), default=0.003, show_default=True, help="Of the peak force.")
@click.option("--effect", default="", help="Hide an effect of the library in all specimens, at its typical size.")
@click.option(
    "--screw",
    type=click.FloatRange(0, 1),
    default=0.0,
    help="Hide an uneven lead screw, which the library does not have: its largest error over the largest displacement.",
)
@click.option("--workers", type=click.IntRange(1, 1024), help="Local worker processes.")
@click.option("--quiet", is_flag=True, help="No progress and no table.")
def benchmark_infer(
    out: Path | None,
    study: Path | None,
    cohorts: int,
    specimens: int,
    protocols: tuple[str, ...],
    rate_hz: float,
    noise: float,
    effect: str,
    screw: float,
    workers: int | None,
    quiet: bool,
) -> None:
    """Draw cohorts from the prior, infer each blind, and count how often posteriors hold the truth."""
    from sinew.runner.console import Console
    from sinew.tasks.benchmark.infer.drawn import Conditions, tests_of
    from sinew.tasks.benchmark.infer.figure import draw
    from sinew.tasks.benchmark.infer.run import benchmark
    from sinew.tasks.benchmark.infer.show import markdown, tell
    from sinew.tasks.study.files import write_text

    def say(line: str) -> None:
        if not quiet:
            put(line)

    out = out or own_folder("benchmark-infer")
    conditions = Conditions(specimens, tests_of(protocols), rate_hz, noise, effect=effect, screw=screw)
    result = benchmark(out, cohorts=cohorts, conditions=conditions, study=study, workers=workers, say=say)
    write_text(out / "benchmark.md", markdown(result))
    draw(result, out)
    tell(result, Console(quiet=quiet, highlight=False))
    if not quiet:
        put(f"results: {out / 'benchmark.json'}, {out / 'benchmark.md'}")
    say_next(f"read {out / 'benchmark.md'}")


@sinew.group("reproduce")
def reproduce_() -> None:
    """Published work, reproduced on specimens whose truth is known."""


@reproduce_.command("paper")
@click.option("--out", type=PATH, show_default="results/paper", help="Folder of the cohort, the run and the paper.")
@click.option("--study", type=PATH, help="Settings in place of the paper's sizes (default: configs/tendon.yaml).")
@click.option("--per-site", type=click.IntRange(1, 9), default=9, show_default=True, help="Specimens of each site.")
@click.option("--rate", type=click.FloatRange(0.5, 1000), default=100.0, show_default=True, help="Samples per second.")
@click.option("--workers", type=click.IntRange(1, 1024), help="Local worker processes.")
@click.option("--quiet", is_flag=True, help="Nothing but errors and the last line.")
def reproduce_paper(
    out: Path | None, study: Path | None, per_site: int, rate: float, workers: int | None, quiet: bool
) -> None:
    """All figures, tables and numbers of Pekedis (2025), beside the truth."""
    from sinew.tasks.benchmark.paper.run import reproduce

    out = out or own_folder("paper")
    missing = reproduce(out, study=study, per_site=per_site, rate_hz=rate, workers=workers, quiet=quiet)
    if missing and not quiet:
        put(f"not drawn by this study: {', '.join(missing)}")
    say_next(f"read {out / 'paper' / 'paper.md'}")
