# `make setup check test` installs into .venv and checks everything; CI runs the same.
VENV ?= .venv
PYTHON ?= python3
BIN = $(VENV)/bin

.PHONY: setup check test slow demo bench interop platforms fuzz
setup:
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet --editable ".[dev]"

check:
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

# The core once more as plain Python: readable tracebacks, and no result may hang on the compiler.
CORE = elementary rotation quaternion euler_angles rotvec kinematics inertia newton_euler inverse_dynamics double_double elliptic plane_pendulum

test:
	status=0; $(BIN)/pytest -n 2 --dist loadfile -m "not slow" || status=1; \
	NUMBA_DISABLE_JIT=1 $(BIN)/pytest -n 2 --dist loadfile $(CORE:%=tests/test_%.py) || status=1; exit $$status

slow:
	$(BIN)/pytest -v -m slow

demo:
	$(BIN)/rbfmu demo

# All of them are run; the status is 1 where any misses a goal.
BENCHES = bench_kernels bench_free_rotation bench_fmu bench_held_gil bench_native bench_gallery bench_costs
bench:
	status=0; for one in $(BENCHES); do $(BIN)/python examples/$$one.py || status=1; done; exit $$status

interop:
	$(BIN)/pip install --quiet --editable ".[interop]"
	$(BIN)/python examples/interop.py interop

# Native FMUs for all platforms; those that an emulator here runs give the kernels' bits (apt: qemu-user libc6-arm64-cross wine64).
platforms:
	$(BIN)/pip install --quiet --editable ".[native]"
	$(BIN)/pytest -m slow tests/test_native_fmu_build.py tests/test_native_fmu_platforms.py

# Wrong calls of both kinds of FMU, millions of them, counted; the C layer under sanitizers.
fuzz:
	$(BIN)/python tests/fuzzing.py 1 10000
	$(BIN)/pytest -s -m "slow or not slow" tests/test_fuzz.py tests/test_abuse.py
