"""The hash of the template that a study brings."""

import shutil
from pathlib import Path

from sinew.tasks.study.own_template import template_hash, template_texts
from sinew.tasks.study.study import read_study

CONFIGS = Path(__file__).parents[3] / "configs"


def test_the_hash_is_that_of_the_files_which_a_run_reads(tmp_path):
    shutil.copytree(CONFIGS / "dogbone", tmp_path / "dogbone")
    shutil.copy(CONFIGS / "dogbone.yaml", tmp_path / "dogbone.yaml")
    study = read_study(tmp_path / "dogbone.yaml")
    before = template_hash(study, "template")
    assert before == template_hash(study, "template") != ""
    own = tmp_path / "dogbone" / next(iter(template_texts(study)))
    own.write_text(own.read_text() + "<!-- another -->\n")
    assert template_hash(study, "template") not in ("", before)
    shutil.rmtree(tmp_path / "dogbone")
    assert template_hash(study, "uniaxial") == "", "a run by another simulator does not read them"


def test_a_study_without_files_of_its_own_has_none(tmp_path):
    study = tmp_path / "study.yaml"
    study.write_text("name: s\n")
    assert template_hash(read_study(study), "uniaxial") == ""
