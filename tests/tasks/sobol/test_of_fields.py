"""Sobol indices of fields: those of each place, kept with the mesh, drawn on it and exported."""

import json
import shutil

import numpy as np
import pandas as pd
import pytest
import yaml

from sinew.runner.store.store import open_store
from sinew.tasks.simulate.febio import keeping
from sinew.tasks.simulate.plain_design import shares
from sinew.tasks.simulate.saltelli import Design
from sinew.tasks.sobol import of_fields
from sinew.tasks.sobol.by_chaos import ByChaos
from sinew.tasks.sobol.evaluated import Evaluated
from sinew.tasks.sobol.method import Intervals
from sinew.tasks.study import pipeline
from sinew.tasks.study.resources import resource
from sinew.tasks.study.workspace import Workspace
from tests.tasks.simulate.febio.plotting_bar import plotting_bar, runs
from tests.tasks.simulate.febio.test_own_model import command, written
from tests.tasks.simulate.febio.test_vtk import arrays


@pytest.fixture(scope="module")
def once(tmp_path_factory, drawing):
    """The study of the tutorial that keeps fields, run once with a stand-in solver that writes some."""
    folder = tmp_path_factory.mktemp("fields")
    shutil.copytree(resource("configs/dogbone"), folder / "dogbone")
    study = yaml.safe_load(resource("configs/dogbone.yaml").read_text())
    study["protocols"]["relaxation"]["points"] = 21
    study["simulator"] |= {
        "executable": str(plotting_bar(folder)), "keep": "fields", "fields": ["displacement", "stress"],
    }  # fmt: skip
    study["simulator"]["outputs"]["gauge_stress"]["summary"] = "last"
    study["tasks"], study["sobol"] = ["sobol"], {"method": "surrogate", "error": 0.9, "runs": 32}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Workspace, "client", lambda _: None)
        patch.setattr(pipeline, "_draw", drawing["_draw"])
        command("run", written(folder, study), "--out", folder / "out", "--quiet")
    return folder


@pytest.fixture
def again(once, tmp_path, monkeypatch):
    """The study and a copy of its result folder without the result: all rows are there, and are analysed again."""
    monkeypatch.setattr(Workspace, "client", lambda _: None)
    monkeypatch.setattr(keeping, "_indexes", {})
    out = shutil.copytree(once / "out", tmp_path / "out")
    (out / "sobol.json").unlink()
    return once / "study.yaml", out


def fields(out):
    found = json.loads((out / "sobol.json").read_text())
    return found, open_store(out).read_result(of_fields.stored_as(found["tables"]["dogbone"], "relaxation"))


def test_a_place_has_the_indices_that_its_value_has(once):
    out = once / "out"
    found, dataset = fields(out)
    assert found["fields"] == {"dogbone": ["relaxation"]}
    assert dataset["moment"].to_numpy().tolist() == ["largest", "end"]
    assert dataset["time_s"].to_numpy() == pytest.approx([5.0, 65.0])
    # the bar's stress is uniaxial, so its equivalent is the stress itself, of which there is an output
    gauge = found["outputs"]["gauge_stress"]
    for key, apart in (("S1", 0.005), ("ST", 0.005), ("ST_conf", 0.02)):
        np.testing.assert_allclose(dataset[f"stress.{key}"].to_numpy()[1, :, 0], gauge[key], atol=apart)
    assert dataset["stress.ST"].attrs == {"variable": "stress", "where": "domain", "of": "von_mises"}
    assert dataset["displacement.ST"].sizes["displacement_places"] == dataset.sizes["node"]
    middle = dataset["nodes"].to_numpy()[:, 2] == 0.0  # of the specimen, which does not move but narrows
    assert np.nanargmax(np.nanmean(dataset["displacement.ST"].to_numpy()[1][:, middle], axis=1)) == 1
    drawn = sorted(each.name for each in (out / "figures").glob("sobol_field_*.csv"))
    assert [each.rpartition("_")[2] for each in drawn] == ["displacement.csv", "stress.csv"]
    table = pd.read_csv(out / "figures" / drawn[1])
    assert table["parameter"].nunique() == 3 and table["time_s"].nunique() == 2
    assert (out / "figures" / drawn[1]).with_suffix(".png").is_file()


def test_indices_are_exported_with_the_mesh(once, tmp_path, capsys):
    out = shutil.copytree(once / "out", tmp_path / "out")
    _, dataset = fields(out)
    command("fields", out, "--indices", "--to", tmp_path / "vtk")
    (path,) = (tmp_path / "vtk").glob("*.pvd")
    last = sorted((tmp_path / "vtk" / path.stem).glob("*.vtu"))[-1]
    stored = arrays(last)
    for title, name, j in (
        ("ST E_matrix: stress", "stress.ST", 0),
        ("S1_conf nu: displacement", "displacement.S1_conf", 1),
    ):
        np.testing.assert_array_equal(stored[title].ravel(), dataset[name].to_numpy()[1, j].astype(np.float32))
    for file in (out / "fields").iterdir():
        file.unlink()
    command("fields", out, "--indices", "--to", tmp_path / "vtk", expect=2)
    assert "the run whose mesh is needed is gone" in capsys.readouterr().err


