"""The real solver on a user's own input: any mesh, any material, any parameters, any outputs of its log file.

For each row and protocol, :mod:`tasks.simulate.rendering` makes the input in a process of its own, with the study's
outputs in its log file section; then the solver runs, and what it logged is brought to the times of the protocol.
"""

import hashlib
import json
import sys
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any, Literal

import jinja2
import jinja2.meta
import numpy as np
from jinja2.sandbox import SandboxedEnvironment
from scipy.interpolate import PchipInterpolator

from runner import external
from tasks.model import Curve, Model, Protocol, Specimen
from tasks.problems import BadInput, shown
from tasks.simulate import Array, Compared, Output, Simulated, rendering
from tasks.simulate.attempt import INPUT, Failed, attempt, read_records, row_by_row
from tasks.simulate.febio import MAX_TEMPLATE_BYTES, at_every_row, from_rest, load_points, solver_steps

MAX_FILES = 100
RENDER_S = 300.0  # of the clock; rendering.SECONDS are of a processor
TAKEN = {
    *("displacement_points", "step_points", "first_step_s", "end_s", "steps", "time_s", "displacement_mm", "protocol"),
    *("specimen", "range", "namespace", "loop", "self", "super", "caller", "varargs", "kwargs"),
    *("true", "false", "none", "True", "False", "None", "and", "or", "not", "if", "else", "elif", "in", "is", "for"),
    *("import", "include", *rendering.FUNCTIONS, *rendering.CONSTANTS),
}
"""Names that a parameter of a template cannot have."""

Reduce = Literal["single", "sum", "mean", "max", "min"]
_REDUCE: dict[str, Callable[..., Array]] = {
    "single": np.sum,
    "sum": np.sum,
    "mean": np.mean,
    "max": np.max,
    "min": np.min,
}


@dataclass(frozen=True)
class Logged(Output):
    """An output by what the solver logs: ``item`` of ``data`` for some ``ids`` or a named ``set``, made one number.

    That number is times ``scale``. ``at_rest`` is its value before the first step, of which the solver logs nothing.
    """

    data: Literal["node_data", "element_data", "rigid_body_data"] = "node_data"
    item: str = ""
    ids: tuple[int, ...] = ()
    set: str | None = None
    reduce: Reduce = "single"
    scale: float = 1.0
    at_rest: float = 0.0


