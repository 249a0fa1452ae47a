"""The lecture's slender beam as a pendulum on its end: the period of small swings against the analytic one."""

from pathlib import Path

import numpy as np

import rbfmu

SCENE = Path(__file__).parent / "scenes" / "beam_pendulum.toml"


def period(time: np.ndarray, rate: np.ndarray) -> float:
    """Mean period from the upward zero crossings of a rate, found by linear interpolation."""
    up = np.flatnonzero((rate[:-1] < 0.0) & (rate[1:] >= 0.0))
    crossings = time[up] - rate[up] * (time[up + 1] - time[up]) / (rate[up + 1] - rate[up])
    return float(np.mean(np.diff(crossings)))


def main() -> float:
    """Print both periods and return their relative difference."""
    scene = rbfmu.load_scene(SCENE)
    result = rbfmu.simulate(scene)
    length = 2.0 * scene.body.r_oc_b[0]
    # About the end: M_o = m l^2/12 + m (l/2)^2 = m l^2/3, so T = 2 pi sqrt(2 l / (3 g)).
    analytic = 2.0 * np.pi * np.sqrt(2.0 * length / (3.0 * -scene.loads.gravity_a[2]))
    measured = period(result.time, result.omega_b[:, 1])
    print(f"period of the simulated beam: {measured:.7f} s")
    print(f"2 pi sqrt(2 l / (3 g)):       {analytic:.7f} s")
    found, theory = measured / analytic - 1.0, np.radians(0.1) ** 2 / 16.0
    print(f"relative difference: {found:.1e} (theory for this swing: {theory:.1e})")
    return found


if __name__ == "__main__":
    main()
