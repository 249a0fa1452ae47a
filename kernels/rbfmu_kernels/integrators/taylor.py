"""Taylor series of any order for the motion of a body, with error control inside a communication step.

Only the body rate, and those loads that turn in b, have series of full order, which take few products. The attitude
follows from the rate by the two-point formula of Hermite and Obreshkov, exact to order 2 m from m derivatives at either
end: sum_k c_k h^k q^(k)(0) = sum_k c_k (-h)^k q^(k)(h), c_k = (2m - k)! m! / ((2m)! k! (m - k)!), which q = q_0 o D
makes explicit. Where a force turns with the body, velocity and position follow in the same way. Hairer, Norsett,
Wanner, Solving Ordinary Differential Equations I, 2nd ed. 1993, I.8 (series) and II.13 (Obreshkov's methods); the step
is chosen by the last two terms: A. Jorba & M. Zou, Experimental Mathematics 14 (2005).

Works in a piece of a model's buffer, see `taylor_coefficients`; states: see `equations_of_motion`.
"""

import math

import numpy as np

from ..buffer import MAX_SUBSTEPS, OK, STEP_REJECTED
from ..buffer_access import put_vec3_at, quaternion_at, vec3_at
from ..compile.decorator import kernel
from ..compile.simd import add_lanes, lanes, lanes_at, multiply_lanes, numbers
from ..mechanics import equations_of_motion as motion, inertia
from ..mechanics.equations_of_motion import OMEGA, R_C, RATE_ONLY, V_C, WHOLE_STATE, Body, LoadPolynomial, Rotation
from ..rotations.quaternion import add_scaled_quaternion, compose_quaternions, invert_quaternion, rotate
from ..rotations.vec3 import ZERO, add, add_scaled, dot, largest_component, scale
from ..types import Buffer, Quaternion, Vec3
from . import interpolation, substeps, taylor_coefficients as series
from .substeps import Method, Room
from .taylor_coefficients import ACCELERATION, FORCE, PER, RATE, TORQUE, TURN, WORK, SpaceFixedLoads, term

_MAX_DERIVATIVES = 9
"""The largest number of derivatives of the attitude, that at `MAX_ORDER`: see `derivatives_of_attitude`."""
_COUNTS = range(_MAX_DERIVATIVES + 1)


def _weight(m: int, k: int) -> float:
    return math.perm(m, k) * math.factorial(2 * m - k) / math.factorial(2 * m) if k <= m else 0.0


_WEIGHT = np.array([[_weight(m, k) for k in range(_MAX_DERIVATIVES + 2)] for m in _COUNTS])
"""c_k k! of the two-point formula with m derivatives: [m, k]."""
_REMAINDER = np.array(
    [math.factorial(m) ** 2 / (math.factorial(2 * m) * math.factorial(2 * m + 1)) * 0.25**m for m in _COUNTS]
)
"""The formula's error is this times (2 h)^(2m+1) / 2 times the (2m+1)-th derivative."""
_RATE_PER_ACCELERATION = 4.0 / math.e * np.array(_COUNTS)
"""This times an angular acceleration alpha is the square of the steady rate with an equal remainder.

A turn from rest is q = exp(alpha t^2 / 4), whose (2m)-th derivative is (2m)! / m! (alpha / 4)^m at rest; that of a
steady turn is (omega / 2)^(2m). They are equal at omega^2 = ((2m)! / m!)^(1/m) alpha, by Stirling's formula some
4 m / e alpha. Without this a body that starts from rest would seem not to turn at all.
"""
_FOUR = 4.0 ** np.array(_COUNTS)
"""It cancels the 0.25^m of `_REMAINDER`, which is for the half angles of quaternions: a path turns by whole angles."""

STEPS_OF_LOADS = 8
"""The number of steps over which loads that turn in b follow their series, before the attitude turns them again.

Truncation errors of a load's series add up from step to step; to turn loads at each step would cost a rotation and the
first terms of all series.
"""


@kernel
def derivatives_of_attitude(order: int) -> int:
    """Return the number of derivatives of the attitude with the least work, as measured at tolerances 1e-3 to 1e-12.

    order: that of the rate's series.
    """
    return (3 * order + 7) // 8


