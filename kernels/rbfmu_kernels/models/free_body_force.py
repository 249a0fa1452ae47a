"""A torque-free body under a force fixed in b: exact rotation, and a quadrature of the force for the path.

A step is cut into equal panels of at most `substep`, each with `order` points of Gauss's rule. What a panel of length s
leaves out shrinks as (omega s)^(2 order), and nothing else is left out; steps add up in twice the digits.
Source: Abramowitz and Stegun, 25.4.30.
"""

from typing import Any

from ..body.closed_form import commit_step, has_torque, is_finite_path, is_finite_rotation, time_after
from ..body.memory import body_of, centre_of, loads_of, put_centre, substep_of
from ..body.needs import skips_model_checks
from ..body.shell import entry_functions, feedthrough, outputs
from ..buffer import STEP_REJECTED, places
from ..buffer_access import put_vec3_at, vec3_at
from ..compile.decorator import kernel
from ..exact.free_rotation import free_attitude_at, place_at, scaled_time
from ..integrators.substeps import substeps_in
from ..mechanics.equations_of_motion import steady_acceleration, turning_acceleration
from ..numerics.double_double import two_sum
from ..rotations.vec3 import add_scaled
from ..types import Vec3
from .free_triaxial import FREE, free_motion_of, keep_place, output_rates, set_up_rotation, shown_rates

__all__ = ["BLOCKS", "SIZE", "feedthrough", "initialize", "output_rates", "outputs", "step"]

ORDERS = (1, 2, 3, 4, 5, 6, 7, 8)
"""The numbers of points a panel that may be chosen."""
_POINTS = (
    0.5,
    0.2113248654051871, 0.7886751345948129,
    0.11270166537925831, 0.5, 0.8872983346207417,
    0.06943184420297371, 0.33000947820757187, 0.6699905217924281, 0.9305681557970263,
    0.046910077030668004, 0.23076534494715845, 0.5, 0.7692346550528415,
    0.953089922969332,
    0.03376524289842399, 0.16939530676686773, 0.38069040695840156, 0.6193095930415985,
    0.8306046932331322, 0.966234757101576,
    0.025446043828620736, 0.12923440720030277, 0.2970774243113014, 0.5,
    0.7029225756886985, 0.8707655927996972, 0.9745539561713793,
    0.019855071751231884, 0.10166676129318664, 0.2372337950418355, 0.4082826787521751,
    0.591717321247825, 0.7627662049581645, 0.8983332387068134, 0.9801449282487681,
)  # fmt: skip
_WEIGHTS = (
    1.0,
    0.5, 0.5,
    0.2777777777777778, 0.4444444444444444, 0.2777777777777778,
    0.17392742256872692, 0.32607257743127305, 0.32607257743127305, 0.17392742256872692,
    0.11846344252809454, 0.23931433524968324, 0.28444444444444444, 0.23931433524968324,
    0.11846344252809454,
    0.08566224618958518, 0.1803807865240693, 0.23395696728634552, 0.23395696728634552,
    0.1803807865240693, 0.08566224618958518,
    0.06474248308443485, 0.13985269574463832, 0.19091502525255946, 0.2089795918367347,
    0.19091502525255946, 0.13985269574463832, 0.06474248308443485,
    0.05061426814518813, 0.11119051722668724, 0.15685332293894363, 0.181341891689181,
    0.181341891689181, 0.15685332293894363, 0.11119051722668724, 0.05061426814518813,
)  # fmt: skip
"""Points or weights of Gauss's rule on [0, 1], by order: k of them from k (k - 1) / 2 on."""

BLOCKS, SIZE = places(FREE | {"order": 1, "low_r": 3, "low_v": 3})
"""After FREE: order, and the low parts of position and velocity of the centre of mass."""

_ORDER, _LOW_R, _LOW_V = (BLOCKS[n].start for n in ("order", "low_r", "low_v"))
_TORQUE = 11
"""The key in `buffer.FAULTS`."""
_NONE = (0.0, 0.0, 0.0)


@kernel
def _set_up(z: Any) -> int:
    if not skips_model_checks(z) and has_torque(z):
        return _TORQUE
    set_up_rotation(z)
    put_vec3_at(z, _LOW_R, _NONE)
    put_vec3_at(z, _LOW_V, _NONE)
    return 0


@kernel
def _advance(z: Any, h: float) -> int:
    """Advance by h; reject the step and change nothing where the motion is not finite or an input makes a torque."""
    count = substeps_in(h, substep_of(z))
    if count == 0 or (not skips_model_checks(z) and has_torque(z)):
        return STEP_REJECTED
    motion = free_motion_of(z)
    t = scaled_time(motion, time_after(z, h))
    place = place_at(motion, t)
    q, omega = free_attitude_at(motion, t, place), shown_rates(z, place)
    (r, low_r), (v, low_v) = _moved(z, h, count)
    if not is_finite_rotation(q, omega) or not is_finite_path(r, v):
        return STEP_REJECTED
    put_centre(z, r, v)
    put_vec3_at(z, _LOW_R, low_r)
    put_vec3_at(z, _LOW_V, low_v)
    keep_place(z, place)
    return commit_step(z, h, q, omega)


@kernel
def _moved(z: Any, h: float, count: int) -> tuple[tuple[Vec3, Vec3], tuple[Vec3, Vec3]]:
    """Return position and velocity of the centre of mass after h, each with its low part."""
    body, loads = body_of(z), loads_of(z)
    (r, v), a = centre_of(z), steady_acceleration(body, loads)
    gained_r, gained_v = _gained(z, h, count)
    way = add_scaled(add_scaled(gained_r, 0.5 * h * h, a), h, v)
    return _sum(r, vec3_at(z, _LOW_R), way), _sum(v, vec3_at(z, _LOW_V), add_scaled(gained_v, h, a))


@kernel
def _gained(z: Any, h: float, count: int) -> tuple[Vec3, Vec3]:
    """Return what the turning force adds to position and velocity in h."""
    body, loads, motion = body_of(z), loads_of(z), free_motion_of(z)
    order, part = int(z[_ORDER]), h / count
    first, r, v = order * (order - 1) // 2, _NONE, _NONE
    for i in range(count):
        r = add_scaled(r, part, v)
        for j in range(first, first + order):
            t = scaled_time(motion, time_after(z, (i + _POINTS[j]) * part))
            a = turning_acceleration(free_attitude_at(motion, t, place_at(motion, t)), body, loads)
            dv = part * _WEIGHTS[j]
            r = add_scaled(r, part * (1.0 - _POINTS[j]) * dv, a)
            v = add_scaled(v, dv, a)
    return r, v


@kernel
def _sum(a: Vec3, low: Vec3, b: Vec3) -> tuple[Vec3, Vec3]:
    """Return a + low + b, and its low part."""
    x, low_x = two_sum(a[0], b[0] + low[0])
    y, low_y = two_sum(a[1], b[1] + low[1])
    w, low_w = two_sum(a[2], b[2] + low[2])
    return (x, y, w), (low_x, low_y, low_w)


initialize, step = entry_functions(__name__, _set_up, _advance)
