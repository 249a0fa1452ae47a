"""The step or tolerance that meets a scene's accuracy, found by pilot runs of the candidate methods."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rbfmu.measures import largest_error
from rbfmu.models import Plan
from rbfmu.scene import Scene, SceneError
from rbfmu.unit import filled_buffer, initialize
from rbfmu_kernels.kicked_top import is_symmetric_top, resonant_step
from rbfmu_kernels.layout import FINE

PILOT_POINTS = 20_000
"""Communication steps up to which a pilot run has the scene's own; a longer run takes several at once."""
TIGHTEST = 1e-15
"""The smallest tolerance that double precision serves."""
MARGIN = 1e3
"""How much tighter the pilot's reference run is."""
COST = {0: 345.0, 2: 100.0, 4: 453.0, 6: 801.0}
"""ns a substep of DOP853 (0) and of kicks by order, measured in one run on a heavy top; only their ratios count."""

ROUND_OFF = 2.0**-52

Motion = dict[str, Any]


def cheapest_fit(scene: Scene, general: Plan) -> Plan:
    """DOP853, or kicks where the body is a symmetric top and they are cheaper, fitted to the accuracy by pilot runs."""
    accuracy, ports = scene.run.accuracy, scene.inputs.ports

    def tolerance(value: float) -> Plan:
        return replace(general, tolerance=min(max(value, TIGHTEST), accuracy))

    margin, found = 1.0, False
    while not found and (margin == 1.0 or accuracy / margin > TIGHTEST):
        margin *= MARGIN
        references = _references(scene, tolerance(accuracy / margin))
        best = _fit(scene, references, tolerance, accuracy / 8.0, 1.0)
        # the reference's own error, if it grows over the run as the judged one's does
        found = best.error <= accuracy / 3.0 and best.error <= 0.1 * margin * best.plan.tolerance
    for order in (2, 4, 6) if _is_top(scene) else ():
        best = _fit(scene, references, *_kicks(scene, general, order), best)
    if best.error > accuracy / 3.0:
        expected = f"expected one that this scene can meet; the methods here reach {3.0 * best.error:.1e} here"
        raise SceneError(f"run.accuracy = {accuracy!r}: {expected}", scene.name)
    how = (
        f"at tolerance {best.plan.tolerance:.1e}" if best.plan.order == 0 else f"in steps of {best.plan.substep:.3g} s"
    )
    judge = f"one {margin:g} times tighter in half the steps"
    reason = f"{best.plan.method} {how}: error {best.error:.1e} in a pilot run, against {judge}"
    if not ports:
        return replace(best.plan, reasons=(reason,))
    share = max(min(best.plan.tolerance, accuracy * scene.run.step / (scene.run.stop - scene.run.start)), TIGHTEST)
    held = f"ports: each substep's estimated error at most {share:.1e}, a communication step's share of the accuracy"
    return replace(best.plan, tolerance=share, reasons=(reason, held))


def _is_top(scene: Scene) -> bool:
    body = scene.body
    assert body is not None
    steady = not scene.inputs.ports and not scene.inputs.parameters and not any(scene.loads.damping_b)
    return steady and bool(is_symmetric_top(body.M))


def _kicks(scene: Scene, general: Plan, order: int) -> tuple[Callable[[float], Plan], float, float]:
    """The plan of a step size, the size to begin with, and the exponent of the error's law."""
    body, run = scene.body, scene.run
    assert body is not None
    turn = 2.0 * math.pi / max(math.hypot(*scene.initial.omega_b), 1e-300)  # where a torque fixed in the body resonates
    longest = min(0.45 * resonant_step(body.M, scene.initial.omega_b), 0.45 * turn, run.stop - run.start)

    def kicks(substep: float) -> Plan:
        method = f"kicks of order {order}"
        return replace(general, model="symmetric top", method=method, tolerance=0.0, order=order,
                       substep=min(substep, longest))  # fmt: skip

    return kicks, longest, 1.0 / order


@dataclass(frozen=True)
class _Fit:
    plan: Plan
    error: float
    cost: float


