"""Contradictions between the sections of a scene, each of which is valid by itself."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from rbfmu.scene.body import Body
from rbfmu.scene.fields import fault
from rbfmu_kernels.quantities import LOADS, OUTPUTS, TORQUES
from rbfmu_kernels.types import Vec3

PRESCRIBED = tuple(row.name for row in OUTPUTS if row.kinematic)
"""Quantities that follow from prescribed rates."""
HELD = tuple(row.name for row in OUTPUTS if row.of_origin)
"""Quantities of o, which a pivot keeps fixed."""
NEGLIGIBLE = 1e-12
"""The relative size up to which a part of a vector counts as round-off, as in the kernels."""


def default_quantities(body: Body | None, inputs: Any, quantities: tuple[str, ...]) -> tuple[str, ...]:
    """Return the default outputs: all quantities that this motion has."""
    if inputs is not None and "omega_b" in inputs.ports:
        return PRESCRIBED
    return tuple(q for q in quantities if not (body is not None and body.pivot and q in HELD))


def faults_between(good: Mapping[str, Any], rates: tuple[str, Any] | None = None) -> Iterator[str]:
    """Yield all contradictions between those sections that are valid by themselves; a missing body is None.

    rates: the key and value of the initial rates as written in the file, if the key is not `initial.omega_b`.
    """
    inputs, body, initial = good.get("inputs"), good.get("body"), good.get("initial")
    rates = rates or ("initial.omega_b", initial and initial.omega_b)
    if inputs is not None:
        prescribed = "omega_b" in inputs.ports
        if "body" in good and body is None and not prescribed:
            yield 'body is missing: expected a table [body] with mass and inertia (or shape), or ports = ["omega_b"]'
        yield from _faults_of_parameters(inputs)
        if prescribed:
            yield from _faults_of_prescribed_rates(good, rates)
            return
    if body is not None and body.pivot:
        if initial is not None and any(initial.velocity):
            yield fault("initial.velocity", initial.velocity, "zero: the pivot holds o (m/s)")
        if inputs is not None and "velocity_0" in inputs.parameters:
            yield fault("inputs.parameters", inputs.parameters, "no velocity_0: the pivot holds o")
    if body is not None and (axis := body.axis_without_inertia) is not None:
        yield from _faults_of_beam(body, np.array(axis), good, rates)


def _faults_of_parameters(inputs: Any) -> Iterator[str]:
    for name in inputs.parameters:
        if name in inputs.ports:
            yield fault("inputs.parameters", inputs.parameters, f"no {name}: it is an input, by inputs.ports")


def _faults_of_prescribed_rates(good: Mapping[str, Any], rates: tuple[str, Any]) -> Iterator[str]:
    inputs, outputs, initial = good["inputs"], good.get("outputs"), good.get("initial")
    if len(inputs.ports) > 1:
        yield fault("inputs.ports", inputs.ports, "omega_b alone: it prescribes the rates, so loads have no effect")
    why = "the port omega_b prescribes the rates, and nothing else is modelled"
    for name in inputs.parameters:
        if name not in ("quaternion_0", "omega_b"):
            yield fault("inputs.parameters", inputs.parameters, f"quaternion_0 at most: {why}")
            break
    if outputs is not None and set(outputs.quantities) - set(PRESCRIBED):
        yield fault("outputs.quantities", outputs.quantities, f"names out of {', '.join(PRESCRIBED)}: {why}")
    if initial is not None and any(initial.omega_b):
        yield fault(rates[0], rates[1], "zero, or no such key: the port omega_b prescribes the rates")


def _faults_of_beam(body: Body, axis: Any, good: Mapping[str, Any], rates: tuple[str, Any]) -> Iterator[str]:
    """Yield the faults of a body without inertia about `axis`: a torque about that axis makes the rate unbounded."""
    initial, loads, inputs = (good.get(key) for key in ("initial", "loads", "inputs"))
    about = f"about {_direction(axis)}, where inertia is zero to {NEGLIGIBLE:g} of its trace"
    # A force at o has the moment -r x F about the centre of mass of a free body, and no moment about a pivot.
    lever = np.zeros(3) if body.pivot else -np.cross(body.r_oc_b, axis)
    levered = not _small(lever, np.array(body.r_oc_b))
    if initial is not None and not _small(axis @ np.array(initial.omega_b), np.array(initial.omega_b)):
        unit = "deg/s" if rates[0].endswith("_deg") else "rad/s"
        yield fault(rates[0], rates[1], f"no rate {about} ({unit})")
    if loads is not None:
        yield from _faults_of_loads(loads, axis, lever, levered, about)
    if inputs is not None:
        for port in inputs.ports:
            if port in TORQUES or levered:
                yield fault("inputs.ports", inputs.ports, f"no {port}: it can act {about}")


def _faults_of_loads(loads: Any, axis: Any, lever: Any, levered: bool, about: str) -> Iterator[str]:
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


def _small(part: Any, whole: Any) -> bool:
    """Return whether a part of a vector is round-off."""
    return bool(np.linalg.norm(part) <= NEGLIGIBLE * np.linalg.norm(whole))


def _direction(axis: Vec3) -> str:
    return "(" + ", ".join(f"{x + 0.0:.4g}" for x in axis) + ")"
