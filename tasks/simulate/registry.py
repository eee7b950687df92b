"""All simulators that a study can name: their settings, each with a ``name`` of its own."""

from typing import Annotated, get_args

from pydantic import Field

from sinew.tasks.simulate.febio.settings import FEBioSettings, TemplateSettings
from sinew.tasks.simulate.settings import SimulatorSettings, UniaxialSettings

AnySimulator = Annotated[
    UniaxialSettings | FEBioSettings | TemplateSettings,  # a new simulator is added here
    Field(discriminator="name"),
]


def kinds() -> dict[str, type[SimulatorSettings]]:
    """The settings of each simulator, by its name."""
    return {kind.model_fields["name"].default: kind for kind in get_args(get_args(AnySimulator)[0])}


def of_the_tissue() -> list[str]:
    """Names of the simulators of sinew's own tissue: a study of it can use any of these with default settings."""
    return [name for name, kind in kinds().items() if kind.law == "tendon"]


def of_own_models() -> list[str]:
    """Names of the simulators whose model and parameters come from the study."""
    return [name for name, kind in kinds().items() if kind.law != "tendon"]