@pytest.mark.parametrize("damage", ["no variable", "no time", "no intervals", "no dimension"])
def test_indices_that_somebody_damaged_are_refused_in_one_line(once, tmp_path, capsys, damage):
    out = shutil.copytree(once / "out", tmp_path / "out")
    (group,) = (out / "store.zarr" / "sobol_fields").glob("*/displacement.ST")
    if damage in ("no time", "no intervals"):
        shutil.rmtree(group.with_name("time_s" if damage == "no time" else "displacement.S1_conf"))
    else:
        about = json.loads((group / "zarr.json").read_text())
        if damage == "no variable":
            del about["attributes"]["variable"]
        else:
            about["shape"] = about["shape"][:2]
            about["chunk_grid"]["configuration"]["chunk_shape"] = about["shape"]
            about["dimension_names"] = about["dimension_names"][:2]
        (group / "zarr.json").write_text(json.dumps(about))
    command("fields", out, "--indices", "--to", tmp_path / "vtk", expect=2)
    (line,) = capsys.readouterr().err.splitlines()
    assert len(line) < 300 + len(str(out))
    assert not list((tmp_path / "vtk").rglob("*.vtu"))


def test_nothing_is_run_or_analysed_again(once, monkeypatch):
    monkeypatch.setattr(Workspace, "client", lambda _: None)
    before, count = (once / "out" / "sobol.json").read_bytes(), runs(once)
    monkeypatch.setattr("sinew.tasks.sobol.analysed.of_fields", lambda *_: pytest.fail("it is analysed again"))
    command("sobol", once / "study.yaml", "--out", once / "out", "--quiet")
    assert (once / "out" / "sobol.json").read_bytes() == before and runs(once) == count


@pytest.mark.thorough
def test_a_result_whose_arrays_are_gone_is_made_again(again, once):
    study, out = again
    shutil.copyfile(once / "out" / "sobol.json", out / "sobol.json")
    shutil.rmtree(out / "store.zarr" / "sobol_fields")
    command("sobol", study, "--out", out, "--quiet")
    np.testing.assert_array_equal(fields(out)[1]["stress.ST"], fields(once / "out")[1]["stress.ST"])


def test_without_fields_there_are_no_indices_of_them(again, capsys):
    study, out = again
    shutil.rmtree(out / "fields")
    command("sobol", study, "--out", out)
    said = " ".join(capsys.readouterr().out.split())
    assert "dogbone, relaxation: no indices of fields: the fields of its rows were not kept" in said
    assert "fields" not in json.loads((out / "sobol.json").read_text())
    command("fields", out, "--indices", expect=2)
    assert (
        "no indices of fields; expected a finished `sinew sobol` of a study with keep: fields"
        in capsys.readouterr().err
    )


@pytest.mark.parametrize("what", ["MOST", "MOST_INDICES"])
def test_fields_that_are_too_large_have_none(again, capsys, monkeypatch, what):
    study, out = again
    monkeypatch.setattr(of_fields, what, 1000)
    command("sobol", study, "--out", out)
    assert "are too many" in " ".join(capsys.readouterr().out.split())
    assert "fields" not in json.loads((out / "sobol.json").read_text())


@pytest.mark.thorough
def test_places_are_analysed_some_at_a_time(again, once, monkeypatch):
    study, out = again
    monkeypatch.setattr(of_fields, "BYTES_AT_A_TIME", 8 * 32 * 60)
    command("sobol", study, "--out", out, "--quiet")
    some, all_at_once = (fields(folder)[1] for folder in (out, once / "out"))
    apart = np.abs(some["stress.ST"] - all_at_once["stress.ST"])
    assert (apart <= all_at_once["stress.ST_conf"]).all() and not np.isnan(some["stress.ST"]).any()


def test_what_varies_by_rounding_alone_has_no_index():
    """Values are of 32 bits: a place that is held varies in the last of them."""
    share = shares(2, 64, 1, 8)
    alone = ((0,), (1,))
    design = Design(("a", "b"), 64, False, share, scrambles=8, members=alone, plain=True)
    estimate = ByChaos(design, share, np.ones(64, dtype=bool), Intervals(10, 0.95, 1))
    rng = np.random.default_rng(3)
    held = np.nextafter(np.float32(0.3), np.where(rng.random((64, 40)) < 0.5, 0, 1).astype(np.float32))
    real = np.repeat((5.0 + share[:, :1] + 0.5 * share[:, 1:]).astype(np.float32), 30, axis=1)
    one = Evaluated(None, None, np.arange(64))
    found = of_fields._analysed(estimate, one, np.hstack([real, held]), np.zeros(70, dtype=int))
    assert np.isnan(found["ST"][:, 30:]).all()
    np.testing.assert_allclose(found["ST"][:, :30], np.array([[0.8], [0.2]]) * np.ones(30), atol=0.001)
    assert found["ST_conf"][:, :30].max() < 0.01


def test_fields_of_surfaces_alone_have_none(again, capsys, monkeypatch):
    study, out = again
    monkeypatch.setattr(of_fields, "has_place", lambda _: False)
    command("sobol", study, "--out", out)
    assert "none of its variables is a number, a vector or a stress" in " ".join(capsys.readouterr().out.split())


@pytest.mark.thorough
def test_a_result_without_indices_is_made_again_once_the_fields_are_there(again, once):
    study, out = again
    (out / "fields").rename(out / "elsewhere")
    command("sobol", study, "--out", out, "--quiet")
    keeping._indexes.clear()
    (out / "elsewhere").rename(out / "fields")
    command("sobol", study, "--out", out, "--quiet")
    np.testing.assert_array_equal(fields(out)[1]["stress.ST"], fields(once / "out")[1]["stress.ST"])


def test_either_rows_or_indices(tmp_path, capsys):
    command("fields", tmp_path, expect=2)
    assert "Either some --row, or --indices;" in capsys.readouterr().err
