"""Pilot runs: a plan tried on its scene before it is used, and the runs that judge it."""

import math

from rbfmu.ladder import Needs
from rbfmu.models import Plan
from rbfmu.recording import Motion, begun, recorded, substeps_counted
from rbfmu.scene import Scene
from rbfmu.times import communication_steps, thinned_steps
from rbfmu_kernels._substeps import substeps_in

MOST_STEPS = 20_000
"""Communication steps up to which a pilot run has the scene's own; a longer run takes several at once."""
ROUND_OFF = 2.0**-52


def judged(scene: Scene) -> tuple[str, ...]:
    """What of the state the scene makes a method follow: no more, so that a pilot run takes the steps of later runs."""
    needs = Needs.of(scene)
    attitude, rate = ("quaternion",) * needs.attitude, ("omega_b",) * needs.rotation
    return attitude + rate + ("position", "velocity") * needs.translation


def references(scene: Scene, tight: Plan) -> list[Motion]:
    """What pilot runs are judged by: two that start a round-off away to either side, as a chaotic motion magnifies it.

    In half steps, so that they share neither steps nor round-off with what they judge.
    """
    steps, unit, names = thinned_steps(scene, MOST_STEPS), tight.unit, judged(scene)
    return [recorded(unit, begun(scene, tight, names, s * ROUND_OFF), steps, names, 2) for s in (1.0, -1.0)]


def pilot_run(scene: Scene, trial: Plan) -> tuple[Motion, float]:
    """The motion on the scene's grid (every so many points of a long one), ports at zero, and the substeps it took."""
    z = begun(scene, trial, judged(scene))
    motion = recorded(trial.unit, z, thinned_steps(scene, MOST_STEPS), judged(scene))
    if math.isfinite(trial.substep):
        return motion, substeps_taken(scene, trial.substep)
    return motion, max(substeps_counted(trial.unit, z), float(communication_steps(scene)))


def whole_run(scene: Scene, trial: Plan) -> Motion:
    """The motion's begin and end, all in one communication step."""
    names = judged(scene)
    return recorded(trial.unit, begun(scene, trial, names), [scene.run.stop - scene.run.start], names)


def substeps_taken(scene: Scene, substep: float) -> float:
    """Over the run, where each is at most `substep`; infinite where that is refused."""
    return communication_steps(scene) * (substeps_in(scene.run.step, substep) or math.inf)
