"""Principal moments, axes and rates of a body; a body that turns about one of these axes alone.

They are double-double, for exact motions whose phase is a rate times a long time: moments in doubles, accurate to eps
of the trace, would cause an error of eps times the angle turned.
"""

import math

from ..buffer_access import quaternion_at, vec3_at
from ..compile.decorator import kernel
from ..exact.uniform_rotation import power_for
from ..mechanics.equations_of_motion import Body, Loads, angular_acceleration
from ..mechanics.inertia import INERTIA_TOLERANCE, is_diagonal, principal_axes
from ..mechanics.newton_euler import damping_torque
from ..numerics import double_double as dd, elementary
from ..numerics.double_double import DoubleDouble, Vector, two_product, two_sum
from ..rotations.matrix import invert_matrix, transform
from ..rotations.quaternion import invert_quaternion, largest_of, rotate, scale_quaternion
from ..rotations.vec3 import add, add_scaled, cross, dot, is_nonzero, norm, scale
from ..types import Buffer, Matrix, Quaternion, Vec3
from . import memory

Axes = tuple[Vector, Vector, Vector]
"""The three principal axes, each in b."""
Inertia = tuple[DoubleDouble, DoubleDouble, DoubleDouble, DoubleDouble, DoubleDouble, DoubleDouble]
"""The elements 11, 22, 33, 12, 13, 23."""

_ZERO: DoubleDouble = (0.0, 0.0)
_ONE: DoubleDouble = (1.0, 0.0)
_NEGLIGIBLE = 2.0**-106
"""The part of the trace up to which an element off the diagonal counts as zero: an ulp of double-double arithmetic."""


@kernel(inline=False)
def exact_frame(z: Buffer) -> tuple[Vector, Axes]:
    """Return (moments, axes) about the centre of mass or the pivot; the moments in some power of two of kg m^2.

    The axes are the body's own where these are principal. Else moments and axes belong to a matrix within 1e-31 of the
    given one, and a least moment of at most 1e-12 of the trace counts as zero (a slender beam).
    """
    M = _about_reference(z)
    if M[3][0] == 0.0 and M[4][0] == 0.0 and M[5][0] == 0.0:
        return M[0:3], ((_ONE, _ZERO, _ZERO), (_ZERO, _ONE, _ZERO), (_ZERO, _ZERO, _ONE))
    M = _scaled(M)
    (a, _), (b, _), (c, _), (d, _), (e, _), (f, _) = M
    moments, axes = _refined(M, _orthonormal(principal_axes(((a, d, e), (d, b, f), (e, f, c)))[1]))
    if moments[0][0] <= INERTIA_TOLERANCE * (a + b + c):
        mean = dd.scale(0.5, dd.add(moments[1], moments[2]))
        moments = _ZERO, mean, mean
    return moments, axes


@kernel(inline=False)
def rates_along(axes: Axes, omega: Vec3) -> Vector:
    """Return the components of a rate along principal axes."""
    w = dd.vector(omega)
    return dd.dot(axes[0], w), dd.dot(axes[1], w), dd.dot(axes[2], w)


@kernel
def axes_as_floats(axes: Axes) -> Matrix:
    """Return the axes as floats, each a row."""
    (a, b, c), (d, e, f), (g, h, i) = axes
    return (a[0], b[0], c[0]), (d[0], e[0], f[0]), (g[0], h[0], i[0])


@kernel(inline=False)
def keeps_its_rate(z: Buffer, omega: Vec3) -> bool:
    """Return whether omega x M omega is zero in double-double, so that the rate stays constant without torque."""
    a, b, c, d, e, f = _scaled(_about_reference(z))
    rate = dd.vector(omega)
    x, y, w = dd.scale_vector(power_for(rate), rate)
    yw, wx, xy = dd.multiply(y, w), dd.multiply(w, x), dd.multiply(x, y)
    xx, yy, ww = dd.multiply(x, x), dd.multiply(y, y), dd.multiply(w, w)
    first = dd.dot((dd.subtract(c, b), f, e), (yw, dd.subtract(yy, ww), xy))
    second = dd.dot((dd.subtract(a, c), e, d), (wx, dd.subtract(ww, xx), yw))
    third = dd.dot((dd.subtract(b, a), d, f), (xy, dd.subtract(xx, yy), wx))
    first, second = dd.subtract(first, dd.multiply(d, wx)), dd.subtract(second, dd.multiply(f, xy))
    third = dd.subtract(third, dd.multiply(e, yw))
    return first[0] == 0.0 and second[0] == 0.0 and third[0] == 0.0


