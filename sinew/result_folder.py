"""A result folder, opened: each task's result as an object that prints and plots, and as other libraries' objects.

Everything is read from the files of the folder, so it works while a study runs and where only a part is finished.
"""

import json
import os
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any, Literal

import pandas as pd
import xarray as xr

from sinew import interop
from sinew.runner.errors import BadInput, StoreError
from sinew.runner.printing import printable
from sinew.runner.store.results import PLAIN
from sinew.runner.store.store import open_store, refuse_strange_entries
from sinew.tasks.drawing import views
from sinew.tasks.drawing.formats import without_formulas
from sinew.tasks.registry import TASKS
from sinew.tasks.study.result import believed

SHOWN = 12  # lines of a table in a notebook


def results(folder: str | Path) -> "Results":
    """Open a result folder, finished or not. Raises :class:`BadInput` when it is none.

    Raises ``StoreError`` for one with links, pipes or devices.
    """
    path = Path(folder)
    if not os.path.isdir(path):  # unlike Path.is_dir, it takes names of any length
        raise BadInput(path, "is not there", "a result folder, as given to --out")
    if not (path / "store.zarr").is_dir() and not any((path / f"{task}.json").is_file() for task in TASKS):
        raise BadInput(path, "holds neither a store nor results", "a result folder, as given to --out")
    refuse_strange_entries(path)
    return Results(path)


@dataclass(frozen=True)
class TaskResult:
    """What a task left: ``result`` is its result, ``table`` its numbers, ``plot`` draws its figures."""

    task: str
    folder: Path
    result: Any

    @property
    def content(self) -> dict[str, Any]:
        """Everything that the JSON file holds."""
        content: dict[str, Any] = json.loads(self._path.read_text("utf-8"))
        return content

    @property
    def told(self) -> dict[str, Any]:
        """The former name of ``content``."""
        warnings.warn("`told` is called `content` now, and will be gone in 0.3", DeprecationWarning, stacklevel=2)
        return self.content

    @property
    def table(self) -> pd.DataFrame:
        """Its numbers, by names of parameters, specimens or sites."""
        with believed(self._path):
            table: pd.DataFrame = self._show.table(self.result)
        return table

    @property
    def headline(self) -> str:
        """What came out, in one line."""
        with believed(self._path):
            return str(self._show.headline(self.result))

    @property
    def plots(self) -> dict[str, list[str]]:
        """Names of its figures, and the specimens or sites that there is one of each for."""
        return views.names(self._figures, self.result)

    def plot(self, name: str | None = None, of: str | None = None) -> Any:
        """A :class:`matplotlib.figure.Figure`: the first of ``plots``, or ``name``; ``of`` a specimen or site."""
        with believed(self._path):
            return views.one_figure(self._figures, self.task, self.result, self.folder, name, of)

    @property
    def _path(self) -> Path:
        return self.folder / f"{self.task}.json"

    @property
    def _show(self) -> Any:
        return TASKS[self.task].module("show")

    @property
    def _figures(self) -> Any:
        figures = TASKS[self.task].module("figures")
        return figures.kinds(self.result) if hasattr(figures, "kinds") else figures.FIGURES

    def __repr__(self) -> str:
        return printable(f"{self.task}: {self.headline}\n{self.table.to_string(max_rows=SHOWN, max_cols=8)}")

    def _repr_html_(self) -> str:
        table = self.table.to_html(max_rows=SHOWN, max_cols=8, border=0, float_format=lambda value: f"{value:.4g}")
        plots = ", ".join(self.plots)
        return _no_formulas(
            f"<p><b>{escape(self.task)}</b>: {escape(self.headline)}</p>{table}"
            f"<p><small>figures: {escape(plots)}</small></p>"
        )


