"""Cohorts that the real solver pulled through a mesh: ``python -m tests.hidden.mesh --out OUT --effect softening``.

The truth is the dog-bone of the tutorial with eight times the study's elements and half its time steps, with an effect
in the library's own form, of a drawn size, and white noise. ``OUT/cases`` is a folder for ``sinew benchmark discover``,
``OUT/study.yaml`` the study that knows the coarse mesh and no effect. Needs febio4. With ``--points``, a camera follows
ten points of the gauge (``dic_1_mm`` to ``dic_10_mm``, along the pull), and the study compares them, too. The answers
tell the ``strength`` of each effect: what of its trace the model's parameters cannot imitate.
"""

import json
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click
import numpy as np
import yaml

from sinew.tasks.data.cohort import write_cohort
from sinew.tasks.discover.fit.sizes import by_name
from sinew.tasks.model import Curve, Model, Protocol, Specimen
from sinew.tasks.model.effect import Effect, model_with
from sinew.tasks.simulate import Array, Simulated, Simulator
from sinew.tasks.simulate.build import simulator_of
from sinew.tasks.study.model import model_of
from sinew.tasks.study.resources import resource
from sinew.tasks.study.study import read_study

RATE_HZ, NOISE = 5.0, 0.003  # of the peak force
POINTS, POINT_NOISE_MM, PICTURES_EVERY = 10, 0.005, 2  # that a camera follows; rows from one picture to the next
FINER = ("set fineness = 1", "set fineness = 2")
SIZE_MM, SCATTER = (20.0, 4.0, 2.0), 0.03
STEP = 0.02  # of the range of a parameter, for slopes
RANGES = {"E_matrix": (12.0, 40.0), "nu": (0.2, 0.4), "g_1": (0.3, 1.2), "tau_1": (4.0, 20.0)}  # of true values


def corners(name: str, time_s: list[float], displacement_mm: list[float]) -> Protocol:
    """A protocol through corners."""
    time = np.arange(0.0, time_s[-1] + 1e-9, 1.0 / RATE_HZ)
    return Protocol(name, time, np.interp(time, time_s, displacement_mm))


PROTOCOLS = (
    corners("relaxation", [0, 5, 35], [0, 1.5, 1.5]),
    corners("cycles", [0, 2, 3.6, 6.4, 8.8, 12.4, 15.6, 20, 24], [0, 0.6, 0.12, 0.96, 0.24, 1.32, 0.36, 1.68, 0.48]),
)


def outputs_of_points(fineness: int) -> dict[str, dict[str, Any]]:
    """Where ten points of the gauge's surface go, along the pull: five heights on the middle line and on the edge."""
    across, sheet = 3 * fineness + 1, (3 * fineness + 1) * (2 * fineness + 1)
    first = 1 + 2 * fineness * across
    nodes = [first + i + k * fineness * sheet for i in (0, across - 1) for k in range(1, 6)]
    names = [f"dic_{number}_mm" for number in range(1, POINTS + 1)]
    return {
        name: {"data": "node_data", "item": "uz", "ids": [node], "unit": "mm"}
        for name, node in zip(names, nodes, strict=True)
    }


def study_of(out: Path, changes: tuple[str, str] | None = None, *, points: bool = False, **settings: Any) -> Path:
    """Write the study of the dog-bone without measurements of its own, and its template; returns the study's path."""
    out.mkdir(parents=True, exist_ok=True)
    shutil.copytree(str(resource("configs/dogbone")), out / "dogbone", dirs_exist_ok=True)
    template = out / "dogbone" / "dogbone.feb.j2"
    if changes is not None:
        assert template.read_text().count(changes[0]) == 1
        template.write_text(template.read_text().replace(*changes))
    content = yaml.safe_load(resource("configs/dogbone.yaml").read_text("utf-8"))
    for name in ("specimen", "protocols", "sobol", "calibrate"):
        content.pop(name)
    content["simulator"] |= {"fibre": "tissue", "matrix": "tissue"} | settings
    if points:
        outputs = outputs_of_points(1 if changes is None else 2)
        content["simulator"]["outputs"] = {"force": content["simulator"]["outputs"]["force"]} | outputs
        content["measured"] = {"force": {}} | {name: {} for name in outputs}
    content |= {"cohort": "cohort", "tasks": ["discover"], "discover": {"laws": False}}
    path = out / "study.yaml"
    path.write_text(yaml.safe_dump(content, sort_keys=False))
    return path