@kernel(inline=False)
def _about_reference(z: Buffer) -> Inertia:
    """Return M about the centre of mass or the pivot."""
    (a, d, e), (_, b, f), (_, _, c) = memory.inertia_of(z)
    M: Inertia = ((a, 0.0), (b, 0.0), (c, 0.0), (d, 0.0), (e, 0.0), (f, 0.0))
    if not memory.has_pivot(z):
        return M
    m, (x, y, w) = z[memory.AT.mass], vec3_at(z, memory.AT.r_oc_b)
    xx, yy, ww = two_product(x, x), two_product(y, y), two_product(w, w)
    return (
        _plus(M[0], m, dd.add(yy, ww)), _plus(M[1], m, dd.add(ww, xx)), _plus(M[2], m, dd.add(xx, yy)),
        _plus(M[3], -m, two_product(x, y)), _plus(M[4], -m, two_product(x, w)), _plus(M[5], -m, two_product(y, w)),
    )  # fmt: skip


@kernel
def _plus(a: DoubleDouble, s: float, b: DoubleDouble) -> DoubleDouble:
    return dd.add(a, dd.multiply_float(b, s))


@kernel
def _scaled(M: Inertia) -> Inertia:
    """Return M scaled by a power of two to a trace of about 1."""
    up = elementary.power_of_two_for(M[0][0] + M[1][0] + M[2][0])
    return (*dd.scale_vector(up, M[:3]), *dd.scale_vector(up, M[3:]))


@kernel(inline=False)
def _orthonormal(R: Matrix) -> Axes:
    """Return the columns of R, nearly orthonormal, made so in double-double by one step of Newton's method."""
    x, y, w = invert_matrix(R)
    xy, xw, yw = _half_dot(x, y)[0], _half_dot(x, w)[0], _half_dot(y, w)[0]
    return _corrected(x, xy, y, xw, w), _corrected(y, xy, x, yw, w), _corrected(w, xw, x, yw, y)


@kernel(inline=False)
def _corrected(x: Vec3, half_xy: float, y: Vec3, half_xw: float, w: Vec3) -> Vector:
    rest = dd.subtract((0.5, 0.0), _half_dot(x, x))[0]
    a, b, c = add_scaled(add_scaled(scale(rest, x), -half_xy, y), -half_xw, w)
    return two_sum(x[0], a), two_sum(x[1], b), two_sum(x[2], c)


@kernel
def _half_dot(a: Vec3, b: Vec3) -> DoubleDouble:
    return dd.scale(0.5, dd.dot_of_floats(a, b))


@kernel(inline=False)
def _refined(M: Inertia, axes: Axes) -> tuple[Vector, Axes]:
    """Return moments and axes of M by Jacobi's rotations, from axes that are principal to round-off.

    A sweep squares the elements off the diagonal, once they are small beside the gaps between the moments (Golub & Van
    Loan, Matrix Computations, 8.5): one sweep reduces them from round-off of doubles to that of double-double.
    """
    x, y, w = axes
    m_x, m_y, m_w = _times(M, x), _times(M, y), _times(M, w)
    a, b, c, d, e, f = dd.dot(x, m_x), dd.dot(y, m_y), dd.dot(w, m_w), dd.dot(x, m_y), dd.dot(x, m_w), dd.dot(y, m_w)
    least = _NEGLIGIBLE * (a[0] + b[0] + c[0])
    for _ in range(8):
        if not abs(d[0]) + abs(e[0]) + abs(f[0]) > least:
            break
        cos, sin, change = _jacobi(a, b, d, least)
        a, b, d, (e, f) = dd.subtract(a, change), dd.add(b, change), _ZERO, _turned(e, f, cos, sin)
        x, y = _turned_axes(x, y, cos, sin)
        cos, sin, change = _jacobi(a, c, e, least)
        a, c, e, (d, f) = dd.subtract(a, change), dd.add(c, change), _ZERO, _turned(d, f, cos, sin)
        x, w = _turned_axes(x, w, cos, sin)
        cos, sin, change = _jacobi(b, c, f, least)
        b, c, f, (d, e) = dd.subtract(b, change), dd.add(c, change), _ZERO, _turned(d, e, cos, sin)
        y, w = _turned_axes(y, w, cos, sin)
    return (a, b, c), (x, y, w)


