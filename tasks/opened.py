"""A result folder, opened: each task's result as an object that prints and plots, and as other libraries' objects.

Everything is read from the files of the folder, so it works while a study runs and where only a part is finished.
"""

from collections.abc import Callable
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any, Literal

import pandas as pd
import xarray as xr

from runner.errors import StoreError
from runner.store import open_store
from tasks import interop
from tasks.problems import BadInput
from tasks.report.frames import TABLES, headline
from tasks.workspace import read_result

SHOWN = 12  # lines of a table in a notebook


def results(folder: str | Path) -> "Results":
    """Open a result folder, finished or not. Raises :class:`BadInput` when it is none."""
    path = Path(folder)
    if not path.is_dir():
        raise BadInput(path, "is not there", "a result folder, as given to --out")
    if not (path / "store.zarr").is_dir() and not any((path / f"{task}.json").is_file() for task in TABLES):
        raise BadInput(path, "holds neither a store nor results", "a result folder, as given to --out")
    return Results(path)


@dataclass(frozen=True)
class TaskResult:
    """What a task left: ``told`` is the content of its JSON file, ``table`` its numbers, ``plot`` its figures."""

    task: str
    folder: Path
    told: dict[str, Any]

    @property
    def table(self) -> pd.DataFrame:
        """Its numbers, by names of parameters, specimens or sites."""
        return TABLES[self.task](self.told)

    @property
    def plots(self) -> dict[str, list[str]]:
        """Names of its figures, and the specimens or sites that there is one of each for."""
        from tasks.report import views

        return views.names(self.task, self.told)

    def plot(self, name: str | None = None, of: str | None = None) -> Any:
        """A :class:`matplotlib.figure.Figure`: the first of ``plots``, or ``name``; ``of`` a specimen or site."""
        from tasks.report import views

        return views.view(self.task, self.told, self.folder, name, of)

    def __repr__(self) -> str:
        return f"{self.task}: {headline(self.task, self.told)}\n{self.table.to_string(max_rows=SHOWN, max_cols=8)}"

    def _repr_html_(self) -> str:
        table = self.table.to_html(max_rows=SHOWN, max_cols=8, border=0, float_format=lambda value: f"{value:.4g}")
        plots = ", ".join(self.plots)
        return (
            f"<p><b>{escape(self.task)}</b>: {escape(headline(self.task, self.told))}</p>{table}"
            f"<p><small>figures: {escape(plots)}</small></p>"
        )


@dataclass(frozen=True)
class Results:
    """A result folder. Use :func:`results` or :func:`tasks.run`.

    A task that is not finished raises :class:`BadInput`, which says what to run.
    """

    folder: Path

    # ---- one for each task

    @property
    def sobol(self) -> TaskResult:
        """Sobol indices with intervals."""
        return self._task("sobol")

    @property
    def importance(self) -> TaskResult:
        """Random forest importance."""
        return self._task("importance")

    @property
    def calibrate(self) -> TaskResult:
        """The parameters of each specimen."""
        return self._task("calibrate")

    @property
    def infer(self) -> TaskResult:
        """The posterior of each site."""
        return self._task("infer")

    @property
    def predict(self) -> TaskResult:
        """Bands around the curves, and how much of the data they cover."""
        return self._task("predict")

    @property
    def compare(self) -> TaskResult:
        """How far the sites can be told apart."""
        return self._task("compare")

    @property
    def discover(self) -> TaskResult:
        """The verdict on what the model lacks, and the candidates."""
        return self._task("discover")

    @property
    def finished(self) -> tuple[str, ...]:
        """The tasks that have a result."""
        return tuple(task for task in TABLES if (self.folder / f"{task}.json").is_file())

    @property
    def figures(self) -> tuple[Path, ...]:
        """The figures that the tasks drew, as PNG."""
        return tuple(sorted((self.folder / "figures").glob("*.png")))

    # ---- as other libraries' objects

    def xarray(self) -> xr.DataTree:
        """The store, lazily: all evaluations and the arrays of all results."""
        path = open_store(self.folder).path
        return xr.open_datatree(path, engine="zarr", consolidated=False)

    def arviz(self, site: str) -> Any:
        """The posterior of a site as :class:`arviz.InferenceData`."""
        return interop.posterior(self.folder, site)

    def abc_history(self, site: str) -> Any:
        """The inference of a site as :class:`pyabc.History`."""
        return interop.abc_history(self.folder, site)

    def skopt_result(self, specimen: str, *, surrogate: bool = False) -> Any:
        """The Bayesian search of a specimen as skopt's ``OptimizeResult``, see :func:`tasks.interop.skopt_result`."""
        return interop.skopt_result(self.calibrate.told, self.folder, specimen, surrogate=surrogate)

    def salib_problem(self) -> dict[str, Any]:
        """SALib's problem of the Sobol study."""
        return interop.salib_problem(self.sobol.told, self.folder / "sobol.json")

    def salib_result(self, output: str = "total") -> Any:
        """The Sobol indices of an output (``total`` or a protocol) as SALib's ``ResultDict``."""
        return interop.salib_result(self.sobol.told, self.folder / "sobol.json", output)

    def salib_samples(self, specimen: str) -> tuple[Any, Any]:
        """Sample ``X`` ``[n, d]`` and output ``Y`` ``[n]`` (N) of a specimen in SALib's order."""
        return interop.salib_samples(self.sobol.told, self.folder, specimen)

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
            found |= {f"particles_{site}": _later(self.particles, site) for site in self.infer.told["sites"]}
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
                frame.to_csv(path, index=False)
            else:
                frame.to_parquet(path, index=False)
            paths.append(path)
        return paths

    def __repr__(self) -> str:
        lines = [f"Results of {self._study()} in {self.folder}"]
        lines += [f"  {task}: {headline(task, self._task(task).told)}" for task in self.finished]
        lines += [f"  evaluations: {name}: {done:,} of {rows:,} rows" for name, rows, done in self._rows()]
        return "\n".join(lines if len(lines) > 1 else [*lines, "  nothing is finished yet"])

    def _repr_html_(self) -> str:
        cells = [(task, headline(task, self._task(task).told)) for task in self.finished]
        cells += [(name, f"{done:,} of {rows:,} rows") for name, rows, done in self._rows()]
        body = "".join(f"<tr><th>{escape(name)}</th><td>{escape(words)}</td></tr>" for name, words in cells)
        head = f"<p><b>{escape(self._study())}</b> in <code>{escape(str(self.folder))}</code></p>"
        return head + (f"<table>{body}</table>" if body else "<p>nothing is finished yet</p>")

    # ---- inside

    def _task(self, task: str) -> TaskResult:
        path = self.folder / f"{task}.json"
        told = read_result(path)
        if told is None:
            problem = "is not JSON" if path.exists() else "is not there"
            raise BadInput(path, problem, f"a finished `sinew {task}` in this folder")
        try:
            headline(task, told)
            TABLES[task](told)
        except (AttributeError, IndexError, KeyError, TypeError, ValueError) as error:
            problem = f"lacks or garbles something ({type(error).__name__}: {error})"
            raise BadInput(path, problem, f"what this version's `sinew {task}` writes") from None
        return TaskResult(task, self.folder, told)

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
