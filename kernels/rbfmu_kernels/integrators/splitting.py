"""A body with two equal principal moments under torques and forces that depend on its attitude only: heavy tops.

A step composes kicks (the loads change the rates at a fixed attitude) with drifts (the exact flow of the
symmetric free body, by elementary functions only). Damping and changes of the inputs within the step are left out. The
symmetry axis may have any direction; two of the moments about the reference point must be equal.

Kicks resonate with the precession about the angular momentum: keep h well below `resonant_step`. Below it the
energy error stays bounded for all times; at it the energy drifts by some m g l.
"""

import math

from ..compile.decorator import kernel
from ..mechanics.equations_of_motion import Body, Loads, State, angular_acceleration, linear_acceleration
from ..mechanics.inertia import add_scaled_matrix, diagonal, scale_matrix, trace
from ..numerics.elementary import power_of_two_for
from ..rotations.matrix import transform
from ..rotations.quaternion import compose_quaternions, invert_quaternion, rotate, scale_quaternion
from ..rotations.rotation_vector import quaternion_from_rotvec
from ..rotations.vec3 import ZERO, add_scaled, norm, scale, subtract
from ..types import Matrix, Vec3

Parts = tuple[float, ...]

# S. Blanes & P. C. Moan, "Practical symplectic partitioned Runge-Kutta and Runge-Kutta-Nystroem methods",
# J. Comput. Appl. Math. 142 (2002): SRKN^b_6 (order 4) and SRKN^b_11 (order 6), each symmetric, kicks at both ends:
# the last of one step and the first of the next are merged.
# Each kick depends on the attitude alone, so that the conditions of Nystroem methods suffice.
_K4 = (0.0829844064174052, 0.396309801498368, -0.0390563049223486)
_K4_MIDDLE = 1.0 - 2.0 * (_K4[0] + _K4[1] + _K4[2])
_D4 = (0.245298957184271, 0.604872665711080)
_D4_LAST = 0.5 - (_D4[0] + _D4[1])
_K6 = (0.0414649985182624, 0.198128671918067, -0.0400061921041533, 0.0752539843015807, -0.0115113874206879)
_K6_LAST = 0.5 - (_K6[0] + _K6[1] + _K6[2] + _K6[3] + _K6[4])
_D6 = (0.123229775946271, 0.290553797799558, -0.127049212625417, -0.246331761062075, 0.357208872795928)
_D6_MIDDLE = 1.0 - 2.0 * (_D6[0] + _D6[1] + _D6[2] + _D6[3] + _D6[4])
_KICKS_4, _DRIFTS_4 = (*_K4, _K4_MIDDLE, *_K4[::-1]), (*_D4, _D4_LAST, _D4_LAST, *_D4[::-1])
_KICKS_6, _DRIFTS_6 = (*_K6, _K6_LAST, _K6_LAST, *_K6[::-1]), (*_D6, _D6_MIDDLE, *_D6[::-1])


@kernel
def transverse_moment(M: Matrix) -> float:
    """Return the moment that two principal axes of M share; where no two are equal, a number between the two nearest.

    M: symmetric, kg m^2, any scale.  Error <= 2 eps tr(M).
    From the deviator's invariants: M - tr(M) / 3 = d (n n^T - 1 / 3).
    """
    total = trace(M)
    power = 1.0 if 2.0**-200 < total < 2.0**200 else power_of_two_for(total)  # for products of three moments
    M = scale_matrix(power, M)
    third = trace(M) / 3.0
    x, y, z = M[0][0] - third, M[1][1] - third, M[2][2] - third
    a, b, c = M[1][2], M[0][2], M[0][1]
    squares = (x * x + y * y + z * z) + 2.0 * (a * a + b * b + c * c)
    determinant = x * (y * z - a * a) - c * (c * z - a * b) + b * (c * a - y * b)
    return (third - math.copysign(math.sqrt(squares / 6.0), determinant)) / power