@kernel
def _sum(s: Buffer, u: int, order: int, h: float) -> Vec3:
    """Return the series at u, evaluated at h; even and odd powers are summed apart, so that fewer sums wait."""
    steps = lanes(h * h, h * h, h * h, h * h)
    even = odd = lanes(0.0, 0.0, 0.0, 0.0)
    for k in range(order - (order & 1), 0, -2):
        even = add_lanes(multiply_lanes(even, steps), lanes_at(s, term(u, k)))
        odd = add_lanes(multiply_lanes(odd, steps), lanes_at(s, term(u, k - 1)))
    even, odd = multiply_lanes(even, steps), multiply_lanes(odd, lanes(h, h, h, h))
    return numbers(add_lanes(add_lanes(even, odd), lanes_at(s, u)))[:3]


@kernel
def _half_turn(s: Buffer, m: int, h: float) -> Quaternion:
    """Return half of the two-point formula: the sum of c_k k! h^k D_k."""
    power, total = 1.0, (0.0, 0.0, 0.0, 0.0)
    for k in range(m + 1):
        total = add_scaled_quaternion(total, _WEIGHT[m, k] * power, quaternion_at(s, term(TURN, k)))
        power *= h
    return total


@kernel
def _half_path(s: Buffer, m: int, h: float) -> tuple[Vec3, Vec3]:
    """Return half of the two-point formula for the velocity and the position by an acceleration."""
    power, speed, path = h, ZERO, ZERO
    for k in range(m):
        gain = scale(PER[k] * power, vec3_at(s, term(ACCELERATION, k)))
        power *= h
        speed = add_scaled(speed, _WEIGHT[m, k + 1], gain)
        path = add_scaled(path, _WEIGHT[m, k + 2] * PER[k + 1] * h, gain)
    return speed, path


@kernel
def _move_centre(z: Buffer, y: int, s: Buffer, m: int, h: float) -> None:
    """Add half of the two-point formula to velocity and position of the state z[y:], h < 0 at a step's end."""
    (speed, path), q = _half_path(s, m, h), quaternion_at(z, y)
    sign = math.copysign(1.0, h)
    gain, path = scale(sign, rotate(q, speed)), scale(sign, rotate(q, path))
    v_c = add(vec3_at(z, y + V_C), gain if h < 0.0 else ZERO)
    put_vec3_at(z, y + R_C, add(vec3_at(z, y + R_C), add(scale(0.5 * abs(h), v_c), path)))
    put_vec3_at(z, y + V_C, add(v_c, gain if h > 0.0 else ZERO))


@kernel
def space_fixed_acceleration(s: Buffer, body: Body, fixed: SpaceFixedLoads) -> float:
    """Return a bound of the angular acceleration by loads that turn in b, rad/s^2."""
    torque = 0.0
    if fixed.lever_force:
        torque += substeps.size_of(body.arm_b) * substeps.size_of(vec3_at(s, FORCE))
    if fixed.torque:
        torque += substeps.size_of(vec3_at(s, TORQUE))
    return torque * inertia.trace(body.inertia_inverse)


@kernel
def _square_by_changes(s: Buffer, m: int) -> float:
    """Return the square of the steady rate with the remainder of a rate from rest that rises as t^2 or t^3.

    With x = `_RATE_PER_ACCELERATION` and terms c_k t^k, the rate to the power k + 1 is x^k c_k, for k = 1 as for these.
    """
    x = _RATE_PER_ACCELERATION[m]
    cube = x * x * substeps.size_of(vec3_at(s, term(RATE, 2)))
    square = math.sqrt(cube)
    for _ in range(4):  # the exponent, 1/2, nears 2/3
        square = math.sqrt(cube * math.sqrt(square))
    return max(square, math.sqrt(x * x * x * substeps.size_of(vec3_at(s, term(RATE, 3)))))


