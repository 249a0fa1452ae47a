"""Two FMUs of rbfmu in OMSimulator, by a script of Lua, and the same by two Simulators.

A satellite's rates go into a navigator. OMSimulator steps both units, then outputs become inputs; it writes 12 digits.
It must be on the path as a program: `python -m examples.interop.omsimulator`.
"""

import runpy
import shutil
import sys
import tempfile
from pathlib import Path

import numpy as np

import rbfmu_fmu
from examples.interop.importers import run, table
from examples.interop.run import to_digits

GROUPS = runpy.run_path(str(Path(__file__).parents[1] / "07_groups.py"))
SATELLITE, NAVIGATOR, STEP, STEPS = (GROUPS[name] for name in ("SATELLITE", "NAVIGATOR", "STEP", "STEPS"))
DIGITS = 12
SCRIPT = """oms_setCommandLineOption("--stripRoot=true")
oms_newModel("m")
oms_addSystem("m.root", oms_system_wc)
oms_addSubModel("m.root.satellite", "{folder}/satellite.fmu")
oms_addSubModel("m.root.navigator", "{folder}/navigator.fmu")
{connections}
oms_setResultFile("m", "{folder}/out.csv")
oms_setLoggingInterval("m", {step})
oms_setFixedStepSize("m.root", {step})
oms_setStopTime("m", {stop})
oms_instantiate("m")
oms_initialize("m")
oms_simulate("m")
oms_terminate("m")
oms_delete("m")
"""
CONNECTION = 'oms_addConnection("m.root.satellite.omega_b[{k}]", "m.root.navigator.omega_b[{k}]")'


def through_omsimulator(folder: Path) -> np.ndarray:
    """Return the satellite's attitude and the navigator's after each step, (STEPS, 8)."""
    for scene in (SATELLITE, NAVIGATOR):
        rbfmu_fmu.build(scene, folder / f"{scene.name}.fmu", kind="native")
    connections = "\n".join(CONNECTION.format(k=k) for k in (1, 2, 3))
    script = SCRIPT.format(folder=folder, connections=connections, step=STEP, stop=STEP * STEPS)
    (folder / "system.lua").write_text(script)
    printed = run("OMSimulator", f"--tempDir={folder}", folder / "system.lua")
    if "error:" in printed:
        raise RuntimeError(printed)
    names = [f"{unit}.quaternion[{k}]" for unit in ("satellite", "navigator") for k in (1, 2, 3, 4)]
    rows = {time: row for time, *row in table(folder / "out.csv", ["time", *names])}
    return np.array([row for time, row in rows.items() if time > 0.0])


def main() -> float:
    """Print the largest difference between OMSimulator and two Simulators, in the digits that it writes; return it."""
    if not shutil.which("OMSimulator"):
        sys.exit("no OMSimulator on the path")
    expected = GROUPS["by_simulators"]()
    with tempfile.TemporaryDirectory() as place:
        found = through_omsimulator(Path(place))
    difference = float(np.max(np.abs(found - to_digits(expected, DIGITS))))
    print(f"{len(found)} steps; largest difference to two Simulators in {DIGITS} digits: {difference}")
    return difference


if __name__ == "__main__":
    main()
