"""``sinew`` without figures, page and Dask's own pages, which take longer than all else in small studies.

A run that fails still tries to build its page.
"""

if __name__ == "__main__":  # worker processes import this file, too, and need none of it
    import os
    import sys

    sys.modules["distributed.dashboard.scheduler"] = None  # its address is there, its pages are not: no bokeh

    from sinew.__main__ import command
    from sinew.tasks.study import pipeline
    from sinew.tasks.study.workspace import Workspace

    if "SINEW_TESTS_ONE_PROCESS" in os.environ:
        Workspace.client = lambda _: None  # rows are evaluated in this process
    build = pipeline.report
    pipeline._draw = lambda *_: None
    pipeline.report = lambda folder, console, silent=False: build(folder, console, silent=True) if silent else None
    command()
