"""Laws 1 to 4 and 9: what integration does to an attitude's norm, phase and small angles."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from rbfmu.studies.reference_methods import REFERENCE_INTEGRATORS
from rbfmu.studies.stability.cases import NO_LOADS, SPHERE, UPRIGHT, angle, at, free_body, one_step, spin, turned
from rbfmu.studies.stability.findings import AT_MOST, RECORDED, Finding, Study, exponent
from rbfmu_kernels.integrators.dop853_tableau import STAGES, A
from rbfmu_kernels.mechanics.equations_of_motion import State
from rbfmu_kernels.rotations.euler_angles import ZYX, euler_from_quaternion, euler_rate_b
from rbfmu_kernels.rotations.matrix import matrix_from_quaternion
from rbfmu_kernels.rotations.rotation_vector import quaternion_from_rotvec, rotvec_from_quaternion, rotvec_rate_b

_BODY = free_body(SPHERE)
EPS = 2.0**-52


def stability_polynomial(method: str) -> Callable[[complex], complex]:
    """Return the stability polynomial R(z): a step multiplies y by R(h lambda) if dy/dt = lambda y."""
    if method == "DOP853":
        return _polynomial_of_the_tableau
    terms = {"explicit Euler": 1, "semi-implicit Euler": 1, "RK4": 4, "Taylor 8": 8, "Taylor 12": 12, "Taylor 16": 16}
    return lambda z: sum(z**k / math.factorial(k) for k in range(terms[method] + 1))


def _polynomial_of_the_tableau(z: complex) -> complex:
    """Return R(z) by the stages in turn; a solver of linear systems pivots, and loses digits as each processor sums."""
    stages: list[complex] = []
    for row in A[: STAGES + 1].tolist():
        stages.append(1.0 + z * sum(a * stage for a, stage in zip(row, stages, strict=False)))
    return stages[-1]


def crossing(growth: Callable[[float], float], low: float, high: float) -> float:
    """Return where the growth factor passes 1, from stable at `low` to unstable at `high`."""
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if growth(middle) <= 1.0 else (low, middle)
    return low


def quaternion_growth(method: str, h_omega: float) -> float:
    """Return |q| after one step of a body that turns by h omega."""
    return math.hypot(*one_step(method)(spin(h_omega), 1.0, _BODY, NO_LOADS).q_ab)


def matrix_growth(h_omega: float) -> float:
    """Return the length of R's first column after one step of RK4 on R."""
    method = REFERENCE_INTEGRATORS["RK4, matrix"]
    R_ab = method.steps(method.start(spin(h_omega)), 1.0, 1, _BODY, NO_LOADS).R_ab
    return math.hypot(R_ab[0][0], R_ab[1][0], R_ab[2][0])


def growth_factors(quick: bool) -> Study:
    """Measure laws 1 to 3: the factor by which a step scales an attitude, against h omega."""
    x = np.linspace(0.1, 13.0, 26 if quick else 130)
    columns: dict[str, Any] = {"h_omega": x.tolist()}
    named = {"explicit Euler": "explicit Euler", "RK4, quaternion not normalised": "RK4", "DOP853": "DOP853"}
    for method, polynomial in named.items():
        R = stability_polynomial(polynomial)
        columns[f"{method}, predicted"] = [abs(R(0.5j * value)) for value in x]
        columns[f"{method}, measured"] = [quaternion_growth(method, value) for value in x]
    R = stability_polynomial("RK4")
    columns["RK4, matrix, predicted"] = [abs(R(1j * value)) for value in x]
    columns["RK4, matrix, measured"] = [matrix_growth(value) for value in x]

    def limit(method: str, low: float, high: float) -> float:
        return crossing(lambda x: quaternion_growth(method, x), low, high)

    findings = [
        Finding(1, f"explicit Euler, growth of |q| a step, h omega = {x:g}", math.sqrt(1.0 + 0.25 * x * x),
                quaternion_growth("explicit Euler", x), 1e-15)
        for x in (0.1, 1.0, 10.0)
    ]  # fmt: skip
    findings += [
        Finding(2, "RK4 on q, largest stable h omega", 4.0 * math.sqrt(2.0),
                limit("RK4, quaternion not normalised", 5.0, 7.0), 1e-12),
        Finding(2, "DOP853 on q, largest stable h omega", 11.92, limit("DOP853", 11.0, 13.0), 1e-4),
        Finding(3, "RK4 on R, largest stable h omega", 2.0 * math.sqrt(2.0), crossing(matrix_growth, 2.0, 4.0), 1e-12),
    ]  # fmt: skip
    return Study("growth_factors", findings, columns)


