"""The reference by which plans are judged: a scene's motion in all judged quantities, far more exact than any plan's.

The equations of motion and a scene's formulas are a list of operations, which compiled functions evaluate in
double-double arithmetic. The reference has its own steps, independent of the communication step; its series are
evaluated at each time at which an output is asked for.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from decimal import Decimal, localcontext
from itertools import accumulate
from typing import Any, NamedTuple

import numpy as np

from rbfmu.formulas import program
from rbfmu.formulas.motion import STATE, by_element, closure, groups_of
from rbfmu.models.formulas import EVENT, FormulaModel, equations_of
from rbfmu.models.question import Question
from rbfmu.runs.steps import Tell
from rbfmu.scene.scene import Body, Scene, SceneError
from rbfmu.types import Array, Buffer, Indices, Motion
from rbfmu_kernels.buffer_access import matrix_at, put_quaternion_at
from rbfmu_kernels.compile.decorator import kernel
from rbfmu_kernels.compile.tiered import tiered
from rbfmu_kernels.integrators import formula_ends, formula_reference as kernels
from rbfmu_kernels.integrators.formula_operations import KINDS, ROOTS
from rbfmu_kernels.mechanics.inertia import INERTIA_TOLERANCE
from rbfmu_kernels.rotations.matrix import quaternion_from_matrix

Decimals = Any
"""Arrays of `Decimal`: NumPy computes with these as with any objects, but its types have no name for them."""
DIGITS, OF_TIMES = 50, 400
"""DIGITS: of numbers computed from the scene's: more than the 32 of double-double, to which they are rounded once.
OF_TIMES: so many that sums of steps are exact, as the sign of what remains decides whether a condition on t holds."""
ONE = np.array([[Decimal(int(i == j)) for j in range(3)] for i in range(3)])
CHUNK = 500
"""The number of the scene's steps after which progress is reported."""
MOST_WORK = 20_000_000
"""The most operations in all steps of a reference, each with all its coefficients: about 20 s."""
MOST_SERIES = 3e5
"""A motion of formulas that takes too long is followed in doubles instead, unless it needs more steps: about 20 s."""
ENOUGH, STEADY = 0.15, 2.1
"""In a hurry, a reference stops after a fifth of its steps if they cover less than ENOUGH of the run, and if steps do
not grow longer: they cover less than STEADY times what the first half of them covered."""
SHORTER, MOST_SHORTENED = 2.0**-40, 10
"""The factor by which the unit of time is shortened where coefficients come near the end of the range of doubles, and
how often at most."""
MOST_HALVED, FAR_PARTS, PARTS = 60, 64, 16
"""MOST_HALVED: how often a series is halved because of its defect. FAR_PARTS, PARTS: at how many places in a series its
defect is checked, if it reaches much farther than the last one, and else: more than in the series that are judged.
"""
CREEPING = 1e-6
"""A motion has no end in reach if the last half of all steps advances it by less than this part of the time before. The
reason is then a square root or power that comes to zero within this part of a run, if there is one.
"""
FINEST, MOST_STALLED = 2.0**-52, 500
"""MOST_STALLED: the most successive series that may reach less than FINEST of the time since the start, which doubles
cannot resolve: 13 where a force grows from 1e-300, ever more where a motion ends in a pole."""
NOWHERE, SLIDES = -2, math.inf
"""NOWHERE: the steps that `follow` returns for a motion that ends. SLIDES: marks the corner that it slides along."""


class ReferenceTooLongError(ArithmeticError):
    """An error for a motion that takes more steps than allowed, or leaves the range of numbers."""