@dataclass(frozen=True)
class Results:
    """A result folder. Use :func:`results` or :func:`sinew.run`.

    A task that is not finished raises :class:`BadInput`, which says what to run.
    """

    folder: Path

    def __getattr__(self, task: str) -> TaskResult:
        """The result of a task, by the task's name."""
        if task not in TASKS:
            raise AttributeError(f"{type(self).__name__!r} has no attribute {task!r}, and no task has this name")
        return self._task(task)

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *TASKS]

    @property
    def finished(self) -> tuple[str, ...]:
        """The tasks that have a result."""
        return tuple(task for task in TASKS if (self.folder / f"{task}.json").is_file())

    @property
    def figures(self) -> tuple[Path, ...]:
        """The figures that the tasks drew, as PNG."""
        return tuple(sorted((self.folder / "figures").glob("*.png")))

    # ---- as other libraries' objects

    def xarray(self) -> xr.DataTree:
        """The store, lazily: all evaluations and the arrays of all results.

        Raises ``StoreError`` for arrays that are not what is written here, which must not be decompressed.
        """
        store = open_store(self.folder)
        store.check()
        return xr.open_datatree(store.path, engine="zarr", **PLAIN)

    def arviz(self, site: str) -> Any:
        """The posterior of a site as :class:`arviz.InferenceData`."""
        return interop.posterior(self.folder, site)

    def abc_history(self, site: str) -> Any:
        """The inference of a site as :class:`pyabc.History`."""
        return interop.abc_history(self.folder, site)

    def skopt_result(self, specimen: str, *, surrogate: bool = False) -> Any:
        """The Bayesian search of a specimen as skopt's ``OptimizeResult``, see :func:`sinew.interop.skopt_result`."""
        return interop.skopt_result(self.calibrate.result, self.folder, specimen, surrogate=surrogate)

    def salib_problem(self) -> dict[str, Any]:
        """SALib's problem of the Sobol study."""
        return interop.salib_problem(self.sobol.result)

    def salib_result(self, output: str = "total") -> Any:
        """The Sobol indices of an output (``total`` or a protocol) as SALib's ``ResultDict``."""
        return interop.salib_result(self.sobol.result, output)

    def salib_samples(self, specimen: str) -> tuple[Any, Any]:
        """Sample ``X`` ``[n, d]`` and output ``Y`` ``[n]`` (N) of a specimen in SALib's order."""
        return interop.salib_samples(self.sobol.result, self.folder, specimen)

    # ---- as tables

    def samples(self, evaluations: str) -> pd.DataFrame:
        """All rows of one group of ``evaluations`` in the store: parameters, objectives (N), status."""
        return interop.samples(self.folder, evaluations)

    def particles(self, site: str) -> pd.DataFrame:
        """All particles of an inference, with weights."""
        return interop.particles(self.folder, site)

    def tables(self) -> dict[str, Callable[[], pd.DataFrame]]:
        """What can be a table, by name: each task, each site's particles, each group of evaluations."""
        found: dict[str, Callable[[], pd.DataFrame]] = {task: self._as_table(task) for task in self.finished}
        if "infer" in self.finished:
            found |= {f"particles_{site}": _later(self.particles, site) for site in self.infer.content["sites"]}
        if (self.folder / "store.zarr").is_dir():
            found |= {f"samples_{t.name}": _later(self.samples, t.name) for t in open_store(self.folder).tables()}
        return found

    def export(self, out: str | Path, format: Literal["csv", "parquet"] = "csv") -> list[Path]:
        """Write all tables into the folder ``out``, each as ``NAME.csv`` or ``NAME.parquet``; returns their paths."""
        if format not in ("csv", "parquet"):
            raise BadInput("format", repr(format), "csv or parquet")
        Path(out).mkdir(parents=True, exist_ok=True)
        paths = []
        for name, table in self.tables().items():
            path = Path(out) / f"{name}.{format}"
            frame = table().reset_index()
            if format == "csv":
                without_formulas(frame).to_csv(path, index=False)
            else:
                frame.to_parquet(path, index=False)
            paths.append(path)
        return paths

    def __repr__(self) -> str:
        lines = [f"Results of {self._study()} in {self.folder}"]
        lines += [f"  {task}: {self._task(task).headline}" for task in self.finished]
        lines += [f"  evaluations: {name}: {done:,} of {rows:,} rows" for name, rows, done in self._rows()]
        return printable("\n".join(lines if len(lines) > 1 else [*lines, "  nothing is finished yet"]))

    def _repr_html_(self) -> str:
        cells = [(task, self._task(task).headline) for task in self.finished]
        cells += [(name, f"{done:,} of {rows:,} rows") for name, rows, done in self._rows()]
        body = "".join(f"<tr><th>{escape(name)}</th><td>{escape(words)}</td></tr>" for name, words in cells)
        head = f"<p><b>{escape(self._study())}</b> in <code>{escape(str(self.folder))}</code></p>"
        return _no_formulas(head + (f"<table>{body}</table>" if body else "<p>nothing is finished yet</p>"))

    # ---- inside

    def _task(self, task: str) -> TaskResult:
        result = TASKS[task].read(self.folder)
        if result is None:
            expected = f"a finished `sinew {task}` in this folder"
            raise BadInput(self.folder / f"{task}.json", "is not there", expected)
        return TaskResult(task, self.folder, result)

    def _as_table(self, task: str) -> Callable[[], pd.DataFrame]:
        return lambda: self._task(task).table

    def _study(self) -> str:
        try:
            return open_store(self.folder).study
        except StoreError:
            return "a study without a store"

    def _rows(self) -> list[tuple[str, int, int]]:
        """Each group of evaluations: its name, its rows, and how many have an outcome."""
        try:
            return [(t.name, len(t), t.finished() + t.waiting()) for t in open_store(self.folder).tables()]
        except StoreError:
            return []


def _later(function: Callable[[str], pd.DataFrame], name: str) -> Callable[[], pd.DataFrame]:
    return lambda: function(name)


def _no_formulas(html: str) -> str:
    """HTML that a notebook's MathJax skips: a formula may hold a link that runs a script."""
    return f'<div class="tex2jax_ignore mathjax_ignore">{html}</div>'
