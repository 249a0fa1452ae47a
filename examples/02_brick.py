"""A scene from a file: planned, simulated, and compared with a figure that NASA published."""

from pathlib import Path

import numpy as np

import rbfmu

SCENE = Path(__file__).parent / "scenes" / "tumbling_brick.toml"


def main() -> None:
    """Print the rates after 30 s beside NASA's."""
    scene = rbfmu.load_scene(SCENE)
    planned = rbfmu.plan(scene)
    print(f"{scene.name}: {planned.model}, {planned.method}", *planned.reasons, sep="\n  ")
    result = rbfmu.simulate(scene)
    # NASA/TM-2015-218675, atmospheric case 2, simulation 01, t = 30 s
    nasa = np.array([12.61839077566776, -17.3974747618308, 31.11958888682995])
    rates = np.degrees(result.omega_b[-1])
    print("body rates after 30 s (deg/s):", rates)
    print("NASA's:                       ", nasa)
    print(f"largest difference: {np.max(np.abs(rates - nasa)):.1e} deg/s")


if __name__ == "__main__":
    main()
