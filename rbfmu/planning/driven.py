"""The plan of a run whose inputs are known: its error and cost under these, and a tighter plan where they need it."""

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from rbfmu.models.integrated import LOADED_TAYLOR, PRESCRIBED_RATES
from rbfmu.planning import reasons as say
from rbfmu.planning.costs import stated
from rbfmu.planning.judge import MAX_SUBSTEPS, least_sizes, refuse_unfinished, watched
from rbfmu.planning.methods import TIGHTEST, likely_order, load_shares, series, series_cost, work_of
from rbfmu.runs.drive import Drive, drive_of
from rbfmu.runs.errors import largest_error
from rbfmu.runs.input_tables import InputTables
from rbfmu.runs.plan import Plan
from rbfmu.runs.trajectory import record_driven
from rbfmu.scene.scene import Scene, SceneError
from rbfmu_kernels.compile.said import PATIENCE, said_after
from rbfmu_kernels.integrators.taylor_coefficients import MAX_ORDER

MAX_TRIED = 1e7
"""The number of substeps of a trial."""
ORDERS = (MAX_ORDER - 4, MAX_ORDER)
"""The orders of the two series, in half pieces and at the least tolerance, by which the others are judged."""


def plan_for_inputs(scene: Scene, tables: InputTables, interpolate: str, found: Plan) -> Plan:
    """Return a scene's plan with its error and cost under the inputs given, or a tighter one where it misses.

    Raises SceneError where none meets the scene's accuracy.
    """
    if found.model == PRESCRIBED_RATES.key:
        return without_loops(scene, found)
    with said_after(PATIENCE, lambda: f"rbfmu: planning {scene.name} takes long: methods are tried under its inputs"):
        return _planned(scene, tables, interpolate, found)


def _planned(scene: Scene, tables: InputTables, interpolate: str, found: Plan) -> Plan:
    names = watched(scene)
    with_rates = tuple(dict.fromkeys((*names, "omega_b")))  # by which rest is judged
    drive, halves = drive_of(scene, tables, interpolate), drive_of(scene, tables, interpolate, parts=2)
    tight = [Plan(LOADED_TAYLOR.key, "", 0, tolerance=1e-18, order=order) for order in ORDERS]
    (truth, taken), (other, more) = (record_driven(scene, plan, halves, with_rates, MAX_SUBSTEPS) for plan in tight)
    for motion, substeps in ((truth, taken), (other, more)):
        refuse_unfinished(scene, np.diff(halves.time).tolist(), motion["omega_b"], substeps)
    floors = least_sizes(scene, truth)
    doubt = largest_error(other, truth, names, floors)
    best = math.inf
    for plan in (found, *_tighter(scene, found)):
        motion, substeps = record_driven(scene, plan, drive, names, MAX_TRIED)
        error = largest_error(motion, truth, names, floors) + doubt
        if error <= scene.run.accuracy:
            return _stated(scene, found, plan, error, substeps, drive)
        best = min(best, error)
    expected = f"one that these inputs allow; the methods here reach {best:.1e} with them"
    raise SceneError(f"run.accuracy = {scene.run.accuracy!r}: expected {expected}", scene.name)


def without_loops(scene: Scene, found: Plan) -> Plan:
    """Return a plan without what it says of loops closed through inputs: inputs that are known close none."""
    of_loops = say.what_inputs_cost(scene, found)
    return replace(found, reasons=tuple(reason for reason in found.reasons if reason not in of_loops))


def _tighter(scene: Scene, found: Plan) -> Iterator[Plan]:
    """Yield series of ever smaller tolerance, for the whole run."""
    general = replace(found, model=LOADED_TAYLOR.key, tolerance=scene.run.accuracy, substep=math.inf, order=0)
    span = scene.run.stop - scene.run.start
    tolerance = found.tolerance if found.model == LOADED_TAYLOR.key else scene.run.accuracy
    while tolerance > TIGHTEST:
        tolerance = max(0.1 * tolerance, TIGHTEST)
        order = max(found.order, likely_order(tolerance))
        yield replace(series(general, order, load_shares(scene)).plan_of(tolerance), span=span)


def _stated(scene: Scene, found: Plan, plan: Plan, error: float, substeps: float, drive: Drive) -> Plan:
    steps, reasons = len(drive.time) - 1, without_loops(scene, found).reasons
    cost = found.cost * len(drive.lengths) / steps
    if plan.model == LOADED_TAYLOR.key:
        ns = series_cost(plan.order, load_shares(scene)) * work_of(substeps, float(len(drive.lengths)))
        cost = stated(scene, replace(plan, cost=ns / steps)).cost
    if plan is not found:
        reasons = (*reasons, say.tighter_than_the_fmu(found.method, plan.method, plan.tolerance))
    return replace(plan, error=error, cost=cost, reasons=(*reasons, say.under_inputs(error)))
