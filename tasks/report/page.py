"""``report.html``: one page of a result folder, finished or not, that needs no network and no other file."""

import json
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any
from urllib.parse import quote

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from sinew.runner.errors import BadInput, SinewError, one_line
from sinew.tasks.calibrate.result import CalibrateResult
from sinew.tasks.discover.result import ADOPTED, NAMES, DiscoverResult
from sinew.tasks.drawing.blocks import Facts, Section, Words, number
from sinew.tasks.drawing.formats import FORMATS
from sinew.tasks.model import TENDON
from sinew.tasks.model.effects import named
from sinew.tasks.registry import TASKS
from sinew.tasks.report.folder import ResultFolder, State, read_folder
from sinew.tasks.report.page_head import head, scripts
from sinew.tasks.report.sections import adopted, data, failures, provenance
from sinew.tasks.report.status import PAGE
from sinew.tasks.study.files import write_text
from sinew.tasks.study.resources import resource

# characters that no page shows, and those that change the direction of the text behind them
UNSEEN = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\u200e\u200f\u202a-\u202e\u2066-\u2069]")


@dataclass(frozen=True)
class _Part:
    """A section of the page: its ``name``, what builds it, and the task whose figures belong to it, if any."""

    name: str
    build: Callable[[ResultFolder], Section]
    task: str = ""


def _parts(folder: ResultFolder) -> list[_Part]:
    """The sections in their order; those of optional tasks only where there is something to show."""
    tasks = sorted(TASKS.values(), key=lambda task: task.place)
    shown = [task for task in tasks if task.name in folder.states]
    modules = [(task.name, task.module("page")) for task in shown]
    return [
        *_leading(folder),
        _Part("data", data.section),
        *(_Part(module.NAME, module.section, name) for name, module in modules),
        _Part("failures", failures.section),
        _Part("provenance", provenance.section),
    ]


def _leading(folder: ResultFolder) -> Iterator[_Part]:
    """Results of the model with the effects that `discover` named come first, once they are there."""
    discovery, there = folder.result(DiscoverResult), folder.folder / ADOPTED
    if discovery is None or discovery.verdict not in NAMES or not (there / PAGE).is_file():
        return
    try:
        adopted_fits = CalibrateResult.read(there)
    except BadInput:
        adopted_fits = None  # the section says what is damaged
    known = named()
    added = {one.name for effect in discovery.effects if effect in known for one in known[effect].parameters}
    if adopted_fits is None or added <= set(adopted_fits.names):  # else they are of an effect that was named before
        yield _Part(adopted.NAME, lambda found: adopted.section(found, read_folder(there)))


@dataclass(frozen=True)
class Built:
    """A page that was written, and a line for each thing that it could not show."""

    path: Path
    trouble: tuple[str, ...]


def build(folder: Path) -> Built:
    """Write ``FOLDER/report.html``. Raises :class:`sinew.runner.errors.BadInput` for another kind of folder."""
    found = read_folder(folder)
    sections, parts = [], _parts(found)
    for part in parts:
        try:
            sections.append(part.build(found))
        except Exception as error:  # noqa: BLE001 - a damaged result must not hide the others
            # fields that are right one by one may contradict each other, and arrays of the store may be damaged
            line = _cannot_be_shown(found, part, error)
            found.trouble.append(line)
            sections.append(Section(part.name, part.name.capitalize(), "", missing=line))
    sections = [_marked(found, part, section) for part, section in zip(parts, sections, strict=True)]
    write_text(folder / PAGE, _page(found, parts, sections))
    return Built(folder / PAGE, tuple(found.trouble))


def _marked(found: ResultFolder, part: _Part, section: Section) -> Section:
    """The section, folded where its task was not run, and with a warning where its model lacks a named effect."""
    if section.missing:
        return replace(section, folded=bool(part.task) and found.states[part.task].word == "not run")
    discovery = found.result(DiscoverResult)
    of_curves = bool(part.task) and TASKS[part.task].measured and part.task != DiscoverResult.TASK
    if discovery is None or discovery.verdict not in NAMES or not of_curves:
        return section
    calibration = found.result(CalibrateResult)
    if calibration is None or set(calibration.names) - {parameter.name for parameter in TENDON}:
        return section  # its model has effects
    lacks = f"This is of the model without {discovery.answer}, which discover found to be missing."
    if (found.folder / ADOPTED / PAGE).is_file():
        then = f" The results with it are in `{ADOPTED}/{PAGE}`."
    else:
        then = "" if discovery.model is None else f" The study with it is `{discovery.model.path}`."
        then += f" `{found.command('run')[1:-1]} --adopt` adds the results with it."
    return replace(section, blocks=[Words(lacks + then, "warning"), *section.blocks])