@kernel(inline=False)
def estimated_excess(
    s: Buffer, method: Method, h: float, accelerations: Vec3, alpha_fixed: float, steps: float, least: float
) -> float:
    """Estimate a step's truncation error and the two-point formula's remainder (rad); return the larger over the
    allowed.

    accelerations: by a force that turns with the body, over the velocity, which counts as 1 m/s at least; and two
    derivatives. least: what `_RATE_PER_ACCELERATION` times the acceleration counts as at least.
    """
    m, allowed = derivatives_of_attitude(method.order), substeps.tolerance_of_substep(method.tolerance, method.span, h)
    last, square = substeps.truncation(s, method, h, alpha_fixed, steps)
    if method.n == RATE_ONLY:
        return last / allowed
    alpha = vec3_at(s, term(RATE, 1))
    square = h * h * (square + max(_RATE_PER_ACCELERATION[m] * math.sqrt(dot(alpha, alpha)), least))
    turn, (acceleration, first, second) = math.sqrt(square), accelerations
    if method.n == WHOLE_STATE:  # the (2m-1)-th derivative of a turning force that changes, by Leibniz's rule
        per = h / max(turn, 1e-30)
        acceleration += (2.0 * m - 1.0) * per * (first + (m - 1.0) * per * second)
    remainder: float = _REMAINDER[m] * substeps.power_of(square, m) * max(turn, _FOUR[m] * h * acceleration)
    return max(last, remainder) / allowed


@kernel
def _put_sums(s: Buffer, order: int, h: float, fixed: SpaceFixedLoads) -> None:
    """Set row 0 of omega, and of the loads that turn in b, to the values of their series at h."""
    series.put_factors(s, RATE, _sum(s, RATE, order, h))
    for level in range(3 if fixed.changing else 1):
        force, torque = FORCE + series.TO_DERIVATIVE * level, TORQUE + series.TO_DERIVATIVE * level
        if fixed.lever_force:
            series.put_factors(s, force, _sum(s, force, order, h))
        if fixed.torque:
            series.put_factors(s, torque, _sum(s, torque, order, h))


@kernel
def turn(
    z: Buffer, y: int, s: Buffer, method: Method, h: float, body: Body, torques: series.Torques, fixed: SpaceFixedLoads
) -> None:
    """Advance rate and attitude, and row 0 of the loads that turn in b, by h; torques: those after h.

    Rows 0 to m of the series are then those at the step's end, from which the two-point formula makes the attitude.
    """
    q, half, m = quaternion_at(z, y), (1.0, 0.0, 0.0, 0.0), derivatives_of_attitude(method.order)
    if method.n != RATE_ONLY:
        half = _half_turn(s, m, h)
    _put_sums(s, method.order, h, fixed)
    put_vec3_at(z, y + OMEGA, vec3_at(s, RATE))
    if method.n != RATE_ONLY:
        series.motion_series(s, 0, m, m, body, torques, fixed)
        q = compose_quaternions(compose_quaternions(q, half), invert_quaternion(_half_turn(s, m, -h)))
        motion.put_unit_attitude(z, y, q)


