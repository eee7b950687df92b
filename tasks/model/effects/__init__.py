"""The library of effects: every file of this package is one effect, named EFFECT in it. Adding a file adds an effect.

docs/effects.md shows how; :mod:`sinew.tasks.model.effect` says what an effect is made of.
"""

import importlib
import pkgutil
from functools import cache

from sinew.tasks.model.effect import Effect
from sinew.tasks.model.law import is_law, law


@cache
def library() -> dict[str, Effect]:
    """All effects by slug, in alphabetical order.

    Raises :class:`ImportError` for a file without an EFFECT, and :class:`ValueError` for a slug in two files.
    """
    found: dict[str, Effect] = {}
    for module in pkgutil.iter_modules(__path__):
        effect = getattr(importlib.import_module(f"{__name__}.{module.name}"), "EFFECT", None)
        if not isinstance(effect, Effect):
            raise ImportError(f"effects/{module.name}.py has no EFFECT")
        if effect.slug in found:
            raise ValueError(f"effects/{module.name}.py: there is another effect {effect.slug}")
        found[effect.slug] = effect
    return dict(sorted(found.items()))


@cache
def named() -> dict[str, Effect]:
    """All effects, and their other forms, as a study names them."""
    return {one.name: one for effect in library().values() for one in (effect, *effect.other_forms)}


def effect_named(name: str) -> Effect:
    """An effect of the library in one of its forms, or a law, by its name in a study.

    Raises :class:`ValueError` for a law that is none, and :class:`KeyError` for another name.
    """
    return law(name) if is_law(name) else named()[name]
