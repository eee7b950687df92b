"""The commands of a crate's README repeat the runs of the log in their order."""

from dataclasses import replace

import pytest

from sinew.tasks.report.crate import environment
from sinew.tasks.report.crate.layout import layout_of
from sinew.tasks.report.crate.methods import methods
from sinew.tasks.report.crate.readme import commands, readme
from sinew.tasks.report.crate.source import Source, read_source


@pytest.fixture(scope="module")
def source(whole_run) -> Source:
    return read_source(whole_run)


def ran(source: Source, *runs: object) -> list[str]:
    """The commands for a log with these runs, without the comparisons; a number is the base samples of a run."""
    events = [
        {"message": "sobol", "base_samples": one} if isinstance(one, int) else {"message": "run started", "tasks": one}
        for one in runs
    ]
    said = commands(replace(source, found=replace(source.found, events=events)), layout_of(source))
    return [
        line.removeprefix("sinew ").replace(" study.yaml --out out-again", "") for line in said if line[:3] != "cmp"
    ]


def test_a_run_of_the_whole_study(source):
    whole = source.study.tasks
    assert ran(source, whole) == ["run"]
    assert ran(source, whole, whole) == ["run"], "it was interrupted, or repeated"


def test_single_tasks_come_in_their_order(source):
    assert ran(source, ["calibrate"], source.study.tasks) == ["calibrate", "run"]
    assert ran(source, ["sobol", "discover"], ["calibrate"]) == ["sobol", "discover", "calibrate"]


def test_what_left_no_result_is_passed_over(source):
    assert ran(source, ["morris"], ["sobol"], "no list", [{}]) == ["sobol"]


def test_base_samples_that_were_doubled_are_doubled_again(source):
    assert ran(source, ["sobol"], 4, ["calibrate"], ["sobol"], 8, ["sobol"], 8, ["sobol"], 16) == [
        "sobol", "calibrate", "sobol --extend", "sobol --extend",
    ]  # fmt: skip
    assert ran(source, ["sobol"], 4, ["sobol"], 8, ["sobol"], 4) == ["sobol", "sobol --extend", "sobol"]


def test_what_was_made_from_a_smaller_design_is_made_again_where_it_was(source):
    assert ran(source, ["sobol"], 4, ["importance"], ["sobol"], 8) == ["sobol", "importance", "sobol --extend"]
    assert ran(source, ["sobol"], 4, ["importance"], ["sobol"], 8, ["importance"]) == [
        "sobol", "importance", "sobol --extend", "importance",
    ]  # fmt: skip


def test_the_path_of_a_verdict_that_moved_is_not_compared(source):
    discovery = source.found.results["discover"]
    named = replace(discovery, model=object())
    moved = replace(source, found=replace(source.found, results={**source.found.results, "discover": named}))
    layout = layout_of(source)
    assert "cmp out/discover.json out-again/discover.json" in commands(moved, layout)
    apart = replace(layout, kept=False)
    assert not [line for line in commands(moved, apart) if "discover.json" in line]
    assert "is not compared" in readme(moved, apart, store=False).decode()


def test_results_with_the_named_effect_are_made_and_compared_too(run_folder, whole_run):
    (run_folder / "adopted").mkdir()
    (run_folder / "adopted" / "sobol.json").write_bytes((run_folder / "sobol.json").read_bytes())
    source = read_source(run_folder, whole_run.parent / "study.yaml", whole_run.parent / "cohort")
    first, *others = commands(source, layout_of(source))
    assert first.startswith("sinew run ") and first.endswith(" --adopt")
    assert others[-1].startswith("cmp ") and others[-1].endswith("out-again/adopted/sobol.json")


def test_what_a_log_names_as_versions_is_neither_installed_nor_shown(source):
    packages = {"numpy": "2.0.0", "evil-package": "6.6.6", "sci-py": "1.0; curl x"}
    said = replace(source, run={**source.run, "packages": packages, "python": '3"><script>', "version": "0.1`x`"})
    assert environment.direct(said.run) == {"numpy": "2.0.0"}
    assert b"evil" not in environment.requirements(said)
    for text in (readme(said, layout_of(source), store=False), methods(said), environment.requirements(said)):
        assert b"<script" not in text
        assert b"0.1`x`" not in text
