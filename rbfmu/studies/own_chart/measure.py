"""Measure a scene of one's own: all methods that suit it, in turns."""

import math
from collections.abc import Iterator

from rbfmu.planning.select import plan
from rbfmu.scene.scene import Scene
from rbfmu.studies.own_chart.case import FLOOR, OwnCase, own_case
from rbfmu.studies.own_chart.contestants import Ladder, own_methods, too_small, why_not
from rbfmu.studies.own_chart.result import Chart, End, Row
from rbfmu.studies.work_precision.collection import (
    QUICK_METHODS,
    Collection,
    Extent,
    Progress,
    collect,
    machine,
)
from rbfmu.studies.work_precision.drawing import group_of, kind_of
from rbfmu.studies.work_precision.methods import Method
from rbfmu.studies.work_precision.peers import absent, peers

LONGEST, REPEATS, SHORTEST = 0.1, 9, 1e-3
"""The processor time, s, of the longest run; how often each is timed; the least time for which each is."""
QUICK_LONGEST = 0.02
"""The processor time, s, of the longest run of a quick chart."""


def measured(scene: Scene, quick: bool, progress: Progress) -> Chart:
    """Return the chart of a scene."""
    progress(0, 1, f"{scene.name}: the true motion")
    case = own_case(scene)
    planned = plan(case.scene)
    methods = own_methods(case, peers()[0])
    if quick:
        methods = [m for m in methods if m.name in QUICK_METHODS]
    found = collect(_extent(case, methods, quick), progress)
    smaller = too_small(case, planned)
    ladder = next(m for m in methods if isinstance(m, Ladder))
    return Chart(
        scene.name,
        planned.model,
        scene.run.accuracy,
        case.span,
        scene.run.stop - scene.run.start,
        case.outputs,
        tuple(scene.inputs.ports),
        tuple(_rows(found)),
        tuple(End(kind_of(e.method, e.family), e.method, e.error, e.why) for e in found.endings),
        tuple(smaller),
        tuple(_not_charted(case, found)),
        ladder.refusal,
        tuple(line for line in machine() if line not in absent()),
    )


def _extent(case: OwnCase, methods: list[Method], quick: bool) -> Extent:
    if quick:
        return Extent((case,), methods, QUICK_LONGEST, 2, 2e-4, True, FLOOR)
    return Extent((case,), methods, LONGEST, REPEATS, SHORTEST, False, FLOOR)


def _rows(found: Collection) -> Iterator[Row]:
    for p in found.points:
        cost = p.seconds / p.simulated
        yield Row(group_of(p), p.method, p.detail, p.family, p.setting, p.value, p.error, cost, p.seconds, p.spread,
                  p.right_hand_sides)  # fmt: skip


def _not_charted(case: OwnCase, found: Collection) -> Iterator[str]:
    """Yield a line for each peer that is not charted."""
    if case.scene.body is None:
        yield "Peers: the scene has no body, and prescribed rates are theirs to supply"
        return
    told = {}
    for method in peers()[0]:
        if not method.suits(case):
            told[_program(method.name)] = "set up for the motions of `rbfmu chart` alone"
        elif why := why_not(method, case):
            told[method.name] = why
    for ending in found.endings:
        if ending.family == "peer" and math.isinf(ending.error) and ending.why.startswith("not run"):
            told[_program(ending.method)] = ending.why.split(": ", 1)[1]
    yield from (f"{name}: {why}" for name, why in told.items())
    yield from absent()


def _program(method: str) -> str:
    """Return the name of the program that a peer's method belongs to."""
    return method.split()[0]
