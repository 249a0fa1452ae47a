"""The plan of an ensemble: one model and method that hold for every member.

The parameters that vary are listed, as if an importer could change them, so that only models are chosen that are valid
for all their values. Order and tolerance come from pilot members: some are drawn as members are, some lie as far out as
the farthest member. Series are fitted to all pilots together, and must suit the centre of what varies. With other
models, each pilot has its own plan; the largest model with the tightest setting is used for all members, and its error
is measured in every pilot.
"""

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from functools import lru_cache, partial
from itertools import islice
from typing import Any

import numpy as np

from rbfmu.ensembles import draws, fitting, members, variables
from rbfmu.models import question, registry
from rbfmu.planning import closed_forms, methods, select
from rbfmu.planning.fitting import held_over_a_run
from rbfmu.planning.judge import Judge, magnified_round_off, what_is_reached
from rbfmu.runs.plan import Plan
from rbfmu.scene.ensemble import SOBOL
from rbfmu.scene.scene import Scene, SceneError, faults_of, warn
from rbfmu.scene.variations import INERTIA, SHAPE
from rbfmu.simulation import SimulationError, run_of
from rbfmu.types import Array

USUAL, FAR, OF_SERIES = 3, 5, 4
"""USUAL: the number of pilots that are drawn as members are. FAR: the number of pilots beyond nearly all members.
OF_SERIES: the number of pilots to which series are fitted; scouts add to these.

For three bodies with a port, at three seeds each, a member's own growth requires less than `MARGIN` times the least
tolerance of these eight pilots in 1 of 80 cases; of one usual pilot alone in 1 of 12, of three in 1 of 30, of five far
ones in 1 of 40. With six usual and ten far pilots it is 1 of 90.
"""
APART = 1 << 32
"""The number of the attempt (see `draws.at_random`) by which pilots are drawn; no member has it."""
FEW_POINTS = 8
"""The number of points in time at which two runs that differ in one key are compared."""
BEYOND = 3.0
"""The distance of far pilots from the centre, in normal scores, less the usual distance sqrt(n) of n normal scores.

The distance of n normal scores has the chi distribution, whose mean is close to sqrt(n) and whose standard deviation is
about 1/sqrt(2) for any n. So 3 is more than four standard deviations, which one member of some 1e4 to 1e5 exceeds.
"""
PARTS = np.outer(0.7 ** np.arange(8), (1.0, -1.0)).ravel()
"""Parts of the distance at which a far pilot is tried, on both sides of the centre, until one is a valid scene."""
MARGIN = 0.3
"""The factor on the pilots' least tolerance, as members' errors scatter about those of eight pilots.

Without it 1 of 13 members of these bodies would require a smaller tolerance, with it 1 of 80 (see `USUAL`).
Series of a body under loads are fitted in another way (`fitting`): with this factor on the least tolerance of the
pilots' own plans, their errors were a thousandth of the accuracy.
"""
MOST_POINTS = 20_000
"""The largest number of communication points whose outputs are interpolated, as each takes 64 bytes in each lane.

With more of them a series that serves many steps costs no more."""
ENOUGH = 0.1
"""The error of a pilot under the common plan, as a part of the accuracy, above which the tolerance is tightened.

It is small because errors of other members may be larger."""


def plan_ensemble(scene: Scene, progress: Callable[[float], Any] | None = None) -> Plan:
    """Choose the model, method and settings for all members.

    progress: a function that is called from time to time with the part of the work that is done, 0 to 1.
    Raises SceneError without an ensemble, and where a pilot cannot meet the accuracy asked.
    """
    found, doubts = _with_doubts(scene, progress)
    warn(scene, doubts)
    return found


def plan_once(scene: Scene) -> Plan:
    """Return the plan of an ensemble. A scene that was planned lately has the same plan and the same warnings again."""
    found, doubts = _kept_with_doubts(scene)
    warn(scene, doubts)
    return found


