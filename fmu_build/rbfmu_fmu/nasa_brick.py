"""NASA's tumbling brick: figures of two of its simulations, and the errors of a motion against them.

NASA/TM-2015-218675, "Check-Cases for Verification of 6-Degree-of-Freedom Flight Vehicle Simulations", atmospheric
case 2 (tumbling brick, no damping). Simulations 01 and 04 agree with Euler's equations to their printed digits.
"""

import numpy as np
from numpy.typing import NDArray

from rbfmu_kernels.compile.tiered import evaluated
from rbfmu_kernels.rotations.euler_angles import ZYX, euler_from_quaternion, quaternion_from_euler
from rbfmu_kernels.rotations.quaternion import angle_between, compose_quaternions
from rbfmu_kernels.types import Quaternion

Array = NDArray[np.float64]

EARTH_RATE = 7.292115e-5
"""rad/s: the earth turns under the brick, about the north axis of the local frame at the equator."""

# time s; body rates p, q, r relative to inertial space deg/s; yaw, pitch, roll relative to local north-east-down deg
NASA = {
    "01": (
        (1.0, 4.25884189865367, 23.119942897440833, 28.379817775030197,
         31.776473202031973, 18.689409988218724, 12.589994847023751),
        (5.0, -16.939485149392073, 9.631939377436426, 33.40662807936806,
         -177.78628843984006, 2.2243792141100465, 43.87923909163861),
        (10.0, -2.41890222177841, -23.55256951951579, 28.12859263003343,
         -4.321336367926564, 3.7413374738658383, -66.01900324375518),
        (15.0, 18.43725431358227, 2.386880298914253, 34.31070561161288,
         171.03042400021664, -9.133426717716462, 34.03745632334572),
        (20.0, -5.422734679890159, 22.715930576502963, 28.608281747225586,
         -6.3696938240052745, 4.059829768024102, 4.1383179964505),
        (25.0, -15.184088701189102, -13.61779950029914, 32.416796198407226,
         175.26125552644683, 5.380257101802712, 10.523078488134617),
        (30.0, 12.61839077566776, -17.3974747618308, 31.11958888682995,
         -4.289355039311268, -3.81965492049295, -56.151307596646866),
    ),
    "04": (
        (1.0, 4.25884189866, 23.1199428975, 28.3798177751,
         31.776473202, 18.689409988, 12.5899948471),
        (5.0, -16.9394851494, 9.63193937745, 33.4066280795,
         -177.786288441, 2.22437921439, 43.8792390909),
        (10.0, -2.41890222177, -23.5525695195, 28.12859263,
         -4.32133636889, 3.74133747365, -66.0190032425),
        (15.0, 18.4372543136, 2.38688029893, 34.3107056116,
         171.030423999, -9.13342671737, 34.0374563219),
        (20.0, -5.42273467991, 22.7159305765, 28.6082817473,
         -6.36969382585, 4.05982976745, 4.13831799799),
        (25.0, -15.1840887012, -13.6177995003, 32.4167961985,
         175.261255524, 5.3802571028, 10.523078486),
        (30.0, 12.6183907757, -17.3974747619, 31.1195888868,
         -4.28935504226, -3.81965492189, -56.1513075938),
    ),
}  # fmt: skip


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
