"""The tissue model as data: parameters, specimens and loading protocols."""

from sinew.tasks.model.parameters import TENDON, Model, Parameter
from sinew.tasks.model.specimen import FORCE, Curve, Protocol, Specimen, file_name

__all__ = ["FORCE", "TENDON", "Curve", "Model", "Parameter", "Protocol", "Specimen", "file_name"]
