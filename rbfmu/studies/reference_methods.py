"""One-step methods in common use, with which the charts and stability laws compare; they are no part of the product.

Each integrates the right-hand sides of `rbfmu_kernels.mechanics.equations_of_motion` with its tuples `State`, `Body`
and `Loads`, but may represent the attitude in another form. `OneStepMethod.start` converts a state to that form,
`steps` advances it by any number of steps (so that drift accumulates as it does for users), and `state_of` converts it
back, with a unit quaternion.
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, NamedTuple

from numba import njit

from rbfmu.studies.moser_veselov import moser_veselov
from rbfmu_kernels.compile.decorator import kernel
from rbfmu_kernels.integrators.splitting import rkn4_steps, rkn6_steps, strang_steps
from rbfmu_kernels.mechanics import equations_of_motion as motion
from rbfmu_kernels.mechanics.equations_of_motion import NO_LOADS, Body, Loads, Rates, State, state_rates
from rbfmu_kernels.mechanics.inertia import add_scaled_matrix
from rbfmu_kernels.rotations import euler_angles as euler
from rbfmu_kernels.rotations import matrix as matrices
from rbfmu_kernels.rotations.euler_angles import ZYX
from rbfmu_kernels.rotations.quaternion import add_scaled_quaternion, compose_quaternions, normalize, quaternion_rate_b
from rbfmu_kernels.rotations.rotation_vector import quaternion_from_rotvec
from rbfmu_kernels.rotations.vec3 import add, add_scaled, cross, scale, subtract
from rbfmu_kernels.types import Matrix, Quaternion, Vec3


class OtherState(NamedTuple):
    """A state whose attitude is R_ab, three Euler angles or a rotation vector; or its time derivative."""

    r_c: Vec3
    v_c: Vec3
    attitude: Any
    omega_b: Vec3


def convert(kind: Any, attitude: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """Return a function that makes a state of another kind, whose attitude is a function of the state's."""
    return lambda state: kind(state[0], state[1], attitude(state[2]), state[3])


_with_unit_quaternion = convert(State, normalize)
NONE: Vec3 = (0.0, 0.0, 0.0)
NO_TURN: Quaternion = (1.0, 0.0, 0.0, 0.0)
MAX_ROUNDS = 100


# Quaternions


@kernel
def advance(state: State, s: float, rates: Rates) -> State:
    """Return state + s rates."""
    return State(
        add_scaled(state.r_c, s, rates.r_c),
        add_scaled(state.v_c, s, rates.v_c),
        add_scaled_quaternion(state.q_ab, s, rates.q_ab),
        add_scaled(state.omega_b, s, rates.omega_b),
    )


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


def _summed(advance: Any) -> Any:
    """Return a function that gives k1 + 2 k2 + 2 k3 + k4, so that a state is rounded once and not four times."""

    @njit(error_model="numpy", forceinline=True)  # type: ignore[untyped-decorator]
    def summed(k1: Any, k2: Any, k3: Any, k4: Any) -> Any:
        return advance(advance(advance(k1, 1.0, k4), 2.0, k2), 2.0, k3)

    return summed


def rk4(rates: Any, advance: Any) -> Any:
    """Return a step of the classical method of Runge and Kutta; `more` is passed to the rates.

    The order is 4. On q as on any vector each step scales |q| by 1 - (h omega)^6 / 9216, and steps are stable up to
    h omega = 4 sqrt 2 (attitude) and h d / I = 2.785 (damping). On the nine numbers of R, |R^T R - I| =
    n (h omega)^6 / 72 after n steps; on yaw, pitch and roll (ZYX) it is singular where cos(pitch) = 0.
    """
    summed = _summed(advance)

    @njit(error_model="numpy", nogil=True)  # type: ignore[untyped-decorator]
    def step(y: Any, h: float, *more: Any) -> Any:
        k1 = rates(y, *more)
        k2 = rates(advance(y, 0.5 * h, k1), *more)
        k3 = rates(advance(y, 0.5 * h, k2), *more)
        return advance(y, h / 6.0, summed(k1, k2, k3, rates(advance(y, h, k3), *more)))

    return step


rk4_not_normalised_step = rk4(state_rates, advance)


@njit(error_model="numpy", nogil=True)  # type: ignore[untyped-decorator]
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
    """Return (y, rounds), y = state + h / 2 f(y), by fixed-point iteration; rounds = MAX_ROUNDS where it fails."""
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
def _loads_in_b(R_ab: Matrix, loads: Loads) -> Loads:
    R_ba = matrices.invert_matrix(R_ab)
    force_b = add(loads.force_b, matrices.transform(R_ba, loads.force_a))
    torque_b = add(loads.torque_b, matrices.transform(R_ba, loads.torque_a))
    return Loads(loads.gravity_a, NONE, force_b, NONE, torque_b)


@kernel
def _accelerations(R_ab: Matrix, omega_b: Vec3, body: Body, loads: Loads) -> tuple[Vec3, Vec3]:
    force_a = add(loads.force_a, matrices.transform(R_ab, loads.force_b))
    a_c = motion.linear_acceleration(NO_TURN, body, Loads(loads.gravity_a, force_a, NONE, NONE, NONE))
    return a_c, motion.angular_acceleration(NO_TURN, omega_b, body, _loads_in_b(R_ab, loads))


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


