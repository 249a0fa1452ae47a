"""How far a tumbling body's attitude is known: a covariance carried along, beside a hundred thousand bodies.

It needs SciPy: `pip install ".[ensemble]"`.
"""

import sys

import numpy as np

import rbfmu

RATE, MOMENT = 1e-3, 2e-3
"""Standard deviations: of each rate at the start, rad/s, and of each moment, over its value."""
MOMENTS = np.array([1.0, 2.0, 2.5])
TABLES = {
    "name": "known_tumble",
    "body": {"mass": 1.0, "inertia": MOMENTS.tolist()},
    "outputs": {"quantities": ["quaternion"]},
    "run": {"stop": 60.0, "step": 5.0},
}
SPINS = {"beside all axes": [0.4, 0.9, 0.5], "about the middle axis": [0.0, 1.0, 0.02]}


def scene_of(omega_b: list[float], runs: int) -> rbfmu.Scene:
    """Return the body with this rate, and an ensemble of rates and moments about it."""
    vary = {
        "initial.omega_b": {"normal": [omega_b, [RATE] * 3]},
        "body.inertia": {"normal": [MOMENTS.tolist(), (MOMENT * MOMENTS).tolist()]},
    }
    ensemble = {"runs": runs, "seed": 4, "keep": ["statistics"], "vary": vary}
    return rbfmu.Scene.from_dict(TABLES | {"initial": {"omega_b": omega_b}, "ensemble": ensemble})


def main(runs: int = 100_000) -> None:
    """Print the standard deviation of the attitude over time, rad, by both ways."""
    if runs < 2:
        sys.exit(f"{runs} runs: expected at least 2, as one alone has no standard deviation")
    for name, omega_b in SPINS.items():
        scene = scene_of(omega_b, runs)
        covariance = np.diag(np.append([RATE] * 3, MOMENT * MOMENTS) ** 2)
        near = rbfmu.sensitivity(scene, ["initial.omega_b", "body.inertia"], covariance=covariance)
        of_all = rbfmu.run_ensemble(scene)
        print(f"spin {name}: standard deviation of the attitude, rad")
        print("   t (s)   carried along   of the bodies")
        for k in (2, 6, 12):
            carried, drawn = (
                np.sqrt(np.trace(C[k])) for C in (near.covariance["attitude"], of_all.covariance["quaternion"])
            )
            print(f"   {near.time[k]:5.0f}   {carried:13.5f}   {drawn:13.5f}")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
