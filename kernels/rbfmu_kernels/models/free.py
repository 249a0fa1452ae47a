"""Models of a body on which no torque acts: its rotation is exact at any time, its position in closed form.

`CONSTANT_RATE`: a sphere, or a spin about a principal axis. `FREE_SYMMETRIC`: two equal moments make two steady turns,
of elementary functions only. `FREE_TRIAXIAL`: any body. While steps are short, one series about an exact state is
evaluated for many of them: no error adds up, and within its reach the omitted terms are below round-off.

`FREE_BODY_FORCE`: a force fixed in b moves the body; its path is computed by quadrature. A step is divided into equal
panels of at most `substep`, each with `order` points of Gauss's rule. The error of a panel of length s is proportional
to (omega s)^(2 order), and there is no other error; steps are summed in double-double.
Source: Abramowitz and Stegun, 25.4.30.
"""

import math
from collections.abc import Iterator
from decimal import Decimal, localcontext

from ..body import closed_form, memory, outputs, principal
from ..body.shell import make_model
from ..buffer import OK, STEP_REJECTED, TORQUE_ACTS, UNSTEADY, UNSYMMETRIC, places, with_work_space
from ..buffer_access import matrix_at, put_matrix_at, put_vec3_at, vec3_at
from ..compile.decorator import kernel
from ..exact import free_rotation as exact, uniform_rotation as uniform
from ..exact.free_rotation_setup import FREE_ROTATION_SIZE, FreeRotation, put_free_rotation, read_free_rotation
from ..integrators import dense_output as dense, splitting, taylor_coefficients as series
from ..integrators.substeps import LONGEST_STEP, Method, substeps_in
from ..mechanics.equations_of_motion import ROTATION, Body, steady_acceleration, turning_acceleration
from ..mechanics.inertia import is_diagonal
from ..numerics import double_double as dd, elliptic
from ..rotations.matrix import invert_matrix, quaternion_from_matrix, transform
from ..rotations.quaternion import compose_quaternions, invert_quaternion, rotate
from ..rotations.vec3 import ZERO, add_scaled, norm
from ..types import Buffer, Quaternion, Vec3

_CONSTANT_RATE_LAYOUT = places(closed_form.CLOSED_FORM | {"turning": uniform.TURNING_SIZE})
_TURNING = _CONSTANT_RATE_LAYOUT.at.turning


@kernel
def _set_up_constant_rate(z: Buffer) -> int:
    omega = memory.rotation_of(z).omega_b
    if not memory.skips_model_checks(z) and (not principal.keeps_its_rate(z, omega) or _is_disturbed(z)):
        return UNSTEADY
    uniform.put_turning(z, _TURNING, uniform.turning_about(dd.vector(omega)))
    return closed_form.start_clocks(z)


@kernel
def _advance_constant_rate(z: Buffer, h: float) -> int:
    """Advance by h; reject the step and change nothing where the motion is not finite or an input makes a torque."""
    if not memory.skips_model_checks(z) and _is_disturbed(z):
        return STEP_REJECTED
    t = closed_form.time_after(z, h)
    q = compose_quaternions(closed_form.first_attitude(z), uniform.rotation_after(uniform.turning_at(z, _TURNING), t))
    return closed_form.finish_step(z, h, q, memory.rotation_of(z).omega_b)


@kernel
def _is_disturbed(z: Buffer) -> bool:
    """Return whether a torque acts, or a turning force bends the body's path; one along the rate does not turn."""
    return closed_form.has_torque(z) or principal.turns_path(z, memory.rotation_of(z).omega_b)


CONSTANT_RATE = make_model("CONSTANT_RATE", _CONSTANT_RATE_LAYOUT, _set_up_constant_rate, _advance_constant_rate)


_FREE_SYMMETRIC_LAYOUT = places(
    closed_form.CLOSED_FORM | {"omega_0": 3, "about_momentum": uniform.TURNING_SIZE, "about_axis": uniform.TURNING_SIZE}
)
_SYMMETRIC = _FREE_SYMMETRIC_LAYOUT.at


@kernel
def _set_up_free_symmetric(z: Buffer) -> int:
    omega, body = memory.rotation_of(z).omega_b, memory.body_of(z)
    if not memory.skips_model_checks(z):
        if closed_form.is_driven(z):
            return TORQUE_ACTS
        if not splitting.is_symmetric_top(body.inertia):
            return UNSYMMETRIC
    mean, moment, exact_axes = principal.exact_symmetric_frame(z)
    momentum, own = uniform.symmetric_turnings(mean, moment, principal.rates_along(exact_axes, omega))
    axes = principal.axes_as_floats(exact_axes)
    put_vec3_at(z, _SYMMETRIC.omega_0, omega)
    about_momentum = uniform.Turning(transform(invert_matrix(axes), momentum.axis), momentum.rate)
    uniform.put_turning(z, _SYMMETRIC.about_momentum, about_momentum)
    uniform.put_turning(z, _SYMMETRIC.about_axis, uniform.Turning(axes[2], own.rate))
    return closed_form.start_clocks(z)


