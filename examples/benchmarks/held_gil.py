"""What holding the GIL saves a host without Python.

A step of the pythonfmu FMU with RBFMU_HOLD_GIL=1 and without.

The host is the tests' own (fmu_host.c). `python -m examples.benchmarks.held_gil` prints the ratio and exits with status
1 where the goal is missed.
"""

import tempfile
from pathlib import Path

from examples.benchmarks.support.goals import Goal, status
from tests.support.fmu import c_host

MOST = 0.7
"""Largest ratio."""


def main(rounds: int = 3, repeats: int = 2000) -> float:
    """Print ns per step, the least of rounds in turn; the ratio of held to not held."""
    least = {"0": float("inf"), "1": float("inf")}
    with tempfile.TemporaryDirectory() as folder:
        for _ in range(rounds):
            for held in least:
                found = c_host.run_c_host(Path(folder), "two_ports", 1, repeats, RBFMU_HOLD_GIL=held)[1]
                least[held] = min(least[held], found)
    print(f"ns per step: {least['0']:.0f}, with the GIL held {least['1']:.0f}")
    return least["1"] / least["0"]


def goals(ratio: float) -> list[Goal]:
    """Of what `main` returns."""
    return [Goal("held / not held", ratio, most=MOST)]


if __name__ == "__main__":
    raise SystemExit(status(goals(main())))