@dataclass(frozen=True, eq=False)
class Template:
    """A solver, its version, a template by the texts of its ``files``, its outputs, and how a run is limited.

    ``force`` names the output that is compared with measured forces. ``settle_s``: a protocol that starts displaced
    starts at rest, goes there in 1 s and waits this long. The rest is as in :class:`tasks.simulate.febio.FEBio`.
    """

    executable: str
    version: str
    files: Mapping[str, str]
    main: str
    outputs: tuple[Logged, ...]
    scratch: Path
    force: str | None = None
    timeout_s: float = 600.0
    max_file_bytes: int = 2**30
    ramp_s: float = 0.0
    hold_growth: float = 0.02
    still_mm: float = 0.0
    settle_s: float = 0.0
    keep_failed: int = 20
    name: str = "template"
    batch_multiple: int = 1

    def identity(self) -> dict[str, Any]:
        digests = {name: hashlib.blake2b(text.encode(), digest_size=16) for name, text in self.files.items()}
        return {
            "name": self.name,
            "version": self.version,
            "files": {name: digest.hexdigest() for name, digest in digests.items()},
            "main": self.main,
            "outputs": [asdict(output) for output in self.outputs],
            "force": self.force,
            "time_steps": [self.ramp_s, self.hold_growth, self.still_mm, self.settle_s],
        }

    def simulate(
        self, model: Model, specimen: Specimen, protocol: Protocol, parameters: Array, *, stresses: bool = False
    ) -> Simulated:
        """The force. Raises :class:`BadInput` when no output is one."""
        if stresses or self.force is None:
            problem = "constituent stresses are not told" if stresses else "no output is the force"
            raise BadInput("simulator", problem, "simulator.force: the name of an output")
        found, status, messages = self._rows(model, specimen, protocol, parameters)
        return Simulated(found[:, self._force], status, messages)

    def compare(self, model: Model, specimen: Specimen, curve: Curve, parameters: Array, keep: Array) -> Compared:
        found, status, messages = self._rows(model, specimen, curve.protocol, parameters)
        force = found[:, self._force] if self.force is not None else np.full((len(found), keep.size), np.nan)
        if self.force is not None and curve.measured:
            rmse = np.sqrt(np.mean((force - curve.force_N) ** 2, axis=1))
        else:
            rmse = np.full(len(found), np.nan)
        named = {output.name: found[:, number] for number, output in enumerate(self.outputs)}
        return Compared(
            rmse,
            force[:, keep] if self.force is not None else force,
            status,
            messages,
            {name: values[:, keep] for name, values in named.items()},
            {output.name: output.summarised(named[output.name]) for output in self.outputs},
        )

    def rendered(self, model: Model, specimen: Specimen, protocol: Protocol, values: Array, folder: Path) -> Path:
        """Write the solver's input for one parameter set ``[d]`` into ``folder``. Raises :class:`BadInput`."""
        times, displacements, _, _ = self._stepped(protocol)
        try:
            self._render(folder, self._variables(model, specimen, protocol, values, times, displacements))
        except Failed as failed:
            raise BadInput(self.main, failed.words, "a template that can be rendered") from None
        return folder / INPUT

    @property
    def _force(self) -> int:
        return [output.name for output in self.outputs].index(str(self.force))

    def _rows(
        self, model: Model, specimen: Specimen, protocol: Protocol, parameters: Array
    ) -> tuple[Array, Array, tuple[str, ...]]:
        """All outputs ``[n, outputs, t]``, NaN for rows that failed; status ``[n]``; messages."""
        found = np.full((len(parameters), len(self.outputs), protocol.time_s.size), np.nan)
        return found, *row_by_row(model, parameters, partial(self._solved, model, specimen, protocol), found)

    def _stepped(self, protocol: Protocol) -> tuple[Array, Array, int, Array]:
        """The solver's times (s), displacements (mm), which of them is the protocol's first row, and its rows."""
        rows = solver_steps(protocol, self.ramp_s, self.hold_growth, self.still_mm)
        return *from_rest(protocol, rows, self.settle_s, loaded_at_rest=False), rows

    def _solved(self, model: Model, specimen: Specimen, protocol: Protocol, values: Array) -> Array:
        """Outputs ``[outputs, t]`` for one parameter set. Raises :class:`Failed`."""
        times, displacements, first, rows = self._stepped(protocol)

        def prepare(directory: Path) -> None:
            self._render(directory, self._variables(model, specimen, protocol, values, times, displacements))

        def read(directory: Path) -> list[tuple[Array, Array]]:
            return [
                read_output(directory / f"sinew-{number}.txt", output, self.max_file_bytes, float(times[-1]))
                for number, output in enumerate(self.outputs)
            ]

        told = attempt(self, prepare, read, dict(zip(model.names, values.tolist(), strict=True)))
        asked = protocol.time_s - protocol.time_s[0] + times[first]
        slack = _slack(float(times[-1]))
        found = np.empty((len(self.outputs), asked.size))
        for number, (output, (at, logged)) in enumerate(zip(self.outputs, told, strict=True)):
            if at[0] > 0:
                at, logged = np.concatenate([[0.0], at]), np.concatenate([[output.at_rest], logged])
            nearest = np.clip(np.searchsorted(at, times[first:] - slack), 0, at.size - 1)
            if np.all(np.abs(at[nearest] - times[first:]) <= slack):  # the solver stopped where it was asked to
                found[number] = at_every_row(protocol, rows, logged[nearest], self.still_mm)
            else:
                found[number] = PchipInterpolator(at, logged)(np.minimum(asked, at[-1]))
        return found

    def _variables(
        self, model: Model, specimen: Specimen, protocol: Protocol, values: Array, times: Array, displacements: Array
    ) -> dict[str, Any]:
        parameters = dict(zip(model.names, values.tolist(), strict=True))
        return parameters | variables(specimen, protocol.name, times, displacements)

    def _render(self, directory: Path, named: dict[str, Any]) -> None:
        job = {"files": dict(self.files), "main": self.main, "renders": [named], "input": INPUT}
        render(directory, job | {"outputs": [asdict(output) for output in self.outputs]}, self.max_file_bytes)


