"""One picture for each study."""

from collections.abc import Callable
from pathlib import Path

from matplotlib.figure import Figure

from rbfmu.stability import attitude_charts, body_charts, model_charts
from rbfmu.stability.findings import Study

PICTURES: dict[str, Callable[[Study], Figure]] = {
    f.__name__: f
    for f in (
        attitude_charts.growth_factors, attitude_charts.drift, attitude_charts.gimbal_passage,
        body_charts.gyroscopic_blow_up, body_charts.damping_limits, body_charts.moser_veselov_limits,
        body_charts.energy_drift, attitude_charts.small_angles, body_charts.intermediate_axis,
        body_charts.sleeping_top, body_charts.kick_resonance, model_charts.product_models,
        model_charts.orders_and_error_control,
    )
}  # fmt: skip
"""By the study's name."""


def draw(study: Study, folder: Path) -> Path:
    """The study's picture, a PNG file."""
    path = folder / f"{study.name}.png"
    PICTURES[study.name](study).savefig(path, dpi=130)
    return path
