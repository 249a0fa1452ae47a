"""What a substep costs, ns, by method and order, all measured in one run, in turn.

`python -m examples.benchmarks.substeps` prints also the lines of `rbfmu.planning.methods` through them. DOP853, which
no plan chooses, stands beside the series: it costs what series of order 16 to 24 do, and its error shrinks with its
step as that of order 8.
"""

from collections.abc import Callable, Sequence
from time import perf_counter
from typing import Any

import numpy as np
from numba import njit

from rbfmu.models.model_buffer import aligned_zeros
from rbfmu.planning.methods import ORDERS_OF_SERIES, SERIES_COSTS
from rbfmu.runs.plan import Plan, filled_buffer, initialize
from rbfmu.studies.chart.cases import CASES
from rbfmu.studies.dop853 import Dop853Plan

KINDS = {"torques known in b": "d", "loads that turn in b": "c'", "a force that turns with the body": "f"}
ROUNDS, SECONDS = 25, 2e-3


@njit(error_model="numpy", nogil=True)
def _repeated(step: Any, z: Any, start: Any, h: float, k: int) -> int:
    fault = 0
    for _ in range(k):
        z[:] = start
        fault += step(z, h)
    return fault


def timed(key: str, plan: Plan, substeps: float = 0.0) -> Callable[[], float]:
    """Ns a substep of a case's whole motion in one communication step; substeps: where the unit does not count them."""
    case = CASES[key]
    start = filled_buffer(case.scene, plan)
    initialize(case.scene, plan.kernels, start)
    z = aligned_zeros(len(start))
    z[:] = start
    assert _repeated(plan.kernels.step, z, start, case.span, 1) == 0
    count = substeps or float(z[plan.kernels.BLOCKS["substeps"]][0])

    def once() -> float:
        before = perf_counter()
        _repeated(plan.kernels.step, z, start, case.span, 1)
        single = perf_counter() - before
        k = max(1, round(SECONDS / single))
        before = perf_counter()
        _repeated(plan.kernels.step, z, start, case.span, k)
        return 1e9 * (perf_counter() - before) / (k * count)

    return once


def series(order: int) -> Plan:
    """At a tolerance that the order is good at."""
    return Plan("body under loads, by series", "", 13, tolerance=10.0 ** (1.0 - 0.65 * order), order=order)


def jobs() -> dict[tuple[str, str], Callable[[], float]]:
    """By row and column of the tables."""
    found = {}
    for kind, key in KINDS.items():
        for order in ORDERS_OF_SERIES:
            found[f"Taylor {order}", kind] = timed(key, series(order))
        found["DOP853", kind] = timed(key, Dop853Plan("body under loads", "", 13, tolerance=1e-8))
        found["DOP853, equal steps", kind] = timed(
            key, Dop853Plan("body under loads", "", 13, substep=CASES[key].span / 500), 500
        )
    for order in (2, 4, 6):
        plan = Plan("symmetric top", "", 13, substep=CASES["c"].span / 200, order=order)
        found[f"splitting {order}", "loads that turn in b"] = timed("c", plan, 200)
    return found


def line(costs: Sequence[float]) -> tuple[float, float]:
    """Return (a, b) of a + b N through the series' costs by order: least squares of relative errors."""
    weights = 1.0 / np.array(costs)
    b, a = np.polyfit(ORDERS_OF_SERIES, costs, 1, w=weights)
    return float(a), float(b)


def main() -> None:
    """Print the least of many rounds."""
    timers = jobs()
    least = dict.fromkeys(timers, np.inf)
    for _ in range(ROUNDS):
        for name, once in timers.items():
            least[name] = min(least[name], once())
    print(" " * 21 + "".join(kind.rjust(35) for kind in KINDS))
    for row in dict.fromkeys(row for row, _ in timers):
        print(row.ljust(21) + "".join(f"{least[row, k]:35.0f}" if (row, k) in least else " " * 35 for k in KINDS))
    for kind, stated in zip(KINDS, SERIES_COSTS, strict=True):
        a, b = line([least[f"Taylor {order}", kind] for order in ORDERS_OF_SERIES])
        print(f"{kind}: {a:.0f} + {b:.1f} N, in rbfmu.planning.methods {stated[0]:.0f} + {stated[1]:.1f} N")


if __name__ == "__main__":
    main()
