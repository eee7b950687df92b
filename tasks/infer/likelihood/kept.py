"""What an unfinished inference keeps: errors of the model, explored specimens, and blocks of sweeps.

A file whose numbers cannot be those of what it claims to be does not count: what it held is computed again.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from sinew.tasks.fitting.roughness import Roughness
from sinew.tasks.infer.likelihood.chains import CHAINS, Block, State
from sinew.tasks.infer.likelihood.chart import Chart
from sinew.tasks.infer.likelihood.compiled import FARTHEST
from sinew.tasks.infer.likelihood.discrepancy import ModelError, QuantityError, lengths_of
from sinew.tasks.infer.likelihood.emulator import Emulator
from sinew.tasks.infer.likelihood.explore import LENGTHS, Explored
from sinew.tasks.infer.likelihood.population import Population
from sinew.tasks.infer.likelihood.target import Target
from sinew.tasks.simulate import Array
from sinew.tasks.study.kept import KeptArrays

Shapes = dict[str, tuple[int | str, ...]]
MODERATE = 1e30  # of variances and precisions of scores, at most; and at least one in so many
OF_A_BLOCK = ("scores", "squares", "mean", "spread", "new", "correlation", "accepted")


def read_model_error(path: Path, inputs: str, target: Target) -> ModelError | None:
    """The model's error in a specimen that was found before, if it was with the same inputs."""
    places = target.measured.places
    shapes: Shapes = {"size": (), "misfit": (), "near": (target.size,)}
    for n, own in enumerate(places.values()):
        shapes |= {f"rough_{n}": (2,), f"directions_{n}": (own.size, f"d_{n}"), f"taken_{n}": (f"d_{n}",)}
    found = KeptArrays(path, inputs).read(shapes)
    if found is None or not _within(found["near"], -FARTHEST, FARTHEST):
        return None
    each = []
    for n, quantity in enumerate(places):
        size, memory = (float(one) for one in found[f"rough_{n}"])
        if not (size >= 0.0 <= memory < 1.0 and _within(found[f"taken_{n}"], 0.0, 1.0)):
            return None
        rough = Roughness(size, memory, lengths_of(target.measured, quantity))
        each.append(QuantityError(rough, found[f"directions_{n}"], found[f"taken_{n}"]))
    size, misfit = float(found["size"]), float(found["misfit"])
    if min(size, misfit) < 0.0:
        return None
    return ModelError(tuple(each), tuple(places.values()), size, misfit, found["near"])


def write_model_error(path: Path, inputs: str, error: ModelError) -> None:
    """Keep the model's error in a specimen."""
    arrays: dict[str, Any] = {"size": error.size, "misfit": error.misfit, "near": error.near}
    for n, one in enumerate(error.each):
        rough = np.array([one.rough.size, one.rough.memory])
        arrays |= {f"rough_{n}": rough, f"directions_{n}": one.directions, f"taken_{n}": one.taken}
    KeptArrays(path, inputs).write({name: np.asarray(array, dtype=np.float64) for name, array in arrays.items()})


def read_explored(path: Path, inputs: str, target: Target) -> Explored | None:
    """A specimen that was explored before, if it was with the same inputs."""
    k = target.size
    terms = 1 + k + k * (k + 1) // 2
    shapes: Shapes = {"centre": (k,), "scale": (k,), "coefficients": (terms, "q"), "rest": (),
              "frame": ("q + k", k), "root": (k, k), "precision": (k, k),
              "length": (), "begin": ("begin", k), "determined": (k,), "error": (), "least": (),
              "left": (len(target.parts),),
              "seen": ("seen", k)}  # fmt: skip
    found = KeptArrays(path, inputs).read(shapes)
    if found is None or not _of_an_explored(found):
        return None
    known = Emulator(found["centre"], found["scale"], found["coefficients"], float(found["rest"]))
    chart = Chart(known, found["frame"], found["root"], found["precision"])
    determined = found["determined"] == 1.0
    error, least = float(found["error"]), float(found["least"])
    begin, left, seen = found["begin"], found["left"], found["seen"]
    return Explored(chart, float(found["length"]), begin, determined, error, least, left, seen)


