"""Ten thousand releases of a satellite that detumbles by its coils: a controller in the ensemble's compiled loop."""

import sys
from pathlib import Path

import numpy as np
from numba import njit

import rbfmu

SCENE = Path(__file__).with_name("b_dot.toml")
PICTURE = Path("releases.png")
STEP, NOISE, MOST, GAIN = 3.0, 3e-7, 0.1, 1.1e4
"""The step, s; the magnetometer's noise, T; the coils' largest dipole, A m2; dipole over dB/dt, A m2 s/T."""
SLOW = 0.5
"""deg/s"""


@njit
def b_dot(t, outputs, state, inputs, noise):
    """Set the coils against the change of the field between two measurements; the first has none before it."""
    for j in range(3):
        field = outputs[3 + j] + NOISE * noise[j]  # after omega_b
        change = (field - state[j]) / STEP if t > 0.0 else 0.0
        inputs[j] = min(max(-GAIN * change, -MOST), MOST)
        state[j] = field


CONTROLLER = rbfmu.Controller(b_dot, state=[0.0, 0.0, 0.0], noise=3)


def main(runs: int | None = None) -> None:
    """Run them on all processors, or fewer runs, draw them, and print how they end."""
    found = rbfmu.run_ensemble(SCENE, runs=runs, controller=CONTROLLER)
    rates = found.final["rate"]
    print(f"{found.runs} runs, {len(found.failed)} failed")
    print(f"rates at the end: median {np.median(rates):.4f} deg/s, 99 % below {np.quantile(rates, 0.99):.4f} deg/s")
    print(f"slower than {SLOW} deg/s: {100.0 * np.mean(rates < SLOW):.1f} %")
    drivers = found.drivers()
    ranks = drivers.correlations[:, drivers.ends.index("rate")] if "rate" in drivers.ends else np.empty(0)
    for k in np.argsort(-np.abs(ranks))[:3]:
        print(f"rank correlation of the rate with {drivers.varied[k]}: {ranks[k]:.2f}")
    found.plot(PICTURE)
    print(PICTURE)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
