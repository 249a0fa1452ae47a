"""One picture for each study."""

from collections.abc import Callable
from pathlib import Path

from matplotlib.figure import Figure

from rbfmu.studies.stability.charts import attitude, body, model
from rbfmu.studies.stability.findings import Study

PICTURES: dict[str, Callable[[Study], Figure]] = {
    f.__name__: f
    for f in (
        attitude.growth_factors, attitude.drift, attitude.gimbal_passage,
        body.gyroscopic_blow_up, body.damping_limits, body.moser_veselov_limits,
        body.energy_drift, attitude.small_angles, body.intermediate_axis,
        body.sleeping_top, body.splitting_resonance, model.product_models,
        model.orders_and_error_control,
    )
}  # fmt: skip
"""The drawing functions, by the study's name."""


def draw(study: Study, folder: Path) -> Path:
    """Draw the study's picture, a PNG file."""
    path = folder / f"{study.name}.png"
    PICTURES[study.name](study).savefig(path, dpi=130)
    return path
