"""What a template can do.

A template is a program that somebody else wrote. The template of a solver's input can use numbers and the other files
of its folder, but no attributes, no modules and no files. The template of a job script can use all of Jinja2's sandbox.
"""

import math
import traceback
from collections import Counter
from typing import Any
from xml.etree.ElementTree import Element

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

from .wrong import Wrong

INPUT_BYTES = 2**26  # of a rendered text

FILTERS = (
    *("abs", "batch", "default", "dictsort", "first", "float", "format", "int", "items", "join", "last", "length"),
    *("list", "max", "min", "replace", "reverse", "round", "slice", "sort", "sum", "trim", "unique"),
)
FUNCTIONS = {
    name: getattr(math, name) for name in ("sqrt", "exp", "log", "sin", "cos", "tan", "atan2", "hypot", "floor", "ceil")
}
CONSTANTS = {"pi": math.pi}
_OF_MAPPINGS = {"get", "items", "keys", "values"}
_OF_LOOPS = {"index", "index0", "revindex", "revindex0", "first", "last", "length", "previtem", "nextitem", "depth"}


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
