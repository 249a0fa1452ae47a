"""The plan of an ensemble: one model and method that hold for every member.

The parameters that vary are listed, as where an importer may change them, so that only models are taken that hold for
all values of them. Order and tolerance come from pilot members: some as members are, and some as far out as the
farthest. The tightest tolerance of all is taken, and every pilot's error under it is measured.
"""

import warnings
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from itertools import islice
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rbfmu.ensembles import draws
from rbfmu.ensembles.chunks import MOST_BYTES, Work, run_samples
from rbfmu.ensembles.draws import normal_scores, probabilities
from rbfmu.ensembles.members import Samples, ensemble_of, member, refusals, samples_at
from rbfmu.ensembles.result import differ
from rbfmu.ensembles.variables import Columns
from rbfmu.exceptions import SceneWarning
from rbfmu.models.question import Question
from rbfmu.models.registry import FORMULAS, LOADED_TAYLOR, MODELS, PRESCRIBED_RATES
from rbfmu.planning import plan
from rbfmu.planning import reasons as say
from rbfmu.planning.fitting import REACHED, fit_of_members
from rbfmu.planning.judge import Judge
from rbfmu.planning.methods import TIGHTEST, whole_series, with_cost
from rbfmu.planning.select import series_serve_alone
from rbfmu.runs.motion import FLOORS
from rbfmu.runs.plan import Plan, start_run
from rbfmu.runs.time_grid import communication_steps
from rbfmu.scene.consistency import warn
from rbfmu.scene.ensemble import SOBOL
from rbfmu.scene.scene import Scene, SceneError, faults_of
from rbfmu.scene.variations import SHAPE
from rbfmu.simulation import SimulationError, simulate
from rbfmu_kernels.compile.tiered import interpreted
from rbfmu_kernels.integrators.substeps import ROUND_OFF
from rbfmu_kernels.integrators.taylor_coefficients import MAX_ORDER
from rbfmu_kernels.models.loaded_taylor_lanes import goes_in_lanes
from rbfmu_kernels.quantities import ANGLE, OUTPUT

Array = NDArray[np.float64]
USUAL, FAR, OF_SERIES = 3, 5, 4
"""The numbers of pilots: drawn as members are, and at points beyond nearly all members; and of those that series are
fitted to, which scouts try besides."""
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
SCOUTS, FEWEST, TAIL = 1024, 64, 32
"""The most and the fewest members whose errors tell of those of others, and of how many the tail is taken."""
SCATTER = 1.15
HIGHEST, LEAST_IN_LANES = 20, 10
"""The highest order of series for ensembles, and that below which lanes do not pay for more substeps."""
OF_MEMBERS = 10_000
"""The members whose worst error is estimated: a plan does not depend on the number of runs, which may be extended."""
SECONDS, TIGHTER, TINY = 0.03, 1e-4, 1e-300
"""The time that they may take one by one; the tolerance that they are compared with, over the plan's."""
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
    pilots, growth = _pilots(scene), 1.0
    judges = [Judge(Question(pilot)) for pilot in islice(pilots, OF_SERIES)]
    fitted = _by_series(scene, judges)
    chosen = fitted and _for_the_worst(scene, fitted, judges[0].names)
    if chosen is None:
        judges += [Judge(Question(pilot)) for pilot in pilots]
        found = []
        for k, judge in enumerate(judges):
            with faults_of(f"{scene.name}, pilot member {k + 1}"):
                found.append(plan(judge.scene, judge=judge))
            tell(0.9 * (k + 1) / len(judges))
        chosen, growth = _accurate(_for_all(found).of_scene(scene), judges)
        chosen = _with_likely_error(scene, chosen, judges[0].names)
    tell(1.0)
    reasons = (
        *_of_model(judges[0].asked, chosen),
        *_of_members(scene, chosen, len(judges)),
        *_of_growth(scene, growth, wild=bool(fitted) and chosen.span > 0.0),
    )
    warn(scene, _of_no_effect(scene, chosen), stacklevel=4)
    return replace(chosen, reasons=reasons)


def _by_series(scene: Scene, judges: list[Judge]) -> Plan | None:
    """Return series that are fitted to all pilots together; None where they must be planned for one by one."""
    with faults_of(f"{scene.name}, pilot member 1"):
        if not series_serve_alone(judges[0]):
            return None
        asked = judges[0].asked
        general = replace(whole_series(scene, 0, scene.run.accuracy), pinned=asked.pinned)
        found = fit_of_members(judges, general, _highest_in_lanes(judges, general))
    return found and with_cost(asked, found)


