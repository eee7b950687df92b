# Two commands do everything: `make demo` and `make test`. Both set up .venv first; python3 (3.11 or newer), git and
# make are all they need beside the package index.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready

.PHONY: setup demo test test-all check docs wheel audit benchmarks mutants chaos fuzz lock clean

setup: $(READY)

$(READY): requirements.lock pyproject.toml
	$(PYTHON) -c 'import sys; sys.exit(None if sys.version_info >= (3, 11) else "sinew needs Python 3.11 or newer; set PYTHON=python3.11")'
	$(PYTHON) -m venv $(VENV)
	# the lock names all packages that others need: pip need not look for them
	$(BIN)/python -m pip install --quiet --no-deps --no-compile --disable-pip-version-check --require-hashes -r requirements.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation -e .
	$(BIN)/python -m pip check --quiet --disable-pip-version-check
	-$(BIN)/python -m compileall -q -j 0 -x '/tests?/' $(VENV)/lib  # pip compiles on one processor only
	touch $(READY)

demo: $(READY)
	$(BIN)/sinew demo

# several hundred processes import this package: where the environment forbids compiled files, each would compile it anew
test test-all: export PYTHONDONTWRITEBYTECODE :=
# The tests on batch systems wait for jobs now and then. They run beside all others, which leave them what they need:
# they have deadlines.
test test-all: SHELL := /bin/bash
test: CHOSEN := and not thorough
test test-all: $(READY)
	@beside=$$(mktemp); trap 'kill -INT $$(jobs -p) 2>/dev/null; wait; rm -f "$$beside"' EXIT; \
	trap 'exit 130' INT TERM; \
	$(BIN)/python -m pytest -m "slurm $(CHOSEN)" -n 5 --dist load --maxschedchunk 1 tests/tasks/cluster tests/runner/cluster \
		>"$$beside" 2>&1 & slurm=$$!; \
	others=0; nice -n 5 $(BIN)/python -m pytest -m "not slurm $(CHOSEN)" -n 3 --dist worksteal || others=$$?; \
	failed=0; wait $$slurm || failed=$$?; cat "$$beside"; exit $$((others | failed))

# what CI asks of the code beside its tests
check: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

# the site in docs/_build/html; runs the notebooks, and fails for a cell that fails, a link that leads nowhere, a warning
docs: $(READY)
	$(BIN)/python -m sphinx --fail-on-warning --keep-going --quiet -b html docs docs/_build/html
	@echo "open docs/_build/html/index.html"

# the package as it is installed, dist/sinew_fe-VERSION-py3-none-any.whl; what it needs as a list, .cdx.json, and with
# the hashes of all files for pip, .requirements.txt
wheel: $(READY)
	$(BIN)/python -m hatchling build -t wheel -d dist
	$(BIN)/python -m tests.supply sbom dist
	$(BIN)/python -m tests.supply requirements dist

# known vulnerabilities of the locked packages; ADVISORIES is a copy of the OSV database, for where there is no network
audit: $(READY)
	$(BIN)/python -m tests.supply audit $(ADVISORIES)

benchmarks: $(READY)
	$(BIN)/python -m tests.benchmarks

# damaged files of every kind for MINUTES; what breaks something is kept in tests/fuzz/corpus
fuzz: $(READY)
	nice -n 10 $(BIN)/python -m tests.fuzz --minutes $(or $(MINUTES),30)

# breaks the code in small ways and counts what the tests notice; OF names targets of tests/mutants/targets.toml, SAMPLE
# how many mutants of each, drawn at random
mutants: $(READY)
	nice -n 10 $(BIN)/python -m tests.mutants $(OF) $(if $(SAMPLE),--sample $(SAMPLE))

# kills a small study of all tasks at random for so many minutes, and looks at what is left
MINUTES ?= 5
chaos: $(READY)
	nice -n 5 $(BIN)/python -m tests.chaos --minutes $(MINUTES)

lock:
	uv pip compile pyproject.toml --extra dev --universal --python-version 3.11 --generate-hashes \
	  --no-emit-index-url --custom-compile-command "make lock" -o requirements.lock --upgrade

clean:
	rm -rf $(VENV) results .mutants docs/_build .pytest_cache .mypy_cache .ruff_cache .hypothesis
