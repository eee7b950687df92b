"""`sinew discover` of a force and a width: both are fitted, mapped, predicted, kept and shown."""

import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from sinew.tasks.data.cohort import write_cohort
from sinew.tasks.data.virtual import autoregressive
from sinew.tasks.discover import prose
from sinew.tasks.discover.result import DiscoverResult
from sinew.tasks.model import Curve, Model, Specimen
from sinew.tasks.model.effects import library
from sinew.tasks.model.protocols import cyclic, one_step
from sinew.tasks.simulate.effects import bars_with
from sinew.tasks.simulate.lateral import lateral
from sinew.tasks.study import pipeline
from sinew.tasks.study.workspace import Workspace
from tests.tasks.study.test_pipeline import sinew

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
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Workspace, "client", lambda _: None)
        for name, real in drawing.items():
            patch.setattr(pipeline, name, real)
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


@pytest.mark.figures
def test_where_the_force_is_all_nothing_else_is_told(out, tmp_path, monkeypatch):
    monkeypatch.setattr(Workspace, "client", lambda _: None)
    study = tmp_path / "study.yaml"
    study.write_text(STUDY.replace("measured: {force: {}, lateral_strain: {}}\n", ""))
    sinew("discover", study, "--data", out.parent / "cohort", "--out", tmp_path / "out", "--quiet")
    alone = json.loads((tmp_path / "out" / "discover.json").read_text())
    assert "compared" not in alone
    assert not any("quantity" in cell or "mean" in cell for cell in alone["cells"]["a/1"])
    assert "quantity" not in pd.read_csv(tmp_path / "out" / "figures" / "discover_cells.csv")
    assert not list((tmp_path / "out" / "figures").glob("*_quantities*"))
    both = json.loads((out / "discover.json").read_text())
    assert alone["inputs"] != both["inputs"]
    assert both["null"]["floor"] > 1.3 * alone["null"]["floor"]
