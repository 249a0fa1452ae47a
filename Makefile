# `make setup check test` installs into .venv and checks everything; CI runs the same.
VENV ?= .venv
PYTHON ?= python3
BIN = $(VENV)/bin

.PHONY: setup check test slow demo bench
setup:
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet --editable ".[dev]"

check:
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

test:
	$(BIN)/pytest -n 2 --dist loadfile -m "not slow"

slow:
	$(BIN)/pytest -m slow

demo:
	$(BIN)/rbfmu demo

bench:
	$(BIN)/python examples/bench_kernels.py bench
	$(BIN)/python examples/bench_fmu.py
