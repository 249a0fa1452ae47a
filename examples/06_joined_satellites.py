"""Two satellites joined by a spring: by two Simulators, and by two FMUs and a spring's in libcosim; the same bits.

libcosim steps all units at once, then outputs become inputs, so the spring's loads come one step late; the loop in
Python does the same. It needs libcosimpy: `pip install "rbfmu[interop]"`.
"""

import runpy
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from pythonfmu.builder import FmuBuilder

import rbfmu
import rbfmu_fmu
from rbfmu.extras import needed_of

with needed_of("interop"):
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
    from libcosimpy.CosimObserver import CosimObserver
    from libcosimpy.CosimSlave import CosimLocalSlave

SPRING = Path(__file__).parent / "interop" / "joined" / "spring.py"
LAW = runpy.run_path(str(SPRING))
STATE, LOADS, spring = LAW["STATE"], LAW["LOADS"], LAW["spring"]
STEP, STEPS = 0.0078125, 1280
"""A power of two, so that every clock agrees to the bit."""


def satellite(name: str, z: float, omega_b: list[float]) -> rbfmu.Scene:
    """Return a satellite at height z above the inertial frame's origin, without gravity."""
    return rbfmu.Scene.from_dict(
        {
            "name": name,
            "body": {"mass": 50.0, "inertia": [1.0, 2.0, 2.5]},
            "initial": {"position": [0.0, 0.0, z], "omega_b": omega_b},
            "loads": {"gravity_a": [0.0, 0.0, 0.0]},
            "inputs": {"ports": ["force_a", "torque_b"]},
            "outputs": {"quantities": ["position", "velocity", "quaternion", "omega_b"]},
            "run": {"stop": STEP * STEPS, "step": STEP},
        }
    )


FIRST, SECOND = satellite("first", 0.0, [0.3, 0.0, 0.1]), satellite("second", 2.5, [0.0, -0.2, 0.0])


def by_simulators() -> np.ndarray:
    """Return both positions after each step, (STEPS, 6)."""
    pair = rbfmu.Simulator(FIRST), rbfmu.Simulator(SECOND)
    loads: list[dict[str, list[float]]] = [{}, {}]
    rows = []
    for _ in range(STEPS):
        states = [{name: getattr(one, name).tolist() for name in STATE} for one in pair]
        for one, load in zip(pair, loads, strict=True):
            one.step(**load)
        loads = spring(*states)
        rows.append([*pair[0].position, *pair[1].position])
    return np.array(rows)


def through_libcosim(folder: Path, kind: str) -> np.ndarray:
    """Return the same from FMUs."""
    files = [rbfmu_fmu.build(one, folder / f"{one.name}.fmu", kind=kind) for one in (FIRST, SECOND)]
    files.append(FmuBuilder.build_FMU(SPRING, dest=folder))
    log_output_level(CosimLogLevel.WARNING)
    execution, names = CosimExecution.from_step_size(round(1e9 * STEP)), ("first", "second", "spring")
    slaves = [CosimLocalSlave(str(file), name) for file, name in zip(files, names, strict=True)]
    units = [execution.add_local_slave(slave) for slave in slaves]
    known = [{v.name.decode(): v.reference for v in execution.slave_variables(unit)} for unit in units]
    _connect(execution, units, known)
    observer = CosimObserver.create_last_value()
    execution.add_observer(observer)
    places = [[known[i][f"position[{k}]"] for k in (1, 2, 3)] for i in (0, 1)]
    rows = []
    for _ in range(STEPS):
        assert execution.step(), execution.status()
        rows.append([x for i in (0, 1) for x in observer.last_real_values(units[i], places[i])])
    return np.array(rows)


def _connect(execution: Any, units: list[int], known: list[dict[str, int]]) -> None:
    """Connect each satellite's state to the spring, and the spring's loads to it."""
    for i in (0, 1):
        for name, size in (STATE | LOADS).items():
            for k in range(1, size + 1):
                own, other = (units[i], known[i][f"{name}[{k}]"]), (units[2], known[2][f"{name}_{i + 1}[{k}]"])
                execution.connect_real_variables(*((*own, *other) if name in STATE else (*other, *own)))


def main(kind: str = "python") -> float:
    """Print distance and centre of mass, and the largest difference to libcosim; return it."""
    rows = by_simulators()
    distance = np.linalg.norm(rows[:, 3:] - rows[:, :3], axis=1)
    for k in range(STEPS // 5 - 1, STEPS, STEPS // 5):
        print(f"t = {STEP * (k + 1):4.1f} s: {distance[k]:.6f} m apart")
    start = np.add(FIRST.initial.position, SECOND.initial.position)
    print(f"the centre of mass moved by {np.max(np.abs(rows[:, :3] + rows[:, 3:] - start)) / 2.0:.1e} m")
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        difference = float(np.max(np.abs(rows - through_libcosim(Path(folder), kind))))
    print(f"largest difference to libcosim: {difference}")
    return difference


if __name__ == "__main__":
    main(*sys.argv[1:])
