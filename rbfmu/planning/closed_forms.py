"""Plans of models that need no integration: exact ones, and smaller ones that are within the accuracy.

An exact closed form has only round-off errors, for which there are formulas. A smaller model is compared with the exact
one, or with the motion in double-double arithmetic.
"""

import math
from dataclasses import replace

import numpy as np

from rbfmu.models import registry
from rbfmu.models.question import GROWING, Question
from rbfmu.planning.judge import Judge, refuse_below
from rbfmu.planning.methods import EXACT
from rbfmu.runs.motion import largest_error, least_sizes, lost_to_cancellation
from rbfmu.runs.plan import Plan
from rbfmu.runs.steps import motion_of
from rbfmu.scene.scene import Scene
from rbfmu.types import Array, Motion
from rbfmu_kernels.compile.tiered import interpreted
from rbfmu_kernels.integrators.substeps import ROUND_OFF
from rbfmu_kernels.quantities import FORCES, OUTPUTS
from rbfmu_kernels.rotations.quaternion import rotate

CONDITIONED = 0.1
"""The largest error by conditioning, as a part of the accuracy, with which the smallest exact model is chosen; with a
larger one, an exact model with a smaller error is preferred."""
TRANSLATION = {row.name for row in OUTPUTS if row.of_origin}
CONSERVED = {row.name for row in OUTPUTS if row.conserved}
DIFFERENCES = {row.name for row in OUTPUTS if row.cancels}
"""Quantities that are sums of terms that may cancel, so that their relative round-off is larger than the state's."""
LITTLE = 0.1
"""The largest error by cancellation, as a part of the accuracy and by a quick bound, that needs no comparison."""
DERIVED = 1e-9
"""The accuracy below which the quantities of DIFFERENCES are compared even if the state is exact.

Without this, a plan promised the error of the state, although a difference of two large terms had lost more digits.
"""
GROWTH = 0.1
"""A spin counts as unstable if the exponent of a disturbance's growth over the run is larger: at this value the
disturbance grows by a tenth, e^0.1 = 1.105."""
SHARE = 0.8
"""The largest error of a smaller model, as a part of the accuracy, if it is not compared with a closed form."""
FEW, FAR = 50, 10.0
"""FEW: the steps at which models are compared first, if there are more. FAR: a model whose error at these is more than
FAR times the allowed error is not run at all steps. Sizes that errors are relative to may be larger between so few."""
PRESCRIBED = "rotation: 4 states, port omega_b prescribes the rates; exact for rates held over a step"


# Rates that are prescribed


def prescribed_rates_error(scene: Scene) -> float:
    """Return the round-off error of the attitude by prescribed rates, rad.

    Each change of the rates adds up to 0.6 eps to the quaternion's error, or 1.1 eps in rad, if all have the same sign.
    The angle between changes has no effect. Rates that change within a step, which a native FMU can take, add as much
    for each radian.
    """
    return ROUND_OFF * (1.0 + scene.run.count)


def prescribed_plan(asked: Question) -> Plan:
    """Return the plan for rates that a port prescribes. Raises SceneError if round-off is above the accuracy."""
    spec, error = registry.PRESCRIBED_RATES, prescribed_rates_error(asked.scene)
    refuse_below(asked, error)
    return Plan(spec.key, spec.method, spec.states, error=error, reasons=(PRESCRIBED,))


# Closed forms that are exact


def exact_closed_form(asked: Question) -> registry.ModelSpec | None:
    """Return the smallest closed form that is exact for this scene and, if there is one, well conditioned; or None."""
    exact = [spec for spec in registry.CLOSED_FORMS if spec.serves(asked)]
    good = (spec for spec in exact if spec.conditioning(asked) <= CONDITIONED * asked.accuracy)
    return next(good, exact[0] if exact else None)


def exact_plan(asked: Question, judge: Judge) -> Plan | None:
    """Return the plan of an exact closed form, with its round-off error, or None if there is none.

    Raises SceneError if round-off is above the accuracy.
    """
    spec = exact_closed_form(asked)
    if spec is None:
        return None
    found, delicate = Plan(spec.key, spec.method, 0), asked.accuracy < DERIVED and set(asked.judged) & DIFFERENCES
    motion = _coarse_motion(asked, found)
    error = EXACT + (ROUND_OFF * (_fastest(motion["omega_b"]) * asked.span) if spec.angle_round_off else 0.0)
    error += spec.conditioning(asked)
    lost = lost_to_cancellation(asked, motion)
    if delicate or lost > LITTLE * asked.accuracy:
        error = max(error, judge.error_if_soon(found, otherwise=lost if lost > LITTLE * asked.accuracy else 0.0))
    if delicate and "alpha_b" in delicate:
        found = replace(found, pinned=asked.pinned)
    refuse_below(asked, error)
    return replace(found, error=error, reasons=why_exact(asked, spec))


