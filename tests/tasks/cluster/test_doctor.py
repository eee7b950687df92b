"""What the doctor sees: a cluster that will do, and everything about one that will not."""

import re
from dataclasses import replace

import numpy as np
import pytest

from sinew.tasks.cluster import doctor as doctor_module
from sinew.tasks.cluster.doctor import examine
from sinew.tasks.cluster.profile import read_profile
from sinew.tasks.data.cohort import write_cohort
from sinew.tasks.data.virtual import virtual_cohort
from sinew.tasks.drawing.blocks import span
from sinew.tasks.model import Curve
from sinew.tasks.study.cohort import cohort_of
from sinew.tasks.study.study import read_study
from tests.batch import places
from tests.tasks.cluster.slurm_studies import ALLOCATION, PROFILE, live, prepare, profile_with, sinew_process, until
from tests.tasks.measured import study_of, write_measured
from tests.trusting import trusted

LOOKED_AT = (
    "study and cohort",
    "ranges",
    "disk",
    "quota",
    "clock of the disk",
    "SLURM",
    "profile",
    "TLS",
    "worker",
    "clock of the worker",
    "result folder",
    "threads",
    "network interface",
    "scratch",
    "solver",
    "canary",
    "size",
)


def findings_of(folder):
    """What the doctor finds good, and what bad, about the study in a folder: its words by the name of the finding."""
    study, profile = read_study(folder / "study.yaml"), read_profile(folder / "profile.yaml")
    out = folder / "out"
    with places.a_place():
        found = examine(study, profile, profile.one_job(study.name, out), out, lambda finding: None)
    assert not out.exists(), "it leaves nothing behind"
    good = {finding.name: finding.words for finding in found if finding.good}
    return good, {finding.name: finding.words for finding in found if not finding.good}


def doctor(folder, expect=0):
    """What the command prints on the study in a folder."""
    profile = folder / "profile.yaml"
    return sinew_process("doctor", folder / "study.yaml", "--profile", profile, "--out", folder / "out", expect=expect)


def test_what_is_compared_beside_the_force_is_told(tmp_path):
    write_measured(tmp_path, 2, 2.0)
    several = study_of(tmp_path, "", "measured: {force: {noise: 0.5}, lateral_strain: {noise: 0.0003}}")
    specimens = cohort_of(read_study(several)).specimens
    points = {sum(int(np.isfinite(c.others["lateral_strain"]).sum()) for c in one.curves) for one in specimens}
    words = doctor_module._compared(specimens)
    assert words.startswith("; compared: force (")
    assert words.endswith(f"lateral_strain ({span(sorted(points))} points, noise 0.0003)")
    assert doctor_module._compared(cohort_of(read_study(study_of(tmp_path, "", ""))).specimens) == ""


@pytest.mark.parametrize(("factor", "good"), [(1.0, True), (1e-4, False), (-1.0, False)])
def test_ranges_that_cannot_reach_the_data(tmp_path, factor, good):
    specimens, _ = virtual_cohort(seed=1, per_site=1, rate_hz=2.0)
    turned = [
        replace(one, curves=tuple(Curve(curve.protocol, factor * curve.force_N) for curve in one.curves))
        for one in specimens
    ]
    write_cohort(tmp_path / "cohort", turned)
    (tmp_path / "study.yaml").write_text("name: x\ncohort: cohort\n")
    study = read_study(tmp_path / "study.yaml")
    found = []
    doctor_module._look_at_the_ranges(study, cohort_of(study), tmp_path / "out", lambda *one: found.append(one))
    ((name, is_good, words),) = found
    assert (name, is_good) == ("ranges", good)
    assert ("fixed value" in words) == good


@pytest.mark.parametrize(
    ("peaks", "good"),
    [
        ({"pull": (100.0, 30.0)}, True),
        ({"pull": (100.0, 1.0)}, False),
        ({"pull": (100.0, -100.0)}, False),
        ({"pull": (-100.0, -100.0)}, True),
        ({"pull": (100.0, 0.0)}, False),
        ({"rest": (0.0, 5.0), "pull": (100.0, 100.0)}, True),
        ({"rest": (0.0, 5.0)}, None),
        ({"pull": (1e-300, 1e300)}, False),
    ],
)
def test_forces_of_a_template_that_are_far_from_the_measured_ones(peaks, good):
    found = []
    doctor_module._note_peaks(peaks, lambda *one: found.append(one))
    assert [one[1] for one in found] == ([] if good is None else [good])