@kernel
def _times(M: Inertia, v: Vector) -> Vector:
    """Return the product M v."""
    a, b, c, d, e, f = M
    return dd.dot((a, d, e), v), dd.dot((d, b, f), v), dd.dot((e, f, c), v)


@kernel(inline=False)
def _jacobi(p: DoubleDouble, q: DoubleDouble, o: DoubleDouble, least: float) -> dd.Three:
    """Return (cos, sin, tan times o) of the rotation that annihilates o of ((p, o), (o, q)); none if o is negligible.

    least: the size of o that counts as zero in the end; 2^-8 of it is negligible.
    """
    if not abs(o[0]) > 2.0**-8 * least:
        return _ONE, _ZERO, _ZERO
    x = dd.divide(dd.subtract(q, p), dd.scale(2.0, o))
    sign = -1.0 if x[0] < 0.0 else 1.0
    root = dd.root(dd.add_float(dd.multiply(x, x), 1.0))
    tan = dd.divide((sign, 0.0), dd.add(dd.scale(sign, x), root))
    cos = dd.divide(_ONE, dd.root(dd.add_float(dd.multiply(tan, tan), 1.0)))
    return cos, dd.multiply(tan, cos), dd.multiply(tan, o)


@kernel
def _turned(u: DoubleDouble, v: DoubleDouble, cos: DoubleDouble, sin: DoubleDouble) -> dd.Two:
    return dd.subtract(dd.multiply(cos, u), dd.multiply(sin, v)), dd.add(dd.multiply(sin, u), dd.multiply(cos, v))


@kernel(inline=False)
def _turned_axes(u: Vector, v: Vector, cos: DoubleDouble, sin: DoubleDouble) -> tuple[Vector, Vector]:
    a, d = _turned(u[0], v[0], cos, sin)
    b, e = _turned(u[1], v[1], cos, sin)
    c, f = _turned(u[2], v[2], cos, sin)
    return (a, b, c), (d, e, f)


@kernel(inline=False)
def principal_frame(M: Matrix) -> tuple[Vec3, Matrix]:
    """Return (moments, R_bp); the body's own axes where they are principal, whatever the order of the moments."""
    if is_diagonal(M):
        return (M[0][0], M[1][1], M[2][2]), ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    return principal_axes(M)


@kernel
def symmetric_frame(M: Matrix) -> tuple[float, float, Matrix]:
    """Return (I_t, I_s, axes) of a body with two equal moments.

    I_t is the moment that two axes share, or their mean; I_s is that of the third axis; the axes t, u, s are rows in b.
    M: symmetric, kg m^2.
    """
    moments, R_bp = principal_frame(M)
    s = _odd_one(moments)
    t, u = (s + 1) % 3, (s + 2) % 3
    axes = invert_matrix(R_bp)
    mean = moments[t] if moments[t] == moments[u] else 0.5 * (moments[t] + moments[u])
    return mean, moments[s], (axes[t], axes[u], axes[s])


@kernel
def exact_symmetric_frame(z: Buffer) -> tuple[DoubleDouble, DoubleDouble, Axes]:
    """Return `symmetric_frame` of the buffer's body in double-double; the moments in some power of two of kg m^2."""
    moments, axes = exact_frame(z)
    s = _odd_one((moments[0][0], moments[1][0], moments[2][0]))
    t, u = (s + 1) % 3, (s + 2) % 3
    return dd.scale(0.5, dd.add(moments[t], moments[u])), moments[s], (axes[t], axes[u], axes[s])