def _advance_by(add: Callable[[Any, float, Any], Any]) -> Any:
    """Return a function that gives state + s k, where `add` does so for attitudes."""

    @njit(error_model="numpy", forceinline=True)  # type: ignore[untyped-decorator]
    def advance(state: OtherState, s: float, k: OtherState) -> OtherState:
        r, v = add_scaled(state.r_c, s, k.r_c), add_scaled(state.v_c, s, k.v_c)
        return OtherState(r, v, add(state.attitude, s, k.attitude), add_scaled(state.omega_b, s, k.omega_b))

    return advance


_advance_vector, _advance_matrix = _advance_by(add_scaled), _advance_by(add_scaled_matrix)


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


_local_rk4, _summed_rates = rk4(_local_rates, _advance_vector), _summed(_advance_vector)


@njit(error_model="numpy", nogil=True)  # type: ignore[untyped-decorator]
def rkmk4_step(state: State, h: float, body: Body, loads: Loads) -> State:
    """Take a step of classical Runge-Kutta on the rotation vector of the step (Munthe-Kaas 1998)."""
    r, v, q, omega = state
    return _local_state(_local_rk4(OtherState(r, v, NONE, omega), h, q, 1.0, body, loads), q)


@njit(error_model="numpy", nogil=True)  # type: ignore[untyped-decorator]
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


Steps = Callable[[Any, float, int, Body, Loads], Any]
"""A function `steps(y, h, n, body, loads)` that takes n steps of size h; all numbers except n are floats."""


@dataclass(frozen=True)
class OneStepMethod:
    """A one-step method, its order, and its evaluations of the right-hand side per step.

    Where the number varies that is 0, where it is not known NaN.
    """

    name: str
    steps: Steps
    order: int
    evaluations: float
    start: Callable[[State], Any] = lambda state: state
    state_of: Callable[[Any], State] = _with_unit_quaternion

    def run(self, state: State, h: float, n: int, body: Body, loads: Loads) -> State:
        """Return the state after n steps of h."""
        return self.state_of(self.path(state, h, [n], body, loads)[0])

    def path(self, state: State, h: float, counts: Iterable[int], body: Body, loads: Loads = NO_LOADS) -> list[Any]:
        """Return the states in the method's own form after so many steps of h each, one after the other."""
        y = self.start(state)
        return [y := self.steps(y, h, n, body, loads) for n in counts]


def compiled_loop(step: Callable[[Any, float, Body, Loads], Any]) -> Steps:
    """Return a loop of n steps of a one-step kernel, compiled at the first call."""

    @njit(error_model="numpy", nogil=True)  # type: ignore[untyped-decorator]
    def loop(y: Any, h: float, n: int, body: Body, loads: Loads) -> Any:
        for _ in range(n):
            y = step(y, h, body, loads)
        return y

    return loop  # type: ignore[no-any-return]


_MATRIX = convert(OtherState, matrices.matrix_from_quaternion), convert(State, matrices.quaternion_from_matrix)
_ANGLES = (
    convert(OtherState, lambda q: euler.euler_from_quaternion(ZYX, q)),
    convert(State, lambda angles: euler.quaternion_from_euler(ZYX, angles)),
)
_ALL = (
    OneStepMethod("explicit Euler", compiled_loop(explicit_euler_step), 1, 1),
    OneStepMethod("semi-implicit Euler", compiled_loop(semi_implicit_euler_step), 1, 1),
    OneStepMethod("implicit midpoint", compiled_loop(implicit_midpoint_step), 2, 0),
    OneStepMethod("RK4, quaternion", compiled_loop(rk4_step), 4, 4),
    OneStepMethod("RK4, quaternion not normalised", compiled_loop(rk4_not_normalised_step), 4, 4),
    OneStepMethod("RK4, matrix", compiled_loop(rk4(_matrix_rates, _advance_matrix)), 4, 4, *_MATRIX),
    OneStepMethod("RK4, Euler angles", compiled_loop(rk4(_angle_rates, _advance_vector)), 4, 4, *_ANGLES),
    OneStepMethod("RKMK4", compiled_loop(rkmk4_step), 4, 4),
    OneStepMethod("CF4", compiled_loop(cf4_step), 4, 4),
)
_FREE = (
    OneStepMethod("Moser-Veselov", moser_veselov(2), 2, 0),
    OneStepMethod("Moser-Veselov, order 10", moser_veselov(10), 10, 0),
)
REFERENCE_INTEGRATORS = {integrator.name: integrator for integrator in _ALL}
"""The methods for any body and any loads, by name."""
TORQUE_FREE_INTEGRATORS = {integrator.name: integrator for integrator in _FREE}
"""The methods for bodies in principal axes without loads or damping, by name."""
ALL_INTEGRATORS = REFERENCE_INTEGRATORS | TORQUE_FREE_INTEGRATORS

SPLITTINGS = {
    "Strang": OneStepMethod("splitting, order 2 (Strang)", strang_steps, 2, 1),
    "RKN4": OneStepMethod("splitting, order 4", rkn4_steps, 4, 6),
    "RKN6": OneStepMethod("splitting, order 6", rkn6_steps, 6, 11),
}
"""The library's own splittings, for tops, by the name of the scheme."""