def _highest_in_lanes(judges: list[Judge], general: Plan) -> int:
    """Return the highest order at which members go side by side, or that of members that do at none.

    A higher one may reach over a whole communication step, which members find out one by one.
    """
    serves = interpreted(goes_in_lanes)
    for order in range(HIGHEST, LEAST_IN_LANES - 1, -2):
        series = replace(general, order=order)
        if all(serves(start_run(judge.scene, series), judge.scene.run.step) for judge in judges):
            return order
    return HIGHEST


# Scouts


class _Scouts:
    """Many more members than pilots, whose errors tell of those of all: runs beside a far tighter tolerance.

    Errors of a few pilots say little of the worst of many members, which may come near to where nearly equal starts
    lead apart. Scouts run in lanes, at a cost of some members each.
    """

    def __init__(self, scene: Scene, plan: Plan, names: tuple[str, ...]) -> None:
        self.scene, self.columns = (
            scene.replace({"outputs.quantities": names}),
            Columns(tuple(OUTPUT[n] for n in names)),
        )
        steps = communication_steps(scene)
        most = min(int(MOST_BYTES / (8.0 * self.columns.width * (steps + 1))), int(1e9 * SECONDS / (plan.cost * steps)))
        cube = draws.at_random(ensemble_of(scene), 0, max(min(most, SCOUTS), FEWEST), APART + 1)
        self.samples = samples_at(self.scene, cube)
        self.truth = self._run(replace(plan, tolerance=TIGHTER * plan.tolerance, order=min(plan.order + 2, MAX_ORDER)))

    def _run(self, plan: Plan) -> Array:
        return run_samples(Work(self.scene, plan, len(self.samples)), self.samples, ends_alone=False)[0]

    def likely_worst(self, plan: Plan) -> float:
        """Return what the errors of OF_MEMBERS members are likely not to exceed."""
        return likely_worst(_errors(self.columns, self._run(plan), self.truth), OF_MEMBERS)


def _for_the_worst(scene: Scene, found: Plan, names: tuple[str, ...]) -> Plan | None:
    """Return the plan with its likely error, its tolerance such that the worst of all members meets the accuracy.

    None where none is likely to.
    """
    scouts, loosest = _Scouts(scene, found, names), found.tolerance
    while found.tolerance >= max(1e-3 * loosest, TIGHTEST):
        worst = scouts.likely_worst(found)
        if worst <= REACHED * scene.run.accuracy:
            return replace(found, error=max(found.error, worst))
        found = replace(found, tolerance=found.tolerance * max(0.3 * scene.run.accuracy / worst, 1e-3))
    return None


def _with_likely_error(scene: Scene, found: Plan, names: tuple[str, ...]) -> Plan:
    """Return the plan of series with the error that the worst of all members is likely to have."""
    if found.model != LOADED_TAYLOR.key:
        return found
    return replace(found, error=max(found.error, _Scouts(scene, found, names).likely_worst(found)))


def likely_worst(errors: Array, runs: int) -> float:
    """Return what the largest of so many more errors will not exceed in 99 of 100 ensembles.

    The tail of errors is taken for a power law, whose exponent is Hill's estimate from the largest of them (B. M. Hill,
    Annals of Statistics 3, 1975; the quantile beyond all data is I. Weissman's, J. Am. Stat. Assoc. 73, 1978): errors
    grow as 1/d where members come to a distance d from a separatrix, and this is the heaviest tail met. The estimate
    scatters by 1/sqrt(TAIL), and is taken so much larger that 99 of 100 hold.
    """
    known = np.sort(errors[np.isfinite(errors)])[::-1]
    if not len(known) or known[0] == 0.0:
        return 0.0
    k = max(1, min(TAIL, len(known) - 1))
    base = max(known[min(k, len(known) - 1)], 1e-3 * known[0])
    exponent = SCATTER * float(np.mean(np.log(np.maximum(known[:k], base) / base)))
    return float(max(known[0], base * (100.0 * k * runs / len(known)) ** exponent))


def _errors(columns: Columns, rows: Array, truth: Array) -> Array:
    """Return each member's largest error, as an accuracy counts it; NaN of those that fail."""
    found, true = columns.split(rows), columns.split(truth)
    worst = np.zeros(len(rows))
    for name in found:
        a, b = found[name].reshape(*rows.shape[:2], -1), true[name].reshape(*rows.shape[:2], -1)
        if OUTPUT[name].error == ANGLE:
            chord = np.minimum(np.linalg.norm(a - b, axis=2), np.linalg.norm(a + b, axis=2))
            apart = 4.0 * np.arcsin(np.minimum(0.5 * chord, 1.0)).max(
                axis=1
            )  # of the turn, whose half is on q's sphere
        else:
            size = np.maximum(np.linalg.norm(b, axis=2).max(axis=1), FLOORS.get(name, TINY))
            apart = np.linalg.norm(a - b, axis=2).max(axis=1) / size
        worst = np.maximum(worst, apart)
    return worst


