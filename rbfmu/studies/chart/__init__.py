"""The study behind `rbfmu chart`: accuracy against cost of every method, on a scene of one's own or on eight motions.

All methods and installed peers are run on a scene as it is, with its ports at zero, and judged by its true motion.
"""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from rbfmu.scene.scene import Scene, of_scene_or_path
from rbfmu.studies.chart.result import Chart

__all__ = ["Chart", "chart"]


@of_scene_or_path
def chart(
    scene: Scene,
    quick: bool = False,
    progress: Callable[[int, int, str], Any] | None = None,
    method: str | Path | None = None,
) -> Chart:
    """Chart accuracy against cost of every method and installed peer on a scene, or that of a scene file.

    quick: few methods and settings, to see that it runs; progress: called with (done, total, text); method: a
    file with a method of one's own (`rbfmu.studies.own_method`), which competes.
    A full chart takes one or two minutes. Raises SceneError where the accuracy asked cannot be met.
    """
    from rbfmu.studies.chart.cases import case_of
    from rbfmu.studies.chart.measure import extent, measure

    what = extent(quick, method)
    progress = progress or (lambda done, total, text: None)
    progress(0, 1, f"{scene.name}: the true motion")
    found = measure(case_of(scene), what, progress)
    return replace(found, whole=scene.run.stop - scene.run.start)
