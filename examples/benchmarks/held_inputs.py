"""What inputs that are held over a communication step cost in accuracy, and two ways to have it back in FMPy.

`fmpy.simulate_fmu` interpolates a table of inputs linearly between its points, and sets what it finds at the beginning
of each step; the model holds that over the step. With the table's times half a step earlier, it holds the value of the
step's middle. With the table's slope given as well, the model follows the table: `simulate_fmu` of FMPy 0.3.32 gives
slopes to FMUs of nine inputs only (`set_input_derivatives`), a loop of one's own to any.
"""

import tempfile
from pathlib import Path

import fmpy
import numpy as np
from fmpy.fmi2 import FMU2Slave

import rbfmu
import rbfmu_fmu

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


def by_table(fmu: Path, step: float, earlier: float) -> np.ndarray:
    """Return the last attitude, inputs held; the table's times are less by `earlier` s."""
    time, torques = table()
    names = ["time", *(f"torque_b[{i}]" for i in (1, 2, 3))]
    rows = np.array([(t - earlier, *row) for t, row in zip(time, torques, strict=True)], [(n, float) for n in names])
    result = fmpy.simulate_fmu(
        str(fmu), stop_time=STOP, step_size=step, output_interval=step, input=rows,
        output=[f"quaternion[{i}]" for i in (1, 2, 3, 4)],
    )  # fmt: skip
    return np.array([result[f"quaternion[{i}]"][-1] for i in (1, 2, 3, 4)])


def by_slopes(fmu: Path, step: float) -> np.ndarray:
    """Return the last attitude, inputs with the table's slopes."""
    model, (time, torques) = fmpy.read_model_description(str(fmu)), table()
    number = {v.name: v.valueReference for v in model.modelVariables}
    torque_b = [number[f"torque_b[{i}]"] for i in (1, 2, 3)]
    with tempfile.TemporaryDirectory() as folder:
        unzipped, identifier = fmpy.extract(str(fmu), folder), model.coSimulation.modelIdentifier
        unit = FMU2Slave(guid=model.guid, unzipDirectory=unzipped, modelIdentifier=identifier, instanceName="body")
        unit.instantiate()
        unit.setupExperiment(startTime=0.0)
        unit.enterInitializationMode()
        unit.exitInitializationMode()
        for k in range(round(STOP / step)):
            t = k * step
            i = int(t / POINTS + 1e-9)
            slope = (torques[i + 1] - torques[i]) / POINTS
            unit.setReal(torque_b, (torques[i] + (t - time[i]) * slope).tolist())
            unit.setRealInputDerivatives(torque_b, [1, 1, 1], slope.tolist())
            unit.doStep(t, step)
        attitude = np.array(unit.getReal([number[f"quaternion[{i}]"] for i in (1, 2, 3, 4)]))
        unit.terminate()
        unit.freeInstance()
    return attitude


def errors(folder: Path) -> dict[float, tuple[float, float, float]]:
    """By step, the attitude's error in degrees: inputs held, held half a step earlier, with slopes."""
    fmus = {h: rbfmu_fmu.build(scene_of(h), folder / f"step_{h:g}.fmu", "native") for h in (0.005, 0.1, 0.05)}
    true = by_slopes(fmus[0.005], 0.005)
    found = {}
    for step in (0.1, 0.05):
        ways = by_table(fmus[step], step, 0.0), by_table(fmus[step], step, 0.5 * step), by_slopes(fmus[step], step)
        held, earlier, given = (float(np.degrees(rbfmu.angle_between(way, true))) for way in ways)
        found[step] = held, earlier, given
    return found


def main() -> dict[float, tuple[float, float, float]]:
    """Print the errors."""
    with tempfile.TemporaryDirectory() as folder:
        found = errors(Path(folder))
    for step, (held, earlier, given) in found.items():
        ways = f"{held:.3f} deg held, {earlier:.4f} deg from a table half a step earlier, {given:.1e} deg with slopes"
        print(f"step {step:g} s: {ways}")
    return found


if __name__ == "__main__":
    main()
