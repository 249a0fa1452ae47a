"""heyoka.py: Taylor series that LLVM compiles, with dense output, for the equations of one body."""

from collections.abc import Iterator
from functools import cache
from itertools import islice
from typing import Any

from rbfmu.scene.scene import Scene
from rbfmu.studies.work_precision.cases import PATH, RATES, ROTATION, Case
from rbfmu.studies.work_precision.methods import NotFeasibleError, Run, module, timed, tolerances
from rbfmu.studies.work_precision.solvers import start_of, states_of, times_of
from rbfmu_kernels.mechanics.equations_of_motion import Body
from rbfmu_kernels.types import Vec3


class Heyoka:
    """`taylor_adaptive`, compiled once for a motion and tolerance; `propagate_grid` evaluates its series at outputs."""

    family, setting, name = "peer", "tol", "heyoka.py"

    def suits(self, case: Case) -> bool:
        """Return whether the case suits: all do but a million turns, which take too long."""
        return not case.long

    def settings(self, case: Case, quick: bool) -> Iterator[float]:
        """Return powers of ten; each takes seconds to compile, since it determines the order."""
        return islice(tolerances(-2, -15, False), 0, None, 6 if quick else 2)

    def run(self, case: Case, value: float) -> Run:
        """Return a run at a tolerance."""
        y, grid = start_of(case), times_of(case)
        series = _integrator(case.scene, case.numbers, value)
        success = module("heyoka").taylor_outcome.time_limit

        def once() -> Any:
            series.time = 0.0
            series.state[:] = y
            return series.propagate_grid(grid)

        outcome, *_, rows = once()
        if outcome != success:
            raise NotFeasibleError(str(outcome))
        found = states_of(case, rows)
        return Run(lambda: found, timed(lambda k: [once() for _ in range(k)]), float("nan"))


@cache
def _integrator(scene: Scene, numbers: int, tolerance: float) -> Any:
    """Return an integrator, whose state is still to be set."""
    return module("heyoka").taylor_adaptive(equations(Case("", "", scene), numbers), [0.0] * numbers, tol=tolerance)


def equations(case: Case, numbers: int) -> list[tuple[Any, Any]]:
    """Return (variable, rate) of the numbers that are integrated: see `cases.RATES`, `PATH`, `ROTATION`, `ALL`."""
    q, w = (module("heyoka").make_vars(*(f"{letter}{i}" for i in range(n))) for letter, n in (("q", 4), ("w", 3)))
    if numbers < ROTATION:
        q = list(case.start.q_ab)
    body, loads = case.body, case.loads
    M = body.inertia
    e, u = q[0], tuple(q[1:])
    R = _rotation(e, u)
    force = _sum(loads.force_b, _times_transposed(R, loads.force_a))
    torque = _sum(loads.torque_b, _times_transposed(R, loads.torque_a), _cross(body.arm_b, force))
    spin = _cross(tuple(_dot(row, w) for row in M), tuple(w))
    turning = tuple(torque[i] + spin[i] - body.damping_b[i] * w[i] for i in range(3))
    dw = [_turned_into_rate(body, i, turning) for i in range(3)]
    dq = [-0.5 * _dot(u, w), *(0.5 * (e * w[i] + x) for i, x in enumerate(_cross(u, tuple(w))))]
    rates, attitude = [*zip(w, dw, strict=True)], [*zip(q, dq, strict=True)]
    system = {RATES: rates, PATH: []}.get(numbers, [*attitude, *rates])
    if numbers in (RATES, ROTATION):
        return system
    r, v = (module("heyoka").make_vars(*(f"{letter}{i}" for i in range(3))) for letter in "rv")
    dv = [
        0.0 * v[i]  # no number alone is an equation's right-hand side
        + body.is_free * loads.gravity_a[i]
        + body.inverse_mass * (loads.force_a[i] + _dot(R[i], loads.force_b))
        for i in range(3)
    ]
    return [*system, *zip(r, v, strict=True), *zip(v, dv, strict=True)]


def _turned_into_rate(body: Body, i: int, torque: Any) -> Any:
    """Return a component of M^-1 torque; 0 about the axis of a slender beam."""
    M, row = body.inertia[i], body.inertia_inverse[i]
    if any(x for j, x in enumerate(M) if j != i):
        return _dot(row, torque)
    return torque[i] / M[i] if row[i] else 0.0 * torque[i]


def _rotation(e: Any, u: Any) -> Any:
    x, y, z = u
    return (
        (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - e * z), 2.0 * (x * z + e * y)),
        (2.0 * (x * y + e * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - e * x)),
        (2.0 * (x * z - e * y), 2.0 * (y * z + e * x), 1.0 - 2.0 * (x * x + y * y)),
    )


def _product(a: Any, b: Any) -> Any:
    """Return a product, or 0.0 if a factor is the number 0."""
    return 0.0 if (isinstance(a, float) and a == 0.0) or (isinstance(b, float) and b == 0.0) else a * b


def _dot(a: Any, b: Any) -> Any:
    return _product(a[0], b[0]) + _product(a[1], b[1]) + _product(a[2], b[2])


def _cross(a: Any, b: Any) -> Any:
    return tuple(_product(a[i - 2], b[i - 1]) - _product(a[i - 1], b[i - 2]) for i in range(3))


def _times_transposed(R: Any, v: Vec3) -> Any:
    return tuple(_dot((R[0][i], R[1][i], R[2][i]), v) for i in range(3))


def _sum(*vectors: Any) -> Any:
    return tuple(sum(x[1:], x[0]) for x in zip(*vectors, strict=True))
