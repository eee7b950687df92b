"""Commands that score sinew where the answer is known."""

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
