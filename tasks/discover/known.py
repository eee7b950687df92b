"""A verdict that is known already: on the same inputs, and with all of its files."""

from collections.abc import Sequence
from dataclasses import replace

from sinew.tasks.discover.after.added import study_with
from sinew.tasks.discover.after.curves import stored_as
from sinew.tasks.discover.fit.sizes import by_name
from sinew.tasks.discover.result import COPY, NAMES, WITH_LAWS, DiscoverResult
from sinew.tasks.discover.settings import Settings
from sinew.tasks.model import Specimen
from sinew.tasks.simulate.build import febio_of
from sinew.tasks.simulate.febio import effects_inside
from sinew.tasks.study.cached import cached, key
from sinew.tasks.study.measured import key_of_quantities
from sinew.tasks.study.workspace import Workspace, attempts_folder


def inputs_of(workspace: Workspace, settings: Settings, specimens: Sequence[Specimen]) -> str:
    """The key of all that a verdict depends on, and of nothing else.

    These are the settings and the seed, the model with its ranges, the curves, the simulator, the solver that checks
    the effect, and the method's version. Where files lie, and how the code is written, are not among them.
    """
    model = workspace.model
    ranges = [[one.name, one.minimum, one.maximum, one.reference] for one in model.parameters]
    data = [[specimen.name, specimen.identity()] for specimen in specimens]
    simulators = [workspace.simulator.identity()]
    if model.law == "tendon":
        simulators.append(febio_of(workspace.study, (), attempts_folder(workspace.out)).identity())
    elif where := workspace.simulator.capabilities.constituents:
        simulators.append({"inside": effects_inside.VERSION, "at": dict(where)})
    of = (settings.model_dump(), workspace.seed, model.identity(), ranges, data, simulators)
    return key(DiscoverResult, *of, *key_of_quantities(workspace.study.compared, workspace.study.force_noise))


def known_verdict(workspace: Workspace, specimens: Sequence[Specimen], inputs: str) -> DiscoverResult | None:
    """The verdict on the same inputs, if all of its files are there and nothing is to be tried again."""
    if workspace.retry_failed:
        return None
    known = cached(workspace, DiscoverResult, inputs, [stored_as(one.name) for one in specimens], [COPY])
    if known is None or (workspace.out / COPY).read_bytes() != DiscoverResult.path(workspace.out).read_bytes():
        return None
    if known.verdict in NAMES and (known.model is None or known.judged is None):
        return None  # a name comes with its study; what lies in its place may be anybody's
    if known.model is not None and not all((workspace.out / path).is_file() for path in known.model.febio.inputs):
        return None
    # where the study was renamed or moved, the studies with the effects and with the laws change as well
    model, law = known.model, known.law
    if model is not None and known.judged is not None:
        path, difference = study_with(workspace, by_name(known.judged.forms, specimens))
        model = replace(model, path=path, difference=difference)
    if law is not None:
        path, difference = study_with(workspace, by_name((*law.beside, *law.names), specimens), WITH_LAWS)
        law = replace(law, path=path, difference=difference)
    if (model, law) == (known.model, known.law):
        return known
    moved = replace(known, model=model, law=law)
    moved.write(workspace.out)
    return moved
