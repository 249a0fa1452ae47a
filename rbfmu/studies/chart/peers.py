"""Which of other people's solvers and simulators are installed, and how to install the others."""

from collections.abc import Callable, Sequence
from functools import cache
from importlib.metadata import PackageNotFoundError, version

from rbfmu.extras import remedy
from rbfmu.studies.chart.methods import Method
from rbfmu.studies.chart.simulators import Basilisk, Drake, MuJoCo
from rbfmu.studies.chart.solvers import Heyoka, Numbalsoda, Odeint, SolveIvp

MUJOCO_INTEGRATORS = ("Euler", "implicit", "implicitfast", "RK4")


def _package(name: str) -> str | None:
    """Return the version of an installed package."""
    try:
        return version(name)
    except PackageNotFoundError:
        return None


def _scipy_methods() -> list[Method]:
    return [*map(SolveIvp, ("DOP853", "RK45", "LSODA")), SolveIvp("LSODA", compiled=False), Odeint()]


_PEERS: dict[str, tuple[str, str, Callable[[], Sequence[Method]]]] = {
    "SciPy": ("scipy", "bench", _scipy_methods),
    "numbalsoda": ("numbalsoda", "bench-fortran", lambda: [Numbalsoda(m) for m in ("lsoda", "dop853")]),
    "heyoka.py": ("heyoka", "bench", lambda: [Heyoka()]),
    "MuJoCo": ("mujoco", "bench", lambda: [MuJoCo(m) for m in MUJOCO_INTEGRATORS]),
    "Basilisk": ("bsk", "bench-simulators", lambda: [Basilisk(m) for m in ("RK4", "RKF78")]),
    "Drake": ("drake", "bench-simulators", lambda: [Drake("runge_kutta3", "RK3"), Drake("runge_kutta5", "RK5")]),
}
"""For each peer: its package, the extra of this library that installs it, and its methods."""
ABSENT = "not installed"


@cache
def peers() -> tuple[tuple[Method, ...], dict[str, str]]:
    """Return the methods of the installed peers, and the version of each peer (`ABSENT` if it is not installed)."""
    found: list[Method] = []
    versions = {}
    for name, (package, _, methods) in _PEERS.items():
        installed = _package(package)
        versions[name] = installed or ABSENT
        found += methods() if installed else []
    return tuple(found), versions


def absent() -> list[str]:
    """Return a line for each peer that is not installed."""
    names = [name for name, found in peers()[1].items() if found == ABSENT]
    return [f"{name}: {ABSENT} ({remedy(_PEERS[name][1])})" for name in names]
