"""A controller in Python turns a satellite to zero attitude: by a Simulator, and through its FMU by FMPy."""

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


def by_simulator(steps: int) -> np.ndarray:
    """Return the attitude after each step, (steps, 4)."""
    satellite = rbfmu.Simulator(SCENE)
    attitudes = []
    for _ in range(steps):
        satellite.step(0.1, torque_b=control(satellite.quaternion, satellite.omega_b))
        attitudes.append(satellite.quaternion)
    return np.array(attitudes)


def by_fmu(steps: int, folder: Path) -> np.ndarray:
    """Return the same from the scene's FMU."""
    fmu_file = str(rbfmu_fmu.build(rbfmu.load_scene(SCENE), folder / "satellite.fmu"))
    model, unzipped = fmpy.read_model_description(fmu_file), fmpy.extract(fmu_file, str(folder / "unzipped"))
    reference = {v.name: v.valueReference for v in model.modelVariables}
    state = [reference[f"quaternion[{i}]"] for i in (1, 2, 3, 4)] + [reference[f"omega_b[{i}]"] for i in (1, 2, 3)]
    torque = [reference[f"torque_b[{i}]"] for i in (1, 2, 3)]
    fmu = FMU2Slave(guid=model.guid, unzipDirectory=unzipped, modelIdentifier=model.coSimulation.modelIdentifier,
                    instanceName="satellite")  # fmt: skip
    fmu.instantiate()
    fmu.setupExperiment(startTime=0.0)
    fmu.enterInitializationMode()
    fmu.exitInitializationMode()
    attitudes = []
    for k in range(steps):
        values = np.array(fmu.getReal(state))
        fmu.setReal(torque, control(values[:4], values[4:]).tolist())
        fmu.doStep(currentCommunicationPoint=k * 0.1, communicationStepSize=0.1)
        attitudes.append(fmu.getReal(state)[:4])
    fmu.terminate()
    fmu.freeInstance()
    return np.array(attitudes)


def main(steps: int = 600) -> float:
    """Print the attitude error as it falls, and how far both ways are apart; return the last error in degrees."""
    attitudes = by_simulator(steps)
    angles = np.degrees(rbfmu.angle_between(attitudes, [1.0, 0.0, 0.0, 0.0]))
    for k in range(steps // 6 - 1, steps, steps // 6):
        print(f"t = {0.1 * (k + 1):4.1f} s: {angles[k]:8.4f} deg from zero attitude")
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        print(f"largest difference to the FMU: {np.max(np.abs(attitudes - by_fmu(steps, Path(folder))))}")
    return float(angles[-1])


if __name__ == "__main__":
    main()
