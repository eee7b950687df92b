"""The studies of ``sinew demo``."""

from sinew.tasks.data.cohort import read_cohort
from sinew.tasks.data.demo import DEMOS, demo_studies
from sinew.tasks.study.study import read_study


def test_the_studies_find_their_specimens_wherever_they_are(tmp_path):
    studies = demo_studies(tmp_path / "here")
    assert [read_study(path).name for path in studies] == [demo.name for demo in DEMOS] == ["demo", "hidden", "partly"]
    for path in studies:
        study = read_study(path)
        assert study.cohort_path == tmp_path / "here" / f"{study.name}-cohort"
        assert [one.name for one in read_cohort(study.cohort_path).specimens] == ["distal/1", "middle/1", "proximal/1"]


def test_what_is_there_stays(tmp_path):
    first, *_ = demo_studies(tmp_path)
    first.write_text("name: mine\ncohort: demo-cohort\n")
    assert demo_studies(tmp_path)[0].read_text() == "name: mine\ncohort: demo-cohort\n"
