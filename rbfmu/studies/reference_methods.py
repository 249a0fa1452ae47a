"""One-step methods in common use, with which the charts and stability laws compare; they are no part of the product.

Each integrates the right-hand sides of `rbfmu_kernels.mechanics.equations_of_motion` with its tuples `State`, `Body`
and `Loads`, but may represent the attitude in another form. `OneStepMethod.start` converts a state to that form,
`steps` advances it by any number of steps (so that drift accumulates as it does for users), and `state_of` converts it
back, with a unit quaternion.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

from numba import njit

from rbfmu.studies.one_step import F, Form, OneStepMethod, Steps, compiled, convert, of_step
from rbfmu_kernels import ZYX, Matrix, Quaternion, Vec3, add_scaled_matrix, quaternion_from_rotvec
from rbfmu_kernels.compile.decorator import kernel
from rbfmu_kernels.integrators.splitting import rkn4_steps, rkn6_steps, strang_steps
from rbfmu_kernels.mechanics import equations_of_motion as motion
from rbfmu_kernels.mechanics.equations_of_motion import Body, Loads, Rates, State, state_rates
from rbfmu_kernels.rotations import euler_angles as euler, matrix as matrices
from rbfmu_kernels.rotations.quaternion import add_scaled_quaternion, compose_quaternions, normalize, quaternion_rate_b
from rbfmu_kernels.rotations.vec3 import add, add_scaled, cross, dot, scale, subtract


class OtherState(NamedTuple):
    """A state whose attitude is R_ab, three Euler angles or a rotation vector; or its time derivative."""

    r_c: Vec3
    v_c: Vec3
    attitude: Any
    omega_b: Vec3


_inlined: Callable[[F], F] = njit(error_model="numpy", forceinline=True)
Advance = Callable[[Form, float, Form], Form]
"""A function (state, s, rates) that returns state + s rates."""
NONE: Vec3 = (0.0, 0.0, 0.0)
NO_TURN: Quaternion = (1.0, 0.0, 0.0, 0.0)
MAX_ROUNDS = 100


# Quaternions


def _advance_by(kind: Callable[..., Form], add: Callable[[Any, float, Any], object]) -> Advance:
    """Return the function state + s rates for states of a kind; `add` is the same function for attitudes."""

    @_inlined
    def advance(state: Form, s: float, rates: Form) -> Form:
        r, v, attitude, omega = state
        dr, dv, turned, dw = rates
        return kind(add_scaled(r, s, dr), add_scaled(v, s, dv), add(attitude, s, turned), add_scaled(omega, s, dw))

    return advance


advance: Callable[[State, float, Rates], State] = _advance_by(State, add_scaled_quaternion)


@kernel
def _unit_attitude(state: State) -> State:
    """Return the state with its quaternion scaled to length 1; a step has left |q| within 10 % of 1."""
    r, v, q, omega = state
    s = 1.0 / math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    return State(r, v, (s * q[0], s * q[1], s * q[2], s * q[3]), omega)


@kernel(inline=False)
def explicit_euler_step(state: State, h: float, body: Body, loads: Loads) -> State:
    """Return y + h f(y): |q| grows by sqrt(1 + (h omega)^2 / 4), a symmetric body's nutation by sqrt(1 + (h nu)^2)."""
    return advance(state, h, state_rates(state, body, loads))


@kernel(inline=False)
def semi_implicit_euler_step(state: State, h: float, body: Body, loads: Loads) -> State:
    """Advance the rates first, then position and attitude with the new rates, and normalise, as game engines do."""
    r, v, q, omega = state
    v = add_scaled(v, h, motion.linear_acceleration(q, body, loads))
    omega = add_scaled(omega, h, motion.angular_acceleration(q, omega, body, loads))
    return _unit_attitude(advance(State(r, v, q, omega), h, Rates(v, NONE, quaternion_rate_b(q, omega), NONE)))


def _sum_of(advance: Advance) -> Callable[[Form, Form, Form, Form], Form]:
    """Return a function that adds k1 + 2 k2 + 2 k3 + k4; a step then rounds the state once, not four times."""

    @_inlined
    def add_up(k1: Form, k2: Form, k3: Form, k4: Form) -> Form:
        return advance(advance(advance(k1, 1.0, k4), 2.0, k2), 2.0, k3)

    return add_up


