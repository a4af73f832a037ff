# Everything sets itself up: `make demo` or `make test` on a fresh machine is enough.
.PHONY: help setup demo test test-layers test-shapes test-lowest test-pythons installed fuzz fuzz-guided kills mutants lint bench docs clean
.DEFAULT_GOAL := help

PYTHON ?= $(shell command -v python3.11 || command -v python3)
BIN := .venv/bin
INPUTS ?= 20000
MUTANTS ?= 100
SECONDS ?= 60
KILLS ?= 60
SEED ?= 0
READY := .venv/.ready
WARM := .venv/.warm
PACKAGES := perception mapping planning sim surefoot
KERNELS := $(shell find $(PACKAGES) -name '*_kernels.py')
# the versions in requirements.lock are those for Python 3.11; others take the newest that pyproject.toml allows
LOCK = $$($(BIN)/python -c 'import sys; print("-c requirements.lock" * (sys.version_info[:2] == (3, 11)))')
INSTALL = $(BIN)/python -m pip install --quiet --disable-pip-version-check
PYTHONS ?= 3.12 3.13
RUNS ?= runs
export OMP_NUM_THREADS := 1
export OPENBLAS_NUM_THREADS := 1
export NUMBA_THREADING_LAYER := workqueue
export SUREFOOT_DATA ?= $(abspath ../shared/data)

help:  ## what can be made
	@grep -E '^[a-z-]+:.*## ' Makefile | sed 's/:.*## /\t/' | expand -t 14

setup: $(WARM)  ## own environment, pinned packages, compiled kernels

$(READY): pyproject.toml requirements.lock
	@test -n "$(PYTHON)" || { echo "surefoot: no Python found; run: apt-get install python3.11 python3.11-venv" >&2; exit 2; }
	@$(PYTHON) surefoot/cli/bootstrap.py
	$(PYTHON) -m venv .venv
	$(INSTALL) $(LOCK) -e '.[dev]'
	@touch $(READY)

# each state of a package's kernels has a cache folder of its own: remove the old ones
$(WARM): $(READY) $(KERNELS)
	@find $(PACKAGES) \( -name 'kernels-*' -prune -o -name '*.nb[ic]' \) -exec rm -rf {} +
	$(BIN)/python -m surefoot.cli.warmup
	@touch $(WARM)

demo: $(WARM)  ## a live walk, its recording processed, both judged
	$(BIN)/surefoot simulate home --seed 0 --record --out $(RUNS)/demo
	$(BIN)/surefoot process $(RUNS)/demo --out $(RUNS)/demo-offline
	@echo && echo "live walk" && $(BIN)/surefoot evaluate $(RUNS)/demo
	@echo && echo "the same, processed from its recording" && $(BIN)/surefoot evaluate $(RUNS)/demo-offline
	@cmp $(RUNS)/demo/trajectory_covariance.csv $(RUNS)/demo-offline/trajectory_covariance.csv \
		&& cmp $(RUNS)/demo/map.pgm $(RUNS)/demo-offline/map.pgm \
		&& echo "trajectory and map of both are the same, bit for bit"
	@echo && echo "open $(RUNS)/demo/report.html in a browser, or: $(BIN)/surefoot view $(RUNS)/demo"

# glibc keeps the memory of freed images; given back, every new one is zeroed page by page
test test-layers test-shapes: export MALLOC_MMAP_THRESHOLD_ := 4294967296
test test-layers test-shapes: export MALLOC_TRIM_THRESHOLD_ := 4294967296

test: $(WARM)  ## the test suite
	$(BIN)/python -m pytest -n 2 --dist loadfile -q

test-layers: $(WARM)  ## perception, mapping and planning without sim and surefoot, array shapes checked
	CHECK_SHAPES=1 BLOCKED_PACKAGES="sim surefoot" $(BIN)/python -m pytest -n 2 --dist loadfile -q tests/perception tests/mapping tests/planning

test-shapes: $(WARM)  ## the other tests with the array shapes of every call checked
	CHECK_SHAPES=1 $(BIN)/python -m pytest -n 2 --dist loadfile -q tests/sim tests/surefoot tests/test_*.py

test-lowest:  ## the test suite with the oldest versions that pyproject.toml allows
	tests/versions.sh lowest $(PYTHON)

test-pythons:  ## the test suite on Python 3.12 and 3.13, as far as this machine has them
	tests/versions.sh newest $(PYTHONS)

installed: $(READY)  ## a wheel in a fresh environment: read-only, without a home, without the checkout
	tests/installed.sh

fuzz: $(WARM)  ## damaged files through every reader: make fuzz INPUTS=100000 SEED=1
	$(BIN)/python -W ignore tests/fuzz/campaign.py $(INPUTS) $(SEED)

fuzz-guided: $(WARM)  ## damaged files chosen by the code they reach, a minute a door: make fuzz-guided SECONDS=60
	$(BIN)/python -c 'import atheris' 2>/dev/null || $(INSTALL) atheris
	$(BIN)/python -W ignore tests/fuzz/guided.py $(SECONDS)

kills: $(WARM)  ## runs killed at random moments must go on to the same files: make kills KILLS=60 SEED=1
	$(BIN)/python -W ignore tests/kills/kills.py $(KILLS) $(SEED)

mutants: $(WARM)  ## bugs planted in the numerical core, and how many the tests notice: make mutants MUTANTS=300 SEED=1
	$(BIN)/python tests/mutants/run_mutants.py $(MUTANTS) $(SEED)

lint: $(READY)  ## style, types, import contracts
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

bench: $(WARM)  ## hot paths against their peers, which it installs
	$(INSTALL) $(LOCK) -e '.[bench]'
	$(BIN)/surefoot bench

docs: $(WARM)  ## the documentation, as pages in build/docs/html; its notebooks are executed
	$(INSTALL) $(LOCK) -e '.[docs]'
	$(BIN)/python -m sphinx -q -W --keep-going -j 2 -d build/docs/trees docs build/docs/html
	$(BIN)/python -m pytest -q tests/docs
	@echo "open build/docs/html/index.html in a browser"

clean:  ## forget the environment and all caches; runs stay
	rm -rf .venv .venv-* .mypy_cache .ruff_cache .pytest_cache .hypothesis build dist
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
