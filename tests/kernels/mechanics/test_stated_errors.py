"""Stated errors, at the worst arguments known, of kernels whose truths are no table of laws elsewhere."""

import pytest

from rbfmu_kernels.mechanics import inertia, newton_euler
from tests.support.references import exact
from tests.support.references.exact import mp
from tests.support.references.laws import Law
from tests.support.references.worst_cases import WORST


def size(M):
    """The largest singular value."""
    return max(mp.svd_r(mp.matrix(M), compute_uv=False))


def trace(M):
    return M[0][0] + M[1][1] + M[2][2]


def parallel_axis(M, m, r):
    S = exact.skew(r)
    return exact.combine((1, M), (-m, exact.product(S, S)))


def rotated(R, M):
    return exact.product(exact.product(R, M), exact.transpose(R))


def torque(M, w):
    return exact.cross(w, exact.apply(M, w))


def alpha(M, w, t):
    return exact.solve(M, exact.add(t, exact.scaled(-1, torque(M, w))))


def size_of_alpha(M, w, t):
    moments = mp.svd_r(mp.matrix(M), compute_uv=False)
    condition = max(moments) / min(moments)
    return (exact.norm(t) + max(moments) * exact.norm(w) ** 2) / min(moments) * condition


def energy(m, M, v, w):
    return [(m * mp.fdot(v, v) + mp.fdot(w, exact.apply(M, w))) / 2]


def of_extents(parts):
    return lambda m, e: of_moments([m / parts * (mp.fdot(e, e) - x * x) for x in e])


def of_moments(moments):
    return [[moments[i] if i == j else mp.zero for j in range(3)] for i in range(3)]


def cylinder(m, r, h):
    side = m * (3 * r * r + h * h) / 12
    return of_moments([side, side, m * r * r / 2])


def one(name):
    return lambda: [WORST[name]]


LAWS = [
    Law(newton_euler.angular_momentum, exact.apply, one("angular_momentum"), 1.5, lambda M, w: size(M) * exact.norm(w)),
    Law(newton_euler.kinetic_energy, energy, one("kinetic_energy"), 3.5,
        lambda m, M, v, w: (m * exact.norm(v) ** 2 + size(M) * exact.norm(w) ** 2) / 2,
        lambda value, truth, scale: exact.error([value], truth, scale)),
    Law(newton_euler.euler_equation, alpha, one("euler_equation"), 7.0, size_of_alpha),
    Law(inertia.parallel_axis, parallel_axis, one("parallel_axis"), 1.0, lambda *case: trace(parallel_axis(*case))),
    Law(inertia.rotate_inertia, rotated, one("rotate_inertia"), 2.2, lambda _, M: trace(M)),
    Law(inertia.beam_inertia, lambda m, h: of_moments([mp.zero, m * h * h / 12, m * h * h / 12]), one("beam_inertia"),
        1.5, lambda m, h: m * h * h / 12),
    Law(inertia.sphere_inertia, lambda m, r: of_moments([2 * m * r * r / 5] * 3), one("sphere_inertia"), 1.8,
        lambda m, r: 2 * m * r * r / 5),
    Law(inertia.box_inertia, of_extents(12), one("box_inertia"), 2.0, lambda m, e: of_extents(12)(m, e)[0][0]),
    Law(inertia.ellipsoid_inertia, of_extents(5), one("ellipsoid_inertia"), 2.0,
        lambda m, e: of_extents(5)(m, e)[0][0]),
    Law(inertia.cylinder_inertia, cylinder, one("cylinder_inertia"), 2.5, lambda m, r, h: cylinder(m, r, h)[0][0]),
]  # fmt: skip


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.name)
def test_error_is_as_stated(law):
    law.check()
