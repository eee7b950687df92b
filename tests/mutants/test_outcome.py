"""What is counted as killed, and which survivors have a reason."""

from tests.mutants.outcome import drawn, outcome, row, survivors, table, unlisted

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
    found = outcome("units", CODES, of=7)
    assert (found.killed, found.timed_out, found.survived, found.untested) == (3, 1, 2, 1)
    assert survivors(CODES) == ["e", "f"]


def test_killed_are_those_that_fail_and_those_that_never_end():
    found = outcome("units", CODES, of=7)
    assert round(found.percent, 1) == 57.1
    assert table([found]).splitlines()[-1].split() == [
        *["units", "7", "7", "3", "1", "2", "1", "57.1", "%", "57.1", "to", "57.1"]
    ]


def test_a_sample_says_how_sure_it_is():
    found = outcome("units", {str(i): int(i > 0) for i in range(100)}, of=2000)
    assert found.percent == 99.0
    assert [round(side, 2) for side in found.interval] == [94.55, 99.97]


def test_a_larger_sample_holds_a_smaller_one():
    names = [f"mutant {i}" for i in range(50)]
    assert drawn(names, None) == sorted(names)
    assert drawn(names, 20)[:10] == drawn(reversed(names), 10)
    assert drawn(names, 10) != sorted(names)[:10]
    assert sorted(drawn(names, 99)) == sorted(names)


def test_a_survivor_is_listed_by_what_it_changes():
    assert row(DIFF) == "| tasks/data/units.py | `return a \\| b` → `return a & b` |"
    assert unlisted([row(DIFF)], "") == [row(DIFF)]
    assert unlisted([row(DIFF)], f"{row(DIFF)} both are bits |\n") == []
