"""Ten thousand releases of a satellite that detumbles: how slow they are in the end, and what that hangs on."""

from pathlib import Path

import numpy as np

import rbfmu

SCENE = Path(__file__).with_name("detumbling.toml")
PICTURE = Path("detumbling.png")
SLOW = 0.5
"""deg/s"""


def main() -> float:
    """Run them on all processors, draw them, and return which part of them turns slower than `SLOW` in the end."""
    found = rbfmu.run_ensemble(SCENE)
    rates = np.degrees(np.linalg.norm(found.final["omega_b"], axis=1))
    print(f"{found.runs} runs, {len(found.failed)} failed")
    print(f"rates at the end: median {np.median(rates):.4f} deg/s, 99 % below {np.quantile(rates, 0.99):.4f} deg/s")
    slow = float(np.mean(rates < SLOW))
    print(f"slower than {SLOW} deg/s: {100.0 * slow:.1f} %")
    mean, std = found.at_end("kinetic_energy")
    print(f"kinetic energy at the end: mean {mean[0]:.3e} J, standard deviation {std[0]:.3e} J")
    drivers = found.drivers()
    ranks = drivers.correlations[:, drivers.ends.index("kinetic_energy")]
    for k in np.argsort(-np.abs(ranks))[:3]:
        print(f"rank correlation of the energy with {drivers.varied[k]}: {ranks[k]:.2f}")
    found.plot(PICTURE)
    print(PICTURE)
    return slow


if __name__ == "__main__":
    main()
