"""The real solver against references, the embedded simulator and what is known of its failures."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sinew.tasks.model import Curve, Model, Protocol, Specimen
from sinew.tasks.model.parameters import own_parameter
from sinew.tasks.model.protocols import STANDARD, one_step
from sinew.tasks.simulate.febio.attempt import solver_version
from sinew.tasks.simulate.febio.field_output import FieldOutput
from sinew.tasks.simulate.febio.output import Logged
from sinew.tasks.simulate.febio.settings import FIELDS
from sinew.tasks.simulate.febio.simulator import FEBio
from sinew.tasks.simulate.febio.template import OwnTemplate, check_template
from sinew.tasks.simulate.febio.tendon import TendonTemplate, read_template
from sinew.tasks.simulate.uniaxial import Uniaxial
from tests.conftest import reference, reference_parameters
from tests.tasks.simulate.febio.dogbone import BAR as GAUGE
from tests.tasks.simulate.febio.dogbone import DOGBONE, OWN, RELAX, dogbone
from tests.tasks.simulate.febio.fake_solver import BAR, BUILT_IN, TEMPLATE, attempts, outcome


@pytest.fixture
def real(tmp_path) -> FEBio:
    program = shutil.which("febio4")
    assert program is not None
    return FEBio(program, "real", BUILT_IN, tmp_path / "attempts", timeout_s=120.0)


def largest_error(force: np.ndarray, expected: np.ndarray) -> float:
    """The largest error of any row, as a fraction of the row's peak."""
    return float((np.abs(force - expected).max(axis=1) / np.abs(expected).max(axis=1)).max())


@pytest.mark.febio
@pytest.mark.parametrize("protocol", ["one_step", "two_step", "cyclic"])
def test_real_solver_matches_the_reference(real, model, protocol):
    history, expected = reference(protocol)
    simulated = real.simulate(model, BAR, history, reference_parameters(model))
    assert simulated.messages == ("",) * 40
    assert largest_error(simulated.force_N, expected) < 1e-6
    assert attempts(real) == []


@pytest.mark.febio
@pytest.mark.parametrize("make", STANDARD[:2])
def test_real_and_embedded_solver_are_equal_at_full_rate(real, model, make):
    history = make(10.0, 100.0)
    rows = reference_parameters(model)[:4]
    simulated = real.simulate(model, BAR, history, rows)
    assert simulated.messages == ("",) * 4
    assert largest_error(simulated.force_N, Uniaxial().simulate(model, BAR, history, rows).force_N) < 1e-7


@pytest.mark.febio
@pytest.mark.parametrize("start_mm", [0.3, 0.05, -0.2])
def test_real_and_embedded_solver_start_displaced_alike(real, model, start_mm):
    time_s = 2.0 + np.arange(2001) / 100.0
    history = Protocol("displaced", time_s, start_mm + 0.1 * np.sin(time_s - 2.0))
    rows = reference_parameters(model)[:4]
    simulated = real.simulate(model, BAR, history, rows)
    assert simulated.messages == ("",) * 4
    assert largest_error(simulated.force_N, Uniaxial().simulate(model, BAR, history, rows).force_N) < 1e-6


@pytest.mark.febio
@pytest.mark.parametrize("last_mm", [-10.5, -12.0])
def test_real_solver_turned_inside_out_has_a_negative_jacobian(real, model, last_mm):
    history = Protocol("crushed", np.array([0.0, 0.1, 0.2]), np.array([0.0, last_mm / 2, last_mm]))
    status, message = outcome(real, model, history)
    assert status == "negative_jacobian"
    assert message.startswith("Negative jacobian")


@pytest.mark.febio
def test_real_solver_crushed_almost_to_nothing(real, model):
    history = Protocol("crushed", np.array([0.0, 0.1, 0.2]), np.array([0.0, -4.95, -9.9]))
    assert outcome(real, model, history) == ("ok", "")


@pytest.mark.febio
def test_real_solver_without_iterations_diverges(real, model):
    simulator = replace(real, template=TendonTemplate(TEMPLATE.replace("<max_refs>25", "<max_refs>1")))
    status, message = outcome(simulator, model)
    assert status == "diverged"
    assert "Max nr of reformations reached" in message


@pytest.mark.febio
@pytest.mark.parametrize(
    ("right", "wrong", "word"),
    [
        ("{{ parameters.E_m | full }}", "-1", "Failed initializing material"),
        ("{{ parameters.nu_m | full }}", "0.7", "Failed initializing material"),
        ('type="solid mixture"', 'type="unobtainium"', "material"),
        ('node_set="top"', 'node_set="nowhere"', "node_set"),
        ("<Control>", "<Control><nonsense>1</nonsense>", "nonsense"),
        ("<max_refs>25", "<max_refs>many", "max_refs"),
    ],
)
def test_real_solver_refuses_broken_input(real, model, right, wrong, word):
    assert right in TEMPLATE
    status, message = outcome(replace(real, template=TendonTemplate(TEMPLATE.replace(right, wrong))), model)
    assert status == "bad_input"
    assert word in message


@pytest.mark.febio
def test_real_solver_ends_at_the_timeout(real, model):
    simulator = replace(real, timeout_s=0.05, hold_growth=0.0)
    status, message = outcome(simulator, model, one_step(10.0, 100.0))
    assert status == "timeout"
    assert message.startswith("no end after 0.05 s")


@pytest.mark.febio
def test_real_solver_ends_at_its_file_limit(real, model):
    simulator = replace(real, max_file_bytes=100_000)
    status, message = outcome(simulator, model, one_step(10.0, 100.0))
    assert status == "bad_output"
    assert "larger than max_file_mb" in message


