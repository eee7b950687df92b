"""`sinew discover` of a force and a width: both are fitted, mapped, predicted, kept and shown."""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from sinew.tasks.data.cohort import write_cohort
from sinew.tasks.data.noise import Noise
from sinew.tasks.data.virtual import autoregressive
from sinew.tasks.discover import compound, page, prose
from sinew.tasks.discover.fit.fit import Fitted
from sinew.tasks.discover.fit.specimen_fits import SpecimenFits
from sinew.tasks.discover.misfit_map import OtherNoise
from sinew.tasks.discover.result import DiscoverResult
from sinew.tasks.discover.show import cells_table
from sinew.tasks.fitting.measured import Measured
from sinew.tasks.model import Curve, Model, Specimen
from sinew.tasks.model.effects import library
from sinew.tasks.model.protocols import cyclic, one_step
from sinew.tasks.simulate.effects import bars_with
from sinew.tasks.simulate.lateral import lateral
from sinew.tasks.study.measured import key_of_quantities
from sinew.tasks.study.workspace import Workspace
from tests.tasks.discover.results import CELL, discovery
from tests.tasks.study.test_pipeline import sinew
from tests.whole_runs import drawn_in_this_process

TRUTH = {"E_m": 30.0, "E_f": 150.0, "alpha_f": 1500.0, "nu_m": 0.3}
MODEL, BAR, SD = Model(), Specimen("a/1", 10.0, 8.0, 4.0), 1e-4
STUDY = """
name: quantities
seed: 3
cohort: cohort
tasks: [discover]
measured: {force: {}, lateral_strain: {}}
discover: {effects: [machine-compliance, toe-slack], starts: 1, laws: false}
model:
  parameters:
""" + "".join(f"    {p.name}: {{fixed: {p.reference}}}\n" for p in MODEL.parameters if p.name not in TRUTH)


def pulled(seed: int = 1) -> Specimen:
    """A bar in a machine that gives way, whose width is seen at every second point."""
    rng, effect = np.random.default_rng(seed), library()["machine-compliance"]
    row = np.array([[TRUTH.get(p.name, p.reference) for p in MODEL.parameters]])
    curves = []
    for make in (one_step, cyclic):
        protocol = make(10.0, 2.0)
        bars = bars_with(MODEL, (effect,), BAR, protocol, row, effect.typical[np.newaxis])
        seen = lateral("lateral_strain", MODEL, BAR, row, bars.strain)[0] + SD * rng.standard_normal(bars.strain.size)
        seen[1::2] = np.nan
        force = bars.force_N[0] + 1.5 * autoregressive(rng, protocol.time_s.size, 0.3)
        curves.append(Curve(protocol, force, {"lateral_strain": seen}))
    return replace(BAR, curves=tuple(curves))


@pytest.fixture(scope="module")
def out(tmp_path_factory, drawing):
    """The result folder of a discovery, with its figures."""
    folder = tmp_path_factory.mktemp("quantities")
    write_cohort(folder / "cohort", [pulled()])
    (folder / "study.yaml").write_text(STUDY)
    with drawn_in_this_process(drawing):
        sinew("discover", folder / "study.yaml", "--out", folder / "out", "--quiet")
    return folder / "out"


def test_the_effect_is_named_by_force_and_width_together(out):
    found = DiscoverResult.read(out)
    assert (found.verdict, found.effects) == ("NAMED", ("machine-compliance",))
    noise = found.compared["a/1"]["lateral_strain"]
    assert noise.sd == pytest.approx(SD, rel=0.15)
    assert noise.unit == "1"
    cells = found.cells["a/1"]
    assert {cell.quantity for cell in cells} == {None, "lateral_strain"}
    wide = [cell for cell in cells if cell.quantity]
    assert any(cell.beyond_chance for cell in wide), "the gauge is strained less than it seems"
    assert all(np.isnan(cell.mean_N) and abs(cell.mean) < 0.01 for cell in wide)
    assert "cyclic, lateral_strain: ramp 6" in {cell.name for cell in wide}
    after = [cell.beyond_chance for cell in found.after["a/1"]]
    assert np.mean(after) < 0.05
    assert found.gap.closed > 0.9
    assert found.confidence is None
    assert "of more than the force, has not been counted" in prose.methods(found)
    assert "Beside the force, the fits compare lateral_strain (noise 9.6e-05)" in prose.methods(found)


def test_the_width_is_kept_and_shown(out):
    kept = xr.open_datatree(out / "store.zarr", engine="zarr", consolidated=False)["discover/a_1"]
    left = {
        name: float(np.nanstd(kept["measured_lateral_strain_cyclic"] - kept[f"{name}_lateral_strain_cyclic"]))
        for name in ("bare", "having")
    }
    assert left["having"] == pytest.approx(SD, rel=0.15)
    assert left["bare"] > 1.2 * left["having"]
    for figure in ("discover_a_1", "discover_a_1_quantities", "discover_cells"):
        assert (out / "figures" / f"{figure}.png").stat().st_size > 5000
    table = pd.read_csv(out / "figures" / "discover_a_1_quantities.csv")
    assert list(table) == ["quantity", "unit", "protocol", "time_s", "measured", "as_it_is", "with_effects"]
    assert len(table) == sum(np.isfinite(curve.others["lateral_strain"]).sum() for curve in pulled().curves)
    cells = pd.read_csv(out / "figures" / "discover_cells.csv")
    assert {"quantity", "mean"} <= set(cells)
    text = (out / "report.html").read_text()
    assert "compared beside the force" in text
    assert "What either model leaves of each quantity beside the force" in text


