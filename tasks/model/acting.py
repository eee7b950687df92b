"""Effects with their values, as they act on bars from the machine's side: constants, displacement and reading."""

from dataclasses import replace

import numpy as np

from sinew.tasks.model.effect import Array, Bars, Effect, Values, in_order

Acting = tuple[tuple[Effect, Values], ...]
"""Effects in the order in which they act, each with its own values by name, ``[n, 1]``."""


def acting(effects: tuple[Effect, ...], values: Array) -> Acting:
    """The effects with their ``values`` ``[n, k]``, the columns of which are their parameters in the order given.

    Raises :class:`ValueError` for another number of columns, and when an effect is there twice.
    """
    named: dict[str, Values] = {}
    first = 0
    for effect in effects:
        named[effect.slug] = {name: values[:, [first + i]] for i, name in enumerate(effect.names)}
        first += len(effect.names)
    if first != values.shape[1]:
        raise ValueError(f"{values.shape[1]} columns of values for {first} parameters of effects")
    return tuple((effect, named[effect.slug]) for effect in in_order(effects))


def with_constants(chosen: Acting, bars: Bars) -> Bars:
    """The bars with the material constants that the effects give them."""
    for effect, own in chosen:
        if effect.material:
            bars = replace(bars, material={**bars.material, **effect.material(bars, own)})
    return bars


def displaced(chosen: Acting, bars: Bars) -> Bars:
    """The bars with the displacement of their gauge length under their force."""
    for effect, own in chosen:
        if effect.displacement:
            bars = replace(bars, displacement_mm=effect.displacement(bars, own))
    return bars


def gives_way(chosen: Acting) -> bool:
    """Whether the displacement of the gauge length depends on the force."""
    return any(effect.giving_way for effect, _ in chosen)


def ways(chosen: Acting, bars: Bars) -> tuple[Array, Array]:
    """Compliance and what is kept of each of ``m`` :class:`GivingWay`, each ``[m, n, t]``."""
    found = [way for effect, own in chosen if effect.giving_way for way in effect.giving_way(bars, own)]
    shape = (-1, *bars.force_N.shape)
    return (
        np.array([way.compliance for way in found]).reshape(shape),
        np.array([way.kept for way in found]).reshape(shape),
    )


def read(chosen: Acting, bars: Bars) -> Bars:
    """The bars with their force as the load cell reports it."""
    for effect, own in chosen:
        if effect.reading:
            bars = replace(bars, force_N=effect.reading(bars, own))
    return bars
