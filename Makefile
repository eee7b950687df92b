# Two commands do everything: `make demo` and `make test`. Both set up .venv first; python3 (3.11 or newer), git and
# make are all they need beside the package index.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready

.PHONY: setup demo test check docs benchmarks lock clean

setup: $(READY)

$(READY): requirements.lock pyproject.toml
	$(PYTHON) -c 'import sys; sys.exit(None if sys.version_info >= (3, 11) else "sinew needs Python 3.11 or newer; set PYTHON=python3.11")'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes -r requirements.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation -e .
	touch $(READY)

demo: $(READY)
	test -d results/demo-cohort || $(BIN)/sinew cohort --out results/demo-cohort --per-site 1 --seed 2503
	$(BIN)/sinew run configs/demo.yaml
	test -d results/hidden-cohort || $(BIN)/sinew cohort --out results/hidden-cohort --per-site 1 --rate 10 --seed 2503 --effect toe-slack
	$(BIN)/sinew run configs/hidden.yaml

test: $(READY)
	$(BIN)/python -m pytest -m "not slurm" -n 2 --dist worksteal
	$(BIN)/python -m pytest -m slurm -n 3 --dist worksteal

# what CI asks of the code beside its tests
check: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

# the site in docs/_build/html; runs the notebooks, and fails for a cell that fails, a link that leads nowhere, a warning
docs: $(READY)
	$(BIN)/python -m sphinx --fail-on-warning --keep-going --quiet -b html docs docs/_build/html
	@echo "open docs/_build/html/index.html"

benchmarks: $(READY)
	$(BIN)/python -m tests.benchmarks

lock:
	uv pip compile pyproject.toml --extra dev --universal --python-version 3.11 --generate-hashes \
	  --no-emit-index-url --custom-compile-command "make lock" -o requirements.lock --upgrade

clean:
	rm -rf $(VENV) results docs/_build .pytest_cache .mypy_cache .ruff_cache .hypothesis
