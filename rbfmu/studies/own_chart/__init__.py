"""The study behind `rbfmu chart SCENE`: accuracy against cost of every method on a scene of one's own.

All methods and installed peers are run on the scene as it is, with its ports at zero, and judged by its motion in
double-double arithmetic.
"""

from collections.abc import Callable
from typing import Any

from rbfmu.scene.scene import Scene, of_scene_or_path
from rbfmu.studies.own_chart.result import Chart

__all__ = ["Chart", "chart"]


@of_scene_or_path
def chart(scene: Scene, quick: bool = False, progress: Callable[[int, int, str], Any] | None = None) -> Chart:
    """Chart accuracy against cost of every method and installed peer on a scene, or that of a scene file.

    quick: few methods and settings, to see that it runs; progress: called with (done, total, text).
    A full chart takes one or two minutes. Raises SceneError where the accuracy asked cannot be met.
    """
    from rbfmu.studies.own_chart.measure import measured

    return measured(scene, quick, progress or (lambda done, total, text: None))
