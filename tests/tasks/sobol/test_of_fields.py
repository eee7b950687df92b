"""Sobol indices of fields: those of each place, kept with the mesh, drawn on it and exported."""

import json

import numpy as np
import pandas as pd
import pytest

from sinew.runner.store.store import open_store
from sinew.tasks.simulate.febio import keeping
from sinew.tasks.sobol import of_fields
from tests.tasks.simulate.febio.plotting_bar import plotting_bar, runs
from tests.tasks.simulate.febio.test_own_model import command, settings, written
from tests.tasks.simulate.febio.test_vtk import arrays

__all__ = ["settings"]


@pytest.fixture
def keeping_fields(tmp_path, settings, monkeypatch):
    """The study of the tutorial that keeps fields, with a stand-in solver that writes some."""
    monkeypatch.setattr(keeping, "_indexes", {})
    settings["simulator"] |= {
        "executable": str(plotting_bar(tmp_path)), "keep": "fields", "fields": ["displacement", "stress"],
    }  # fmt: skip
    settings["simulator"]["outputs"]["gauge_stress"]["summary"] = "last"
    settings["tasks"], settings["sobol"] = ["sobol"], {"base_samples": 16}
    return settings


def fields(out):
    found = json.loads((out / "sobol.json").read_text())
    return found, open_store(out).read_result(of_fields.stored_as(found["tables"]["dogbone"], "relaxation"))


@pytest.mark.figures
def test_a_place_has_the_indices_that_its_value_has(tmp_path, keeping_fields):
    out = tmp_path / "out"
    command("run", written(tmp_path, keeping_fields), "--out", out, "--quiet")
    found, dataset = fields(out)
    assert found["fields"] == {"dogbone": ["relaxation"]}
    assert dataset["moment"].to_numpy().tolist() == ["largest", "end"]
    assert dataset["time_s"].to_numpy() == pytest.approx([5.0, 65.0])
    # the bar's stress is uniaxial, so its equivalent is the stress itself, of which there is an output
    gauge = found["outputs"]["gauge_stress"]
    for key in ("S1", "ST", "ST_conf"):
        np.testing.assert_allclose(dataset[f"stress.{key}"].to_numpy()[1, :, 0], gauge[key], atol=1e-4)
    assert dataset["stress.ST"].attrs == {"variable": "stress", "where": "domain", "of": "von_mises"}
    assert dataset["displacement.ST"].sizes["displacement_places"] == dataset.sizes["node"]
    clamped = dataset["nodes"].to_numpy()[:, 2] == 0.0  # the middle of the specimen, of which only the narrowing varies
    assert np.nanargmax(np.nanmean(dataset["displacement.ST"].to_numpy()[1][:, clamped], axis=1)) == 1
    drawn = sorted(each.name for each in (out / "figures").glob("sobol_field_*.csv"))
    assert [each.rpartition("_")[2] for each in drawn] == ["displacement.csv", "stress.csv"]
    table = pd.read_csv(out / "figures" / drawn[1])
    assert table["parameter"].nunique() == 3 and table["time_s"].nunique() == 2
    assert (out / "figures" / drawn[1]).with_suffix(".png").is_file()


def test_indices_are_exported_with_the_mesh(tmp_path, keeping_fields, capsys):
    out = tmp_path / "out"
    command("sobol", written(tmp_path, keeping_fields), "--out", out, "--quiet")
    _, dataset = fields(out)
    command("fields", out, "--indices", "--to", tmp_path / "vtk")
    (path,) = (tmp_path / "vtk").glob("*.pvd")
    last = sorted((tmp_path / "vtk" / path.stem).glob("*.vtu"))[-1]
    stored = arrays(last)
    np.testing.assert_array_equal(
        stored["ST E_matrix: stress"].ravel(), dataset["stress.ST"].to_numpy()[1, 0].astype(np.float32)
    )
    np.testing.assert_array_equal(
        stored["S1_conf nu: displacement"].ravel(), dataset["displacement.S1_conf"].to_numpy()[1, 1]
    )
    for folder in (out / "fields").iterdir():
        folder.unlink()
    command("fields", out, "--indices", "--to", tmp_path / "vtk", expect=2)
    assert "the run whose mesh is needed is gone" in capsys.readouterr().err


def test_nothing_is_run_or_analysed_again(tmp_path, keeping_fields, monkeypatch):
    study, out = written(tmp_path, keeping_fields), tmp_path / "out"
    command("sobol", study, "--out", out, "--quiet")
    before, count = (out / "sobol.json").read_bytes(), runs(tmp_path)
    monkeypatch.setattr("sinew.tasks.sobol.analysed.of_fields", lambda *_: pytest.fail("it is analysed again"))
    command("sobol", study, "--out", out, "--quiet")
    assert (out / "sobol.json").read_bytes() == before and runs(tmp_path) == count


def test_without_fields_there_are_no_indices_of_them(tmp_path, keeping_fields, capsys):
    keeping_fields["simulator"].pop("keep"), keeping_fields["simulator"].pop("fields")
    out = tmp_path / "out"
    command("sobol", written(tmp_path, keeping_fields), "--out", out, "--quiet")
    assert "fields" not in json.loads((out / "sobol.json").read_text())
    command("fields", out, "--indices", expect=2)
    assert (
        "no indices of fields; expected a finished `sinew sobol` of a study with keep: fields"
        in capsys.readouterr().err
    )


@pytest.mark.parametrize("what", ["MOST", "MOST_INDICES"])
def test_fields_that_are_too_large_have_none(tmp_path, keeping_fields, capsys, monkeypatch, what):
    monkeypatch.setattr(of_fields, what, 1000)
    out = tmp_path / "out"
    command("sobol", written(tmp_path, keeping_fields), "--out", out)
    assert "no indices of fields: " in " ".join(capsys.readouterr().out.split())
    assert "fields" not in json.loads((out / "sobol.json").read_text())


def test_places_are_analysed_some_at_a_time(tmp_path, keeping_fields, monkeypatch):
    out = tmp_path / "out"
    study = written(tmp_path, keeping_fields)
    command("sobol", study, "--out", out, "--quiet")
    _, whole = fields(out)
    monkeypatch.setattr(of_fields, "BYTES_AT_A_TIME", 8 * 96 * 7)
    (out / "sobol.json").unlink()
    command("sobol", study, "--out", out, "--quiet")
    _, parts = fields(out)
    np.testing.assert_allclose(parts["stress.ST"], whole["stress.ST"], atol=1e-6)


def test_either_rows_or_indices(tmp_path, capsys):
    command("fields", tmp_path, expect=2)
    assert "Either some --row, or --indices;" in capsys.readouterr().err
