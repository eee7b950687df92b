"""From a study to its simulator."""

from dataclasses import replace
from pathlib import Path

from sinew.runner.errors import BadInput, shown
from sinew.tasks.model.effect import Effect
from sinew.tasks.simulate import Simulator
from sinew.tasks.simulate.febio import fidelities
from sinew.tasks.simulate.febio.attempt import solver_version
from sinew.tasks.simulate.febio.settings import FEBioSettings, SolverSettings, TemplateSettings
from sinew.tasks.simulate.febio.simulator import FEBio
from sinew.tasks.simulate.registry import kinds, of_the_tissue
from sinew.tasks.simulate.settings import Purpose, SimulatorSettings
from sinew.tasks.study.model import effects_of, model_of
from sinew.tasks.study.study import Study
from sinew.tasks.study.trust import Request


def simulator_of(study: Study, name: str | None, scratch: Path, kept: Path | None = None) -> Simulator:
    """The study's simulator, or that called ``name`` with its default settings; solvers run below ``scratch``.

    Where a study asks for it, runs are kept in the folder ``kept``.
    Raises :class:`BadInput` when the solver or its template cannot be used.
    """
    settings: SimulatorSettings = study.simulator
    if name not in (None, settings.name):
        if settings.law != "tendon":
            raise BadInput("--simulator", f"{name} cannot run a study with a template", "no --simulator")
        if name not in of_the_tissue():
            raise BadInput("--simulator", shown(name), f"one of {', '.join(of_the_tissue())}")
        settings = kinds()[name].model_validate({})
        if lacking := [each for each in study.compared if each not in settings.comparable]:
            raise BadInput("--simulator", f"{name} has no {lacking[0]}, which the study compares", "another simulator")
    return settings.build(replace(_purpose(study, effects_of(study.model), scratch), kept=kept))


def cheaper_of(study: Study, fine: Simulator, scratch: Path) -> dict[str, Simulator]:
    """What stands in for the study's simulator ``fine``, by name, the cheapest first; nothing for most studies.

    Raises :class:`BadInput`.
    """
    settings = study.simulator
    if not isinstance(settings, TemplateSettings) or not settings.cheaper:
        return {}
    return fidelities.cheaper_of(settings, _purpose(study, effects_of(study.model), scratch), fine)


def febio_of(study: Study, effects: tuple[Effect, ...], scratch: Path) -> FEBio:
    """FEBio with ``effects`` and the study's settings, to render its input and, if it is installed, to run it.

    Raises :class:`BadInput` for effects that have no FEBio input.
    """
    settings = study.simulator if isinstance(study.simulator, FEBioSettings) else FEBioSettings()
    purpose = _purpose(study, (), scratch)
    template = settings.read_template(purpose).with_effects(effects)  # all of them, none around it
    found, confirmed = settings.found(purpose, template)
    version = solver_version(found, confirmed) if found else ""
    name = str(found or purpose.solver or settings.executable)
    return replace(settings.with_solver(template, name, version, scratch), confirmed=confirmed)


def solver_request(study: Study) -> Request | None:
    """What a study asks to run as its solver, if only the user may allow it. Raises :class:`BadInput`."""
    settings = study.simulator
    if not isinstance(settings, SolverSettings):
        return None
    purpose = _purpose(study, effects_of(study.model), Path())
    return settings.request(purpose, settings.read_template(purpose))


def _purpose(study: Study, effects: tuple[Effect, ...], scratch: Path) -> Purpose:
    sized = study.protocols is None or study.specimen is not None
    return Purpose(
        study.path,
        study.text,
        model_of(study.model, study.simulator.law),
        effects,
        sized,
        scratch,
        study.solver,
        study.compared,
    )