@pytest.mark.febio
def test_real_solver_says_its_version():
    program = shutil.which("febio4")
    assert program is not None
    assert solver_version(Path(program)).startswith("4.")


def febio() -> Path:
    return Path(str(shutil.which("febio4"))).resolve()


@pytest.mark.febio
def test_one_element_by_template_equals_the_built_in_simulator(tmp_path):
    model = Model()
    text = read_template(Path(), None).text.replace("parameters.", "").replace("constants.beta", "2.0")
    text = text.replace("constants.lambda_0", "1.01")
    own = Model(
        tuple(own_parameter(p.name, p.unit, p.minimum, p.maximum, p.reference) for p in model.parameters),
        law="template",
    )
    force = Logged("force", "N", "max", "node_data", "Rz", (5, 6, 7, 8), None, "sum", 2.0)
    version = solver_version(febio())
    template = OwnTemplate({"t": text}, "t", (force,), "force")
    ours = FEBio(str(febio()), version, template, tmp_path / "a")
    check_template(tmp_path, template, own, sized=True, moved=True)
    built_in = FEBio(str(febio()), version, read_template(Path(), None), tmp_path / "b")
    rows = np.stack([model.reference, 0.7 * model.reference + 0.3 * np.array([p.maximum for p in model.parameters])])
    specimen = Specimen("bar", 10.0, 8.0, 4.0)
    found = ours.simulate(own, specimen, RELAX, rows)
    expected = built_in.simulate(model, specimen, RELAX, rows)
    assert not found.status.any(), found.messages
    assert np.array_equal(found.force_N, expected.force_N)


@pytest.mark.febio
def test_a_straight_bar_of_many_elements_is_the_analytic_bar(tmp_path):
    """Not clamped and not widened, the dog-bone is a bar in uniaxial tension, whose force is known."""
    text = DOGBONE.read_text().replace("widening = 5.0, 3.0, 1.8", "widening = 5.0, 3.0, 1.0")
    clamped = '    <bc name="clamped" type="zero displacement" node_set="grip"><x_dof>1</x_dof><y_dof>1</y_dof></bc>\n'
    assert clamped in text
    text = text.replace(clamped, "")
    rows = np.array([[20.0, 0.3, 0.8, 8.0], [45.0, 0.42, 0.2, 25.0]])
    curve, keep = Curve(RELAX, np.zeros(RELAX.time_s.size)), np.arange(RELAX.time_s.size)
    exact = dogbone(tmp_path, text).compare(OWN, GAUGE, curve, rows, keep)
    found = dogbone(tmp_path, text, febio()).compare(OWN, GAUGE, curve, rows, keep)
    assert not found.status.any(), found.messages
    for name, values in exact.outputs.items():
        assert np.abs(found.outputs[name] - values).max() < 1e-5 * np.abs(values).max(), name


@pytest.mark.febio
def test_the_dogbone_converges_as_its_mesh_is_refined(tmp_path):
    peaks = []
    short = Protocol("pull", np.linspace(0.0, 4.0, 5), np.linspace(0.0, 1.2, 5))
    for fineness in (1, 2, 3):
        text = DOGBONE.read_text().replace("fineness = 1", f"fineness = {fineness}")
        found = dogbone(tmp_path, text, febio()).simulate(OWN, GAUGE, short, OWN.reference[np.newaxis])
        assert not found.status.any(), found.messages
        peaks.append(found.force_N[0, -1])
    assert abs(peaks[0] - peaks[2]) < 0.02 * peaks[2]
    assert abs(peaks[1] - peaks[2]) < 0.4 * abs(peaks[0] - peaks[2])
    assert peaks[0] > peaks[1] > peaks[2], "displacement elements are too stiff"


@pytest.mark.febio
@pytest.mark.parametrize("compression", [0, 1])
def test_outputs_of_kept_fields_are_those_of_the_log(tmp_path, compression):
    """In the plot file of the real solver, to the precision of its numbers; and no second run for new outputs."""
    program = Path(str(shutil.which("febio4")))
    plot = f"<Output><plotfile type='febio'><compression>{compression}</compression></plotfile></Output></febio_spec>"
    text = DOGBONE.read_text().replace("</febio_spec>", plot)
    bar = replace(dogbone(tmp_path, text, program), plotted=FIELDS, kept=tmp_path / "fields")
    rows = OWN.full(("E_matrix", "nu"), np.array([[10.0, 0.2], [45.0, 0.45]]))
    logged, status, messages = bar._rows(OWN, GAUGE, RELAX, rows)
    assert messages == ("", "")
    fields = (
        FieldOutput(
            "reaction", "N", "max", "reaction forces", "z", (), "grip", "sum", -4.0
        ),  # the log has the other sign
        FieldOutput("mean_stress", "MPa", "max", "stress", "zz", (), "gauge", "mean"),
        FieldOutput("lateral", "mm", "max", "displacement", "x", (), "edge", "single", -2.0),
    )
    without_solver = replace(bar, template=replace(bar.template, fields=fields), executable="/nowhere/febio4")
    found, status, messages = without_solver._rows(OWN, GAUGE, RELAX, rows)
    assert messages == ("", "")
    assert not status.any()
    assert np.array_equal(found[:, :3], logged)
    size = np.abs(logged).max(axis=2)
    assert (np.abs(found[:, 3:] - logged).max(axis=2) < 1e-6 * size).all()
