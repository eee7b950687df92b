"""`sinew export` refuses what is wrong in one line, before anything is written."""

import pytest


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("nowhere", "--ro-crate"), ("nowhere: is not there", "expected a result folder")),
        (("cohort", "--ro-crate"), ("cohort: holds no store.zarr, log.jsonl or result", "expected a result folder")),
        (("study.yaml", "--ro-crate"), ("study.yaml: is a file", "expected a result folder")),
        (("cohort",), ("Missing option '--ro-crate'", "`sinew export --help` says more")),
        (
            ("cohort", "--ro-crate", "--out", "rows.csv"),
            ("--out rows.csv: is there already", "expected a name that is"),
        ),
        (("cohort", "--ro-crate", "--out", "no/where.zip"), ("--out no/where.zip: its folder is not there",)),
        (("cohort", "--ro-crate", "--license", "my own"), ("--license: 'my own'", "expected an SPDX name such as")),
        (("cohort", "--ro-crate", "--author", " "), ("--author: ' '", 'expected "NAME" or')),
        (("cohort", "--ro-crate", "--author", "A <0000-0002-1825>"), ("--author: 'A <0000-0002-1825>'",)),
        (("cohort", "--ro-crate", "--author", "A\x1b[31m"), ("--author: 'A\\x1b[31m'",)),
    ],
    ids=lambda value: " ".join(value[1:3]) or value[0] if isinstance(value, tuple) else None,
)
def test_what_cannot_be_exported_is_refused(refused, words, told):
    refused(("export", *words), *told)
