"""Which of other people's solvers and simulators are installed, and how to install the others."""

from collections.abc import Callable, Sequence
from functools import cache
from importlib.metadata import PackageNotFoundError, version

from rbfmu.extras import remedy
from rbfmu.studies.work_precision.heyoka_peer import Heyoka
from rbfmu.studies.work_precision.methods import Method
from rbfmu.studies.work_precision.simulators import Basilisk, Drake, MuJoCo
from rbfmu.studies.work_precision.solvers import numbalsoda_methods, scipy_methods

MUJOCO_INTEGRATORS = ("Euler", "implicit", "implicitfast", "RK4")


def _package(name: str) -> str | None:
    """Return the version of an installed package."""
    try:
        return version(name)
    except PackageNotFoundError:
        return None


_PEERS: dict[str, tuple[str, str, Callable[[], Sequence[Method]]]] = {
    "SciPy": ("scipy", "bench", scipy_methods),
    "numbalsoda": ("numbalsoda", "bench-fortran", numbalsoda_methods),
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