def _matrix_drift(R_ab: Any) -> float:
    """Return |R^T R - I| in the 2-norm."""
    R = np.array(R_ab)
    return float(np.linalg.norm(R.T @ R - np.eye(3), 2))


def drift(quick: bool) -> Study:
    """Measure laws 2 and 3: the drift of |q| from 1 and of R^T R from I over many steps."""
    x, counts = 0.1, [10**k for k in range(0, 5 if quick else 7)]
    names = {"RK4, quaternion not normalised": "q", "RK4, matrix": "R", "RK4, quaternion": "q normalised"}
    columns: dict[str, Any] = {"steps": counts}
    states = {name: REFERENCE_INTEGRATORS[name].start(spin(1.0)) for name in names}
    done = 0
    for column in names.values():
        columns[column] = []
    for count in counts:
        for name, column in names.items():
            states[name] = REFERENCE_INTEGRATORS[name].steps(states[name], x, count - done, _BODY, NO_LOADS)
            state = states[name]
            drift = _matrix_drift(state.R_ab) if column == "R" else abs(math.hypot(*state.q_ab) - 1.0)
            columns[column].append(drift)
        done = count
    columns["q, predicted"] = [-math.expm1(n * math.log1p(-(x**6) / 9216.0)) for n in counts]
    columns["R, predicted"] = [-math.expm1(n * math.log1p(-(x**6) / 72.0)) for n in counts]
    n = 10_000
    k = counts.index(n)
    after = REFERENCE_INTEGRATORS["RK4, quaternion"].run(spin(1.0), x, n, _BODY, NO_LOADS)
    lag = angle(after, turned(spin(1.0), x * n))
    findings = [
        Finding(2, "RK4 on q, decay of |q| in 1e4 steps, h omega = 0.1", columns["q, predicted"][k], columns["q"][k],
                5e-4),
        Finding(2, "RK4 on q, lag of the angle in 1e4 steps, h omega = 0.1", n * x**5 / 1920.0, lag, 1e-3),
        Finding(3, "RK4 on R, |R^T R - I| after 1e4 steps, h omega = 0.1", columns["R, predicted"][k], columns["R"][k],
                2e-3),
        Finding(3, "|R^T R - I| over the decay of |q|^2", 64.0, columns["R"][k] / (2.0 * columns["q"][k]), 2e-3),
    ]  # fmt: skip
    return Study("drift", findings, columns)


_MISS = 0.01
"""The least angle between the nose (x axis) and the vertical, in rad."""


def _passage() -> State:
    """Return the state of a body at 1 rad/s whose nose (x axis) passes the vertical at an angle of _MISS."""
    return at(UPRIGHT, (0.0, math.cos(_MISS), math.sin(_MISS)))


def _passage_error(method: str, ratio: float) -> float:
    """Return the attitude's error after half a turn with h omega / delta = ratio."""
    n = round(math.pi / (ratio * _MISS))
    after = REFERENCE_INTEGRATORS[method].run(_passage(), math.pi / n, n, _BODY, NO_LOADS)
    return angle(after, turned(_passage(), math.pi))


