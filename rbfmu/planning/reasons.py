"""Why a plan is what it is, in lines that each state a number with its unit."""

import numpy as np

from rbfmu.models.disturbances import growth_rate
from rbfmu.models.question import Question
from rbfmu.models.registry import ModelSpec
from rbfmu.runs.plan import Plan
from rbfmu_kernels.compile.tiered import interpreted
from rbfmu_kernels.quantities import FORCES, TORQUES
from rbfmu_kernels.rotations.quaternion import rotate

PRESCRIBED = "rotation: 4 states, port omega_b prescribes the rates; exact for rates held over a step"


def what_is_left_out(asked: Question, steady: bool) -> tuple[str, ...]:
    """Return what is not modelled, or is in closed form; steady: whether the model's force_b keeps its direction."""
    lines = [_translation(asked, steady)]
    if not asked.rotation:
        lines.append("rotation: 0 of 7 states, no output shows it and no force depends on it")
    elif not asked.attitude:
        lines.append("attitude: 0 of 4 states, no output shows it and no load depends on it")
    return tuple(lines)


def _translation(asked: Question, steady: bool) -> str:
    scene, body = asked.scene, asked.body
    loads, initial = scene.loads, scene.initial
    if not asked.translation:
        return "translation: 0 of 6 states, " + ("the pivot holds o" if body.pivot else "no output shows it")
    ports = [p for p in scene.inputs.ports if p in FORCES]
    if not steady and (any(loads.force_b) or "force_b" in ports):
        return f"translation: 6 states, force_b turns with the body of {body.mass:.6g} kg"
    push = np.array(loads.force_a) + np.array(interpreted(rotate)(initial.quaternion, loads.force_b))
    a = np.array(loads.gravity_a) + push / body.mass
    if ports:
        return f"translation: 6 states in closed form, {ports[0]} held over steps of {scene.run.step:g} s"
    if np.any(a):
        return f"translation: 6 states in closed form, constant acceleration {np.linalg.norm(a):.6g} m/s2"
    speed = float(np.linalg.norm(initial.velocity))
    return f"translation: 6 states in closed form, constant velocity {speed:.6g} m/s of the centre of mass"


def why_exact(asked: Question, spec: ModelSpec) -> tuple[str, ...]:
    """Return what makes a closed form exact."""
    if not asked.rotation:
        return ()
    growth = growth_rate(asked) if spec.may_be_unstable else 0.0
    unstable = (f"unstable: a disturbance would grow e-fold in {1.0 / growth:.3g} s",) if growth > 0.0 else ()
    return (spec.reason(asked), *unstable)


def why_fitted(plan: Plan, arithmetic: str) -> str:
    """Return what a plan's setting came to in a pilot run; arithmetic: of the judge."""
    how = f"at tolerance {plan.tolerance:.1e}" if plan.tolerance else f"in steps of {plan.substep:.3g} s"
    return f"{plan.method} {how}: error {plan.error:.1e} in a pilot run, judged in {arithmetic}"


def held_over_a_run(plan: Plan) -> str:
    """Return what a tolerance of the whole run means."""
    return f"{plan.method}: estimated errors of a run add up to at most {plan.tolerance:.1e}"


def why_held_whatever(asked: Question, plan: Plan, arithmetic: str) -> tuple[str, ...]:
    """Return how a plan serves inputs and parameters that no pilot run has seen."""
    held = f"{held_over_a_run(plan)}, whatever {' and '.join(sorted(asked.varying))} may be"
    return held, f"error {plan.error:.1e} in a pilot run with inputs at zero, judged in {arithmetic}"


def what_inputs_cost(asked: Question, plan: Plan) -> tuple[str, ...]:
    """Return what a zero-order hold of the inputs over a communication step does to a loop closed through them.

    No loop can be closed where no output shows what the ports do; the energy alone tells of no direction.
    A spring's energy grows each step by k h^2 / (2 m) of it, or with first derivatives of the inputs by
    (k h^2 / m)^2 / 12. With a damper beside it the loop is stable where k h / 2 < d < 2 m / h, as the products of its
    eigenvalues show.
    """
    scene, shown = asked.scene, asked.quantities - {"kinetic_energy"}
    ports, h, body = scene.inputs.ports, scene.run.step, scene.body
    if not ports:
        return ()
    derivatives = all(f"{port}_rate" in plan.kernels.BLOCKS for port in ports)
    remedy = "input derivatives, with which it is of second or third order, or " if derivatives else ""
    held = (
        f"inputs are held over each step of {h:g} s: a loop closed through them is of first order in it, whatever the "
        f"accuracy asked; remedy: {remedy}a shorter step"
    )
    if "omega_b" in ports or body is None:
        return held, f"a feedback of the angle on omega_b is unstable where its gain is beyond {2.0 / h:.3g} 1/s"
    lines: tuple[str, ...] = ()
    moved = shown & {"position", "velocity", "acceleration"}
    pushed, twisted = moved and set(ports) & set(FORCES), shown - moved and set(ports) & set(TORQUES)
    has_arm = any(body.r_oc_b) or "r_oc_b" in scene.inputs.parameters
    if not (pushed or twisted or (shown and has_arm) or scene.inputs.own):
        return ()
    if pushed and not body.pivot:
        lines = _held_loop(h, "forces", body.mass, "kg", "N/m", "N s/m")
    if twisted:
        moments = asked.start.principal_axes[0].tolist()
        least = next(moment for moment in moments if moment > 1e-12 * sum(moments))  # a beam's first is 0
        lines += _held_loop(h, "torques", least, "kg m2", "N m/rad", "N m s/rad")
    return held, *lines


def _held_loop(h: float, loads: str, m: float, inertia: str, spring: str, damper: str) -> tuple[str, ...]:
    gain, enough = f"gains {0.5 * h * h / m:.3g} k of its energy each step", f"{0.5 * h:.3g} k {damper}"
    return (
        f"a spring of k {spring} through {loads} on {m:.3g} {inertia} {gain}, unless a damper of {enough} is beside it",
        f"a damper beyond {2.0 * m / h:.3g} {damper} through {loads} is unstable",
    )
