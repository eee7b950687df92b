"""A bar that stands in for a model of the user's own: the embedded simulator with that model's parameters.

It costs next to nothing. How much it tells of the model is measured where it is used
(:mod:`sinew.tasks.sobol.by_chaos`); nothing is taken from it that the model itself has not confirmed.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from sinew.tasks.model import TENDON, Curve, Model, Protocol, Specimen
from sinew.tasks.simulate import Array, Capabilities, Compared, Output, Simulated, rmse_of
from sinew.tasks.simulate.bar_parameters import CONSTANTS, LEFT_OUT
from sinew.tasks.simulate.uniaxial import LANES, Uniaxial


@dataclass(frozen=True)
class StandIn:
    """The bar: ``given`` says which of the model's parameters, or which number, each of its own is.

    ``force`` is the model's output that is the force, as whose values the bar's are stored.
    """

    given: tuple[tuple[str, str | float], ...]
    force: Output
    name: str = "bar"

    @property
    def capabilities(self) -> Capabilities:
        return Capabilities(LANES, quick=True, outputs=(self.force,), force=self.force.name)

    def identity(self) -> dict[str, Any]:
        of_bar = Uniaxial().identity() | {"given": [list(each) for each in self.given]}
        return {"name": self.name, "output": [self.force.name, self.force.summary], "bar": of_bar}

    def simulate(
        self, model: Model, specimen: Specimen, protocol: Protocol, parameters: Array, *, stresses: bool = False
    ) -> Simulated:
        given = dict(self.given)
        columns = [_column(parameter.name, given, model, parameters) for parameter in TENDON]
        usual = Model()
        beta, lambda_0 = (float(given.get(name, getattr(usual, name))) for name in CONSTANTS)
        bar = Model(beta=beta, lambda_0=lambda_0)
        return Uniaxial().simulate(bar, specimen, protocol, np.column_stack(columns), stresses=stresses)

    def compare(self, model: Model, specimen: Specimen, curve: Curve, parameters: Array, keep: Array) -> Compared:
        found = self.simulate(model, specimen, curve.protocol, parameters)
        rmse = rmse_of(found.force_N, curve.force_N)
        kept = found.force_N[:, keep]
        course, number = {self.force.name: kept}, {self.force.name: self.force.summarised(found.force_N)}
        none = np.full(len(parameters), np.nan)
        return Compared(rmse, kept, found.status, found.messages, course, number, dict.fromkeys(curve.others, none))


def _column(name: str, given: Mapping[str, str | float], model: Model, parameters: Array) -> Array:
    """A parameter of the bar ``[n]``."""
    what = given.get(name, LEFT_OUT.get(name, LEFT_OUT.get(name.partition("_")[0])))
    assert what is not None, "every parameter of the tissue has a value that changes nothing"
    if isinstance(what, str):
        return np.asarray(parameters[:, model.names.index(what)])
    return np.full(len(parameters), float(what))
