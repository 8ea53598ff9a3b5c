# Two commands on a fresh machine: `make tables` runs the main job, `make test` the tests. Both set themselves up first.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
INSTALLED := $(VENV)/.installed
# Tools of lint and tests stand in a lock of their own.
TOOLS := $(VENV)/.tools
# snakemake, which goes on by itself after a run that was killed.
SNAKEMAKE := $(BIN)/gsbridge run
PIP := $(BIN)/python -m pip --quiet --disable-pip-version-check
# Python compiles a file when it is first imported, which most of the packages' files never are. It has to keep what it compiled:
# where the environment forbids that, as images for containers like to, each of some hundred processes compiles all it imports anew.
unexport PYTHONDONTWRITEBYTECODE
INSTALL := $(PIP) install --no-compile
# PyPI's torch for Linux brings gigabytes of CUDA; PyTorch's own index also has it without. Empty for a machine with a GPU.
TORCH_INDEX ?= https://download.pytorch.org/whl/cpu
# The version of PyTorch, as its lock has it.
TORCH = $(shell sed -n 's/^\(torch==[^ ;]*\).*/\1/p' requirements-torch.lock)
TOY_POLICY := results/policies/grasp/small_cube+foam_pad/gs/default/seed1/policy.json
OVERVIEW := results/overview/grasp-small_cube+foam_pad-gs-default
# Areas that were measured once, with commas between them.
RECORDED = $(shell ls benchmarks/scores | sed 's/\.json$$//' | paste -sd , -)
SUPPORTED := import sys; sys.exit(not (3, 11) <= sys.version_info[:2] < (3, 14))

# Tests that wait most of their time: runs that are killed, and jobs of a cluster or a bucket.
WAITING := tests/faults tests/rules/test_cluster.py tests/rules/test_storage.py tests/rules/test_kubernetes.py

.PHONY: help status dag locks tables toy study results results-page evidence pictures docs test test-working test-waiting test-unit test-gap test-rules test-toy test-captures test-fuzz test-faults gpu-check lint format schema clean-toy setup

tables: $(INSTALLED)
	$(SNAKEMAKE)

help:
	@echo "make tables        reconstruct, train, try, and write results/tables/index.html"
	@echo "make toy           the same on one object, in the folder toy/"
	@echo "make test          lint, types, unit, rule and end-to-end tests"
	@echo "make status        what is left of make tables, about how long it takes, what is degraded and why"
	@echo "make dag           the graph of rules as rules.svg (needs graphviz; rules.dot without it)"
	@echo "make gpu-check     what a GPU can do here: parity, speed, one object of the paper's budget"
	@echo "make study         ways of learning compared, further worlds, the gap's blind cases: hours"
	@echo "make evidence      all that is recorded, measured anew; a part of it with PART=NAME, one of: $(PARTS)"
	@echo "make results       measured figures against their floors: benchmarks/RESULTS.md"
	@echo "make results-page  the same page without measuring: which recorded figures are of this tree, and which are stale"
	@echo "make pictures      the pictures of README and docs, from the toy"
	@echo "make docs          the pages of this version as a site in site/, beside other versions that were made there"
	@echo "make setup         the environment alone"
	@echo "Further: make lint, format, schema, locks, clean-toy, test-fuzz, test-faults. A run of your own: gsbridge run --help"

status: $(INSTALLED)
	@$(BIN)/gsbridge status

dag: $(INSTALLED)
	@$(SNAKEMAKE) --rulegraph dot > rules.dot 2> rules.log || { grep ^ERROR rules.log || cat rules.log; rm rules.dot rules.log; exit 1; } >&2
	@rm rules.log
	@if command -v dot > /dev/null; then dot -Tsvg rules.dot -o rules.svg && rm rules.dot && echo rules.svg; else echo rules.dot; fi

# What the policy needs goes first: its training is the longest way to the tables, and leaves a core to everything else.
toy: $(INSTALLED)
	$(SNAKEMAKE) --directory toy --config preset=toy --prioritize $(TOY_POLICY) -- all results/gap-benchmark/report.html

study: $(INSTALLED)
	$(SNAKEMAKE) study

# The pictures of README and of the guide to filming, made anew from the toy: some minutes once it is there.
pictures: $(INSTALLED)
	$(SNAKEMAKE) --directory toy --config preset=toy -- $(OVERVIEW).jpg results/figures/capture_guide.jpg
	mkdir -p docs/pictures
	cp toy/$(OVERVIEW).jpg docs/pictures/overview.jpg
	cp toy/$(OVERVIEW).webp docs/pictures/overview.webp
	cp toy/results/figures/capture_guide.jpg docs/pictures/capture_guide.jpg