# Why


def _of_model(pilot: Question, chosen: Plan) -> Iterator[str]:
    """Yield what the model leaves out, and why it is right, with a pilot's numbers."""
    if chosen.model == PRESCRIBED_RATES.key:
        yield say.PRESCRIBED
        return
    if chosen.formulas:
        from rbfmu.planning.formulas import what_formulas_read  # what has none starts sooner

        yield from what_formulas_read(pilot, chosen)
        yield f"{chosen.method}: estimated errors of a run add up to at most {chosen.tolerance:.1e} in every member"
        return
    yield from say.what_is_left_out(pilot, chosen.spec.force_keeps_direction)
    if chosen.spec.closed_form:
        yield from say.why_exact(pilot, chosen.spec)
    elif chosen.tolerance > 0.0 and not chosen.span:
        yield f"{chosen.method} at tolerance {chosen.tolerance:.1e}: the cheapest of those that serve all pilot members"
    elif chosen.tolerance > 0.0:
        yield f"{chosen.method}: estimated errors of a run add up to at most {chosen.tolerance:.1e} in every member"


def _of_members(scene: Scene, chosen: Plan, pilots: int) -> Iterator[str]:
    ensemble = ensemble_of(scene)
    keys = ", ".join(variation.key for variation in ensemble.vary)
    whatever = f"the model holds whatever {keys} may be"
    yield f"one plan for all {ensemble.runs} members; the numbers above are of one, {whatever}"
    if chosen.model == LOADED_TAYLOR.key:
        said = f"by {pilots} pilot members, as far out as the farthest, and by up to a thousand others"
        likely = f"error at most {chosen.error:.1e} in {OF_MEMBERS:,} members, with 99 in 100"
        yield f"{likely}, {said}; {scene.run.accuracy:g} asked"
    elif chosen.model != PRESCRIBED_RATES.key:
        far = f"as far out as the farthest; {scene.run.accuracy:g} asked"
        yield f"error at most {chosen.error:.1e} in {pilots} pilot members, {far}"
    if ensemble.design == SOBOL and ensemble.runs & (ensemble.runs - 1):
        low = 1 << (ensemble.runs.bit_length() - 1)
        yield f"Sobol's points are balanced where runs is a power of 2: {low} or {2 * low} in place of {ensemble.runs}"


def _of_growth(scene: Scene, growth: float, wild: bool) -> Iterator[str]:
    """Yield that members may miss the accuracy; wild: whether no tolerance holds for the worst of them."""
    if 4.0 * ROUND_OFF * growth > scene.run.accuracy:
        yield (
            f"a pilot member magnifies an error {growth:.1e} times, round-off beyond the accuracy: members may miss it"
        )
    elif wild:
        yield "nearly equal starts lead apart here: round-off grows beyond the accuracy in the worst members"


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
            yield member(scene, samples, row, _listed(scene))
    if not found:
        raise SceneError(f"ensemble.vary: expected members that are scenes; of the first, {message}", scene.name)


def _pilot_samples(scene: Scene) -> Iterator[Samples]:
    """Yield rows of which the first that is a scene is a pilot; they do not depend on the design and the runs.

    Usual ones and far ones take turns, as series are fitted to the first.
    """
    ensemble = ensemble_of(scene)
    cube = draws.at_random(ensemble, 0, USUAL * len(PARTS) + FAR, APART)
    n = len(ensemble.varying)
    for k in range(max(USUAL, FAR)):
        if k < USUAL:
            yield samples_at(scene, cube[k : USUAL * len(PARTS) : USUAL])
        if k < FAR:
            direction = normal_scores(cube[USUAL * len(PARTS) + k])
            far = (np.sqrt(n) + BEYOND) * direction / np.linalg.norm(direction)
            yield samples_at(scene, probabilities(np.outer(PARTS, far).ravel()).reshape(-1, n))


# One plan for all


def _for_all(found: list[Plan]) -> Plan:
    """Return the plan of the largest model, with the shortest step and the least tolerance of all."""
    order = [*MODELS, FORMULAS.key]
    largest = max(order.index(one.model) for one in found)
    same = [one for one in found if order.index(one.model) == largest]
    dearest = max(same, key=lambda one: one.cost)
    tolerance = min(one.tolerance for one in same)
    if tolerance > 0.0:
        tolerance = max(MARGIN * tolerance, TIGHTEST)
    substep, error = min(one.substep for one in same), max(one.error for one in same)
    return replace(dearest, tolerance=tolerance, substep=substep, error=error, formulas=None)


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