def gimbal_passage(quick: bool) -> Study:
    """Measure law 4: roll, pitch and yaw of a body whose nose passes close to the vertical."""
    ratios = np.geomspace(0.1, 30.0, 9 if quick else 41).tolist()
    columns = {"h_omega_over_delta": ratios}
    columns |= {name: [_passage_error(name, r) for r in ratios] for name in ("RK4, Euler angles", "RK4, quaternion")}
    yaw_rates = []
    for t in np.linspace(0.45 * math.pi, 0.55 * math.pi, 2001).tolist():
        q_ab = turned(_passage(), t)
        yaw_rates.append(abs(euler_rate_b(ZYX, euler_from_quaternion(ZYX, q_ab), _passage()[3])[0]))
    findings = [
        Finding(4, "largest yaw rate over omega / delta, delta = 0.01", 1.0, max(yaw_rates) * _MISS, 1e-4),
        *(
            Finding(4, f"RK4 on angles, error in rad at h omega / delta = {ratio:g}", recorded,
                    _passage_error("RK4, Euler angles", ratio), 0.04, RECORDED)
            for ratio, recorded in ((10.0, 8e-2), (1.0, 3.6e-5), (0.1, 3e-9))
        ),
        Finding(4, "RK4 on angles, order from h omega / delta = 0.2 to 0.1", 4.0,
                exponent(_passage_error("RK4, Euler angles", 0.2), _passage_error("RK4, Euler angles", 0.1)), 0.02),
        Finding(4, "RK4 on q, lag in rad over half a turn with h = pi / 31", math.pi * (math.pi / 31) ** 4 / 1920,
                _passage_error("RK4, quaternion", 10.0), 1e-2),
    ]  # fmt: skip
    return Study("gimbal_passage", findings, columns)


def _dexp_coefficient(theta: float) -> float:
    """Return the factor of u x (u x omega) in du/dt, |u| = theta, as `rotvec_rate_b` computes it."""
    return (1.0 - rotvec_rate_b((theta, 0.0, 0.0), (0.0, 1.0, 0.0))[1]) / (theta * theta)


def _acos_of_trace(theta: float) -> float:
    R_ab = matrix_from_quaternion(quaternion_from_rotvec((theta, 0.0, 0.0)))
    return math.acos(max(-1.0, min(1.0, 0.5 * (R_ab[0][0] + R_ab[1][1] + R_ab[2][2] - 1.0))))


def small_angles(quick: bool) -> Study:
    """Measure law 9: formulas that suffer from cancellation at small angles."""
    thetas = np.geomspace(1e-12, 1.0, 37 if quick else 241).tolist()

    def relative(value: float, truth: float) -> float:
        return max(abs(value / truth - 1.0), 1e-17)

    def versine(theta: float) -> float:
        return 2.0 * math.sin(0.5 * theta) ** 2 / theta**2

    columns = {
        "theta": thetas,
        "acos of the trace": [relative(_acos_of_trace(x), x) for x in thetas],
        "(1 - cos) / theta^2": [relative((1.0 - math.cos(x)) / x**2, versine(x)) for x in thetas],
        "rotvec_from_quaternion": [
            relative(rotvec_from_quaternion(quaternion_from_rotvec((x, 0.0, 0.0)))[0], x) for x in thetas
        ],
    }
    findings = [
        *(
            Finding(9, f"inverse of dexp at 2 pi - {gap:g}, over 1 / (2 pi gap)", 1.0,
                    _dexp_coefficient(2.0 * math.pi - gap) * 2.0 * math.pi * gap, 2.0 * gap + 1e-15 / gap)
            for gap in (1e-2, 1e-4, 1e-6)
        ),
        Finding(9, "acos of the trace at theta = 1e-8", 0.0, _acos_of_trace(1e-8), 0.0),
        Finding(9, "(1 - cos) / theta^2 at theta = 1e-8, relative error", 1.0,
                relative((1.0 - math.cos(1e-8)) / 1e-16, versine(1e-8)), 1e-15),
        Finding(9, "rotation vector of a quaternion, 1e-12 to 1 rad: relative error", 4.0 * EPS,
                max(columns["rotvec_from_quaternion"]), 0.0, AT_MOST),
        Finding(9, "its way there, against sin(theta / 2): relative error", 2.0 * EPS,
                max(relative(quaternion_from_rotvec((x, 0.0, 0.0))[1], math.sin(0.5 * x)) for x in thetas), 0.0,
                AT_MOST),
    ]  # fmt: skip
    return Study("small_angles", findings, columns)