def _with_doubts(scene: Scene, progress: Callable[[float], Any] | None = None) -> tuple[Plan, list[str]]:
    """Return the plan and its doubts: how members may miss the accuracy, and which varied keys have no effect."""
    tell = progress or (lambda part: None)
    pilots, growth = _pilots(scene), 1.0
    judges = [Judge(question.Question(pilot), most=fitting.POINTS) for pilot in islice(pilots, OF_SERIES)]
    by_series, chosen = _by_series(scene, judges)
    wild = by_series and chosen is None
    if chosen is None:
        judges = [judge if judge.stride == 1 else Judge(judge.asked) for judge in judges]
        judges += [Judge(question.Question(pilot)) for pilot in pilots]
        found = []
        for k, judge in enumerate(judges):
            with faults_of(f"{scene.name}, pilot member {k + 1}"):
                found.append(select.cheapest(judge.asked, judge))
            tell(0.9 * (k + 1) / len(judges))
        for_all = _for_all(found).of_scene(scene)
        if wild:  # the worst members magnify errors far more than pilots: use the tightest tolerance
            for_all = replace(for_all, tolerance=methods.TIGHTEST, interpolated=_may_interpolate(judges[0]))
        chosen, growth = _accurate(for_all, judges)
        if not wild:
            likely = fitting.with_likely_error(scene, chosen, judges[0].names)
            wild = likely.error > scene.run.accuracy
            chosen = chosen if wild else likely
    else:
        with suppress(SceneError):  # a centre that cannot run is no cause to refuse the members
            chosen, wild = _accurate_at_the_centre(scene, chosen)
    tell(1.0)
    doubts = [*_doubts_of_growth(scene, growth, wild)]
    if not scene.inputs.ports:  # a port may supply anything, so that any key may have an effect
        doubts += _doubts_of_no_effect(scene, chosen)
    why = (*_reasons_of_model(judges[0].asked, chosen), *_reasons_of_members(scene, chosen, len(judges), wild))
    return replace(chosen, reasons=why), doubts


_kept_with_doubts = lru_cache(maxsize=8)(_with_doubts)


def _by_series(scene: Scene, judges: list[Judge]) -> tuple[bool, Plan | None]:
    """Return whether series are fitted to the pilots together, and the plan valid for all members, or None.

    If the worst member requires a far tighter tolerance than the pilots, another order may be the cheapest: the fit is
    then repeated with a smaller error of the pilots.
    """
    with faults_of(f"{scene.name}, pilot member 1"):
        if scene.inputs.ports or not select.series_serve_alone(judges[0]):  # pilot runs do not see what ports supply
            return False, None
        asked = judges[0].asked
        general = methods.series_of_all(asked, 0, scene.run.accuracy)
        general = replace(general, pinned=asked.pinned, interpolated=_may_interpolate(judges[0]))
        if scene.run.count == 1:  # no series has to go beyond this one step
            general = replace(general, substep=scene.run.step)
        fitting.follow_in_doubles(judges)
        fit = partial(fitting.fit_of_members, judges, general)
        part = fitting.PART
        fitted, found, scouts = fit(part) or fit(fitting.MOST), None, None
        while fitted:
            if scouts is None or not scouts.serve(fitted):
                scouts = fitting.Scouts(scene, methods.with_cost(asked, fitted), judges[0].names)
            found = fitting.for_the_worst(scouts, fitted)
            if scouts.seconds < fitting.LONGER and (found is None or scouts.are_too_few):
                # a few scouts say little about a heavy tail: take more, with a truth for the tightest tolerance
                tightest = replace(fitted, tolerance=methods.TIGHTEST)
                costed = methods.with_cost(asked, tightest)
                scouts = fitting.Scouts(scene, costed, judges[0].names, fitting.LONGER)
                found = fitting.for_the_worst(scouts, fitted)
            if found is None:
                return True, None
            found = methods.with_cost(asked, cheap := fitting.dearest(judges, found))
            if cheap.cost <= fitting.DEARER * fitted.cost or part < fitting.PART:
                break
            part *= found.tolerance / fitted.tolerance
            fitted = fit(part)
    return found is not None, found


def _accurate_at_the_centre(scene: Scene, found: Plan) -> tuple[Plan, bool]:
    """Return the series with a tolerance that suits the centre of what varies, and whether none is tight enough.

    Ensembles are often centred on a special state, such as one from which a pendulum just reaches the top. Few members
    come so near to it that their errors grow as much as its own, so that pilots and scouts may miss them all.
    """
    samples = members.samples_at(scene, np.full((1, len(members.ensemble_of(scene).varying)), 0.5))
    if members.refusals(scene, samples):
        return found, False
    judge = Judge(question.Question(members.member(scene, samples, 0, _with_all_listed(scene))), most=fitting.POINTS)
    fitting.follow_in_doubles([judge])
    before = 0.0
    for tolerance in (found.tolerance, *methods.ever_tighter(found.tolerance)):
        plan = replace(found, tolerance=tolerance)
        error, substeps = judge.try_out(plan)
        before = before or substeps
        if error <= fitting.WITHIN * scene.run.accuracy:
            return replace(plan, error=max(error, found.error), cost=found.cost * (substeps / before)), False
    return plan, True


def _may_interpolate(judge: Judge) -> bool:
    """Return whether outputs can be interpolated: the path by a force that turns with the body cannot."""
    return not judge.asked.load_shares[1] and judge.scene.run.count <= MOST_POINTS