@kernel
def _odd_one(moments: Vec3) -> int:
    """Return the index of the axis whose moment is farthest from the other two."""
    a, b, c = moments
    x, y, w = abs(b - c), abs(c - a), abs(a - b)
    return 0 if x <= y and x <= w else (1 if y <= w else 2)


@kernel
def is_sphere(M: Matrix) -> bool:
    """Return whether the three moments are equal to the bit, so that every axis is principal.

    M: symmetric, kg m^2.
    """
    return M[0][0] == M[1][1] and M[1][1] == M[2][2] and is_diagonal(M)


# A body that turns about one principal axis, fixed in space: which axis, whether anything tilts it, what drives it

_PARALLEL = 8.0 * 2.0**-52
"""The part of a vector's length that may lie across an axis by round-off.

Of 20,000 vectors along an axis, turned by an attitude and back, the worst had 2.3 eps across; this is three times that.
"""


@kernel
def main_axis(z: Buffer) -> Vec3:
    """Return the principal axis along which most of the rate is, or about which a body at rest begins to turn.

    In equilibrium it is the axis about which the arm would swing. A sphere's axis may have any direction, as every axis
    is principal.
    """
    (q, omega), body, loads = memory.rotation_of(z), memory.body_of(z), memory.loads_of(z)
    v = omega if is_nonzero(omega) else angular_acceleration(q, omega, body, loads)
    if _may_be_oblique(body, loads) and is_nonzero(v):
        return scale(1.0 / norm(v), v)
    moments, R = principal_frame(body.inertia)
    e = invert_matrix(R)  # its rows are the axes
    x, y, w = abs(dot(e[0], v)), abs(dot(e[1], v)), abs(dot(e[2], v))
    if not is_nonzero(v):
        x, y = _clearance(moments[0], e[0], body.arm_b), _clearance(moments[1], e[1], body.arm_b)
        w = _clearance(moments[2], e[2], body.arm_b)
    k = 0 if x >= y and x >= w else (1 if y >= w else 2)
    return e[k]


@kernel
def _may_be_oblique(body: Body, loads: Loads) -> bool:
    """Return whether the body is a sphere that no force with an arm swings: round-off across its axis stays small."""
    return is_sphere(body.inertia) and not (is_nonzero(body.arm_b) and is_nonzero(loads.force_a))


@kernel
def _clearance(moment: float, axis: Vec3, arm: Vec3) -> float:
    """Return minus the arm's length along an axis, greatest where the arm lies across; -inf for one without inertia."""
    return -abs(dot(axis, arm)) if moment > 0.0 else -math.inf


@kernel
def leaves_axis(z: Buffer, axis: Vec3) -> bool:
    """Return whether anything, at any angle, turns the body about another axis, or a turning force bends its path.

    Loads that models with a closed form do not know count as well.
    """
    (q, omega), body, loads = memory.rotation_of(z), memory.body_of(z), memory.loads_of(z)
    arm, q_ba = body.arm_b, invert_quaternion(q)
    force = rotate(q_ba, loads.force_a)
    start = add(omega, angular_acceleration(q, omega, body, loads))
    slack = _PARALLEL if _may_be_oblique(body, loads) else 0.0
    across = _is_across(axis, start, slack) or _is_across(axis, omega, slack)
    across = across or _is_across(axis, damping_torque(body.damping_b, axis), slack)
    across = across or _is_across(axis, rotate(q_ba, loads.torque_a), slack)
    across = across or (is_nonzero(cross(axis, arm)) and dot(axis, force) != 0.0)
    across = across or (is_nonzero(cross(axis, force)) and dot(axis, arm) != 0.0)
    return across or turns_path(z, axis) or memory.has_unknown_load(z)