def pulled(
    simulator: Simulator,
    model: Model,
    specimen: Specimen,
    row: Array,
    rng: np.random.Generator,
    noise: float = NOISE,
    protocols: Sequence[Protocol] = PROTOCOLS,
) -> Specimen:
    """The specimen with measured curves of the parameters ``row``; ``noise`` of the force: in parts of its peak."""
    curves = []
    for protocol in protocols:
        done = simulated(simulator, model, specimen, protocol, row)
        force = done.force_N[0]
        noisy = force + noise * np.abs(force).max() * rng.standard_normal(force.size)
        others = {}
        for name, course in of_points(done).items():
            others[name] = course + POINT_NOISE_MM * rng.standard_normal(force.size)
            others[name][np.arange(force.size) % PICTURES_EVERY > 0] = np.nan
        curves.append(Curve(protocol, noisy, others))
    return Specimen(specimen.name, specimen.length_mm, specimen.width_mm, specimen.thickness_mm, tuple(curves))


def simulated(simulator: Simulator, model: Model, specimen: Specimen, protocol: Protocol, row: Array) -> Simulated:
    """One run. Raises ``ClickException`` if it fails."""
    done = simulator.simulate(model, specimen, protocol, row[np.newaxis])
    if done.status[0]:
        raise click.ClickException(f"{specimen.name}, {protocol.name}: {done.messages[0]}")
    return done


def of_points(done: Simulated) -> dict[str, Array]:
    """The courses ``[t]`` (mm) of the points that a camera follows, by name."""
    return {name: course[0] for name, course in done.outputs.items() if name.startswith("dic_")}


def strength(
    simulator: Simulator,
    model: Model,
    specimen: Specimen,
    plain: Array,
    row: Array,
    noise: float = NOISE,
    protocols: Sequence[Protocol] = PROTOCOLS,
) -> float:
    """Root mean square, in units of the noise, of what effects change and the model's other parameters cannot imitate.

    ``model`` has the effects, ``row`` their values and ``plain`` their null values. To first order at ``row``.
    """

    def courses(at: Array) -> list[tuple[Array, float]]:
        """Each course with its noise."""
        found = []
        for protocol in protocols:
            done = simulated(simulator, model, specimen, protocol, at)
            found.append((done.force_N[0], noise * float(np.abs(done.force_N[0]).max())))
            found += [(course[::PICTURES_EVERY], POINT_NOISE_MM) for course in of_points(done).values()]
        return found

    here = courses(row)

    def change(at: Array) -> Array:
        """What another row changes, in units of the noise."""
        return np.concatenate([(a - b) / sd for (a, _), (b, sd) in zip(courses(at), here, strict=True)])

    slopes = []
    for place in np.flatnonzero(plain == row):  # the model's own parameters
        parameter = model.parameters[place]
        step = np.zeros(row.size)
        step[place] = STEP * (parameter.maximum - parameter.minimum)
        slopes.append(change(row + step))
    trace = change(plain)
    by = np.column_stack(slopes)
    rest = trace - by @ np.linalg.lstsq(by, trace, rcond=None)[0]
    return float(np.sqrt(np.mean(rest**2)))