def variables(specimen: Specimen, protocol: str, times: Array, displacements: Array) -> dict[str, Any]:
    """What a template can use besides the parameters: the history, and the specimen's geometry if it has one."""
    displacement_points, step_points = load_points(times.tobytes(), displacements.tobytes())
    found: dict[str, Any] = {
        "displacement_points": displacement_points,
        "step_points": step_points,
        "first_step_s": float(times[1] - times[0]),
        "end_s": float(times[-1]),
        "steps": times.size - 1,
        "time_s": times.tolist(),
        "displacement_mm": displacements.tolist(),
        "protocol": protocol,
    }
    if np.isfinite(specimen.length_mm):
        found["specimen"] = {
            "length_mm": specimen.length_mm,
            "width_mm": specimen.width_mm,
            "half_width_mm": specimen.width_mm / 2,
            "thickness_mm": specimen.thickness_mm,
        }
    return found


def render(directory: Path, job: dict[str, Any], max_bytes: int) -> dict[str, Any]:
    """Do a job of :func:`tasks.simulate.rendering.answer` in a process of its own. Raises :class:`Failed`."""
    (directory / rendering.JOB).write_text(json.dumps(job), "utf-8")
    finished = external.run(
        [sys.executable, "-I", str(Path(rendering.__file__).resolve())],
        directory,
        timeout_s=RENDER_S * len(job["renders"]),
        max_file_bytes=max_bytes,
    )
    (directory / rendering.JOB).unlink()
    answer = directory / rendering.ANSWER
    if finished.timed_out or finished.killed_by == "SIGXCPU":
        raise Failed("bad_input", f"{job['main']} takes more than {rendering.SECONDS} s to render")
    if finished.killed_by == "SIGXFSZ":
        raise Failed("bad_input", f"{job['main']} renders to more than max_file_mb")
    if not answer.is_file():
        raise Failed("crashed", f"rendering {job['main']} ended by {finished.killed_by or finished.output[-300:]}")
    told: dict[str, Any] = json.loads(answer.read_text("utf-8"))
    answer.unlink()
    if "wrong" in told:
        where, problem, expected = told["wrong"]
        raise _Wrong(where, problem, expected)
    return told


class _Wrong(Failed):
    """What is wrong with a template, in the three parts of :class:`BadInput`."""

    def __init__(self, where: str, problem: str, expected: str) -> None:
        super().__init__("bad_input", f"{where}: {problem}; expected {expected}")
        self.parts = (where, problem, expected)


# ---- the template


def read_files(folder: Path, name: str) -> tuple[str, dict[str, str]]:
    """A template inside ``folder`` and what it includes: its own name, and the texts of all files by name.

    What it includes, by plain names, must lie in the template's own folder or below. Raises :class:`BadInput`.
    """
    main = folder / name
    _check_inside(main, folder, "the study's folder")
    home, files = main.parent, dict[str, str]()
    waiting = [main.name]
    while waiting:
        each = waiting.pop()
        path = home / each
        _check_inside(path, home, "the template's folder")
        files[each] = _text(path)
        try:
            asked = list(jinja2.meta.find_referenced_templates(SandboxedEnvironment().parse(files[each])))
        except jinja2.TemplateSyntaxError as error:
            raise BadInput(
                f"{path}: line {error.lineno}", error.message or "syntax error", "a Jinja2 template"
            ) from None
        except RecursionError:
            raise BadInput(path, "nested too deeply", "a simpler template") from None
        for other in asked:
            if other is None:
                raise BadInput(path, "an include whose name is computed", '{% include "name" %}')
            if other not in files and other not in waiting:
                waiting.append(other)
        if len(files) > MAX_FILES or sum(map(len, files.values())) > MAX_TEMPLATE_BYTES:
            raise BadInput(main, "with all that it includes is too large", f"at most {MAX_FILES} files and 64 MB")
    return main.name, dict(sorted(files.items()))


def _check_inside(path: Path, folder: Path, what: str) -> None:
    try:
        inside = path.resolve().is_relative_to(folder.resolve())
    except (ValueError, RuntimeError, OSError):
        raise BadInput(
            "simulator.file", f"{shown(str(path))} cannot be a file", "a template beside the study"
        ) from None
    if not inside:
        raise BadInput(path, f"lies outside {what}", "a file inside it")
    if not path.is_file():
        raise BadInput(path, "is not there", "a FEBio input template")