@kernel
def _advance_free_symmetric(z: Buffer, h: float) -> int:
    """Advance by h; reject the step and change nothing where the motion is not finite or an input makes a torque."""
    if not memory.skips_model_checks(z) and closed_form.is_driven(z):
        return STEP_REJECTED
    t = closed_form.time_after(z, h)
    q = closed_form.first_attitude(z)
    back = uniform.rotation_after(uniform.turning_at(z, _SYMMETRIC.about_axis), t)
    if memory.needs_attitude(z):
        about = uniform.rotation_after(uniform.turning_at(z, _SYMMETRIC.about_momentum), t)
        q = compose_quaternions(compose_quaternions(q, about), back)
    return closed_form.finish_step(z, h, q, rotate(invert_quaternion(back), vec3_at(z, _SYMMETRIC.omega_0)))


FREE_SYMMETRIC = make_model("FREE_SYMMETRIC", _FREE_SYMMETRIC_LAYOUT, _set_up_free_symmetric, _advance_free_symmetric)


FREE = closed_form.CLOSED_FORM | {"axes": 9, "moved": 1, "constants": FREE_ROTATION_SIZE}
"""After CLOSED_FORM: principal axes, 1 if the last step was in closed form, constants of the motion."""
_FREE_WORK = series.FORCE_RATE
"""The size of the work space: series of rate and attitude, and the attitude's products where loads' would be."""
_FREE_TRIAXIAL_LAYOUT = with_work_space(FREE | dense.SERIES_BLOCKS | {"next_reach": 1}, _FREE_WORK)
_LEAST_REACH = 16.0
"""The least number of communication steps that a series must reach over: for fewer, the closed form costs less."""
_ROUND_OFF = 2.0**-50
"""The bound of the last two terms: the omitted terms are then some 2^-54."""
_FARTHEST = 8.0
"""The largest turn, rad, over which a series is tried: its last term, (turn / 2)^24 / 24!, is 4e-10 there."""

_TRIAXIAL = _FREE_TRIAXIAL_LAYOUT.at
_SERIES = _TRIAXIAL.validity
"""The place of the series' blocks."""


@kernel
def _set_up_free_triaxial(z: Buffer) -> int:
    if not memory.skips_model_checks(z) and closed_form.is_driven(z):
        return TORQUE_ACTS
    set_up_rotation(z)
    # where the given moments are the principal ones, doubles hold them exactly
    serves = memory.needs_attitude(z) and is_diagonal(memory.body_of(z).inertia) and not memory.has_pivot(z)
    omega = memory.rotation_of(z).omega_b
    longest = min(LONGEST_STEP, _FARTHEST / max(norm(omega), 1e-300)) if serves else 0.0
    z[_SERIES], z[_TRIAXIAL.next_reach] = dense.NONE, longest
    return 0


@kernel(inline=False)
def set_up_rotation(z: Buffer) -> None:
    """Set the exact motion's constants and the clocks."""
    moments, axes = principal.exact_frame(z)
    R_bp = invert_matrix(principal.axes_as_floats(axes))
    put_matrix_at(z, _TRIAXIAL.axes, R_bp)
    q_ab, omega_b = memory.rotation_of(z)
    q_bp = quaternion_from_matrix(R_bp)
    q_ap = compose_quaternions(q_ab, q_bp)
    motion = exact.free_rotation_of(moments, q_ap, principal.rates_along(axes, omega_b))
    put_free_rotation(z, _TRIAXIAL.constants, exact.with_axes_turned(motion, invert_quaternion(q_bp)))
    closed_form.start_clocks(z)
    z[_TRIAXIAL.moved] = 0.0


@kernel
def _advance_free_triaxial(z: Buffer, h: float) -> int:
    """Advance by h; reject the step and change nothing where the motion is not finite or an input makes a torque."""
    if not memory.skips_model_checks(z) and closed_form.is_driven(z):
        return STEP_REJECTED
    if not dense.reaches_over(z, _SERIES, h):
        return _advance_exactly(z, h)
    t, _ = dense.clock_after(z, _SERIES, h)
    q = dense.attitude_at(z, _TRIAXIAL.work, int(z[_TRIAXIAL.turn_order]), t)
    status = closed_form.finish_step(z, h, q, dense.rate_at(z, _TRIAXIAL.work, series.MAX_ORDER, t))
    if status == OK:
        dense.pass_time(z, _SERIES, h)
        z[_TRIAXIAL.moved] = 0.0
    return status


