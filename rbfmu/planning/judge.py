"""The error of a plan: how far it is from a scene's motion, in every quantity that the scene asks for.

If a method is judged by itself, or by another in the same arithmetic, its error cannot be told from round-off that the
motion magnifies. The truth is therefore computed in double-double arithmetic, with twice the digits, by series of an
order that no plan uses. Only if that takes too long, two series in doubles are used; their difference, the doubt, is
added to all errors.
"""

import math
from collections.abc import Mapping, Sequence
from functools import cached_property
from itertools import pairwise

import numpy as np

from rbfmu.exceptions import PlanningWarning, warn_caller
from rbfmu.models.question import Question
from rbfmu.planning.methods import LOW_ORDER, series_of_all
from rbfmu.runs.inputs import undriven
from rbfmu.runs.motion import largest_error, largest_size, least_sizes
from rbfmu.runs.plan import Plan, start_run
from rbfmu.runs.steps import Steps, Tell, motion_of, record, substeps_counted
from rbfmu.scene.scene import Scene, SceneError
from rbfmu.types import Array, Motion
from rbfmu_kernels.compile.tiered import evaluated
from rbfmu_kernels.integrators.substeps import ROUND_OFF
from rbfmu_kernels.rotations.quaternion import compose_quaternions

MAX_STEPS = 20_000
"""The most communication steps that pilot runs take one by one; in longer runs they take several as one."""
MAX_COUNTED = 2_000_000
"""The most steps of a longer run that are taken one by one in the end, to measure their round-off."""
GOLDEN, FEW_POINTS = 0.6180339887498949, 64
"""GOLDEN: where a step is cut in two, so that a motion whose period is the step does not look like rest. FEW_POINTS:
into about how many parts a run of few steps is cut. Cut k of a step is at k^2 GOLDEN modulo 1. With k GOLDEN, a motion
of 89 periods in a step, 55.006 up to the first cut, would be near its start again at all cuts."""
SMALL, LOST = 1e-11, 0.1
"""SMALL: a disturbance, rad, well above round-off. LOST: the size to which it must not grow.

Of four motions that magnify errors 200 to 6e5 times, the factor is the same to 0.3 % with errors of 1e-12 to 1e-8. With
1e-13 round-off puts it up to 9 % off, with 1e-14 up to 64 %; 1e-6 grows to 0.7 in one of them, and is 7 % off.
"""
DIRECTIONS = ((0.48, -0.6, 0.64), (0.8, 0.0, -0.6), (0.36, 0.8, 0.48))
"""Orthogonal directions, none along a body's axis."""
BETWEEN = 0.1
"""The least size that errors of a quantity are relative to, as a part of its largest size, also between communication
points. Without it, errors of a quantity that is zero at all these points would be relative to round-off. A larger size
at these points counts alone."""
MAX_REFERENCE_STEPS = 100_000
"""The most steps of the reference in double-double arithmetic: some seconds of work."""
MAX_SUBSTEPS = 3e6
"""The most substeps in doubles of a motion for which the reference takes too many steps."""
BESIDE_POLES = 1e-12
"""The part of the largest value that an event watches which may be round-off in later values, and a little more."""
TURNS = 1e-3
"""The rotation in a substep, rad, up to which fast rotation is not the reason that substeps are short."""
MAX_TRIED = 5e7
"""The most substeps of all pilot runs of a plan, up to half a minute of work. A limit in seconds would not be the same
on all machines."""
MOMENTS = 2_000
"""The least number of parts of a run, as MAX_SUBSTEPS is checked after each part."""
TRYING = "methods are tried on its motion, in pilot runs"
LONG = (
    "planning takes more than some seconds, for the motion turns fast, or damping is stiff: more than 1e5 steps of "
    "order 26; a shorter run is planned sooner"
)


