"""The real solver: render its input, run it, read its reactions, and say in one word why it failed.

FEBio 4 is run once for each parameter set and protocol, in a directory and a process group of its own. The input is a
Jinja2 template, rendered in a sandbox. The model is half of the specimen's width, so force = 2 x summed reactions.
"""

import hashlib
import re
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import defusedxml.ElementTree
import jinja2
import numpy as np
from defusedxml import DefusedXmlException
from jinja2.sandbox import SandboxedEnvironment
from scipy.interpolate import CubicSpline, PchipInterpolator

from tasks.model import Curve, Model, Protocol, Specimen
from tasks.problems import BadInput, shown
from tasks.resources import resource
from tasks.simulate import Array, Compared, Simulated
from tasks.simulate.attempt import INPUT, Failed, attempt, read_records, row_by_row

REACTIONS = "reaction.txt"
DEFAULT_TEMPLATE = "tendon.feb.j2"
MAX_TEMPLATE_BYTES = 64 * 2**20
HALF = 2.0
SHORTEST_HOLD_S = 1.0


@dataclass(frozen=True)
class FEBio:
    """A solver, its version, the text of the input template, and how a run is stepped and limited.

    ``scratch`` holds one directory for each attempt, unless the job names a folder on its node; those of failed rows
    are kept in ``scratch``, at most ``keep_failed``.
    ``ramp_s``, ``hold_growth`` and ``still_mm`` say where the solver steps, see :func:`solver_steps`.
    ``loaded_at_rest`` says that the template's bar bears force at zero displacement, whose relaxation is waited for.
    """

    executable: str
    version: str
    template: str
    scratch: Path
    timeout_s: float = 600.0
    max_file_bytes: int = 2**32
    ramp_s: float = 0.0
    hold_growth: float = 0.02
    still_mm: float = 0.0
    keep_failed: int = 20
    loaded_at_rest: bool = False
    name: str = "febio"
    batch_multiple: int = 1

    def identity(self) -> dict[str, Any]:
        digest = hashlib.blake2b(self.template.encode(), digest_size=16).hexdigest()
        steps = {"ramp_s": self.ramp_s, "hold_growth": self.hold_growth, "still_mm": self.still_mm}
        identity = {"name": self.name, "version": self.version, "template": digest, "time_steps": steps}
        return identity | ({"loaded_at_rest": True} if self.loaded_at_rest else {})

    def simulate(
        self, model: Model, specimen: Specimen, protocol: Protocol, parameters: Array, *, stresses: bool = False
    ) -> Simulated:
        if stresses:
            raise BadInput("simulator", "febio reports no constituent stresses", "simulator: uniaxial for stresses")
        force = np.full((len(parameters), protocol.time_s.size), np.nan)
        solve = partial(self._force, model, specimen, protocol)
        return Simulated(force, *row_by_row(model, parameters, solve, force))

    def compare(self, model: Model, specimen: Specimen, curve: Curve, parameters: Array, keep: Array) -> Compared:
        simulated = self.simulate(model, specimen, curve.protocol, parameters)
        rmse = np.sqrt(np.mean((simulated.force_N - curve.force_N) ** 2, axis=1))
        return Compared(rmse, simulated.force_N[:, keep], simulated.status, simulated.messages)

    def rendered(self, model: Model, specimen: Specimen, protocol: Protocol, values: Array) -> str:
        """The solver's input for one parameter set ``[d]``."""
        _, times, displacements, _ = self._stepped(model, protocol, values)
        return _rendered(self.template, model, specimen, times, displacements, values)

    def _stepped(self, model: Model, protocol: Protocol, values: Array) -> tuple[Array, Array, Array, int]:
        """Rows of the protocol at which the solver stops; its times (s), displacements (mm), and the first of these."""
        rows = solver_steps(protocol, self.ramp_s, self.hold_growth, self.still_mm)
        relaxed_s = 40.0 * max(value for name, value in zip(model.names, values, strict=True) if name.startswith("tau"))
        return rows, *from_rest(protocol, rows, relaxed_s, loaded_at_rest=self.loaded_at_rest)

    def _force(self, model: Model, specimen: Specimen, protocol: Protocol, values: Array) -> Array:
        """Force ``[t]`` (N) for one parameter set. Raises :class:`Failed`."""
        rows, times, displacements, first = self._stepped(model, protocol, values)

        def prepare(directory: Path) -> None:
            text = _rendered(self.template, model, specimen, times, displacements, values)
            (directory / INPUT).write_text(text, "utf-8")

        def read(directory: Path) -> Array:
            return read_reactions(directory / REACTIONS, times[1:], self.max_file_bytes)

        reactions = attempt(self, prepare, read, dict(zip(model.names, values.tolist(), strict=True)))
        at_steps = HALF * np.concatenate([[0.0], reactions])[first:]
        return at_every_row(protocol, rows, at_steps, self.still_mm)


# ---- input


