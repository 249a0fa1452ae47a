"""What exact torque-free motion costs, in plain RK4 steps; and many times of one body beside as many bodies.

The least of many short, interleaved runs. `python -m examples.benchmarks.free_rotation` prints the ratios and exits
with status 1 where a goal is missed.
"""

from time import process_time
from typing import Any

import numpy as np
from numba import njit

import rbfmu
from examples.benchmarks.support.goals import Goal, status
from examples.benchmarks.support.least import least
from rbfmu_kernels import free_rotation
from rbfmu_kernels.exact.free_rotation import free_rotation_at, free_rotation_setup

I_123, Q = (1.0, 2.0, 3.0), (0.5, 0.5, 0.5, 0.5)
RATES = {"generic": (0.3, 1.0, 0.2), "near the middle axis": (1e-9, 1.0, 1e-9)}
AN_EVALUATION, WITH_SETUP = "an evaluation / an RK4 step", "with its setup / an RK4 step"
MANY_TIMES = "many times of one body / as many bodies"
EACH_OUTPUT = "ns of CPU an output of many bodies at ten times"
GOALS = {AN_EVALUATION: 5.0, WITH_SETUP: 60.0, MANY_TIMES: 0.5, EACH_OUTPUT: 80.0}
"""Largest ratios, and ns, with the bodies' set-up and on one thread."""
MANY = 2000


@njit(error_model="numpy")  # type: ignore[untyped-decorator]
def rk4_steps(moments: Any, q: Any, omega: Any, h: float, n: int) -> Any:
    """Plain RK4 on Euler parameters and Euler's equations: the unit of cost."""
    k = ((moments[1] - moments[2]) / moments[0], (moments[2] - moments[0]) / moments[1],
         (moments[0] - moments[1]) / moments[2])  # fmt: skip
    y = (q[0], q[1], q[2], q[3], omega[0], omega[1], omega[2])
    for _ in range(n):
        a = _rhs(k, y)
        b = _rhs(k, _plus(y, 0.5 * h, a))
        c = _rhs(k, _plus(y, 0.5 * h, b))
        d = _rhs(k, _plus(y, h, c))
        y = _plus(_plus(_plus(_plus(y, h / 6.0, a), h / 3.0, b), h / 3.0, c), h / 6.0, d)
    return y


@njit(error_model="numpy", inline="always")  # type: ignore[untyped-decorator]
def _rhs(k: Any, y: Any) -> Any:
    e, x, y_, z, a, b, c = y
    return (
        -0.5 * (x * a + y_ * b + z * c), 0.5 * (e * a + y_ * c - z * b), 0.5 * (e * b - x * c + z * a),
        0.5 * (e * c + x * b - y_ * a), k[0] * b * c, k[1] * c * a, k[2] * a * b,
    )  # fmt: skip


@njit(error_model="numpy", inline="always")  # type: ignore[untyped-decorator]
def _plus(y: Any, h: float, d: Any) -> Any:
    return (
        y[0] + h * d[0], y[1] + h * d[1], y[2] + h * d[2], y[3] + h * d[3],
        y[4] + h * d[4], y[5] + h * d[5], y[6] + h * d[6],
    )  # fmt: skip


@njit(error_model="numpy")  # type: ignore[untyped-decorator]
def _evaluations(setup: Any, h: float, n: int) -> float:
    total = 0.0
    for i in range(n):
        q, omega = free_rotation_at(setup, h * i)
        total += q[0] + omega[0]
    return total


@njit(error_model="numpy")  # type: ignore[untyped-decorator]
def _with_setups(moments: Any, q: Any, omega: Any, h: float, n: int) -> Any:
    for _ in range(n):
        q, omega = free_rotation(moments, q, omega, h)
    return q, omega


def _in_rk4_steps(omega: Any, rounds: int, n: int) -> dict[str, float]:
    setup = free_rotation_setup(I_123, Q, omega)
    seconds = least(rounds + 1, {
        "RK4": lambda: rk4_steps(I_123, Q, omega, 1e-3, n),
        AN_EVALUATION: lambda: _evaluations(setup, 0.1, n),
        WITH_SETUP: lambda: _with_setups(I_123, Q, omega, 0.1, n),
    })  # fmt: skip
    return {name: seconds[name] / seconds["RK4"] for name in (AN_EVALUATION, WITH_SETUP)}


def _many_times(rounds: int) -> float:
    """Return the cost of many times of one body, which is set up once, over that of many bodies."""
    omega = RATES["generic"]
    times, bodies = np.linspace(0.0, 10.0, MANY), np.broadcast_to(omega, (MANY, 3)).copy()
    seconds = least(rounds + 1, {
        "times": lambda: rbfmu.free_rotation(I_123, Q, omega, times),
        "bodies": lambda: rbfmu.free_rotation(I_123, Q, bodies, 1.0),
    })  # fmt: skip
    return seconds["times"] / seconds["bodies"]


def _each_output(bodies: int, rounds: int = 7) -> float:
    """Return the least CPU time, ns, of bodies with moments and rates of their own, an output."""
    numbers = np.random.default_rng(1)
    moments = np.array([1.0, 2.0, 2.9]) * (1.0 + 0.01 * numbers.normal(size=(bodies, 1, 3)))
    omega, times = numbers.normal(size=(bodies, 1, 3)), np.linspace(1.0, 10.0, 10)
    call = {EACH_OUTPUT: lambda: rbfmu.free_rotation(moments, Q, omega, times)}
    return 1e9 * least(rounds + 1, call, clock=process_time)[EACH_OUTPUT] / (bodies * len(times))


def main(rounds: int = 300, n: int = 300, bodies: int = 1_000_000) -> dict[str, dict[str, float]]:
    """Print and return the ratios by motion."""
    figures = {name: _in_rk4_steps(omega, rounds, n) for name, omega in RATES.items()}
    figures["generic"][MANY_TIMES] = _many_times(-(-rounds // 8))
    figures["generic"][EACH_OUTPUT] = _each_output(bodies)
    for motion, ratios in figures.items():
        print(*(f"{motion + ', ' + name:60}{ratio:8.2f}" for name, ratio in ratios.items()), sep="\n")
    return figures


def goals(figures: dict[str, dict[str, float]]) -> list[Goal]:
    """Of the ratios that `main` returns."""
    return [
        Goal(f"{motion}, {name}", ratio, most=GOALS[name])
        for motion, ratios in figures.items()
        for name, ratio in ratios.items()
    ]


if __name__ == "__main__":
    raise SystemExit(status(goals(main())))
