"""What an unfinished inference keeps: errors of the model, explored specimens, and blocks of sweeps."""

from pathlib import Path

import numpy as np

from sinew.tasks.fitting.roughness import Roughness
from sinew.tasks.infer.likelihood.chains import Block, State
from sinew.tasks.infer.likelihood.chart import Chart
from sinew.tasks.infer.likelihood.discrepancy import ModelError, lengths_of
from sinew.tasks.infer.likelihood.emulator import Emulator
from sinew.tasks.infer.likelihood.explore import Explored
from sinew.tasks.infer.likelihood.population import Population
from sinew.tasks.infer.likelihood.target import Target
from sinew.tasks.simulate import Array
from sinew.tasks.study.kept import KeptArrays

OF_A_BLOCK = ("scores", "squares", "mean", "spread", "new", "correlation", "accepted")


def read_model_error(path: Path, inputs: str, target: Target) -> ModelError | None:
    """The model's error in a specimen that was found before, if it was with the same inputs."""
    shapes = {"rough": (2,), "directions": (target.points, None), "taken": (None,), "size": (), "misfit": ()}
    found = KeptArrays(path, inputs).read(shapes)
    if found is None or found["directions"].shape[1] != found["taken"].size:
        return None
    size, memory = (float(each) for each in found["rough"])
    rough = Roughness(size, memory, lengths_of(target.measured))
    return ModelError(rough, found["directions"], found["taken"], float(found["size"]), float(found["misfit"]))


def write_model_error(path: Path, inputs: str, error: ModelError) -> None:
    """Keep the model's error in a specimen."""
    rough = np.array([error.rough.size, error.rough.memory])
    arrays = {"rough": rough, "directions": error.directions, "taken": error.taken, "size": error.size,
              "misfit": error.misfit}  # fmt: skip
    KeptArrays(path, inputs).write({name: np.asarray(array, dtype=np.float64) for name, array in arrays.items()})


def read_explored(path: Path, inputs: str, target: Target) -> Explored | None:
    """A specimen that was explored before, if it was with the same inputs."""
    k = target.size
    terms = 1 + k + k * (k + 1) // 2
    shapes = {"centre": (k,), "scale": (k,), "coefficients": (terms, None), "rest": (),
              "frame": (None, k), "root": (k, k), "precision": (k, k),
              "length": (), "begin": (None, k), "determined": (k,), "error": (), "least": (),
              "seen": (None, k)}  # fmt: skip
    found = KeptArrays(path, inputs).read(shapes)
    if found is None or len(found["begin"]) == 0 or len(found["frame"]) != found["coefficients"].shape[1] + k:
        return None
    known = Emulator(found["centre"], found["scale"], found["coefficients"], float(found["rest"]))
    chart = Chart(known, found["frame"], found["root"], found["precision"])
    determined = found["determined"] == 1.0
    error, least = float(found["error"]), float(found["least"])
    return Explored(chart, float(found["length"]), found["begin"], determined, error, least, found["seen"])


def write_explored(path: Path, inputs: str, explored: Explored) -> None:
    """Keep an explored specimen."""
    chart, known = explored.chart, explored.chart.known
    arrays = {"centre": known.centre, "scale": known.scale, "coefficients": known.coefficients, "rest": known.rest,
              "frame": chart.frame, "root": chart.root, "precision": chart.precision, "length": explored.length,
              "begin": explored.begin,
              "determined": explored.determined, "error": explored.error, "least": explored.least,
              "seen": explored.seen}  # fmt: skip
    KeptArrays(path, inputs).write({name: np.asarray(array, dtype=np.float64) for name, array in arrays.items()})


def read_block(path: Path, inputs: str, specimens: int, size: int) -> Block | None:
    """A block of sweeps of an ensemble that was made before, if it was with the same inputs."""
    n, k = specimens, size
    shapes: dict[str, tuple[int | None, ...]] = {
        "state_scores": (n, None, k), "state_squares": (n, None), "state_mean": (None, k),
        "state_precision": (None, k, k), "state_scales": (None, k), "state_weights": (n, None), "sweep": (),
        "scores": (None, None, n, k), "squares": (None, None, n), "mean": (None, None, k),
        "spread": (None, None, k), "new": (None, None, k),
        "correlation": (None, k, k), "accepted": (n,),
    }  # fmt: skip
    found = KeptArrays(path, inputs).read(shapes)
    if found is None:
        return None
    population = Population(*(found[f"state_{name}"] for name in ("mean", "precision", "scales", "weights")))
    state = State(found["state_scores"], found["state_squares"], population, int(found["sweep"]))
    return Block(state, *(found[name] for name in OF_A_BLOCK))


def write_block(path: Path, inputs: str, block: Block) -> None:
    """Keep a block of sweeps."""
    state, population = block.state, block.state.population
    arrays: dict[str, Array] = {
        "state_scores": state.scores, "state_squares": state.squares, "state_mean": population.mean,
        "state_precision": population.precision, "state_scales": population.scales,
        "state_weights": population.weights, "sweep": np.array(float(state.sweep)),
    }  # fmt: skip
    KeptArrays(path, inputs).write({**arrays, **{name: getattr(block, name) for name in OF_A_BLOCK}})
