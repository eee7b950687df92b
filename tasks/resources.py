"""Templates and ready studies that come with sinew, in a checkout or in an installed package."""

from pathlib import Path


def resource(name: str) -> Path:
    """Path of a file such as ``templates/tendon.feb.j2``. Raises ``FileNotFoundError`` when there is none."""
    here = Path(__file__).resolve().parent
    for folder in (here, here.parent):  # an installed package carries them inside, a checkout beside
        if (folder / name).exists():
            return folder / name
    raise FileNotFoundError(name)