class Judge:
    """Measures errors of plans by the truth: the scene's motion with ports as at its start, far more exact than plans.

    progress: a function that is called with the part of the motion that is done; fewer: the same scene with fewer
    outputs, if it is to be judged as well: what is not asked for is not integrated, so that substeps may be longer.
    most: the most steps of pilot runs; in longer runs they take several steps as one.
    """

    def __init__(
        self, asked: Question, progress: Tell = None, fewer: Question | None = None, most: int = MAX_STEPS
    ) -> None:
        self.asked, self.scene, self.names = asked, asked.scene, asked.judged
        of_fewer = tuple(name for name in fewer.judged if name in self.names) if fewer else self.names
        self._followed = tuple(dict.fromkeys((*self.names, "omega_b")))
        self._name_sets = tuple(dict.fromkeys((self.names, of_fewer or self.names)))
        self.steps = asked.scene.run.thinned_steps(most)
        self._parts = max(2, FEW_POINTS // len(self.steps))
        self._progress = progress
        self.doubt = 0.0  # how far the truth itself may be off
        self.substeps_left = MAX_TRIED  # of pilot runs to come
        self.pilots = 1  # how many pilot runs of the same kernels will follow: compiling them at once may pay
        self.arithmetic = "double-double arithmetic"
        self.doing = TRYING

    @property
    def stride(self) -> int:
        """Return how many of the run's communication steps are taken as one."""
        return math.ceil(self.scene.run.count / len(self.steps))

    @property
    def cut_steps(self) -> list[float]:
        """Return the lengths, s, of the parts of communication steps, which are cut in two, or in more if few."""
        cuts = (0.0, *sorted(k * k * GOLDEN % 1.0 for k in range(1, self._parts)), 1.0)
        if self.scene.has_formulas:  # the sum of parts must be h to the last bit, where a condition on t may change
            return [(h + after * h) - (h + before * h) for h in self.steps for before, after in pairwise(cuts)]
        return [(after - before) * h for h in self.steps for before, after in pairwise(cuts)]

    @cached_property
    def motion(self) -> Motion:
        """Return the truth at communication points and between them. Raises SceneError if it takes too long."""
        if self._exact is not None:
            return self._exact
        start_run(self.scene, series_of_all(self.asked, 20, 1e-18), self.names)  # raises where outputs have no start
        warn_caller(f"{self.scene.name}: {LONG}", PlanningWarning)
        self.arithmetic = "double precision"
        self.doing = "its motion is followed in small steps, for it turns fast, or damping is stiff"
        truth, check = (self._tight_motion(order) for order in (20, 24))
        self.doubt = largest_error(truth, check, self.names, least_sizes(self.asked, truth))
        self.doing = TRYING
        return truth

    def _tight_motion(self, order: int) -> Motion:
        """Return the motion by a tight series in doubles, in small steps, for want of a reference."""
        tight = series_of_all(self.asked, order, 1e-18)
        parts = max(2, MOMENTS // len(self.cut_steps))
        steps = (np.repeat(self.cut_steps, parts) / parts).tolist()
        run = Steps(self.scene, tight, undriven(steps), self._followed)
        found = record(run, self._followed, MAX_SUBSTEPS, self._progress)
        refuse_unfinished(self.scene, steps, found["omega_b"], substeps_counted(run.kernels, run.z))
        return {name: rows[::parts] for name, rows in found.items()}

    def follow_by(self, plan: Plan) -> None:
        """Use the motion by a plan as the truth, if its accuracy is known from similar motions."""
        self._parts = 2  # errors are needed at communication points only
        self.__dict__["motion"] = self.motion_by(plan, self._followed)

    def forget(self) -> None:
        """Discard the truth, so that it is computed again, in as many parts as `follow_by` took."""
        for name in ("_exact", "motion", "truth", "floors"):
            self.__dict__.pop(name, None)

    def error_if_soon(self, plan: Plan, otherwise: float = 0.0) -> float:
        """Return the plan's error if the truth takes no more than seconds, else `otherwise`."""
        return otherwise if self.is_slow else self.try_out(plan)[0]

    @cached_property
    def _exact(self) -> Motion | None:
        """Return the motion in double-double arithmetic, or None if that takes too long."""
        from rbfmu.planning.reference import ReferenceTooLongError, reference_motion  # a closed form starts sooner

        self.doing = f"its motion is followed in {self.arithmetic}"
        try:
            return reference_motion(self.scene, self.cut_steps, MAX_REFERENCE_STEPS, self._progress)
        except ReferenceTooLongError:
            return None
        finally:
            self.doing = TRYING

    @property
    def is_slow(self) -> bool:
        """Return whether the motion takes too many steps for double-double arithmetic."""
        return self._exact is None

    @cached_property
    def truth(self) -> Motion:
        """Return the truth at communication points."""
        return {name: rows[:: self._parts] for name, rows in self.motion.items()}

    @cached_property
    def floors(self) -> Mapping[str, float]:
        """Return the least sizes that errors are relative to, by name.

        A quantity that oscillates, with zeros at the communication points, has the size that it has between them.
        """
        found = dict(least_sizes(self.asked, self.motion))
        for name in self.names:
            found[name] = max(found.get(name, 0.0), BETWEEN * largest_size(self.motion[name]))
        return found

    def _floors_of(self, run: Steps) -> dict[str, float]:
        """Return the least sizes; of a number that an event watches, its size over the run."""
        return {**self.floors, **watched_sizes(self.scene, run.kernels.BLOCKS, run.z)}

    def _refuse_poles(self, largest: Mapping[str, float]) -> None:
        """Raise SceneError if the number that an event watches has a pole, whose round-off hides its other values."""
        for name in self.scene.events:
            when = f"when.{name}"
            size = largest_size(self.motion[when])  # also between communication points, at which it may be zero
            if BESIDE_POLES * largest.get(when, 0.0) > size:
                sizes = f"events.{name}.when comes to {largest[when]:.1e}, and is at most {size:.1e} elsewhere"
                expected = "expected a formula without poles, beside which zeros are lost"
                raise SceneError(f"{sizes}: {expected}", self.scene.name)

    def try_out(self, plan: Plan, at_once: int = 1, parts: int = 1, absolute: bool = False) -> tuple[float, float]:
        """Return the plan's error over the run, and its number of substeps.

        at_once: how many steps are taken as one; parts: into how many equal parts each is then cut; absolute: whether
        errors of positions and velocities are relative to 1 m and 1 m/s, as parameters vary with which these grow.
        """
        if at_once == 1:
            return self._error(plan, self.steps, self.truth, parts, absolute)
        points = [*range(0, len(self.steps), at_once), len(self.steps)]
        steps = [math.fsum(self.steps[i:j]) for i, j in pairwise(points)]
        return self._error(plan, steps, {name: self.truth[name][points] for name in self.names}, parts, absolute)

    def try_between(self, plan: Plan, pieces: float) -> float:
        """Return the plan's error in about `pieces` shorter steps, at communication points and between them."""
        parts = max(round(pieces / len(self.cut_steps)), 1)
        return self._error(plan, self.cut_steps, {name: self.motion[name] for name in self.names}, parts)[0]

    def try_all_steps(self, plan: Plan) -> float:
        """Return a plan's error with the round-off of all the run's steps, if `try_out` took several as one.

        In very long runs only the first steps are taken, and their round-off is extrapolated to all.
        """
        parts, steps = self.stride, len(self.steps)
        if parts == 1:
            return plan.error
        count = max(min(steps, MAX_COUNTED // parts), 1)
        truth = {name: self.truth[name][: count + 1] for name in self.names}
        together, _ = self._error(plan, self.steps[:count], truth)
        apart, _ = self._error(plan, self.steps[:count], truth, parts)
        return plan.error + max(apart - together, 0.0) * steps / count

    def _error(
        self, plan: Plan, steps: list[float], truth: Motion, parts: int = 1, absolute: bool = False
    ) -> tuple[float, float]:
        errors, substeps = [], []
        for names in self._name_sets:
            run = Steps(self.scene, plan, undriven(steps, parts), names, self.pilots)
            found = self._pilot(run, names)
            floors = self._floors_of(run)
            self._refuse_poles(floors)
            errors.append(largest_error(found, truth, names, floors, absolute))
            substeps.append(substeps_counted(run.kernels, run.z))
        return max(errors) + self.doubt, max(substeps)

    def _pilot(self, run: Steps, names: tuple[str, ...]) -> Motion:
        """Return the motion of a pilot run. Raises SceneError if all pilot runs together take too long."""
        found = record(run, names, self.substeps_left)
        self.substeps_left -= substeps_counted(run.kernels, run.z)
        if self.substeps_left < 0.0:
            raise too_long(self.scene, f"pilot runs take more than {MAX_TRIED:.0e} substeps")
        return found

    def growth(self) -> float:
        """Return the factor, at least 1, by which an error of attitude and rate at the start grows over the run.

        Small errors grow linearly, and from any direction they soon turn to the direction of largest growth (Lyapunov
        exponents are measured in this way: Benettin et al., Meccanica 15 (1980) 9-30). With three orthogonal directions
        it is nearly impossible that all start where nothing grows. The errors are well above round-off, and remain well
        below the motion itself. The factor is infinite if an error does not remain below LOST.
        """
        worst = self._worst_disturbed(20)
        if worst == math.inf and self.scene.has_formulas:
            worst = self._worst_disturbed(LOW_ORDER)
        return max(worst / SMALL, 1.0) if worst < LOST else math.inf

    def _worst_disturbed(self, order: int) -> float:
        """Return how far series of this order, with a small error at the start, come from the truth."""
        span, truth = self.asked.span, self.truth  # the truth first: it raises an error for a motion without end
        whens = (f"when.{name}" for name in self.scene.events)
        at_rest = {when: 0.0 for when in whens if not self.motion[when].any()}  # their size is the disturbance
        tight, rows, worst = series_of_all(self.asked, order, 1e-16), np.array(DIRECTIONS), 0.0
        for turn, change in zip(rows, np.roll(rows, 1, axis=0), strict=True):
            run = Steps(self.scene, tight, undriven(self.steps), self.names)
            q, omega = (run.z[run.kernels.BLOCKS[name]] for name in ("q", "omega"))
            q += 0.5 * SMALL * np.array(evaluated(compose_quaternions, tuple(q.tolist()), (0.0, *turn.tolist())))
            omega += SMALL / span * self._turning(change)
            found = self._pilot(run, self.names)
            worst = max(worst, largest_error(found, truth, self.names, self._floors_of(run) | at_rest))
        return worst

    def _turning(self, change: Array) -> Array:
        """Return the part (3,) of a change of the rate that is about axes with inertia."""
        body = self.scene.body
        axis = body.axis_without_inertia if body else None
        return change if axis is None else change - np.dot(change, axis) * np.array(axis)

    def motion_by(self, plan: Plan, names: tuple[str, ...]) -> Motion:
        """Return the motion by a plan in `cut_steps`."""
        return motion_of(self.scene, plan, self.cut_steps, names)


def magnified_round_off(growth: float) -> float:
    """Return the error that a motion makes of four units of round-off, at most 1."""
    return min(4.0 * ROUND_OFF * growth, 1.0)


def watched_sizes(scene: Scene, blocks: Mapping[str, slice], z: Array) -> dict[str, float]:
    """Return the largest size in a run of the number that each event watches, by its block; rows may all be zero."""
    sizes = z[blocks["events.largest"]].tolist() if scene.events else ()
    return {f"when.{name}": size for name, size in zip(scene.events, sizes, strict=True)}


def refuse_unfinished(
    scene: Scene, steps: Sequence[float], rates: Array, substeps: float, driven: bool = False
) -> None:
    """Raise SceneError if a motion ended early: after more than MAX_SUBSTEPS, or because a step was refused.

    rates (n + 1, 3): omega_b before and after each of n steps, NaN after the end; driven: by inputs, for which there is
    no reference.
    """
    if np.isfinite(rates[-1]).all():
        return
    last = np.flatnonzero(np.isfinite(rates[:, 0]))[-1]
    done = math.fsum(steps[:last])
    reached = scene.run.text_of(scene.run.start + done)
    if driven and scene.has_formulas and substeps <= MAX_SUBSTEPS:
        why = "where a formula is not finite, or the motion changes too fast"
        raise SceneError(f"inputs: expected others from t = {reached} s on, {why}", scene.name)
    own = [*(f"outputs.{name}" for name in scene.outputs.own), *(f"events.{name}" for name in scene.events)]
    if own and substeps <= MAX_SUBSTEPS:  # for formulas of loads the reference has its own error
        why = f"{' or '.join(own)} is not finite then, or changes too fast"
        raise SceneError(f"run.stop = {scene.run.stop!r}: expected at most {reached} s, as {why}", scene.name)
    rate, why = math.hypot(*rates[last]), "damping is stiff, or another load too large"
    turns_by = rate * done / substeps if substeps > MAX_SUBSTEPS else rate * steps[last] / MAX_SUBSTEPS
    if turns_by > TURNS:
        why = f"it turns at {rate:.2g} rad/s"
    message = f"the {steps[last]:.3g} s from t = {reached} s take too many substeps, or leave the range of numbers"
    if substeps > MAX_SUBSTEPS:
        message = f"{substeps:.1e} substeps take it on by {done:.3g} s"
    raise too_long(scene, f"{message}: {why}")


def too_long(scene: Scene, why: str) -> SceneError:
    """Return the error for a run that is too long to be planned."""
    return SceneError(f"run.stop = {scene.run.stop!r}: expected a shorter run, as {why}", scene.name)


def what_is_reached(error: float) -> str:
    """Return the part of a message that gives the least error of all methods."""
    if not error < math.inf:
        return "no method here ends with finite numbers"
    return f"the methods here reach {least_accuracy(error)}"


def least_accuracy(error: float) -> str:
    """Return an error with two digits, never rounded down, so that an accuracy of this value can be met."""
    text = f"{error:.1e}"
    return text if not float(text) < error else f"{1.05 * error:.1e}"


def refuse_below(asked: Question, error: float) -> None:
    """Raise SceneError for an accuracy below the error of round-off, infinite if numbers overflow."""
    if error == math.inf:
        raise too_long(asked.scene, "the square of its rate comes to leave the range of numbers")
    if not asked.accuracy >= error:  # also true if the error is NaN
        expected = f"at least {least_accuracy(error)}, what double precision keeps"
        raise SceneError(f"run.accuracy = {asked.accuracy!r}: expected {expected}", asked.scene.name)