@kernel(inline=False)
def _advance_exactly(z: Buffer, h: float) -> int:
    """Advance by h in closed form, and begin a series there if that pays."""
    motion = free_motion_of(z)
    t = exact.scaled_time(motion, closed_form.time_after(z, h))
    place = exact.place_at(motion, t)
    q = exact.free_attitude_at(motion, t, place) if memory.needs_attitude(z) else memory.rotation_of(z).q_ab
    status = closed_form.finish_step(z, h, q, shown_rates(z, place))
    if status == OK:
        z[_TRIAXIAL.moved] = 1.0
        if _LEAST_REACH * h <= z[_TRIAXIAL.next_reach]:
            _begin_series(z, h, q, _rates(z, place), memory.body_of(z))
        else:
            z[_SERIES] = dense.NONE
    return status


@kernel(inline=False)
def _begin_series(z: Buffer, h: float, q: Quaternion, omega: Vec3, body: Body) -> None:
    """Make a series from attitude and rate on, and keep it if it reaches over many steps of h."""
    s, method = z[_TRIAXIAL.work : _TRIAXIAL.work + _FREE_WORK], Method(ROTATION, series.MAX_ORDER, _ROUND_OFF, 0.0)
    series.put_factors(s, series.RATE, omega)
    no_loads = series.SpaceFixedLoads(False, False, False)
    # A plan may use the closed form although a little damping acts. With damping the rate would drift over each series
    # and jump back at its end.
    undamped = Body(body.inverse_mass, body.inertia, body.inertia_inverse, body.arm_b, ZERO, body.is_free)
    series.motion_series(s, 0, series.MAX_ORDER, 0, undamped, (ZERO, ZERO, ZERO), no_loads)
    series.end_series(s, series.RATE, series.MAX_ORDER)
    reach = dense.likely_reach(s, series.MAX_ORDER, z[_TRIAXIAL.next_reach])
    reach, _ = dense.reach_within(s, method, 0, 1.0, reach, 1.0)
    m = int(dense.attitude_series(s, series.FORCE, q, series.MAX_ORDER, reach, 0.5 * _ROUND_OFF))
    series.end_series(s, series.TURN, m)
    reach, z[_TRIAXIAL.next_reach] = dense.reach_within(s, method, m, 1.0, reach, 1.0)
    dense.begin_clock(z, _SERIES, ROTATION, m, reach)
    if not _LEAST_REACH * h <= reach:
        z[_SERIES] = dense.NONE


@kernel
def shown_rates(z: Buffer, place: elliptic.Place) -> Vec3:
    """Return omega_ab_b at a place on the polhode, or the state's present rate if no output needs it."""
    return _rates(z, place) if memory.shows_rates(z) else memory.rotation_of(z).omega_b


@kernel(inline=False)
def rates_of_outputs(z: Buffer) -> int:
    """Set the outputs' time derivatives at constant inputs, after the rate, which may be that of an earlier step."""
    if z[_TRIAXIAL.moved] != 0.0:
        motion = free_motion_of(z)
        place = exact.place_at(motion, exact.scaled_time(motion, closed_form.time_after(z, 0.0)))
        put_vec3_at(z, _TRIAXIAL.omega, _rates(z, place))
    return outputs.output_rates(z)


@kernel(inline=False)
def _rates(z: Buffer, place: elliptic.Place) -> Vec3:
    """Return omega_ab_b at a place on the polhode."""
    return transform(matrix_at(z, _TRIAXIAL.axes), exact.free_rate_at(free_motion_of(z), place))


@kernel
def free_motion_of(z: Buffer) -> FreeRotation:
    """Return the constants that `set_up_rotation` has stored."""
    return read_free_rotation(z[_TRIAXIAL.constants : _TRIAXIAL.constants + FREE_ROTATION_SIZE])


FREE_TRIAXIAL = make_model(
    "FREE_TRIAXIAL", _FREE_TRIAXIAL_LAYOUT, _set_up_free_triaxial, _advance_free_triaxial, output_rates=rates_of_outputs
)


ORDERS = (1, 2, 3, 4, 5, 6, 7, 8)
"""The numbers of points in a panel that a plan may choose."""


