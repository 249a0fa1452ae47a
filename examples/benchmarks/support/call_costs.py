"""What a call of a kernel or an array function costs: on one item, with two threads, and the first of a process."""

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numba import njit

import rbfmu
import rbfmu_kernels as k

IMPORTS = 15


def one_item() -> dict[str, float]:
    """Return us of one call on one item, and what a call costs in a compiled loop beside the same lines by hand."""
    q, v = np.array([0.5, 0.5, 0.5, 0.5]), np.array([1.0, 2.0, 3.0])
    tq, tv = (0.5, 0.5, 0.5, 0.5), (1.0, 2.0, 3.0)
    figures = {
        "array function, us": _best(lambda: rbfmu.rotate(q, v), 20_000) * 1e6,
        "scalar kernel, us": _best(lambda: k.rotate(tq, tv), 20_000) * 1e6,
    }
    n = 2_000_000
    by_kernel, by_hand = np.inf, np.inf
    for _ in range(9):
        by_kernel = min(by_kernel, _best(lambda: _loop_of_kernels(tq, tq, n), 1))
        by_hand = min(by_hand, _best(lambda: _loop_by_hand(tq, tq, n), 1))
    return figures | {"loop of kernels / loop by hand": by_kernel / by_hand}


@njit
def _loop_of_kernels(q: Any, p: Any, n: int) -> Any:
    for _ in range(n):
        q = k.compose_quaternions(q, p)
    return q


@njit
def _loop_by_hand(q: Any, p: Any, n: int) -> Any:
    a, b, c, d = q
    e, f, g, h = p
    for _ in range(n):
        a, b, c, d = (
            a * e - b * f - c * g - d * h,
            a * f + b * e + c * h - d * g,
            a * g - b * h + c * e + d * f,
            a * h + b * g - c * f + d * e,
        )
    return a, b, c, d


def _best(call: Callable[[], Any], times: int) -> float:
    call()
    best = np.inf
    for _ in range(7):
        start = time.perf_counter()
        for _ in range(times):
            call()
        best = min(best, (time.perf_counter() - start) / times)
    return best


def threads(n: int) -> dict[str, float]:
    """Speed of two threads as a ratio to one: at n items, and below the size from which on threads are used."""
    angles, out = np.random.default_rng(1).uniform(-3.0, 3.0, size=(n, 3)), np.empty((n, 4))
    ratios = {}
    for items, rounds in ((n, 25), (10_000, 1000)):
        some, into = angles[:items], out[:items]
        seconds: dict[int, list[float]] = {1: [], 2: []}
        for _ in range(rounds):
            for count in (1, 2):
                rbfmu.set_threads(count)
                rbfmu.quaternion_from_euler("ZYX", some, out=into)  # threads are started by the first call
                start = time.perf_counter()
                rbfmu.quaternion_from_euler("ZYX", some, out=into)
                seconds[count].append(time.perf_counter() - start)
        one, two = (float(np.median(seconds[count])) for count in (1, 2))
        ratios[f"ZYX to quaternion, {items:,} items, two threads / one"] = one / two
    rbfmu.set_threads(1)
    return ratios


FIRST_CALLS = {
    "quaternion to ZYX": "euler_from_quaternion('ZYX', [1.0, 0, 0, 0])",
    "free_rotation (the largest)": "free_rotation([1.0, 2.0, 3.0], [1.0, 0, 0, 0], [0.1, 0.2, 0.3], 1.0)",
}


def starts() -> dict[str, float]:
    """Return imports as a ratio; s for the first call of a function, with a cold and a warm cache of compiled code."""
    figures = {}
    with tempfile.TemporaryDirectory() as cache:
        timed = "import time; t = time.perf_counter(); import {}; print(time.perf_counter() - t)"
        calls = [timed.format(module) for module in ("rbfmu.arrays", "numba")]
        ours, numba = np.median([[_python(call, cache) for call in calls] for _ in range(IMPORTS)], axis=0)
        figures["import of all array functions / import numba"] = ours / numba
        for name, call in FIRST_CALLS.items():
            first = (
                f"import time, rbfmu; rbfmu.compose_matrices; t = time.process_time(); rbfmu.{call};"
                "print(time.process_time() - t)"
            )
            for state in ("cold", "warm"):
                figures[f"first call of {name}, {state} cache, s of CPU"] = _python(first, cache)
    return figures


def _python(code: str, cache: str) -> float:
    """Return what the code prints, run with the bytecode on disk that an installed package has."""
    environment = os.environ | {"NUMBA_CACHE_DIR": cache, "PYTHONDONTWRITEBYTECODE": ""}
    command = [sys.executable, "-c", code]
    return float(subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout)
