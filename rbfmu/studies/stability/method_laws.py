"""Laws 1 to 9: errors of attitude and energy that integration methods make, and their largest stable steps."""

import math
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

import rbfmu_kernels as kernels
from rbfmu.runs.plan import Plan
from rbfmu.simulation import simulate
from rbfmu.studies import dop853, reference_methods
from rbfmu.studies.one_step import OneStepMethod
from rbfmu.studies.stability import CURVE, LAWS, OWN, Columns, Finding, Study, exponent, finding, motions
from rbfmu.studies.stability.motions import SPHERE, TUMBLING, UPRIGHT, ZERO, at, attitude_after, free_body, spin
from rbfmu_kernels.mechanics.equations_of_motion import NO_LOADS, angular_acceleration

EULER, SEMI, MIDPOINT, RK4, RK4_ON_Q, RK4_ON_R, RK4_ON_ANGLES, *_ = reference_methods.REFERENCE_INTEGRATORS.values()
MOSER_VESELOV, MOSER_VESELOV_10 = reference_methods.TORQUE_FREE_INTEGRATORS.values()
_BODY = free_body(SPHERE)
EPS = 2.0**-52


def _along(f: Callable[[OneStepMethod, float], float], x: Sequence[float], method: OneStepMethod) -> list[float]:
    return [f(method, value) for value in x]


def stability_polynomial(method: str) -> Callable[[complex], complex]:
    """Return the stability polynomial R(z) of a method: for dy/dt = lambda y, a step multiplies y by R(h lambda)."""
    if method == "DOP853":
        return _polynomial_of_the_tableau
    terms = {"explicit Euler": 1, "RK4": 4, "Taylor 8": 8, "Taylor 12": 12, "Taylor 16": 16}[method.split(",")[0]]
    return lambda z: sum(z**k / math.factorial(k) for k in range(terms + 1))


def _polynomial_of_the_tableau(z: complex) -> complex:
    """Return R(z), computed stage by stage; a linear solver would lose digits, differently on each processor."""
    stages: list[complex] = []
    for row in dop853.A[: dop853.STAGES + 1].tolist():
        stages.append(1.0 + z * sum(a * stage for a, stage in zip(row, stages, strict=False)))
    return stages[-1]


def crossing(holds: Callable[[float], bool], low: float, high: float) -> float:
    """Return the x, by bisection, up to which `holds(x)` is true; it is true at `low` and false at `high`."""
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low


def limit_near(factor: Callable[[float], float], limit: float) -> float:
    """Return the x up to which |factor(x)| of a step is at most 1, within 20 % of the expected limit."""
    return crossing(lambda x: abs(factor(x)) <= 1.0, 0.8 * limit, 1.2 * limit)


def growth(method: OneStepMethod, h_omega: float) -> float:
    """Return |q|, or the length of R's first column, after one step in which the body turns by h omega."""
    (attitude,) = (y[2] for y in method.path(spin(h_omega), 1.0, [1], _BODY))
    return math.hypot(*(row[0] for row in attitude) if method is RK4_ON_R else attitude)


def growth_factors(quick: bool) -> Study:
    """Measure laws 1 to 3: the factor by which a step scales |q| or R, as a function of h omega."""
    x = np.linspace(0.1, 13.0, 26 if quick else 130).tolist()
    curve = partial(_along, growth, x)
    columns: Columns = {"h_omega": x}
    for method in (EULER, RK4_ON_Q, dop853.DOP853, RK4_ON_R):
        R, eigenvalue = stability_polynomial(method.name), 1j if method is RK4_ON_R else 0.5j
        columns[f"{method.name}, predicted"] = [abs(R(eigenvalue * value)) for value in x]
        columns[f"{method.name}, measured"] = curve(method)
    limits = {"RK4 on q": 4.0 * math.sqrt(2.0), "DOP853 on q": 11.92, "RK4 on R": 2.0 * math.sqrt(2.0)}
    of_limits = zip((RK4_ON_Q, dop853.DOP853, RK4_ON_R), limits.items(), strict=True)
    findings = [
        *(finding("growth of Euler", growth(EULER, x), math.sqrt(1.0 + 0.25 * x * x), x=x) for x in (0.1, 1.0, 10.0)),
        *(finding(name, limit_near(partial(growth, method), limit), limit) for method, (name, limit) in of_limits),
    ]
    return Study("growth_factors", findings, columns, curve)


