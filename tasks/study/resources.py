"""Templates and ready studies that come with sinew."""

from pathlib import Path

import sinew

DISTRIBUTION = "sinew-fe"  # what pip calls it; the package index has another project called sinew


def resource(name: str) -> Path:
    """Path of a file such as ``templates/tendon.feb.j2``. Raises ``FileNotFoundError`` when there is none."""
    path = Path(sinew.__path__[0]) / name
    if not path.exists():
        raise FileNotFoundError(name)
    return path
