"""Laws 5 to 8: what integration does to a body's energy, and how large a step may be."""

import math
from typing import Any

import numpy as np

from rbfmu.runs.plan import Plan
from rbfmu.studies.reference_methods import REFERENCE_INTEGRATORS, TORQUE_FREE_INTEGRATORS
from rbfmu.studies.stability.attitude_laws import crossing, stability_polynomial
from rbfmu.studies.stability.cases import (
    BRICK,
    NO_LOADS,
    SPHERE,
    TUMBLE,
    UPRIGHT,
    ZERO,
    angle,
    at,
    damped_rate,
    free_body,
    free_motion,
    one_step,
    rotational_energy,
    spin,
    turned,
)
from rbfmu.studies.stability.findings import AT_MOST, RECORDED, Finding, Study, exponent
from rbfmu_kernels.mechanics.equations_of_motion import State, angular_acceleration
from rbfmu_kernels.mechanics.newton_euler import angular_momentum, kinetic_energy
from rbfmu_kernels.rotations.vec3 import norm

_ROD = (1.0, 1.0, 0.01)
_RATE, _STEP = 30.0, 1.0 / 60.0
_NUTATION = _RATE * (1.0 - _ROD[2] / _ROD[0])


def _transverse(state: State) -> float:
    return math.hypot(state.omega_b[0], state.omega_b[1])


def _gains(method: str) -> tuple[float, float, float, float]:
    """Return the gains of energy and |h|^2 over theory's in 1000 steps of 0.05 s of BRICK, and the least gains."""
    y, h, body = TUMBLE, 0.05, free_body(BRICK)
    step = one_step(method)
    M = body.inertia
    gained, predicted, least = [0.0, 0.0], [0.0, 0.0], [math.inf, math.inf]
    for _ in range(1000):
        after = step(y, h, body, NO_LOADS)
        alpha = angular_acceleration(y.q_ab, y.omega_b, body, NO_LOADS)
        square = norm(angular_momentum(M, y.omega_b)) ** 2
        gain = (
            rotational_energy(BRICK, after) - rotational_energy(BRICK, y),
            norm(angular_momentum(M, after.omega_b)) ** 2 - square,
        )
        theory = (h * h * kinetic_energy(0.0, M, ZERO, alpha), (h * norm(angular_momentum(M, alpha))) ** 2)
        for i in range(2):
            gained[i] += gain[i]
            predicted[i] += theory[i]
            least[i] = min(least[i], gain[i])
        y = after
    return gained[0] / predicted[0], gained[1] / predicted[1], least[0], least[1]


def gyroscopic_blow_up(quick: bool) -> Study:
    """Measure law 5: an explicit gyroscopic term adds energy."""
    start, body = at(UPRIGHT, (1e-3, 0.0, _RATE)), free_body(_ROD)
    factor = math.sqrt(1.0 + (_STEP * _NUTATION) ** 2)
    names = ("explicit Euler", "semi-implicit Euler", "RK4, quaternion", "implicit midpoint")
    columns: dict[str, Any] = {"time": [k * _STEP for k in range(61)], "predicted": [factor**k for k in range(61)]}
    for name in names:
        states = [start]
        for _ in range(60):
            states.append(one_step(name)(states[-1], _STEP, body, NO_LOADS))
        columns[name] = [_transverse(s) / 1e-3 for s in states]
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
_POLYNOMIAL = {"RK4, quaternion": "RK4"}
_LIMITS = {"explicit Euler": 2.0, "semi-implicit Euler": 2.0, "RK4, quaternion": 2.785, "DOP853": 6.394}
_TAYLOR = {"Taylor 8": 4.314, "Taylor 12": 5.823, "Taylor 16": 7.324}
_MODELS = {
    "DOP853": Plan("body under loads", "", 3, substep=1.0),
    **{f"Taylor {n}": Plan("body under loads, by series", "", 3, tolerance=math.inf, order=n) for n in (8, 12, 16)},
}
"""Plans of the product's methods, with one substep per step."""


def decay_factor(method: str, x: float) -> float:
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
        R = stability_polynomial(_POLYNOMIAL.get(method, method))
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
    return angle(after, turned(spin(1.0), x))


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


_FREE = REFERENCE_INTEGRATORS | TORQUE_FREE_INTEGRATORS
_H = 0.1


def _energies(name: str, h: float, counts: list[int]) -> list[float]:
    """Return the relative energy errors of the tumbling brick after each of these numbers of steps."""
    start = rotational_energy(BRICK, TUMBLE)
    if name == "exact steps":
        rates = free_motion(BRICK, TUMBLE, h * counts[-1], h).omega_b[counts]
        states = [at(UPRIGHT, tuple(row)) for row in rates.tolist()]
    else:
        y, done, states = TUMBLE, 0, []
        for count in counts:
            y, done = _FREE[name].steps(y, h, count - done, free_body(BRICK), NO_LOADS), count
            states.append(y)
    return [rotational_energy(BRICK, y) / start - 1.0 for y in states]


def energy_drift(quick: bool) -> Study:
    """Measure law 8: the energy of a tumbling brick over long runs at h = 0.1."""
    counts = [10**k for k in range(0, 4 if quick else 6)]
    n, round_off = counts[-1], 2.0**-52 * math.sqrt(counts[-1])
    names = ("semi-implicit Euler", "RK4, quaternion", "implicit midpoint", "Moser-Veselov, order 10", "exact steps")
    signed = {name: _energies(name, _H, counts) for name in names}
    columns: dict[str, Any] = {"steps": counts} | {name: [abs(e) for e in signed[name]] for name in names}
    coarse, longer = _energies("RK4, quaternion", _H, [1000, 10_000])
    finer = _energies("RK4, quaternion", 0.5 * _H, [20_000])[0]
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