def reference_motion(scene: Scene, steps: Sequence[float], most: int, progress: Tell = None) -> Motion:
    """Return the judged quantities of a scene, and attitude and rate, at its start and after each step, s.

    Ports keep their values at the start. For a scene with formulas, the quantities are its outputs, its own states
    and what its events watch. progress: a function that is called with the part of the run that is done, 0 to 1.
    Raises ReferenceTooLongError if it takes more than `most` steps of its own, and SceneError if a motion by formulas
    ends before the run.
    """
    listed = OperationList(scene)
    most = min(most, MOST_WORK // len(listed.found))
    sides = np.array([[n, 0.0, 0.0] for n in listed.sides]).reshape(-1, 3)
    with localcontext() as context:
        context.prec = DIGITS
        here = pairs_of(listed.at_start(_exact_values(listed.formulas, scene)))
        context.prec = OF_TIMES
        times = pairs_of(accumulate(map(Decimal, steps), initial=Decimal(0)))
    work, sizes = np.zeros((2, len(listed.found) * kernels.LENGTH)), np.zeros(len(listed.least))
    rows = np.full((times.shape[1], len(listed.wanted)), np.nan)
    walked = listed.operations, listed.states, listed.least, sides, listed.touching, listed.rising, listed.wanted
    equations = kernels.Equations(*walked, listed.time)
    for first in range(0, times.shape[1], CHUNK):
        chunk = slice(max(first - 1, 0), first + CHUNK)
        some = np.ascontiguousarray(times[:, chunk])
        problem = Problem(equations, some, rows[chunk], work, here, sizes, scene.has_formulas)
        count, done, lately = follow(problem, most, in_a_hurry=not scene.has_formulas)
        if scene.has_formulas and (count == NOWHERE or (count < 0 and lately < CREEPING * done)):
            raise _ends_early(scene, done, listed.keys_at_fault(work, sides))
        starts = scene.has_formulas and np.isfinite(rows[0]).all()  # otherwise a start in doubles says what is wrong
        if count >= 0 and starts and not np.isfinite(rows[chunk]).all():
            row, column = np.argwhere(~np.isfinite(rows))[0].tolist()
            raise _ends_early(scene, sum(steps[:row]), f"{listed.columns[column]} is not finite")
        if count < 0 or not np.isfinite(rows[chunk]).all():
            left = times[0, -1] - times[0, int(np.isfinite(rows).all(axis=1).sum()) - 1]
            if starts and left * most > 2.0 * lately * MOST_SERIES:
                why = f"{most // 2} steps of order {kernels.ORDER} take it on by {lately:.2g} s"
                raise SceneError(f"run.stop = {scene.run.stop!r}: expected a shorter run, as {why}", scene.name)
            raise ReferenceTooLongError(scene.name)
        most -= count
        if progress is not None:
            progress(min((first + CHUNK) / times.shape[1], 1.0))
    return listed.named(rows)


class Problem(NamedTuple):
    """The equations of a motion, and the arrays that `follow` uses.

    times (2, N): increasing, s after the start, double-double; rows (N, w): the wanted values at these; s (2, n
    LENGTH): the series; here (2, n): values at the start, of numbers and leaves; sizes: one for each group; may_hide:
    whether a load may rise and vanish within a step without a trace in the terms of the series, as formulas may.
    """

    equations: kernels.Equations
    times: Array
    rows: Array
    s: Array
    here: Array
    sizes: Array
    may_hide: bool


def follow(problem: Problem, most: int, in_a_hurry: bool) -> tuple[int, float, float]:
    """Set the rows; return the number of steps, the time that they reach, and how far those after `most` / 2 went, s.

    The number is -1 beyond `most` steps, and NOWHERE if values are not finite or slide along a corner. In a hurry it is
    also -1 if a fifth of `most` steps covered too little: see ENOUGH.
    """
    equations, times, rows, s, here, sizes, _ = problem
    begin, span = float(times[0, 0]), float(times[0, -1] - times[0, 0])
    now, half, tenth = (begin, float(times[1, 0])), begin, 0.0
    usual = 2.0 ** math.floor(math.log2(span)) if span > 0.0 else 1.0  # so that no term of the motion is denormal
    unit, step, shortened, steps, stalled, k = usual, 0.0, 0, 0, 0, 0
    equations.sides[:, 1:], equations.touching[:, 2], s[:, :: kernels.LENGTH] = 0.0, 0, here
    while k < times.shape[1]:
        if not _settle_sides(problem, unit, now[0] / unit, is_same_series=shortened > 0):
            return NOWHERE, now[0], 0.0
        last, step = step, min(kernels.longest_step(equations, sizes, s), 2.0 * span / unit)
        if math.isnan(step) and shortened < MOST_SHORTENED:
            unit, step, shortened = SHORTER * unit, last / SHORTER, shortened + 1
            continue
        reach, step = _reach(problem, now[0] / unit, unit, step, last)
        steps, done = steps + 1, now[0] - begin
        stalled = stalled + 1 if unit * reach[0] < FINEST * done else 0
        if not reach[0] > 0.0 or stalled > MOST_STALLED:
            return NOWHERE, now[0], 0.0
        half = now[0] if steps == most // 2 else half
        tenth = done if steps == most // 10 else tenth
        if steps > most or (in_a_hurry and steps == most // 5 and done < min(ENOUGH * span, STEADY * tenth)):
            return -1, now[0], now[0] - half
        k = kernels.put_rows(equations, s, unit, reach[0], now, times, here, rows, k)
        if k < times.shape[1]:
            now = kernels.begin_at(equations.states, s, unit, reach, now, here)
            if len(equations.sides):  # a square root near its corner shortens only one series' unit
                unit, step, shortened = usual, step * (unit / usual), 0
    return steps, now[0], now[0] - half


def _settle_sides(problem: Problem, unit: float, done: float, *, is_same_series: bool) -> bool:
    """Expand the series until each side agrees with the sign that its number has next; return False if no choice does.

    done: the time that has passed, in units; is_same_series: whether it is the previous series in another unit.
    """
    equations, sides, turned = problem.equations, problem.equations.sides, -1
    roots = [n for n in equations.touching[:, 1] if equations.operations[n, 0] in ROOTS] if len(sides) else []
    equations.operations[roots, 3] = 0
    if not is_same_series:
        sides[:, 1], sides[:, 2] = sides[:, 2], 0.0
    for _ in range(3 * len(sides) + len(roots) + 1):
        kernels.expand(equations, problem.s, unit)
        if roots and kernels.rest_roots(equations, problem.s, done):
            continue
        turned = kernels.turn_side(equations, problem.s, done) if len(sides) else -1
        if turned < 0:
            return True
    sides[turned, 1] = SLIDES
    return False


def _reach(problem: Problem, done: float, unit: float, step: float, last: float) -> tuple[tuple[float, float], float]:
    """Return the reach of the series, and the step, halved until the defect is small; last: the step before."""
    equations, _, _, s, here, sizes, may_hide = problem
    reach, has_corners = (step, 0.0), any(map(len, (equations.sides, equations.touching, equations.rising)))
    for _ in range(MOST_HALVED):
        reach = kernels.to_corner(equations, s, step, done) if has_corners else (step, 0.0)
        parts = (FAR_PARTS if step > formula_ends.FARTHER * last else PARTS) if may_hide else 1
        fault = kernels.first_fault(equations, sizes, s, unit, reach[0] - 2.0 * kernels.BEYOND * step, here, parts)
        if fault == 0.0:
            break
        step = 0.5 * fault
    return reach, step


class OperationList:
    """The motion and the wanted quantities as a list of operations, which `follow` evaluates.

    found: the operations' indices in the graph. All else refers to places in this list: operations: a row for each;
    states: a row for each: its operation, that of its rate, its group; least: the least size of each group; wanted: the
    operations asked for; sides: the signs of numbers; touching: the arguments that have no series at zero, with their
    square roots, powers and angles; rising: arguments of exponentials; time: the operation t, or -1.
    """

    def __init__(self, scene: Scene) -> None:
        self._is_plain = not scene.has_formulas
        if self._is_plain:
            shown = dict.fromkeys((*Question(scene).judged, "quaternion", "omega_b"))
            scene = scene.replace({"outputs.quantities": [*shown]})
        self.formulas = formulas = equations_of(scene)
        self.graph, self._shown, rates = formulas.motion.graph, {**formulas.shown}, formulas.all_rates
        if self._is_plain:  # attitudes are computed from the rounded matrix, as they have always been
            self._shown["quaternion"] = formulas.motion.R
        wanted = [self.graph.symbol_of(x) for _, x in by_element(self._shown)]
        names = closure(rates, wanted, self.graph)
        leaves, slopes = [self.graph.leaf("state", n) for n in names], [self.graph.symbol_of(rates[n]) for n in names]
        self.found = program.with_pairs(self.graph, [*wanted, *leaves, *slopes])
        place = {i: n for n, i in enumerate(self.found)}
        self.operations = self._rows(place)
        groups = groups_of(names)
        group_of = {name: g for g, group in enumerate(groups) for name in group.states}
        ends = zip(leaves, slopes, names, strict=True)
        rows = [(place[leaf.index], place[slope.index], group_of[name]) for leaf, slope, name in ends]
        self.states = np.array(rows, np.int64).reshape(-1, 3)
        self.least = np.array([group.least if group.relative else -group.least for group in groups])
        self.wanted = np.array([place[x.index] for x in wanted], np.int64)
        operations = [(n, self.graph.operations[i]) for n, i in enumerate(self.found)]
        self.sides = [n for n, x in operations if x.kind == "side"]
        touching = [(place[program.zero_argument(x)], n, 0) for n, x in operations if x.kind in program.TOUCHING]
        self.touching = np.array(touching, np.int64).reshape(-1, 3)
        rising = {place[i] for _, x in operations if x.kind in program.RISING for i in x.of}
        self.rising = np.array([*rising], np.int64)
        self.time = dict(zip(names, self.states[:, 0].tolist(), strict=True)).get("t", -1)

    def _rows(self, place: Mapping[int, int]) -> Indices:
        """Return a row for each operation: kind, three arguments (a sine's second is the cosine), if it changes."""
        rows, changing = np.zeros((len(self.found), 5), np.int64), set[int]()
        for n, i in enumerate(self.found):
            kind, of, _ = self.graph.operations[i]
            if kind in program.PAIRS:
                of = (of[0], program.pair_of(self.graph, i).index)
            if kind == "state" or not changing.isdisjoint(of):
                changing.add(i)
            if kind == "multiply" and changing.isdisjoint(of[:1]):  # the constant factor is second
                of = of[::-1]
            if kind == "multiply" and changing.isdisjoint(of[1:]):
                kind = "scale"
            rows[n] = [KINDS.index(kind), *(place[j] for j in of), *[0] * (3 - len(of)), i in changing]
        return rows

    @property
    def columns(self) -> list[str]:
        """Return the quantity of each number of a row, as a key of the scene if it has one."""
        own = {name: f"outputs.{name}" for name in self.formulas.own_outputs}
        own |= {f"{EVENT}{name}": f"events.{name}" for name in self.formulas.events}
        return [own.get(name, name) for name, value in self._shown.items() for _ in range(np.size(value))]

    def named(self, rows: Array) -> Motion:
        """Return the rows of each quantity, by name."""
        ends = np.cumsum([np.size(value) for value in self._shown.values()])[:-1]
        motion = dict(zip(self._shown, np.split(rows, ends, axis=1), strict=True))
        if self._is_plain:
            matrices, q = np.ascontiguousarray(motion["quaternion"]), np.empty((len(rows), 4))
            tiered(_put_quaternions)(matrices.ravel(), q.ravel())
            motion["quaternion"] = q
        return motion

    def keys_at_fault(self, work: Array, sides: Array) -> str:
        """Return the reason why a motion ends, with its keys; work, sides: the arrays of `follow` there."""
        lost = ~np.isfinite(work[0].reshape(-1, kernels.LENGTH))
        lost[[self.graph.operations[i].kind == "state" for i in self.found]] = False
        if lost.any():
            n = np.argwhere(lost.T)[0, 1]  # the one of lowest order; others may follow from it
            named = " or ".join(self.formulas.keys_of(self.found[n])) or "the motion"
            kind, of, _ = self.graph.operations[self.found[n]]
            message = f"{named} is not finite, or has no finite derivatives"
            if kind == "exp" and math.isinf(work[0, n * kernels.LENGTH]):
                x = work[0, self.found.index(of[0]) * kernels.LENGTH]
                message += f": exp({x:.6g}) is too large for a number"
            return message
        corner = "a corner of abs, min, max, clip, where or a table; give it a slope: clip(x/w, -1, 1) for a sign of x"
        at_fault, why = [int(n) for n, begun, _ in sides if begun == SLIDES], f"slides along {corner}"
        if not at_fault:
            root, slope = np.abs(work[0].reshape(-1, kernels.LENGTH)[self.touching[:, 1], :2]).T
            at_fault = self.touching[root <= CREEPING * slope, 1].tolist()
            why = "has a root or norm that comes to zero; give it a least value: x/max(norm(x), w) for x/norm(x)"
        if not at_fault:
            return "the motion changes ever faster"
        named = " or ".join(dict.fromkeys(key for n in at_fault for key in self.formulas.keys_of(self.found[n])))
        return f"{named or 'the motion'} {why}"

    def at_start(self, values: Mapping[str, Decimal]) -> list[Decimal]:
        """Return the operations' values at the start: numbers, parameters, states, inputs; sides are 1, all else 0."""
        rows = (self.graph.operations[i] for i in self.found)
        known = ((kind, x, Decimal(kind == "side")) for kind, _, x in rows)
        return [Decimal(x) if kind == "number" else values.get(str(x), other) for kind, x, other in known]


@kernel(inline=False)
def _put_quaternions(matrices: Buffer, q: Buffer) -> None:
    for i in range(len(q) // 4):
        put_quaternion_at(q, 4 * i, quaternion_from_matrix(matrix_at(matrices, 9 * i)))


def _ends_early(scene: Scene, done: float, said: str) -> SceneError:
    """Return the error for a motion that ends `done` s after its start; said: what fails there."""
    reached = f"t = {scene.run.text_of(scene.run.start + done)} s"
    if done == 0.0:
        return SceneError(f"expected another start or formula: at {reached} {said}", scene.name)
    return SceneError(f"run.stop = {scene.run.stop!r}: expected one before {reached}, where {said}", scene.name)


def _exact_values(formulas: FormulaModel, scene: Scene) -> dict[str, Decimal]:
    """Return the exact values of parameters, and of states and inputs at the start, by their elements' names."""
    body, initial = scene.body, scene.initial
    assert body is not None
    q, omega, r_oc, M = *map(decimals_of, (initial.quaternion, initial.omega_b, body.r_oc_b)), _inertia(body)
    position, velocity = decimals_of(initial.position), 0 * ONE[0]  # of the centre of mass, but of o with a pivot
    if not body.pivot:
        R = _matrix(q)
        velocity = decimals_of(initial.velocity) + R @ np.cross(omega, r_oc)
        position = position + R @ r_oc
    given = {name: decimals_of(values) for name, values in formulas.given.numbers.items()}
    own = {f"{STATE}{name}": decimals_of(row.start) for name, row in scene.states.items()}
    own |= {name: decimals_of(port.start) for name, port in scene.inputs.own.items()}
    of_body = {
        "M": M, "M_inverse": _inverse(M), "arm": r_oc if body.pivot else -r_oc,
        "inverse_mass": np.array([1 / Decimal(body.mass)]), "q": q / (q @ q).sqrt(), "omega": omega,
        "r_c": position, "v_c": velocity, "t": np.array([Decimal(scene.run.start)]),
    }  # fmt: skip
    return dict(by_element({**given, **own, **of_body}))


def pairs_of(numbers: Iterable[Decimal]) -> Array:
    """Return numbers (n,) as double-double numbers (2, n): a row of high parts, and one of low parts."""
    exact = [*numbers]
    high = [float(x) for x in exact]
    low = (float(x - Decimal(h)) if math.isfinite(h) else 0.0 for x, h in zip(exact, high, strict=True))
    return np.array([high, [*low]])


def decimals_of(values: Any) -> Decimals:
    """Return floats as exact decimals, in an array of objects."""
    return np.vectorize(Decimal, otypes=[object])(values)


def _inertia(body: Body) -> Decimals:
    """Return M about the centre of mass, or about o with a pivot."""
    M, r = decimals_of(body.inertia), decimals_of(body.r_oc_b)
    if body.pivot:
        M = M + Decimal(body.mass) * (r @ r * ONE - np.outer(r, r))
    return M


def _inverse(M: Decimals) -> Decimals:
    """Return the inverse of M; for a slender beam (one zero moment) the pseudo-inverse."""
    cofactors = np.array([np.cross(M[k - 2], M[k - 1]) for k in range(3)])
    determinant, trace = M[0] @ cofactors[0], np.trace(M)
    if determinant > Decimal(INERTIA_TOLERANCE) * trace * np.trace(cofactors):
        return cofactors.T / determinant
    axis = max(cofactors, key=lambda column: column @ column)
    own = np.outer(axis, axis) * trace / (axis @ axis)
    return _inverse(M + own) - own / trace**2


def _matrix(q: Decimals) -> Decimals:
    """Return R of a quaternion of any norm but zero."""
    w, v = q[0], q[1:]
    turn = np.array([np.cross(v, unit) for unit in ONE]).T  # v x
    return ((w * w - v @ v) * ONE + 2 * np.outer(v, v) + 2 * w * turn) / (q @ q)
