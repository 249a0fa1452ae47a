"""Two FMUs of rbfmu in PyFMI's Master: held inputs, an algebraic loop, error control that goes back.

`python -m examples.interop.pyfmi_master FOLDER build` writes the FMUs, with rbfmu's Python. PyFMI may have a Python of
its own: `python pyfmi_master.py FOLDER run` needs PyFMI alone, and writes what it saw. `... FOLDER compare`, with
rbfmu's again, compares with two simulators and with the exact solution of the loop.
"""

import json
import sys
from pathlib import Path

STEP, STEPS = 0.125, 80
STOP = STEP * STEPS
TOLERANCE = 1e-6
TORQUE = 0.6
"""N m: the known torque of the loop's first body, about z."""
MOMENT_1, MOMENT_2 = 3.0, 2.0
"""kg m2, about z. In the algebraic loop torque_1 = alpha_2 and torque_2 = alpha_1 (N m, rad/s2), both at once; in the
other torque_1 = omega_2 and torque_2 = omega_1 (N m, rad/s), which inputs that are held follow to first order only."""


def build(folder: Path) -> None:
    """Write the FMUs."""
    import rbfmu_fmu

    for name, scene in scenes().items():
        rbfmu_fmu.build(scene, folder / f"{name}.fmu", kind="native")


def scenes() -> dict:
    """Return a satellite whose rates a navigator gets, and two bodies that get each other's angular acceleration."""
    import rbfmu

    run = {"stop": STOP, "step": STEP, "accuracy": 1e-9}
    tables = {
        "satellite": {"body": {"mass": 50.0, "inertia": [1.0, 2.0, 3.0]}, "initial": {"omega_b": [0.1, -0.2, 0.15]},
                      "outputs": {"quantities": ["quaternion", "omega_b"]}},
        "navigator": {"inputs": {"ports": ["omega_b"]}, "outputs": {"quantities": ["quaternion"]}},
        **{name: {"body": {"mass": 1.0, "inertia": [moment, moment, moment]}, "inputs": {"ports": ["torque_b"]},
                  "loads": {"torque_b": [0.0, 0.0, torque]}, "outputs": {"quantities": ["omega_b", "alpha_b"]}}
           for name, moment, torque in (("first", MOMENT_1, TORQUE), ("second", MOMENT_2, 0.0))},
    }  # fmt: skip
    return {name: rbfmu.Scene.from_dict({"name": name, "run": run} | table) for name, table in tables.items()}


def run(folder: Path) -> None:
    """Run both systems in PyFMI's Master."""
    found = {
        "held": _mastered(folder, "satellite", "navigator", NAVIGATION, "quaternion", error_controlled=False),
        "loop": _mastered(folder, "first", "second", ALGEBRAIC, "omega_b", error_controlled=False),
        "fixed": _mastered(folder, "first", "second", COUPLED, "omega_b", error_controlled=False),
        "controlled": _mastered(folder, "first", "second", COUPLED, "omega_b", error_controlled=True),
    }
    (folder / "seen.json").write_text(json.dumps(found))


NAVIGATION = [(0, f"omega_b[{k}]", 1, f"omega_b[{k}]") for k in (1, 2, 3)]
ALGEBRAIC = [(0, "alpha_b[3]", 1, "torque_b[3]"), (1, "alpha_b[3]", 0, "torque_b[3]")]
COUPLED = [(0, "omega_b[3]", 1, "torque_b[3]"), (1, "omega_b[3]", 0, "torque_b[3]")]


def _mastered(folder: Path, one: str, other: str, connections: list, shown: str, error_controlled: bool) -> dict:
    """Return times, and a quantity of both units."""
    from pyfmi import load_fmu
    from pyfmi.master import Master

    units = [load_fmu(str(folder / f"{name}.fmu"), log_level=0) for name in (one, other)]
    master = Master(units, [(units[a], x, units[b], y) for a, x, b, y in connections])
    options = master.simulate_options()
    options |= {"step_size": STEP, "error_controlled": error_controlled, "extrapolation_order": 0}
    options |= {"linear_correction": False, "rtol": TOLERANCE, "atol": TOLERANCE, "result_handling": "memory"}
    result = master.simulate(start_time=0.0, final_time=STOP, options=options)
    size = 4 if shown == "quaternion" else 3
    numbers = {
        k: [[float(x) for x in result[u][f"{shown}[{i + 1}]"]] for i in range(size)] for k, u in enumerate(units)
    }
    return {"time": [float(t) for t in result[units[0]]["time"]], "first": numbers[0], "second": numbers[1]}


def compare(folder: Path) -> dict:
    """Print the differences; return them."""
    import numpy as np

    import rbfmu

    seen = json.loads((folder / "seen.json").read_text())
    made = scenes()
    satellite, navigator, rows = rbfmu.Simulator(made["satellite"]), rbfmu.Simulator(made["navigator"]), []
    for _ in range(STEPS):
        rates = satellite.omega_b
        satellite.step()
        navigator.step(omega_b=rates)
        rows.append([*satellite.quaternion, *navigator.quaternion])
    held = np.array(seen["held"]["first"] + seen["held"]["second"]).T[1:]
    found = {"held inputs, to two simulators": float(np.max(np.abs(held - np.array(rows))))}
    alpha = TORQUE / (MOMENT_1 - 1.0 / MOMENT_2)
    time, rate = np.array(seen["loop"]["time"]), np.array(seen["loop"]["first"][2])
    found["algebraic loop, to its exact solution (rad/s)"] = float(np.max(np.abs(rate - alpha * time)))
    s = 1.0 / np.sqrt(MOMENT_1 * MOMENT_2)  # omega_1' = (torque + omega_2) / M_1, omega_2' = omega_1 / M_2
    for name in ("fixed", "controlled"):
        time, rate = np.array(seen[name]["time"]), np.array(seen[name]["first"][2])
        exact = TORQUE / (MOMENT_1 * s) * np.sinh(s * time)
        found[f"{name} steps, error relative to the largest rate"] = float(np.max(np.abs(rate - exact)) / exact[-1])
        print(f"{name} steps: {len(time) - 1}")
    for name, value in found.items():
        print(f"{name}: {value:.3g}")
    return found


if __name__ == "__main__":
    {"build": build, "run": run, "compare": compare}[sys.argv[2]](Path(sys.argv[1]))