def _matrix_drift(R_ab: kernels.Matrix) -> float:
    """Return |R^T R - I| in the 2-norm."""
    R = np.array(R_ab)
    return float(np.linalg.norm(R.T @ R - np.eye(3), 2))


def drift(quick: bool) -> Study:
    """Measure laws 2 and 3: the drift of |q| from 1 and of R^T R from I over many steps."""
    x, counts = 0.1, [10**k for k in range(0, 5 if quick else 7)]
    columns: Columns = {"steps": counts}
    for method, column in ((RK4_ON_Q, "q"), (RK4_ON_R, "R"), (RK4, "q normalised")):
        states = method.path(spin(1.0), x, np.diff(counts, prepend=0).tolist(), _BODY)
        columns[column] = [_matrix_drift(y[2]) if column == "R" else abs(math.hypot(*y[2]) - 1.0) for y in states]
    for column, part in (("q", 9216.0), ("R", 72.0)):
        columns[f"{column}, predicted"] = [-math.expm1(n * math.log1p(-(x**6) / part)) for n in counts]
    n = 10_000
    after = {name: values[counts.index(n)] for name, values in columns.items()}
    lag = kernels.angle_between(RK4.run(spin(1.0), x, n, _BODY, NO_LOADS).q_ab, attitude_after(spin(1.0), x * n))
    findings = [
        finding("decay of q", after["q"], after["q, predicted"]),
        finding("lag on q", lag, n * x**5 / 1920.0),
        finding("drift of R", after["R"], after["R, predicted"]),
        finding("R over q", after["R"] / (2.0 * after["q"])),
    ]
    return Study("drift", findings, columns)


_MISS = 0.01
"""The least angle between the nose (x axis) and the vertical, in rad."""
_PASSAGE = at(UPRIGHT, (0.0, math.cos(_MISS), math.sin(_MISS)))
"""The initial state of a body at 1 rad/s whose nose passes the vertical at that angle."""


def passage_error(method: OneStepMethod, ratio: float) -> float:
    """Return the attitude error in rad after half a turn with h omega / delta = ratio, where delta is _MISS."""
    n = round(math.pi / (ratio * _MISS))
    after = method.run(_PASSAGE, math.pi / n, n, _BODY, NO_LOADS)
    return kernels.angle_between(after.q_ab, attitude_after(_PASSAGE, math.pi))


def gimbal_passage(quick: bool) -> Study:
    """Measure law 4: roll, pitch and yaw of a body whose nose passes close to the vertical."""
    ratios, on_angles = np.geomspace(0.1, 30.0, 9 if quick else 41).tolist(), partial(passage_error, RK4_ON_ANGLES)
    curve = partial(_along, passage_error, ratios)

    def yaw_rate(t: float) -> float:
        angles = kernels.euler_from_quaternion(kernels.ZYX, attitude_after(_PASSAGE, t))
        return abs(kernels.euler_rate_b(kernels.ZYX, angles, _PASSAGE.omega_b)[0])

    largest = max(map(yaw_rate, np.linspace(0.45 * math.pi, 0.55 * math.pi, 2001).tolist()))
    findings = [
        finding("yaw rate", largest * _MISS),
        *(finding("passage on angles", on_angles(x), error, x=x) for x, error in LAWS[4]["recorded"]),
        finding("order on angles", exponent(on_angles(0.2), on_angles(0.1))),
        finding("passage on q", passage_error(RK4, 10.0), math.pi * (math.pi / 31) ** 4 / 1920),
    ]
    columns = {"h_omega_over_delta": ratios} | {method.name: curve(method) for method in (RK4_ON_ANGLES, RK4)}
    return Study("gimbal_passage", findings, columns, curve)


_ROD = (1.0, 1.0, 0.01)
_RATE, _STEP = 30.0, 1.0 / 60.0
_NUTATION = _RATE * (1.0 - _ROD[2] / _ROD[0])


