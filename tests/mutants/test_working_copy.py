"""Targets name files and tests that are there."""

import pytest

from tests.mutants.working_copy import ROOT, Target, targets


@pytest.mark.parametrize("target", targets().values(), ids=lambda target: target.name)
def test_a_target_names_what_is_there(target: Target):
    for pattern in target.mutate:
        assert list((ROOT / "sinew").glob(pattern)), pattern
    for test in target.tests:
        path, _, name = test.removeprefix("--deselect=").partition("::")
        assert (ROOT / path).exists(), path
        assert not name or f"def {name}(" in (ROOT / path).read_text(), name
