"""What contradicts between the sections of a scene, each valid by itself, and what is possible but looks like a slip.

Such doubts are warnings: a wrong unit, or too long a communication step.
"""

import math
import warnings
from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from rbfmu.exceptions import SceneWarning as SceneWarning
from rbfmu.scene.body import Body
from rbfmu.scene.section import fault
from rbfmu.types import Array
from rbfmu_kernels.compile.tiered import evaluated
from rbfmu_kernels.mechanics import inertia
from rbfmu_kernels.quantities import ANGLE, LOADS, OUTPUTS, TORQUES

if TYPE_CHECKING:
    from rbfmu.scene.scene import Inputs, Loads, Scene

PRESCRIBED = tuple(row.name for row in OUTPUTS if row.kinematic)
"""Quantities that follow from prescribed rates."""
NEGLIGIBLE = 1e-12
"""The relative size up to which a part of a vector counts as round-off, as in the kernels."""


def default_quantities(body: Body | None, inputs: "Inputs | None") -> tuple[str, ...]:
    """Return the default outputs: all quantities that this motion has."""
    if inputs is not None and "omega_b" in inputs.ports:
        return PRESCRIBED
    return tuple(row.name for row in OUTPUTS if not (body is not None and body.pivot and row.of_origin))


def faults_between(good: Mapping[str, Any]) -> Iterator[str]:
    """Yield all contradictions between those sections that are valid by themselves; a missing body is None."""
    inputs, body, initial = good.get("inputs"), good.get("body"), good.get("initial")
    if inputs is not None:
        prescribed = "omega_b" in inputs.ports
        if "body" in good and body is None and not prescribed:
            yield 'body is missing: expected a table [body] with mass and inertia (or shape), or ports = ["omega_b"]'
        for name in inputs.parameters:
            if name in inputs.ports:
                yield fault("inputs.parameters", inputs.parameters, f"no {name}: it is an input, by inputs.ports")
        if prescribed:
            yield from _faults_of_prescribed_rates(good)
            return
    if body is not None and body.pivot:
        if initial is not None and any(initial.velocity):
            yield fault("initial.velocity", initial.velocity, "zero: the pivot holds o (m/s)")
        if inputs is not None and "velocity_0" in inputs.parameters:
            yield fault("inputs.parameters", inputs.parameters, "no velocity_0: the pivot holds o")
    if body is not None and (axis := body.axis_without_inertia) is not None:
        yield from _faults_of_beam(body, np.array(axis), good)


def _faults_of_prescribed_rates(good: Mapping[str, Any]) -> Iterator[str]:
    inputs, outputs, initial = good["inputs"], good.get("outputs"), good.get("initial")
    if len(inputs.ports) > 1:
        yield fault("inputs.ports", inputs.ports, "omega_b alone: it prescribes the rates, so loads have no effect")
    why = "the port omega_b prescribes the rates, and nothing else is modelled"
    if good.get("body") is not None:
        yield f"a table [body] is given: expected none, as {why}"
    if set(inputs.parameters) - {"quaternion_0", "omega_b"}:
        yield fault("inputs.parameters", inputs.parameters, f"quaternion_0 at most: {why}")
    if outputs is not None and set(outputs.quantities) - set(PRESCRIBED):
        yield fault("outputs.quantities", outputs.quantities, f"names out of {', '.join(PRESCRIBED)}: {why}")
    if initial is not None and any(initial.omega_b):
        key, rates = initial.rates_said
        yield fault(key, rates, "zero, or no such key: the port omega_b prescribes the rates")


def _faults_of_beam(body: Body, axis: Array, good: Mapping[str, Any]) -> Iterator[str]:
    """Yield the faults of a body without inertia about `axis`: a torque about that axis makes the rate unbounded."""
    initial, loads, inputs = (good.get(key) for key in ("initial", "loads", "inputs"))
    about = f"about {_direction(axis)}, where inertia is zero to {NEGLIGIBLE:g} of its trace"
    # A force at o has the moment -r x F about the centre of mass of a free body, and no moment about a pivot.
    lever = np.zeros(3) if body.pivot else -np.cross(body.r_oc_b, axis)
    levered = not _small(lever, np.array(body.r_oc_b))
    if initial is not None and not _small(axis @ np.array(initial.omega_b), np.array(initial.omega_b)):
        key, rates = initial.rates_said
        yield fault(key, rates, f"no rate {about} ({'deg/s' if key.endswith('_deg') else 'rad/s'})")
    if loads is not None:
        yield from _faults_of_loads(loads, axis, lever, levered, about)
    if inputs is not None:
        for port in inputs.ports:
            if port in TORQUES or levered:
                yield fault("inputs.ports", inputs.ports, f"no {port}: it can act {about}")


