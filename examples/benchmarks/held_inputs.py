"""What inputs that are held over a communication step cost in accuracy, and what their derivatives bring back.

FMPy interpolates a table of inputs linearly between its points, and sets what it finds at the beginning of each step;
the model holds that over the step. With the table's slope given as well it follows the table. FMPy 0.3.32 can give
slopes to FMUs of nine inputs only (`set_input_derivatives`), so they are given to the kernels here.
"""

import tempfile
from pathlib import Path

import fmpy
import numpy as np

import rbfmu
import rbfmu_fmu
from rbfmu.runs.model_buffer import filled_buffer, initialize

STOP, POINTS = 60.0, 1.0
"""s: the run, and from one point of the table to the next."""


def scene_of(step: float) -> rbfmu.Scene:
    """Return a satellite that another unit turns."""
    return rbfmu.Scene.from_dict({
        "name": "held_inputs",
        "body": {"mass": 50.0, "inertia": [1.0, 2.0, 2.5]},
        "initial": {"omega_b": [0.1, -0.2, 0.15]},
        "loads": {"gravity_a": [0.0, 0.0, 0.0]},
        "inputs": {"ports": ["torque_b"]},
        "outputs": {"quantities": ["quaternion"]},
        "run": {"stop": STOP, "step": step, "accuracy": 1e-9},
    })  # fmt: skip


def table() -> tuple[np.ndarray, np.ndarray]:
    """Return times (n,) in s and torques (n, 3) in N m."""
    time = np.arange(0.0, STOP + POINTS, POINTS)
    return time, np.stack([0.01 * np.sin(0.5 * time + phase) for phase in (0.0, 1.0, 2.0)], axis=1)


def by_kernels(scene: rbfmu.Scene) -> np.ndarray:
    """Return the last attitude with the table's slopes."""
    planned = rbfmu.plan(scene)
    kernels, z, (time, torques) = planned.kernels, filled_buffer(scene, planned), table()
    initialize(scene, kernels, z)
    for k in range(round(STOP / scene.run.step)):
        t = k * scene.run.step
        i = int(t / POINTS + 1e-9)
        slope = (torques[i + 1] - torques[i]) / POINTS
        z[kernels.BLOCKS["torque_b"]] = torques[i] + (t - time[i]) * slope
        z[kernels.BLOCKS["torque_b_rate"]] = slope
        assert kernels.step(z, scene.run.step) == 0
    return z[kernels.BLOCKS["quaternion"]].copy()


def by_fmpy(scene: rbfmu.Scene) -> np.ndarray:
    """Return the last attitude of the native FMU, inputs held."""
    time, torques = table()
    names = ["time", *(f"torque_b[{i}]" for i in (1, 2, 3))]
    rows = np.array([(t, *row) for t, row in zip(time, torques, strict=True)], [(name, float) for name in names])
    with tempfile.TemporaryDirectory() as folder:
        fmu = rbfmu_fmu.build(scene, Path(folder) / "held_inputs.fmu", "native")
        result = fmpy.simulate_fmu(
            str(fmu), stop_time=STOP, step_size=scene.run.step, output_interval=scene.run.step, input=rows,
            output=[f"quaternion[{i}]" for i in (1, 2, 3, 4)],
        )  # fmt: skip
    return np.array([result[f"quaternion[{i}]"][-1] for i in (1, 2, 3, 4)])


def main() -> dict[float, tuple[float, float]]:
    """By step, the attitude's error in degrees after the run: inputs held, inputs with derivatives."""
    errors, true = {}, by_kernels(scene_of(0.005))
    for step in (0.1, 0.05):
        scene = scene_of(step)
        held, given = (np.degrees(rbfmu.angle_between(how(scene), true)) for how in (by_fmpy, by_kernels))
        errors[step] = float(held), float(given)
        print(f"step {step:g} s: {held:.3f} deg after {STOP:g} s with inputs held, {given:.1e} deg with derivatives")
    return errors


if __name__ == "__main__":
    main()