def _cannot_be_shown(found: ResultFolder, part: _Part, error: Exception) -> str:
    if isinstance(error, SinewError):
        return str(error)
    file = found.folder / (f"{part.task}.json" if part.task else "store.zarr")
    what = f"{type(error).__name__}: {error}"
    return one_line(
        f"{file}: the section '{part.name}' cannot be shown ({what}); run `sinew {part.task or 'run'}` again"
    )


def _page(found: ResultFolder, parts: list[_Part], sections: list[Section]) -> str:
    figures = {part.name: _figures(found.folder, part.task) for part in parts if part.task}
    return render(
        found.name, _key(found), sections, found.trouble, states=found.states, figures=figures, version=_version(found)
    )


def render(
    title: str,
    key: Facts,
    sections: Sequence[Section],
    trouble: Sequence[str],
    *,
    states: Mapping[str, State] = MappingProxyType({}),
    figures: Mapping[str, Any] = MappingProxyType({}),
    version: str = "",
) -> str:
    """A page of these sections: HTML that holds all it needs, in which everything is escaped."""
    loader = FileSystemLoader(resource("templates/report.html.j2").parent)
    environment = Environment(
        loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True, finalize=_seen
    )
    environment.filters["json"] = _json
    style = resource("templates/report.css").read_text("utf-8")
    return environment.get_template("report.html.j2").render(
        title=title,
        states=states,
        key=key,
        trouble=trouble,
        sections=sections,
        figures=figures,
        version=version,
        head=head(),
        scripts=[_inside_script(script) for script in scripts()],
        style=Markup(style),  # noqa: S704 - a file of this package
    )


def _seen(value: Any) -> Any:
    """A text without characters that nobody sees; HTML of this program stays as it is."""
    return UNSEEN.sub("\N{REPLACEMENT CHARACTER}", value) if type(value) is str else value


def _key(found: ResultFolder) -> Facts:
    """The few numbers that say how large this was."""
    tables = found.status["tables"] if found.status else []
    failed = sum(sum(table["failed"].values()) for table in tables)
    rows = [
        ("specimens", _specimens(found)),
        ("evaluations", f"{sum(table['done'] for table in tables):,}"),
        ("failed", f"{failed:,}"),
        ("core-hours in evaluations", number(found.status["core_hours"]["evaluations"], 2) if found.status else "–"),
    ]
    return Facts(rows)


def _specimens(found: ResultFolder) -> str:
    if found.store is None:
        return "–"
    try:
        return f"{len(found.measured):,}"
    except Exception:  # noqa: BLE001 - the section of the data says what is damaged
        return "–"


def _version(found: ResultFolder) -> str:
    return str(found.runs[-1].get("version", "")) if found.runs else ""


def _figures(folder: Path, task: str) -> list[tuple[str, list[tuple[str, str]]]]:
    """Figures of a task that are there: a name, and links to its formats relative to the page."""
    names = sorted({path.stem for path in (folder / "figures").glob(f"{task}*") if path.suffix[1:] in FORMATS})
    there = {name: [kind for kind in FORMATS if (folder / "figures" / f"{name}.{kind}").is_file()] for name in names}
    return [(name, [(kind, f"figures/{quote(name)}.{kind}") for kind in kinds]) for name, kinds in there.items()]


def _json(value: Any) -> Markup:
    """JSON that may stand in a script element: nothing in it can end the element or begin a comment."""
    finite = json.loads(json.dumps(value, default=dict), parse_constant=lambda _: None)  # browsers know no NaN
    text = json.dumps(finite, separators=(",", ":"))
    for character in "<>&\u2028\u2029":
        text = text.replace(character, f"\\u{ord(character):04x}")
    return Markup(text)  # noqa: S704 - cannot end the element, see above


def _inside_script(script: str) -> Markup:
    """A script of this package or of Bokeh as content of a script element."""
    if "</script" in script.lower() or "<!--" in script:
        raise ValueError("a script that would end its element")
    return Markup(script)  # noqa: S704 - checked above
