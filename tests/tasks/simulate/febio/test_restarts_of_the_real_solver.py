"""The real solver, interrupted in the middle of a run: what it goes on to is what it would have come to."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sinew.runner.evaluation import external
from sinew.runner.evaluation.interim import STATES, kept_until_written
from sinew.tasks.model.protocols import one_step
from sinew.tasks.simulate.febio import restarts
from sinew.tasks.simulate.febio.simulator import FEBio
from tests.conftest import reference_parameters
from tests.tasks.simulate.febio.dogbone import BAR, DOGBONE, OWN, RELAX, dogbone
from tests.tasks.simulate.febio.fake_solver import BAR as TENDON
from tests.tasks.simulate.febio.fake_solver import BUILT_IN, attempts
from tests.tasks.simulate.febio.restarting import Interrupted


@pytest.fixture(autouse=True)
def _often(tmp_path, monkeypatch):
    monkeypatch.setattr(external, "MEANWHILE_S", 0.005)
    monkeypatch.setattr(restarts, "WORTH", 0.0)
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "home"))


def both(simulator, monkeypatch, model, specimen, protocol, row):
    """The simulated forces ``[t]`` of a whole run, and of one that is interrupted and goes on from its middle."""
    whole = simulator.simulate(model, specimen, protocol, row)
    assert whole.messages == ("",)
    simulator = replace(simulator, restart_s=0.01)
    look, kept, went_on = restarts.Interim.look, [], []

    def looked(self):
        before = self.due
        look(self)
        kept.append(self.due != before)
        if sum(kept) == 3:
            raise Interrupted

    with monkeypatch.context() as patch:
        patch.setattr(restarts.Interim, "look", looked)
        with pytest.raises(Interrupted), kept_until_written():
            simulator.simulate(model, specimen, protocol, row)
    assert len(list((simulator.scratch / STATES).iterdir())) == 1
    join = restarts.Interim.join
    monkeypatch.setattr(restarts.Interim, "join", lambda self: went_on.append(self.before) or join(self))
    with kept_until_written():
        found = simulator.simulate(model, specimen, protocol, row)
    assert found.messages == ("",)
    assert [state is not None for state in went_on] == [True], "it went on and did not start over"
    assert attempts(simulator) == [STATES]
    assert not list((simulator.scratch / STATES).iterdir())
    return whole.force_N[0], found.force_N[0]


@pytest.mark.febio
def test_the_built_in_tendon_goes_on(tmp_path, monkeypatch, model):
    real = FEBio(str(shutil.which("febio4")), "real", BUILT_IN, tmp_path / "attempts", timeout_s=120.0)
    row = reference_parameters(model)[:1]
    whole, found = both(real, monkeypatch, model, TENDON, one_step(10.0, 100.0), row)
    np.testing.assert_allclose(found, whole, rtol=0, atol=1e-9 * np.abs(whole).max())


@pytest.mark.febio
def test_a_dog_bone_goes_on(tmp_path, monkeypatch):
    text = DOGBONE.read_text().replace("fineness = 1", "fineness = 2")
    real = dogbone(tmp_path, text, Path(str(shutil.which("febio4"))))
    whole, found = both(real, monkeypatch, OWN, BAR, RELAX, OWN.reference[np.newaxis])
    np.testing.assert_allclose(found, whole, rtol=0, atol=1e-9 * np.abs(whole).max())
    monkeypatch.setattr(restarts, "_seconds_per_step", {})
    options, kept = [], replace(real, restart_s=1.0)
    limited = external.run
    monkeypatch.setattr(external, "run", lambda *given, **o: options.append(given[0]) or limited(*given, **o))
    for _ in range(2):
        with kept_until_written():
            found = kept.simulate(OWN, BAR, RELAX, OWN.reference[np.newaxis])
        np.testing.assert_array_equal(found.force_N[0], whole)
    assert any(word.startswith("-dump_stride=") for word in options[1]), "its log says how many steps there were"
