"""A controller in Python turns a satellite's FMU to zero attitude, step by step through FMPy."""

import shutil
import tempfile
from pathlib import Path

import fmpy
import numpy as np
from fmpy.fmi2 import FMU2Slave

import rbfmu
import rbfmu_fmu

SCENE = Path(__file__).parent / "scenes" / "controlled_satellite.toml"
STIFFNESS, DAMPING = 0.4, 1.2
"""N m per unit of eps, N m s/rad."""


def control(q_ab: np.ndarray, omega_b: np.ndarray) -> np.ndarray:
    """PD law: against the rotation vector's direction, by the shorter way, and against the rates."""
    return -STIFFNESS * np.copysign(1.0, q_ab[0]) * q_ab[1:] - DAMPING * omega_b


def main() -> float:
    """Print the attitude error as it falls; return the last one in degrees."""
    scene = rbfmu.load_scene(SCENE)
    folder = Path(tempfile.mkdtemp())
    fmu_file = rbfmu_fmu.build(scene, folder / "satellite.fmu")
    model = fmpy.read_model_description(str(fmu_file))
    reference = {v.name: v.valueReference for v in model.modelVariables}
    state = [reference[f"quaternion[{i}]"] for i in (1, 2, 3, 4)] + [reference[f"omega_b[{i}]"] for i in (1, 2, 3)]
    torque = [reference[f"torque_b[{i}]"] for i in (1, 2, 3)]

    unzipped = fmpy.extract(str(fmu_file), str(folder / "unzipped"))
    fmu = FMU2Slave(guid=model.guid, unzipDirectory=unzipped, modelIdentifier=model.coSimulation.modelIdentifier,
                    instanceName="satellite")  # fmt: skip
    fmu.instantiate()
    fmu.setupExperiment(startTime=0.0)
    fmu.enterInitializationMode()
    fmu.exitInitializationMode()
    step, angle = scene.run.step, 0.0
    for k in range(round(scene.run.stop / step)):
        values = np.array(fmu.getReal(state))
        angle = float(np.degrees(rbfmu.angle_between(values[:4], [1.0, 0.0, 0.0, 0.0])))
        if k % 100 == 0:
            print(f"t = {k * step:4.1f} s: {angle:8.4f} deg from zero attitude")
        fmu.setReal(torque, control(values[:4], values[4:]).tolist())
        fmu.doStep(currentCommunicationPoint=k * step, communicationStepSize=step)
    fmu.terminate()
    fmu.freeInstance()
    shutil.rmtree(folder)
    print(f"t = {scene.run.stop:4.1f} s: {angle:8.4f} deg")
    return angle


if __name__ == "__main__":
    main()
