"""The motion of a scene's body to 40 digits, by a way that shares no formula with the kernels.

States are the rotation matrix, the angular momentum in inertial axes (about the centre of mass, or the pivot), position
and velocity of the centre of mass; Taylor series of order 32 in integers of 220 bits after the point, with a step
that keeps each series' last term below 1e-45.  A second of a rate of 1 rad/s costs some milliseconds.
"""

import math
from collections.abc import Sequence
from fractions import Fraction
from functools import cache
from operator import mul
from typing import Any, NamedTuple

import mpmath as mp
import numpy as np

BITS, ORDER = 220, 32
ONE = 1 << BITS
LAST_TERM = 1 << (BITS - 150)
DIGITS = 60

Series = list[int]
Vector = list[Any]


class Point(NamedTuple):
    """Attitude, body rates, position and velocity of o, in numbers of mpmath."""

    R_ab: list[Vector]
    omega_b: Vector
    position: Vector
    velocity: Vector


def fixed(x: float | Fraction) -> int:
    return round(Fraction(x) * ONE)


def cross(a: Vector, b: Vector) -> Vector:
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def matvec(A: Any, v: Any) -> Vector:
    return [sum(map(mul, row, v)) for row in A]


def transposed(A: Any) -> list[Vector]:
    return [list(column) for column in zip(*A, strict=True)]


def steiner(M: Any, mass: Fraction, r: Vector) -> list[Vector]:
    """M plus the inertia of a particle at r."""
    square = sum(map(mul, r, r))
    return [[M[i][j] + mass * ((i == j) * square - r[i] * r[j]) for j in range(3)] for i in range(3)]


def inverse(M: list[Vector]) -> list[Vector]:
    """Exact; a zero on the diagonal of a diagonal matrix stays zero (the slender beam)."""
    if not any(M[i][j] for i in range(3) for j in range(3) if i != j):
        return [[1 / M[i][i] if i == j and M[i][i] else Fraction(0) for j in range(3)] for i in range(3)]
    columns = [cross(M[1], M[2]), cross(M[2], M[0]), cross(M[0], M[1])]
    det = sum(map(mul, M[0], columns[0]))
    return [[columns[j][i] / det for j in range(3)] for i in range(3)]


def matrix_of(q: Sequence[Any]) -> list[Vector]:
    """R of q / |q|, by E&G (6.163)."""
    with mp.workdps(DIGITS):
        n = mp.sqrt(sum(mp.mpf(x) ** 2 for x in q))
        e, x, y, z = (mp.mpf(x) / n for x in q)
        return [
            [e * e + x * x - y * y - z * z, 2 * (x * y - e * z), 2 * (x * z + e * y)],
            [2 * (x * y + e * z), e * e - x * x + y * y - z * z, 2 * (y * z - e * x)],
            [2 * (x * z - e * y), 2 * (y * z + e * x), e * e - x * x - y * y + z * z],
        ]