@kernel
def is_symmetric_top(M: Matrix) -> bool:
    """Return whether two principal moments of M are equal, to 8 eps of the trace: (M - I_t) (M - I_s) = 0.

    Each is then within 4 eps of the trace from their common value.  M: symmetric, kg m^2, any scale.
    """
    M = scale_matrix(power_of_two_for(trace(M)), M)
    total = trace(M)
    t = transverse_moment(M)
    s = total - 2.0 * t
    A, B = add_scaled_matrix(M, -1.0, diagonal((t, t, t))), add_scaled_matrix(M, -1.0, diagonal((s, s, s)))
    residual = max(max(norm(transform(A, B[0])), norm(transform(A, B[1]))), norm(transform(A, B[2])))
    return residual <= 4.0 * 2.0**-52 * total * (abs(t - s) + 4.0 * 2.0**-52 * total)


@kernel
def resonant_step(M: Matrix, omega_b: Vec3) -> float:
    """Return 2 pi I_t / |M omega|, s: the step in which the body makes one turn about the angular momentum.

    2 pi I_t / (I_s |omega_s|) for a fast top.  A torque fixed in the body resonates at 2 pi / |omega| as well.
    """
    momentum = norm(transform(M, omega_b))
    return 2.0 * math.pi * transverse_moment(M) / (momentum if momentum > 0.0 else 1e-300)


@kernel
def _kick(state: State, h: float, body: Body, loads: Loads) -> State:
    """Let the loads act for h at a fixed attitude."""
    r, v, q, omega = state
    v = add_scaled(v, h, linear_acceleration(q, body, loads))
    return State(r, v, q, add_scaled(omega, h, angular_acceleration(q, ZERO, body, loads)))


@kernel
def _drift(state: State, h: float, M: Matrix, per_transverse: float) -> State:
    """Move without loads for h: turn by h M omega / I_t about the momentum, by h (1 - M / I_t) omega about the axis."""
    r, v, q, omega = state
    along_momentum = scale(per_transverse, transform(M, omega))
    back = quaternion_from_rotvec(scale(h, subtract(omega, along_momentum)))
    q = compose_quaternions(compose_quaternions(q, quaternion_from_rotvec(scale(h, along_momentum))), back)
    return State(add_scaled(r, h, v), v, q, rotate(invert_quaternion(back), omega))


@kernel(inline=False)
def _drift_and_kick(state: State, drift: float, kick: float, per_transverse: float, body: Body, loads: Loads) -> State:
    return _kick(_drift(state, drift, body.inertia, per_transverse), kick, body, loads)


@kernel
def _with_unit_attitude(state: State) -> State:
    """Return the state with |q| = 1 by a step of Newton's method: products of unit quaternions are off by some eps."""
    r, v, q, omega = state
    s = 1.5 - 0.5 * (q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    return State(r, v, scale_quaternion(s, q), omega)


@kernel
def _steps(state: State, h: float, n: int, body: Body, loads: Loads, kicks: Parts, drifts: Parts) -> State:
    """Take n steps of kicks and drifts, given as parts of h; where two steps meet, their kicks are merged."""
    u = 1.0 / transverse_moment(body.inertia)
    y = _kick(state, kicks[0] * h, body, loads)
    for i in range(1, n + 1):
        for k in range(len(drifts)):
            merged = 2.0 if k + 1 == len(drifts) and i < n else 1.0
            y = _drift_and_kick(y, drifts[k] * h, merged * kicks[k + 1] * h, u, body, loads)
        y = _with_unit_attitude(y)
    return y


@kernel(inline=False)
def strang_steps(state: State, h: float, n: int, body: Body, loads: Loads) -> State:
    """Take n steps of half a kick, a drift, half a kick: order 2."""
    return _steps(state, h, n, body, loads, (0.5, 0.5), (1.0,))


@kernel(inline=False)
def rkn4_steps(state: State, h: float, n: int, body: Body, loads: Loads) -> State:
    """Take n steps of six drifts and as many kicks: order 4."""
    return _steps(state, h, n, body, loads, _KICKS_4, _DRIFTS_4)


@kernel(inline=False)
def rkn6_steps(state: State, h: float, n: int, body: Body, loads: Loads) -> State:
    """Take n steps of eleven drifts and as many kicks: order 6."""
    return _steps(state, h, n, body, loads, _KICKS_6, _DRIFTS_6)