def _rule_of_gauss(order: int) -> Iterator[tuple[float, float]]:
    """Yield points on [0, 1] and weights: zeros of Legendre's polynomial by Newton's method, in 40 digits.

    NumPy's `leggauss` begins with eigenvalues from LAPACK, whose last bits may depend on the processor.
    """
    with localcontext() as context:
        context.prec = 40
        for k in range(order, 0, -1):
            x, change = Decimal(math.cos(math.pi * (k - 0.25) / (order + 0.5))), Decimal(1)
            while abs(change) > 1e-30:
                before, p = Decimal(0), Decimal(1)
                for n in range(order):
                    before, p = p, ((2 * n + 1) * x * p - n * before) / (n + 1)
                slope = order * (before - x * p) / (1 - x * x)
                change = p / slope
                x -= change
            yield float((1 + x) / 2), float(1 / ((1 - x * x) * slope * slope))


_POINTS, _WEIGHTS = zip(*(row for order in ORDERS for row in _rule_of_gauss(order)), strict=True)
"""Points and weights of Gauss's rules; those of order k, k of each, begin at index k (k - 1) / 2."""

_FREE_BODY_FORCE_LAYOUT = places(FREE | {"order": 1, "low_r": 3, "low_v": 3})
"""After FREE: order, and the low parts of position and velocity of the centre of mass."""
_FORCED = _FREE_BODY_FORCE_LAYOUT.at


@kernel
def _set_up_free_body_force(z: Buffer) -> int:
    if not memory.skips_model_checks(z) and closed_form.has_torque(z):
        return TORQUE_ACTS
    set_up_rotation(z)
    put_vec3_at(z, _FORCED.low_r, ZERO)
    put_vec3_at(z, _FORCED.low_v, ZERO)
    return 0


@kernel
def _advance_free_body_force(z: Buffer, h: float) -> int:
    """Advance by h; reject the step and change nothing where the motion is not finite or an input makes a torque."""
    count = substeps_in(h, z[_FORCED.substep])
    if count == 0 or (not memory.skips_model_checks(z) and closed_form.has_torque(z)):
        return STEP_REJECTED
    motion = free_motion_of(z)
    t = exact.scaled_time(motion, closed_form.time_after(z, h))
    place = exact.place_at(motion, t)
    q, omega = exact.free_attitude_at(motion, t, place), shown_rates(z, place)
    (r, low_r), (v, low_v) = _moved(z, h, count)
    if not closed_form.is_finite_rotation(q, omega) or not closed_form.is_finite_path(r, v):
        return STEP_REJECTED
    memory.put_centre(z, r, v)
    put_vec3_at(z, _FORCED.low_r, low_r)
    put_vec3_at(z, _FORCED.low_v, low_v)
    z[_FORCED.moved] = 1.0
    return closed_form.commit_step(z, h, q, omega)


@kernel
def _moved(z: Buffer, h: float, count: int) -> tuple[tuple[Vec3, Vec3], tuple[Vec3, Vec3]]:
    """Return position and velocity of the centre of mass after h, each with its low part."""
    body, loads = memory.body_of(z), memory.loads_of(z)
    (r, v), a = memory.centre_of(z), steady_acceleration(body, loads)
    gained_r, gained_v = _gained(z, h, count)
    way = add_scaled(add_scaled(gained_r, 0.5 * h * h, a), h, v)
    return _sum(r, vec3_at(z, _FORCED.low_r), way), _sum(v, vec3_at(z, _FORCED.low_v), add_scaled(gained_v, h, a))


@kernel
def _gained(z: Buffer, h: float, count: int) -> tuple[Vec3, Vec3]:
    """Return the parts of position and velocity that the turning force adds in h."""
    body, loads, motion = memory.body_of(z), memory.loads_of(z), free_motion_of(z)
    order, part = int(z[_FORCED.order]), h / count
    first, r, v = order * (order - 1) // 2, ZERO, ZERO
    for i in range(count):
        r = add_scaled(r, part, v)
        for j in range(first, first + order):
            t = exact.scaled_time(motion, closed_form.time_after(z, (i + _POINTS[j]) * part))
            a = turning_acceleration(exact.free_attitude_at(motion, t, exact.place_at(motion, t)), body, loads)
            dv = part * _WEIGHTS[j]
            r = add_scaled(r, part * (1.0 - _POINTS[j]) * dv, a)
            v = add_scaled(v, dv, a)
    return r, v


@kernel
def _sum(a: Vec3, low: Vec3, b: Vec3) -> tuple[Vec3, Vec3]:
    """Return a + low + b, and its low part."""
    x, low_x = dd.two_sum(a[0], b[0] + low[0])
    y, low_y = dd.two_sum(a[1], b[1] + low[1])
    w, low_w = dd.two_sum(a[2], b[2] + low[2])
    return (x, y, w), (low_x, low_y, low_w)


FREE_BODY_FORCE = make_model(
    "FREE_BODY_FORCE", _FREE_BODY_FORCE_LAYOUT, _set_up_free_body_force, _advance_free_body_force,
    ORDERS=ORDERS, output_rates=rates_of_outputs,
)  # fmt: skip