def sizes_of(effect: Effect, rng: np.random.Generator, times: float = 1.0) -> dict[str, float]:
    """Values between the null and what is typical, or a third beyond; so many ``times`` of what can be null."""
    found = {}
    for parameter, null in zip(effect.parameters, effect.null_values, strict=True):
        start = null if parameter.name in effect.null else 0.0
        value = start + (times if parameter.name in effect.null else 1.0) * rng.uniform(0.7, 1.3) * (
            parameter.reference - start
        )
        found[parameter.name] = float(np.clip(value, parameter.minimum, parameter.maximum))
    return found


@click.command()
@click.option("--out", type=click.Path(path_type=Path), required=True, help="Folder to write.")
@click.option("--effect", "slugs", multiple=True, required=True, help="One case with this effect or form, or none.")
@click.option("--protocol", "names", multiple=True, type=click.Choice([one.name for one in PROTOCOLS]), help="All.")
@click.option("--specimens", type=click.IntRange(1, 4), default=1, show_default=True)
@click.option("--points", is_flag=True, help="Ten points of the gauge are followed by a camera.")
@click.option("--times", type=click.FloatRange(0.01, 10.0), default=1.0, show_default=True, help="Of the usual sizes.")
@click.option("--noise", type=click.FloatRange(1e-4, 0.1), default=NOISE, show_default=True, help="Of the peak force.")
@click.option("--seed", type=click.IntRange(0, 2**32 - 1), default=1, show_default=True)
def main(
    out: Path,
    slugs: tuple[str, ...],
    names: tuple[str, ...],
    specimens: int,
    points: bool,
    times: float,
    noise: float,
    seed: int,
) -> None:
    """Write cohorts, answers.json and the study for `sinew benchmark discover`."""
    if shutil.which("febio4") is None:
        raise click.ClickException("febio4 is not on the PATH")
    study_of(out, points=points)
    fine = read_study(study_of(out / "fine", FINER, points=points, time_steps={"ramp_s": 0.25, "hold_growth": 0.1}))
    simulator, bare = simulator_of(fine, None, out / "scratch"), model_of(fine.model, "template")
    answers, how = {}, (noise, [one for one in PROTOCOLS if one.name in (names or one.name)])
    for number, slug in enumerate(slugs, 1):
        rng, case = np.random.default_rng([seed, number]), f"case_{number:02d}"
        mm = [[float(size * (1 + SCATTER * rng.standard_normal())) for size in SIZE_MM] for _ in range(specimens)]
        bars = [Specimen(f"s{i:02d}", *size) for i, size in enumerate(mm, 1)]
        truth = [np.array([rng.uniform(*RANGES[name]) for name in bare.names]) for _ in bars]
        plain = [pulled(simulator, bare, *each, rng, *how) for each in zip(bars, truth, strict=True)]
        effects = () if slug == "none" else by_name([slug], plain)
        values = {name: value for effect in effects for name, value in sizes_of(effect, rng, times).items()}
        having, model = simulator.with_effects(effects), model_with(bare, effects)
        rows = [np.array([*row, *values.values()]) for row in truth]
        made = [pulled(having, model, *each, rng, *how) for each in zip(bars, rows, strict=True)] if effects else plain
        nulls = [value for effect in effects for value in effect.null_values]
        seen = [
            strength(having, model, bar, np.array([*own, *nulls]), row, *how)
            for bar, own, row in zip(bars, truth, rows, strict=True)
        ] if effects else []  # fmt: skip
        write_cohort(out / "cases" / case, made)
        answers[case] = {
            "case": f"mesh-{slug}",
            "truth": [effect.slug for effect in effects],
            "magnitude": values,
            "strength": {effect.slug: round(float(np.median(seen)), 2) for effect in effects},
            "specimens": {
                bar.name: dict(zip(bare.names, row.tolist(), strict=True))
                for bar, row in zip(bars, truth, strict=True)
            },
            "noise_fraction_of_peak": noise,
            "seed": seed,
        }  # fmt: skip
        print(f"{case}: {slug} {values}, strength {answers[case]['strength']}")
    (out / "cases" / "answers.json").write_text(json.dumps(answers, indent=1) + "\n", "utf-8")


if __name__ == "__main__":
    main()
