"""Why a plan is what it is, in lines that each state a number with its unit."""

import math

import numpy as np
from numpy.typing import NDArray

from rbfmu.arrays import principal_axes, rotate
from rbfmu.planning.candidates import acting_loads, torques
from rbfmu.runs.models import Plan
from rbfmu.scene.scene import Scene
from rbfmu_kernels.quantities import FORCES, TORQUES

PRESCRIBED = "rotation: 4 states, port omega_b prescribes the rates; exact for rates held over a step"
Array = NDArray[np.float64]

GROWTH = 0.1
"""Growth of a disturbance over the run, as an exponent, from which on a spin counts as unstable."""


def what_is_left_out(
    scene: Scene, attitude: bool, rotation: bool, translation: bool, steady: bool = False
) -> tuple[str, ...]:
    """Degrees of freedom that are not modelled, or in closed form; steady: the model's force_b keeps its direction."""
    lines = [_translation(scene, translation, steady)]
    if not rotation:
        lines.append("rotation: 0 of 7 states, no output shows it and no force depends on it")
    elif not attitude:
        lines.append("attitude: 0 of 4 states, no output shows it and no load depends on it")
    return tuple(lines)


def _translation(scene: Scene, needed: bool, steady: bool) -> str:
    body, loads, initial = scene.body, scene.loads, scene.initial
    assert body is not None
    if not needed:
        return "translation: 0 of 6 states, " + ("the pivot holds o" if body.pivot else "no output shows it")
    ports = [p for p in scene.inputs.ports if p in FORCES]
    if not steady and (any(loads.force_b) or "force_b" in ports):
        return f"translation: 6 states, force_b turns with the body of {body.mass:.6g} kg"
    push = np.array(loads.force_a) + rotate(np.array(initial.quaternion), np.array(loads.force_b))
    a = np.array(loads.gravity_a) + push / body.mass
    if ports:
        return f"translation: 6 states in closed form, {ports[0]} held over steps of {scene.run.step:g} s"
    if np.any(a):
        return f"translation: 6 states in closed form, constant acceleration {np.linalg.norm(a):.6g} m/s2"
    speed = float(np.linalg.norm(initial.velocity))
    return f"translation: 6 states in closed form, constant velocity {speed:.6g} m/s of the centre of mass"


def why_exact(scene: Scene, model: str, rotation: bool, attitude: bool) -> tuple[str, ...]:
    """What makes a closed form exact."""
    if not rotation:
        return ()
    rate = float(np.linalg.norm(scene.initial.omega_b))
    moments = ", ".join(f"{m:.6g}" for m in _moments(scene))
    lines = {
        "no rotation": _standing(scene, rate, attitude),
        "constant rate": f"rotation: constant rate {rate:.6g} rad/s, about a principal axis (moments {moments} kg m2)",
        "angular momentum": "rotation: 3 of 7 states, angular momentum h_0 + T t under torque_a, its attitude left out",
        "one axis": f"rotation: one angle, closed form from {rate:.6g} rad/s about one axis under {_acting(scene)}",
        "undamped pendulum": f"rotation: one angle from {rate:.6g} rad/s, swung by forces fixed in space, undamped",
        "torque-free symmetric body": f"rotation: no torque, two equal moments ({moments} kg m2): elementary functions",
        "symmetric body spun up": f"rotation: rates in closed form from {rate:.6g} rad/s under {_acting(scene)}, "
        f"two equal moments ({moments} kg m2)",
        "torque-free body": f"rotation: no torque, moments {moments} kg m2: elliptic functions",
    }
    growth = growth_rate(scene) if model in ("no rotation", "constant rate", "one axis") else 0.0
    unstable = f"unstable: a disturbance would grow e-fold in {1.0 / growth:.3g} s" if growth > 0.0 else ""
    return (lines[model], unstable) if unstable else (lines[model],)


def _acting(scene: Scene) -> str:
    """Names of the loads that turn the body."""
    return " and ".join(sorted(torques(scene) & acting_loads(scene.loads))) or "no torque"


def _standing(scene: Scene, rate: float, attitude: bool) -> str:
    if attitude or rate == 0.0:
        return "rotation: 0 of 7 states, the body begins at 0 rad/s and nothing turns it"
    return f"rotation: 0 of 7 states, the rates asked for stay as they begin ({rate:.6g} rad/s)"


def why_swinging(scene: Scene, plan: Plan) -> tuple[str, ...]:
    """One angle, integrated."""
    return ("rotation: one angle, every load turns the body about one principal axis; 2 of 7 states",)


def why_pushed(scene: Scene, plan: Plan) -> tuple[str, ...]:
    """Exact rotation, the path by quadrature."""
    moments = ", ".join(f"{m:.6g}" for m in _moments(scene))
    rule = plan.method.rpartition(", ")[2]
    why = f"path: {rule} in panels of {plan.substep:.3g} s: error {plan.error:.1e}"
    return f"rotation: no torque, moments {moments} kg m2: elliptic functions", f"{why}, {scene.run.accuracy:g} asked"