@pytest.mark.takes(12)
def test_a_cluster_that_will_do(tmp_path, slurm_cluster):
    prepare(tmp_path, PROFILE + "scratch: /tmp\n")
    said = doctor(tmp_path)
    found = dict(re.findall(r"^ok   ([^:]+): (.*)$", said, re.MULTILINE))
    assert tuple(found) == LOOKED_AT
    assert "BAD" not in said
    assert "slurm" in found["SLURM"]
    assert re.match(r"n\d, job \d+, Python 3", found["worker"])
    script = "a script, whose runs can write wherever you may"
    assert found["solver"] == f"{tmp_path / 'solver'}, version 9.9.9; {script}"
    assert found["canary"].startswith("distal/1: ok in ")
    assert found["threads"] == "2 workers with 1 thread each on 2 CPUs"
    assert found["scratch"].startswith("/tmp/sinew-")
    assert not (tmp_path / "out").exists(), "it leaves nothing behind"
    until(lambda: not live(), "the end of its job", 30)


@pytest.mark.takes(8)
def test_a_site_with_allocations_is_examined_by_a_job_of_the_same_kind(tmp_path, slurm_cluster):
    prepare(tmp_path, ALLOCATION)
    good, bad = findings_of(tmp_path)
    assert not bad
    assert good["threads"] == "1 workers with 1 thread each on 1 CPUs"
    assert good["canary"].startswith("distal/1: ok in ")


@pytest.mark.takes(8)
def test_a_solver_that_fails_and_a_cluster_without_tls(tmp_path, slurm_cluster):
    study = prepare(tmp_path, profile_with(tls=False))
    solver = tmp_path / "solver"
    solver.write_text(solver.read_text().replace("stiffness = ", "sys.exit(139); stiffness = "))
    trusted(study)
    _, bad = findings_of(tmp_path)
    assert set(bad) == {"TLS", "canary"}
    assert "a stranger can connect" in bad["TLS"]
    assert "exit code 139" in bad["canary"]


@pytest.mark.takes(8)
def test_a_solver_that_is_not_there(tmp_path, slurm_cluster):
    study = prepare(tmp_path, profile_with())
    (tmp_path / "solver").unlink()
    _, bad = findings_of(tmp_path)
    assert set(bad) == {"solver"}
    assert f"{study}: simulator.executable: " in bad["solver"]


@pytest.mark.takes(8)
def test_jobs_that_do_not_start(tmp_path, slurm_cluster):
    prepare(tmp_path, profile_with(prologue=["echo the module system is away >&2", "exit 3"]))
    _, bad = findings_of(tmp_path)
    assert set(bad) == {"worker"}
    assert "ended before it came to work: the module system is away" in bad["worker"]


@pytest.mark.takes(5)
def test_what_is_bad_is_said_with_exit_code_2(tmp_path, slurm_cluster):
    """Jobs that SLURM refuses."""
    prepare(tmp_path, PROFILE + "partition: nowhere\n")
    said = doctor(tmp_path, expect=2)
    assert said == "sinew: 2 of 8 checks failed: profile, worker\n"
    _, bad = findings_of(tmp_path)
    assert set(bad) == {"profile", "worker"}
    assert "profile.yaml: partition: SLURM refuses the job" in bad["profile"]


def test_an_interface_that_this_machine_does_not_have(tmp_path, slurm_cluster):
    prepare(tmp_path, PROFILE.replace("interface: lo", "interface: ib7"))
    _, bad = findings_of(tmp_path)
    assert "network interface 'ib7' is not on" in bad["worker"]


@pytest.mark.parametrize(
    ("tasks", "rows"),
    [
        ("[sobol]\nsobol: {base_samples: 8}", 3 * 8 * 18),
        ("[sobol, importance]\nsobol: {base_samples: 8, specimens: [distal/1]}", 8 * 18),
        ("[morris]\nmorris: {trajectories: 4}", 3 * 4 * 17),
    ],
)
def test_the_size_of_a_study_is_that_of_its_tasks(tmp_path, tasks, rows):
    specimens, truth = virtual_cohort(seed=1, per_site=1, rate_hz=1.0)
    write_cohort(tmp_path / "cohort", specimens, truth)
    (tmp_path / "study.yaml").write_text(f"name: size\nseed: 1\ncohort: cohort\ntasks: {tasks}\n")
    study = read_study(tmp_path / "study.yaml")
    cohort = cohort_of(study, None)
    found = doctor_module._rows(study, cohort, None, tmp_path)
    assert found.total() == rows
    curves = sum(min(96, curve.force_N.size) for curve in cohort.specimens[0].curves)
    each = curves + doctor_module.OTHER_NUMBERS
    assert doctor_module._numbers(study, cohort, found) == rows * each