def _gains(method: OneStepMethod) -> dict[str, float]:
    """Return the gains of energy and |h|^2 of a brick in 1000 steps of 0.05 s, and the largest loss in a step.

    The gains are relative to the predicted ones.
    """
    h, body = 0.05, TUMBLING.body
    M = body.inertia

    def sizes(omega_b: kernels.Vec3) -> tuple[float, float]:
        return kernels.kinetic_energy(0.0, M, ZERO, omega_b), kernels.norm(kernels.angular_momentum(M, omega_b)) ** 2

    states = [TUMBLING.start, *method.path(TUMBLING.start, h, [1] * 1000, body)]
    gains = np.diff([sizes(y.omega_b) for y in states], axis=0)
    alphas = [angular_acceleration(y.q_ab, y.omega_b, body, NO_LOADS) for y in states[:-1]]
    predicted = [(h * h * energy, h * h * momentum) for energy, momentum in map(sizes, alphas)]
    gained, lost = np.sum(gains, axis=0) / np.sum(predicted, axis=0), -np.min(gains, axis=0)
    names = ("energy gained", "momentum gained", "energy lost", "momentum lost")
    return dict(zip(names, (*gained, *lost), strict=True))


def rod_growth(method: OneStepMethod) -> list[float]:
    """Return a rod's transverse rate, relative to its initial value, after 0 to 60 steps of 1/60 s."""
    start = at(UPRIGHT, (1e-3, 0.0, _RATE))
    path = method.path(start, _STEP, [1] * 60, free_body(_ROD))
    return [math.hypot(*y.omega_b[:2]) / 1e-3 for y in (start, *path)]


def gyroscopic_blow_up(quick: bool) -> Study:
    """Measure law 5: integrating the gyroscopic term explicitly adds energy."""
    factor = math.sqrt(1.0 + (_STEP * _NUTATION) ** 2)
    columns: Columns = {"time": [k * _STEP for k in range(61)], "predicted": [factor**k for k in range(61)]}
    columns |= {method.name: rod_growth(method) for method in (EULER, SEMI, RK4, MIDPOINT)}
    rates = [finding("growth of a rod", columns[m.name][-1], factor**60, name=m.name) for m in (EULER, SEMI)]
    rates.append(finding("that growth", columns[SEMI.name][-1]))
    gains = [finding(what, x, name=m.name) for m in (EULER, SEMI) for what, x in _gains(m).items()]
    return Study("gyroscopic_blow_up", rates + gains, columns, rod_growth)


def decay_factor(method: OneStepMethod, x: float) -> float:
    """Return the rate after one step of a damped spin of 1 rad/s with h d / I = x; NaN if the step fails."""
    return float(method.path(spin(1.0), 1.0, [1], free_body(SPHERE, (x, x, x)))[0].omega_b[2])


def _decay_of_plan(planned: Plan, x: float) -> float:
    """Return the same rate for a model of the library, with one substep per step."""
    scene = motions.scene_of(spin(1.0), ["omega_b"], 1.0, 1.0, {"body.inertia": SPHERE, "loads.damping_b": (x, x, x)})
    return float(simulate(scene, planned=planned).omega_b[1, 2])


_MODELS = {
    "DOP853": dop853.Dop853Plan("body under loads", "", 3, substep=1.0),
    **{f"Taylor {n}": Plan("body under loads, by series", "", 3, tolerance=math.inf, order=n) for n in (8, 12, 16)},
}
_DECAYS = {method.name: partial(decay_factor, method) for method in (EULER, SEMI, RK4, MIDPOINT)} | {
    name: partial(_decay_of_plan, planned) for name, planned in _MODELS.items()
}
"""The functions that return this rate for h d / I, by the name of the method or model."""


def damping_limits(quick: bool) -> Study:
    """Measure law 6: the largest h d / I at which a damped spin still decays."""
    x, damped = np.linspace(0.05, 8.0, 32 if quick else 160).tolist(), (EULER.name, RK4.name, "DOP853")
    columns = {"h d / I": x, "exact": [math.exp(-value) for value in x]}
    columns |= {name: [abs(_DECAYS[name](value)) for value in x] for name in (*damped, MIDPOINT.name)}
    columns |= {f"{name}, predicted": [abs(stability_polynomial(name)(-value)) for value in x] for name in damped}
    limits = [finding("damping limit", limit_near(_DECAYS[n], y), y, name=n) for n, y in LAWS[6]["limits"].items()]
    factors = [finding("damping factor", _DECAYS[n](3.0), stability_polynomial(n)(-3.0).real, name=n) for n in _MODELS]
    own = partial(_along, lambda method, value: abs(decay_factor(method, value)), x)
    return Study("damping_limits", limits + factors, columns, own)


