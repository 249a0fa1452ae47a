"""Bodies, states and motions that laws are measured on, references of 40 digits, and the errors of models on them."""

import json
import math
import tomllib
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from rbfmu.runs.motion import largest_error
from rbfmu.runs.plan import Plan, start_run
from rbfmu.scene.scene import Scene, SceneError
from rbfmu.simulation import SimulationError, simulate
from rbfmu.studies.chart.cases import CASES
from rbfmu.types import Array
from rbfmu_kernels.mechanics.equations_of_motion import Body, State
from rbfmu_kernels.mechanics.inertia import diagonal, inverse_inertia
from rbfmu_kernels.rotations.rotation_vector import quaternion_from_rotvec
from rbfmu_kernels.rotations.vec3 import scale
from rbfmu_kernels.types import Quaternion, Vec3

ZERO: Vec3 = (0.0, 0.0, 0.0)
UPRIGHT: Quaternion = (1.0, 0.0, 0.0, 0.0)
SPHERE: Vec3 = (1.0, 1.0, 1.0)
TUMBLING, FLIPPING, HEAVY_TOP = CASES["a"], CASES["b"], CASES["c"]
"""Motions of the charts: a brick that tumbles, that brick about its middle axis, and a fast top with m g l = 1 N m."""
BRICK = TUMBLING.moments


def free_body(moments: Vec3, damping_b: Vec3 = ZERO) -> Body:
    """Return a free body in principal axes."""
    M = diagonal(moments)
    return Body(1.0, M, inverse_inertia(M), ZERO, damping_b, 1.0)


def at(q: Quaternion, omega_b: Vec3) -> State:
    """Return a state of rotation."""
    return State(ZERO, ZERO, q, omega_b)


def spin(rate: float) -> State:
    """Return the state of a body that turns about z."""
    return at(UPRIGHT, (0.0, 0.0, rate))


def attitude_after(state: State, t: float) -> Quaternion:
    """Return the attitude of a sphere, upright at first, after the time t; its rate is constant."""
    return quaternion_from_rotvec(scale(t, state.omega_b))


def scene_of(
    body: Mapping[str, Any], start: State, asked: Sequence[str], stop: float, step: float, **more: Any
) -> Scene:
    """Return the scene of a body of 1 kg without weight; more: further keys, as `Scene.replace` takes them."""
    tables = {
        "body": {"mass": 1.0, **body},
        "initial": {"attitude": {"quaternion": list(start.q_ab)}, "omega_b": list(start.omega_b)},
        "loads": {"gravity_a": ZERO},
        "outputs": {"quantities": list(asked)},
        "run": {"stop": stop, "step": step},
    }
    return Scene.from_dict(tables).replace(more)


REFERENCES = Path(__file__).with_name("reference_motions.json")
"""The file is written by tests/support/references/stability_references.py."""
POINTS = 10
"""The number of points at which a motion is compared."""
STATE = ("quaternion", "omega_b", "position", "velocity")
DERIVED = ("omega_a", "angular_momentum_a", "kinetic_energy")


def _motion(tables: dict[str, Any]) -> Scene:
    run = tables["run"] | {"step": tables["run"]["stop"] / POINTS, "accuracy": 1e-9}
    return Scene.from_dict({"outputs": {"quantities": [*STATE, *DERIVED]}} | tables | {"run": run})


_TABLES = tomllib.loads(Path(__file__).with_name("motions.toml").read_text(encoding="utf-8"))
MOTIONS = {key: _motion(tables) for key, tables in _TABLES.items()}
"""The motions on which laws 13 and 14 are measured."""


@cache
def references() -> dict[str, Any]:
    """Return the contents of the file of references."""
    return json.loads(REFERENCES.read_text(encoding="utf-8"))  # type: ignore[no-any-return]