@kernel(inline=False)
def taylor_advance(
    z: Buffer, room: Room, method: Method, h: float, body: Body, loads: LoadPolynomial,
    points: interpolation.Points | None = None,
) -> int:  # fmt: skip
    """Advance the state by h, with the estimated error of each substep within the tolerance.

    points: where the motion is asked for within h, at constant loads, of which none turns with the body.

    An infinite tolerance keeps the size of substeps. The next substep aims at the allowed error over 1.4, and at half
    of it after a substep was refused, so that few are refused. Each is the rest of h divided by the number of substeps
    that the kept size would need: then the last one is no small remainder, from which the next step would have to grow.
    STEP_REJECTED where the motion is not finite or needs too many steps; the caller then restores state and size.
    """
    (y, w, size), (n, order, tolerance, _) = room, method
    s, m, now = z[w : w + WORK], derivatives_of_attitude(order), loads
    fixed, torques = series.space_fixed_loads(body, loads), series.known_torques(loads, body)
    turned = fixed.lever_force or fixed.torque
    # From rest under loads that begin at zero, two of three terms vanish, or three of four: then four are judged.
    longer = Method(n, min(order + 2, series.MAX_ORDER) if fixed.changing else order, tolerance, method.span)
    series.put_factors(s, RATE, vec3_at(z, y + OMEGA))
    if turned:
        series.turned_loads(s, quaternion_at(z, y), now, fixed)
    series.motion_series(s, 0, longer.order, m, body, torques, fixed)
    if n == WHOLE_STATE:
        series.acceleration_series(s, m, body.inverse_mass, now)
    rest, low, tried, passed = h, 0.0, 0, 1  # rest + low: the time left, so that a thousand substeps add up to h
    most = MAX_SUBSTEPS
    if points is not None:
        most *= len(points.states)
    while rest > 0.0:
        tried += 1
        if not rest < most * z[size] or tried >= most:
            return STEP_REJECTED
        count = substeps.parts_in(rest, z[size])
        part = (rest + low) / count
        excess = _excess(z, y, s, method, part, count, body, fixed, now)
        if fixed.changing:
            excess = max(excess, _excess(z, y, s, longer, part, count, body, fixed, now))
        if not excess <= 1.0:
            z[size] = substeps.nearer_size(part, order, 2.0 * excess)
            continue
        substeps.count_substep(z, size)
        nearer = substeps.nearer_size(part, order, 1.4 * excess) if tolerance < math.inf else z[size]
        z[size] = max(z[size], nearer) if count == 1 else nearer
        left, begin, q_0 = 0.0 if count == 1 else rest - part, (h - rest) - low, quaternion_at(z, y)
        low += (rest - left) - part
        rest = left
        if n == WHOLE_STATE:
            _move_centre(z, y, s, m, part)
        if points is not None and interpolation.place_of(points.time, passed, begin, part, rest == 0.0) >= 0.0:
            interpolation.keep_beginning(s, m)
        if fixed.changing:
            now = motion.polynomial_after(loads, h - rest)
            torques = series.known_torques(now, body)
        turn(z, y, s, method, part, body, torques, fixed)
        if n == WHOLE_STATE:
            series.acceleration_series(s, m, body.inverse_mass, now)
            _move_centre(z, y, s, m, -part)
        if points is not None:
            passed = _pass_points(z, y, s, method, points, passed, begin, part, q_0, rest == 0.0)
        if rest > 0.0:
            anew = turned and (fixed.changing or tried % STEPS_OF_LOADS == 0)
            if anew:
                series.turned_loads(s, quaternion_at(z, y), now, fixed)
            series.motion_series(s, 0 if n == RATE_ONLY or anew else m, longer.order, 0, body, torques, fixed)
    return OK


@kernel
def _pass_points(
    z: Buffer, y: int, s: Buffer, method: Method, points: interpolation.Points, k: int, begin: float, h: float,
    q_0: Quaternion, is_last: bool,
) -> int:  # fmt: skip
    """Set the motion at the points within a substep, from point k on; return the number of the next point."""
    q_1, m = quaternion_at(z, y), derivatives_of_attitude(method.order)
    x = interpolation.place_of(points.time, k, begin, h, is_last)
    while x >= 0.0:
        inside = interpolation.motion_inside(s, method, m, h, x, q_0, q_1)
        interpolation.put_rotation(points.states, k - 1, inside)
        k += 1
        x = interpolation.place_of(points.time, k, begin, h, is_last)
    if is_last:
        interpolation.put_rotation(points.states, k - 1, Rotation(q_1, vec3_at(z, y + OMEGA)))
    return k


@kernel
def _excess(
    z: Buffer, y: int, s: Buffer, method: Method, part: float, count: int, body: Body, fixed: SpaceFixedLoads,
    loads: LoadPolynomial,
) -> float:  # fmt: skip
    """Return the estimated error of the first of `count` equal steps over the allowed one."""
    accelerations = ZERO
    if method.n == WHOLE_STATE:
        speed = max(largest_component(vec3_at(z, y + V_C)), 1.0)
        first, second = largest_component(loads.rate.force_b), largest_component(loads.rate_2.force_b)
        per = body.inverse_mass / speed
        accelerations = (largest_component(vec3_at(s, ACCELERATION)) / speed, per * first, per * second)
    turned = fixed.lever_force or fixed.torque
    alpha_fixed = space_fixed_acceleration(s, body, fixed) if turned and count > 1 else 0.0
    least = _square_by_changes(s, derivatives_of_attitude(method.order)) if fixed.changing else 0.0
    return estimated_excess(s, method, part, accelerations, alpha_fixed, min(count, STEPS_OF_LOADS), least)
