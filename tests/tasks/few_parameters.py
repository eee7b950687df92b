"""Studies with few free parameters: all others are held at their references."""

from collections.abc import Collection

from sinew.tasks.model import Model


def held_but(free: Collection[str]) -> str:
    """Lines for ``model.parameters`` of a study, which hold each parameter of the tendon that is not ``free``."""
    held = (one for one in Model().parameters if one.name not in free)
    return "".join(f"    {one.name}: {{fixed: {one.reference}}}\n" for one in held)
