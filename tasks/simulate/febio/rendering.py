"""The program that reads and renders templates. It runs in a process of its own; nobody imports it to render.

A template is a program that somebody else wrote. The template of a solver's input can use numbers and the other files
of its folder, but no attributes, no modules and no files. The process is limited in memory and processor time, because
a loop or a constant such as ``10 ** (10 ** 10)`` has no other limit. The rendered text must be XML that names no other
file. Where a study asks for outputs, they are added to its log file section. The template of a job script can use all
of Jinja2's sandbox, within the same limits.

The program reads one job per line and writes one answer per line, both JSON, until its input ends. It imports nothing
of sinew, so that it starts in a tenth of a second.
"""

import json
import math
import re
import resource
import sys
import time
import traceback
from collections import Counter
from pathlib import Path, PurePath
from typing import Any
from xml.etree.ElementTree import Element, SubElement, tostring

import defusedxml.ElementTree
import jinja2
import jinja2.meta
from defusedxml import DefusedXmlException
from jinja2.bccache import Bucket
from jinja2.exceptions import SecurityError
from jinja2.nodes import Name, Output
from jinja2.runtime import LoopContext
from jinja2.sandbox import SandboxedEnvironment
from jinja2.utils import Namespace

SECONDS, MEMORY_BYTES = 10, 2**30  # processor time of a job, memory of the process
INPUT_BYTES = 2**26  # of a rendered text
WORDS = 140  # letters of each part of a message

FILTERS = (
    *("abs", "batch", "default", "dictsort", "first", "float", "format", "int", "items", "join", "last", "length"),
    *("list", "max", "min", "replace", "reverse", "round", "slice", "sort", "sum", "trim", "unique"),
)
FUNCTIONS = {
    name: getattr(math, name) for name in ("sqrt", "exp", "log", "sin", "cos", "tan", "atan2", "hypot", "floor", "ceil")
}
CONSTANTS = {"pi": math.pi}
_PATH = re.compile(r"\s*([/~\\]|[A-Za-z]:)")
#: FEBio's reader turns ``&lt;`` into ``<`` before it looks for tags, and passes over carriage returns.
_MARKUP, _IN_ATTRIBUTES = re.compile(r"[<\x00-\x08\x0b-\x1f\x7f]"), re.compile(r'[<"\x00-\x08\x0b-\x1f\x7f]')
ROOM, ROOM_OF_DELIMITER = 255, 15  # characters that FEBio has for an attribute, or in a text in front of a comma
_OF_MAPPINGS = {"get", "items", "keys", "values"}
_OF_LOOPS = {"index", "index0", "revindex", "revindex0", "first", "last", "length", "previtem", "nextitem", "depth"}


class Wrong(Exception):
    """What is wrong with a template: where, what, and what was expected."""


class Closed(SandboxedEnvironment):
    """Allows names, items, arithmetic, loops and macros, but no access to Python's objects."""

    def getattr(self, obj: Any, attribute: str) -> Any:
        if isinstance(obj, dict):
            if attribute in obj or attribute not in _OF_MAPPINGS:
                return self.getitem(obj, attribute)
            return super().getattr(obj, attribute)
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


class Compiled(jinja2.BytecodeCache):
    """Compiled templates, so that each file is compiled once for many environments. Nothing else outlives a render."""

    def __init__(self) -> None:
        self.code: dict[str, Any] = {}

    def load_bytecode(self, bucket: Bucket) -> None:
        bucket.code = self.code.get(bucket.key + bucket.checksum)

    def dump_bytecode(self, bucket: Bucket) -> None:
        self.code[bucket.key + bucket.checksum] = bucket.code


