"""Whatever stands in a file, the command reads it or refuses it in one line: 2,000 damaged files of all kinds."""

import threading
from pathlib import Path
from random import Random

import pytest

from tests.fuzz import limits
from tests.fuzz.limits import Broken, attempt, written
from tests.fuzz.mutations import mutated
from tests.fuzz.targets import Target, corpus, targets

INPUTS = 2000
CORPUS = Path(__file__).parent / "corpus"
NAMES = ("study", "profile", "cohort", "export", "parameters", "template", "output", "plot file", "kept runs",
         "checkpoint", "results", "model", "ranges", "answers", "hidden effects", "workbook",
         "result folder")  # fmt: skip


@pytest.fixture(scope="module")
def every(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Target]:
    return targets(tmp_path_factory.mktemp("fuzz"))


def test_each_target_is_listed(every):
    assert tuple(every) == NAMES


@pytest.mark.parametrize("name", NAMES)
def test_valid_files_are_read(every, name):
    """To the end: damage to what is refused anyway would show nothing."""
    target = every[name]
    for seed in target.seeds[:1] if target.whole else target.seeds:
        with written(target.files) as folder:
            target.read(folder, folder / seed)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.filterwarnings("ignore")
def test_damaged_files_are_read_or_refused(every, name):
    target = every[name]
    count = INPUTS * target.share // sum(one.share for one in every.values())
    for number in range(count):  # the same in every run, whatever else this process has imported
        random = Random(number)
        seed = random.choice(target.seeds)
        try:
            attempt(target, seed, mutated(target.files[seed], random))
        except Broken as broken:
            raise AssertionError(f"{seed}, number {number}: {broken}") from broken


@pytest.mark.parametrize(
    ("name", "file", "content"), [pytest.param(*one, id=f"{one[0]}-{i}") for i, one in enumerate(corpus(CORPUS))]
)
@pytest.mark.filterwarnings("ignore")
def test_what_was_found_stays_mended(every, name, file, content):
    attempt(every[name], file, content)


def test_what_breaks_a_limit_is_seen(every):
    for read, words in ((lambda *_: [0] * 2**28, "traceback: MemoryError"), (lambda *_: {}[1], "traceback: KeyError")):
        with pytest.raises(Broken, match=words):
            attempt(Target("x", {"a": b""}, read), "a", b"")


def endless(*_: object) -> None:
    while True:
        pass


@pytest.mark.parametrize(
    ("bound", "read", "words"),
    [
        ("SECONDS", endless, "longer than 0.2 s of a processor"),
        ("WALL_S", lambda *_: threading.Event().wait(), "longer than 0.2 s"),
    ],
)
def test_what_does_not_end_is_seen(monkeypatch, bound, read, words):
    """Work is bounded by processor time, which does not depend on what else runs here; waiting by the clock."""
    assert limits.SECONDS == 10
    monkeypatch.setattr(limits, bound, 0.2)
    with pytest.raises(Broken, match=f"^{words}$"):
        attempt(Target("x", {"a": b""}, read), "a", b"")
