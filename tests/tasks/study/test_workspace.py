"""Folders of workers that were killed are gone before a run and after it; work in this process shows its progress."""

import logging
from pathlib import Path

from sinew.runner.cluster.local import Local
from sinew.runner.progress import read_progress
from sinew.tasks.study.study import read_study
from sinew.tasks.study.workspace import open_workspace
from tests.tasks.measured import study_of, write_measured
from tests.tasks.stand_in import prepare


def test_folders_that_killed_workers_left_are_removed_before_a_run_and_after_it(tmp_path):
    study, cohort, _ = prepare(tmp_path)
    out = tmp_path / "out"
    left = [out / "attempts" / "attempt-1" / "model.feb", out / ".workers" / "dask-scratch-space" / "global.lock"]
    kept = out / "attempts" / "failed-crashed-2" / "failure.json"

    def leave(paths: list[Path]) -> None:
        for path in paths:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.touch()

    def folders() -> set[str]:
        return {path.relative_to(out).as_posix() for path in out.rglob("*") if path.is_dir()}

    leave([*left, kept])
    gone = {"attempts/attempt-1", ".workers", ".workers/dask-scratch-space"}
    assert gone < folders()
    with open_workspace(read_study(study), data=cohort, out=out, cluster=Local(1), quiet=True):
        assert not gone & folders()
        leave(left)
    assert not gone & folders()
    assert kept.exists()


def test_work_in_this_process_is_counted_and_shown_while_it_goes_on(tmp_path):
    study, cohort, _ = prepare(tmp_path)
    seen = []
    opened = open_workspace(read_study(study), data=cohort, out=tmp_path / "out", cluster=Local(1), quiet=True)
    with opened as workspace:

        def double(number: int) -> int:
            workspace.board.write()
            facts = read_progress(tmp_path / "out")
            seen.append((facts["title"], facts["of"], facts["done"], facts["total"]))
            return 2 * number

        assert workspace.each("importance", "forests", double, {"a": 1, "b": 2}) == {"a": 2, "b": 4}
        assert workspace.each("importance for outputs", "forests", double, {}) == {}
        assert workspace.counted == {}
    assert seen == [("importance", "forests", 0, 2), ("importance", "forests", 1, 2)]


def test_a_parameter_that_a_quantity_beside_the_force_sees_is_not_told_as_unseen(tmp_path):
    write_measured(tmp_path, rate_hz=2.0)
    for compared, seen in (("measured: {force: {}, lateral_strain: {}}", True), ("", False)):
        study = read_study(study_of(tmp_path, "", compared))
        with open_workspace(study, out=tmp_path / "out", cluster=Local(1)) as workspace:
            assert ("nu_m" in workspace.ranges.unseen) == (not seen), "the lateral strain sees it"


def test_after_a_run_messages_go_where_they_went_before(tmp_path, caplog):
    study, cohort, _ = prepare(tmp_path)
    logger = logging.getLogger("sinew")
    level = logger.level
    logger.propagate = True  # whatever ran in this process before
    with open_workspace(read_study(study), data=cohort, out=tmp_path / "out", cluster=Local(1), quiet=True):
        logger.warning("during the run")
    logger.warning("after it")
    assert [record.message for record in caplog.records] == ["after it"]
    assert logger.level == level