# Why


def _reasons_of_model(pilot: question.Question, chosen: Plan) -> Iterator[str]:
    """Yield what the model leaves out, and why it is valid, with one pilot's numbers."""
    if chosen.model == registry.PRESCRIBED_RATES.key:
        yield closed_forms.PRESCRIBED
    elif chosen.formulas and chosen.spec.closed_form:
        yield from chosen.reasons
    elif chosen.formulas:
        from rbfmu.planning.formulas import what_formulas_read  # only if needed, as it loads slowly

        yield from what_formulas_read(pilot, chosen)
        yield f"{held_over_a_run(chosen)} in every member"
    else:
        yield from closed_forms.what_is_left_out(pilot, chosen.spec.force_keeps_direction)
        if chosen.spec.closed_form:
            yield from closed_forms.why_exact(pilot, chosen.spec)
        elif chosen.tolerance > 0.0 and not chosen.span:
            served = "the cheapest of those that serve all pilot members"
            yield f"{chosen.method} at tolerance {chosen.tolerance:.1e}: {served}"
        elif chosen.tolerance > 0.0:
            yield f"{held_over_a_run(chosen)} in every member"


def _reasons_of_members(scene: Scene, chosen: Plan, pilots: int, wild: bool) -> Iterator[str]:
    ensemble = members.ensemble_of(scene)
    keys = ", ".join(variation.key for variation in ensemble.vary)
    whatever = f"the model holds whatever {keys} may be"
    yield f"one plan for all {ensemble.runs:,} members; the numbers above are of one, {whatever}"
    if chosen.runs_through and scene.run.count > 1:
        yield "substeps do not end at communication points, whose outputs are interpolated"
    if chosen.model == registry.LOADED_TAYLOR.key and not wild:
        evidence = f"by {pilots} pilot members, as far out as the farthest, and by up to a thousand others"
        likely = f"error at most {chosen.error:.1e} in {fitting.MEMBERS:,} members, with 99 in 100"
        yield f"{likely}, {evidence}; {scene.run.accuracy:g} asked"
    elif chosen.model != registry.PRESCRIBED_RATES.key:
        far = f"as far out as the farthest; {scene.run.accuracy:g} asked"
        yield f"error at most {chosen.error:.1e} in {pilots} pilot members, {far}"
    if ensemble.design == SOBOL and ensemble.runs & (ensemble.runs - 1):
        low = 1 << (ensemble.runs.bit_length() - 1)
        expected = f"{low:,} or {2 * low:,} in place of {ensemble.runs:,}"
        yield f"Sobol's points are balanced where runs is a power of 2: {expected}"


def _doubts_of_growth(scene: Scene, growth: float, wild: bool) -> Iterator[str]:
    """Yield the doubt that members may miss the accuracy; wild: whether no tolerance is tight enough for the worst."""
    if magnified_round_off(growth) > scene.run.accuracy:
        message = f"a pilot member magnifies an error {growth:.1e} times, round-off beyond the accuracy"
        yield f"{message}: members may miss it"
    elif wild:
        yield "nearly equal starts lead apart here: round-off may grow beyond the accuracy in the worst of many members"


def _doubts_of_no_effect(scene: Scene, chosen: Plan) -> Iterator[str]:
    """Yield a doubt for each varied key without effect: a member's outputs are the same with another member's value."""
    samples = members.samples_at(scene, draws.at_random(members.ensemble_of(scene), 0, 2, APART))
    shaped = any(key.startswith(f"{SHAPE}.") for key in samples.applied)
    step = {"run.step": (scene.run.stop - scene.run.start) / FEW_POINTS}
    with suppress(SceneError, SimulationError):  # if the members cannot run, there is no doubt
        own = _outputs_of(members.member(scene, samples, 0, step), chosen)
        for key in samples.applied:  # the inertia of a shape depends on the mass
            swapped = [key, INERTIA] if key == "body.mass" and shaped else [key]
            reverse = {name: samples.applied[name][::-1] for name in swapped}
            other = replace(samples, applied={**samples.applied, **reverse})
            found = _outputs_of(members.member(scene, other, 0, step), chosen)
            moved = any(_differs(own[name].ravel(), found[name].ravel()) for name in own)
            if not moved and (name := _key_of(scene, key)):
                yield f"ensemble.vary: {name} varies without effect on any output"


def _key_of(scene: Scene, key: str) -> str:
    """Return the key in `ensemble.vary` that varies an applied key; "" if no such key can be named."""
    ensemble = members.ensemble_of(scene)
    shape = ensemble.variation_of(SHAPE)
    if key == INERTIA and not ensemble.variation_of(INERTIA):  # the inertia is the shape's
        return SHAPE if shape and any(marginal.varies for marginal in shape.marginals) else ""
    return "" if key.startswith(f"{SHAPE}.") else key