def rk4(rates: Callable[..., Form], advance: Advance) -> Callable[..., Form]:
    """Return a step of the classical Runge-Kutta method of order 4; `more` is passed to the rates.

    Applied to q without normalisation, a step scales |q| by 1 - (h omega)^6 / 9216. Steps are stable up to
    h omega = 4 sqrt 2 (attitude) and h d / I = 2.785 (damping). Applied to the nine numbers of R, it gives
    |R^T R - I| = n (h omega)^6 / 72 after n steps. For yaw, pitch, roll (ZYX) it is singular where cos(pitch) = 0.
    """
    add_up = _sum_of(advance)

    @compiled
    def step(y: Form, h: float, *more: object) -> Form:
        k1 = rates(y, *more)
        k2 = rates(advance(y, 0.5 * h, k1), *more)
        k3 = rates(advance(y, 0.5 * h, k2), *more)
        return advance(y, h / 6.0, add_up(k1, k2, k3, rates(advance(y, h, k3), *more)))

    return step


rk4_not_normalised_step = rk4(state_rates, advance)


@compiled
def rk4_step(state: State, h: float, body: Body, loads: Loads) -> State:
    """Take a step of classical Runge-Kutta and normalise the attitude after it."""
    return _unit_attitude(rk4_not_normalised_step(state, h, body, loads))


@kernel
def _difference(a: State, b: State) -> float:
    """Return the 1-norm of b - a over quaternion and rates."""
    q, p = a.q_ab, b.q_ab
    turn = abs(p[0] - q[0]) + abs(p[1] - q[1]) + abs(p[2] - q[2]) + abs(p[3] - q[3])
    u, w = a.omega_b, b.omega_b
    return turn + abs(w[0] - u[0]) + abs(w[1] - u[1]) + abs(w[2] - u[2])


@kernel(inline=False)
def midpoint(state: State, h: float, body: Body, loads: Loads) -> tuple[State, float]:
    """Return (y, rounds) with y = state + h / 2 f(y), by fixed-point iteration; rounds = MAX_ROUNDS if it fails."""
    middle, change, rounds, omega = state, 1.0, 0.0, state.omega_b
    size = 1.0 + abs(omega[0]) + abs(omega[1]) + abs(omega[2])
    while change > 1e-15 * size and rounds < MAX_ROUNDS:
        after = advance(state, 0.5 * h, state_rates(middle, body, loads))
        change = _difference(middle, after)
        middle = after
        rounds += 1.0
    return middle, rounds


@kernel(inline=False)
def implicit_midpoint_step(state: State, h: float, body: Body, loads: Loads) -> State:
    """Return y + h f((y + y_next) / 2): conserves |q|, energy, |h| of a free body; not finite if iteration fails."""
    middle, rounds = midpoint(state, h, body, loads)
    settled = h if rounds < MAX_ROUNDS else h * float("inf")
    return advance(state, settled, state_rates(middle, body, loads))


# Rotation matrices and Euler angles: the loads are decomposed in b first


@kernel
def _accelerations(R_ab: Matrix, omega_b: Vec3, body: Body, loads: Loads) -> tuple[Vec3, Vec3]:
    R_ba = matrices.invert_matrix(R_ab)
    force_a = add(loads.force_a, matrices.transform(R_ab, loads.force_b))
    force_b = add(loads.force_b, matrices.transform(R_ba, loads.force_a))
    torque_b = add(loads.torque_b, matrices.transform(R_ba, loads.torque_a))
    in_a, in_b = Loads(loads.gravity_a, force_a, NONE, NONE, NONE), Loads(NONE, NONE, force_b, NONE, torque_b)
    a_c = motion.linear_acceleration(NO_TURN, body, in_a)
    return a_c, motion.angular_acceleration(NO_TURN, omega_b, body, in_b)


@kernel(inline=False)
def _matrix_rates(state: OtherState, body: Body, loads: Loads) -> OtherState:
    _, v, R_ab, omega = state
    a_c, alpha = _accelerations(R_ab, omega, body, loads)
    return OtherState(v, a_c, matrices.matrix_rate_b(R_ab, omega), alpha)


