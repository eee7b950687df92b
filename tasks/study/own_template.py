"""The template that a study brings: its files, and a hash of them."""

from sinew.tasks.simulate.febio.files import read_files
from sinew.tasks.simulate.febio.renderer import Allowance
from sinew.tasks.study.files import digest
from sinew.tasks.study.study import Study


def template_texts(study: Study) -> dict[str, str]:
    """The templates and what they include: texts by their names, as seen from the template's folder; none without one.

    Raises :class:`sinew.runner.errors.BadInput`.
    """
    name = study.simulator.own_template
    names = () if name is None else (name, *study.simulator.further_templates)
    found: dict[str, str] = {}
    for each in names:
        found |= read_files(study.path.parent, each, Allowance())[1]
    return found


def template_hash(study: Study, simulator: str) -> str:
    """Names the content of these files; empty for runs of another ``simulator`` than the study's, and without files."""
    texts = template_texts(study) if simulator == study.simulator.name else {}
    return digest(texts) if texts else ""
