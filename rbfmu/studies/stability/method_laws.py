"""Laws 1 to 9: what integration does to an attitude and to a body's energy, and how large a step may be."""

import math
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np

from rbfmu.runs.plan import Plan
from rbfmu.studies.dop853 import STAGES, A, Dop853Plan
from rbfmu.studies.reference_methods import (
    REFERENCE_INTEGRATORS,
    TORQUE_FREE_INTEGRATORS,
    OneStepMethod,
    integrator,
)
from rbfmu.studies.stability.findings import AT_MOST, RECORDED, Finding, Study, exponent
from rbfmu.studies.stability.motions import (
    BRICK,
    NO_LOADS,
    SPHERE,
    TUMBLE,
    UPRIGHT,
    ZERO,
    angle,
    at,
    attitude_after,
    damped_rate,
    free_body,
    free_motion,
    one_step,
    rotational_energy,
    spin,
)
from rbfmu_kernels.mechanics.equations_of_motion import State, angular_acceleration
from rbfmu_kernels.mechanics.newton_euler import angular_momentum, kinetic_energy
from rbfmu_kernels.rotations.euler_angles import ZYX, euler_from_quaternion, euler_rate_b
from rbfmu_kernels.rotations.matrix import matrix_from_quaternion
from rbfmu_kernels.rotations.rotation_vector import quaternion_from_rotvec, rotvec_from_quaternion, rotvec_rate_b
from rbfmu_kernels.rotations.vec3 import norm

_BODY = free_body(SPHERE)
EPS = 2.0**-52


def stability_polynomial(method: str) -> Callable[[complex], complex]:
    """Return the stability polynomial R(z): a step multiplies y by R(h lambda) if dy/dt = lambda y."""
    if method == "DOP853":
        return _polynomial_of_the_tableau
    terms = {"explicit Euler": 1, "RK4": 4, "Taylor 8": 8, "Taylor 12": 12, "Taylor 16": 16}[method.split(",")[0]]
    return lambda z: sum(z**k / math.factorial(k) for k in range(terms + 1))


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


def growth(method: str | OneStepMethod, h_omega: float) -> float:
    """Return |q|, or the length of R's first column, after one step of a body that turns by h omega."""
    attitude = one_step(method)(spin(h_omega), 1.0, _BODY, NO_LOADS)[2]
    return math.hypot(*(row[0] for row in attitude) if method == "RK4, matrix" else attitude)


def growth_factors(quick: bool) -> Study:
    """Measure laws 1 to 3: the factor by which a step scales an attitude, against h omega."""
    x = np.linspace(0.1, 13.0, 26 if quick else 130)
    columns: dict[str, Any] = {"h_omega": x.tolist()}
    for method in ("explicit Euler", "RK4, quaternion not normalised", "DOP853", "RK4, matrix"):
        R, eigenvalue = stability_polynomial(method), 1j if method == "RK4, matrix" else 0.5j
        columns[f"{method}, predicted"] = [abs(R(eigenvalue * value)) for value in x]
        columns[f"{method}, measured"] = [growth(method, value) for value in x]

    def limit(method: str, low: float, high: float) -> float:
        return crossing(lambda x: growth(method, x), low, high)

    findings = [
        Finding(1, f"explicit Euler, growth of |q| a step, h omega = {x:g}", math.sqrt(1.0 + 0.25 * x * x),
                growth("explicit Euler", x), 1e-15)
        for x in (0.1, 1.0, 10.0)
    ]  # fmt: skip
    findings += [
        Finding(2, "RK4 on q, largest stable h omega", 4.0 * math.sqrt(2.0),
                limit("RK4, quaternion not normalised", 5.0, 7.0), 1e-12),
        Finding(2, "DOP853 on q, largest stable h omega", 11.92, limit("DOP853", 11.0, 13.0), 1e-4),
        Finding(3, "RK4 on R, largest stable h omega", 2.0 * math.sqrt(2.0), limit("RK4, matrix", 2.0, 4.0), 1e-12),
    ]  # fmt: skip
    return Study("growth_factors", findings, columns)


def _between(counts: list[int]) -> list[int]:
    """Return the numbers of steps from each count to the next, the first from 0."""
    return [b - a for a, b in pairwise([0, *counts])]


def _matrix_drift(R_ab: Any) -> float:
    """Return |R^T R - I| in the 2-norm."""
    R = np.array(R_ab)
    return float(np.linalg.norm(R.T @ R - np.eye(3), 2))


