"""The discrete Moser-Veselov algorithm for torque-free bodies, plain (order 2) and preprocessed to order 10.

It conserves the angular momentum and a modified energy exactly; each step solves for three numbers by fixed-point
iteration. Preprocessing (E. Hairer & G. Vilmart, J. Phys. A 39 (2006); R. McLachlan & A. Zanna, Found. Comput. Math. 5
(2005)) replaces the moments of inertia by functions of the step size, of |h|^2 and of the energy, which raises the
order at no cost per step.
"""

import math
from typing import Any

from rbfmu_kernels.compile.decorator import kernel
from rbfmu_kernels.mechanics.equations_of_motion import Body, Loads, State
from rbfmu_kernels.rotations.quaternion import compose_quaternions, normalize
from rbfmu_kernels.rotations.vec3 import dot
from rbfmu_kernels.types import Vec3

MAX_ROUNDS = 10_000  # the iteration is slow near the largest step that has a solution


@kernel(inline=False)
def _steps(state: State, h: float, n: int, moments: Vec3, inverse: Vec3) -> State:
    """Take n steps with modified `inverse` moments, each by a Cayley vector c: R = (1 + skew(c))(1 - skew(c))^-1."""
    r, v, q, omega = state
    m = (moments[0] * omega[0], moments[1] * omega[1], moments[2] * omega[2])
    i, j, k = 1.0 / inverse[0], 1.0 / inverse[1], 1.0 / inverse[2]
    g = (j - k, k - i, i - j)
    f = (g[0] / i, g[1] / j, g[2] / k)
    for _ in range(n):
        a = (0.5 * h * m[0] * inverse[0], 0.5 * h * m[1] * inverse[1], 0.5 * h * m[2] * inverse[2])
        x, y, z = a
        change, rounds = 1.0, 0
        while change > 1e-16 and rounds < MAX_ROUNDS:
            s = 1.0 + (x * x + y * y + z * z)
            x1 = s * a[0] + f[0] * y * z
            y1 = s * a[1] + f[1] * x1 * z
            z1 = s * a[2] + f[2] * x1 * y1
            change = abs(x1 - x) + abs(y1 - y) + abs(z1 - z)
            x, y, z = x1, y1, z1
            rounds += 1
        found = 4.0 / h if change < 1e-13 else float("nan")
        s = found / (1.0 + (x * x + y * y + z * z))
        q = normalize(compose_quaternions(q, (1.0, x, y, z)))
        m = (m[0] + s * g[0] * y * z, m[1] + s * g[1] * x * z, m[2] + s * g[2] * x * y)
    return State(r, v, q, (m[0] / moments[0], m[1] / moments[1], m[2] / moments[2]))


def _coefficients(moments: Vec3) -> tuple[list[float], list[float]]:
    """Return weights of C, H, C^2, CH, H^2, ... H^4 (orders 4, 4, 6, 6, 6, ... 10) in both series of `_modified`."""
    a, b, c = moments
    D = a * b * c

    def inverse_powers(n: int) -> float:
        return float(a**-n + b**-n + c**-n)

    def powers(n: int) -> float:
        return float(a**n + b**n + c**n)

    def mixed(n: int, m: int) -> float:
        return float((a**n + b**n) / c**m + (b**n + c**n) / a**m + (c**n + a**n) / b**m)

    X1, X2, X3, X4 = (inverse_powers(n) for n in (1, 2, 3, 4))
    S1, S2, S3, S4 = (powers(n) for n in (1, 2, 3, 4))
    t11, t12, t21, t13, t31, t22 = (mixed(*nm) for nm in ((1, 1), (1, 2), (2, 1), (1, 3), (3, 1), (2, 2)))
    s = [
        S1 / (6 * D),
        -X1 / 3,
        (S2 / D - X1) / (30 * D),
        (1 - t11) / (30 * D),
        (3 * S1 / D + 2 * X2) / 60,
        (4 * D + 17 * S3 - 15 * D * t11) / (2520 * D**3),
        (9 * S1 + 10 * D * X2 - 6 * t21) / (420 * D**2),
        ((6 * t12 - 100 * X1) * D + 53 * S2) / (2520 * D**2),
        (15 - D * X3 - 2 * t11) / (630 * D),
        (62 * S4 - 94 * D * t21 + 66 * D**2 * X2 + 81 * D * S1) / (45360 * D**4),
        (-77 * t31 + 75 * D * t12 + 214 * S2 - 240 * D * X1) / (22680 * D**3),
        (26 * D * t22 + 55 * S3 + 204 * D - 50 * D**2 * X3 - 59 * D * t11) / (7560 * D**3),
        (137 * D * X2 - D * t13 + 3 * S1 - 69 * t21) / (11340 * D**2),
        (2 * D**2 * X4 + 5 * D * t12 - 171 * D * X1 + 159 * S2) / (45360 * D**2),
    ]
    d = [
        -1 / (3 * D),
        S1 / (6 * D),
        -S1 / D**2 / 60,
        X1 / D / 10 - S2 / D**2 / 60,
        -(9 + t11) / D / 60,
        (34 * D * X1 - 19 * S2) / (2520 * D**3),
        (S3 + 2 * D * t11 - 85 * D) / (1260 * D**3),
        (47 * S1 + 13 * t21 - 38 * D * X2) / (2520 * D**2),
        (9 * D * X1 + D * t12 - 11 * S2) / (1260 * D**2),
        (60 * t11 * D - 61 * S3 - 247 * D) / (45360 * D**4),
        (54 * D * S1 - S4 + 218 * D * t21 - 426 * D**2 * X2) / (45360 * D**4),
        (125 * D * X1 - 5 * t31 - 130 * S2 + 4 * D * t12) / (7560 * D**3),
        (67 * S3 - 735 * D - 15 * D * t22 + 87 * D * t11 + 34 * D**2 * X3) / (22680 * D**3),
        (165 * S1 - D * t13 - 9 * t21 - 145 * D * X2) / (45360 * D**2),
    ]
    return s, d


_DEGREES = [(n - j, j) for n in (1, 2, 3, 4) for j in range(n + 1)]


def _modified(order: int, h: float, moments: Vec3, omega: Vec3) -> Vec3:
    """Return modified inverse moments s(C, H) / I + d(C, H), C = h^2 |m|^2 / 2, H = h^2 m . omega / 2."""
    m = (moments[0] * omega[0], moments[1] * omega[1], moments[2] * omega[2])
    C, H = 0.5 * h * h * dot(m, m), 0.5 * h * h * dot(m, omega)
    terms = [C**i * H**j for i, j in _DEGREES if 2 * (i + j) + 2 <= order]
    s, d = (sum(c * t for c, t in zip(series, terms, strict=False)) for series in _coefficients(moments))
    return ((1.0 + s) / moments[0] + d, (1.0 + s) / moments[1] + d, (1.0 + s) / moments[2] + d)


def moser_veselov(order: int) -> Any:
    """Return `steps(y, h, n, body, loads)` of order 2, 4, 6, 8 or 10; loads and off-diagonal M are ignored."""

    def steps(y: State, h: float, n: int, body: Body, loads: Loads) -> State:
        M = body.inertia
        unit = 2.0 ** round(math.log2(max(M[0][0], M[1][1], M[2][2])))  # else powers of a planet's moments overflow
        moments = (M[0][0] / unit, M[1][1] / unit, M[2][2] / unit)
        return _steps(y, h, n, moments, _modified(order, h, moments, y.omega_b))

    return steps