# The pages as a site; a link that leads nowhere stops it. Its tools have an environment of their own, since none of ours needs them.
docs: .venv-docs/.installed
	NO_MKDOCS_2_WARNING=1 .venv-docs/bin/mkdocs build --strict

.venv-docs/.installed: docs/requirements.txt
	$(PYTHON) -m venv --clear .venv-docs
	.venv-docs/bin/python -m pip --quiet --disable-pip-version-check install --requirement docs/requirements.txt
	touch .venv-docs/.installed

# All that is recorded, in parts of a night of two cores each: `make evidence PART=study`. Stopped, a part goes on where it was; on a
# cluster `make evidence PROFILE=profiles/slurm` does all at once. The gap is judged on a seal that is drawn once and kept, so that
# nobody has tuned on it; real logs and captures count where GSBRIDGE_MEASURED and GSBRIDGE_CAPTURES name their folders. A clone
# holds the records of areas without their results, and so snakemake would find nothing to do: the records are made anew.
PART ?= $(PARTS)
PARTS := tables simulator shapes photos study worlds loops severity worth gap gap_rivals gap_bodies gap_pictures gap_real
SEAL := results/.state/seal
EVIDENCE_tables := all benchmarks/scores/real2sim.json benchmarks/scores/policies.json
EVIDENCE_simulator := simulator benchmarks/scores/simulator.json
EVIDENCE_shapes := benchmarks/scores/shapes.json
EVIDENCE_photos := benchmarks/scores/photos.json
EVIDENCE_study := study benchmarks/scores/study.json
EVIDENCE_worlds := benchmarks/scores/worlds.json
EVIDENCE_loops := benchmarks/scores/loops.json
EVIDENCE_severity := results/severity_controller.md results/severity.md benchmarks/scores/severity.json
EVIDENCE_worth := results/worth.md results/graded.md benchmarks/scores/worth.json
EVIDENCE_gap := benchmarks/scores/gap.json
$(foreach part,rivals bodies pictures real,$(eval EVIDENCE_gap_$(part) := benchmarks/scores/gap_$(part).json))

evidence: $(addprefix evidence-,$(PART))
	$(SNAKEMAKE) --forcerun record_timings -- benchmarks/evidence/timings.csv.gz
	$(MAKE) results-page

evidence-%: $(INSTALLED)
	@test -n "$(EVIDENCE_$*)" || { echo "there is no part '$*'; use $(PARTS)" >&2; exit 1; }
	@mkdir -p $(dir $(SEAL)) && test -s $(SEAL) || shuf -i 10001-999999999 -n 1 > $(SEAL)
	GSBRIDGE_SEAL=$$(cat $(SEAL)) $(SNAKEMAKE) $(if $(PROFILE),--workflow-profile $(PROFILE)) --keep-going --forcerun record_scores -- $(EVIDENCE_$*)
	$(if $(filter gap gap_bodies gap_pictures,$*),$(BIN)/python -m benchmarks.gap_seals --scored results/gap-benchmark/*/scores.json)
	$(if $(filter gap_rivals,$*),$(BIN)/python -m benchmarks.gap_seals --scored results/gap-benchmark/*/compared.json)

results: $(INSTALLED)
	$(SNAKEMAKE) --forcerun record_scores -- benchmarks/RESULTS.md

# Without measuring: which of the recorded figures are of the tree as it is.
results-page: $(INSTALLED)
	$(SNAKEMAKE) --allowed-rules write_results_page --forcerun write_results_page --config "areas=[$(RECORDED)]" -- benchmarks/RESULTS.md
	$(BIN)/python -m benchmarks.readme
	$(BIN)/python -m benchmarks.floor_history

# Two at a time, in this order, until all are done: whatever ends, the next begins. The toy comes first, which leaves a core idle
# for minutes, beside tests that use one core; the captures fill what the last of those leave. Tests that wait stand beside both.
test: $(TOOLS)
	$(MAKE) --jobs=2 test-waiting test-working

test-working: $(TOOLS)
	$(MAKE) --jobs=2 --output-sync=target test-toy lint test-unit test-captures test-gap test-rules

test-waiting: $(TOOLS)
	$(BIN)/python -m pytest --durations=10 $(WAITING)

