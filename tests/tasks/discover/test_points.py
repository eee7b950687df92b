"""`sinew discover` through a template with ten points of a camera: they tell apart what the force cannot."""

import json

import numpy as np
import pytest
import yaml

from sinew.tasks.data.cohort import write_cohort
from sinew.tasks.discover.fit.sizes import library_for
from sinew.tasks.simulate.febio.simulator import FEBio
from sinew.tasks.study import pipeline
from sinew.tasks.study.workspace import Workspace
from tests.tasks.discover.own_model import OwnBar, pulled
from tests.tasks.discover.test_own_model import STUDY
from tests.tasks.simulate.febio.dogbone import DOGBONE, stand_in
from tests.tasks.study.test_pipeline import sinew
from tests.trusting import trusted

POINTS = 10
NAMES = [f"dic_{number}_mm" for number in range(1, POINTS + 1)]


@pytest.fixture
def verdict(tmp_path, monkeypatch):
    """What is said of a specimen that slips in its grips, with or without the points; the solver is in this process."""
    monkeypatch.setattr(Workspace, "client", lambda _: None)
    monkeypatch.setattr(pipeline, "_draw", lambda *_: None)
    monkeypatch.setattr(FEBio, "simulate", lambda own, *given, **how: OwnBar(points=POINTS).simulate(*given, **how))
    text = DOGBONE.read_text().replace("{{ nu }}", "0.3")
    for name, own in {"E_matrix": "E", "g_1": "nu_m", "tau_1": "tau"}.items():
        text = text.replace(f"{{{{ {name} }}}}", f"{{{{ {own} }}}}")
    (tmp_path / "bone").mkdir()
    (tmp_path / "bone" / "dogbone.feb.j2").write_text(text)
    slip = library_for([pulled()])["grip-slip"]
    specimen = pulled((slip,), tuple(slip.typical), sd_N=0.3, points=POINTS, sd_mm=0.005)
    write_cohort(tmp_path / "cohort", [specimen])
    content = yaml.safe_load(STUDY.replace("PROGRAM", str(stand_in(tmp_path))))
    content["discover"] |= {"effects": ["machine-compliance", "grip-slip"]}
    for number, name in enumerate(NAMES, 1):
        output = {"data": "node_data", "item": "uz", "ids": [number], "unit": "mm"}
        content["simulator"]["outputs"][name] = output

    def judged(**more):
        name = "with" if more else "without"
        (tmp_path / f"{name}.yaml").write_text(yaml.safe_dump(content | more))
        sinew("discover", trusted(tmp_path / f"{name}.yaml"), "--out", tmp_path / name, "--quiet")
        return json.loads((tmp_path / name / "verdict.json").read_text())

    return judged


@pytest.mark.thorough
def test_points_tell_apart_what_the_force_cannot(verdict):
    alone = verdict()
    assert alone["verdict"] == "AMBIGUOUS"
    assert set(alone["set"]) == {"grip-slip", "machine-compliance"}
    both = verdict(measured={"force": {}} | {name: {} for name in NAMES})
    assert (both["verdict"], both["effects"]) == ("NAMED", ["grip-slip"])
    assert set(both["compared"]["bone/1"]) == set(NAMES)
    assert both["compared"]["bone/1"]["dic_3_mm"]["sd"] == pytest.approx(0.005, rel=0.2)
    assert both["gap"]["closed"] > 0.95
    after = [abs(cell["z"]) > cell["limit"] for cell in both["after"]["bone/1"]]
    assert np.mean(after) < 0.05
    low, high = both["candidates"][0]["parameters"]["bone/1"]["slip_per_force"]["interval"]
    slip = library_for([pulled()])["grip-slip"].typical[0]
    assert low - 0.1 * slip < slip < high + 0.1 * slip
