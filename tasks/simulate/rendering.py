"""From a user's input template to the solver's input, as a program of its own: it is run, never imported by a worker.

A template is a program that somebody else wrote. Here it has numbers and the other files of its folder, but no
attributes, no modules and no files, and this process has bounds on its memory and its time, which a loop or a constant
such as ``10 ** (10 ** 10)`` would exceed. What comes out must be XML without anything that names another file; the
outputs that the study asks for are added to its log file section.

It imports nothing of sinew, so that it starts in a tenth of a second.
"""

import hashlib
import json
import math
import re
import resource
import sys
import traceback
from pathlib import Path, PurePath
from typing import Any
from xml.etree.ElementTree import Element, SubElement, tostring

import defusedxml.ElementTree
import jinja2
import jinja2.meta
from defusedxml import DefusedXmlException
from jinja2.exceptions import SecurityError
from jinja2.runtime import LoopContext
from jinja2.sandbox import SandboxedEnvironment
from jinja2.utils import Namespace

JOB, ANSWER = "render.json", "rendered.json"
SECONDS, MEMORY_BYTES, INPUT_BYTES = 60, 2**31, 2**28

FILTERS = (
    *("abs", "batch", "first", "float", "format", "int", "join", "last", "length", "list", "max", "min", "replace"),
    *("reverse", "round", "slice", "sort", "sum", "trim", "unique"),
)
FUNCTIONS = {
    name: getattr(math, name) for name in ("sqrt", "exp", "log", "sin", "cos", "tan", "atan2", "hypot", "floor", "ceil")
}
CONSTANTS = {"pi": math.pi}
_PATH = re.compile(r"\s*([/~\\]|[A-Za-z]:)")
_OF_LOOPS = {"index", "index0", "revindex", "revindex0", "first", "last", "length", "previtem", "nextitem", "depth"}


class Wrong(Exception):
    """What is wrong with a template: where, what, and what was expected."""


class Closed(SandboxedEnvironment):
    """Names, items, arithmetic, loops and macros; nothing of Python's objects."""

    def getattr(self, obj: Any, attribute: str) -> Any:
        if isinstance(obj, dict):
            return obj[attribute] if attribute in obj else self.undefined(obj=obj, name=attribute)
        if isinstance(obj, Namespace) or (isinstance(obj, LoopContext) and attribute in _OF_LOOPS):
            return super().getattr(obj, attribute)
        raise SecurityError(f".{attribute} is no variable; templates cannot use attributes")

    def getitem(self, obj: Any, argument: Any) -> Any:
        if isinstance(obj, dict | list | tuple | str):
            try:
                return obj[argument]
            except (LookupError, TypeError):
                return self.undefined(obj=obj, name=argument)
        raise SecurityError("[...] is for lists and mappings")


def environment(files: dict[str, str]) -> Closed:
    """Where templates of ``files``, and no others, can be rendered."""
    closed = Closed(
        undefined=jinja2.StrictUndefined,
        autoescape=False,
        finalize=_printable,
        loader=jinja2.FunctionLoader(lambda name: (files[name], name, None) if name in files else None),
    )
    closed.filters = {name: closed.filters[name] for name in FILTERS} | {"full": _full}
    closed.globals = {name: closed.globals[name] for name in ("range", "namespace")} | FUNCTIONS | CONSTANTS
    return closed


def _printable(value: Any) -> Any:
    if isinstance(value, float) and not math.isfinite(value):
        raise ValueError(f"prints {value}, which is no finite number")
    if isinstance(value, jinja2.Undefined):
        return value  # says which variable it is
    if value is None or callable(value) or isinstance(value, dict | list | tuple):
        raise TypeError(f"prints {'nothing' if value is None else 'something else than a number or a text'}")
    return value


def _full(value: Any) -> str:
    if isinstance(value, jinja2.Undefined):
        str(value)  # says which variable it is
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise TypeError("| full prints numbers")
    return repr(float(value))


# ---- rendering