def why_exact(asked: Question, spec: registry.ModelSpec) -> tuple[str, ...]:
    """Return the reasons why a closed form is exact."""
    if not asked.rotation:
        return ()
    growth = growth_rate(asked) if spec.may_be_unstable else 0.0
    unstable = (f"unstable: a disturbance would grow e-fold in {1.0 / growth:.3g} s",) if growth > 0.0 else ()
    return (spec.reason(asked), *unstable)


def _coarse_motion(asked: Question, found: Plan) -> Motion:
    """Return a closed form's motion at some times, for the sizes of quantities that are needed."""
    cancelling = tuple(name for name in asked.judged if name in DIFFERENCES)
    names = tuple(dict.fromkeys((*cancelling, "omega_b"))) if found.spec.angle_round_off else cancelling
    if not names:
        return {}  # do not run the model, which would have to be loaded or compiled
    return motion_of(asked.scene, found, asked.scene.run.thinned_steps(100), names)


def _fastest(rates: Array) -> float:
    with np.errstate(over="ignore"):  # an infinite error is refused
        return float(np.max(np.linalg.norm(rates, axis=1)))


# Models that are not exact, but within the accuracy


def plan_within_accuracy(asked: Question, judge: Judge, exact: Plan | None) -> Plan | None:
    """Return the plan of the smallest model within the accuracy, if nothing varies that the comparison depends on.

    exact: the plan of the exact closed form, with which smaller models are compared; None: they are compared with the
    motion in double-double arithmetic.
    """
    names = asked.judged
    smaller = [*registry.CLOSED_FORMS[: registry.CLOSED_FORMS.index(exact.spec) if exact else None]]
    if not smaller or not asked.rotation or not _may_be_compared(asked):
        return None
    if "force_b" in asked.varying and "acceleration" in names and "quaternion" not in names:
        names = (*names, "quaternion")  # ports are zero here; the force that they supply is as wrong as the attitude
    shown = tuple(dict.fromkeys((*names, "omega_b")))  # rates only for their change
    bound = asked.accuracy - exact.error if exact else SHARE * asked.accuracy - EXACT
    if exact and asked.scene.run.count > FEW:
        few = Judge(asked, most=FEW)
        roughly = few.motion_by(replace(exact, pinned=asked.pinned), shown)
        smaller = [spec for spec in smaller if _error(few, spec, roughly, names, FAR) <= FAR * bound]
        if not smaller:
            return None
    truth = judge.motion_by(replace(exact, pinned=asked.pinned), shown) if exact else judge.motion
    for spec in smaller:
        error = _error(judge, spec, truth, names)
        if error <= bound:
            why = f"{spec.key} in place of {exact.model if exact else 'the body under loads'}: "
            why += f"{error:.1e} apart at {len(truth['omega_b']) - 1} times, {asked.accuracy:g} asked"
            error += exact.error if exact else 0.0
            return replace(_candidate(asked, spec), error=error, reasons=(why,))
    return None


def _candidate(asked: Question, spec: registry.ModelSpec) -> Plan:
    return Plan(spec.key, spec.method, 0, pinned=asked.pinned)


def _error(judge: Judge, spec: registry.ModelSpec, truth: Motion, names: tuple[str, ...], times: float = 1.0) -> float:
    """Return a model's error relative to `truth`; infinity if it cannot be within `times` the accuracy."""
    asked = judge.asked
    if not _may_be_close(asked, spec, truth, names, times * asked.accuracy):
        return math.inf
    motion = judge.motion_by(_candidate(asked, spec), names)  # also between communication points
    return largest_error(motion, truth, names, least_sizes(asked, truth), absolute=bool(asked.varying & GROWING))


