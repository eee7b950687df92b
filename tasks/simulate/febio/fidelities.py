"""What stands in for a model of the user's own, by a study's settings: the model itself decides, these save runs.

==========  ===================================================================================
``bar``     the embedded bar, with parameters of the model or numbers for its own
``coarse``  the same solver on another template (a coarser mesh), or with larger time steps
==========  ===================================================================================
"""

from dataclasses import replace
from typing import cast

from sinew.tasks.simulate import Simulator
from sinew.tasks.simulate.around import Around
from sinew.tasks.simulate.febio.settings import TemplateSettings
from sinew.tasks.simulate.febio.simulator import FEBio
from sinew.tasks.simulate.settings import Purpose
from sinew.tasks.study.trust import require


def cheaper_of(settings: TemplateSettings, purpose: Purpose, fine: Simulator) -> dict[str, Simulator]:
    """The simulators that stand in for ``fine``, by name, the cheapest first. Raises :class:`BadInput`."""
    build = {"bar": _bar, "coarse": _coarse}
    return {name: build[name](settings, purpose, fine) for name in settings.cheaper}


def _coarse(settings: TemplateSettings, purpose: Purpose, fine: Simulator) -> Simulator:
    """The same solver, as it was found and confirmed for the model itself."""
    solver = cast(FEBio, fine.inner if isinstance(fine, Around) else fine)
    template = settings.coarser().read_template(purpose)
    require(settings.request(purpose, solver.template, template))  # of these very texts, which may have changed since
    found = settings.coarser().with_solver(template, solver.executable, solver.version, solver.scratch)
    return replace(found, confirmed=solver.confirmed).surrounded(purpose.effects)


def _bar(settings: TemplateSettings, purpose: Purpose, fine: Simulator) -> Simulator:
    """The bar without the effects that the model may have."""
    from sinew.tasks.simulate.stand_in import StandIn  # numba is slow to import

    given, can = settings.of_the_bar(purpose), fine.capabilities
    return StandIn(tuple(given.items()), next(output for output in can.outputs if output.name == can.force))
