"""The motion of a scene's body in quadruple precision, compiled by this machine's C compiler at first use.

Shares no code with what it judges. Every number is kept as an unevaluated sum of two doubles, (high, low).
"""

import ctypes
import hashlib
import os
import subprocess
import tempfile
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from tests.support.compilers import c_compiler

SOURCE = Path(__file__).with_name("taylor.c")
BLOCKS = {
    "mass": 1, "inertia": 6, "r_oc_b": 3, "gravity_a": 3, "damping_b": 3, "force_a": 3, "force_b": 3, "torque_a": 3,
    "torque_b": 3, "position_0": 3, "velocity_0": 3, "quaternion_0": 4, "omega_b_0": 3, "pivot": 1,
}  # fmt: skip
PORTS = ("force_a", "force_b", "torque_a", "torque_b")
QUANTITIES = {
    "position": 3, "velocity": 3, "acceleration": 3, "quaternion": 4, "rpy": 3, "omega_b": 3, "omega_a": 3,
    "alpha_b": 3, "angular_momentum_a": 3, "kinetic_energy": 1,
}  # fmt: skip
COUNT, SCALES = sum(QUANTITIES.values()), 4
MAX_SERIES = 40_000
"""Some 20 seconds of quadruple precision."""
BUILDS = {"quadruple": ("-lquadmath", "-lm"), "double": ("-DREAL=double", "-lm")}


class TooDearError(RuntimeError):
    """The motion would take too many series."""


class Truth(NamedTuple):
    """Quantities at the start and after each step, as sums of two doubles; the largest size of each on the way.

    scales: sizes before anything cancels of the rates (rad/s), angular accelerations, accelerations and inertia; mass
    (kg), span (s).
    """

    high: dict[str, np.ndarray]
    low: dict[str, np.ndarray]
    sizes: dict[str, float]
    scales: np.ndarray


@cache
def library(kind="quadruple"):
    """The compiled integrator; None where there is no compiler, or none with quadruple precision."""
    if c_compiler() is None or (kind == "quadruple" and not _compiled("#include <quadmath.h>", "-lquadmath")):
        return None
    source = SOURCE.read_text()
    path = _compiled(source, *BUILDS[kind])
    if path is None:
        raise RuntimeError(f"{SOURCE} does not compile")
    return ctypes.CDLL(str(path))


def _compiled(source, *options):
    """A shared library of C source, kept by its contents; None where that fails."""
    folder = Path(os.environ.get("RBFMU_TEST_CACHE", tempfile.gettempdir()))
    key = hashlib.sha256(repr((source, options)).encode()).hexdigest()[:16]
    path = folder / f"rbfmu-reference-{os.getuid()}-{key}.so"
    made = path.with_suffix(f".{os.getpid()}")
    command = [c_compiler(), "-O2", "-std=gnu11", "-ffp-contract=off", "-shared", "-fPIC", "-xc", "-", "-o", str(made)]
    if not path.exists():
        if subprocess.run([*command, *options], input=source.encode(), check=False).returncode:
            return None
        made.replace(path)
    return path


def parameters_of(scene):
    """The blocks of a scene's numbers, as an FMU names them."""
    body, initial, loads = scene.body, scene.initial, scene.loads
    if body is None:
        return {"quaternion_0": list(initial.quaternion)}
    M = body.inertia
    return {
        "mass": [body.mass],
        "inertia": [M[0][0], M[1][1], M[2][2], M[0][1], M[0][2], M[1][2]],
        "r_oc_b": list(body.r_oc_b),
        **{name: list(getattr(loads, name)) for name in ("gravity_a", "damping_b", *PORTS)},
        "position_0": list(initial.position),
        "velocity_0": list(initial.velocity),
        "quaternion_0": list(initial.quaternion),
        "omega_b_0": list(initial.omega_b),
        "pivot": [float(body.pivot)],
    }


def motion(parameters, steps, inputs=None, kind="quadruple", most=MAX_SERIES):
    """The body's motion over steps (s), inputs (port name -> (n, 3)) held over each. Raises TooDearError."""
    p = np.array([x for name in BLOCKS for x in parameters[name]], dtype=float)
    h = np.ascontiguousarray(steps, dtype=float)
    u = np.zeros((max(len(h), 1), 12))
    for name, values in (inputs or {}).items():
        k = 3 * PORTS.index(name)
        u[:, k : k + 3] = values
    rows, sizes, scales = _memory(len(h))
    took = library(kind).body_motion(_of(p), len(h), _of(h), _of(u), most, _of(rows), _of(sizes), _of(scales))
    if took < 0:
        raise TooDearError(f"more than {most} series" if took == -1 else "no finite step")
    return _truth(rows, sizes, np.append(scales, [p[0], h.sum()]))


def prescribed_motion(quaternion_0, steps, omega_b, kind="quadruple"):
    """Attitude under rates (n, 3), each held over its step."""
    h, omega = np.ascontiguousarray(steps, dtype=float), np.ascontiguousarray(omega_b, dtype=float)
    rows, sizes, scales = _memory(len(h))
    q = np.array(quaternion_0, dtype=float)
    library(kind).prescribed_motion(_of(q), len(h), _of(h), _of(omega), _of(rows), _of(sizes))
    scales[0] = sizes[list(QUANTITIES).index("omega_b")]
    return _truth(rows, sizes, np.append(scales, [0.0, 0.0]))


def _memory(n):
    return np.zeros((n + 1, COUNT, 2)), np.zeros(len(QUANTITIES)), np.zeros(SCALES)


def _of(array):
    return array.ctypes.data_as(ctypes.POINTER(ctypes.c_double))


def _truth(rows, sizes, scales):
    at = np.cumsum([0, *QUANTITIES.values()])
    blocks = {name: slice(a, b) for name, a, b in zip(QUANTITIES, at[:-1], at[1:], strict=True)}
    high = {name: rows[:, block, 0] for name, block in blocks.items()}
    low = {name: rows[:, block, 1] for name, block in blocks.items()}
    return Truth(high, low, dict(zip(QUANTITIES, sizes.tolist(), strict=True)), scales)