def _text(path: Path) -> str:
    if path.stat().st_size > MAX_TEMPLATE_BYTES:
        raise BadInput(path, f"{path.stat().st_size / 2**20:,.0f} MB", "at most 64 MB")
    try:
        return path.read_text("utf-8-sig")
    except UnicodeDecodeError:
        raise BadInput(path, "not a text file", "a FEBio input template in UTF-8") from None
    except OSError as error:
        raise BadInput(path, (error.strerror or "cannot be read").lower(), "a readable file") from None


def check_template(study: Path, template: Template, model: Model, *, sized: bool, moved: bool) -> None:
    """Render the template at the middle of all ranges and at both ends of each, and see that every parameter matters.

    ``sized``: the specimen's size is known. ``moved``: the displacement history must be used. Raises :class:`BadInput`.
    """
    size = (10.0, 8.0, 4.0) if sized else (np.nan,) * 3
    times = np.array([0.0, 1.0, 2.0])
    named = variables(Specimen("check", *size), "check", times, 0.1 * times)
    middle = dict(zip(model.names, model.reference.tolist(), strict=True)) | named
    renders = [middle]
    renders += [middle | {p.name: value} for p in model.free for value in (p.minimum, p.maximum)]
    job = {"files": dict(template.files), "main": template.main, "renders": renders, "known": list(middle)}
    with tempfile.TemporaryDirectory(prefix="sinew-") as folder:
        try:
            told = render(Path(folder), job | {"outputs": [asdict(o) for o in template.outputs]}, 2**30)
        except _Wrong as wrong:
            where, problem, expected = wrong.parts
            raise BadInput(f"{study}: {where}", problem, expected) from None
        except Failed as failed:
            raise BadInput(f"{study}: {template.main}", failed.words, "a template that can be rendered") from None
    for name in model.names:
        if name not in told["used"]:
            where = f"{study}: model.parameters.{name}"
            raise BadInput(where, f"not used in {template.main}", f"{{{{ {name} }}}} where it acts")
    for number, parameter in enumerate(model.free):
        if len({told["digests"][0], *told["digests"][1 + 2 * number : 3 + 2 * number]}) == 1:
            problem = f"{template.main} renders to the same input at both ends of its range"
            raise BadInput(
                f"{study}: model.parameters.{parameter.name}", problem, f"{{{{ {parameter.name} }}}} printed"
            )
    if moved and not {"displacement_points", "displacement_mm"} & set(told["used"]):
        problem = f"{template.main} does not follow the measured displacement"
        raise BadInput(f"{study}: simulator.file", problem, "{{ displacement_points }} in its load curve")


# ---- output


def read_output(path: Path, output: Logged, max_bytes: int, end_s: float) -> tuple[Array, Array]:
    """Times ``[t]`` (s, increasing up to ``end_s``) and values ``[t]`` of one output.

    Raises :class:`Failed` for anything amiss.
    """
    try:
        found, table, even = read_records(path, max_bytes)
    except Failed as failed:
        raise Failed(failed.status, f"{output.name}: {failed.words}") from None
    lines, width = table.shape
    if not found.size or not even or not lines or lines % found.size or width != 2:
        raise Failed("bad_output", f"{output.name}: {found.size} steps and {lines} lines of {width} numbers")
    if not (np.isfinite(found).all() and (np.diff(found) > 0).all() and found[0] >= 0):
        raise Failed("bad_output", f"{output.name}: times do not increase")
    if found[-1] < end_s - _slack(end_s):
        raise Failed("bad_output", f"{output.name} ends at {found[-1]:g} s, the protocol at {end_s:g} s")
    ids, values = table.reshape(found.size, -1, 2).transpose(2, 0, 1)
    if not (ids == ids[0]).all() or (output.ids and set(ids[0]) != set(output.ids)):
        raise Failed("bad_output", f"{output.name}: logged for other ids than asked")
    with np.errstate(over="ignore", invalid="ignore"):
        total = output.scale * _REDUCE[output.reduce](values, axis=1)
    if not np.isfinite(total).all():
        at = found[np.flatnonzero(~np.isfinite(total))[0]]
        raise Failed("bad_output", f"{output.name} is not finite at {at:g} s")
    return found, total


def _slack(end_s: float) -> float:
    """How far apart times may be and still be the same (s): FEBio logs them with nine digits at the most."""
    return 1e-7 * max(1.0, end_s)
