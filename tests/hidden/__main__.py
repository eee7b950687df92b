"""Write a folder of cohorts with something hidden: python -m tests.hidden --out FOLDER --cases 24 --seed 7."""

from pathlib import Path

import click
import numpy as np

from tests.hidden.forms import FORMS, OUTSIDE
from tests.hidden.make import SMALL, Plan, plans, write


@click.command()
@click.option("--out", type=click.Path(path_type=Path), required=True, help="Folder to write.")
@click.option("--cases", type=click.IntRange(1, 99), default=24, show_default=True)
@click.option("--seed", type=click.IntRange(0, 2**32 - 1), default=0, show_default=True)
@click.option("--rate", type=click.FloatRange(0.5, 1000), default=10.0, show_default=True, help="Samples per second.")
@click.option("--simulator", type=click.Choice(["own", "febio"]), default="own", show_default=True)
@click.option(
    "--form",
    "forms",
    multiple=True,
    help=f"One case with these forms, joined by +, in place of --cases; :small makes them small. none, or some of "
    f"{', '.join([*FORMS, *OUTSIDE])}",
)
def main(out: Path, cases: int, seed: int, rate: float, simulator: str, forms: tuple[str, ...]) -> None:
    """Write cohorts and answers.json for `sinew benchmark discover`."""
    chosen = [_plan(form) for form in forms] or plans(cases, np.random.default_rng(seed))
    write(out, chosen, seed, rate, simulator)
    print(f"{len(chosen)} cases: {out}")


def _plan(text: str) -> Plan:
    names, _, size = text.partition(":")
    chosen = () if names == "none" else tuple(names.split("+"))
    if unknown := [name for name in chosen if name not in FORMS and name not in OUTSIDE]:
        raise click.BadParameter(f"no form {unknown[0]}")
    return Plan(chosen, SMALL if size == "small" else 1.0)


if __name__ == "__main__":
    main()
