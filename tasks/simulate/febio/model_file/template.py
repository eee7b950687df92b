"""The template of a FEBio model: its own text, with variables where something is to vary.

With the protocol ``as_saved`` it renders to the model as its author saved it. With any other protocol, what is moved
follows the measured displacement, and the solver stops where a value is needed.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from xml.etree.ElementTree import Element as Rendered

import defusedxml.ElementTree

from sinew.runner.errors import BadInput, shown
from sinew.tasks.simulate.febio.model_file.choices import Measured, Varied
from sinew.tasks.simulate.febio.model_file.contents import Moved, nodes_of_surface
from sinew.tasks.simulate.febio.model_file.loading import controls, next_controller
from sinew.tasks.simulate.febio.model_file.source import Element, Source
from sinew.tasks.simulate.febio.renderer import WrongTemplate, render
from sinew.tasks.simulate.row_by_row import Failed

AS_SAVED = "as_saved"
MESH_FILE = "mesh.xml"
_SAVED, _FOLLOWING, _END = '{% if protocol == "as_saved" %}', '{% if protocol != "as_saved" %}', "{% endif %}"


@dataclass(frozen=True)
class Edit:
    """Text of a template in place of the bytes from ``start`` to ``end`` of a model."""

    start: int
    end: int
    text: str


def template_of(
    source: Source, varied: Sequence[Varied], moved: Moved | None, factor: float, measured: Sequence[Measured]
) -> dict[str, str]:
    """The texts of a template's files by name; the first is the template itself.

    ``factor``: how far ``moved`` goes (in the model's unit) for a displacement of 1 mm. Raises :class:`BadInput`.
    """
    edits = [Edit(one.number.start, one.number.end, f"{{{{ {one.name} }}}}") for one in varied]
    if moved is not None:
        inside = [one for one in varied if moved.value.start <= one.number.start < moved.value.end]
        if inside:
            problem = f"{shown(inside[0].number.path)} is the displacement of {shown(moved.name)}, which is moved"
            raise BadInput(source.path, problem, "one of --vary and --move")
        edits += _followed(source, moved, factor)
    sets = _node_sets(source, measured)
    mesh = source.mesh
    name = f"{source.path.stem}.feb.j2"
    declaration = '<?xml version="1.0" encoding="UTF-8"?>\n'
    if mesh is None or mesh.inside is None:
        return {name: declaration + _edited(source, edits, 0, len(source.text)) + "\n"}
    begin, end = mesh.inside
    text = _edited(source, [*edits, Edit(begin, end, f'{{% include "{MESH_FILE}" %}}')], 0, len(source.text))
    return {name: f"{declaration}{text}\n", MESH_FILE: _edited(source, [], begin, end) + sets}


def _edited(source: Source, edits: Sequence[Edit], begin: int, end: int) -> str:
    """A part of a model's text with edits, in which nothing else is a word of the template language."""
    found, at = [], begin
    for edit in sorted(edits, key=lambda one: (one.start, one.end)):
        found += [_literally(source.text[at : edit.start]), edit.text]
        at = edit.end
    return "".join([*found, _literally(source.text[at:end])])


def _literally(text: bytes) -> str:
    return text.decode().replace("{", "{{ '{' }}")


# ---- a displacement that follows the measured one


def _followed(source: Source, moved: Moved, factor: float) -> list[Edit]:
    """Edits by which ``moved`` follows the study's displacement. Raises :class:`BadInput`."""
    found = controls(source)
    control = source.section("Control")
    if control is None or len(found) != 1 or control.inside is None:
        problem = f"{shown(moved.name)} cannot follow a measured displacement: the model has {len(found)} steps"
        raise BadInput(source.path, problem, "a model of one step, or no --move")
    data = source.section("LoadData")
    if data is None or data.inside is None:
        raise BadInput(source.path, f"{shown(moved.name)} follows no load curve", "one in its LoadData section")
    number = next_controller(source)
    tag, value = moved.value.tag, moved.value
    edits = [
        Edit(value.start, value.start, _SAVED),
        Edit(value.end, value.end, f'{{% else %}}<{tag} lc="{number}">{factor!r}</{tag}>{_END}'),
        Edit(data.inside[1], data.inside[1], _FOLLOWING + _curves(number) + _END),
    ]
    return edits + _steps(control, number + 1)


def _curves(number: int) -> str:
    curve = '<load_controller id="{}" type="loadcurve"><interpolate>{}</interpolate><extend>CONSTANT</extend><points>\n'
    end = "</points></load_controller>\n"
    return (
        f"{curve.format(number, 'LINEAR')}{{{{ displacement_points }}}}{end}"
        f"{curve.format(number + 1, 'STEP')}{{{{ step_points }}}}{end}"
    )


def _steps(control: Element, must_points: int) -> list[Edit]:
    """Edits by which a run lasts as long as the protocol and stops where the study needs a value."""
    assert control.inside is not None
    times = "<time_steps>-1</time_steps><final_time>{{ end_s }}</final_time><step_size>{{ first_step_s }}</step_size>"
    longest = f'<dtmax lc="{must_points}">1</dtmax>'
    edits = []
    for element in control.all("time_steps", "step_size", "final_time"):
        edits += [Edit(element.start, element.start, _SAVED), Edit(element.end, element.end, _END)]
    stepper = control.find("time_stepper")
    step = stepper.find("dtmax") if stepper is not None else None
    if stepper is None or stepper.inside is None:
        if stepper is not None:
            edits += [Edit(stepper.start, stepper.start, _SAVED), Edit(stepper.end, stepper.end, _END)]
        times += f'<time_stepper type="default"><dtmin>0</dtmin>{longest}<dtforce>1</dtforce></time_stepper>'
    elif step is None:
        edits.append(Edit(stepper.inside[0], stepper.inside[0], _FOLLOWING + longest + _END))
    else:
        edits += [Edit(step.start, step.start, _SAVED), Edit(step.end, step.end, f"{{% else %}}{longest}{_END}")]
    return [*edits, Edit(control.inside[0], control.inside[0], _FOLLOWING + times + _END)]


# ---- sets for outputs of surfaces


def name_of_nodes(surface: str) -> str:
    """The name of the set that holds a surface's nodes."""
    return f"nodes of {surface}"


def _node_sets(source: Source, measured: Sequence[Measured]) -> str:
    sets = []
    for name in dict.fromkeys(one.set for one in measured if one.surface):
        nodes = nodes_of_surface(source, name)
        ids = "".join(f'<n id="{n}"/>' for n in nodes) if source.version == "3.0" else ",".join(map(str, nodes))
        title = name_of_nodes(name).replace("&", "&amp;").replace('"', "&quot;").replace("<", "&lt;")
        sets.append(f'<NodeSet name="{title}">{ids}</NodeSet>\n')
    return "".join(sets)


# ---- the same model


def check_same(source: Source, files: Mapping[str, str], variables: Mapping[str, object]) -> None:
    """Render a template with the model's own numbers: it must be the model again. Raises :class:`BadInput`."""
    main = next(iter(files))
    try:
        (text,) = render(dict(files), main, [dict(variables)], None)["texts"]
    except WrongTemplate as wrong:
        where, problem, expected = wrong.parts
        raise BadInput(f"{source.path}: {where}", problem, expected) from None
    except Failed as failed:
        raise BadInput(source.path, failed.words, "a model of which a template can be made") from None
    saved = defusedxml.ElementTree.fromstring(source.text, forbid_dtd=True)
    again = defusedxml.ElementTree.fromstring(text.encode(), forbid_dtd=True)
    if (difference := _difference(saved, again)) is not None:
        raise BadInput(source.path, f"its template renders to another model ({difference})", "a report of this fault")


def _difference(one: Rendered, other: Rendered, inside: str = "") -> str | None:
    """Where two inputs differ in what a solver reads; sets of nodes that were added at the end do not count."""
    path = f"{inside}/{one.tag}"
    added = list(other)[len(one) :]
    if any(each.tag != "NodeSet" for each in added) or len(other) < len(one):
        return f"{path}: {len(one)} and {len(other)} parts"
    if (one.tag, one.attrib) != (other.tag, other.attrib) or not _same_text(one.text, other.text):
        return path
    children = zip(one, other, strict=False)
    return next((found for a, b in children if (found := _difference(a, b, path)) is not None), None)


def _same_text(one: str | None, other: str | None) -> bool:
    if (one or "").split() == (other or "").split():
        return True
    try:
        return [*map(float, (one or "").split(","))] == [*map(float, (other or "").split(","))]
    except ValueError:
        return False
