"""The study with the named effects is the former one and these; its numbers and words are read back as they were."""

from pathlib import Path
from types import SimpleNamespace

from sinew.tasks.discover.after.added import study_with
from sinew.tasks.discover.result import WITH_EFFECTS
from sinew.tasks.model.effects import named
from sinew.tasks.study.study import read_study

STUDY = """name: no
seed: 3
cohort: cohort
tasks: [discover]
measured: {force: {noise: 1e-1}, lateral_strain: {noise: 1e-3}}
"""


def workspace_of(study, folder, simulator="uniaxial"):
    (folder / "out").mkdir()
    cohort, simulator = SimpleNamespace(folder=folder / "cohort"), SimpleNamespace(name=simulator)
    return SimpleNamespace(out=folder / "out", study=study, cohort=cohort, simulator=simulator)


def test_numbers_and_texts_stay_what_they_are(tmp_path):
    (tmp_path / "study.yaml").write_text(STUDY)
    study = read_study(tmp_path / "study.yaml")
    workspace = workspace_of(study, tmp_path)
    path, difference = study_with(workspace, (named()["toe-slack"],))
    assert Path(path) == Path(WITH_EFFECTS)
    new = read_study(tmp_path / "out" / path)
    assert (new.name, new.measured) == (study.name, study.measured)
    assert new.model.effects == ["toe-slack"]
    changed = [line for line in difference.splitlines() if line[0] in "+-" and line[:3] not in ("+++", "---")]
    assert changed == ["-cohort: cohort", "+cohort: ../../cohort", "+model:", "+  effects:", "+  - toe-slack"]


def test_the_study_is_that_which_was_judged(tmp_path):
    (tmp_path / "study.yaml").write_text(STUDY)
    study = read_study(tmp_path / "study.yaml")
    (tmp_path / "study.yaml").write_text("seed: 9")
    workspace = workspace_of(study, tmp_path)
    path, _ = study_with(workspace, (named()["toe-slack"],))
    assert read_study(tmp_path / "out" / path).seed == 3


def test_what_options_of_the_command_replaced_is_in_the_study(tmp_path):
    (tmp_path / "study.yaml").write_text("name: no\nseed: 3\ncohort: cohort\ntasks: [discover]\n")
    workspace = workspace_of(read_study(tmp_path / "study.yaml", seed=9), tmp_path, simulator="febio")
    path, difference = study_with(workspace, (named()["toe-slack"],))
    new = read_study(tmp_path / "out" / path)
    assert (new.seed, new.simulator.name) == (9, "febio")
    assert "+seed: 9" in difference and "+simulator: febio" in difference
