# Two commands matter: `make demo` runs the main job on a bare machine, `make test` tests it.
# Both see to everything they need first (scripts/set_up.py); a second time that costs nothing.

PYTHON ?= python3
BIN := .venv/bin
OUT ?= runs/t1
QUERY ?= put the glass into the refrigerator

.PHONY: help setup demo test test-all lint doctor renderer clean
.DEFAULT_GOAL := help

help:  ## Lists the targets.
	@sed -n 's/^\([a-z-]*\):.*## \(.*\)/  make \1\t\2/p' Makefile | expand -t 22

setup:  ## Makes the environment in .venv, with a renderer.
	@command -v $(PYTHON) >/dev/null || { echo "[set-up] $(PYTHON) is not installed; on Debian: apt-get install python3"; exit 2; }
	@$(PYTHON) scripts/set_up.py

demo: setup  ## Puts a glass into a refrigerator; pictures, videos and a report go to runs/t1.
	$(BIN)/scene2demo run "$(QUERY)" --scene kitchen_t1 --seed 0 --out $(OUT) --force

test: setup  ## Runs the tests, the slow ones left out.
	$(BIN)/python -m pytest -m "not slow"

test-all: setup  ## Runs all tests.
	$(BIN)/python -m pytest

lint: setup  ## Checks style and types.
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

doctor: setup  ## Tells what this machine can do.
	$(BIN)/scene2demo doctor

renderer: setup  ## Tries again to get a renderer for the cameras.
	$(BIN)/python scripts/setup_renderer.py

clean:  ## Removes the environment and caches; runs/ stays.
	rm -rf .venv .pytest_cache .mypy_cache .ruff_cache .hypothesis
