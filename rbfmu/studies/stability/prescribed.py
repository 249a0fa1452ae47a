"""The model of prescribed rates: rates that are constant for some steps and then change within each step."""

import numpy as np

from rbfmu.runs.plan import Plan, filled_buffer, initialize
from rbfmu.scene.scene import Scene
from rbfmu.studies.stability.motions import Array, attitude_error, references

_Vector = tuple[float, float, float]
_NONE: _Vector = (0.0, 0.0, 0.0)
_HELD: tuple[float, _Vector, _Vector, _Vector] = (2.0, (3.0, -1.0, 2.0), _NONE, _NONE)
PRESCRIBED = (
    *(_HELD,) * 5,
    (1.0, (1e-3, 2e-3, -1e-3), _NONE, _NONE),
    (2.0, (1.0, 0.0, 0.5), (-0.5, 1.5, 0.25), (0.25, -1.0, 0.5)),
    (2.0, (0.0, 2.0, -1.0), (1.0, -0.5, 0.75), _NONE),
)
"""For each step: its length in s, and omega_b with its first and second derivative at the start of the step."""


def prescribed_error() -> float:
    """Return the largest error after a step, rad."""
    scene = Scene.from_dict({"inputs": {"ports": ["omega_b"]}, "outputs": {"quantities": ["quaternion"]}})
    planned = Plan("prescribed rates", "", 4)
    kernels, z = planned.kernels, filled_buffer(scene, planned)
    initialize(scene, kernels, z)
    found: list[Array] = []
    for h, omega, rate, rate_2 in PRESCRIBED:
        for name, value in (("omega_b", omega), ("omega_b_rate", rate), ("omega_b_rate_2", rate_2)):
            z[kernels.BLOCKS[name]] = value
        refused = kernels.step(z, h)
        found.append(np.full(4, np.nan) if refused else z[kernels.BLOCKS["quaternion"]].copy())
    return attitude_error(np.array(found), np.array(references()["prescribed"]))
