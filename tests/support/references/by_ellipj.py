"""Torque-free motion as SciPy's users write it, after the textbook, beside `rbfmu.free_rotation`: errors and costs.

Landau & Lifshitz, Mechanics, par. 37: rates by Jacobi's functions, attitude by Euler angles ZXZ about the angular
momentum, whose precession is an elliptic integral of the third kind (by Carlson's R_F and R_J). The truth has 40
digits.
By hand: python -m tests.support.references.by_ellipj
"""

import math
import time
from collections.abc import Callable

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.special import ellipj, ellipk, ellipkinc, elliprf, elliprj

import rbfmu
from tests.support.references.free_rotation_mp import Numbers, angle_to, closed_form

Array = np.ndarray
MOMENTS, Q_0 = np.array([1.0, 2.0, 3.0]), [1.0, 0.0, 0.0, 0.0]
STARTS = {"generic": 1.0, "1e-3 from the middle axis": 1e-3, "1e-6": 1e-6, "1e-9": 1e-9}
BODIES, ROUNDS = 20, 9


def integral_of_third_kind(n: float, phi: Array, m: float) -> Array:
    """Return Legendre's incomplete integral Pi(n; phi | m) of any amplitude."""
    turns = np.round(phi / np.pi)
    s, c = np.sin(phi - turns * np.pi), np.cos(phi - turns * np.pi)
    x, y = c * c, 1.0 - m * s * s
    part = s * elliprf(x, y, 1.0) + n / 3.0 * s**3 * elliprj(x, y, 1.0, 1.0 - n * s * s)
    whole = elliprf(0.0, 1.0 - m, 1.0) + n / 3.0 * elliprj(0.0, 1.0 - m, 1.0, 1.0 - n)
    found: Array = 2.0 * turns * whole + part
    return found


def motion(moments: Array, omega_0: Array, t: Array) -> tuple[Array, Array]:
    """Return quaternions (times, 4), from no rotation on, and rates (times, 3) of a body with three unequal moments."""
    energy, h = omega_0 @ (moments * omega_0), float(np.linalg.norm(moments * omega_0))  # twice the kinetic energy
    axes = np.eye(3)
    if h * h < energy * moments[1]:
        axes = np.array(
            [[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]]
        )  # its third axis is the one it turns about
    (i1, i2, i3), w = np.abs(axes) @ moments, axes @ omega_0
    a, b = (np.sqrt((energy * i3 - h * h) / (i * (i3 - i))) for i in (i1, i2))
    c = np.copysign(np.sqrt((h * h - energy * i1) / (i3 * (i3 - i1))), w[2])
    m = (i2 - i1) * (energy * i3 - h * h) / ((i3 - i2) * (h * h - energy * i1))
    rate = np.copysign(np.sqrt((i3 - i2) * (h * h - energy * i1) / (i1 * i2 * i3)), c * (i3 - i2))
    begin = np.arctan2(w[1] / b, w[0] / a)
    u = ellipkinc(begin, m) + rate * t
    sn, cn, dn, _ = ellipj(u, m)
    rates = np.column_stack([a * cn, b * sn, c * dn])
    amplitude = np.arctan2(sn, cn)
    amplitude += 2.0 * np.pi * np.round((u - ellipkinc(amplitude, m)) / (4.0 * ellipk(m)))
    low = h * h - (i3 * c) ** 2
    n = -((i3 * c) ** 2) * m / low
    first = integral_of_third_kind(n, begin[None], m)
    third = (integral_of_third_kind(n, amplitude, m) - first) / rate
    precession = h * t / i3 + h * (energy - h * h / i3) / low * third
    nutation = np.arccos(np.clip(i3 * rates[:, 2] / h, -1.0, 1.0))
    own = np.arctan2(i1 * rates[:, 0], i2 * rates[:, 1])
    angles = np.column_stack([precession, nutation, own])
    if not np.isfinite(angles).all():  # m is 1 to the last digit, or beyond
        return np.full((len(t), 4), np.nan), np.full((len(t), 3), np.nan)
    at = Rotation.from_euler("ZXZ", angles)
    start = Rotation.from_euler("ZXZ", [0.0, np.arccos(i3 * w[2] / h), np.arctan2(i1 * w[0], i2 * w[1])])
    frame = Rotation.from_matrix(axes)
    quaternions: Array = (frame.inv() * start.inv() * at * frame).as_quat(scalar_first=True)
    return quaternions, rates @ axes


def start_of(distance: float, numbers: np.random.Generator) -> Array:
    """Return rates of a spin that is so far from the middle axis."""
    if distance == 1.0:
        drawn: Array = numbers.normal(size=3)
        return drawn
    return np.array([distance * numbers.normal(), 1.0, distance * numbers.normal()])


def worst_errors(distance: float, times: Array) -> tuple[float, float]:
    """Return the largest error of the attitude, rad, of SciPy's and of ours."""
    numbers, errors = np.random.default_rng(11), []
    for _ in range(BODIES):
        omega_0 = start_of(distance, numbers)
        of_scipy, _ = motion(MOMENTS, omega_0, times)
        of_rbfmu, _ = rbfmu.free_rotation(MOMENTS, Q_0, omega_0, times)
        for k, t in enumerate(times):
            truth, _ = closed_form(MOMENTS, (1, 0, 0, 0), omega_0, t)
            errors.append([least_angle(of_scipy[k], truth), least_angle(of_rbfmu[k], truth)])
    theirs, ours = np.max(errors, axis=0)
    return float(theirs), float(ours)


def least_angle(q: Array, truth: Numbers) -> float:
    """Return the angle between two attitudes, whatever the quaternions' signs."""
    return min(angle_to(q, truth), angle_to(-q, truth)) if np.isfinite(q).all() else math.nan


def seconds(run: Callable[[], object]) -> float:
    """Return the CPU time of a call."""
    begin = time.process_time()
    run()
    return time.process_time() - begin


def main() -> None:
    """Print a row a start: worst errors over 20 bodies, and nanoseconds a time of 10,000 times of one body."""
    times, many = np.array([0.7, 9.0, 40.0]), np.linspace(0.0, 40.0, 10_000)
    print("start                        SciPy, rad   rbfmu, rad   SciPy, ns   rbfmu, ns")
    for name, distance in STARTS.items():
        theirs, ours = worst_errors(distance, times)
        omega_0 = start_of(distance, np.random.default_rng(12))
        calls = [
            lambda w=omega_0: motion(MOMENTS, w, many),
            lambda w=omega_0: rbfmu.free_rotation(MOMENTS, Q_0, w, many),
        ]
        costs = np.median([[seconds(call) for call in calls] for _ in range(ROUNDS + 1)][1:], axis=0) / 1e-9 / len(many)
        print(f"{name:27} {theirs:12.1e} {ours:12.1e} {costs[0]:11.0f} {costs[1]:11.0f}")


if __name__ == "__main__":
    main()
