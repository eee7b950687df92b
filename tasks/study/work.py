"""What a task will have to do, as far as it can be said before any of it is done."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

from sinew.tasks.data.cohort import Cohort
from sinew.tasks.model import Model, Specimen
from sinew.tasks.simulate import Capabilities
from sinew.tasks.study.study import Study


@dataclass(frozen=True, eq=False)
class Given:
    """What is known of a study before its first evaluation."""

    study: Study
    cohort: Cohort
    model: Model
    can: Capabilities

    def specimens(self, names: Sequence[str] | str) -> tuple[Specimen, ...]:
        """The specimens that a task's settings name."""
        return self.cohort.specimens if isinstance(names, str) else self.cohort.choose(names, str(self.study.path))

    def outcomes(self, specimens: Sequence[Specimen]) -> int:
        """How many outcomes an analysis of these specimens looks at: the total, each protocol, each other output."""
        protocols = {curve.name for specimen in specimens for curve in specimen.curves}
        return 1 + (len(protocols) if len(protocols) > 1 else 0) + len(self.can.outputs)


@dataclass(frozen=True)
class Work:
    """The work of a task: ``rows`` are evaluations of each specimen by the simulator.

    ``here_s`` and ``shared_s`` are processor seconds of the method itself, in the process that leads the run and in
    its workers, on the machine of docs/benchmarks.md. They are measured figures, good to a factor of two.
    """

    rows: Mapping[str, int] = field(default_factory=dict)
    here_s: float = 0.0
    shared_s: float = 0.0

    @property
    def evaluations(self) -> int:
        return sum(self.rows.values())


def points(specimen: Specimen) -> int:
    """Measured points of all curves of a specimen, to which the time of an evaluation is proportional."""
    return sum(curve.protocol.time_s.size for curve in specimen.curves)


def points_kept(specimen: Specimen, most: int | Literal["all"]) -> int:
    """How many points of all curves of a specimen a store keeps, with ``most`` (or all) of each curve."""
    sizes = (curve.protocol.time_s.size for curve in specimen.curves)
    return sum(size if most == "all" else min(most, size) for size in sizes)