@kernel(inline=False)
def _angle_rates(state: OtherState, body: Body, loads: Loads) -> OtherState:
    _, v, angles, omega = state
    a_c, alpha = _accelerations(euler.matrix_from_euler(ZYX, angles), omega, body, loads)
    return OtherState(v, a_c, euler.euler_rate_b(ZYX, angles, omega), alpha)


_advance_vector, _advance_matrix = _advance_by(OtherState, add_scaled), _advance_by(OtherState, add_scaled_matrix)


# Lie group methods: within a step, the attitude is q exp(u)


@kernel
def _local_state(local: OtherState, q: Quaternion) -> State:
    r, v, u, omega = local
    return State(r, v, compose_quaternions(q, quaternion_from_rotvec(u)), omega)


@kernel(inline=False)
def _local_rates(local: OtherState, q: Quaternion, correction: float, body: Body, loads: Loads) -> OtherState:
    """Return rates with du/dt = omega + u x omega / 2 + u x (u x omega) / 12 (order 4); omega if correction = 0."""
    v, a_c, _, alpha = state_rates(_local_state(local, q), body, loads)
    u, omega = local.attitude, local.omega_b
    turned = cross(u, omega)
    du = add_scaled(add_scaled(omega, 0.5 * correction, turned), correction / 12.0, cross(u, turned))
    return OtherState(v, a_c, du, alpha)


_local_rk4, _summed_rates = rk4(_local_rates, _advance_vector), _sum_of(_advance_vector)


@compiled
def rkmk4_step(state: State, h: float, body: Body, loads: Loads) -> State:
    """Take a step of classical Runge-Kutta on the rotation vector of the step (Munthe-Kaas 1998)."""
    r, v, q, omega = state
    return _local_state(_local_rk4(OtherState(r, v, NONE, omega), h, q, 1.0, body, loads), q)


@compiled
def cf4_step(state: State, h: float, body: Body, loads: Loads) -> State:
    """Take a step of the commutator-free Lie group method of order 4 (Celledoni, Marthinsen & Owren 2003)."""
    r, v, q, omega = state
    local = OtherState(r, v, NONE, omega)
    k1 = _local_rates(local, q, 0.0, body, loads)
    y2 = _advance_vector(local, 0.5 * h, k1)
    k2 = _local_rates(y2, q, 0.0, body, loads)
    k3 = _local_rates(_advance_vector(local, 0.5 * h, k2), q, 0.0, body, loads)
    y4 = _advance_vector(local, h, k3)
    q2 = compose_quaternions(q, quaternion_from_rotvec(y2.attitude))
    last = OtherState(y4.r_c, y4.v_c, subtract(y4.attitude, y2.attitude), y4.omega_b)
    k4 = _local_rates(last, q2, 0.0, body, loads)
    r, v, u, omega = _advance_vector(local, h / 6.0, _summed_rates(k1, k2, k3, k4))
    u = scale(0.5, u)
    lean = scale(h / 6.0, subtract(k1.attitude, k4.attitude))
    q = compose_quaternions(q, quaternion_from_rotvec(add(u, lean)))
    return State(r, v, compose_quaternions(q, quaternion_from_rotvec(subtract(u, lean))), omega)


# The discrete Moser-Veselov algorithm for torque-free bodies, plain (order 2) and preprocessed to order 10
#
# It conserves the angular momentum and a modified energy exactly; each step solves for three numbers by fixed-point
# iteration. Preprocessing (E. Hairer & G. Vilmart, J. Phys. A 39 (2006); R. McLachlan & A. Zanna, Found. Comput. Math.
# 5 (2005)) replaces the moments of inertia by functions of the step size, of |h|^2 and of the energy, which raises the
# order at no cost per step.

MOST_ROUNDS = 10_000  # the iteration is slow near the largest step that has a solution


