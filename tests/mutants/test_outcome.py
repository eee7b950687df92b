"""What is counted as killed, and which survivors have a reason."""

from tests.mutants.outcome import outcome, row, survivors, table, unlisted

DIFF = """# sinew.tasks.data.units.x_scale__mutmut_3
--- sinew/tasks/data/units.py
+++ sinew/tasks/data/units.py
@@ -1,3 +1,3 @@
 def scale(unit):
-    return a | b
+    return a & b
"""
CODES = {"a": 1, "b": 1, "c": 3, "d": -24, "e": 0, "f": 33, "g": None}


def test_a_mutant_that_no_test_runs_has_survived():
    found = outcome("units", CODES)
    assert (found.killed, found.timed_out, found.survived, found.untested) == (3, 1, 2, 1)
    assert survivors(CODES) == ["e", "f"]


def test_killed_are_those_that_fail_and_those_that_never_end():
    found = outcome("units", CODES)
    assert round(found.percent, 1) == 57.1
    assert table([found]).splitlines()[-1].split() == ["units", "7", "3", "1", "2", "1", "57.1", "%"]


def test_a_survivor_is_listed_by_what_it_changes():
    assert row(DIFF) == "| tasks/data/units.py | `return a \\| b` → `return a & b` |"
    assert unlisted([row(DIFF)], "") == [row(DIFF)]
    assert unlisted([row(DIFF)], f"{row(DIFF)} both are bits |\n") == []
