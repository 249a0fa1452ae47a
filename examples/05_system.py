"""Two FMUs of rbfmu and a controller, connected by an OSP system file and run by libcosim; the same by simulators.

In libcosim's fixed-step algorithm all units step at once, then outputs become inputs: each connection delays by a
step. It needs libcosimpy: `pip install "rbfmu[interop]"`.
"""

import shutil
import sys
import tempfile
from pathlib import Path

import numpy as np
from pythonfmu.builder import FmuBuilder

import rbfmu
import rbfmu_fmu
from rbfmu.extras import needed_of

with needed_of("interop"):
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
    from libcosimpy.CosimObserver import CosimObserver

SYSTEM = Path(__file__).parent / "interop" / "system"
SATELLITE = rbfmu.load_scene(Path(__file__).parent / "scenes" / "controlled_satellite.toml")
NAVIGATOR = rbfmu.Scene.from_dict(
    {
        "name": "navigator",
        "initial": {"attitude": {"euler": "ZYX", "angles_deg": [60, -30, 45]}},
        "inputs": {"ports": ["omega_b"]},
        "outputs": {"quantities": ["quaternion"]},
    }
)
STEP, STEPS = 0.125, 480


def build(folder: Path, kind: str) -> None:
    """Write the three FMUs and the system file that names them."""
    rbfmu_fmu.build(SATELLITE, folder / "satellite.fmu", kind=kind)
    rbfmu_fmu.build(NAVIGATOR, folder / "navigator.fmu", kind=kind)
    FmuBuilder.build_FMU(SYSTEM / "controller.py", dest=folder).replace(folder / "controller.fmu")
    shutil.copy(SYSTEM / "OspSystemStructure.xml", folder)


def through_libcosim(folder: Path) -> np.ndarray:
    """Return the satellite's attitude and the navigator's after each step, (STEPS, 8)."""
    log_output_level(CosimLogLevel.WARNING)
    execution = CosimExecution.from_osp_config_file(str(folder))
    observer, places = CosimObserver.create_last_value(), []
    execution.add_observer(observer)
    for unit in ("satellite", "navigator"):
        index = execution.slave_index_from_instance_name(unit)
        known = {v.name.decode(): v.reference for v in execution.slave_variables(index)}
        places.append((index, [known[f"quaternion[{k}]"] for k in (1, 2, 3, 4)]))
    rows = []
    for _ in range(STEPS):
        assert execution.step(), execution.status()
        rows.append([x for place in places for x in observer.last_real_values(*place)])
    return np.array(rows)


def by_simulators() -> np.ndarray:
    """Run the same loop in Python: every unit steps with what the others said before."""
    from controller import control

    satellite, navigator, torque = rbfmu.Simulator(SATELLITE), rbfmu.Simulator(NAVIGATOR), [0.0, 0.0, 0.0]
    rows = []
    for _ in range(STEPS):
        omega, attitude, held = satellite.omega_b, navigator.quaternion, torque
        satellite.step(STEP, torque_b=held)
        navigator.step(STEP, omega_b=omega)
        torque = control(attitude.tolist(), omega.tolist())
        rows.append([*satellite.quaternion, *navigator.quaternion])
    return np.array(rows)


def main(kind: str = "python") -> float:
    """Print the errors of pointing and of navigation, and the largest difference to simulators in Python; return it."""
    with tempfile.TemporaryDirectory() as folder:
        build(Path(folder), kind)
        rows = through_libcosim(Path(folder))
    pointing = np.degrees(rbfmu.angle_between(rows[:, :4], [1.0, 0.0, 0.0, 0.0]))
    navigation = np.degrees(rbfmu.angle_between(rows[:, :4], rows[:, 4:]))
    for k in range(STEPS // 6 - 1, STEPS, STEPS // 6):
        print(f"t = {(k + 1) * STEP:4.1f} s: {pointing[k]:8.4f} deg off, of which navigation {navigation[k]:.4f} deg")
    difference = float(np.max(np.abs(rows - by_simulators())))
    print(f"largest difference to simulators in Python: {difference}")
    return difference


if __name__ == "__main__":
    main(*sys.argv[1:])
