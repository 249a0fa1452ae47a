"""What a step of a Simulator costs from Python, beside a bare call of the compiled step.

A loop sets one port and reads two quantities, as a controller does. `python -m examples.benchmarks.stepping` prints
both, and exits with status 1 where the goal is missed.
"""

from collections.abc import Callable
from pathlib import Path
from time import perf_counter

import rbfmu
from examples.benchmarks.support.goals import Goal, status

SCENE = Path(__file__).parents[1] / "scenes" / "controlled_satellite.toml"
MOST = 3.0
"""Microseconds a step."""


def seconds(run: Callable[[int], None], steps: int) -> float:
    """Return the time of a loop, s a step."""
    begin = perf_counter()
    run(steps)
    return (perf_counter() - begin) / steps


def main(rounds: int = 9, steps: int = 50_000) -> dict[str, float]:
    """Print and return seconds a step of a Simulator and of the compiled step alone, the least of rounds in turn."""
    scene = rbfmu.load_scene(SCENE)
    step, z = rbfmu.compiled_step(scene)
    satellite, h, torque = rbfmu.Simulator(scene), scene.run.step, (0.0, 0.0, 0.0)

    def stepped(n: int) -> None:
        for _ in range(n):
            satellite.step(torque_b=torque)
            satellite.quaternion, satellite.omega_b  # noqa: B018

    def bare(n: int) -> None:
        for _ in range(n):
            step(z, h)

    times = [[seconds(run, steps) for run in (stepped, bare)] for _ in range(rounds)]
    least = [min(column) for column in zip(*times, strict=True)]
    print(f"Simulator {1e6 * least[0]:.2f} us a step with a port set and two quantities read")
    print(f"bare call of the compiled step {1e6 * least[1]:.2f} us: ratio {least[0] / least[1]:.2f}")
    return {"stepped": least[0], "bare": least[1]}


def goals(figures: dict[str, float]) -> list[Goal]:
    """Of what `main` returns."""
    return [Goal("microseconds a step of a Simulator", 1e6 * figures["stepped"], most=MOST)]


if __name__ == "__main__":
    raise SystemExit(status(goals(main())))
