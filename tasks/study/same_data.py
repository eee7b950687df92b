"""Whether a result is of the measurements, the model and the ranges that the study has now."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from sinew.runner.errors import BadInput
from sinew.tasks.model import Specimen
from sinew.tasks.study.files import digest
from sinew.tasks.study.workspace import Workspace


def data_of(workspace: Workspace, specimens: Sequence[Specimen]) -> dict[str, str]:
    """A digest for each specimen of its curves and sizes, and of the model with its effects and ranges.

    Whatever is compared with it later must be a part of the key of the result that holds it: otherwise a result that is
    refused would not be made anew. The simulators of sinew's own tissue agree with each other, so it does not tell
    them apart; of a model of the user's own, the solver is a part of it.
    """
    model, simulator = workspace.model, workspace.simulator
    effects = list(workspace.study.model.effects)
    ranges = [[one.name, one.minimum, one.maximum, one.reference] for one in model.parameters]
    own_model = simulator.identity() if simulator.capabilities.outputs else {}
    return {one.name: digest(one.identity(), model.identity(), effects, ranges, own_model) for one in specimens}


def refuse_other_data(
    workspace: Workspace, path: Path, then: Mapping[str, str] | None, specimens: Sequence[Specimen], again: str
) -> None:
    """Raises :class:`BadInput` where a result in ``path`` is of other data than these specimens have now.

    ``then``: :func:`data_of` when it was made; None in results of versions that did not keep it, which are believed.
    ``again``: what makes it anew.
    """
    if then is None:
        return
    for name, now in data_of(workspace, specimens).items():
        if then.get(name) != now:
            raise BadInput(
                path, f"{name}: its curves or sizes, the model, its ranges or its solver have changed since", again
            )
