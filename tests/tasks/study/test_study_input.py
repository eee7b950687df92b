"""Whatever stands in a study file, it is read as a study or refused in one line."""

import json
import math
from collections.abc import Iterator
from typing import Any

import pytest
import yaml
from hypothesis import example, given
from hypothesis import strategies as st

from sinew.runner.errors import BadInput
from sinew.tasks.model import TENDON
from sinew.tasks.study.model import model_of
from sinew.tasks.study.study import Study, read_study
from tests.tasks.cli.bad_input import STUDY
from tests.tasks.inputs import NUMBERS, mutated, quick, read_or_refuse


def read_study_or_refuse(text: str | bytes) -> Study | None:
    return read_or_refuse(read_study, "study.yaml", files={"study.yaml": text})


YAML_PIECES = (
    "name: a\n|seed: |sobol: |points|: |- |  |\n|{|}|[|]|, |'|\"|#|>\n|!!int |!!float |!!bool |!!timestamp |!!binary "
    "|!!set |!!omap |!!str |!x |&a |*a|<<: |? |---\n|...\n|%YAML 1.1\n|0x|0b|1:60|1e3|.nan|-.inf|null|~|yes|\t|\0|\x85|"
    "\u2028|\\ud800|=|@|`|%|1|_|2001-01-01|febio|model: "
)


@quick
@given(st.text() | st.lists(st.sampled_from(YAML_PIECES.split("|")), max_size=12).map("".join))
@example("name: !!timestamp x")
@example("name: !!bool x")
@example("name: !!int ''")
@example("name: !!float ''")
@example("name: a\nseed: 0x" + "f" * 5000)
@example('name: "\\ud800"')
@example('"\\ud800": a')
def test_any_text_as_study(text):
    study = read_study_or_refuse(text)
    assert study is None or len(model_of(study.model, study.simulator.law).names) == len(TENDON)


@quick
@given(st.binary() | mutated(yaml.safe_dump(STUDY)))
def test_any_bytes_as_study(content):
    read_study_or_refuse(content)


SCALARS = st.none() | st.booleans() | NUMBERS | st.text(max_size=8) | st.dates() | st.binary(max_size=4)
WORDS = st.sampled_from(["febio", "uniaxial", "local", "address", "all", "sobol", "importance", "s01", "MPa", "name"])
VALUES = st.recursive(
    SCALARS | WORDS,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4) | WORDS, inner, max_size=3),
    max_leaves=4,
)


def places(section: Any, place: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    if place:
        yield place
    for key in section if isinstance(section, dict) else range(len(section)) if isinstance(section, list) else ():
        yield from places(section[key], (*place, key))


@quick
@given(st.lists(st.tuples(st.sampled_from(list(places(STUDY))), st.none() | st.text(max_size=5), VALUES), max_size=3))
def test_mutated_study(mutations):
    study = json.loads(json.dumps(STUDY))
    for place, new_name, value in mutations:
        section = study
        for key in place[:-1]:
            if isinstance(section, dict) and key in section and isinstance(section[key], dict):
                section = section[key]
        section[place[-1] if new_name is None else new_name] = value
    read = read_study_or_refuse(yaml.safe_dump(study, allow_unicode=True))
    assert mutations or read is not None
    if read is not None:
        assert all(
            math.isfinite(p.minimum) and p.minimum <= p.reference <= p.maximum
            for p in model_of(read.model, read.simulator.law).parameters
        )
        assert read.seed in range(2**32)


def refusal(text: str, tmp_path) -> str:
    path = tmp_path / "study.yaml"
    path.write_text(text)
    with pytest.raises(BadInput) as error:
        read_study(path)
    return str(error.value)


def test_numbers_of_thousands_of_digits_are_texts(tmp_path):
    """Python cannot print such integers, and fails where nobody catches it."""
    for number in ("0x" + "f" * 20_000, "9" * 20_000, "0b" + "1" * 20_000):
        assert "seed" in refusal(f"name: a\nseed: {number}\n", tmp_path)


def test_values_without_end_are_refused_before_they_are_judged(tmp_path):
    assert "more than 20,000 values" in refusal(f"name: a\ntasks: [{'a,' * 20_001}]\n", tmp_path)


def test_points_of_all_histories_are_bounded(tmp_path):
    history = "{time_s: [0, 1], displacement_mm: [0, 1], points: 1000000}"
    (tmp_path / "bar.feb").write_text("<febio_spec/>")
    outputs = "{x: {data: node_data, item: ux, set: a, unit: mm}}"
    study = f"name: a\nsimulator: {{name: template, file: bar.feb, outputs: {outputs}}}\n"
    study += "model: {parameters: {E: {min: 1, max: 2, unit: MPa}}}\nprotocols:\n"
    histories = "".join(f"  p{i}: {history}\n" for i in range(3))
    assert "more than 2,000,000 points in all" in refusal(study + histories, tmp_path)
