"""What an unfinished inference keeps: read as it was, and not at all where it cannot be what it claims to be."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import safetensors.numpy

from sinew.tasks.fitting.roughness import Roughness
from sinew.tasks.infer.likelihood.chains import Block, begun, swept
from sinew.tasks.infer.likelihood.discrepancy import ModelError, QuantityError
from sinew.tasks.infer.likelihood.explore import Explored, explored
from sinew.tasks.infer.likelihood.kept import (
    read_block,
    read_explored,
    read_model_error,
    write_block,
    write_explored,
    write_model_error,
)
from tests.tasks.infer.likelihood.test_chains import ROUGH, SIZE, SPECIMENS, Line, course

TARGETS = [Line(course(np.full((1, SIZE), at))[0]) for at in (0.3, 0.5, 0.6)]


@pytest.fixture(scope="module")
def known() -> tuple[list[Explored], Block]:
    found = [explored(target, (1, number), ROUGH) for number, target in enumerate(TARGETS)]
    state = begun(TARGETS, found, (2,), heavy=False)
    return found, swept(TARGETS, found, state, 8, (3,), heavy=False)


def same(one: object, other: object) -> bool:
    if isinstance(one, np.ndarray | float | int):
        return np.array_equal(one, other)
    if isinstance(one, tuple):
        return isinstance(other, tuple) and len(one) == len(other) and all(map(same, one, other))
    if hasattr(one, "__dataclass_fields__"):
        return all(same(getattr(one, name), getattr(other, name)) for name in one.__dataclass_fields__)
    return one == other


def changed(path, name: str, change) -> None:
    """Rewrite a file with one of its arrays changed."""
    arrays = {key: array.copy() for key, array in safetensors.numpy.load(path.read_bytes()).items()}
    arrays[name] = np.ascontiguousarray(change(arrays[name]))
    path.write_bytes(safetensors.numpy.save(arrays))


OF_A_BLOCK = [
    ("state_scores", lambda a: a[:, :5]),  # fewer chains
    ("state_scores", lambda a: a + 1e3),
    ("mean", lambda a: a[:0]),
    ("mean", lambda a: a[:5]),  # fewer sweeps than the others
    ("sweep", lambda _: np.array(1e300)),
    ("sweep", lambda _: np.array(-1.0)),
    ("sweep", lambda _: np.array(8.5)),
    ("state_precision", lambda a: 0.0 * a),
    ("state_precision", lambda a: -a),
    ("state_scales", lambda a: 0.0 * a),
    ("state_weights", lambda a: -a),
    ("squares", lambda a: a - 1e9),
    ("correlation", lambda a: 3.0 * a),
    ("accepted", lambda a: a + 2.0),
]


def test_a_block_is_read_as_it_was_written(known, tmp_path):
    _, block = known
    write_block(tmp_path / "block", "inputs", block)
    found = read_block(tmp_path / "block", "inputs", SPECIMENS, SIZE)
    assert same(found, block)
    assert read_block(tmp_path / "block", "other", SPECIMENS, SIZE) is None
    assert read_block(tmp_path / "block", "inputs", SPECIMENS - 1, SIZE) is None


@pytest.mark.parametrize(("name", "change"), OF_A_BLOCK)
def test_a_block_that_cannot_be_does_not_count(known, tmp_path, name, change):
    write_block(tmp_path / "block", "inputs", known[1])
    changed(tmp_path / "block", name, change)
    assert read_block(tmp_path / "block", "inputs", SPECIMENS, SIZE) is None


OF_AN_EXPLORED = [
    ("root", lambda a: 0.0 * a),
    ("precision", lambda a: -a),
    ("precision", lambda a: a + np.triu(a + 1.0, 1)),
    ("length", lambda _: np.array(1e50)),
    ("begin", lambda a: 0.0 * a + 1e50),
    ("begin", lambda a: a[:0]),
    ("seen", lambda a: a[:0]),
    ("scale", lambda a: 0.0 * a),
    ("determined", lambda a: a + 0.5),
    ("least", lambda _: np.array(-1.0)),
    ("frame", lambda a: a[:-1]),
]


def test_an_explored_specimen_is_read_as_it_was_written(known, tmp_path):
    write_explored(tmp_path / "known", "inputs", known[0][0])
    assert same(read_explored(tmp_path / "known", "inputs", TARGETS[0]), known[0][0])


@pytest.mark.parametrize(("name", "change"), OF_AN_EXPLORED)
def test_an_explored_specimen_that_cannot_be_does_not_count(known, tmp_path, name, change):
    write_explored(tmp_path / "known", "inputs", known[0][0])
    changed(tmp_path / "known", name, change)
    assert read_explored(tmp_path / "known", "inputs", TARGETS[0]) is None


OF_THE_FORCE = QuantityError(Roughness(0.5, 0.8, (6,)), np.eye(6)[:, :2], np.array([0.5, 0.9]))
ERROR = ModelError((OF_THE_FORCE,), (np.arange(6),), 1.0, 2.0, np.zeros(2))
QUANTITIES = {"force": SimpleNamespace(target=np.zeros(6))}
MEASURED = SimpleNamespace(thinned={"pull": SimpleNamespace(quantities=QUANTITIES)}, places={"force": np.arange(6)})


def test_an_error_of_a_model_is_read_as_it_was_written(tmp_path):
    target = replace(TARGETS[0], measured=MEASURED)
    write_model_error(tmp_path / "error", "inputs", ERROR)
    assert same(read_model_error(tmp_path / "error", "inputs", target), ERROR)
    nothing = replace(ERROR, each=(replace(OF_THE_FORCE, directions=np.empty((6, 0)), taken=np.empty(0)),))
    write_model_error(tmp_path / "error", "inputs", nothing)
    assert same(read_model_error(tmp_path / "error", "inputs", target), nothing)


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("rough_0", lambda _: np.array([-1.0, 0.5])),
        ("rough_0", lambda _: np.array([1.0, 1.0])),
        ("taken_0", lambda a: a + 1.0),
        ("taken_0", lambda a: a[:1]),
        ("size", lambda _: np.array(-1.0)),
        ("near", lambda a: a + 99.0),
        ("near", lambda a: a[:1]),
    ],
)
def test_an_error_of_a_model_that_cannot_be_does_not_count(tmp_path, name, change):
    write_model_error(tmp_path / "error", "inputs", ERROR)
    changed(tmp_path / "error", name, change)
    assert read_model_error(tmp_path / "error", "inputs", replace(TARGETS[0], measured=MEASURED)) is None
