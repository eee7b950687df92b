"""What a batch keeps for the case of an interruption is gone with its outcomes, and stays without them."""

import pytest

from sinew.runner.evaluation.interim import keep_until_written, kept_until_written


def test_files_are_removed_when_the_outcomes_are_written(tmp_path):
    file = tmp_path / "a"
    with kept_until_written():
        assert keep_until_written(file)
        assert keep_until_written(tmp_path / "never written")
        file.write_text("x")
    assert not file.exists()


def test_files_stay_when_the_batch_is_interrupted(tmp_path):
    file = tmp_path / "a"
    with pytest.raises(KeyboardInterrupt), kept_until_written():
        keep_until_written(file)
        file.write_text("x")
        raise KeyboardInterrupt
    assert file.read_text() == "x"
    with kept_until_written():
        pass
    assert file.exists(), "another batch removes its own files only"


def test_outside_of_a_batch_nothing_is_kept(tmp_path):
    assert not keep_until_written(tmp_path / "a")
