# Two commands on a fresh machine: `make tables` runs the main job, `make test` the tests. Both set themselves up first.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
INSTALLED := $(VENV)/.installed
SNAKEMAKE := $(BIN)/snakemake

.PHONY: tables toy results test lint format clean-toy setup

tables: $(INSTALLED)
	$(SNAKEMAKE)

toy: $(INSTALLED)
	$(SNAKEMAKE) --directory toy --config preset=toy

results: $(INSTALLED)
	$(SNAKEMAKE) benchmarks/RESULTS.md

test: lint
	$(BIN)/python -m pytest tests/unit
	$(BIN)/python -m pytest tests/rules
	$(BIN)/python -m pytest tests/e2e

lint: $(INSTALLED)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/snakefmt --check Snakefile rules
	$(SNAKEMAKE) --lint

format: $(INSTALLED)
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .
	$(BIN)/snakefmt Snakefile rules

clean-toy:
	rm -rf toy

setup: $(INSTALLED)

# A half-made environment has no stamp, so that the next call finishes it.
$(INSTALLED): requirements.lock pyproject.toml
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --requirement requirements.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --editable .
	touch $(INSTALLED)
