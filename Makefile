# Two commands matter: `make demo` runs the main job on a bare machine, `make test` tests it.
# Both see to everything they need first (scripts/set_up.py); a second time that costs nothing.

BIN := .venv/bin
# The first of these that is a Python of the right version makes the environment; PYTHON=... names another.
PYTHONS := $(PYTHON) python3 python3.13 python3.12 python3.11
INTERPRETER ?= python3.12
OUT ?= runs/t1
QUERY ?= put the glass into the refrigerator
BASELINES ?= unchecked checked repaired constraint-pose sampled-grasp one-demonstration
EPISODES ?= 20
SEED ?= 68000

.PHONY: help setup demo test test-all golden lint conformance interop baselines docs doctor repair clean
.DEFAULT_GOAL := help

help:  ## Lists the targets.
	@sed -n 's/^\([a-z-]*\):.*## \(.*\)/  make \1\t\2/p' Makefile | expand -t 22

setup: setup-all  ## Makes the environment in .venv, with a renderer and all that the program can use.

# The demo takes a part of it, tests and checks take the developer's tools as well.
.PHONY: setup-demo setup-all setup-test
setup-demo setup-all setup-test:
	@for python in $(PYTHONS); do \
	    if $$python -c 'import sys; sys.exit(not (3, 11) <= sys.version_info[:2] < (3, 14))' 2>/dev/null; then \
	        exec $$python scripts/set_up.py $(@:setup-%=%); \
	    fi; \
	done; \
	echo "[set-up] Python 3.11, 3.12 or 3.13 is needed, and none was found; on Debian: apt-get install python3"; \
	exit 2

demo: setup-demo  ## Puts a glass into a refrigerator; pictures, videos and a report go to runs/t1.
	$(BIN)/scene2demo run "$(QUERY)" --scene kitchen_t1 --seed 0 --out $(OUT) --force

test: setup-test  ## Runs the tests, the slow ones left out.
	$(BIN)/python -m pytest -m "not slow and not golden" -n auto --dist worksteal

test-all: setup-test  ## Runs all tests.
	$(BIN)/python -m pytest -m "not golden" -n auto --dist worksteal

golden: setup-test  ## Compares all that this version does with what was frozen (REWRITE_GOLDEN=1 freezes it).
	$(BIN)/python -m pytest tests/golden -n auto

lint: setup-test  ## Checks style and types.
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

conformance: setup-all  ## Compares BDDL with the reference implementation, which it installs into .venv-reference.
	$(BIN)/python -m benchmarks.conformance --out build/conformance.json

interop: setup-all  ## Loads exported data sets with lerobot, h5py and zarr, which it installs into .venv-interop (INTERPRETER).
	$(BIN)/python -m benchmarks.interop --interpreter $(INTERPRETER) --out build/interop.json

baselines: setup-all  ## Measures what others do in our rooms (BASELINES, EPISODES, SEED; ROBOGEN=checkout reads its plans).
	@for baseline in $(BASELINES); do \
	    $(BIN)/python -m benchmarks.baselines $$baseline T1 T2 T3 T4 T5 T6 --episodes $(EPISODES) --seed $(SEED) \
	        --out runs/baselines || exit $$?; \
	done
	$(BIN)/scene2demo bench T1 T2 T3 T4 T5 T6 --episodes $(EPISODES) --seed $(SEED) --out runs/baselines
	$(BIN)/python -m benchmarks.baselines table runs/baselines
	@if [ -n "$(ROBOGEN)" ]; then $(BIN)/python -m benchmarks.robogen_plans "$(ROBOGEN)"; fi

docs: setup-test  ## Builds the documentation, with its generated pages, in build/site/index.html.
	$(BIN)/python scripts/build_docs.py
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet

doctor: setup-demo  ## Tells what this machine can do.
	$(BIN)/scene2demo doctor

repair:  ## Goes through the set-up again: missing libraries, a renderer.
	@if [ -f .venv/scene2demo-set-up ]; then \
	    sed -i 's/^[^ ]*/again/' .venv/scene2demo-set-up && $(MAKE) --no-print-directory setup-demo; \
	else \
	    $(MAKE) --no-print-directory setup-all; \
	fi

clean:  ## Removes the environment and caches; runs/ stays.
	rm -rf .venv .venv-interop build .pytest_cache .mypy_cache .ruff_cache .hypothesis