def _fit(
    scene: Scene,
    references: list[Motion],
    plan_of: Callable[[float], Plan],
    value: float,
    exponent: float,
    best: "_Fit | None" = None,
) -> _Fit:
    """The cheapest plan of a family with an error of at most a third of the accuracy, if cheaper than `best`.

    Where nothing is that good, the one with the smallest error.
    """
    accuracy, error, run = scene.run.accuracy, math.inf, scene.run
    for _ in range(8):
        trial, last = plan_of(value), error
        if (
            best
            and best.error <= accuracy / 3.0
            and COST[trial.order] * (run.stop - run.start) > best.cost * trial.substep
        ):
            break  # dearer than what was found
        motion, substeps = _pilot(scene, trial)
        error = max(largest_error(motion, reference) for reference in references)
        fit = _Fit(trial, error, COST[trial.order] * substeps)
        if best is None or _better(fit, best, accuracy / 3.0):
            best = fit
        stuck = error == last  # each communication step is one substep, or the step is as short as may be
        if accuracy / 12.0 <= error <= accuracy / 3.0 or (stuck and error <= accuracy / 3.0):
            break
        ratio = accuracy / (6.0 * error) if 0.0 < error < math.inf else (1e3 if error == 0.0 else 1e-3)
        ratio = min(ratio, 0.03) if stuck else ratio
        value *= min(max(ratio**exponent, 1e-3), 1e3)
    assert best
    return best


def _better(a: _Fit, b: _Fit, bound: float) -> bool:
    if a.error <= bound and b.error <= bound:
        return a.cost < b.cost
    return a.error < b.error


def _references(scene: Scene, tight: Plan) -> list[Motion]:
    """What a pilot run is judged by: runs of half steps that start a round-off away, as a chaotic motion magnifies it.

    To either side where round-off is what limits them: whatever a run's own luck, it is far from one of the two.
    """
    sides = (1.0, -1.0) if tight.tolerance <= 10.0 * TIGHTEST else (1.0,)
    return [_pilot(scene, tight, side)[0] for side in sides]


def _pilot(scene: Scene, trial: Plan, side: float = 0.0) -> tuple[Motion, float]:
    """The motion on the scene's grid (every so many points of a long one), ports at zero, and the substeps it took.

    side: where not 0, the start is shaken and each communication step cut in two, so that a reference shares neither
    steps nor round-off with what it judges.  NaN from where the motion ends early.
    """
    unit, run, z = trial.unit, scene.run, filled_buffer(scene, trial)
    parts = 2 if side else 1
    z[unit.BLOCKS["unwanted"]] = 0.0
    _shake(unit, z, side * ROUND_OFF)
    initialize(scene, unit, z)
    steps = math.ceil((run.stop - run.start) / run.step * (1.0 - 1e-9))
    stride = math.ceil(steps / PILOT_POINTS)
    blocks = {n: z[unit.BLOCKS[n]] for n in ("quaternion", "omega_b", "position", "velocity")}
    motion = {n: np.full((math.ceil(steps / stride) + 1, len(b)), np.nan) for n, b in blocks.items()}
    substeps = 0.0
    for k in range(len(motion["quaternion"])):
        h = min(stride, steps - (k - 1) * stride) * run.step
        if k and any(unit.step(z, h / parts) != FINE for _ in range(parts)):
            break
        substeps += math.ceil(h / trial.substep * (1.0 - 1e-9)) if k else 0.0
        for n, block in blocks.items():
            motion[n][k] = block
    return motion, float(z[unit.BLOCKS["substeps"]][0]) if "substeps" in unit.BLOCKS else substeps


def _shake(unit: Any, z: Any, part: float) -> None:
    """Inertia, attitude and rates at the start changed by `part` of themselves."""
    z[unit.BLOCKS["inertia"]] *= 1.0 + part * np.array([1.0, -1.0, 1.0, 1.0, -1.0, 1.0])
    z[unit.BLOCKS["quaternion_0"]] += part * np.array([0.0, 1.0, -1.0, 1.0])
    z[unit.BLOCKS["omega_b_0"]] *= 1.0 + part * np.array([1.0, -1.0, 1.0])