def used_names(files: dict[str, str]) -> set[str]:
    """The variables that templates use and do not set themselves."""
    closed = environment({})
    found: set[str] = set()
    for name, text in files.items():
        try:
            found |= jinja2.meta.find_undeclared_variables(closed.parse(text))
        except jinja2.TemplateSyntaxError as error:
            raise Wrong(f"{name}: line {error.lineno}", error.message or "syntax error", "a Jinja2 template") from None
    return found - set(closed.globals)


def rendered(files: dict[str, str], main: str, variables: dict[str, Any]) -> Element:
    """The root of the XML that the template gives. Raises :class:`Wrong`."""
    try:
        text = environment(files).get_template(main).render(variables)
    except jinja2.TemplateSyntaxError as error:
        raise Wrong(f"{main}: line {error.lineno}", error.message or "syntax error", "a Jinja2 template") from None
    except MemoryError:
        raise Wrong(main, f"takes more than {MEMORY_BYTES / 2**30:g} GB to render", "less") from None
    except Exception as error:  # noqa: BLE001 - a template can raise anything that an expression can
        raise Wrong(
            _line_of(error, files, main), f"cannot be rendered ({error})", "numbers and known variables"
        ) from None
    if len(text) > INPUT_BYTES:
        raise Wrong(main, f"renders to {len(text) / 2**20:,.0f} MB", f"at most {INPUT_BYTES / 2**20:.0f} MB")
    try:
        return defusedxml.ElementTree.fromstring(text.encode(), forbid_dtd=True)
    except (defusedxml.ElementTree.ParseError, DefusedXmlException, ValueError) as error:
        line = getattr(error, "position", (0,))[0]
        around = text.splitlines()[line - 1].strip()[:60] if 0 < line <= text.count("\n") + 1 else ""
        problem = f"renders to no XML ({error}{f': {around}' if around else ''})"
        raise Wrong(main, problem, "well-formed XML without a document type") from None


def _line_of(error: Exception, files: dict[str, str], main: str) -> str:
    lines = [frame for frame in traceback.extract_tb(error.__traceback__) if frame.filename in files]
    return f"{lines[-1].filename}: line {lines[-1].lineno}" if lines else main


def check(main: str, root: Element) -> None:
    """Refuse what is no FEBio input, and what could name a file outside the attempt's folder."""
    if root.tag != "febio_spec":
        raise Wrong(main, f"renders to <{root.tag}>", "<febio_spec>")
    for element in root.iter():
        if element.tag in ("Include", "Plugins", "Import"):
            raise Wrong(main, f"<{element.tag}>", "everything in the template and in what it includes by Jinja2")
        for name, value in (*element.attrib.items(), (None, element.text or "")):
            told = element.tag if name is None else f"{element.tag} {name}"
            if name == "from" or (name == "file" and (PurePath(value).name != value or value in ("", ".", ".."))):
                raise Wrong(main, f'<{told}="{value[:40]}">', "a file name without a folder")
            if _PATH.match(value) or "../" in value or "..\\" in value:
                raise Wrong(main, f"<{told}> names a path ({value.strip()[:40]})", "nothing outside of the template")


# ---- outputs


def add_outputs(main: str, root: Element, outputs: list[dict[str, Any]]) -> None:
    """Add the study's outputs to the log file section, each with a file of its own."""
    section = root.find("Output")
    if section is None:
        section = SubElement(root, "Output")
    log = section.find("logfile")
    if log is None:
        log = SubElement(section, "logfile")
    for number, output in enumerate(outputs):
        chosen = _ids(main, root, output)
        if output["reduce"] == "single" and len(chosen) != 1:
            problem = f"set {output['set']} has {len(chosen)} items" if output["set"] else f"{len(chosen)} ids"
            raise Wrong(_of(output), problem, "one, or reduce: sum, mean, max or min")
        attributes = {"data": output["item"], "name": output["name"], "file": f"sinew-{number}.txt", "delim": ","}
        SubElement(log, output["data"], attributes).text = ",".join(map(str, chosen))


def _of(output: dict[str, Any]) -> str:
    return f"simulator.outputs.{output['name']}"