def _may_be_compared(asked: Question) -> bool:
    """Return whether rotation and sizes of the compared quantities do not depend on anything that varies."""
    names = set(asked.judged)
    rests = {*registry.ONE_AXIS.rests_on(asked)}
    if asked.translation or "acceleration" in names:
        rests = rests | {"r_oc_b"}
        if any(asked.scene.loads.force_b):
            rests = rests | {"mass"}
    if names & {"acceleration", "kinetic_energy"}:
        rests = rests | GROWING
    return not rests & asked.varying


def _may_be_close(
    asked: Question, spec: registry.ModelSpec, truth: Motion, names: tuple[str, ...], accuracy: float
) -> bool:
    """Return whether a model may be within the accuracy, by a quick estimate from the larger model's motion."""
    kept = set() if spec.states else TRANSLATION | CONSERVED
    if growth_rate(asked) * asked.span > GROWTH and not set(names) <= kept:
        return False
    if not spec.states:
        return _is_constant(asked, truth, names, accuracy)
    if spec.rates_from is None:
        return True
    rates = truth["omega_b"]
    change, fastest = _fastest(rates - spec.rates_from(asked, rates)), _fastest(rates)
    if "omega_b" in names and change > accuracy * fastest:
        return False
    # A hundredth of the rotation that the change of rates may cause: a trial in vain costs one run, but no accuracy.
    return 0.01 * change * min(asked.span, 1.0 / fastest if fastest > 0.0 else math.inf) <= accuracy


def _is_constant(asked: Question, truth: Motion, names: tuple[str, ...], accuracy: float) -> bool:
    """Return whether all compared quantities, except the path and the energy, stay as they begin."""
    names = tuple(n for n in names if n not in (*TRANSLATION, "kinetic_energy"))
    still = {n: truth[n][:1] + 0.0 * truth[n] for n in names}
    return largest_error(still, truth, names, least_sizes(asked, truth)) <= accuracy


# How fast a disturbance grows


def growth_rate(asked: Question) -> float:
    """Return how fast a disturbance of the motion at the start grows, 1/s; 0 where it is stable.

    It is omega sqrt((I_k - I_i) (I_j - I_k) / (I_i I_j)) for a free spin about the middle axis, and
    sqrt(4 I_t m g l - (I_s omega_s)^2) / (2 I_t) for a body spinning at omega_s with its centre of mass above a pivot.
    """
    moments, R = asked.start.principal_axes
    arm, rates = R.T @ np.array(asked.body.r_oc_b), R.T @ np.array(asked.scene.initial.omega_b)
    if asked.body.pivot and any(asked.scene.loads.gravity_a) and any(asked.body.r_oc_b):
        return _growth_above_pivot(asked, moments, int(np.argmax(np.abs(arm))), rates)
    if int(np.argmax(np.abs(rates))) != 1 or asked.body.axis_without_inertia is not None:
        return 0.0
    low, middle, high = moments
    return float(abs(rates[1]) * math.sqrt((middle - low) * (high - middle) / (low * high)))


def _growth_above_pivot(asked: Question, moments: Array, own: int, rates: Array) -> float:
    """Return the growth rate, 1/s, above a pivot; own: the principal axis nearest to the centre of mass."""
    body, up = asked.body, -np.array(asked.scene.loads.gravity_a)
    if float(np.dot(interpreted(rotate)(asked.scene.initial.quaternion, body.r_oc_b), up)) <= 0.0:
        return 0.0
    least = float(np.min(np.delete(moments, own)))
    spin = float(moments[own] * rates[own])
    weight = body.mass * float(np.linalg.norm(up)) * float(np.linalg.norm(np.array(body.r_oc_b)))
    square = 4.0 * least * weight - spin * spin
    return math.sqrt(square) / (2.0 * least) if square > 0.0 else 0.0


# What is not modelled


def what_is_left_out(asked: Question, steady: bool) -> tuple[str, ...]:
    """Return reasons: what is not modelled, or in closed form; steady: whether force_b keeps its direction in a."""
    lines = [_translation(asked, steady)]
    if not asked.rotation:
        lines.append("rotation: 0 of 7 states, as no output shows it and no force depends on it")
    elif not asked.attitude:
        lines.append("attitude: 0 of 4 states, as no output shows it and no load depends on it")
    return tuple(lines)


def _translation(asked: Question, steady: bool) -> str:
    scene, body = asked.scene, asked.body
    loads, initial = scene.loads, scene.initial
    if not asked.translation:
        return "translation: 0 of 6 states, as " + ("the pivot holds o" if body.pivot else "no output shows it")
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
