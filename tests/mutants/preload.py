"""A plugin of pytest that imports what `tests/conftest.py` needs, once, before mutmut forks for each mutant."""

import sinew.tasks.study.pipeline  # noqa: F401