class _Equations:
    """Right-hand sides: linear maps of R, but for the products R^T h, R skew(omega) and, with damping, R (d omega)."""

    def __init__(self, body: Any, initial: Any, loads: Any) -> None:
        exact = lambda v: [Fraction(x) for x in v]  # noqa: E731
        mass, r_oc = Fraction(body.mass), exact(body.r_oc_b)
        gravity, force_a, force_b = exact(loads.gravity_a), exact(loads.force_a), exact(loads.force_b)
        torque_a, torque_b = exact(loads.torque_a), exact(loads.torque_b)
        M = [exact(row) for row in body.inertia]
        self.pivot = body.pivot
        if self.pivot:
            M = steiner(M, mass, r_oc)
            arm, arm_force = r_oc, [mass * g for g in gravity]
            self.acceleration, self.body_acceleration = [0] * 3, [Fraction(0)] * 3
        else:
            arm, arm_force = [-x for x in r_oc], force_a
            torque_b = [t + m for t, m in zip(torque_b, cross(arm, force_b), strict=True)]
            self.acceleration = [fixed(g + f / mass) for g, f in zip(gravity, force_a, strict=True)]
            self.body_acceleration = [f / mass for f in force_b]
        self.M_inverse = [[fixed(x) for x in row] for row in inverse(M)]
        self.torque_a = [fixed(t) for t in torque_a]
        self.arm, self.arm_force = [fixed(x) for x in arm], [fixed(x) for x in arm_force]
        self.torque_b, self.damping = [fixed(x) for x in torque_b], [fixed(x) for x in loads.damping_b]
        self.body_acceleration = [fixed(x) for x in self.body_acceleration]
        self.levers, self.r_oc = any(self.arm) and any(self.arm_force), [fixed(x) for x in r_oc]
        with mp.workdps(DIGITS):
            R_exact = [[Fraction(int(mp.nint(x * ONE)), ONE) for x in row] for row in matrix_of(initial.quaternion)]
        omega = exact(initial.omega_b)
        h = matvec(R_exact, matvec(M, omega))
        r_c = [p + r for p, r in zip(exact(initial.position), matvec(R_exact, r_oc), strict=True)]
        v_c = [v + w for v, w in zip(exact(initial.velocity), matvec(R_exact, cross(omega, r_oc)), strict=True)]
        if self.pivot:
            v_c = [Fraction(0)] * 3
        flat = [x for row in R_exact for x in row]
        self.start = [fixed(x) for x in (*flat, *h, *v_c, *r_c)]

    def series(self, state: list[int], step: int) -> list[Series]:
        """Taylor coefficients of the state, times powers of the step."""
        s = [[x] for x in state]
        R, h, v = [s[0:3], s[3:6], s[6:9]], s[9:12], s[12:15]
        columns = transposed(R)
        omega: list[Series] = [[], [], []]
        for k in range(ORDER):
            u = [_conv(c[0], h[0]) + _conv(c[1], h[1]) + _conv(c[2], h[2]) >> BITS for c in columns]
            for w, x in zip(omega, matvec(self.M_inverse, u), strict=True):
                w.append(x >> BITS)
            rates: list[int] = []
            for a, b, c in R:
                rates += [
                    _conv(b, omega[2]) - _conv(c, omega[1]) >> BITS,
                    _conv(c, omega[0]) - _conv(a, omega[2]) >> BITS,
                    _conv(a, omega[1]) - _conv(b, omega[0]) >> BITS,
                ]
            now = [[x[k] for x in row] for row in R]
            rates += self._torque(now, k, R, omega)
            push = matvec(now, self.body_acceleration)
            rates += [(x >> BITS) + (a if k == 0 else 0) for x, a in zip(push, self.acceleration, strict=True)]
            rates += [x[k] for x in v]
            for x, rate in zip(s, rates, strict=True):
                x.append((rate * step >> BITS) // (k + 1))
        return s

    def _torque(self, now: list[Vector], k: int, R: Any, omega: list[Series]) -> Vector:
        turned = matvec(now, self.torque_b)
        torque = [(x >> BITS) + (t if k == 0 else 0) for x, t in zip(turned, self.torque_a, strict=True)]
        if self.levers:
            at = [x >> BITS for x in matvec(now, self.arm)]
            torque = [t + (x >> BITS) for t, x in zip(torque, cross(at, self.arm_force), strict=True)]
        if any(self.damping):
            drag = [[d * x >> BITS for x in w] for d, w in zip(self.damping, omega, strict=True)]
            torque = [t - (sum(map(_conv, row, drag)) >> BITS) for t, row in zip(torque, R, strict=True)]
        return torque

    def point(self, state: list[int]) -> Point:
        with mp.workdps(DIGITS):
            x = [mp.mpf(n) / ONE for n in state]
            R = [x[0:3], x[3:6], x[6:9]]
            r_oc = [mp.mpf(n) / ONE for n in self.r_oc]
            M_inverse = [[mp.mpf(n) / ONE for n in row] for row in self.M_inverse]
            omega = matvec(M_inverse, matvec(transposed(R), x[9:12]))
            offset, swing = matvec(R, r_oc), matvec(R, cross(omega, r_oc))
            if self.pivot:
                position = [mp.mpf(n) / ONE for n in self.start[15:18]]
                r_0 = matvec([[mp.mpf(n) / ONE for n in self.start[i : i + 3]] for i in (0, 3, 6)], r_oc)
                return Point(R, omega, [p - q for p, q in zip(position, r_0, strict=True)], [mp.mpf(0)] * 3)
            position = [p - q for p, q in zip(x[15:18], offset, strict=True)]
            return Point(R, omega, position, [p - q for p, q in zip(x[12:15], swing, strict=True)])


def _conv(a: Series, b: Series) -> int:
    return sum(map(mul, a, reversed(b)))


def _at(series: list[Series], part: Fraction) -> list[int]:
    p = fixed(part)
    values = [0] * len(series)
    for k in range(ORDER, -1, -1):
        values = [(x * p >> BITS) + s[k] for x, s in zip(values, series, strict=True)]
    return values


def motion(scene: Any, times: Sequence[float]) -> list[Point]:
    """The body's motion at times from the scene's start on, ascending; inputs zero."""
    return _motion(scene.body, scene.initial, scene.loads, scene.run.start, tuple(times))


@cache
def _motion(body: Any, initial: Any, loads: Any, start: float, times: tuple[float, ...]) -> list[Point]:
    equations = _Equations(body, initial, loads)
    state, now = equations.start, Fraction(start)
    rate = max(1e-3, float(np.linalg.norm(initial.omega_b)))
    step = Fraction(1.0 / rate)
    points: list[Point] = []
    while len(points) < len(times):
        series = equations.series(state, fixed(step))
        last = max(abs(s[ORDER]) for s in series)
        part = Fraction(min(1.0, math.exp((math.log(LAST_TERM) - _log(last)) / ORDER)))
        end = now + part * step
        while len(points) < len(times) and Fraction(times[len(points)]) <= end:
            points.append(equations.point(_at(series, (Fraction(times[len(points)]) - now) / step)))
        state, now = _at(series, part), end
        step = Fraction(float(step * part) * (1.0 if part < 1 else 1.5))
    return points


def _log(n: int) -> float:
    return math.log(n >> 900) + 900 * math.log(2.0) if n.bit_length() > 950 else math.log(max(n, 1))


def angle_to(q: Sequence[float], R_ab: list[Vector]) -> float:
    """The angle in rad between a quaternion's attitude and a rotation matrix."""
    with mp.workdps(DIGITS):
        E = [matvec(transposed(R_ab), column) for column in transposed(matrix_of(q))]
        sine = mp.sqrt((E[1][2] - E[2][1]) ** 2 + (E[2][0] - E[0][2]) ** 2 + (E[0][1] - E[1][0]) ** 2)
        return float(mp.atan2(sine, E[0][0] + E[1][1] + E[2][2] - 1))


def distance(v: Sequence[float], truth: Vector) -> float:
    with mp.workdps(DIGITS):
        return float(mp.sqrt(sum((mp.mpf(float(a)) - b) ** 2 for a, b in zip(v, truth, strict=True))))


def largest_size(vectors: list[Vector], floor: float) -> float:
    with mp.workdps(DIGITS):
        return max([floor, *(float(mp.sqrt(sum(x * x for x in v))) for v in vectors)])


def errors(points: list[Point], quaternion: Any, omega_b: Any, position: Any, velocity: Any) -> dict[str, float]:
    """The largest errors over a run, as a scene's `accuracy` counts them."""
    found = {"attitude": max(angle_to(q, p.R_ab) for q, p in zip(quaternion, points, strict=True))}
    for name, values, floor in (("omega_b", omega_b, 0.0), ("position", position, 1.0), ("velocity", velocity, 1.0)):
        truth = [getattr(p, name) for p in points]
        size = largest_size(truth, floor) or 1.0
        found[name] = max(distance(v, t) for v, t in zip(values, truth, strict=True)) / size
    return found