def _ids(main: str, root: Element, output: dict[str, Any]) -> list[int]:
    """Which nodes, elements or rigid bodies an output is of. Raises :class:`Wrong` for those that are not there."""
    kind, asked = output["data"], output["set"]
    if kind == "rigid_body_data":
        bodies = {e.get("name"): _number(main, e) for e in root.iter("material") if e.get("type") == "rigid body"}
        there, sets, what = set(bodies.values()), {name: [number] for name, number in bodies.items()}, "rigid body"
    else:
        each, outer, named = ("node", "Nodes", "NodeSet") if kind == "node_data" else ("elem", "Elements", "ElementSet")
        parts = [(part, [_number(main, e) for e in part.iter(each)]) for part in root.iter(outer)]
        there = {number for _, numbers in parts for number in numbers}
        sets = {part.get("name"): numbers for part, numbers in parts}
        what = "node" if kind == "node_data" else "element"
        if asked is not None:
            sets |= {e.get("name"): _listed(main, e) for e in root.iter(named)}
    if asked is not None and asked not in sets:
        known = ", ".join(sorted(name for name in sets if name)) or "none is there"
        raise Wrong(_of(output), f"no set {asked!r} of {what}s in {main}", f"one of {known}"[:300])
    chosen = output["ids"] if asked is None else sets[asked]
    for number in chosen:
        if number not in there:
            raise Wrong(_of(output), f"{what} {number} is not in {main}", _range(there, what))
    if not chosen:
        raise Wrong(_of(output), f"set {asked!r} is empty", f"at least one {what}")
    return chosen


def _range(there: set[int], what: str) -> str:
    return f"{what}s from {min(there)} to {max(there)}" if there else f"a model with {what}s"


def _number(main: str, element: Element) -> int:
    text = element.get("id", "")
    if not text.strip().isdecimal():
        raise Wrong(main, f"<{element.tag} id={text!r}>", "a whole number as id")
    return int(text)


def _listed(main: str, element: Element) -> list[int]:
    """The ids of a set: ``1,2,3``, or an element with an id for each."""
    if len(element):
        return [_number(main, child) for child in element]
    found = []
    for part in (element.text or "").replace("\n", ",").replace(" ", ",").split(","):
        if part and not part.isdecimal():
            raise Wrong(main, f"<{element.tag} name={element.get('name')!r}> has {part[:20]!r}", "numbers and commas")
        found += [int(part)] if part else []
    return found


# ---- the program


def answer(job: dict[str, Any]) -> dict[str, Any]:
    """Render each of the job's ``renders`` (variables by name); write the first as ``input`` if that is asked for.

    Returns the names that the template uses, and a digest of each input.
    """
    files, main = job["files"], job["main"]
    found: dict[str, Any] = {"digests": []}
    if job.get("known") is not None:
        found["used"] = sorted(used_names(files))
        if unknown := [name for name in found["used"] if name not in job["known"]]:
            raise Wrong(main, f"unknown variable {unknown[0]}", f"some of {', '.join(job['known'])}")
    for number, variables in enumerate(job["renders"]):
        root = rendered(files, main, variables)
        check(main, root)
        add_outputs(main, root, job["outputs"])
        text = '<?xml version="1.0" encoding="UTF-8"?>\n' + tostring(root, encoding="unicode") + "\n"
        found["digests"].append(hashlib.blake2b(text.encode(), digest_size=16).hexdigest())
        if number == 0 and job.get("input"):
            Path(job["input"]).write_text(text, "utf-8")
    return found


def _main() -> None:
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
    job = json.loads(Path(JOB).read_text("utf-8"))
    seconds = SECONDS * len(job["renders"])
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 5))  # at the first it is told, at the second killed
    try:
        told = answer(job)
    except Wrong as wrong:
        told = {"wrong": wrong.args}
    except (MemoryError, RecursionError) as error:
        told = {"wrong": (job["main"], f"cannot be rendered ({type(error).__name__})", "a smaller or simpler template")}
    Path(ANSWER).write_text(json.dumps(told), "utf-8")


if __name__ == "__main__":
    sys.setrecursionlimit(2000)
    _main()