def read_template(folder: Path, name: str | None, model: Model | None = None) -> str:
    """The input template's text, the built-in one or a file inside ``folder``; checked by rendering it once.

    It is rendered with the parameters of ``model``, by default the baseline's.

    Raises :class:`BadInput` when it is not there, leaves the folder, cannot be rendered, or is no FEBio input.
    """
    path = resource(f"templates/{DEFAULT_TEMPLATE}") if name is None else folder / name
    if name is not None:
        try:
            inside = path.resolve().is_relative_to(folder.resolve())
        except (ValueError, RuntimeError, OSError):
            raise BadInput(
                "simulator.template", f"{shown(name)} cannot be a file", "a template beside the study"
            ) from None
        if not inside:
            raise BadInput(path, "lies outside the study's folder", "a template inside it")
        if not path.is_file():
            raise BadInput(path, "is not there", "a FEBio input template")
        if path.stat().st_size > MAX_TEMPLATE_BYTES:
            raise BadInput(path, f"{path.stat().st_size / 2**20:,.0f} MB", "at most 64 MB")
    try:
        text = path.read_text("utf-8")
    except UnicodeDecodeError:
        raise BadInput(path, "not a text file", "a FEBio input template in UTF-8") from None
    except OSError as error:
        raise BadInput(path, (error.strerror or "cannot be read").lower(), "a readable file") from None
    model = model or Model()
    times = np.array([0.0, 1.0, 2.0])
    try:
        rendered = render(text, model, Specimen("check", 10.0, 8.0, 4.0), times, 0.1 * times, model.reference)
    except jinja2.TemplateSyntaxError as error:
        raise BadInput(f"{path}: line {error.lineno}", error.message or "syntax error", "a Jinja2 template") from None
    except _CANNOT as error:
        raise BadInput(
            path, f"cannot be rendered ({error})", "the variables named at the top of tendon.feb.j2"
        ) from None
    _check_xml(path, rendered)
    return text


def _rendered(
    template: str, model: Model, specimen: Specimen, times: Array, displacements: Array, values: Array
) -> str:
    try:
        text = render(template, model, specimen, times, displacements, values)
        if _SUSPECT.search(text):  # parsing every input would cost as much as a short run
            _check_xml(Path(INPUT), text)
    except BadInput as error:
        raise Failed("bad_input", str(error)) from None
    except _CANNOT as error:
        raise Failed("bad_input", f"the template cannot be rendered ({error})") from None
    return text


# whatever could name a file outside the attempt's directory, or hide one in an entity
_SUSPECT = re.compile(r"""&|<!|Include|(?:file|from)\s*=\s*(["'])(?!\w[\w.-]*\1)""")
_CANNOT = (
    jinja2.TemplateError,
    TypeError,
    ValueError,
    ArithmeticError,
    LookupError,
    RecursionError,
    MemoryError,
    SyntaxError,
)


def render(template: str, model: Model, specimen: Specimen, times: Array, displacements: Array, values: Array) -> str:
    """The solver's input for one parameter set; numbers read back to the same bits."""
    displacement_points, step_points = load_points(times.tobytes(), displacements.tobytes())
    return _compiled(template).render(
        parameters=dict(zip(model.names, values.tolist(), strict=True)),
        constants={"beta": model.beta, "lambda_0": model.lambda_0},
        specimen={
            "length_mm": specimen.length_mm,
            "half_width_mm": specimen.width_mm / 2,
            "thickness_mm": specimen.thickness_mm,
        },
        first_step_s=float(times[1] - times[0]),
        end_s=float(times[-1]),
        displacement_points=displacement_points,
        step_points=step_points,
    )


@lru_cache(maxsize=8)
def _compiled(template: str) -> jinja2.Template:
    environment = SandboxedEnvironment(undefined=jinja2.StrictUndefined, autoescape=False)
    environment.filters["full"] = _full
    return environment.from_string(template)


def _full(value: Any) -> str:
    if isinstance(value, jinja2.Undefined):
        str(value)  # says which variable it is
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise TypeError(f"| full prints numbers, not {shown(value)}")
    return repr(float(value))


@lru_cache(maxsize=32)
def load_points(times: bytes, displacements: bytes) -> tuple[str, str]:
    """Load curve points of the displacement, and of the must points where the solver has to stop."""
    at = np.frombuffer(times).tolist()
    moved = "".join(f"<pt>{t!r},{u!r}</pt>\n" for t, u in zip(at, np.frombuffer(displacements).tolist(), strict=True))
    longest = 2 * at[-1]  # the largest step allowed: larger than any, so that each step ends at the next must point
    return moved, "".join(f"<pt>{t!r},{longest!r}</pt>\n" for t in at)


def _check_xml(path: Path, text: str) -> None:
    try:
        root = defusedxml.ElementTree.fromstring(text.encode())
    except (defusedxml.ElementTree.ParseError, DefusedXmlException, ValueError) as error:
        raise BadInput(path, f"renders to no XML ({error})", "a FEBio input file") from None
    if root.tag != "febio_spec":
        raise BadInput(path, f"renders to <{root.tag}>", "<febio_spec>")
    for element in root.iter():
        if element.tag == "Include":
            raise BadInput(path, "<Include>", "everything in the template itself")
        for attribute in ("file", "from"):
            name = element.get(attribute)
            if name is not None and (Path(name).name != name or name in ("", ".", "..")):
                raise BadInput(path, f"<{element.tag} {attribute}={shown(name)}>", "a file name without a folder")


