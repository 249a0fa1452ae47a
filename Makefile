# `make setup check test` installs into .venv and checks everything; CI runs the same.
VENV ?= .venv
PYTHON ?= python3
BIN = $(VENV)/bin
# Tests start hundreds of processes: modules are compiled to bytecode once, also where the environment forbids it.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: setup check test thorough slow demo bench interop platforms fuzz ranges release site
setup:
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet --no-compile --editable ".[dev]"

check:
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python -m tests.support.commit_subjects

SHARED = -n 2 --dist loadfile

test:
	@echo "The tests take some six minutes of a processor's time, half as long on two; four once their code is kept."
	$(BIN)/pytest $(SHARED) -m "not slow and not thorough"

# The core once more as plain Python: readable tracebacks, and no result may hang on the compiler.
CORE = $(addprefix tests/kernels/,numerics rotations mechanics exact/test_plane_pendulum.py)

# What takes seconds, and some of what is one of many alike. CI runs it as well.
thorough:
	status=0; $(BIN)/pytest $(SHARED) --no-loadscope-reorder -m "thorough and not slow" || status=1; \
	NUMBA_DISABLE_JIT=1 $(BIN)/pytest $(SHARED) -m "not slow" $(CORE) || status=1; exit $$status

slow: thorough
	$(BIN)/pytest -v -n 2 -m slow

demo:
	$(BIN)/rbfmu demo

# All of them are run; the status is 1 where any misses a goal.
BENCHES = kernels free_rotation fmu held_gil native gallery costs stepping dense_output ensembles batches
bench:
	status=0; for one in $(BENCHES); do $(BIN)/python -m examples.benchmarks.$$one || status=1; done; exit $$status

interop:
	$(BIN)/pip install --quiet --editable ".[interop]"
	$(BIN)/python -m examples.interop.run interop

# Native FMUs for all platforms; those that an emulator here runs give the kernels' bits (apt: qemu-user libc6-arm64-cross wine64).
platforms:
	$(BIN)/pip install --quiet --editable ".[native]"
	$(BIN)/pytest -m slow $(addprefix tests/fmu/native/test_native_fmu_,build.py compilers.py platforms.py)

# The lowest and the newest of all dependencies with every Python found here, in fresh environments, some minutes each.
ranges:
	$(BIN)/pip install --quiet "uv>=0.5"
	$(BIN)/python -m tests.support.ranges

# Pages, gallery and a reference with search as files: open build/site/index.html.
site:
	$(BIN)/pip install --quiet --editable ".[site,view,fit,ensemble]"
	$(BIN)/python -m sphinx -q -W -c examples/site -d build/trees . build/site

# Wheel and source archive in dist, each tried in bare environments of the lowest and the newest Python found here.
release:
	$(BIN)/pip install --quiet build twine "uv>=0.5"
	$(BIN)/python -m tests.support.release

# Wrong calls of both kinds of FMU, millions of them, counted; the C layer under sanitizers.
fuzz:
	$(BIN)/python tests/support/fmu/fuzzing.py 1 10000
	$(BIN)/pytest -s -m "slow or not slow" tests/fmu/test_conformance.py