def _faults_of_loads(loads: "Loads", axis: Array, lever: Array, levered: bool, about: str) -> Iterator[str]:
    if not _small(axis @ np.array(loads.torque_b), np.array(loads.torque_b)):
        yield fault("loads.torque_b", loads.torque_b, f"no torque {about} (N m)")
    if any(loads.torque_a):
        yield fault("loads.torque_a", loads.torque_a, f"zero, or torque_b: this one can come to act {about} (N m)")
    if levered and not _small(lever @ np.array(loads.force_b), np.array(loads.force_b) * np.linalg.norm(lever)):
        yield fault("loads.force_b", loads.force_b, f"a force at o without moment {about} (N)")
    if levered and any(loads.force_a):
        yield fault("loads.force_a", loads.force_a, f"zero, or force_b: this one can come to act {about} (N)")
    for load in (row for row in LOADS if row.dissipates):
        coefficients = getattr(loads, load.name)
        damped = np.array(coefficients) * axis
        if not _small(np.cross(damped, axis), damped):
            yield fault(f"loads.{load.name}", coefficients, f"one that makes no torque {about} ({load.unit})")


def _small(part: Array, whole: Array) -> bool:
    """Return whether a part of a vector is round-off."""
    return bool(np.linalg.norm(part) <= NEGLIGIBLE * np.linalg.norm(whole))


def _direction(axis: Array) -> str:
    return "(" + ", ".join(f"{x + 0.0:.4g}" for x in axis) + ")"


THINNEST = 0.05
"""The least plausible mass (kg) by the cube of the least radius of gyration (m3).

A solid ball has 17 times its density, so this is a 400th of air. The least radius is taken, as beams and cables have a
long one. Large solar sails have 0.02 to 5, frames in space 50, hulls of ships, asteroids and planets 1e4. An inertia in
kg cm2 in place of kg m2 makes it 1e6 times less: of a compact satellite 0.02.
"""
SMALLEST = 1e-4
"""The smallest plausible radius of gyration, in m."""
PERIODIC = tuple(row.name for row in OUTPUTS if row.error == ANGLE or row.unit == "rad")
"""Quantities that do not show a turn between two points."""


def warn(scene: "Scene", doubts: Iterable[str], stacklevel: int = 3) -> None:
    """Issue a SceneWarning for each doubt."""
    for doubt in doubts:
        warnings.warn(f"{scene.name}: {doubt}", SceneWarning, stacklevel=stacklevel)


def doubts_before(scene: "Scene") -> Iterator[str]:
    """Yield the doubts that a scene raises: an implausible radius of gyration, or more than one turn per step."""
    if scene.body is not None:
        yield from _size(scene.body)
    yield from _turns(scene, math.hypot(*scene.initial.omega_b), "at the start")


def doubts_after(scene: "Scene", motion: Mapping[str, Array]) -> Iterator[str]:
    """Yield the doubts that only the results of a run raise; `motion` holds them by quantity."""
    found = next((motion[row.name] for row in OUTPUTS if row.unit == "rad/s" and row.name in motion), None)
    if found is not None and not any(_turns(scene, math.hypot(*scene.initial.omega_b), "")):
        yield from _turns(scene, float(np.max(np.linalg.norm(found, axis=1))), "at the fastest")


def _size(body: Body) -> Iterator[str]:
    moments = evaluated(inertia.principal_axes, body.M_c)[0]
    least, radius = (math.sqrt(max(moment, 0.0) / body.mass) for moment in (moments[0], moments[2]))
    largest = math.cbrt(body.mass / THINNEST)
    if least > largest:
        wrong = f"is at least {least:.3g} m, beyond {largest:.3g} m, where {body.mass:g} kg are thinner than air"
    elif 0.0 < radius < SMALLEST:
        wrong = f"is {radius:.3g} m, below {1e3 * SMALLEST:g} mm"
    else:
        return
    yield f"the body's radius of gyration {wrong}; mass in kg, inertia in kg m2?"


def _turns(scene: "Scene", rate: float, when: str) -> Iterator[str]:
    turns = rate * scene.run.step / (2.0 * math.pi)
    if turns > 1.0 and (shown := [name for name in scene.outputs.quantities if name in PERIODIC]):
        lost = f"{turns:.3g} turns a communication step {when}, which {' and '.join(shown)} cannot show"
        yield f"run.step = {scene.run.step!r}: {lost}; a turn takes {scene.run.step / turns:.3g} s"