def _differs(a: Array, b: Array) -> bool:
    return len(a) != len(b) or bool(variables.differ(np.stack([a, b])).any())  # an event may happen more often


def _outputs_of(scene: Scene, chosen: Plan) -> dict[str, Array]:
    found = run_of(scene, chosen)
    return {**found.quantities, **{f"events.{name}": times for name, times in found.events.items()}}


# Pilots


def _with_all_listed(scene: Scene) -> dict[str, Any]:
    """Return the scene's change that lists all varying parameters, so that a plan is valid for every value of them."""
    names = dict.fromkeys((*scene.inputs.parameters, *members.ensemble_of(scene).parameters))
    return {"inputs.parameters": [name for name in names if name not in scene.inputs.ports]}


def _pilots(scene: Scene) -> Iterator[Scene]:
    """Yield the scenes of pilots, with the varying parameters listed. Raises SceneError if no sample is valid."""
    message, found = "", 0
    for samples in _pilot_samples(scene):
        bad = members.refusals(scene, samples)
        row = next((row for row in range(len(samples)) if row not in bad), None)
        if row is None:
            message = bad[0]
        else:
            found += 1
            yield members.member(scene, samples, row, _with_all_listed(scene))
    if not found:
        raise SceneError(f"ensemble.vary: expected members that are scenes; of the first, {message}", scene.name)


def _pilot_samples(scene: Scene) -> Iterator[members.Samples]:
    """Yield samples for each pilot: the first row that is a valid scene is the pilot.

    They depend neither on the design nor on the number of runs. Usual and far pilots alternate, as series are fitted to
    the first few.
    """
    ensemble = members.ensemble_of(scene)
    cube = draws.at_random(ensemble, 0, USUAL * len(PARTS) + FAR, APART)
    n = len(ensemble.varying)
    for k in range(max(USUAL, FAR)):
        if k < USUAL:
            yield members.samples_at(scene, cube[k : USUAL * len(PARTS) : USUAL])
        if k < FAR:
            direction = draws.normal_scores(cube[USUAL * len(PARTS) + k])
            far = (np.sqrt(n) + BEYOND) * direction / np.linalg.norm(direction)
            yield members.samples_at(scene, draws.probabilities(np.outer(PARTS, far).ravel()).reshape(-1, n))


# One plan for all


def _for_all(found: list[Plan]) -> Plan:
    """Return the plan with the largest model, and of the plans with it the shortest substep and the least tolerance."""
    order = [*registry.MODELS, registry.FORMULAS.key]
    largest = max(order.index(plan.model) for plan in found)
    same = [plan for plan in found if order.index(plan.model) == largest]
    dearest = max(same, key=lambda plan: plan.cost)
    tolerance = min(plan.tolerance for plan in same)
    if tolerance > 0.0:
        tolerance = max(MARGIN * tolerance, methods.TIGHTEST)
    substep, error = min(plan.substep for plan in same), max(plan.error for plan in same)
    return replace(dearest, tolerance=tolerance, substep=substep, error=error, formulas=None)


def _accurate(found: Plan, judges: list[Judge]) -> tuple[Plan, float]:
    """Return the plan with the pilots' largest error, its tolerance tightened if necessary, and the growth of an error.

    The growth is 1 unless the tolerance is the tightest. Raises SceneError where a pilot cannot meet the accuracy.
    """
    worst, growth = found.error if found.spec.closed_form else 0.0, 1.0
    for judge in judges if found.model != registry.PRESCRIBED_RATES.key else ():
        error, accuracy = _error(judge, found), judge.scene.run.accuracy
        for tolerance in methods.ever_tighter(found.tolerance):
            if error <= ENOUGH * accuracy:
                break
            found = replace(found, tolerance=tolerance)
            error = _error(judge, found)
        if not error <= accuracy:
            expected = f"one that all members can meet; {what_is_reached(error)}"
            raise SceneError(f"run.accuracy = {accuracy!r}: expected {expected}", f"{judge.scene.name}, a pilot member")
        worst = max(worst, error)
        if 0.0 < found.tolerance <= methods.TIGHTEST:
            growth = max(growth, judge.growth())
    return replace(found, error=worst), growth


def _error(judge: Judge, found: Plan) -> float:
    """Return a pilot's error; of a closed form only at some points of a long run, and 0 if the truth takes too long."""
    if not found.spec.closed_form:
        return judge.try_out(found)[0]
    few = judge if judge.scene.run.count <= fitting.POINTS else Judge(judge.asked, most=fitting.POINTS)
    return few.error_if_soon(found)
