"""Other people's solvers and simulators on the same cases: SciPy's here; which of all are installed."""

from collections.abc import Callable, Iterator, Sequence
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import numpy as np
from numba import njit

from rbfmu.work_precision.cases import CHECKPOINTS, Case
from rbfmu.work_precision.methods import Method, NotFeasibleError, Run, timed, tolerances
from rbfmu.work_precision.simulators import Basilisk, Drake, MuJoCo, module, tuples
from rbfmu_kernels.body_memory import body_of, loads_of
from rbfmu_kernels.dynamics import State, state_rates


def _package(name: str) -> str | None:
    """The version of an installed package."""
    try:
        return version(name)
    except PackageNotFoundError:
        return None


# SciPy


@njit(error_model="numpy")  # type: ignore[untyped-decorator]
def _rates(y: Any, z: Any) -> Any:
    """d/dt of (q, omega) or (q, omega, r_c, v_c) for the body of a unit's buffer z."""
    r, v = ((y[7], y[8], y[9]), (y[10], y[11], y[12])) if len(y) > 7 else ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    dr, dv, dq, dw = state_rates((r, v, (y[0], y[1], y[2], y[3]), (y[4], y[5], y[6])), body_of(z), loads_of(z))
    f = np.empty(len(y))
    f[0], f[1], f[2], f[3] = dq
    f[4], f[5], f[6] = dw
    if len(y) > 7:
        f[7], f[8], f[9] = dr
        f[10], f[11], f[12] = dv
    return f


def _numpy_rates(case: Case) -> Callable[[float, Any], Any]:
    """The same as people write it."""
    lightness, M, M_inverse, arm, damping, _ = (np.array(x) for x in case.body)
    gravity_a, force_a, force_b, torque_a, torque_b = (np.array(x) for x in case.loads)

    def rates(t: float, y: Any) -> Any:
        e, u, w = y[0], y[1:4], y[4:7]
        skew = np.array([[0.0, -u[2], u[1]], [u[2], 0.0, -u[0]], [-u[1], u[0], 0.0]])
        R = np.eye(3) + 2.0 * (e * skew + skew @ skew)
        torque = np.cross(arm, force_b + R.T @ force_a) + torque_b + R.T @ torque_a - damping * w - np.cross(w, M @ w)
        f = [-0.5 * u @ w, *(0.5 * (e * w + np.cross(u, w))), *(M_inverse @ torque)]
        return f if len(y) == 7 else [*f, *y[10:13], *(gravity_a + lightness * (force_a + R @ force_b))]

    return rates


class SciPy:
    """`scipy.integrate.solve_ivp`, its right-hand sides compiled with Numba, or in NumPy."""

    family, setting = "peer", "rtol = atol"

    def __init__(self, method: str, compiled: bool = True) -> None:
        self.method, self.compiled = method, compiled
        self.name = f"SciPy {method}" if compiled else f"SciPy {method}, f in NumPy"

    def suits(self, case: Case) -> bool:
        """All but a million turns, which take too long."""
        return not case.long

    def settings(self, case: Case, quick: bool) -> Iterator[float]:
        """Tolerances."""
        return tolerances(-2, -13, quick)

    def run(self, case: Case, value: float) -> Run:
        """At a tolerance; the position too where it has no closed form."""
        solve = module("scipy.integrate").solve_ivp
        r, v, q, omega = case.start
        y = np.array((*q, *omega, *r, *v) if case.turning_force else (*q, *omega))
        times = np.arange(1, CHECKPOINTS + 1) * case.interval
        z = case.buffer
        rates = (lambda t, y: _rates(y, z)) if self.compiled else _numpy_rates(case)

        def once() -> Any:
            return solve(rates, (0.0, case.span), y, self.method, times, rtol=value, atol=value)

        first = once()
        if not first.success:
            raise NotFeasibleError(first.message)

        def state(x: Any) -> State:
            return tuples(x[7:10], x[10:13], x[:4], x[4:7]) if len(x) > 7 else tuples(r, v, x[:4], x[4:7])

        found = [state(x) for x in first.y.T]
        return Run(lambda: found, timed(lambda k: [once() for _ in range(k)]), float(first.nfev))


_PEERS: dict[str, tuple[str, Callable[[], Sequence[Method]]]] = {
    "SciPy": ("scipy", lambda: [*map(SciPy, ("DOP853", "RK45", "LSODA")), SciPy("LSODA", compiled=False)]),
    "MuJoCo": ("mujoco", lambda: [MuJoCo(m) for m in ("Euler", "implicit", "RK4")]),
    "Basilisk": ("bsk", lambda: [Basilisk(m) for m in ("RK4", "RKF78")]),
    "Drake": ("drake", lambda: [Drake("runge_kutta3", "RK3"), Drake("runge_kutta5", "RK5")]),
}


@cache
def peers() -> tuple[tuple[Method, ...], dict[str, str]]:
    """The installed peers' methods; versions by peer, or that it is not installed."""
    found: list[Method] = []
    versions = {}
    for name, (package, methods) in _PEERS.items():
        installed = _package(package)
        versions[name] = installed or "not installed"
        found += methods() if installed else []
    return tuple(found), versions
