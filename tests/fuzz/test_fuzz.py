"""Whatever stands in a file, the command reads it or refuses it in one line: 2,000 damaged files of all kinds."""

from collections.abc import Callable, Iterator
from pathlib import Path
from random import Random
from typing import Any

import pytest

from tests.fuzz.limits import Broken, attempt
from tests.fuzz.mutations import mutated
from tests.fuzz.targets import Target, corpus, targets

INPUTS = 2000
CORPUS = Path(__file__).parent / "corpus"
NAMES = ("study", "profile", "cohort", "export", "parameters", "template", "output", "plot file", "kept runs",
         "checkpoint", "results", "result folder")  # fmt: skip


@pytest.fixture(scope="module", autouse=True)
def _without_threads() -> Iterator[None]:
    """Zarr reads each file in a thread of its own; the same calls in the thread of its loop take a quarter less."""

    async def here(function: Callable[..., Any], *arguments: Any, **named: Any) -> Any:
        return function(*arguments, **named)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("asyncio.to_thread", here)
        yield


@pytest.fixture(scope="module")
def every(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Target]:
    return targets(tmp_path_factory.mktemp("fuzz"))


def test_each_target_is_listed(every):
    assert tuple(every) == NAMES


@pytest.mark.parametrize("name", NAMES)
def test_valid_files_are_read(every, name):
    for seed in every[name].seeds:
        attempt(every[name], seed, every[name].files[seed])


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
    def endless(*_):
        while True:
            pass

    for read, words in ((lambda *_: [0] * 2**28, "traceback: MemoryError"), (lambda *_: {}[1], "traceback: KeyError")):
        with pytest.raises(Broken, match=words):
            attempt(Target("x", {"a": b""}, read), "a", b"")
    with pytest.MonkeyPatch.context() as patch, pytest.raises(Broken, match="longer than"):
        patch.setattr("tests.fuzz.limits.SLOWER", 0.1)
        attempt(Target("x", {"a": b""}, endless), "a", b"")