@kernel
def turns_path(z: Buffer, axis: Vec3) -> bool:
    """Return whether a force that turns about an axis with the body bends its path, and an output shows it.

    The axis may have any length, and is zero where the body does not turn. A force along the axis does not turn.
    """
    return memory.needs_translation(z) and _is_across(axis, memory.loads_of(z).force_b, _PARALLEL)


@kernel
def _is_across(axis: Vec3, v: Vec3, slack: float) -> bool:
    """Return whether the part of v across the axis, which may have any length, is more than `slack` of |v|."""
    return norm(cross(axis, v)) > slack * norm(axis) * norm(v)


@kernel(inline=False)
def swing(z: Buffer, axis: Vec3) -> dd.Two:
    """Return (A, B), rad/s^2: forces fixed in space cause the angular acceleration A cos phi + B sin phi.

    phi: the angle about the axis from quaternion_0 on.
    """
    arm, loads = memory.body_of(z).arm_b, memory.loads_of(z)
    q, moment = quaternion_at(z, memory.AT.quaternion_0), _moment(z, axis)
    q = scale_quaternion(elementary.power_of_two_for(largest_of(q)), q)
    force, mass = (loads.gravity_a, z[memory.AT.mass]) if memory.has_pivot(z) else (loads.force_a, 1.0)
    lever = cross(axis, arm)
    unit = dd.multiply(moment, dd.add(two_product(q[0], q[0]), dd.dot_of_floats(q[1:], q[1:])))
    a, b = _turned_dot(q, lever, force), _turned_dot(q, cross(axis, lever), force)
    return dd.divide(dd.multiply_float(a, mass), unit), dd.divide(dd.multiply_float(b, mass), unit)


@kernel
def drive_and_damping_rate(z: Buffer, axis: Vec3) -> tuple[float, float]:
    """Return (P, d), rad/s^2 and 1/s: torques, forces that turn with the body, and damping cause P - d rate.

    P - d rate is the angular acceleration about the axis.
    """
    q_ba, body, loads = invert_quaternion(memory.rotation_of(z).q_ab), memory.body_of(z), memory.loads_of(z)
    torque = add(rotate(q_ba, loads.torque_a), add(loads.torque_b, cross(body.arm_b, loads.force_b)))
    moment = _moment(z, axis)[0]
    return dot(axis, torque) / moment, -dot(axis, damping_torque(body.damping_b, axis)) / moment


@kernel
def _moment(z: Buffer, axis: Vec3) -> DoubleDouble:
    """Return the moment about the axis, through the centre of mass or the pivot."""
    moment = dd.dot_of_floats(axis, transform(memory.inertia_of(z), axis))
    if memory.has_pivot(z):
        lever = cross(axis, vec3_at(z, memory.AT.r_oc_b))
        moment = dd.add(moment, dd.multiply_float(dd.dot_of_floats(lever, lever), z[memory.AT.mass]))
    return moment


@kernel
def _triple(a: Vec3, b: Vec3, c: Vec3) -> DoubleDouble:
    """Return the product a . (b x c)."""
    x = dd.subtract(two_product(b[1], c[2]), two_product(b[2], c[1]))
    y = dd.subtract(two_product(b[2], c[0]), two_product(b[0], c[2]))
    w = dd.subtract(two_product(b[0], c[1]), two_product(b[1], c[0]))
    return dd.add(dd.add(dd.multiply_float(x, a[0]), dd.multiply_float(y, a[1])), dd.multiply_float(w, a[2]))


@kernel
def _turned_dot(q_ab: Quaternion, v_b: Vec3, u_a: Vec3) -> DoubleDouble:
    """Return |q|^2 u . R(q) v."""
    e = q_ab[1:]
    square = dd.subtract(two_product(q_ab[0], q_ab[0]), dd.dot_of_floats(e, e))
    along = dd.multiply(dd.dot_of_floats(u_a, e), dd.dot_of_floats(e, v_b))
    about = dd.multiply_float(_triple(u_a, e, v_b), q_ab[0])
    return dd.add(dd.multiply(square, dd.dot_of_floats(u_a, v_b)), dd.scale(2.0, dd.add(along, about)))