def environment(files: dict[str, str], compiled: Compiled | None = None) -> Closed:
    """Where templates of ``files``, and no others, can be rendered."""
    closed = Closed(
        undefined=jinja2.StrictUndefined,
        autoescape=False,
        finalize=_printable,
        bytecode_cache=compiled,
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
        raise TypeError(f"| full prints numbers, not {str(value)!r:.40}")
    return repr(float(value))


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


def variables_of(main: str, files: dict[str, str]) -> dict[str, Any]:
    """The variables that are ``used``, and those that ``main`` only ``printed`` as they are. Raises :class:`Wrong`."""
    used = used_names(files)
    trees = {name: environment({}).parse(text) for name, text in files.items()}
    every = Counter(node.name for tree in trees.values() for node in tree.find_all(Name))
    outputs = [node for part in trees[main].body if isinstance(part, Output) for node in part.nodes]
    printed = Counter(node.name for node in outputs if isinstance(node, Name))
    return {"used": sorted(used), "printed": sorted(name for name in used if 0 < printed[name] == every[name])}


def rendered(
    files: dict[str, str], main: str, variables: dict[str, Any], compiled: Compiled | None = None
) -> tuple[str, Element]:
    """The rendered template, as text and as the root of its XML. Raises :class:`Wrong`."""
    try:
        text = environment(files, compiled).get_template(main).render(variables)
    except jinja2.TemplateSyntaxError as error:
        raise Wrong(f"{main}: line {error.lineno}", error.message or "syntax error", "a Jinja2 template") from None
    except MemoryError:
        raise  # of the process, whatever it was about
    except Exception as error:  # noqa: BLE001 - a template can raise anything that an expression can
        raise Wrong(
            _line_of(error, files, main), f"cannot be rendered ({error})", "numbers and known variables"
        ) from None
    _refuse_large(main, text)
    try:
        return text, defusedxml.ElementTree.fromstring(text.encode(), forbid_dtd=True)
    except (defusedxml.ElementTree.ParseError, DefusedXmlException, ValueError) as error:
        line = getattr(error, "position", (0,))[0]
        around = "".join(text.splitlines()[line - 1 : line]).strip()[:60] if line else ""
        problem = f"renders to no XML ({error}{f': {around}' if around else ''})"
        raise Wrong(main, problem, "well-formed XML without a document type") from None


def _refuse_large(main: str, text: str) -> None:
    if len(text) > INPUT_BYTES:
        raise Wrong(main, f"renders to {len(text) / 2**20:,.0f} MB", f"at most {INPUT_BYTES / 2**20:.0f} MB")


def _line_of(error: Exception, files: dict[str, str], main: str) -> str:
    lines = [frame for frame in traceback.extract_tb(error.__traceback__) if frame.filename in files]
    return f"{lines[-1].filename}: line {lines[-1].lineno}" if lines else main


def check(main: str, root: Element) -> None:
    """Refuse any text that is no FEBio input, or that could name a file outside the attempt's folder."""
    if root.tag != "febio_spec":
        raise Wrong(main, f"renders to <{root.tag}>", "<febio_spec>")
    for element in root.iter():
        tag = element.tag.rpartition("}")[2]  # FEBio knows no namespaces
        if tag in ("Include", "Plugins", "Import", "RVE"):
            raise Wrong(main, f"<{tag}>", "everything in the template and in what it includes by Jinja2")
        for name, value in (*element.attrib.items(), (None, element.text or ""), (None, element.tail or "")):
            label = element.tag if name is None else f"{element.tag} {name}"
            if (found := (_MARKUP if name is None else _IN_ATTRIBUTES).search(value)) is not None:
                raise Wrong(main, f"<{label[:40]}> holds {found[0]!r}", "nothing that FEBio reads as markup, or skips")
            length = max(map(len, value.split(",")[:-1]), default=0) if name is None else len(value)
            if length > (most := ROOM_OF_DELIMITER if name == "delim" else ROOM):
                raise Wrong(
                    main, f"<{label[:40]}> has {length:,} characters", f"at most {most}, for which FEBio has room"
                )
            if name == "from" or (name == "file" and (PurePath(value).name != value or value in ("", ".", ".."))):
                raise Wrong(main, f'<{label}="{value[:40]}">', "a file name without a folder")
            if _PATH.match(value) or "../" in value or "..\\" in value:
                raise Wrong(main, f"<{label}> names a path ({value.strip()[:40]})", "nothing outside of the template")


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
            raise Wrong(f"simulator.outputs.{output['name']}", problem, "one, or reduce: sum, mean, max or min")
        attributes = {"data": output["item"], "name": output["name"], "file": f"sinew-{number}.txt", "delim": ","}
        SubElement(log, output["data"], attributes).text = ",".join(map(str, chosen))


def _ids(main: str, root: Element, output: dict[str, Any]) -> list[int]:
    """The nodes, elements or rigid bodies of an output. Raises :class:`Wrong` for those that do not exist."""
    kind, asked, of = output["data"], output["set"], f"simulator.outputs.{output['name']}"
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
        raise Wrong(of, f"no set {asked!r} of {what}s in {main}", f"one of {known}"[:300])
    chosen = output["ids"] if asked is None else sets[asked]
    for number in chosen:
        if number not in there:
            expected = f"{what}s from {min(there)} to {max(there)}" if there else f"a model with {what}s"
            raise Wrong(of, f"{what} {number} is not in {main}", expected)
    if not chosen:
        raise Wrong(of, f"set {asked!r} is empty", f"at least one {what}")
    return chosen


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
    for part in re.split(r"[\s,]+", element.text or ""):
        if part and not part.isdecimal():
            raise Wrong(main, f"<{element.tag} name={element.get('name')!r}> has {part[:20]!r}", "numbers and commas")
        found += [int(part)] if part else []
    return found


def included(name: str, text: str) -> dict[str, Any]:
    """``names`` of the templates that a text includes, None for one that is computed. Raises :class:`Wrong`."""
    try:
        found = jinja2.meta.find_referenced_templates(SandboxedEnvironment().parse(text))
        return {"names": list(dict.fromkeys(found))}
    except jinja2.TemplateSyntaxError as error:
        raise Wrong(f"{name}: line {error.lineno}", error.message or "syntax error", "a Jinja2 template") from None
    except RecursionError:
        raise Wrong(name, "nested too deeply", "a simpler template") from None


def job_script(name: str, text: str, variables: dict[str, Any]) -> dict[str, Any]:
    """The ``text`` of a job script, rendered. Raises :class:`Wrong`."""
    environment = SandboxedEnvironment(
        loader=jinja2.DictLoader({}), undefined=jinja2.StrictUndefined, autoescape=False, trim_blocks=True,
        keep_trailing_newline=True)  # fmt: skip
    expected = "a Jinja2 template of a job script"
    try:
        script = environment.from_string(text).render(variables)
    except MemoryError:
        raise  # of the process, whatever it was about
    except jinja2.TemplateError as error:
        where = f"{name}: line {error.lineno}" if isinstance(error, jinja2.TemplateSyntaxError) else name
        words = f"includes {error.name!r:.60}" if isinstance(error, jinja2.TemplateNotFound) else str(error)
        raise Wrong(where, words, f"{expected} with {', '.join(variables)}") from None
    except Exception as error:  # noqa: BLE001 - a template can raise anything that an expression can
        raise Wrong(name, f"{type(error).__name__}: {error}", expected) from None
    _refuse_large(name, script)
    return {"text": script}


def answer(job: dict[str, Any], files: dict[str, str], compiled: Compiled | None = None) -> dict[str, Any]:
    """Render the template ``main`` of ``files`` with each of the job's ``renders`` (variables by name).

    Returns, for each, whether it is the ``same`` input as the first and, if the job asks for ``texts``, the input.
    With ``known`` names, it also returns which of them the template has ``used``, and refuses all others. ``outputs``
    None adds none. Inputs are written anew from what was checked: FEBio ends comments and instructions elsewhere than
    XML does. Raises :class:`Wrong`.
    """
    main = job["main"]
    found: dict[str, Any] = {"texts": [], "same": []}
    if job.get("known") is not None:
        found["used"] = sorted(used_names(files))
        if unknown := [name for name in found["used"] if name not in job["known"]]:
            raise Wrong(main, f"unknown variable {unknown[0]}", f"some of {', '.join(job['known'])}")
    first: tuple[str, Element] | None = None
    for variables in job["renders"]:
        text, root = rendered(files, main, variables, compiled)
        check(main, root)
        if job["outputs"] is not None:
            add_outputs(main, root, job["outputs"])
        first = first or (text, root)
        found["same"].append(text == first[0] or _are_same(root, first[1]))
        if job.get("texts"):
            written = '<?xml version="1.0" encoding="UTF-8"?>\n' + tostring(root, encoding="unicode") + "\n"
            found["texts"].append(written)
    return found


def _are_same(one: Element, other: Element) -> bool:
    """Whether two inputs differ in nothing that a solver reads: in more than comments."""
    both = ([(each.tag, each.attrib, each.text, each.tail, len(each)) for each in root.iter()] for root in (one, other))
    return next(both) == next(both)


def _limit_processor(seconds: float) -> None:
    """Let the kernel end this process once it has used so many further seconds of a processor."""
    used = resource.getrusage(resource.RUSAGE_SELF)
    most = math.ceil(used.ru_utime + used.ru_stime + seconds)
    hard = resource.getrlimit(resource.RLIMIT_CPU)[1]
    resource.setrlimit(resource.RLIMIT_CPU, (most if hard == resource.RLIM_INFINITY else min(most, hard), hard))


def _most_memory() -> int:
    """The largest memory (bytes) of this process; Linux has that of the one that started it in ``ru_maxrss``."""
    status = Path("/proc/self/status")
    if status.exists():
        return int(re.findall(r"VmHWM:\s+(\d+) kB", status.read_text())[0]) * 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def _reply(job: dict[str, Any], files: dict[str, str], compiled: Compiled) -> bytes:
    """The answer to a job, as a line of JSON; for a template that is ``wrong``, the three parts of a message."""
    name = job["main"]
    try:
        match job["kind"]:
            case "render":
                reply = answer(job, files, compiled)
            case "variables":
                reply = variables_of(name, files)
            case "included":
                reply = included(name, job["text"])
            case _:
                reply = job_script(name, job["text"], job["variables"])
        return json.dumps(reply).encode()
    except Wrong as wrong:
        parts = wrong.args
    except MemoryError:
        parts = (name, f"takes more than {MEMORY_BYTES / 2**30:g} GB", "a smaller template")
    except RecursionError:
        parts = (name, "cannot be rendered (RecursionError)", "a simpler template")
    except Exception as error:  # noqa: BLE001 - Jinja2 and Python raise many kinds for what they cannot read
        parts = (name, f"cannot be read ({type(error).__name__}: {error})", "a Jinja2 template")
    return json.dumps({"wrong": [part if len(part) <= WORDS else f"{part[: WORDS - 3]}..." for part in parts]}).encode()


def main() -> None:
    """Answer jobs until the input ends. A job to render without ``files`` uses those of the job before.

    Each answer is two lines: the processor time (s) and whether the process ends, for it took much memory; the answer.
    """
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
    much = max(MEMORY_BYTES // 2, _most_memory())
    files: dict[str, str] = {}
    compiled = Compiled()
    for line in sys.stdin.buffer:
        job = json.loads(line)
        del line
        if "files" in job:
            files, compiled = job["files"], Compiled()
        before = time.process_time()
        _limit_processor(job["seconds"])
        reply = _reply(job, files, compiled)
        facts = {"took": time.process_time() - before, "last": _most_memory() > much}
        sys.stdout.buffer.write(json.dumps(facts).encode() + b"\n" + reply + b"\n")
        sys.stdout.buffer.flush()


if __name__ == "__main__":
    sys.setrecursionlimit(2000)
    main()
