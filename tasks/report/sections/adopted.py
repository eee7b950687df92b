"""The model with the effect that `discover` named, where `sinew run --adopt` has run it: it leads the page."""

from collections.abc import Iterator
from typing import cast

from sinew.tasks.calibrate.result import CalibrateResult, SpecimenFit
from sinew.tasks.discover.result import ADOPTED, DiscoverResult
from sinew.tasks.drawing.blocks import Block, Section, Table, Words, listed, number, with_its_unit
from sinew.tasks.infer.result import InferResult, Posteriors
from sinew.tasks.report.folder import ResultFolder
from sinew.tasks.report.status import PAGE

NAME = "adopted"


def section(found: ResultFolder, adopted: ResultFolder) -> Section:
    """How close the model with the effects comes, beside the model without them, and its parameters.

    ``adopted`` is the folder ``adopted`` of ``found``.
    """
    discovery, fits = found.result(DiscoverResult), adopted.result(CalibrateResult)
    effects = discovery.answer if discovery is not None else "the named effects"
    title, question = f"The model with {effects}", "What are fits and parameters once the missing effect is added?"
    blocks: list[Block] = [Words(
        f"`discover` found that the model lacks {effects}. These results are of the model with it; all of "
        f"them are in `{ADOPTED}/{PAGE}`. Sections below with a warning are of the model without it."
    )]  # fmt: skip
    trouble = [Words(line, "warning") for line in adopted.trouble]
    if fits is None:
        return Section(NAME, title, question, [*blocks, *trouble, Words("It has no calibration yet.", "note")])
    without = found.result(CalibrateResult)
    blocks += [
        _closeness(without, fits),
        _parameters(fits),
        *_sites(cast(Posteriors | None, adopted.result(InferResult))),
        *trouble,
    ]
    worst = max(_percents(fits), default=float("nan"))
    before = max(_percents(without), default=float("nan")) if without is not None else float("nan")
    closeness = f"largest error of a fit {number(worst, 2)} % of the peak force"
    closeness += f", without {effects} {number(before, 2)} %" if without is not None else ""
    bounds = sorted({name for fit in fits.specimens.values() for name in fit.on_bound})
    return Section(
        NAME, title, question, blocks, found=closeness, failed=f"on a bound: {listed(bounds)}" if bounds else ""
    )


def _percents(result: CalibrateResult) -> list[float]:
    return [fit.percent_of_peak(protocol) for fit in result.specimens.values() for protocol in fit.rmse_N]


def _closeness(without: CalibrateResult | None, having: CalibrateResult) -> Table:
    """A row for each specimen and protocol that was fitted with the effects."""
    rows = []
    for name, fit in having.specimens.items():
        other = without.specimens.get(name) if without is not None else None
        for protocol in fit.rmse_N:
            before = _fit_cells(other, protocol) if other is not None and protocol in other.rmse_N else ["–", "–"]
            rows.append([f"{name} {protocol.replace('_', ' ')}", *before, *_fit_cells(fit, protocol)])
    header = [
        "curve",
        "error without it (% of the peak)",
        "R² without it",
        "error with it (% of the peak)",
        "R² with it",
    ]
    return Table("How close the fits are (root mean square error)", header, rows)


def _fit_cells(fit: SpecimenFit, protocol: str) -> list[str]:
    r2 = fit.r2[protocol]
    return [number(fit.percent_of_peak(protocol), 2), "–" if r2 is None else f"{r2:.4f}"]


def _parameters(fits: CalibrateResult) -> Table:
    units = dict(zip(fits.names, fits.units, strict=True))
    rows = [
        [
            with_its_unit(name, units[name]),
            *(_value(fit, name) for fit in fits.specimens.values()),
        ]
        for name in fits.free
    ]
    return Table("Calibrated parameters", ["parameter", *fits.specimens], rows, open=len(rows) <= 20)


def _value(fit: SpecimenFit, name: str) -> str:
    return number(fit.parameters[name], 3) + ("" if name in fit.determined else " (not determined)")


def _sites(posterior: Posteriors | None) -> Iterator[Block]:
    if posterior is None:
        return
    for site, found in posterior.sites.items():
        rows = [[name, number(one.mean, 3), number(one.sd, 2)] for name, one in found.parameters.items()]
        yield Table(f"Posterior of {site}", ["parameter", "mean", "standard deviation"], rows, open=False)
