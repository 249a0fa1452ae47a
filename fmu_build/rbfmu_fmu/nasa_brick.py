"""NASA's tumbling brick: figures of two of its simulations, and the errors of a motion against them.

NASA/TM-2015-218675, "Check-Cases for Verification of 6-Degree-of-Freedom Flight Vehicle Simulations", atmospheric
case 2 (tumbling brick, no damping). Simulations 01 and 04 agree with Euler's equations to their printed digits.
"""

import csv
from itertools import groupby
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rbfmu_kernels.compile.tiered import evaluated
from rbfmu_kernels.rotations.euler_angles import ZYX, euler_from_quaternion, quaternion_from_euler
from rbfmu_kernels.rotations.quaternion import angle_between, compose_quaternions
from rbfmu_kernels.types import Quaternion

Array = NDArray[np.float64]

EARTH_RATE = 7.292115e-5
"""rad/s: the earth turns under the brick, about the north axis of the local frame at the equator."""


def _nasa() -> dict[str, tuple[tuple[float, ...], ...]]:
    """Return the figures of nasa_brick.csv by simulation: time, three rates, three angles a row."""
    with Path(__file__).with_suffix(".csv").open(newline="", encoding="ascii") as file:
        _, *rows = csv.reader(line for line in file if not line.startswith("#"))
    return {name: tuple(tuple(map(float, row[1:])) for row in found) for name, found in groupby(rows, lambda r: r[0])}


NASA = _nasa()


def errors(simulation: str, time: Array, q_ab: Array, omega_b: Array) -> list[tuple[float, float, float]]:
    """Return (time in s, largest rate error in deg/s, attitude error in deg) at NASA's times that the motion passes."""
    found = []
    for row in NASA[simulation]:
        k = int(np.argmin(np.abs(time - row[0])))
        if abs(time[k] - row[0]) < 1e-9:
            rate = float(np.max(np.abs(np.degrees(omega_b[k]) - row[1:4])))
            yaw, pitch, roll = np.radians(row[4:7]).tolist()
            q_nb = evaluated(quaternion_from_euler, ZYX, (yaw, pitch, roll))
            (local,) = _local_attitudes(np.array([row[0]]), q_ab[k : k + 1])
            found.append((row[0], rate, float(np.degrees(evaluated(angle_between, local, q_nb)))))
    return found


def local_angles(time: Array, q_ab: Array) -> Array:
    """Return yaw, pitch and roll, rad, relative to north-east-down: frame a is that at time 0, which does not turn."""
    return np.array([evaluated(euler_from_quaternion, ZYX, q) for q in _local_attitudes(time, q_ab)])


def _local_attitudes(time: Array, q_ab: Array) -> list[Quaternion]:
    half = 0.5 * EARTH_RATE * time
    q_na = np.stack([np.cos(half), -np.sin(half), 0.0 * half, 0.0 * half], axis=-1)
    return [evaluated(compose_quaternions, *both) for both in zip(q_na.tolist(), q_ab.tolist(), strict=True)]
