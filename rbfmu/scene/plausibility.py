"""Warnings of scenes that are possible but look like mistakes: a wrong unit, or too long a communication step."""

import math
import warnings
from collections.abc import Iterable, Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from rbfmu.exceptions import SceneWarning as SceneWarning
from rbfmu.scene.body import Body
from rbfmu.scene.scene import Scene
from rbfmu_kernels.compile.tiered import evaluated
from rbfmu_kernels.mechanics import inertia
from rbfmu_kernels.quantities import ANGLE, OUTPUTS

THINNEST = 0.05
"""The least plausible mass (kg) by the cube of the least radius of gyration (m3).

A solid ball has 17 times its density, so this is a 400th of air. The least radius is taken, as beams and cables have a
long one. Large solar sails have 0.02 to 5, frames in space 50, hulls of ships, asteroids and planets 1e4. An inertia in
kg cm2 in place of kg m2 makes it 1e6 times less: of a compact satellite 0.02.
"""
SMALLEST = 1e-4
"""The smallest plausible radius of gyration, in m."""
PERIODIC = tuple(row.name for row in OUTPUTS if row.error == ANGLE or row.unit == "rad")
"""Quantities that do not show a turn between two points."""


def warn(scene: Scene, doubts: Iterable[str], stacklevel: int = 3) -> None:
    """Issue a SceneWarning for each doubt."""
    for doubt in doubts:
        warnings.warn(f"{scene.name}: {doubt}", SceneWarning, stacklevel=stacklevel)


def doubts_before(scene: Scene) -> Iterator[str]:
    """Yield the doubts that a scene raises: an implausible radius of gyration, or more than one turn per step."""
    if scene.body is not None:
        yield from _size(scene.body)
    yield from _turns(scene, math.hypot(*scene.initial.omega_b), "at the start")


def doubts_after(scene: Scene, motion: Mapping[str, NDArray[np.float64]]) -> Iterator[str]:
    """Yield the doubts that only the results of a run raise; `motion` holds them by quantity."""
    found = next((motion[row.name] for row in OUTPUTS if row.unit == "rad/s" and row.name in motion), None)
    if found is not None and not any(_turns(scene, math.hypot(*scene.initial.omega_b), "")):
        yield from _turns(scene, float(np.max(np.linalg.norm(found, axis=1))), "at the fastest")


def _size(body: Body) -> Iterator[str]:
    moments = evaluated(inertia.principal_axes, body.M_c)[0]
    least, radius = (math.sqrt(max(moment, 0.0) / body.mass) for moment in (moments[0], moments[2]))
    largest = math.cbrt(body.mass / THINNEST)
    if least > largest:
        wrong = f"is at least {least:.3g} m, beyond {largest:.3g} m, where {body.mass:g} kg are thinner than air"
    elif 0.0 < radius < SMALLEST:
        wrong = f"is {radius:.3g} m, below {1e3 * SMALLEST:g} mm"
    else:
        return
    yield f"the body's radius of gyration {wrong}; mass in kg, inertia in kg m2?"


def _turns(scene: Scene, rate: float, when: str) -> Iterator[str]:
    turns = rate * scene.run.step / (2.0 * math.pi)
    if turns > 1.0 and (shown := [name for name in scene.outputs.quantities if name in PERIODIC]):
        lost = f"{turns:.3g} turns a communication step {when}, which {' and '.join(shown)} cannot show"
        yield f"run.step = {scene.run.step!r}: {lost}; a turn takes {scene.run.step / turns:.3g} s"
