"""The template that a study brings: its files, and a hash of them."""

from sinew.tasks.simulate.febio.files import read_files
from sinew.tasks.simulate.febio.renderer import Allowance
from sinew.tasks.study.files import digest
from sinew.tasks.study.study import Study


def template_texts(study: Study) -> dict[str, str]:
    """The template and what it includes: texts by their names, as seen from the template's folder; none without one.

    Raises :class:`sinew.runner.errors.BadInput`.
    """
    name = study.simulator.own_template
    return {} if name is None else read_files(study.path.parent, name, Allowance())[1]


def template_hash(study: Study) -> str:
    """Names the content of these files."""
    return digest(template_texts(study))
