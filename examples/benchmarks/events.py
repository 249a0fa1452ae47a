"""Events beside solve_ivp's and heyoka.py's: how many of the roots of a formula each finds.

A free body turns for 50 s, in one communication step; tolerances are 1e-9. SciPy looks for changes of sign between its
own steps, heyoka.py isolates roots of its series as rbfmu does. `python -m examples.benchmarks.events` prints all.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

import rbfmu
from rbfmu.extras import needed_of

with needed_of("bench"):
    from scipy.integrate import solve_ivp

STOP, ACCURACY = 50.0, 1e-9
INERTIA, OMEGA = (1.0, 1.5, 2.2), (0.4, 2.0, 0.3)
Watched = Callable[[Any, Any], Any]
Case = tuple[str, str, Watched, int]
"""What it is, the formula, the same for others (a module of functions and the time), and how many roots there are."""
CASES: tuple[Case, ...] = (
    ("roots far apart", "sin(3*t)", lambda m, t: m.sin(3.0 * t), 48),
    ("at the start", "t", lambda m, t: t, 1),
    ("two 1e-2 s apart", "(t - 20)*(t - 20.01)", lambda m, t: (t - 20.0) * (t - 20.01), 2),
    ("two 1e-6 s apart", "(t - 7)*(t - 7.000001)", lambda m, t: (t - 7.0) * (t - 7.000001), 2),
    ("at corners", "abs(t - 25) - 5", lambda m, t: m.sqrt((t - 25.0) ** 2.0) - 5.0, 2),
    ("threefold", "(t - 10)**3", lambda m, t: (t - 10.0) ** 3.0, 1),
    ("touches, no root", "1 - cos(t)", lambda m, t: 1.0 - m.cos(t), 0),
    ("64 a second", "sin(201*t)", lambda m, t: m.sin(201.0 * t), int(201.0 * STOP / math.pi) + 1),
)


def of_rbfmu(formula: str) -> int:
    """Return how many roots `simulate` finds."""
    scene = rbfmu.Scene.from_dict({
        "body": {"mass": 1.0, "inertia": INERTIA}, "initial": {"omega_b": OMEGA}, "events": {"it": formula},
        "outputs": {"quantities": ["omega_b"]}, "run": {"stop": STOP, "step": STOP, "accuracy": ACCURACY},
    })  # fmt: skip
    return len(rbfmu.simulate(scene).events["it"])


def of_scipy(watched: Watched) -> int:
    """Return how many roots solve_ivp finds, with DOP853 and its default steps."""
    M = np.array(INERTIA)

    def rates(_: float, omega: Any) -> Any:
        return -np.cross(omega, M * omega) / M

    event = lambda t, _: float(watched(np, t))  # noqa: E731
    found = solve_ivp(rates, (0.0, STOP), OMEGA, "DOP853", events=event, rtol=ACCURACY, atol=ACCURACY)
    return len(found.t_events[0])


def of_heyoka(watched: Watched) -> int:
    """Return how many roots heyoka.py finds."""
    with needed_of("bench"):
        import heyoka
    x, y, z = heyoka.make_vars("x", "y", "z")
    a, b, c = INERTIA
    system = [(x, (b - c) / a * y * z), (y, (c - a) / b * z * x), (z, (a - b) / c * x * y)]
    times: list[float] = []
    event = heyoka.nt_event(watched(heyoka, heyoka.time) + 0.0 * x, lambda _, t, sign: times.append(t))
    heyoka.taylor_adaptive(system, list(OMEGA), tol=ACCURACY, nt_events=[event]).propagate_until(STOP)
    return len(times)


def main() -> None:
    """Print a row a formula: how many roots there are, and how many each finds."""
    print(f"{'':18s} {'formula':24s} {'there are':>9s}{'rbfmu':>11s}{'solve_ivp':>11s}{'heyoka.py':>11s}")
    for what, formula, watched, true in CASES:
        found = of_rbfmu(formula), or_error(of_scipy, watched), or_error(of_heyoka, watched)
        print(f"{what:18s} {formula:24s} {true:9d}" + "".join(f"{x:>11}" for x in found), flush=True)


def or_error(count: Callable[[Watched], int], watched: Watched) -> int | str:
    """Return a number of roots, or that there was an error."""
    try:
        return count(watched)
    except RuntimeError:
        return "an error"


if __name__ == "__main__":
    main()
