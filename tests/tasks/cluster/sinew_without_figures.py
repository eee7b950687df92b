"""``sinew`` without figures, page and Dask's own pages, which take longer than all else in the small studies of tests.

A run that fails still tries to build its page.
"""

if __name__ == "__main__":  # worker processes import this file, too, and need none of it
    import sys

    sys.modules["distributed.dashboard.scheduler"] = None  # its address is there, its pages are not: no bokeh

    from sinew.tasks import pipeline
    from sinew.tasks.cli.main import main

    build = pipeline.report
    pipeline._draw = lambda *_: None
    pipeline.report = lambda folder, console, silent=False: build(folder, console, silent=True) if silent else None
    main()
