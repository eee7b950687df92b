"""A function without its decorators is what it was, and mutmut finds it."""

import textwrap

from tests.mutants.decorators import without_decorators


def rewritten(source: str) -> str:
    return without_decorators(textwrap.dedent(source))


def test_a_property_and_a_context_manager_still_work():
    namespace: dict = {}
    source = """
        from contextlib import contextmanager
        class Box:
            @property
            def size(self):
                return 3
            @staticmethod
            @contextmanager
            def opened():
                yield 4
        """
    found = rewritten(source)
    exec(found, namespace)
    assert "@" not in found
    assert namespace["Box"]().size == 3
    with namespace["Box"].opened() as content:
        assert content == 4


def test_what_mutmut_knows_or_nobody_knows_is_left():
    source = """
        class Box:
            @staticmethod
            def make():
                return 1
            @validator("x")
            def check(self):
                return 2
        """
    assert rewritten(source) == textwrap.dedent(source)
