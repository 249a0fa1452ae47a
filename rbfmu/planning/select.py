"""From a scene to a plan: the smallest model that serves it, and why."""

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from rbfmu.planning import reasons as say
from rbfmu.planning.candidates import (
    CLOSED,
    GROWING,
    Needs,
    accepts,
    closed_forms,
    rests_on,
    turning_axis,
    varying_parameters,
)
from rbfmu.planning.costs import stated
from rbfmu.planning.fitting import cheapest_fit, swinging_fit
from rbfmu.planning.judge import Judge, round_off, watched
from rbfmu.planning.promises import conditioning_error, prescribed_rates_error
from rbfmu.planning.quadrature import cheapest_quadrature
from rbfmu.runs.errors import largest_error
from rbfmu.runs.models import Plan
from rbfmu.runs.time_grid import thinned_steps
from rbfmu.runs.trajectory import Motion, record_trajectory, start_run
from rbfmu.scene.scene import PARAMETERS as SCENE_PARAMETERS
from rbfmu.scene.scene import Scene, SceneError
from rbfmu_kernels.integrators.splitting import is_symmetric_top
from rbfmu_kernels.quantities import OUTPUTS

EXACT, ROUND_OFF = 1e-14, 2.0**-52
"""The accuracy that closed forms keep, and what a step of others loses at least."""
SWING, PUSHED = "one swinging axis", "torque-free body, pushed"


class Rung(NamedTuple):
    """A model's method, and the numbers that it keeps of the rotation or of the rates alone."""

    method: str = ""
    states: int = 7
    rate_states: int = 3


RUNGS = {
    "no rotation": Rung("closed form", 0, 0),
    "constant rate": Rung("closed form", 4, 0),
    "angular momentum": Rung("closed form", 3, 3),
    "one axis": Rung("closed form", 2, 1),
    "undamped pendulum": Rung("elliptic functions", 2, 2),
    SWING: Rung("", 2, 2),
    "prescribed rates": Rung("exact rotation", 4, 4),
    "torque-free symmetric body": Rung("elementary functions"),
    "symmetric body spun up": Rung("closed form", 7, 3),
    "torque-free body": Rung("elliptic functions"),
    PUSHED: Rung(),
    "symmetric top": Rung("", 7, 7),
    "body under loads": Rung("", 7, 7),
    "body under loads, by series": Rung(),
}
OF_ONE_ANGLE = ("one axis", "symmetric body spun up")
"""Whose angle is a double, with round-off of its own size; the others drop whole turns."""
TRANSLATION = {row.name for row in OUTPUTS if row.of_origin}
CONSERVED = {row.name for row in OUTPUTS if row.conserved}
DIFFERENCES = {row.name for row in OUTPUTS if row.cancels}
"""Quantities that are sums of terms that may cancel, so that round-off counts for more than in the state."""
DERIVED = 1e-9
"""The accuracy below which they are looked at even where the state is exact."""
SHARE = 0.8
"""Of the accuracy: what a model that leaves something out may be off by, where no closed form judges it."""


def plan(scene: Scene, full: bool = False, progress: Callable[[float], Any] | None = None) -> Plan:
    """Choose model, method and step; full: all degrees of freedom and outputs, integrated.

    progress: is told from time to time which part of the motion that judges plans is known.
    Raises SceneError where the accuracy asked cannot be met.
    """
    if full:
        scene = with_all_outputs(scene)
    found = _planned(scene, full, progress)
    return replace(found, reasons=(*found.reasons, *say.what_inputs_cost(scene, found)))


def _planned(scene: Scene, full: bool, progress: Callable[[float], Any] | None) -> Plan:
    if "omega_b" in scene.inputs.ports:
        return _prescribed(scene)
    needs, judge = Needs.of(scene), Judge(scene, progress)
    if full:
        return _integrated(scene, Needs(True, True, not _has_pivot(scene)), judge, kicks=False)
    exact = closed_forms(scene, needs)
    found = _closed(scene, exact[0], needs, judge) if exact else None
    smaller = _smaller(scene, found, needs, judge)
    if smaller:
        return smaller
    found = found or _swinging(scene, needs, judge) or _pushed(scene, needs, judge) or _integrated(scene, needs, judge)
    return replace(found, reasons=(*_left_out(scene, needs, found.model), *found.reasons))