def truth(key: str) -> dict[str, Array]:
    """Return the true quantities of a motion at its communication points, without the start."""
    scene, kept = MOTIONS[key], references()["motions"][key]
    assert scene.body is not None
    found = {name: np.array(kept[name]) for name in STATE}
    R_ab, omega = np.array([_matrix(q) for q in found["quaternion"]]), found["omega_b"]
    M_c, r_oc = np.array(scene.body.M_c), np.array(scene.body.r_oc_b)
    v_c = found["velocity"] + np.einsum("nij,nj->ni", R_ab, np.cross(omega, r_oc))
    h = omega @ M_c
    energy = 0.5 * scene.body.mass * np.sum(v_c * v_c, axis=1) + 0.5 * np.sum(omega * h, axis=1)
    if scene.body.pivot:  # the momentum is about the pivot
        h = h + scene.body.mass * np.cross(r_oc, np.cross(omega, r_oc))
    found["omega_a"] = np.einsum("nij,nj->ni", R_ab, omega)
    found["angular_momentum_a"] = np.einsum("nij,nj->ni", R_ab, h)
    found["kinetic_energy"] = energy[:, None]
    return found


def _matrix(q: Array) -> Array:
    """Return R_ab, by another formula than that of the kernels which are measured."""
    e, x, y, z = q
    E = np.array([[-x, e, -z, y], [-y, z, e, -x], [-z, -y, x, e]])
    G = np.array([[-x, e, z, -y], [-y, -z, e, x], [-z, y, -x, e]])
    product: Array = E @ G.T
    return product


def attitude_error(q: ArrayLike, true_q: ArrayLike) -> float:
    """Return the largest attitude error in rad; a deviation of the quaternion's norm from 1 counts as an error."""
    q, true_q = np.asarray(q), np.asarray(true_q)
    sign = np.where(np.sum(q * true_q, axis=-1, keepdims=True) < 0.0, -1.0, 1.0)
    apart, together = np.linalg.norm(sign * q - true_q, axis=-1), np.linalg.norm(sign * q + true_q, axis=-1)
    return float(np.max(4.0 * np.arctan2(apart, together)))


def error_of(found: Mapping[str, Array], true: Mapping[str, Array]) -> float:
    """Return the largest error: attitude in rad, others relative to the largest norm (at least 1 m, 1 m/s)."""
    rows = {name: values.reshape(len(values), -1) for name, values in found.items()}
    if not all(np.all(np.isfinite(values)) for values in rows.values()):
        return math.inf
    turned = attitude_error(rows["quaternion"], true["quaternion"]) if "quaternion" in rows else 0.0
    return max(turned, largest_error(rows, true, rows.keys() - {"quaternion"}))


def error_of_model(key: str, planned: Plan) -> float:
    """Return the error of a motion by `simulate`; infinite where the model refuses it."""
    try:
        result = simulate(MOTIONS[key], planned=planned)
    except (SceneError, SimulationError):
        return math.inf
    return error_of({name: values[1:] for name, values in result.quantities.items()}, truth(key))


_HELD: tuple[float, Vec3, Vec3, Vec3] = (2.0, (3.0, -1.0, 2.0), ZERO, ZERO)
PRESCRIBED = (
    *(_HELD,) * 5,
    (1.0, (1e-3, 2e-3, -1e-3), ZERO, ZERO),
    (2.0, (1.0, 0.0, 0.5), (-0.5, 1.5, 0.25), (0.25, -1.0, 0.5)),
    (2.0, (0.0, 2.0, -1.0), (1.0, -0.5, 0.75), ZERO),
)
"""For each step: its length in s, and omega_b with its first and second derivative at the start of the step."""


def prescribed_error() -> float:
    """Return the largest error after a step, rad."""
    scene = Scene.from_dict({"inputs": {"ports": ["omega_b"]}, "outputs": {"quantities": ["quaternion"]}})
    planned = Plan("prescribed rates", "", 4)
    kernels, z = planned.kernels, start_run(scene, planned)
    found: list[Array] = []
    for h, omega, rate, rate_2 in PRESCRIBED:
        for name, value in (("omega_b", omega), ("omega_b_rate", rate), ("omega_b_rate_2", rate_2)):
            z[kernels.BLOCKS[name]] = value
        refused = kernels.step(z, h)
        found.append(np.full(4, np.nan) if refused else z[kernels.BLOCKS["quaternion"]].copy())
    return attitude_error(np.array(found), np.array(references()["prescribed"]))
