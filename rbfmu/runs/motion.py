"""Errors between two motions (rows of quantities over a run), and the sizes that they are relative to.

Errors are measured as a scene's `accuracy`: of the attitude as an angle, rad; of all other quantities relative to their
largest size in the run, as there is no error relative to a quantity that passes through zero.
"""

import math
from collections.abc import Iterable, Iterator, Mapping

import numpy as np

from rbfmu import arrays
from rbfmu.models.question import Question
from rbfmu.scene.scene import Body, Scene
from rbfmu.types import Array, Buffer, Motion
from rbfmu_kernels.buffer_access import quaternion_at
from rbfmu_kernels.compile.decorator import kernel
from rbfmu_kernels.compile.tiered import tiered
from rbfmu_kernels.mechanics.inertia import INERTIA_TOLERANCE
from rbfmu_kernels.quantities import ANGLE, DISSIPATIVE, FORCES, OUTPUT, OUTPUTS, TORQUES
from rbfmu_kernels.rotations.quaternion import angle_between

FLOORS: Mapping[str, float] = {row.name: row.floor for row in OUTPUTS if row.floor}
"""The least size, m or m/s, that an error is relative to, by the quantity's name."""
NOISE = 64.0 * 2.0**-52
"""A quantity below this part of its largest term is only round-off, as for a body at rest, whatever terms cancel."""


# Errors between two motions


def attitude_error(a: Array, b: Array) -> Array:
    """Return the angles (...), rad, between attitudes a and b, unit quaternions (..., 4)."""
    if np.ndim(a) != 2 or np.shape(a) != np.shape(b):
        return arrays.angle_between(a, b)  # type: ignore[no-any-return]
    angles = np.empty(len(a))
    tiered(_put_angles)(*(np.ascontiguousarray(q, np.float64).ravel() for q in (a, b)), angles)
    return angles


@kernel(inline=False)
def _put_angles(a: Buffer, b: Buffer, angles: Buffer) -> None:
    for i in range(len(angles)):
        angles[i] = angle_between(quaternion_at(a, 4 * i), quaternion_at(b, 4 * i))


def relative_error(a: Array, b: Array, floor: float) -> Array:
    """Return |a - b| (n,) of rows (n, k), relative to the largest |b| of the run, or to `floor` if that is larger."""
    return sizes(a - b, max(largest_size(b), floor) or 1.0)


def largest_size(rows: Array) -> float:
    """Return the largest Euclidean norm of a row, without overflow."""
    unit = float(np.max(np.abs(rows), initial=0.0))
    return unit * float(np.max(sizes(rows, unit))) if 0.0 < unit < math.inf else unit


def sizes(rows: Array, unit: float) -> Array:
    """Return the Euclidean norms of rows, in units of `unit`."""
    return np.asarray(np.linalg.norm(rows / unit, axis=-1))


def largest_error(
    a: Mapping[str, Array], b: Mapping[str, Array], names: Iterable[str], floors: Mapping[str, float] = FLOORS,
    absolute: bool = False,
) -> float:  # fmt: skip
    """Return the largest error of motion a against b in the quantities named; infinite if one is not finite.

    floors: the least size that an error is relative to, by the quantity's name and in its unit; absolute: whether
    errors of positions and velocities are relative to 1 m and 1 m/s, as parameters vary with which these grow.
    """
    worst = 0.0
    for name in names:
        if name in OUTPUT and OUTPUT[name].error == ANGLE:
            largest = float(np.max(attitude_error(a[name], b[name])))
        elif absolute and name in FLOORS:
            largest = largest_size(a[name] - b[name])
        else:
            largest = float(np.max(relative_error(a[name], b[name], floors.get(name, 0.0))))
        worst = max(worst, largest) if math.isfinite(largest) else math.inf
    return worst


# Sizes that errors are relative to


def least_sizes(asked: Question, motion: Motion) -> dict[str, float]:
    """Return the least size that errors are relative to, by name.

    Errors of a quantity that is zero except for round-off of its terms are relative to the size of these terms.
    """
    return {**FLOORS, **{name: size for name, (size, part) in _sizes_and_parts(asked, motion).items() if part <= NOISE}}


def lost_to_cancellation(asked: Question, motion: Motion) -> float:
    """Return a bound of the relative error that cancellation of terms causes in the motion's quantities."""
    return max((NOISE / part for _, part in _sizes_and_parts(asked, motion).values() if part > NOISE), default=0.0)


def _sizes_and_parts(asked: Question, motion: Motion) -> dict[str, tuple[float, float]]:
    """Return each quantity's natural size, and its largest over natural size; for an energy the ratio's square root."""
    found: dict[str, tuple[float, float]] = {}
    for name, size in natural_sizes(asked, motion).items():
        if name in motion and size > 0.0:
            part = largest_size(motion[name]) / size
            found[name] = size, math.sqrt(part) if OUTPUT[name].unit == "J" else part
    return found


def natural_sizes(asked: Question, motion: Motion) -> dict[str, float]:
    """Return the size of each quantity if the scene's loads were not in balance, in the quantity's unit, by name."""
    body, size = asked.body, asked.scene.loads.sizes
    force, linear = _force_and_acceleration(body, size)
    arm, (low, middle, high) = math.hypot(*body.r_oc_b), asked.start.principal_axes[0].tolist()
    least = low if low > INERTIA_TOLERANCE * high else middle
    torque = sum(size[name] for name in sorted(TORQUES - DISSIPATIVE))
    angular = (torque + arm * force) / least
    turning = largest_size(motion.get("omega_b", np.array(asked.scene.initial.omega_b)))
    rate = math.sqrt(angular) + turning
    angular += turning * turning
    speed = 0.0 if body.pivot else linear * asked.span
    by_unit = {
        "rad/s": rate, "rad/s2": angular, "kg m2/s": high * rate, "m/s2": arm * angular + linear,
        "J": high * rate * rate + body.mass * speed * speed,
    }  # fmt: skip
    return {row.name: by_unit[row.unit] for row in OUTPUTS if row.unit in by_unit}


def _force_and_acceleration(body: Body, loads: Mapping[str, float]) -> tuple[float, float]:
    """Return the force, N, and acceleration, m/s2, by loads of these sizes if they were not in balance."""
    force = body.mass * loads["gravity_a"] if body.pivot else sum(loads[name] for name in sorted(FORCES))
    return force, loads["gravity_a"] + force / body.mass


def doubts_of_sizes(scene: Scene, motion: Motion) -> Iterator[str]:
    """Yield a doubt for positions or velocities that are smaller than the error that the accuracy allows.

    Values that are only round-off, as of loads in balance or of a rotation about o, give no doubt.
    """
    if scene.body is None:
        return
    (_, linear), span = _force_and_acceleration(scene.body, scene.loads.sizes), scene.run.stop - scene.run.start
    arm, rate = math.hypot(*scene.body.r_oc_b), math.hypot(*scene.initial.omega_b)
    at_rest = NOISE * max(linear * span * max(span, 1.0), arm * max(rate, 1.0))
    for name, floor in FLOORS.items():
        size = largest_size(motion[name]) if name in motion else 0.0
        if at_rest < size < scene.run.accuracy * floor:
            unit = OUTPUT[name].unit
            allowed = f"run.accuracy = {scene.run.accuracy:g} is relative to {floor:g} {unit} there"
            other = "the accuracy of an output of your own is relative to its own size"
            yield f"{name}: at most {size:.1e} {unit}, which may be wrong in every digit, as {allowed}; {other}"