def _prescribed(scene: Scene) -> Plan:
    rung, error = RUNGS["prescribed rates"], prescribed_rates_error(scene)
    _refuse_below(scene, error)
    return stated(scene, Plan("prescribed rates", rung.method, rung.states, error=error, reasons=(say.PRESCRIBED,)))


def _closed(scene: Scene, model: str, needs: Needs, judge: Judge) -> Plan:
    found, delicate = _of_rung(scene, model, needs), scene.run.accuracy < DERIVED and set(judge.names) & DIFFERENCES
    error = EXACT + (ROUND_OFF * _angle(scene, model) if model in OF_ONE_ANGLE else 0.0)
    error += conditioning_error(scene, model)
    if delicate:
        error = max(error, judge.error_if_soon(found))
        found = replace(found, held=_held(scene) if "alpha_b" in delicate else ())
    _refuse_below(scene, error)
    return replace(found, error=error, reasons=say.why_exact(scene, model, needs.rotation, needs.attitude))


def _refuse_below(scene: Scene, error: float) -> None:
    if scene.run.accuracy < error:
        expected = f"at least {error:.1e}, what double precision keeps"
        raise SceneError(f"run.accuracy = {scene.run.accuracy!r}: expected {expected}", scene.name)


def _angle(scene: Scene, model: str) -> float:
    """The largest that the body may turn by, rad."""
    closed = Plan(model, "", 0)
    motion = record_trajectory(
        closed.unit, start_run(scene, closed, ("omega_b",)), thinned_steps(scene, 100), ("omega_b",)
    )
    return float(np.max(np.linalg.norm(motion["omega_b"], axis=1))) * (scene.run.stop - scene.run.start)


def _of_rung(scene: Scene, model: str, needs: Needs) -> Plan:
    return stated(scene, Plan(model, RUNGS[model].method, _states(model, needs)))


def _left_out(scene: Scene, needs: Needs, model: str) -> tuple[str, ...]:
    steady = model in (*CLOSED, SWING)
    return say.what_is_left_out(scene, needs.attitude, needs.rotation, needs.translation, steady)


def _swinging(scene: Scene, needs: Needs, judge: Judge) -> Plan | None:
    """One angle under forces fixed in space, by the series of least work that meets the accuracy."""
    if rests_on(scene, needs)[SWING] & varying_parameters(scene) or not accepts(scene, SWING):
        return None
    found = swinging_fit(scene, Plan(SWING, "", _states(SWING, needs), tolerance=scene.run.accuracy), judge)
    if found is None:
        return None
    reasons = say.why_swinging(scene, found)
    return stated(scene, replace(found, held=_held(scene), reasons=(*reasons, *found.reasons)))


def _pushed(scene: Scene, needs: Needs, judge: Judge) -> Plan | None:
    """Exact rotation and a quadrature for the path; a symmetric body's may cost more than kicks."""
    varies = rests_on(scene, needs)[PUSHED] & varying_parameters(scene)
    if not any(scene.loads.force_b) or not needs.translation or varies or not accepts(scene, PUSHED):
        return None
    found = cheapest_quadrature(scene, Plan(PUSHED, "", _states(PUSHED, needs), held=_held(scene)), judge)
    assert scene.body is not None
    if found is None:
        return None
    found = stated(scene, found)
    if not is_symmetric_top(scene.body.M):
        return found
    try:
        other = _integrated(scene, needs, judge)
    except SceneError:
        return found
    return found if found.cost < other.cost else other


def _integrated(scene: Scene, needs: Needs, judge: Judge, kicks: bool = True) -> Plan:
    found = cheapest_fit(scene, Plan("body under loads, by series", "", 0, tolerance=scene.run.accuracy), judge, kicks)
    return stated(scene, replace(found, states=_states(found.model, needs), held=_held(scene)))


def _states(model: str, needs: Needs) -> int:
    rotation = RUNGS[model].states if needs.attitude else RUNGS[model].rate_states
    return rotation + (6 if needs.translation else 0)


def _has_pivot(scene: Scene) -> bool:
    return scene.body is not None and scene.body.pivot