def test_where_the_force_is_all_nothing_else_is_told(out, tmp_path, monkeypatch):
    monkeypatch.setattr(Workspace, "client", lambda _: None)
    study = tmp_path / "study.yaml"
    study.write_text(STUDY.replace("measured: {force: {}, lateral_strain: {}}\n", ""))
    sinew("discover", study, "--data", out.parent / "cohort", "--out", tmp_path / "out", "--quiet")
    alone = json.loads((tmp_path / "out" / "discover.json").read_text())
    assert "compared" not in alone
    assert not any("quantity" in cell or "mean" in cell for cell in alone["cells"]["a/1"])
    assert "quantity" not in cells_table(DiscoverResult.read(tmp_path / "out"))
    both = json.loads((out / "discover.json").read_text())
    assert alone["inputs"] != both["inputs"]
    assert both["null"]["floor"] > 1.3 * alone["null"]["floor"]


def test_an_error_that_quantities_share_counts_once(monkeypatch):
    """Courses that are wrong together make a share no surer than the force alone does."""
    one = pulled()
    every_row = tuple(replace(c, others={f"w{n}": c.force_N for n in range(8)}) for c in one.curves)
    noise = {f"w{n}": Noise(1.0, 0.0) for n in range(8)}
    alone, both = (Measured(replace(one, curves=every_row), Noise(1.0, 0.0), others) for others in ({}, noise))
    rng, found = np.random.default_rng(3), {}
    force = {name: rng.normal(size=thin.size) + 3.0 for name, thin in alone.thinned.items()}

    def residuals(candidate, measured, at, curves):
        times = 0.5 if candidate.effects else 1.0
        return times * np.concatenate([np.tile(force[c.name], len(measured.quantities)) for c in curves])[np.newaxis]

    monkeypatch.setattr(compound, "residuals", residuals)
    for measured in (alone, both):
        cohort = [SpecimenFits(measured, MODEL, Path())]
        floor = float(sum(thin.size for thin in measured.thinned.values()))
        fits = [Fitted(np.zeros(1), 0.0, 1)]
        effects = (library()["time-lag"],)
        found[len(measured.quantities)] = compound.taken_away(cohort, fits, ((), fits), (effects, fits), floor)
    (share, ends), (same, wider) = found[1], found[9]
    assert same == pytest.approx(share)
    assert np.diff(wider) == pytest.approx(np.diff(ends), rel=1e-6)


NOISE = OtherNoise(0.1, 0.0, "mm", given=False)


@pytest.mark.parametrize(
    ("compared", "quantity", "words"),
    [
        ({}, None, "compared: other specimens"),
        ({"a/1": {}}, None, "compared: other specimens"),
        ({"b/1": {"w": NOISE}}, None, "compared: other specimens"),
        ({"a/1": {"w": NOISE}}, "v", "a quantity of a/1 that was not compared"),
        (None, "w", "a quantity of a/1 that was not compared"),
    ],
)
def test_a_result_that_contradicts_itself_is_none(compared, quantity, words):
    with pytest.raises(ValueError, match=words):
        discovery(compared=compared, cells={"a/1": (replace(CELL, quantity=quantity, mean=0.1),)})


def test_a_cell_of_a_quantity_has_its_mean():
    for quantity, mean in (("w", None), (None, 0.1)):
        with pytest.raises(ValueError, match="a mean of a/1"):
            discovery(compared={"a/1": {"w": NOISE}}, cells={"a/1": (replace(CELL, quantity=quantity, mean=mean),)})


def test_noise_of_nothing_is_none():
    for sd in (0.0, np.inf):
        with pytest.raises(ValueError, match="noise of"):
            OtherNoise(sd, 0.0, "mm", given=True)
    with pytest.raises(ValueError, match="a unit of 25 letters"):
        OtherNoise(0.1, 0.0, 25 * "m", given=True)


def test_specimens_with_other_protocols_have_empty_plots_of_those(monkeypatch):
    """What is picked must replace all that was drawn before."""
    times = {"x": np.arange(3.0), "y": np.arange(4.0)}
    left = {
        name: {"w": {each: {"time": times[each], "bare": times[each]} for each in protocols}}
        for name, protocols in (("b/1", "x"), ("a/1", "xy"))
    }
    monkeypatch.setattr(page, "leftovers", lambda kept, result, specimen: left[specimen])
    found = discovery(compared={name: {"w": NOISE} for name in left}, cells=dict.fromkeys(left, ()))
    store = SimpleNamespace(read_result=lambda _: None)
    shown = page._quantities(SimpleNamespace(store=store), found)
    assert list(shown.options) == ["b/1, w", "a/1, w"]
    assert len(shown.plots) == 2


def test_the_order_of_quantities_is_a_part_of_what_is_kept(tmp_path):
    keys = [key_of_quantities(names, None) for names in ((), ("a", "b"), ("b", "a"))]
    assert keys[0] == []
    assert keys[1] != keys[2]
    specimen = replace(BAR, curves=pulled().curves)
    noises = [dict.fromkeys(names, Noise(1.0, 0.0)) for names in (("a", "b"), ("b", "a"))]
    both = [SpecimenFits(Measured(specimen, Noise(1.0, 0.0), each), MODEL, tmp_path) for each in noises]
    first, second = both
    first._checkpoint(2, "bare", possible=None).append(np.array([1.0, 2.0]))
    assert len(first._checkpoint(2, "bare", possible=None)) == 1
    assert len(second._checkpoint(2, "bare", possible=None)) == 0
