"""Two FMUs that libcosim connects by a group of variables, and the same by two Simulators; the same bits.

A satellite's rates, as one group, go into a navigator that adds them up to an attitude. The groups stand in each FMU's
OspModelDescription, which libcosim wants beside the FMU. It needs libcosimpy: `pip install "rbfmu[interop]"`.
"""

import sys
import tempfile
import zipfile
from pathlib import Path

import numpy as np

import rbfmu
import rbfmu_fmu
from rbfmu.extras import needed_of

with needed_of("interop"):
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
    from libcosimpy.CosimObserver import CosimObserver

STEP, STEPS = 0.125, 480
SATELLITE = rbfmu.Scene.from_dict(
    {
        "name": "satellite",
        "body": {"mass": 50.0, "inertia": [1.0, 2.0, 3.0]},
        "initial": {"omega_b": [0.1, -0.2, 0.15]},
        "outputs": {"quantities": ["quaternion", "omega_b"]},
        "run": {"stop": STEP * STEPS, "step": STEP},
    }
)
NAVIGATOR = rbfmu.Scene.from_dict(
    {
        "name": "navigator",
        "inputs": {"ports": ["omega_b"]},
        "outputs": {"quantities": ["quaternion"]},
        "run": {"stop": STEP * STEPS, "step": STEP},
    }
)
SYSTEM = f"""<?xml version="1.0" encoding="UTF-8"?>
<OspSystemStructure xmlns="http://opensimulationplatform.com/MSMI/OSPSystemStructure" version="0.1">
  <BaseStepSize>{STEP}</BaseStepSize>
  <Algorithm>fixedStep</Algorithm>
  <Simulators>
    <Simulator name="satellite" source="satellite.fmu"/>
    <Simulator name="navigator" source="navigator.fmu"/>
  </Simulators>
  <Connections>
    <VariableGroupConnection>
      <VariableGroup simulator="satellite" name="omega_b"/>
      <VariableGroup simulator="navigator" name="omega_b"/>
    </VariableGroupConnection>
  </Connections>
</OspSystemStructure>
"""


def build(folder: Path, kind: str) -> None:
    """Write both FMUs, their groups beside them, and the system."""
    for scene in (SATELLITE, NAVIGATOR):
        path = rbfmu_fmu.build(scene, folder / f"{scene.name}.fmu", kind=kind)
        with zipfile.ZipFile(path) as archive:
            (groups,) = (name for name in archive.namelist() if name.endswith("_OspModelDescription.xml"))
            (folder / Path(groups).name).write_bytes(archive.read(groups))
    (folder / "OspSystemStructure.xml").write_text(SYSTEM)


def through_libcosim(folder: Path) -> np.ndarray:
    """Return the satellite's attitude and the navigator's after each step, (STEPS, 8)."""
    log_output_level(CosimLogLevel.WARNING)
    execution, observer = CosimExecution.from_osp_config_file(str(folder)), CosimObserver.create_last_value()
    execution.add_observer(observer)
    places = []
    for name in ("satellite", "navigator"):
        unit = execution.slave_index_from_instance_name(name)
        known = {v.name.decode(): v.reference for v in execution.slave_variables(unit)}
        places.append((unit, [known[f"quaternion[{k}]"] for k in (1, 2, 3, 4)]))
    rows = []
    for _ in range(STEPS):
        assert execution.step(), execution.status()
        rows.append([x for place in places for x in observer.last_real_values(*place)])
    return np.array(rows)


def by_simulators() -> np.ndarray:
    """Return the same; each step of the navigator has the rates at its beginning."""
    satellite, navigator, rows = rbfmu.Simulator(SATELLITE), rbfmu.Simulator(NAVIGATOR), []
    for _ in range(STEPS):
        rates = satellite.omega_b
        satellite.step()
        navigator.step(omega_b=rates)
        rows.append([*satellite.quaternion, *navigator.quaternion])
    return np.array(rows)


def main(kind: str = "python") -> float:
    """Print how far the navigator is off, and the largest difference to libcosim; return it."""
    rows = by_simulators()
    off = np.degrees(rbfmu.angle_between(rows[:, :4], rows[:, 4:]))
    print(f"rates held over {STEP} s: the navigator is off by {off.max():.3f} deg at most")
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as place:
        build(Path(place), kind)
        difference = float(np.max(np.abs(rows - through_libcosim(Path(place)))))
    print(f"largest difference to libcosim: {difference}")
    return difference


if __name__ == "__main__":
    main(*sys.argv[1:])
