"""The tasks of a study. To add one, make a folder for it and add an entry to ``TASKS``; no other file changes.

The folder of a task holds these modules, which are imported when they are first needed:

============  ====================================================================================================
module        what it offers
============  ====================================================================================================
``settings``  ``Settings``, the task's section of the study file; optionally ``DEFAULT``, used when a study has no such
              section, ``check(study, out, **flags)``, which refuses what cannot work before anything is written, and
              ``needs(study)``, where the settings decide whether a result of the task that it ``needs`` is taken up
``method``    the method as plain functions: arrays in, result out, no files
``task``      ``run(workspace, settings, **flags)``: plan, evaluate, analyse, commit; returns the result
``result``    the result, a frozen dataclass that owns ``TASK.json`` (:class:`sinew.tasks.study.result.Result`)
``show``      ``table`` and ``headline`` of a result, ``summary`` for the console
``figures``   ``draw(workspace, result)`` writes all figures; ``FIGURES`` draws one at a time, or ``kinds(result)`` if
              the figures depend on the result
``page``      ``section(folder)``: the task's section of ``report.html``
``prose``     ``methods(result)``: the paragraph of a methods section, with the numbers of the result
``work``      ``work(given, settings)``: what the task will have to do, for an estimate of the time it takes
============  ====================================================================================================
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from types import MappingProxyType
from typing import Any


@dataclass(frozen=True)
class Task:
    """An entry of the registry; ``name`` is the command, the folder, the section of the study and ``NAME.json``.

    ``summary`` is the command's help. ``needs`` names the task whose result it takes up. ``flags`` are the command's
    own switches with their help. ``measured``: it needs measured curves.
    ``optional``: new studies leave it out, and the page shows it only once it has run. ``place`` orders the page.
    """

    name: str
    summary: str
    place: int
    needs: str | None = None
    flags: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    examples: tuple[str, ...] = ()
    measured: bool = False
    optional: bool = False

    def module(self, name: str) -> Any:
        """One of the modules of the task's folder."""
        return import_module(f"{__package__}.{self.name}.{name}")

    def needed(self, study: Any) -> str | None:
        """The task whose result a study's run of this one takes up; settings that decide have a ``needs(study)``."""
        own = getattr(self.module("settings"), "needs", None)
        return self.needs if own is None else own(study)

    @property
    def settings(self) -> Any:
        """The class of the task's section of the study file."""
        return self.module("settings").Settings

    def read(self, folder: Path) -> Any:
        """The task's result in a folder, or None. Raises :class:`sinew.runner.errors.BadInput` when it is damaged."""
        return self.module("result").RESULT.read(folder)


TASKS: Mapping[str, Task] = {
    task.name: task
    for task in (
        Task(
            "sobol", "Sobol indices with confidence intervals.", place=2,
            flags={"extend": "Double the base samples of the last result; evaluates only the new rows."},
            examples=("sinew sobol study.yaml", "sinew sobol study.yaml --extend"),
        ),
        Task("importance", "Random forest importance from the rows of the Sobol study.", place=3, needs="sobol"),
        Task(
            "calibrate", "The parameters of each specimen that bring the model closest to its curves.", place=1,
            measured=True, examples=("sinew calibrate study.yaml --simulator febio",),
        ),
        Task(
            "infer", "The parameters of each site's population and specimens, with their uncertainty.", place=4,
            needs="calibrate", measured=True,
        ),
        Task(
            "predict", "Bands around the curves of each site, and how much of the data they cover.", place=5,
            needs="infer", measured=True,
        ),
        Task("compare", "Can the sites be told apart by their parameters?", place=6, needs="infer", measured=True),
        Task(
            "discover", "Where do model and measurements disagree, and which effect is missing?", place=7,
            measured=True, examples=("sinew discover study.yaml --data data/tails",),
        ),
        Task("morris", "Elementary effects (Morris): a screening at the price of few rows.", place=2, optional=True),
        Task("surrogate", "Emulators of forces and outputs along time, from few runs.", place=2, optional=True),
        Task("pawn", "PAWN indices of whole distributions, from the rows of the Sobol study.", place=3, needs="sobol",
             optional=True),
    )
}  # fmt: skip
