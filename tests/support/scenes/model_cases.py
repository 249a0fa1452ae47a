"""Bodies, loads and units for tests of the units behind FMUs and `simulate`."""

import numpy as np
from scipy.spatial.transform import Rotation

from rbfmu.models.registry import MODELS
from rbfmu.planning.select import plan
from rbfmu.runs.plan import Plan, filled_buffer, initialize
from rbfmu.scene.scene import Scene
from rbfmu_kernels.buffer import OK, STEP_REJECTED

EPS = 2.0**-52
TRIAXIAL = {"mass": 2.0, "inertia": [1.0, 2.0, 2.5]}
OFFSET = {"mass": 2.0, "inertia": [[1.0, 0.1, 0.05], [0.1, 1.2, 0.02], [0.05, 0.02, 1.5]], "r_oc_b": [0.1, -0.2, 0.3]}
NO_GRAVITY = {"gravity_a": [0.0, 0.0, 0.0]}
GRAVITY = {"gravity_a": [0.0, 0.0, -9.81]}
TURNED = {"rotvec": [0.3, -0.8, 0.5]}
TOP = {"mass": 1.0, "inertia": [0.5, 0.5, 0.3], "r_oc_b": [0.0, 0.0, 0.5], "pivot": True}
LEANING = {"rotvec": [0.4, 0.0, 0.0]}
LOADED = {
    "gravity_a": [0.0, 0.0, -1.0], "force_b": [1.0, 0.5, 0.2], "force_a": [0.3, 0.1, -0.4], "torque_b": [0.1, 0.2, 0.1],
    "torque_a": [0.05, 0.0, 0.02], "damping_b": [0.1, 0.05, 0.02],
}  # fmt: skip
ALL_LOADS = {
    "body": OFFSET,
    "initial": {"omega_b": [1.0, 2.0, -1.0], "position": [1.0, 2.0, 3.0], "velocity": [0.1, 0.2, 0.3]},
    "loads": {name: values for name, values in LOADED.items() if name != "gravity_a"},
}
MOVING = {"position": [1.0, 2.0, 3.0], "velocity": [0.1, 0.2, 0.3], "omega_b": [1.0, 2.0, -1.0], "attitude": TURNED}


def plan_by_hand(model, **settings):
    """A plan that runs, whatever it is good for: of a middle order."""
    spec = MODELS[model]
    orders = spec.kernels.ORDERS or (0,)
    return Plan(model, spec.method, spec.states, **{"order": orders[len(orders) // 2]} | settings)


def made(body, initial=None, loads=None, accuracy=1e-10, stop=10.0, **other):
    run = {"stop": stop, "step": stop / 10.0, "accuracy": accuracy}
    return Scene(body=body, initial=initial or {}, loads=loads or NO_GRAVITY, run=run, **other)


class Unit:
    """A scene's unit, initialised as planned (or as another scene's plan has it), its variables by name."""

    def __init__(self, scene, planned=None):
        self.plan = planned or plan(scene)
        self.kernels = self.plan.kernels
        self.z = filled_buffer(scene, self.plan)
        initialize(scene, self.kernels, self.z)

    def __getitem__(self, name):
        values = self.z[self.kernels.BLOCKS[name]].copy()
        return values if len(values) > 1 else float(values[0])

    def __setitem__(self, name, value):
        self.z[self.kernels.BLOCKS[name]] = value

    def step(self, h, times=1):
        for _ in range(times):
            assert self.kernels.step(self.z, h) == OK
        return self

    def refresh(self):
        self.kernels.outputs(self.z)
        return self


def distance(a, b):
    return float(np.linalg.norm(np.subtract(a, b)))


def matrix(unit):
    return Rotation.from_quat(unit["quaternion"], scalar_first=True).as_matrix()


SCRATCH = {"before", "step_size_before", "substeps", "validity", "kept_before", "work"}
"""Blocks of a buffer that say nothing about the motion."""


def assert_refused(unit, h):
    """Nothing has changed, and the motion goes on as if nothing had been asked."""
    before = {name: unit.z[block].tobytes() for name, block in unit.kernels.BLOCKS.items() if name not in SCRATCH}
    with np.errstate(all="ignore"):
        assert unit.kernels.step(unit.z, h) == STEP_REJECTED
    for name, values in before.items():
        assert unit.z[unit.kernels.BLOCKS[name]].tobytes() == values, name
