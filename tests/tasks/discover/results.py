"""A discovery's result that is made up, for tests of what reads one."""

from collections.abc import Mapping
from typing import Any

from sinew.tasks.discover.follow_up import AddedModel, Checks, SolverCheck
from sinew.tasks.discover.judge.confidence import confidence
from sinew.tasks.discover.misfit_map import CellMisfit, NoiseLevel
from sinew.tasks.discover.result import (
    Apart,
    BareFit,
    CandidateResult,
    Conflict,
    DiscoverResult,
    Estimate,
    Gain,
    Gap,
    SpecimenConflict,
    SplitGap,
)


def candidate(
    *effects: str,
    loss: float,
    null: float = 5000.0,
    free: int = 2,
    held_out: float | None = None,
    **intervals: tuple[float, float],
) -> CandidateResult:
    """A candidate whose criterion is its loss and 8 for each parameter; ``intervals`` are those of both specimens."""
    parameters = {name: Estimate(sum(ends) / 2, "1", ends) for name, ends in intervals.items()}
    return CandidateResult(
        effects=effects,
        forms=effects,
        loss=loss,
        free=free,
        gain=null - loss - 8.0 * free,
        gains={},
        explained=None,
        held_out=held_out,
        held_out_error=None if held_out is None else 1.0,
        splits={} if held_out is None else {"protocol": Gain(held_out, 1.0)},
        beyond_one={},
        in_place=None,
        on_bound=(),
        parameters={"s01": parameters, "s02": parameters} if parameters else {},
        shared={},
    )


CELL = CellMisfit("cyclic", "toe", 1, 5.0, 1.5, 3.0, 4.0)


def discovery(word: Any = "NONE", null: float = 5000.0, floor: float = 1000.0, **fields: Any) -> DiscoverResult:
    """A result with a verdict on one specimen, ``a/1``; ``fields`` replace others."""
    one = SpecimenConflict(10.0, 5, 0.08, (("cyclic", 10.0),), (Apart("E_f", 2.0, ("a", "b"), (200.0, 210.0)),))
    made: Mapping[str, Any] = {
        "verdict": word,
        "effects": (),
        "set": (),
        "why": "because",
        "confidence": confidence(word),
        "explained": None,
        "null": BareFit(null, floor, True, {"a/1": (null,)}),
        "conflict": Conflict(10.0, 5, 0.08, {"a/1": one}),
        "located": True,
        "surely": True,
        "noise": {"a/1": NoiseLevel(1.0, 0.3, 0.0)},
        "candidates": (),
        "cells": {"a/1": (CELL,)},
        "shown": (),
        "gap": Gap("protocol", 2.0, 1.0, 1.0, 1.0, {"protocol": SplitGap(2.0, 1.0, 1.0, 1.0)}),
        "next_experiment": None,
        "outside": None,
        "model": None,
        "inputs": "these",
    }
    return DiscoverResult(**{**made, **fields})


MODEL = AddedModel("discover/model.yaml", "", Checks(0.0, 9.0, 1.0, True), SolverCheck(("one.feb",), False, "why"))
