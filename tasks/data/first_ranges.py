"""The ranges that a new study starts with: the published ones of human tendon, or ones scaled to the measured curves.

Tissue that is much softer, stiffer or more extensible than tendon, or stiffens up to larger strains, gets ranges of its
own. For many values of the toe and of the relaxation, both moduli are fitted to the curves, as the force depends on
them linearly; the moduli of the best fits, and a factor of three on both sides, are the ranges. Where the toe ends is
decided by best fits that are searched for. Relaxation times are scaled where the tests last for seconds or hours.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import nnls

from sinew.tasks.drawing.blocks import listed
from sinew.tasks.model import Curve, Model, Parameter, Protocol, Specimen
from sinew.tasks.model.parameters import LARGEST_LAMBDA_0
from sinew.tasks.model.phases import is_compression
from sinew.tasks.simulate import Array
from sinew.tasks.simulate.reach import reach, spread, thinned, unseen
from sinew.tasks.simulate.uniaxial import Uniaxial
from sinew.tasks.study.range_check import out_of_reach, rounded, words

EXTENSIBLE = 0.1  # strain from which on a toe that ends at 1 % is no toe
TOE_ENDS = (0.25, 0.5, 0.75, 1.0)  # parts of the largest strain at which the toe may end
#: Less extensible tissue has such a toe where it leaves less than these parts of the misfit of the first loadings: of
#: that with the published toe, and with slack fibres, which are taut from some parts of the largest strain on.
LATER, THAN_SLACK, TAUT_AT = 0.5, 0.8, (0.125, 0.25, 0.375, 0.5, 0.75)
LOADED = 0.98  # of the largest displacement: the end of the first loading
FEWEST_OF_A_LOADING = 6  # points; a loading of fewer has no shape
TOE_OF = 4  # specimens, at most, that tell where the toe ends
SEARCHES, CLOSER = 6, 0.6  # of a best fit: each looks in a box around the best so far, so much smaller than before
STRONGEST = 5.0  # relaxation strength of tissue of which nothing is known
ROWS = 64  # values of toe and relaxation that are tried
BEST = 6  # of them, whose moduli count
WIDER = 3.0  # on both sides of their moduli
LOOKED_AT = 12  # specimens, at most
LASTING = (20.0, 2000.0)  # s; shorter tests cannot show the published relaxation times, longer ones have others
SPAN = 2000.0  # between the largest and the smallest relaxation time, as published
UNLIKE = 30.0  # times; specimens of one tissue differ by less
SAMPLES = 2.0  # that the smallest relaxation time lasts at least
ONCE_FILLED_IN = "once all sizes are filled in, `sinew init` on the cohort scales them to the tests"


@dataclass(frozen=True)
class FirstRanges:
    """The ``model`` of a new study, and what a person should know about its ranges, line by line.

    ``scaled``: its ranges are not the published ones; ``only_times``: but for the relaxation times they are.
    ``unseen``: parameters on which no force of the tests depends.
    """

    model: Model
    lines: tuple[str, ...]
    scaled: bool = False
    unseen: tuple[str, ...] = ()
    only_times: bool = False

    @property
    def published(self) -> bool:
        """Whether all ranges but those of the relaxation times are the published ones."""
        return self.only_times or not self.scaled


def first_ranges(specimens: Sequence[Specimen], others: Sequence[Specimen] = ()) -> FirstRanges:
    """Ranges for the measured curves of specimens whose sizes are known; of ``others``, only the times count."""
    found = _first_ranges(specimens, others)
    found = replace(found, lines=(*found.lines, *_unlike(specimens)))
    if not specimens or not others:
        return found
    names = listed([one.name for one in others])
    line = f"ranges: not compared with {names}; {ONCE_FILLED_IN}"
    return replace(found, lines=(*found.lines, line))


def _unlike(specimens: Sequence[Specimen]) -> list[str]:
    """A line for specimens that can hardly be of one tissue: peak stress and stiffness differ by ``UNLIKE`` or more."""
    peaks = {}
    for one in specimens:
        if one.measured:
            stress = max(float(np.abs(curve.force_N).max()) for curve in one.curves) / one.area_mm2
            strain = max(float(np.abs(one.stretch(curve.protocol) - 1.0).max()) for curve in one.curves)
            if stress > 0.0 and strain > 0.0:
                peaks[one.name] = (stress, stress / strain)
    if not peaks:
        return []
    soft, stiff = (choose(peaks, key=lambda name: peaks[name][0]) for choose in (min, max))
    times = [peaks[stiff][at] / peaks[soft][at] for at in (0, 1)]
    if min(times) < UNLIKE:
        return []
    line = (
        f"ranges: the peak stress of {stiff} is {times[0]:.3g} times that of {soft}, too much for specimens of"
        " one tissue; a study has one set of ranges, so make a study of its own for each tissue"
    )
    return [line]


def _first_ranges(specimens: Sequence[Specimen], others: Sequence[Specimen]) -> FirstRanges:
    simulator = Uniaxial()
    chosen = [one for one in specimens if one.measured and any(curve.force_N.any() for curve in one.curves)]
    chosen = chosen[:: -(-len(chosen) // LOOKED_AT)] if chosen else []
    model, timed = _with_times(Model(), [*chosen, *others])
    reaches = [each for one in chosen for each in reach(simulator, model, one)]
    if not reaches:
        line = f"ranges: those of human tendon; {ONCE_FILLED_IN}"
        return FirstRanges(model, (line, *timed), scaled=bool(timed), only_times=True)
    if all(each.other_sign for each in reaches):
        line = "ranges: those of human tendon, which give forces of the other sign; tension is positive"
        return FirstRanges(
            model, (f"{line}, so check the sign convention of the machine", *timed), scaled=bool(timed), only_times=True
        )
    squeezed = all(is_compression(curve.protocol) for one in chosen for curve in one.curves)
    strains = [one.stretch(curve.protocol) - 1.0 for one in chosen for curve in one.curves]
    strain = max(float(each.max()) for each in strains)
    peaks = {one.specimen: one for one in sorted(reaches, key=lambda one: abs(one.measured_N))}.values()
    far = out_of_reach(reaches) or [one for one in peaks if not one.ratios[0] <= 1.0 <= one.ratios[1]]
    scaled, taut = _with_best_toe(simulator, model, chosen, strain, squeezed=squeezed)
    stiffens = strain <= EXTENSIBLE and scaled.lambda_0 != model.lambda_0
    beside = list(timed)
    if taut is not None:
        beside.append(
            f"ranges: the curves stiffen beyond the toe, as if fibres became taut at {100 * (taut - 1.0):.2g} % of "
            "strain, which `sinew discover` can tell; if the toe of this tissue is that long, set model.lambda_0"
        )
    if not squeezed and strain <= EXTENSIBLE and not far and not stiffens:
        line = "ranges: those of human tendon (Pekedis 2025), which reach the measured forces"
        found = _without_unseen(simulator, model, chosen, [line, *beside], scaled=bool(timed))
        return replace(found, only_times=True)
    because = [f"strain {100 * min(e.min() for e in strains):.3g} to {100 * strain:.3g} %"]
    because += [f"the curves stiffen beyond {100 * (model.lambda_0 - 1.0):.3g} %"] if stiffens else []
    because += [words(max(far, key=lambda one: one.distance))] if far else []
    lines = [f"ranges: scaled to these tests, as those of human tendon do not fit ({'; '.join(because)})"]
    lines += beside
    model, more = _scaled(simulator, model, scaled, chosen, squeezed=squeezed)
    again = [each for one in chosen for each in reach(simulator, model, one)]
    if left := out_of_reach(again):
        more.append(f"ranges: widen them in study.yaml: they do not reach {left[0].specimen} {left[0].protocol}")
    return _without_unseen(simulator, model, chosen, [*lines, *more], scaled=True)


def _without_unseen(
    simulator: Uniaxial, model: Model, specimens: Sequence[Specimen], lines: list[str], *, scaled: bool
) -> FirstRanges:
    """The same with parameters fixed on which no measured force depends."""
    names = unseen(simulator, model, specimens)
    if names and len(names) < len(model.free):
        for parameter in model.free:
            if parameter.name in names:
                model = model.with_parameter(_fixed(parameter, parameter.reference))
        lines.append(f"ranges: no force of these tests depends on {', '.join(names)}; fixed")
        return FirstRanges(model, tuple(lines), scaled, names)
    return FirstRanges(model, tuple(lines), scaled)


def _with_times(model: Model, specimens: Sequence[Specimen]) -> tuple[Model, list[str]]:
    """The model with relaxation times for tests that last for seconds or hours; three bands from samples to tests."""
    lasting = max(
        (float(np.ptp(curve.protocol.time_s)) for one in specimens for curve in one.curves), default=LASTING[0]
    )
    if LASTING[0] <= lasting <= LASTING[1]:
        return model, []
    steps = [float(np.median(np.diff(curve.protocol.time_s))) for one in specimens for curve in one.curves]
    first = min(max(lasting / SPAN, SAMPLES * min(steps)), lasting / 10.0)
    ends = [float(f"{each:.2g}") for each in np.geomspace(first, lasting, 4)]
    for parameter in model.parameters:
        if parameter.name.startswith("tau_"):
            band = int(parameter.name[4]) - 1
            low, high = ends[band], ends[band + 1]
            model = model.with_parameter(replace(parameter, minimum=low, maximum=high, reference=(low + high) / 2))
    words = f"the longest test lasts {lasting:.3g} s, so relaxation times go from {ends[0]:g} to {ends[-1]:g} s"
    return model, [f"ranges: {words} in three bands"]


def _with_best_toe(
    simulator: Uniaxial, timed: Model, specimens: Sequence[Specimen], strain: float, *, squeezed: bool
) -> tuple[Model, float | None]:
    """Tissue of which nothing is known but its toe: extensible tissue may have any, other only a far likelier one.

    Also the stretch from which on slack fibres would be taut, where those describe the first loadings far better than
    the published toe, and nearly as well as any longer one.
    """
    published = _unknown(timed, squeezed=squeezed)
    ends = [1.0 + part * strain for part in TOE_ENDS]
    longer = [_with_toe(published, end) for end in ends if published.lambda_0 < end < LARGEST_LAMBDA_0]
    if squeezed or not longer:
        return published, None
    some = specimens[:: -(-len(specimens) // TOE_OF)]

    def misfit(model: Model, taut: float = 1.0, of: Sequence[Specimen] = some) -> float:
        return float(np.median([_least_misfit(simulator, model, one, taut) for one in of]))

    if strain > EXTENSIBLE:
        return min((published, *longer), key=misfit), None
    loadings = [replace(one, curves=tuple(map(_first_loading, one.curves))) for one in some]
    least = min(misfit(model, of=loadings) for model in longer)
    taut = {1.0 + part * strain: misfit(published, 1.0 + part * strain, loadings) for part in TAUT_AT}
    slack = min(taut, key=lambda each: taut[each])  # an effect that ``discover`` can find
    enough = LATER * misfit(published, of=loadings)
    if least < min(enough, THAN_SLACK * taut[slack]):
        return min(longer, key=misfit), None
    return published, slack if taut[slack] < enough else None


def _first_loading(curve: Curve) -> Curve:
    """The curve up to where it is first stretched nearly as far as ever: relaxation has little part in it."""
    protocol = curve.protocol
    moved = protocol.displacement_mm
    points = int(np.argmax(moved >= LOADED * moved.max())) + 1
    if points < FEWEST_OF_A_LOADING or not curve.force_N[:points].any():
        return curve
    loading = Protocol(protocol.name, protocol.time_s[:points], moved[:points])
    return Curve(loading, curve.force_N[:points])


def _least_misfit(simulator: Uniaxial, model: Model, specimen: Specimen, taut: float) -> float:
    """The relative misfit of the best fit that is found: among points in the ranges, then ever closer to the best."""
    low, high = (np.array([getattr(one, end) for one in model.parameters]) for end in ("minimum", "maximum"))
    shares = (spread(model, ROWS)[-ROWS:] - low) / np.where(high > low, high - low, 1.0)
    tried, best, misfit = shares, shares[0], np.inf
    for search in range(SEARCHES):
        _, misfits = _fits(simulator, model, specimen, low + tried * (high - low), taut)
        least = int(np.argmin(misfits))
        if misfits[least] < misfit:
            best, misfit = tried[least], float(misfits[least])
        tried = np.clip(best + CLOSER ** (search + 1) * (shares - 0.5), 0.0, 1.0)
    return misfit


def _scaled(
    simulator: Uniaxial, timed: Model, model: Model, specimens: Sequence[Specimen], *, squeezed: bool
) -> tuple[Model, list[str]]:
    """The model with moduli for these specimens, and what was done besides, line by line."""
    lines = []
    if squeezed:
        lines.append("ranges: every test is a compression, in which fibres carry nothing: E_f is fixed at 0")
    elif model.lambda_0 != timed.lambda_0:
        lines.append(f"ranges: the toe ends at a stretch of {model.lambda_0:g} (lambda_0), where the model fits best")
    moduli = np.vstack([_moduli(simulator, model, one) for one in specimens])
    if not moduli.any():
        return timed, ["ranges: no moduli fit these forces; those of human tendon are left"]
    for name, column in zip(("E_f", "E_m"), moduli.T, strict=True):
        if name == "E_f" and squeezed:
            continue
        model = model.with_parameter(_range(model, name, column, float(moduli.max())))
    return model, lines


def _unknown(model: Model, *, squeezed: bool) -> Model:
    """Tissue of which nothing is known but the times within which it relaxes."""
    for parameter in model.parameters:
        if parameter.name.startswith("g_"):
            model = model.with_parameter(replace(parameter, minimum=0.0, maximum=STRONGEST, reference=1.0))
        if parameter.name == "E_f" and squeezed:
            model = model.with_parameter(_fixed(parameter, 0.0))
    return model


def _with_toe(model: Model, end: float) -> Model:
    """The toe ends at a stretch of ``end``; its exponent has the same range of effects there as at 1.01."""
    end = float(f"{end:.3g}")
    alpha = model.parameters[model.names.index("alpha_f")]
    strains = ((model.lambda_0**2 - 1.0) / (end**2 - 1.0)) ** model.beta
    maximum = rounded(alpha.maximum * strains, up=True)
    return replace(model.with_parameter(replace(alpha, maximum=maximum, reference=maximum / 2)), lambda_0=end)


def _moduli(simulator: Uniaxial, model: Model, specimen: Specimen) -> Array:
    """Moduli ``[BEST, 2]`` (MPa) of fibres and matrix that fit best, of many values of all other parameters."""
    moduli, misfits = _fits(simulator, model, specimen, spread(model, ROWS)[-ROWS:])
    return moduli[np.argsort(misfits, kind="stable")[:BEST]]


def _fits(simulator: Uniaxial, model: Model, specimen: Specimen, rows: Array, taut: float = 1.0) -> tuple[Array, Array]:
    """Moduli ``[n, 2]`` (MPa) of fibres and matrix that fit best beside the other parameters of ``rows`` ``[n, d]``.

    Also the relative misfits ``[n]`` of these fits. Fibres are ``taut`` from this stretch on.
    """
    fibre, matrix = model.names.index("E_f"), model.names.index("E_m")
    basis, measured = [], []
    for curve in map(thinned, specimen.curves):
        size = float(np.sqrt(np.mean(curve.force_N**2))) or 1.0
        weight = 1.0 / (size * np.sqrt(curve.force_N.size))
        each = []
        for column in (fibre, matrix):
            one = rows.copy()
            one[:, [fibre, matrix]] = 0.0
            one[:, column] = 1.0
            along = _of_fibres(curve.protocol, specimen.length_mm, taut) if column == fibre else curve.protocol
            each.append(simulator.simulate(model, specimen, along, one).force_N * weight)
        basis.append(np.stack(each, axis=-1))
        measured.append(curve.force_N * weight)
    design, target = np.concatenate(basis, axis=1), np.concatenate(measured)
    fits = [nnls(np.nan_to_num(one), target) for one in design]
    return np.array([moduli for moduli, _ in fits]), np.array([misfit for _, misfit in fits]) / np.linalg.norm(target)


def _of_fibres(protocol: Protocol, length_mm: float, taut: float) -> Protocol:
    """The history of fibres that are ``taut`` from this stretch on."""
    stretch = (1.0 + protocol.displacement_mm / length_mm) / taut
    return protocol if taut == 1.0 else Protocol(protocol.name, protocol.time_s, length_mm * (stretch - 1.0))


def _range(model: Model, name: str, moduli: Array, largest: float) -> Parameter:
    """The modulus with a range around fitted ones; up to the ``largest`` one where all of them are 0."""
    parameter = model.parameters[model.names.index(name)]
    low, high = float(moduli.min()) / WIDER, (float(moduli.max()) or largest) * WIDER
    minimum, maximum = rounded(low, up=False), rounded(high, up=True)
    return replace(parameter, minimum=minimum, maximum=maximum, reference=(minimum + maximum) / 2)


def _fixed(parameter: Parameter, value: float) -> Parameter:
    return replace(parameter, minimum=value, maximum=value, reference=value)