def _moser_veselov_error(method: OneStepMethod, x: float) -> float:
    """Return the error in rad of one step in which a sphere turns by x rad; NaN if the step has no solution."""
    return kernels.angle_between(method.run(spin(1.0), x, 1, _BODY, NO_LOADS).q_ab, attitude_after(spin(1.0), x))


def _last_use(method: OneStepMethod, error: float) -> float:
    """Return the largest h omega for which a step has a solution with at most this error in rad."""
    return crossing(lambda x: _moser_veselov_error(method, x) <= error, 0.5, 3.0)


def moser_veselov_limits(quick: bool) -> Study:
    """Measure law 7: the discrete Moser-Veselov algorithm has no solution for large steps."""
    x = np.geomspace(0.02, 2.0, 21 if quick else 161).tolist()
    columns = {"h_omega": x}
    columns |= {method.name: _along(_moser_veselov_error, x, method) for method in (MOSER_VESELOV, MOSER_VESELOV_10)}
    columns["Moser-Veselov, predicted"] = [math.asin(value) - value if value <= 1.0 else math.nan for value in x]
    findings = [
        finding("Moser-Veselov", _last_use(MOSER_VESELOV, math.inf)),
        finding("Moser-Veselov 10", _last_use(MOSER_VESELOV_10, 0.01) / (0.5 * math.pi)),
        finding("error of a step", _moser_veselov_error(MOSER_VESELOV, 0.5), math.asin(0.5) - 0.5),
    ]
    return Study("moser_veselov_limits", findings, columns)


H = 0.1


def energies(method: OneStepMethod | None, h: float, counts: list[int]) -> list[float]:
    """Return the relative energy errors of the tumbling brick after each of these numbers of steps of h s.

    method: None for exact steps.
    """
    start = TUMBLING.start
    if method is None:
        found = motions.free_rates(start.omega_b, h * np.array(counts)).tolist()
    else:
        found = [y.omega_b for y in method.path(start, h, np.diff(counts, prepend=0).tolist(), TUMBLING.body)]
    M = TUMBLING.body.inertia
    sizes = [kernels.kinetic_energy(0.0, M, ZERO, tuple(omega_b)) for omega_b in (start.omega_b, *found)]
    return [size / sizes[0] - 1.0 for size in sizes[1:]]


def energy_drift(quick: bool) -> Study:
    """Measure law 8: the energy of a tumbling brick over long runs with h = 0.1 s."""
    counts = [10**k for k in range(0, 4 if quick else 6)]

    def curve(method: OneStepMethod | None) -> list[float]:
        return [abs(error) for error in energies(method, H, counts)]

    columns: Columns = {"steps": counts} | {m.name: curve(m) for m in (SEMI, RK4, MIDPOINT, MOSER_VESELOV_10)}
    columns["exact steps"] = curve(None)
    n, (coarse, longer), (finer,) = counts[-1], energies(RK4, H, [1000, 10_000]), energies(RK4, 0.5 * H, [20_000])
    findings = [
        finding("order of the drift", exponent(longer, finer)),
        finding("drift of RK4", coarse / H**5),
        finding("drift of Moser-Veselov", columns[MOSER_VESELOV_10.name][-1], 2.0 * EPS * math.sqrt(n), n=n),
        finding("drift of exact steps", max(columns["exact steps"]), 4.0 * EPS, n=n),
    ]
    if not quick:
        findings.append(finding("long drift of RK4", columns[RK4.name][-1]))
    return Study("energy_drift", findings, columns, curve)


def _acos_of_trace(theta: float) -> float:
    R_ab = kernels.matrix_from_quaternion(kernels.quaternion_from_rotvec((theta, 0.0, 0.0)))
    return math.acos(max(-1.0, min(1.0, 0.5 * (R_ab[0][0] + R_ab[1][1] + R_ab[2][2] - 1.0))))


