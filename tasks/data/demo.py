"""The demo: three studies of virtual tendons, which need no data, no solver and no cluster."""

import shutil
from dataclasses import dataclass
from pathlib import Path

from sinew.tasks.data.cohort import write_cohort
from sinew.tasks.data.virtual import virtual_cohort
from sinew.tasks.model.effects import named
from sinew.tasks.study.files import write_text
from sinew.tasks.study.resources import resource
from sinew.tasks.study.workspace import check_folder

SEED = 2503


@dataclass(frozen=True)
class Demo:
    """A study that comes with sinew, ``configs/NAME.yaml``, and the specimens that it is about."""

    name: str
    rate_hz: float = 100.0
    effects: tuple[str, ...] = ()
    screw: float = 0.0


DEMOS = (
    Demo("demo"),
    Demo("hidden", rate_hz=10.0, effects=("toe-slack",)),
    Demo("partly", rate_hz=10.0, effects=("toe-slack",), screw=0.015),
)


def demo_studies(out: Path) -> list[Path]:
    """Write the studies and their cohorts into ``out``; what is there already stays. Returns the study files.

    Raises :class:`sinew.runner.errors.BadInput`.
    """
    check_folder(out)
    return [_write(out, demo) for demo in DEMOS]


def _write(out: Path, demo: Demo) -> Path:
    cohort, study = out / f"{demo.name}-cohort", out / f"{demo.name}.yaml"
    if not cohort.exists():
        effects = tuple(named()[name] for name in demo.effects)
        specimens, truth = virtual_cohort(
            seed=SEED, per_site=1, rate_hz=demo.rate_hz, effects=effects, screw=demo.screw
        )
        partial = out / f".{cohort.name}"
        shutil.rmtree(partial, ignore_errors=True)
        write_cohort(partial, specimens, truth)
        partial.rename(cohort)
    if not study.exists():
        text = resource(f"configs/{demo.name}.yaml").read_text("utf-8")
        write_text(study, text.replace(f"../results/{cohort.name}", cohort.name))
    return study