def with_all_outputs(scene: Scene) -> Scene:
    """The scene with every quantity asked for."""
    return Scene.from_dict({k: v for k, v in scene.to_dict().items() if k != "outputs"}, scene.name)


# Models that are not exact, but within the accuracy


def _smaller(scene: Scene, found: Plan | None, needs: Needs, judge: Judge) -> Plan | None:
    """The smallest model that stays within the accuracy, if nothing varies that turns it.

    found: the closed form that serves exactly, and then judges; else the motion in double-double arithmetic does.
    """
    names, varying = watched(scene), varying_parameters(scene)
    if (found and found.model == CLOSED[0]) or not needs.rotation or not _may_be_compared(scene, needs):
        return None
    if "force_b" in varying and "acceleration" in names and "quaternion" not in names:
        names = (*names, "quaternion")  # ports are at zero here: what they bring is as wrong as the attitude
    truth = _motion_of(scene, found, judge, names) if found else judge.motion
    bound = (1.0 if found else SHARE) * scene.run.accuracy - EXACT
    for model in _below(found.model if found else ""):
        if _may_be_close(scene, model, truth, names):
            candidate = replace(_of_rung(scene, model, needs), held=_held(scene))
            error = judge.compare(candidate, truth, names, bool(varying & GROWING))
            if error <= bound:
                why = say.why_close(scene, model, found, error, len(truth["omega_b"]) - 1)
                error += found.error if found else 0.0
                return replace(candidate, error=error, reasons=(*_left_out(scene, needs, model), why))
    return None


def _may_be_compared(scene: Scene, needs: Needs) -> bool:
    """Whether nothing varies that the rotation, or the size of what is looked at, depends on: that is not compared."""
    names, varying = set(watched(scene)), varying_parameters(scene)
    rests = rests_on(scene, needs)["one axis"]
    if needs.translation or "acceleration" in names:
        rests = rests | {"r_oc_b"}
        if any(scene.loads.force_b):
            rests = rests | {"mass"}
    if names & {"acceleration", "kinetic_energy"}:
        rests = rests | GROWING
    return not rests & varying


def _motion_of(scene: Scene, found: Plan, judge: Judge, names: tuple[str, ...]) -> Motion:
    """Of a closed form, at the times of the judge's own motion; rates are a measure only of how much changes."""
    names = tuple(dict.fromkeys((*names, "omega_b")))
    z = start_run(scene, replace(found, held=_held(scene)), names)
    return record_trajectory(found.unit, z, judge.cut_steps, names)


def _may_be_close(scene: Scene, model: str, truth: Motion, names: tuple[str, ...]) -> bool:
    """Whether it is worth running a model, judged by the larger one's motion."""
    run, rates = scene.run, truth["omega_b"]
    span = run.stop - run.start
    unstable = say.growth_rate(scene) * span > say.GROWTH
    if model == "no rotation":
        unstable = unstable and not set(names) <= TRANSLATION | CONSERVED
    if unstable:
        return False
    if model == "no rotation":
        names = tuple(n for n in names if n not in (*TRANSLATION, "kinetic_energy"))
        still = {n: truth[n][:1] + 0.0 * truth[n] for n in names}
        return largest_error(still, truth, names, round_off(scene, truth)) <= run.accuracy
    if model not in ("constant rate", "one axis", "undamped pendulum"):
        return True
    axis = turning_axis(scene)
    other = rates[0] if model == "constant rate" else np.outer(rates @ axis, axis)
    change = float(np.max(np.linalg.norm(rates - other, axis=1)))
    fastest = float(np.max(np.linalg.norm(rates, axis=1)))
    if "omega_b" in names and change > run.accuracy * fastest:
        return False
    return 0.01 * change * min(span, 1.0 / fastest if fastest > 0.0 else math.inf) <= run.accuracy


def _below(model: str) -> Iterator[str]:
    for smaller in CLOSED:
        if smaller == model:
            return
        yield smaller


def _held(scene: Scene) -> tuple[str, ...]:
    """Parameters on whose values a pilot run or a comparison rests: all but those listed."""
    return tuple(name for name in SCENE_PARAMETERS if name not in scene.inputs.parameters)
