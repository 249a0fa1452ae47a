"""The plan of an ensemble: one model and method that hold for every member.

The parameters that vary are listed, as where an importer may change them, so that only models are taken that hold for
all values of them. Order and tolerance come from pilot members: some as members are, and some as far out as the
farthest. The tightest tolerance of all is taken, and every pilot's error under it is measured.
"""

import warnings
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rbfmu.ensembles import draws
from rbfmu.ensembles.draws import normal_scores, probabilities
from rbfmu.ensembles.members import Samples, ensemble_of, member, refusals, samples_at
from rbfmu.ensembles.result import differ
from rbfmu.exceptions import SceneWarning
from rbfmu.models.question import Question
from rbfmu.models.registry import MODELS, PRESCRIBED_RATES
from rbfmu.planning import plan
from rbfmu.planning import reasons as say
from rbfmu.planning.judge import Judge
from rbfmu.planning.methods import TIGHTEST
from rbfmu.runs.plan import Plan
from rbfmu.scene.consistency import warn
from rbfmu.scene.ensemble import SOBOL
from rbfmu.scene.scene import Scene, SceneError, faults_of
from rbfmu.scene.variations import SHAPE
from rbfmu.simulation import SimulationError, simulate
from rbfmu_kernels.integrators.substeps import ROUND_OFF

Array = NDArray[np.float64]
USUAL, FAR = 3, 5
"""The numbers of pilots: drawn as members are, and at points beyond nearly all members."""
APART = 1 << 32
"""The attempt by whose numbers pilots are drawn, which no member has."""
FEW_POINTS = 8
"""The number of points in time at which runs are compared that differ in one key."""
BEYOND = 3.0
"""How far these lie from the centre beyond the usual distance, sqrt(n) of n normal scores.

The distance of n normal scores has the chi distribution, whose mean is close to sqrt(n) and whose standard deviation is
about 1/sqrt(2) whatever n: 3 more is beyond four standard deviations, which one member of some 1e4 to 1e5 exceeds.
"""
PARTS = np.outer(0.7 ** np.arange(8), (1.0, -1.0)).ravel()
"""Parts of the distance at which a far pilot is tried, to both sides, until it is a scene."""
MARGIN = 0.3
"""The part of the pilots' least tolerance that is taken: errors of members scatter about those of eight pilots."""
ENOUGH = 0.1
"""The part of the accuracy up to which a pilot's error is left as it is."""


def plan_ensemble(scene: Scene, progress: Callable[[float], Any] | None = None) -> Plan:
    """Choose model, method and step for all members.

    progress: a function that is told from time to time which part of the work is done.
    Raises SceneError without an ensemble, and where a pilot cannot meet the accuracy asked.
    """
    tell = progress or (lambda part: None)
    judges, found = [Judge(Question(pilot)) for pilot in _pilots(scene)], []
    for k, judge in enumerate(judges):
        with faults_of(f"{scene.name}, pilot member {k + 1}"):
            found.append(plan(judge.scene, judge=judge))
        tell(0.9 * (k + 1) / len(judges))
    chosen, growth = _accurate(_for_all(found), judges)
    tell(1.0)
    pilots = _of_members(scene, chosen, len(judges))
    reasons = (*_of_model(judges[0].asked, chosen), *pilots, *_of_growth(scene, growth))
    warn(scene, _of_no_effect(scene, chosen), stacklevel=4)
    return replace(chosen, reasons=reasons)


# Why


def _of_model(pilot: Question, chosen: Plan) -> Iterator[str]:
    """Yield what the model leaves out, and why it is right, with a pilot's numbers."""
    if chosen.model == PRESCRIBED_RATES.key:
        yield say.PRESCRIBED
        return
    yield from say.what_is_left_out(pilot, chosen.spec.force_keeps_direction)
    if chosen.spec.closed_form:
        yield from say.why_exact(pilot, chosen.spec)
    elif chosen.tolerance > 0.0:
        yield f"{chosen.method}: estimated errors of a run add up to at most {chosen.tolerance:.1e} in every member"


def _of_members(scene: Scene, chosen: Plan, pilots: int) -> Iterator[str]:
    ensemble = ensemble_of(scene)
    keys = ", ".join(variation.key for variation in ensemble.vary)
    whatever = f"the model holds whatever {keys} may be"
    yield f"one plan for all {ensemble.runs} members; the numbers above are of one, {whatever}"
    if chosen.model != PRESCRIBED_RATES.key:
        far = f"as far out as the farthest; {scene.run.accuracy:g} asked"
        yield f"error at most {chosen.error:.1e} in {pilots} pilot members, {far}"
    if ensemble.design == SOBOL and ensemble.runs & (ensemble.runs - 1):
        low = 1 << (ensemble.runs.bit_length() - 1)
        yield f"Sobol's points are balanced where runs is a power of 2: {low} or {2 * low} in place of {ensemble.runs}"


