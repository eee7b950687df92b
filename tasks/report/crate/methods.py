"""METHODS.md of a crate: words for a methods section, of what this study really did, with numbers and references."""

import re
from collections.abc import Iterator

import numpy as np

from sinew.runner.errors import one_line
from sinew.tasks.drawing.blocks import number, plain_paragraph, plural, span
from sinew.tasks.model import Model, Specimen
from sinew.tasks.registry import TASKS
from sinew.tasks.report.crate import environment
from sinew.tasks.report.crate.references import REFERENCES
from sinew.tasks.report.crate.source import Source
from sinew.tasks.study.files import as_bytes
from sinew.tasks.study.model import model_of

CITED = re.compile(r"\[@([a-z, @]+)\]")


def methods(source: Source) -> bytes:
    """The page, in Markdown: a paragraph for data, model, program and each task that has a result."""
    parts = [("Measured data", _data(source)), ("Model", _model(source)), ("Computation", _computation(source))]
    results = source.found.results
    tasks = sorted(results, key=lambda name: TASKS[name].place)
    parts += [(_title(task), plain_paragraph(TASKS[task].module("prose").methods(results[task]))) for task in tasks]
    parts.append(("Failed evaluations", _failures(source)))
    text = "\n".join(f"## {title}\n{words}\n" for title, words in parts if words)
    text, order = numbered(text)
    head = f"# Methods of {source.study.name}\nWritten from the study file and the results. Check and shorten it.\n\n"
    listed = [f"{i}. {REFERENCES[key].line()}" for i, key in enumerate(order, start=1)]
    return as_bytes(head + text + "\n".join(["", "## References", *listed]) + "\n")


def numbered(text: str) -> tuple[str, list[str]]:
    """``[@key, @other]`` as numbers in the order of their first use; and the keys in that order."""
    order: list[str] = []

    def number_of(found: re.Match[str]) -> str:
        keys = [key.strip(" @") for key in found.group(1).split(",")]
        order.extend(key for key in keys if key not in order)
        return f"[{', '.join(str(order.index(key) + 1) for key in keys)}]"

    return CITED.sub(number_of, text), order


def _title(task: str) -> str:
    return {
        "sobol": "Sobol indices", "importance": "Random forest importance", "calibrate": "Calibration",
        "infer": "Inference", "predict": "Prediction", "compare": "Comparison of sites", "discover": "Missing effects",
        "morris": "Elementary effects", "pawn": "PAWN indices", "surrogate": "Emulators",
    }.get(task, task.capitalize())  # fmt: skip


def _data(source: Source) -> str:
    specimens = source.cohort.specimens
    if source.cohort_folder is None:
        return f"Nothing was measured; displacements are those of the study file. {_protocols(specimens)}"
    sites = sorted({one.site for one in specimens if one.site})
    of = f" of {len(sites)} sites ({', '.join(sites)})" if sites else ""
    sizes = ", ".join(
        f"{name} {span([getattr(one, f'{name}_mm') for one in specimens])} mm"
        for name in ("length", "width", "thickness")
    )
    return f"{plural(len(specimens), 'specimen')}{of} were tested ({sizes}). {_protocols(specimens)}"


def _protocols(specimens: tuple[Specimen, ...]) -> str:
    sentences = []
    for name in dict.fromkeys(curve.name for one in specimens for curve in one.curves):
        having = [(one, curve) for one in specimens for curve in one.curves if curve.name == name]
        points = span([curve.protocol.time_s.size for _, curve in having])
        lasts = span([curve.protocol.time_s[-1] - curve.protocol.time_s[0] for _, curve in having])
        moved = [np.abs(curve.protocol.displacement_mm).max() for _, curve in having]
        strain = [100 * peak / one.length_mm for peak, (one, _) in zip(moved, having, strict=True)]
        far = f"{span(strain)} % of the gauge length" if np.isfinite(strain).all() else f"{span(moved)} mm"
        force = ""
        if all(np.isfinite(curve.force_N).all() for _, curve in having):
            force = f", peak force {span([np.abs(curve.force_N).max() for _, curve in having])} N"
        sentences.append(
            f"Protocol `{name}`: {plural(len(having), 'curve')} of {points} points over {lasts} s, largest "
            f"displacement "
            f"{far}{force}."
        )
    return " ".join(sentences)


def _model(source: Source) -> str:
    study = source.study
    model = model_of(study.model, study.simulator.law)
    if study.simulator.law == "template":
        what = "The model is a FEBio model [@febio] of the laboratory's own, given as a template in this crate."
    else:
        what = (
            "The tissue was modelled as a bar: a solid mixture of an isotropic elastic matrix and fibres with an "
            "exponential-power law that carry tension only "
            f"(beta = {model.beta:g}, lambda_0 = {model.lambda_0:g}), both viscoelastic with Prony series of "
            f"three terms "
            "[@pekedis, @puso]."
        )
        if study.model.effects:
            what += f" Added effects: {', '.join(study.model.effects)}."
    name, version = environment.solver(source)
    if source.run["simulator"] == "uniaxial":
        how = f"Forces were computed from {_equations(source)} (simulator `uniaxial`)."
    else:
        how = one_line(f"Forces were computed with {name} {version} (simulator `{source.run['simulator']}`) [@febio].")
    return f"{what} {how} {_ranges(model)}"


def _equations(source: Source) -> str:
    if source.study.model.effects:
        return "the equations of the homogeneous bar with these effects"
    return "the closed form of the homogeneous bar"


def _ranges(model: Model) -> str:
    free = "; ".join(
        f"{one.name} {number(one.minimum)} to {number(one.maximum)}{in_markdown(one.unit)}"
        for one in model.parameters
        if not one.fixed
    )
    fixed = "; ".join(
        f"{one.name} = {number(one.reference)}{in_markdown(one.unit)}" for one in model.parameters if one.fixed
    )
    return f"Ranges of the parameters: {free}.{f' Fixed: {fixed}.' if fixed else ''}"


def _computation(source: Source) -> str:
    packages = environment.direct(source.run)
    named = ", ".join(f"{name} {packages[name]}" for name in ("numpy", "scipy", "numba") if name in packages)
    version, python = (environment.version_of(source.run, name, "of unknown version") for name in ("version", "python"))
    return one_line(
        f"All computations were made with sinew {version} under Python {python}{f' ({named})' if named else ''}, with "
        f"the seed {source.run['seed']}. The same seed, study and data give the same numbers. All versions are in "
        "`environment/`."
    )


def _failures(source: Source) -> str:
    status = source.found.status
    if status is None:
        return ""
    done = sum(table["done"] for table in status["tables"])
    failed = sum(sum(table["failed"].values()) for table in status["tables"])
    if not failed:
        return f"The model was evaluated {done:,} times, without a failure."
    return f"Of {done:,} evaluations of the model, {failed:,} failed. No result uses these."


def in_markdown(unit: str) -> str:
    """A unit as Markdown shows it, whatever it holds."""
    return "" if unit in ("", "1") else " " + re.sub(r"([\\`*_{}\[\]<>&#|!$])", r"\\\1", unit)


def cited(text: str) -> Iterator[str]:
    """The keys that a text cites."""
    for found in CITED.finditer(text):
        yield from (key.strip(" @") for key in found.group(1).split(","))