def why_close(scene: Scene, model: str, found: Plan | None, error: float, points: int) -> str:
    """What a model that is not exact leaves out."""
    larger = found.model if found else "the body under loads"
    return f"{larger} dropped for {model}: {error:.1e} apart at {points} times, {scene.run.accuracy:g} asked"


def only_in_own_steps(error: float) -> str:
    """Where other communication steps are less accurate than asked."""
    return f"in other communication steps than the scene's the error is up to {error:.1e}"


def unstable_at_zero_inputs(growth: float) -> str:
    """Where the accuracy is that of substeps only."""
    return (
        f"with inputs at zero the motion magnifies an error {growth:.1e} times, round-off beyond the accuracy: only "
        "the errors of substeps are held to it"
    )


def what_inputs_cost(scene: Scene, plan: Plan) -> tuple[str, ...]:
    """What holding the inputs over a communication step does to a loop that is closed through them.

    A spring's energy grows by k h^2 / (2 m) of it a step, with first derivatives of the inputs by (k h^2 / m)^2 / 12;
    with a damper beside it the loop is stable where k h / 2 < d < 2 m / h: from the products of its eigenvalues.
    """
    ports, h, body = scene.inputs.ports, scene.run.step, scene.body
    if not ports:
        return ()
    derivatives = all(f"{port}_rate" in plan.unit.BLOCKS for port in ports)
    remedy = "input derivatives, with which it is of second or third order, or " if derivatives else ""
    held = (
        f"inputs are held over each step of {h:g} s: a loop closed through them is of first order in it, whatever the "
        f"accuracy asked; remedy: {remedy}a shorter step"
    )
    if "omega_b" in ports or body is None:
        return held, f"a feedback of the angle on omega_b is unstable where its gain is beyond {2.0 / h:.3g} 1/s"
    lines: tuple[str, ...] = ()
    if any(port in FORCES for port in ports) and not body.pivot:
        lines = _held_loop(h, "forces", body.mass, "kg", "N/m", "N s/m")
    if any(port in TORQUES for port in ports):
        moments = _moments(scene)
        least = next(moment for moment in moments if moment > 1e-12 * sum(moments))  # a beam's first is 0
        lines += _held_loop(h, "torques", least, "kg m2", "N m/rad", "N m s/rad")
    return held, *lines


def _held_loop(h: float, loads: str, m: float, inertia: str, spring: str, damper: str) -> tuple[str, ...]:
    gain, enough = f"gains {0.5 * h * h / m:.3g} k of its energy each step", f"{0.5 * h:.3g} k {damper}"
    return (
        f"a spring of k {spring} through {loads} on {m:.3g} {inertia} {gain}, unless a damper of {enough} is beside it",
        f"a damper beyond {2.0 * m / h:.3g} {damper} through {loads} is unstable",
    )


def growth_rate(scene: Scene) -> float:
    """1/s: how fast a disturbance of the motion at the start grows; 0 where it is stable.

    A free spin about the middle axis: omega sqrt((I_k - I_i) (I_j - I_k) / (I_i I_j)); a body on a pivot whose centre
    of mass is above it, spinning at omega_s: sqrt(4 I_t m g l - (I_s omega_s)^2) / (2 I_t).
    """
    body, omega, gravity = scene.body, np.array(scene.initial.omega_b), np.array(scene.loads.gravity_a)
    assert body is not None
    moments, R = principal_axes(np.array(body.M))
    arm = np.array(body.r_oc_b)
    if body.pivot and np.any(gravity) and np.any(arm):
        return _growth_above_pivot(scene, moments, R)
    rates = np.abs(R.T @ omega)
    k = int(np.argmax(rates))
    if k != 1 or moments[0] == 0.0:
        return 0.0
    low, middle, high = moments
    return float(rates[k] * math.sqrt((middle - low) * (high - middle) / (low * high)))


def _growth_above_pivot(scene: Scene, moments: Array, R: Array) -> float:
    body = scene.body
    assert body is not None
    arm = np.array(body.r_oc_b)
    length = float(np.linalg.norm(arm))
    up = -np.array(scene.loads.gravity_a)
    if float(rotate(np.array(scene.initial.quaternion), arm) @ up) <= 0.0:
        return 0.0
    own = int(np.argmax(np.abs(R.T @ arm)))
    least = float(np.min(np.delete(moments, own)))
    spin = float(moments[own] * (R.T @ np.array(scene.initial.omega_b))[own])
    weight = body.mass * float(np.linalg.norm(up)) * length
    square = 4.0 * least * weight - spin * spin
    return math.sqrt(square) / (2.0 * least) if square > 0.0 else 0.0


def _moments(scene: Scene) -> list[float]:
    assert scene.body is not None
    found: list[float] = principal_axes(np.array(scene.body.M))[0].tolist()
    return found