test-unit: $(TOOLS)
	$(BIN)/python -m pytest --durations=10 tests/unit tests/fuzz --ignore-glob='*/test_gap_*'

test-gap: $(TOOLS)
	$(BIN)/python -m pytest --durations=10 tests/unit/test_gap_*.py

test-rules: $(TOOLS)
	$(BIN)/python -m pytest --durations=10 tests/rules $(addprefix --ignore=,$(WAITING))

test-toy: $(TOOLS)
	$(BIN)/python -m pytest --durations=10 tests/e2e --ignore=tests/e2e/test_captures.py

test-captures: $(TOOLS)
	nice $(BIN)/python -m pytest --durations=10 tests/e2e/test_captures.py

# Broken and hostile files for every reader, fifty times as many as in the tests.
test-fuzz: $(TOOLS)
	GSBRIDGE_FUZZ=10000 $(BIN)/python -m pytest tests/fuzz

# A hundred kills of a small chain, full and read-only disks, two runs in one folder: some minutes. `make test-faults OVER=toy` kills
# the whole toy as often, at random moments of all its stages, and compares its rows, tables and figures: hours; KILLS=3 for less.
KILLS ?= 100
OVER ?= chain
test-faults: $(TOOLS)
	@test $(OVER) = chain || test $(OVER) = toy || { echo "OVER is chain or toy, not '$(OVER)'" >&2; exit 1; }
	GSBRIDGE_FAULTS=$(KILLS) GSBRIDGE_FAULTS_OVER=$(OVER) $(BIN)/python -m pytest tests/faults $(if $(filter toy,$(OVER)),-k toy)

# All that needs a GPU, in one table; minutes. Uses the object of `make toy` where that was made.
gpu-check: $(INSTALLED)
	$(BIN)/python -m benchmarks.gpu_check

# What mypy found is of use to a later run alone, which CI's machine never makes.
lint: $(TOOLS)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/snakefmt --check Snakefile rules
	$(BIN)/mypy $(if $(GSBRIDGE_CI),--no-incremental)
	$(SNAKEMAKE) --lint

# After an edit of gsbridge/configuration or of a table: the schema for editors, the tables of docs/configuration.md and docs/tables.md.
schema: $(INSTALLED)
	$(BIN)/python -m gsbridge.configuration.pages
	$(BIN)/python -m gsbridge.report.tables.columns

# The three locks anew from pyproject.toml, with hashes; needs uv.
locks:
	.ci/lock

format: $(TOOLS)
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .
	$(BIN)/snakefmt Snakefile rules

clean-toy:
	rm -rf toy

setup: $(INSTALLED)

# A half-made environment has no stamp, so that the next call finishes it; one without pip or of another Python is made anew.
# Every package is checked against the hashes of its lock, but for PyTorch's build without CUDA, which comes from PyTorch's own
# index. Where that cannot be reached, PyTorch is taken as its lock says, with CUDA.
$(INSTALLED): requirements.lock requirements-torch.lock pyproject.toml
	@$(BIN)/python -c 'import pip; $(SUPPORTED)' 2>/dev/null || $(PYTHON) -c '$(SUPPORTED)' || \
		{ echo "gsbridge needs Python 3.11 to 3.13, $(PYTHON) is not; name one: make PYTHON=python3.12" >&2; exit 1; }
	@$(BIN)/python -c 'import pip; $(SUPPORTED)' 2>/dev/null || $(PYTHON) -m venv --clear $(VENV) || \
		{ echo "$(PYTHON) cannot make an environment; on Debian and Ubuntu: sudo apt install python3-venv" >&2; exit 1; }
	@echo "Installing into $(VENV), some minutes ..."
	-$(if $(TORCH_INDEX),$(INSTALL) --no-deps --retries 1 --timeout 15 --extra-index-url $(TORCH_INDEX) "$(TORCH)")
	$(INSTALL) --require-hashes --no-deps --requirement requirements.lock
	@$(BIN)/python -c 'import sys; from importlib.metadata import version; sys.exit("torch==" + version("torch") != "$(TORCH)+cpu")' 2>/dev/null || \
		$(INSTALL) --require-hashes --no-deps --requirement requirements-torch.lock
	$(INSTALL) --no-deps --editable .
	touch $(INSTALLED)

$(TOOLS): $(INSTALLED) requirements-test.lock
	$(INSTALL) --require-hashes --no-deps --requirement requirements-test.lock
	touch $(TOOLS)