# ---- stepping


@lru_cache(maxsize=256)
def solver_steps(protocol: Protocol, ramp_s: float, hold_growth: float, still_mm: float) -> Array:
    """Rows of the protocol at which the solver stops, the first and the last among them.

    While the displacement moves, steps are at most ``ramp_s`` long (0: every row) and stop at each reversal. In a hold
    (at least 1 s within ``still_mm`` of a constant) the recursion of the model is exact for any step, so steps grow to
    ``hold_growth`` times the time since the hold began (0: every row).
    """
    time_s, u = protocol.time_s, protocol.displacement_mm
    rows = [0]
    for begin, end, still in _segments(protocol, still_mm):
        if (hold_growth if still else ramp_s) == 0:
            rows += range(begin + 1, end + 1)
            continue
        at = begin
        while at < end:
            longest = hold_growth * (time_s[at] - time_s[begin]) if still else ramp_s
            following = int(np.searchsorted(time_s, time_s[at] + longest * (1 + 1e-9), side="right")) - 1
            following = min(max(following, at + 1), end)
            if not still:
                for reversal in range(at + 1, following):
                    if (u[reversal] - u[reversal - 1]) * (u[reversal + 1] - u[reversal]) <= 0:
                        following = reversal
                        break
            rows.append(following)
            at = following
    return np.array(rows)


@lru_cache(maxsize=256)
def _segments(protocol: Protocol, still_mm: float) -> list[tuple[int, int, bool]]:
    """Holds and the motion between them, as (first row, last row, is a hold); last rows are the next first rows."""
    time_s, u = protocol.time_s, protocol.displacement_mm
    moved = np.flatnonzero(np.abs(np.diff(u)) > still_mm) + 1  # a hold begins after a row that moved
    segments: list[tuple[int, int, bool]] = []
    motion = 0
    start = 0
    while start < u.size - 1:
        following = int(moved[np.searchsorted(moved, start + 1)]) if moved.size and moved[-1] > start else u.size
        end = start + int(np.argmax(np.append(np.abs(u[start:following] - u[start]) > still_mm, True))) - 1
        if time_s[end] - time_s[start] >= SHORTEST_HOLD_S:
            if start > motion:
                segments.append((motion, start, False))
            segments.append((start, end, True))
            motion = end
        start = max(end, start + 1)
    if motion < u.size - 1:
        segments.append((motion, u.size - 1, False))
    return segments


def from_rest(protocol: Protocol, rows: Array, relaxed_s: float, *, loaded_at_rest: bool) -> tuple[Array, Array, int]:
    """The solver's times (s, from 0) and displacements (mm), and which of them is the protocol's first row.

    A protocol that starts displaced, or a bar that is loaded without, starts at rest: the solver goes there in 1 s and
    waits until all has relaxed.
    """
    times = protocol.time_s[rows] - protocol.time_s[0]
    displacements = protocol.displacement_mm[rows]
    if displacements[0] == 0 and not loaded_at_rest:
        return times, displacements, 0
    waited = 1.0 + relaxed_s
    times = np.concatenate([[0.0, 1.0], times + waited])
    return times, np.concatenate([[0.0, displacements[0]], displacements]), 2


def at_every_row(protocol: Protocol, rows: Array, force: Array, still_mm: float) -> Array:
    """Force at every row from the force at the solver's ``rows``: splines in holds, monotone cubics in motion."""
    if rows.size == protocol.time_s.size:
        return force
    full = np.empty(protocol.time_s.size)
    for begin, end, still in _segments(protocol, still_mm):
        inside = (rows >= begin) & (rows <= end)
        times, values = protocol.time_s[rows[inside]], force[inside]
        curve = CubicSpline if still and times.size >= 4 else PchipInterpolator
        full[begin : end + 1] = curve(times, values)(protocol.time_s[begin : end + 1])
    full[rows] = force
    return full


# ---- output


def read_reactions(path: Path, times: Array, max_bytes: int) -> Array:
    """Summed reactions ``[t]`` (N) at ``times`` ``[t]`` (s). Raises :class:`Failed` unless every number is there."""
    found, table, even = read_records(path, max_bytes)
    values = table[:, -1]
    if found.size != times.size or not values.size or not even:
        raise Failed("bad_output", f"{path.name} holds {found.size} of {times.size} steps and {values.size} reactions")
    late = np.flatnonzero(~(np.abs(found - times) <= 1e-7 * max(1.0, times[-1])))
    if late.size:
        i = int(late[0])
        raise Failed("bad_output", f"{path.name}: step {i + 1} is at {found[i]:g} s, not at {times[i]:g} s")
    with np.errstate(over="ignore", invalid="ignore"):
        total = values.reshape(found.size, -1).sum(axis=1)
    if not np.isfinite(total).all():
        raise Failed("bad_output", f"{path.name} holds a reaction that is not finite")
    return total