def _of_growth(scene: Scene, growth: float) -> Iterator[str]:
    if 4.0 * ROUND_OFF * growth > scene.run.accuracy:
        yield (
            f"a pilot member magnifies an error {growth:.1e} times, round-off beyond the accuracy: members may miss it"
        )


def _of_no_effect(scene: Scene, chosen: Plan) -> Iterator[str]:
    """Yield which keys do nothing: those that a member has of another one, while its outputs stay as they are."""
    samples = samples_at(scene, draws.at_random(ensemble_of(scene), 0, 2, APART))
    step = {"run.step": (scene.run.stop - scene.run.start) / FEW_POINTS}
    with suppress(SceneError, SimulationError):  # of no member that can be tried nothing is said
        own = _quietly(member(scene, samples, 0).replace(step), chosen)
        for key, values in samples.applied.items():
            other = replace(samples, applied={**samples.applied, key: values[::-1]})
            found = _quietly(member(scene, other, 0).replace(step), chosen)
            if not key.startswith(f"{SHAPE}.") and not any(
                differ(np.stack([own[name].ravel(), found[name].ravel()])).any() for name in own
            ):
                yield f"ensemble.vary: {key} varies without effect on any output"


def _quietly(scene: Scene, chosen: Plan) -> dict[str, Array]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SceneWarning)  # of steps that are not the scene's
        return simulate(scene, planned=chosen).quantities


# Pilots


def _listed(scene: Scene) -> dict[str, Any]:
    """Return the change of the scene that lists what varies, so that a plan holds for every value of it."""
    names = dict.fromkeys((*scene.inputs.parameters, *ensemble_of(scene).parameters))
    return {"inputs.parameters": [name for name in names if name not in scene.inputs.ports]}


def _pilots(scene: Scene) -> Iterator[Scene]:
    """Yield scenes of members, with what varies listed. Raises SceneError where no member is a scene."""
    message, found = "", 0
    for samples in _pilot_samples(scene):
        bad = refusals(scene, samples)
        row = next((row for row in range(len(samples)) if row not in bad), None)
        if row is None:
            message = bad[0]
        else:
            found += 1
            yield member(scene, samples, row).replace(_listed(scene))
    if not found:
        raise SceneError(f"ensemble.vary: expected members that are scenes; of the first, {message}", scene.name)


def _pilot_samples(scene: Scene) -> Iterator[Samples]:
    """Yield rows of which the first that is a scene is a pilot; they do not depend on the design and the runs."""
    ensemble = ensemble_of(scene)
    cube = draws.at_random(ensemble, 0, USUAL * len(PARTS) + FAR, APART)
    for k in range(USUAL):
        yield samples_at(scene, cube[k : USUAL * len(PARTS) : USUAL])
    n = len(ensemble.varying)
    for point in cube[-FAR:]:
        direction = normal_scores(point)
        far = (np.sqrt(n) + BEYOND) * direction / np.linalg.norm(direction)
        yield samples_at(scene, probabilities(np.outer(PARTS, far).ravel()).reshape(-1, n))


# One plan for all


def _for_all(found: list[Plan]) -> Plan:
    """Return the plan of the largest model, with the shortest step and the least tolerance of all."""
    order = list(MODELS)
    largest = max(order.index(one.model) for one in found)
    same = [one for one in found if order.index(one.model) == largest]
    dearest = max(same, key=lambda one: one.cost)
    tolerance = min(one.tolerance for one in same)
    if tolerance > 0.0:
        tolerance = max(MARGIN * tolerance, TIGHTEST)
    substep, error = min(one.substep for one in same), max(one.error for one in same)
    return replace(dearest, tolerance=tolerance, substep=substep, error=error)


def _accurate(found: Plan, judges: list[Judge]) -> tuple[Plan, float]:
    """Return the plan with the pilots' largest error, tightened where it must be, and how much an error grows."""
    worst, growth = found.error if found.spec.closed_form else 0.0, 1.0
    for judge in judges if found.model != PRESCRIBED_RATES.key else ():
        error, accuracy = _error(judge, found), judge.scene.run.accuracy
        while error > ENOUGH * accuracy and found.tolerance > TIGHTEST:
            found = replace(found, tolerance=max(0.1 * found.tolerance, TIGHTEST))
            error = _error(judge, found)
        if not error <= accuracy:
            expected = f"one that all members can meet; the methods here reach {error:.1e}"
            raise SceneError(f"run.accuracy = {accuracy!r}: expected {expected}", f"{judge.scene.name}, a pilot member")
        worst = max(worst, error)
        if 0.0 < found.tolerance <= TIGHTEST:
            growth = max(growth, judge.growth())
    return replace(found, error=worst), growth


def _error(judge: Judge, found: Plan) -> float:
    """Return a pilot's error; of a closed form only where that takes no more than seconds."""
    return judge.error_if_soon(found) if found.spec.closed_form else judge.try_out(found)[0]
