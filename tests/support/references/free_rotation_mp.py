"""Torque-free motion to 40 digits and more, two ways that share nothing with the kernels' formulas.

`closed_form` has the textbook's Euler angles about the angular momentum (Landau & Lifshitz, Mechanics, par. 37;
Whittaker, par. 69): amplitudes from the energy and the angular momentum, Legendre's incomplete integral of the third
kind by quadrature-free mpmath functions, at a precision that outlasts the cancellations.  `taylor` integrates the
equations of motion in fixed-point integers.
"""

import math
import operator
from collections.abc import Sequence
from typing import Any

import mpmath as mp
import numpy as np

DIGITS = 90

Numbers = Sequence[Any]


def compose(a: Numbers, b: Numbers) -> list[Any]:
    """The product of two quaternions, scalar first."""
    return [
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    ]


def conjugate(a: Numbers) -> list[Any]:
    return [a[0], -a[1], -a[2], -a[3]]


def angle_to(q: Numbers, truth: Numbers) -> float:
    """The angle of the rotation between two quaternions, in [0, 2 pi]: q and -q are 2 pi apart (continuity counts)."""
    with mp.workdps(DIGITS):
        e, x, y, z = compose(conjugate(truth), [mp.mpf(float(a)) for a in q])
        return float(2 * mp.atan2(mp.sqrt(x * x + y * y + z * z), e))


def relative_distance(v: Numbers, truth: Numbers) -> float:
    with mp.workdps(DIGITS):
        length = mp.sqrt(sum(b * b for b in truth))
        return float(mp.sqrt(sum((mp.mpf(float(a)) - b) ** 2 for a, b in zip(v, truth, strict=True))) / length)


def closed_form(
    moments: Numbers, q_0: Numbers, omega_0: Numbers, t: float, digits: int = DIGITS
) -> tuple[list[Any], list[Any]]:
    """(q, omega) at t. Not on the separatrix itself; digits: more where a state is nearer than 1e-40 to something."""
    with mp.workdps(digits):
        i = [mp.mpf(x) for x in moments]
        w = [mp.mpf(x) for x in omega_0]
        q = [mp.mpf(x) for x in q_0]
        length = mp.sqrt(sum(x * x for x in q))
        return _closed_form(i, [x / length for x in q], w, mp.mpf(t))


def _turn(axis: int, angle: Any) -> list[Any]:
    q = [mp.cos(angle / 2), mp.mpf(0), mp.mpf(0), mp.mpf(0)]
    q[axis] = mp.sin(angle / 2)
    return q


def _parity(x: int, y: int, z: int) -> int:
    return 1 if (x, y, z) in ((0, 1, 2), (1, 2, 0), (2, 0, 1)) else -1


def _closed_form(i: list[Any], q_0: list[Any], w: list[Any], t: Any) -> tuple[list[Any], list[Any]]:
    m = [a * b for a, b in zip(i, w, strict=True)]
    if not any((m[1] * w[2] - m[2] * w[1], m[2] * w[0] - m[0] * w[2], m[0] * w[1] - m[1] * w[0])):
        rate = mp.sqrt(sum(x * x for x in w))
        spin = [mp.cos(rate * t / 2), *((mp.sin(rate * t / 2) * x / rate if rate else x) for x in w)]
        return compose(q_0, spin), w
    g2 = sum(x * x for x in m)
    g, energy2 = mp.sqrt(g2), sum(a * b for a, b in zip(m, w, strict=True))
    low, y, high = sorted(range(3), key=lambda k: i[k])
    z = high if g2 >= energy2 * i[y] else low  # the axis that m circles
    z = low + high - z if i[z] == i[y] else z
    x = low + high - z
    # A right-handed frame of body axes with m_z > 0.
    flip = -1 if m[z] < 0 else 1
    sign = (1, _parity(x, y, z) * flip, flip)
    (ix, iy, iz), (mx, my) = [i[k] for k in (x, y, z)], (sign[0] * m[x], sign[1] * m[y])
    ax = mp.sqrt(ix * (g2 - energy2 * iz) / (ix - iz))
    ay = mp.sqrt(iy * (g2 - energy2 * iz) / (iy - iz))
    az = mp.sqrt(iz * (g2 - energy2 * ix) / (iz - ix))
    k2 = (iy - ix) * (energy2 * iz - g2) / ((iz - iy) * (g2 - energy2 * ix))
    drive = mp.sign(iz - ix)
    lam = mp.sqrt((iz - iy) * (g2 - energy2 * ix) / (ix * iy * iz))
    n = 1 - ay**2 / ax**2  # m_x^2 + m_y^2 = ax^2 (1 - n sn^2)
    am_0 = mp.atan2(drive * my / ay, mx / ax)
    quarter = mp.ellipk(k2)
    u = mp.ellipf(am_0, k2) + lam * t
    turns = mp.nint(u / (2 * quarter))
    v = u - 2 * turns * quarter
    am = mp.atan2(mp.ellipfun("sn", v, m=k2), mp.ellipfun("cn", v, m=k2)) + turns * mp.pi
    phi = g * t / iz
    phi += g * (energy2 - g2 / iz) / (ax**2 * lam) * (_third(n, am, k2) - _third(n, am_0, k2))

    def frame(am: Any, phi: Any) -> list[Any]:
        """R_z(phi) R_x(theta) R_z(chi), m / g = (sin theta sin chi, sin theta cos chi, cos theta)."""
        across = mp.sqrt((ax * mp.cos(am)) ** 2 + (ay * mp.sin(am)) ** 2)
        theta = mp.atan2(across, az * mp.sqrt(1 - k2 * mp.sin(am) ** 2))
        turns = mp.nint(am / mp.pi)
        rest = am - turns * mp.pi  # may be beyond pi / 2 by a rounding
        chi = mp.pi / 2 - drive * (mp.atan2(ay * mp.sin(rest), ax * mp.cos(rest)) + turns * mp.pi)
        return compose(compose(_turn(3, phi), _turn(1, theta)), _turn(3, chi))

    turned = compose(conjugate(frame(am_0, mp.mpf(0))), frame(am, phi))
    momentum = (ax * mp.cos(am), drive * ay * mp.sin(am), az * mp.sqrt(1 - k2 * mp.sin(am) ** 2))
    back, rates = [turned[0], None, None, None], [None, None, None]
    for k, axis in enumerate((x, y, z)):
        back[axis + 1] = sign[k] * turned[k + 1]
        rates[axis] = sign[k] * momentum[k] / i[axis]
    return compose(q_0, back), rates


