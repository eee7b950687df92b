"""The command by which a user lets a study run what studies may not run by themselves."""

from pathlib import Path

import click

from sinew.runner.printing import put
from sinew.tasks.cli.group import PATH, sinew


@sinew.command()
@click.argument("study", type=PATH)
def trust(study: Path) -> None:
    """Let a study run another solver than febio4, use a scheduler, or do without TLS.

    It holds until the study, its template or the program changes.
    """
    from sinew.tasks.cluster.spec import cluster_request
    from sinew.tasks.simulate.build import solver_request
    from sinew.tasks.study import trust as consent
    from sinew.tasks.study.study import read_study

    read = read_study(study)
    requests = [request for request in (solver_request(read), cluster_request(read)) if request is not None]
    consent.allow(requests)
    for request in requests:
        put(f"allowed: {request.field}: {request.words}")
        if request.beside:
            put(f"  {request.beside}")
    if not requests:
        put(f"{study} asks for nothing that needs your consent")
