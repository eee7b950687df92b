"""Posteriors of each site's parameters, by the method that the study asks for or that suits its simulator."""

from typing import Any

from sinew.tasks.infer.settings import Settings
from sinew.tasks.study.workspace import Workspace


def run(workspace: Workspace, settings: Settings) -> Any:
    """The posteriors of each site, an ``AbcResult`` or a ``LikelihoodResult``.

    Raises :class:`sinew.runner.errors.BadInput` as the methods do.
    """
    quick = workspace.simulator.capabilities.quick
    if settings.chosen(quick=quick) == "abc":
        from sinew.tasks.infer.abc import task as abc

        return abc.run(workspace, settings.by_abc(quick=quick))
    from sinew.tasks.infer.likelihood import task as likelihood

    return likelihood.run(workspace, settings.by_likelihood())