def _third(n: Any, am: Any, k2: Any) -> Any:
    turns = mp.nint(am / mp.pi)
    return mp.ellippi(n, am - turns * mp.pi, k2) + 2 * turns * mp.ellippi(n, k2)


_BITS = 170
_ORDER = 30


def taylor(moments: Numbers, q_0: Numbers, omega_0: Numbers, t: float) -> tuple[list[Any], list[Any]]:
    """(q, omega) at t by Taylor series of order 30 in integers of 170 bits after the point. |omega t| up to some 100.

    Moments and rates of order 1.
    """
    with mp.workdps(60):
        one = 1 << _BITS
        i = [mp.mpf(x) for x in moments]
        factor = [int((i[k - 2] - i[k - 1]) / i[k] * one) for k in range(3)]
        length = mp.sqrt(sum(mp.mpf(x) ** 2 for x in q_0))
        state = [int(mp.mpf(x) / length * one) for x in q_0] + [int(mp.mpf(x) * one) for x in omega_0]
        rate = max(sum(abs(x) for x in omega_0), 1e-3)
        steps = max(1, int(abs(t) * rate / 0.12))
        h = int(mp.mpf(t) / steps * one)
        for _ in range(steps):
            state = _taylor_step(state, factor, h)
        result = [mp.mpf(x) / one for x in state]
        return result[:4], result[4:]


def _taylor_step(state: list[int], factor: list[int], h: int) -> list[int]:
    e, x, y, z, a, b, c = ([s] for s in state)

    def product(u: list[int], v: list[int]) -> int:
        return sum(map(operator.mul, u, reversed(v))) >> _BITS

    for k in range(_ORDER):
        rates = (
            (-product(x, a) - product(y, b) - product(z, c)) >> 1,
            (product(e, a) + product(y, c) - product(z, b)) >> 1,
            (product(e, b) - product(x, c) + product(z, a)) >> 1,
            (product(e, c) + product(x, b) - product(y, a)) >> 1,
            factor[0] * product(b, c) >> _BITS,
            factor[1] * product(c, a) >> _BITS,
            factor[2] * product(a, b) >> _BITS,
        )
        for series, rate in zip((e, x, y, z, a, b, c), rates, strict=True):
            series.append((rate * h >> _BITS) // (k + 1))
    return [sum(series) for series in (e, x, y, z, a, b, c)]


Case = tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...], float]
CLASSES = ("generic", "symmetric", "near-symmetric", "slow drift", "near-separatrix", "near the intermediate axis",
           "equilibrium", "1e6 periods")  # fmt: skip


def random_case(kind: str, rng: np.random.Generator) -> Case:
    """(moments, q_0, omega_0, t) of a random body of a class; axes in random order, signs random."""
    sides = rng.uniform(0.2, 1.0, 3)  # of a box
    low, middle, high = sorted(
        [sides[1] ** 2 + sides[2] ** 2, sides[0] ** 2 + sides[2] ** 2, sides[0] ** 2 + sides[1] ** 2]
    )
    omega = rng.normal(size=3)
    t = rng.uniform(-100.0, 100.0)
    if kind in ("symmetric", "near-symmetric"):
        stretch = 1.0 if kind == "symmetric" else 1.0 + 1e-12 * rng.uniform(0.1, 1.0)
        if rng.random() < 0.5:
            middle = low * stretch
        else:
            high = middle * stretch
    elif kind == "slow drift":
        low, middle, high = 1.0 + 1e-6 * rng.uniform(-1.0, 1.0, 3)
        t *= 1e5
    elif kind == "near-separatrix":
        ratio = math.sqrt(low * (middle - low) / (high * (high - middle)))
        omega[2] = omega[0] * ratio * (1.0 + 1e-12 * rng.uniform(-1.0, 1.0))
    elif kind == "near the intermediate axis":
        omega[[0, 2]] *= 10.0 ** rng.uniform(-12.0, -3.0, 2)
    elif kind == "equilibrium":
        shape = rng.integers(3)
        if shape == 0:  # about a principal axis
            omega *= np.eye(3)[rng.integers(3)]
        elif shape == 1:  # across a symmetric body's axis
            middle, omega[2] = low, 0.0
        else:
            low = middle = high
        t *= 10.0 ** rng.uniform(0.0, 6.0)
    elif kind == "1e6 periods":
        t *= 1e6
    order = rng.permutation(3)
    moments = np.array([low, middle, high])[order]
    q = rng.normal(size=4)
    q /= np.linalg.norm(q)
    return tuple(moments.tolist()), tuple(q.tolist()), tuple(omega[order].tolist()), float(t)
