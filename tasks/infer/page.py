"""Posterior: what is known of each site's parameters after the inference."""

from typing import cast

from sinew.tasks.drawing.blocks import Section
from sinew.tasks.infer.method import module
from sinew.tasks.infer.result import InferResult, Posteriors
from sinew.tasks.report.folder import ResultFolder

NAME, TITLE = "posterior", "Posterior"
QUESTION = "What is known of each site's parameters, and how surely?"


def section(folder: ResultFolder) -> Section:
    """Everything of ``infer.json``, and the draws in the store."""
    result = cast(Posteriors | None, folder.result(InferResult))
    if result is None:
        return Section(NAME, TITLE, QUESTION, missing=folder.missing("infer"))
    found: Section = module(result, "page").section(folder, result)
    return found