def drift(quick: bool) -> Study:
    """Measure laws 2 and 3: the drift of |q| from 1 and of R^T R from I over many steps."""
    x, counts = 0.1, [10**k for k in range(0, 5 if quick else 7)]
    names = {"RK4, quaternion not normalised": "q", "RK4, matrix": "R", "RK4, quaternion": "q normalised"}
    columns: dict[str, Any] = {"steps": counts}
    for name, column in names.items():
        states = REFERENCE_INTEGRATORS[name].path(spin(1.0), x, _between(counts), _BODY)
        columns[column] = [_matrix_drift(y[2]) if column == "R" else abs(math.hypot(*y[2]) - 1.0) for y in states]
    columns["q, predicted"] = [-math.expm1(n * math.log1p(-(x**6) / 9216.0)) for n in counts]
    columns["R, predicted"] = [-math.expm1(n * math.log1p(-(x**6) / 72.0)) for n in counts]
    n = 10_000
    k = counts.index(n)
    after = REFERENCE_INTEGRATORS["RK4, quaternion"].run(spin(1.0), x, n, _BODY, NO_LOADS)
    lag = angle(after, attitude_after(spin(1.0), x * n))
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


def passage_error(method: str | OneStepMethod, ratio: float) -> float:
    """Return the attitude's error after half a turn with h omega / delta = ratio."""
    n = round(math.pi / (ratio * _MISS))
    after = integrator(method).run(_passage(), math.pi / n, n, _BODY, NO_LOADS)
    return angle(after, attitude_after(_passage(), math.pi))


