"""The tissue model as data: parameters, specimens and the protocols they are pulled by."""

from tasks.model.parameters import TENDON, Model, Parameter
from tasks.model.specimen import Curve, Protocol, Specimen, file_name

__all__ = ["TENDON", "Curve", "Model", "Parameter", "Protocol", "Specimen", "file_name"]