@kernel(inline=False)
def _moser_veselov_steps(state: State, h: float, n: int, moments: Vec3, inverse: Vec3) -> State:
    """Take n steps with modified inverse moments; each turns by R = (1 + skew(c)) (1 - skew(c))^-1, c = (x, y, z)."""
    r, v, q, omega = state
    m = (moments[0] * omega[0], moments[1] * omega[1], moments[2] * omega[2])
    i, j, k = 1.0 / inverse[0], 1.0 / inverse[1], 1.0 / inverse[2]
    g = (j - k, k - i, i - j)
    f = (g[0] / i, g[1] / j, g[2] / k)
    for _ in range(n):
        a = (0.5 * h * m[0] * inverse[0], 0.5 * h * m[1] * inverse[1], 0.5 * h * m[2] * inverse[2])
        x, y, z = a
        change, rounds = 1.0, 0
        while change > 1e-16 and rounds < MOST_ROUNDS:
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
    """Return coefficients of C, H, C^2, CH, H^2, ... H^4 (orders 4, 4, 6, 6, 6, ... 10) in s and d of `_modified`."""
    a, b, c = moments
    D = a * b * c

    def powers(n: int) -> float:
        return float(a**n + b**n + c**n)

    def mixed(n: int, m: int) -> float:
        return float((a**n + b**n) / c**m + (b**n + c**n) / a**m + (c**n + a**n) / b**m)

    X1, X2, X3, X4 = (powers(-n) for n in (1, 2, 3, 4))
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
    """Return the inverse moments (1 + s(C, H)) / I + d(C, H), C = h^2 |m|^2 / 2, H = h^2 m . omega / 2, m = I omega."""
    m = (moments[0] * omega[0], moments[1] * omega[1], moments[2] * omega[2])
    C, H = 0.5 * h * h * dot(m, m), 0.5 * h * h * dot(m, omega)
    terms = [C**i * H**j for i, j in _DEGREES if 2 * (i + j) + 2 <= order]
    s, d = (sum(c * t for c, t in zip(series, terms, strict=False)) for series in _coefficients(moments))
    return ((1.0 + s) / moments[0] + d, (1.0 + s) / moments[1] + d, (1.0 + s) / moments[2] + d)


def moser_veselov(order: int) -> Steps:
    """Return `steps(y, h, n, body, loads)` of order 2, 4, 6, 8 or 10; loads and off-diagonal M are ignored."""

    def steps(y: State, h: float, n: int, body: Body, loads: Loads) -> State:
        M = body.inertia
        unit = 2.0 ** round(math.log2(max(M[0][0], M[1][1], M[2][2])))  # else powers of a planet's moments overflow
        moments = (M[0][0] / unit, M[1][1] / unit, M[2][2] / unit)
        return _moser_veselov_steps(y, h, n, moments, _modified(order, h, moments, y.omega_b))

    return steps


# The methods by name


_MATRIX = convert(OtherState, matrices.matrix_from_quaternion), convert(State, matrices.quaternion_from_matrix)
_ANGLES = (
    convert(OtherState, lambda q: euler.euler_from_quaternion(ZYX, q)),
    convert(State, lambda angles: euler.quaternion_from_euler(ZYX, angles)),
)
REFERENCE_INTEGRATORS = {method.name: method for method in (
    of_step("explicit Euler", explicit_euler_step, 1, 1),
    of_step("semi-implicit Euler", semi_implicit_euler_step, 1, 1),
    of_step("implicit midpoint", implicit_midpoint_step, 2, 0),
    of_step("RK4, quaternion", rk4_step, 4, 4),
    of_step("RK4, quaternion not normalised", rk4_not_normalised_step, 4, 4),
    of_step("RK4, matrix", rk4(_matrix_rates, _advance_matrix), 4, 4, *_MATRIX),
    of_step("RK4, Euler angles", rk4(_angle_rates, _advance_vector), 4, 4, *_ANGLES),
    of_step("RKMK4", rkmk4_step, 4, 4),
    of_step("CF4", cf4_step, 4, 4),
)}  # fmt: skip
"""The methods for any body and any loads, by name."""
TORQUE_FREE_INTEGRATORS = {method.name: method for method in (
    OneStepMethod("Moser-Veselov", moser_veselov(2), 2, 0),
    OneStepMethod("Moser-Veselov, order 10", moser_veselov(10), 10, 0),
)}  # fmt: skip
"""The methods for bodies in principal axes without loads or damping, by name."""
ALL_INTEGRATORS = REFERENCE_INTEGRATORS | TORQUE_FREE_INTEGRATORS

SPLITTINGS = {
    "Strang": OneStepMethod("splitting, order 2 (Strang)", strang_steps, 2, 1),
    "RKN4": OneStepMethod("splitting, order 4", rkn4_steps, 4, 6),
    "RKN6": OneStepMethod("splitting, order 6", rkn6_steps, 6, 11),
}
"""The library's own splittings, for tops, by the name of the scheme."""