def gimbal_passage(quick: bool) -> Study:
    """Measure law 4: roll, pitch and yaw of a body whose nose passes close to the vertical."""
    ratios = np.geomspace(0.1, 30.0, 9 if quick else 41).tolist()
    columns = {"h_omega_over_delta": ratios}
    columns |= {name: [passage_error(name, r) for r in ratios] for name in ("RK4, Euler angles", "RK4, quaternion")}
    yaw_rates = []
    for t in np.linspace(0.45 * math.pi, 0.55 * math.pi, 2001).tolist():
        q_ab = attitude_after(_passage(), t)
        yaw_rates.append(abs(euler_rate_b(ZYX, euler_from_quaternion(ZYX, q_ab), _passage()[3])[0]))
    findings = [
        Finding(4, "largest yaw rate over omega / delta, delta = 0.01", 1.0, max(yaw_rates) * _MISS, 1e-4),
        *(
            Finding(4, f"RK4 on angles, error in rad at h omega / delta = {ratio:g}", recorded,
                    passage_error("RK4, Euler angles", ratio), 0.04, RECORDED)
            for ratio, recorded in ((10.0, 8e-2), (1.0, 3.6e-5), (0.1, 3e-9))
        ),
        Finding(4, "RK4 on angles, order from h omega / delta = 0.2 to 0.1", 4.0,
                exponent(passage_error("RK4, Euler angles", 0.2), passage_error("RK4, Euler angles", 0.1)), 0.02),
        Finding(4, "RK4 on q, lag in rad over half a turn with h = pi / 31", math.pi * (math.pi / 31) ** 4 / 1920,
                passage_error("RK4, quaternion", 10.0), 1e-2),
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


_ROD = (1.0, 1.0, 0.01)
_RATE, _STEP = 30.0, 1.0 / 60.0
_NUTATION = _RATE * (1.0 - _ROD[2] / _ROD[0])


def _gains(method: str) -> tuple[float, float, float, float]:
    """Return the gains of energy and |h|^2 over theory's in 1000 steps of 0.05 s of BRICK, and the least gains."""
    h, body = 0.05, free_body(BRICK)
    M = body.inertia

    def sizes(omega_b: Any) -> tuple[float, float]:
        return kinetic_energy(0.0, M, ZERO, omega_b), norm(angular_momentum(M, omega_b)) ** 2

    states = [TUMBLE, *REFERENCE_INTEGRATORS[method].path(TUMBLE, h, [1] * 1000, body)]
    gains = np.diff([sizes(y.omega_b) for y in states], axis=0)
    alphas = [angular_acceleration(y.q_ab, y.omega_b, body, NO_LOADS) for y in states[:-1]]
    predicted = [(h * h * kinetic_energy(0.0, M, ZERO, a), (h * norm(angular_momentum(M, a))) ** 2) for a in alphas]
    energy, momentum = np.sum(gains, axis=0) / np.sum(predicted, axis=0)
    return energy, momentum, *np.min(gains, axis=0)


def rod_growth(method: str | OneStepMethod) -> list[float]:
    """Return a rod's transverse rate over its start after 0 to 60 steps, in one second."""
    start = at(UPRIGHT, (1e-3, 0.0, _RATE))
    states = [start, *integrator(method).path(start, _STEP, [1] * 60, free_body(_ROD))]
    return [math.hypot(*y.omega_b[:2]) / 1e-3 for y in states]


def gyroscopic_blow_up(quick: bool) -> Study:
    """Measure law 5: an explicit gyroscopic term adds energy."""
    factor = math.sqrt(1.0 + (_STEP * _NUTATION) ** 2)
    names = ("explicit Euler", "semi-implicit Euler", "RK4, quaternion", "implicit midpoint")
    columns: dict[str, Any] = {"time": [k * _STEP for k in range(61)], "predicted": [factor**k for k in range(61)]}
    for name in names:
        columns[name] = rod_growth(name)
    findings = [
        Finding(5, f"{name}, growth of a rod's transverse rate in 1 s, 30 rad/s at 60 Hz", factor**60,
                columns[name][-1], 1e-12)
        for name in names[:2]
    ]  # fmt: skip
    findings.append(Finding(5, "that growth", 717.0, columns["semi-implicit Euler"][-1], 1e-3))
    for name in names[:2]:
        energy, momentum, least_energy, least_momentum = _gains(name)
        findings += [
            Finding(5, f"{name}, brick: energy gained over the sum of h^2 alpha . M alpha / 2", 1.0, energy, 1e-10),
            Finding(5, f"{name}, brick: |h|^2 gained over the sum of h^2 |M alpha|^2", 1.0, momentum, 1e-10),
            Finding(5, f"{name}, brick: loss of energy in any step", 0.0, -least_energy, 0.0, AT_MOST),
            Finding(5, f"{name}, brick: loss of |h|^2 in any step", 0.0, -least_momentum, 0.0, AT_MOST),
        ]
    return Study("gyroscopic_blow_up", findings, columns)


_DAMPED = ("explicit Euler", "RK4, quaternion", "DOP853")
_LIMITS = {"explicit Euler": 2.0, "semi-implicit Euler": 2.0, "RK4, quaternion": 2.785, "DOP853": 6.394}
_TAYLOR = {"Taylor 8": 4.314, "Taylor 12": 5.823, "Taylor 16": 7.324}
_MODELS = {
    "DOP853": Dop853Plan("body under loads", "", 3, substep=1.0),
    **{f"Taylor {n}": Plan("body under loads, by series", "", 3, tolerance=math.inf, order=n) for n in (8, 12, 16)},
}
"""Plans of the product's methods, with one substep per step."""


def decay_factor(method: str | OneStepMethod, x: float) -> float:
    """Return the rate after one step of a damped spin of 1 rad/s with h d / I = x; NaN if there is no step."""
    if method in _MODELS:
        return damped_rate(_MODELS[method], x)
    return float(one_step(method)(spin(1.0), 1.0, free_body(SPHERE, (x, x, x)), NO_LOADS).omega_b[2])


def damping_limits(quick: bool) -> Study:
    """Measure law 6: the largest h d / I at which a damped spin still decays."""
    x = np.linspace(0.05, 8.0, 32 if quick else 160).tolist()
    columns: dict[str, Any] = {"h d / I": x, "exact": [math.exp(-value) for value in x]}
    for method in (*_DAMPED, "implicit midpoint"):
        columns[method] = [abs(decay_factor(method, value)) for value in x]
    for method in _DAMPED:
        R = stability_polynomial(method)
        columns[f"{method}, predicted"] = [abs(R(-value)) for value in x]
    findings = [
        Finding(6, f"{method}, largest h d / I", limit,
                crossing(lambda x: abs(decay_factor(method, x)), 0.8 * limit, 1.2 * limit), 2e-4)  # noqa: B023
        for method, limit in (_LIMITS | _TAYLOR).items()
    ]  # fmt: skip
    findings += [
        Finding(6, f"{method}, a step's factor at h d / I = 3", stability_polynomial(method)(-3.0).real,
                decay_factor(method, 3.0), 1e-12)
        for method in _MODELS
    ]  # fmt: skip
    return Study("damping_limits", findings, columns)


def _moser_veselov_error(method: str, x: float) -> float:
    """Return the error in rad of one step of a sphere that turns by x; NaN where there is no solution."""
    after = TORQUE_FREE_INTEGRATORS[method].run(spin(1.0), x, 1, free_body(SPHERE), NO_LOADS)
    return angle(after, attitude_after(spin(1.0), x))


def _last_use(method: str, error: float) -> float:
    """Return the h omega up to which a step has a solution with at most this error in rad."""
    return crossing(lambda x: 0.0 if _moser_veselov_error(method, x) <= error else 2.0, 0.5, 3.0)


def moser_veselov_limits(quick: bool) -> Study:
    """Measure law 7: the discrete Moser-Veselov algorithm has no solution for large steps."""
    x = np.geomspace(0.02, 2.0, 21 if quick else 161).tolist()
    columns: dict[str, Any] = {"h_omega": x}
    columns |= {name: [_moser_veselov_error(name, value) for value in x] for name in TORQUE_FREE_INTEGRATORS}
    columns["Moser-Veselov, predicted"] = [math.asin(value) - value if value <= 1.0 else math.nan for value in x]
    findings = [
        Finding(7, "Moser-Veselov, last h omega with a solution", 1.0, _last_use("Moser-Veselov", math.inf), 1e-4),
        Finding(7, "Moser-Veselov, order 10, last h omega with the error below 0.01 rad, over pi / 2", 1.0,
                _last_use("Moser-Veselov, order 10", 0.01) / (0.5 * math.pi), 4e-3),
        Finding(7, "Moser-Veselov, error of a step at h omega = 0.5: asin(h omega) - h omega", math.asin(0.5) - 0.5,
                _moser_veselov_error("Moser-Veselov", 0.5), 1e-12),
    ]  # fmt: skip
    return Study("moser_veselov_limits", findings, columns)


_H = 0.1


def energies(name: str | OneStepMethod, h: float, counts: list[int]) -> list[float]:
    """Return the relative energy errors of the tumbling brick after each of these numbers of steps."""
    start = rotational_energy(BRICK, TUMBLE)
    if name == "exact steps":
        rates = free_motion(BRICK, TUMBLE, h * counts[-1], h).omega_b[counts]
        states = [at(UPRIGHT, tuple(row)) for row in rates.tolist()]
    else:
        states = integrator(name).path(TUMBLE, h, _between(counts), free_body(BRICK))
    return [rotational_energy(BRICK, y) / start - 1.0 for y in states]


def energy_drift(quick: bool) -> Study:
    """Measure law 8: the energy of a tumbling brick over long runs at h = 0.1."""
    counts = [10**k for k in range(0, 4 if quick else 6)]
    n, round_off = counts[-1], 2.0**-52 * math.sqrt(counts[-1])
    names = ("semi-implicit Euler", "RK4, quaternion", "implicit midpoint", "Moser-Veselov, order 10", "exact steps")
    signed = {name: energies(name, _H, counts) for name in names}
    columns: dict[str, Any] = {"steps": counts} | {name: [abs(e) for e in signed[name]] for name in names}
    coarse, longer = energies("RK4, quaternion", _H, [1000, 10_000])
    finer = energies("RK4, quaternion", 0.5 * _H, [20_000])[0]
    findings = [
        Finding(8, "RK4, power of h in the energy error after 1000 s", 5.0, exponent(longer, finer), 0.02),
        Finding(8, "RK4, relative energy error over h^5 per 100 s", -0.0277, coarse / _H**5, 0.01, RECORDED),
        Finding(8, f"Moser-Veselov, order 10, energy error, {n:g} steps", 2.0 * round_off,
                columns["Moser-Veselov, order 10"][-1], 0.0, AT_MOST),
        Finding(8, f"exact motion, largest energy error up to {n:g} steps", 4.0 * 2.0**-52, max(columns["exact steps"]),
                0.0, AT_MOST),
    ]  # fmt: skip
    if not quick:
        findings += [
            Finding(8, "RK4, relative energy error after 1e5 steps", 2.6e-5, columns["RK4, quaternion"][-1], 4e-3,
                    RECORDED),
        ]  # fmt: skip
    return Study("energy_drift", findings, columns)
