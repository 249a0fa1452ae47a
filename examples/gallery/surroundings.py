"""What the gallery's scenes meet: other units that drive their ports, and what others saw of them."""

import math
from collections.abc import Callable
from datetime import datetime
from typing import Any

import numpy as np

import rbfmu
from rbfmu.runs.plan import filled_buffer, initialize

DAY = 86400.0
Law = Callable[[float, dict[str, Any]], dict[str, Any]]


def with_step(scene: rbfmu.Scene, step: float) -> rbfmu.Scene:
    """Return the same with another communication step, s."""
    tables = scene.to_dict()
    tables["run"]["step"] = step
    return rbfmu.Scene.from_dict(tables, scene.name)


def driven(scene: rbfmu.Scene, law: Law) -> tuple[Any, dict[str, Any]]:
    """Return times (n,) and quantities (n, k) where another unit sets the ports at the start of each step."""
    planned = rbfmu.plan(scene)
    unit, z, run = planned.kernels, filled_buffer(scene, planned), scene.run
    initialize(scene, unit, z)
    time = np.arange(round((run.stop - run.start) / run.step) + 1) * run.step
    rows = []
    for t in time:
        rows.append({name: z[unit.BLOCKS[name]].copy() for name in scene.outputs.quantities})
        for port, value in law(t, rows[-1]).items():
            z[unit.BLOCKS[port]] = value
        assert unit.step(z, run.step) == 0
    return time, {name: np.array([row[name] for row in rows]) for name in scene.outputs.quantities}


CONE, CONING = math.radians(1.0), 2.0 * math.pi * 10.0
"""Half angle, rad, and rate, rad/s, of the cone that the gyro is taken through."""


def coning_attitude(t: float) -> Any:
    """Return the true attitude: tilted by CONE about an axis that goes round the horizon."""
    return rbfmu.quaternion_from_rotvec(CONE * np.array([math.cos(CONING * t), math.sin(CONING * t), 0.0]))


def mean_rates(t: float, h: float) -> Any:
    """Return what a rate-integrating gyro reports for a step from t to t + h: exact mean body rates."""
    sine, lag = math.sin(CONE), CONING * (t + h)
    chord = np.array([math.cos(lag) - math.cos(CONING * t), math.sin(lag) - math.sin(CONING * t)]) / h
    return np.array([*(sine * chord), -CONING * (1.0 - math.cos(CONE))])


def coning_drift(t: Any, h: float) -> Any:
    """Return the classical formula for what mean rates over steps of h lose while a gyro cones, rad."""
    turn = CONING * h
    return 0.5 * CONING * math.sin(CONE) ** 2 * (1.0 - math.sin(turn) / turn) * t


def control(now: dict[str, Any]) -> Any:
    """Return the torque of examples/04_controlled.py's PD law."""
    q, omega = now["quaternion"], now["omega_b"]
    return -0.4 * math.copysign(1.0, q[0]) * q[1:] - 1.2 * omega


HEAVE, HEAVE_DAMPING = 1025.0 * 9.81 * 1300.0, 2.0e6
ROLL, ROLL_DAMPING = 4.0e6 * 9.81 * 0.5, 1.0e7
SWELL, SWELL_RATE = 1.0, 2.0 * math.pi / 9.0
"""Water: N/m, N s/m; N m, N m s; a swell of 1 m every 9 s."""


def water(t: float, now: dict[str, Any]) -> dict[str, Any]:
    """Buoyancy at the waterline and the righting torque about x; a swell lifts the water and tilts it."""
    level, slope = SWELL * math.sin(SWELL_RATE * t), SWELL * SWELL_RATE**2 / 9.81 * math.cos(SWELL_RATE * t)
    lift = 4.0e6 * 9.81 + HEAVE * (level - now["position"][2]) - HEAVE_DAMPING * now["velocity"][2]
    return {
        "force_a": (0.0, 0.0, lift),
        "torque_b": (ROLL * (slope - now["rpy"][0]) - ROLL_DAMPING * now["omega_b"][0], 0.0, 0.0),
    }


EPOCH = datetime(1992, 11, 9, 17, 49, 47)
RADAR = (
    ("1992-12-02 21:40", (122.2, 86.5, 107.0), (-35.6, 7.2, -97.0)),
    ("1992-12-03 19:30", (86.3, 81.8, 24.5), (-16.4, -29.1, -91.9)),
    ("1992-12-04 18:10", (47.8, 60.7, 284.0), (29.1, -23.2, -97.8)),
    ("1992-12-05 18:50", (14.6, 39.4, 207.1), (33.3, 8.2, -92.2)),
    ("1992-12-06 17:30", (331.3, 23.7, 151.6), (6.6, 34.5, -95.8)),
    ("1992-12-07 17:20", (222.5, 25.4, 143.9), (12.8, 25.4, -104.1)),
    ("1992-12-08 16:40", (169.8, 45.5, 106.9), (-31.1, -21.9, -97.7)),
    ("1992-12-09 17:50", (137.3, 71.3, 22.3), (11.8, -36.9, -94.9)),
    ("1992-12-10 17:20", (103.1, 85.2, 292.6), (35.8, -8.9, -97.9)),
    ("1992-12-11 09:40", (77.0, 85.7, 225.5), (31.0, 17.0, -96.3)),
    ("1992-12-12 09:20", (42.8, 70.2, 133.2), (-1.3, 37.0, -95.9)),
    ("1992-12-13 08:10", (13.7, 44.4, 51.9), (-38.3, 17.9, -97.3)),
    ("1992-12-14 07:50", (323.7, 14.0, 0.0), (-70.5, -30.6, -91.1)),
    ("1992-12-15 07:50", (193.2, 24.4, 21.4), (22.1, -26.6, -96.6)),
    ("1992-12-16 07:10", (165.1, 46.4, 310.6), (33.4, -3.4, -93.7)),
    ("1992-12-17 06:49", (130.6, 76.1, 234.9), (12.6, 33.9, -94.0)),
    ("1992-12-18 07:09", (91.6, 81.6, 142.4), (-24.3, 29.6, -102.0)),
)
"""Date (UTC), 3-1-3 angles, degrees, and body rates, degrees a day, from radar: table in Takahashi et al. (2013)."""


def days_since_epoch(date: str) -> float:
    """Of a date in UTC."""
    return (datetime.fromisoformat(date) - EPOCH).total_seconds() / DAY