def small_angles(quick: bool) -> Study:
    """Measure law 9: the errors of formulas with cancellation at small angles, and of those without."""

    def relative(value: float, truth: float) -> float:
        return max(abs(value / truth - 1.0), 1e-17)

    def plain_versine(theta: float) -> float:
        return relative((1.0 - math.cos(theta)) / theta**2, 2.0 * math.sin(0.5 * theta) ** 2 / theta**2)

    thetas = np.geomspace(1e-12, 1.0, 37 if quick else 241).tolist()
    turns = [kernels.quaternion_from_rotvec((x, 0.0, 0.0)) for x in thetas]
    there = [relative(q[1], math.sin(0.5 * x)) for q, x in zip(turns, thetas, strict=True)]
    back = [relative(kernels.rotvec_from_quaternion(q)[0], x) for q, x in zip(turns, thetas, strict=True)]
    columns = {
        "theta": thetas,
        "acos of the trace": [relative(_acos_of_trace(x), x) for x in thetas],
        "(1 - cos) / theta^2": [plain_versine(x) for x in thetas],
        "rotvec_from_quaternion": back,
    }

    def at_a_turn(gap: float) -> Finding:
        """Return the finding on the coefficient of u x (u x omega) in du/dt, as `rotvec_rate_b` computes it.

        gap: the angle in rad that is missing to a full turn, near which the coefficient is singular.
        """
        theta = 2.0 * math.pi - gap
        factor = (1.0 - kernels.rotvec_rate_b((theta, 0.0, 0.0), (0.0, 1.0, 0.0))[1]) / (theta * theta)
        return finding("dexp", factor * 2.0 * math.pi * gap, near=2.0 * gap + 1e-15 / gap, gap=gap)

    findings = [
        *map(at_a_turn, (1e-2, 1e-4, 1e-6)),
        finding("acos", _acos_of_trace(1e-8)),
        finding("versine", plain_versine(1e-8)),
        finding("rotation vector", max(back), 4.0 * EPS),
        finding("quaternion", max(there), 2.0 * EPS),
    ]
    return Study("small_angles", findings, columns)


# A user's own method: no theory predicts its results, so they are compared with an exact motion


ROUND_OFF, FINE, ROUGH, RATIO = 1e-11, 1e-8, 1e-3, 0.1


def own_laws(method: OneStepMethod, studies: Sequence[Study]) -> Study:
    """Return the findings on a user's method, and add its curves to the studies that have such curves."""
    for study in studies:
        if study.curve is not None:
            study.columns[CURVE] = study.curve(method)
    short, long = (abs(error) for error in energies(method, H, [1000, 10_000]))
    measured = (
        (1, "growth of |q| in a step less 1, h omega = 0.1", 0.0, growth(method, 0.1) - 1.0),
        (2, "largest h omega up to which |q| does not grow", math.inf, largest_stable(partial(growth, method))),
        (4, "error in rad at h omega / delta = 1", 0.0, passage_error(method, 1.0)),
        (5, "thin rod, nutation over its start after 1 s", 1.0, rod_growth(method)[-1]),
        (6, "largest h d / I", math.inf, largest_stable(partial(decay_factor, method))),
        (8, "relative energy error after 1000 steps, h = 0.1", 0.0, short),
        (8, "relative energy error after 10,000 steps", 0.0, long),
        (14, "order: the power of h in the attitude's error", math.inf, order(method)),
    )
    findings = [Finding(law, f"{method.name}: {what}", exact, found, 0.0, OWN) for law, what, exact, found in measured]
    return Study("your_method", findings)


def largest_stable(factor: Callable[[float], float]) -> float:
    """Return the x up to which |factor(x)| of a step is at most 1, within round-off; infinite if it is so up to 20."""
    last = 0.0
    for x in np.linspace(0.05, 20.0, 400).tolist():
        if not abs(factor(x)) - 1e-12 <= 1.0:
            return crossing(lambda x: abs(factor(x)) - 1e-12 <= 1.0, last, x)
        last = x
    return math.inf


def order(method: OneStepMethod) -> float:
    """Return the order from the errors of two steps, the finest above round-off; NaN if there are none.

    The coarsest steps are not used: there RK4 has order 4.5, as its energy error exceeds its lag.
    """
    before, found = math.inf, math.nan
    for k in range(10):
        error = motions.verdict_of_steps(method, 0.5 * 0.5**k, RATIO)[1]
        if ROUND_OFF < error < ROUGH and before < 64.0 * ROUGH:
            found = exponent(before, error)
        if before < FINE:
            break
        before = error
    return found
