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

LARGEST, SMALLEST = 100.0, 1e-4
"""The largest and smallest plausible radius of gyration, in m."""
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
    radius = math.sqrt(evaluated(inertia.principal_axes, body.M_c)[0][2] / body.mass)
    if not SMALLEST <= radius <= LARGEST and radius > 0.0:
        wrong = f"beyond {LARGEST:g} m" if radius > LARGEST else f"below {1e3 * SMALLEST:g} mm"
        yield f"the body's radius of gyration is {radius:.3g} m, {wrong}; mass in kg, inertia in kg m2?"


def _turns(scene: Scene, rate: float, when: str) -> Iterator[str]:
    turns = rate * scene.run.step / (2.0 * math.pi)
    if turns > 1.0 and (shown := [name for name in scene.outputs.quantities if name in PERIODIC]):
        lost = f"{turns:.3g} turns a communication step {when}, which {' and '.join(shown)} cannot show"
        yield f"run.step = {scene.run.step!r}: {lost}; a turn takes {scene.run.step / turns:.3g} s"
