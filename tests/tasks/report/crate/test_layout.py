"""Where things lie in a crate, and what the study file says there."""

from dataclasses import replace
from pathlib import Path

import pytest
import yaml

from sinew.runner.errors import BadInput
from sinew.tasks.report.crate.layout import changed_fields, layout_of, with_fields
from sinew.tasks.report.crate.source import Source, read_source
from sinew.tasks.study.settings_file import as_yaml, from_yaml


def at(source: Source, study: Path, cohort: Path, out: Path) -> Source:
    """The same, lying elsewhere."""
    moved = source.study.model_copy()
    moved._path = study
    return replace(
        source, study=moved, cohort=replace(source.cohort, folder=cohort), found=replace(source.found, folder=out)
    )


@pytest.fixture(scope="module")
def source(whole_run: Path) -> Source:
    return read_source(whole_run)


@pytest.mark.parametrize(
    ("study", "cohort", "out", "places"),
    [
        ("/x/study.yaml", "/x/cohort", "/x/out", ("study.yaml", "cohort", "out")),
        ("/x/a/study.yaml", "/x/a/cohort", "/x/results/a", ("a/study.yaml", "a/cohort", "results/a")),
        ("/x/study.yaml", "/x/my cohort", "/x/out", ("study.yaml", "cohort", "results")),
        ("/x/study.yaml", "/x/tables", "/x/out", ("study.yaml", "cohort", "results")),
        ("/home/me/study.yaml", "/scratch/a/b/c/cohort", "/x/out", ("study.yaml", "cohort", "results")),
    ],
)
def test_places_are_kept_where_they_can_be(source, study, cohort, out, places):
    layout = layout_of(at(source, Path(study), Path(cohort), Path(out)))
    assert (str(layout.study), str(layout.cohort), str(layout.results)) == places
    assert layout.kept == (places[-1] != "results")
    assert layout.again.parent == layout.results.parent


def test_a_study_that_needs_no_change_keeps_its_bytes(source):
    assert changed_fields(source, layout_of(source)) == {}
    assert with_fields(source.study.text, {}) == source.study.text


def test_options_of_the_run_and_paths_come_into_the_study(source):
    far = at(source, Path("/home/me/study.yaml"), Path("/data/a/b/c/tails"), Path("/x/out"))
    far = replace(far, run={**far.run, "seed": 8, "simulator": "febio"})
    assert changed_fields(far, layout_of(far)) == {"seed": 8, "simulator": "febio"}, "it says `cohort: cohort` already"
    other = far.study.model_copy(update={"cohort": "/data/a/b/c/tails"})
    other._path = far.study.path
    assert changed_fields(replace(far, study=other), layout_of(far))["cohort"] == "cohort"


@pytest.mark.parametrize(
    ("cluster", "changed"),
    [
        ("{name: address, address: 'tls://lab.example:8786'}", True),
        ("slurm", True),
        ("{name: local, tls: false}", True),
        ("{name: local, workers: 3}", False),
    ],
)
def test_no_address_and_no_cluster_goes_out(source, cluster, changed):
    kind = type(source.study)
    study = kind.model_validate({"name": "x", "cohort": "cohort", "cluster": yaml.safe_load(cluster)})
    study._path, study._text = source.study.path, source.study.text
    found = changed_fields(replace(source, study=study), layout_of(source))
    assert found.get("cluster") == ("local" if changed else None)


def test_a_template_with_an_absolute_path_is_refused(source):
    simulator = {"name": "febio", "template": "/home/me/tendon.feb"}
    study = type(source.study).model_validate({"name": "x", "cohort": "cohort", "simulator": simulator})
    study._path, study._text = source.study.path, source.study.text
    with pytest.raises(BadInput, match="a path below the study's folder"):
        changed_fields(replace(source, study=study), layout_of(source))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("name: a\ncohort: /far/off  # ours\nseed: 1\n", 'name: a\ncohort: "here"  # ours\nseed: 1\n'),
        ("# first\nname: a\nseed: 1\n", '# first\ncohort: "here"\nname: a\nseed: 1\n'),
        ("name: a\ncohort:\n  /far/off\n", 'name: a\ncohort:\n  "here"\n'),
        ("name: a\ncohort:\n", 'name: a\ncohort: "here"\n'),
        ("{name: a, cohort: b}\n", '{name: a, cohort: "here"}\n'),
        ("{name: a}\n", '{cohort: "here", name: a}\n'),
        ("  name: a\n  seed: 1\n", '  cohort: "here"\n  name: a\n  seed: 1\n'),
        ("cohort: >\n  far\n  off\nname: a\n", 'cohort: "here"\nname: a\n'),
    ],
)
def test_a_field_is_replaced_in_whatever_form_it_has(text, expected):
    assert with_fields(text, {"cohort": "here"}) == expected
    assert yaml.safe_load(expected)["cohort"] == "here"


def test_numbers_and_texts_stay_what_they_are():
    """Where the whole file is written anew, ``1e3`` is no text and ``no`` is no truth value."""
    text = "{name: no,\n cohort: &where there,\n calibrate: {evaluations: 1e3}, measured: {force: {noise: 1e-3}}}\n"
    assert from_yaml(as_yaml(from_yaml(text))) == from_yaml(text)
    odd = "? cohort\n: there\nname: no\nmeasured: {force: {noise: 1e-3}}\n"
    changed = from_yaml(with_fields(odd, {"cohort": "here"}))
    assert changed == {"cohort": "here", "name": "no", "measured": {"force": {"noise": 0.001}}}


def test_a_section_is_replaced_with_all_that_is_in_it():
    text = "cluster:\n  name: address\n  address: tls://lab:1\n# the tasks\ntasks: [sobol]\n"
    assert yaml.safe_load(with_fields(text, {"cluster": "local"})) == {"cluster": "local", "tasks": ["sobol"]}
    assert "lab" not in with_fields(text, {"cluster": "local"})