def _of_an_explored(found: Mapping[str, Array]) -> bool:
    """Whether arrays of the right shapes may be those of an explored specimen."""
    k = found["centre"].size
    return bool(
        len(found["frame"]) == found["coefficients"].shape[1] + k
        and all(len(found[name]) and _within(found[name], -FARTHEST, FARTHEST) for name in ("begin", "seen"))
        and (found["scale"] > 0.0).all()
        and np.isin(found["determined"], (0.0, 1.0)).all()
        and min(found["error"], found["least"], *found["left"]) >= 0.0
        and found["length"] in LENGTHS
        and np.linalg.matrix_rank(found["root"]) == k
        and _positive(found["precision"])
    )


def write_explored(path: Path, inputs: str, explored: Explored) -> None:
    """Keep an explored specimen."""
    chart, known = explored.chart, explored.chart.known
    arrays = {"centre": known.centre, "scale": known.scale, "coefficients": known.coefficients, "rest": known.rest,
              "frame": chart.frame, "root": chart.root, "precision": chart.precision, "length": explored.length,
              "begin": explored.begin,
              "determined": explored.determined, "error": explored.error, "least": explored.least,
              "left": explored.left,
              "seen": explored.seen}  # fmt: skip
    KeptArrays(path, inputs).write({name: np.asarray(array, dtype=np.float64) for name, array in arrays.items()})


def read_block(path: Path, inputs: str, specimens: int, size: int) -> Block | None:
    """A block of sweeps of an ensemble that was made before, if it was with the same inputs."""
    n, k = specimens, size
    c, s = CHAINS, "sweeps"
    shapes: Shapes = {
        "state_scores": (n, c, k), "state_squares": (n, c), "state_mean": (c, k), "state_precision": (c, k, k),
        "state_scales": (c, k), "state_weights": (n, c), "sweep": (),
        "scores": (s, c, n, k), "squares": (s, c, n), "mean": (s, c, k), "spread": (s, c, k), "new": (s, c, k),
        "correlation": (s, k, k), "accepted": (n,),
    }  # fmt: skip
    found = KeptArrays(path, inputs).read(shapes)
    if found is None or not _of_a_block(found):
        return None
    population = Population(*(found[f"state_{name}"] for name in ("mean", "precision", "scales", "weights")))
    state = State(found["state_scores"], found["state_squares"], population, int(found["sweep"]))
    return Block(state, *(found[name] for name in OF_A_BLOCK))


def _of_a_block(found: Mapping[str, Array]) -> bool:
    """Whether arrays of the right shapes may be those of a block."""
    sweep, sweeps = float(found["sweep"]), len(found["scores"])
    return bool(
        sweeps
        and sweep.is_integer()
        and sweeps <= sweep < 2**31
        and all(_within(found[name], -FARTHEST, FARTHEST) for name in ("scores", "state_scores"))
        and all((found[name] >= 0.0).all() for name in ("squares", "state_squares"))
        and all(_within(found[name], 1 / MODERATE, MODERATE) for name in ("state_scales", "state_weights", "spread"))
        and all(_within(found[name], -MODERATE, MODERATE) for name in ("mean", "state_mean", "new"))
        and _within(found["correlation"], -1.0 - 1e-9, 1.0 + 1e-9)
        and _within(found["accepted"], 0.0, 1.0)
        and _positive(found["state_precision"])
    )


def _within(values: Array, low: float, high: float) -> bool:
    return bool(((values >= low) & (values <= high)).all())


def _positive(matrices: Array) -> bool:
    """Whether matrices ``[..., k, k]`` can be precisions: symmetric, with moderate eigenvalues above 0."""
    if not np.allclose(matrices, np.swapaxes(matrices, -1, -2), rtol=0.0, atol=1e-6 * np.abs(matrices).max()):
        return False
    return _within(np.linalg.eigvalsh(matrices), 1 / MODERATE, MODERATE)


def write_block(path: Path, inputs: str, block: Block) -> None:
    """Keep a block of sweeps."""
    state, population = block.state, block.state.population
    arrays: dict[str, Array] = {
        "state_scores": state.scores, "state_squares": state.squares, "state_mean": population.mean,
        "state_precision": population.precision, "state_scales": population.scales,
        "state_weights": population.weights, "sweep": np.array(float(state.sweep)),
    }  # fmt: skip
    KeptArrays(path, inputs).write({**arrays, **{name: getattr(block, name) for name in OF_A_BLOCK}})
