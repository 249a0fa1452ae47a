"""A satellite turned with the least torque: SciPy on derivatives of the motion, checked by an FMU.

It needs SciPy: `pip install scipy`, or `pip install "rbfmu[bench]"`.
"""

from pathlib import Path

import fmpy
import numpy as np

import rbfmu
import rbfmu_fmu
from rbfmu.extras import needed_of

with needed_of("bench"):
    from scipy.optimize import minimize

T, ORDER = 20.0, 5
"""The time of the turn, s, and the degree of the torque's polynomials, in Bernstein's form."""
TARGET = rbfmu.quaternion_from_rotvec([0.9, -1.2, 1.5])
NAMES = [f"c{k}" for k in range(ORDER + 1)]
TERMS = (f"{[1, 5, 10, 10, 5, 1][k]}*c{k}*s**{k}*(1 - s)**{ORDER - k}" for k in range(ORDER + 1))
SATELLITE = rbfmu.Scene.from_dict(
    {
        "name": "slew",
        "body": {"mass": 50.0, "inertia": [[4.0, 0.5, -0.2], [0.5, 5.0, 0.3], [-0.2, 0.3, 2.0]]},
        "constants": {name: [0.1, -0.1, 0.1] for name in NAMES},
        "formulas": {"s": f"t/{T}", "torque": " + ".join(TERMS)},
        "loads": {"torque_b": "torque"},
        "states": {"effort": {"start": 0.0, "rate": "dot(torque, torque)", "unit": "N2 m2 s"}},
        "outputs": {"quantities": ["quaternion", "omega_b"], "spent": "effort"},
        "run": {"stop": T, "step": 1.0, "accuracy": 1e-10},
    }
)


def with_torque(x: np.ndarray) -> rbfmu.Scene:
    """Return the scene whose torque has these coefficients."""
    rows = x.reshape(-1, 3).tolist()
    return SATELLITE.replace({f"constants.{name}": row for name, row in zip(NAMES, rows, strict=True)})


class Turn:
    """Effort and what is left at the end (a turn in b and rates), with their slopes, once for each x."""

    def __init__(self) -> None:
        self.x, self.runs = np.array([]), 0

    def at(self, x: np.ndarray) -> "Turn":
        """Return itself, once it knows x."""
        if not np.array_equal(x, self.x):
            found = rbfmu.sensitivity(with_torque(x), [f"constants.{name}" for name in NAMES])
            error = rbfmu.attitude_error(TARGET, found.values["quaternion"][-1])
            by_turn = rbfmu.rotvec_rate_b(rbfmu.rotvec_from_quaternion(error), np.eye(3)).T
            self.effort, self.effort_slopes = float(found.values["spent"][-1, 0]), found.of["spent"][-1, 0]
            self.left = np.append(rbfmu.rotvec_from_quaternion(error), found.values["omega_b"][-1])
            self.slopes = np.vstack([by_turn @ found.of["attitude"][-1], found.of["omega_b"][-1]])
            self.x, self.runs = x.copy(), self.runs + 1
        return self


def about_one_axis() -> np.ndarray:
    """Return the coefficients of the torque that turns about one axis, but for gyroscopic terms."""
    u = rbfmu.rotvec_from_quaternion(TARGET)
    most = 6.0 / T**2 * np.array(SATELLITE.body.inertia) @ u
    return np.concatenate([most * (1.0 - 2.0 * k / ORDER) for k in range(ORDER + 1)])


def main() -> None:
    """Find the torque, and print what it takes, in Python and in FMPy."""
    turn, begin = Turn(), about_one_axis()
    first = turn.at(begin).effort
    print(f"about one axis: {first:.6f} N2 m2 s, {np.degrees(np.linalg.norm(turn.left[:3])):.2f} deg off at the end")
    ends = {"type": "eq", "fun": lambda x: turn.at(x).left, "jac": lambda x: turn.at(x).slopes}
    found = minimize(
        lambda x: turn.at(x).effort / first, begin, jac=lambda x: turn.at(x).effort_slopes / first, constraints=ends,
        method="SLSQP", options={"maxiter": 100, "ftol": 1e-12},
    )  # fmt: skip
    best = with_torque(found.x)
    off = np.degrees(np.linalg.norm(turn.at(found.x).left[:3]))
    print(f"least torque:   {turn.effort:.6f} N2 m2 s, {off:.1e} deg off, after {turn.runs} runs with derivatives")
    fmu = rbfmu_fmu.build(best, Path("slew.fmu"))
    rows = fmpy.simulate_fmu(str(fmu), stop_time=T, output_interval=1.0)
    q_ab = np.array([rows[f"quaternion[{k}]"][-1] for k in range(1, 5)])
    print(
        f"in FMPy:        {rows['spent'][-1]:.6f} N2 m2 s, {np.degrees(rbfmu.angle_between(q_ab, TARGET)):.1e} deg off"
    )


if __name__ == "__main__":
    main()
