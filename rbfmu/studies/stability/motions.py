"""Bodies, states and motions that laws are measured on, references of 40 digits, and the errors of models on them."""

import json
import math
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from rbfmu.result import Result
from rbfmu.runs.plan import Plan, start_run
from rbfmu.scene.scene import Scene, SceneError
from rbfmu.simulation import SimulationError, simulate
from rbfmu.studies.dop853 import dop853_step_of_state
from rbfmu.studies.reference_methods import OneStepMethod, integrator
from rbfmu.types import Array
from rbfmu_kernels.mechanics.equations_of_motion import NO_LOADS as NO_LOADS
from rbfmu_kernels.mechanics.equations_of_motion import Body, Loads, State
from rbfmu_kernels.mechanics.inertia import diagonal, inverse_inertia
from rbfmu_kernels.mechanics.newton_euler import kinetic_energy
from rbfmu_kernels.rotations.quaternion import angle_between
from rbfmu_kernels.types import Quaternion, Vec3

ZERO: Vec3 = (0.0, 0.0, 0.0)
UPRIGHT: Quaternion = (1.0, 0.0, 0.0, 0.0)
SPHERE: Vec3 = (1.0, 1.0, 1.0)
BRICK: Vec3 = (1.0, 2.0, 3.0)
TUMBLE = State(ZERO, ZERO, (0.5, 0.5, 0.5, 0.5), (0.3, 1.0, 0.2))
"""With BRICK, this is case a of the work-precision diagrams."""
TOP_MOMENTS: Vec3 = (1.0, 1.0, 0.3)
"""Moments of inertia about the pivot; the centre of mass is on the z axis, and m g l = 1 N m."""
WEIGHT = Loads(ZERO, (0.0, 0.0, -1.0), ZERO, ZERO, ZERO)


def free_body(moments: Vec3, damping_b: Vec3 = ZERO) -> Body:
    """Return a free body in principal axes."""
    M = diagonal(moments)
    return Body(1.0, M, inverse_inertia(M), ZERO, damping_b, 1.0)


def heavy_top() -> Body:
    """Return a symmetric body on a pivot, its weight 1 acting at (0, 0, 1)."""
    M = diagonal(TOP_MOMENTS)
    return Body(0.0, M, inverse_inertia(M), (0.0, 0.0, 1.0), ZERO, 0.0)


def at(q: Quaternion, omega_b: Vec3) -> State:
    """Return a state of rotation."""
    return State(ZERO, ZERO, q, omega_b)


def spin(rate: float) -> State:
    """Return the state of a body that turns about z."""
    return at(UPRIGHT, (0.0, 0.0, rate))


def angle(a: State, q: Quaternion) -> float:
    """Return the attitude's error in rad; NaN where it is not finite."""
    return angle_between(a.q_ab, q)


def attitude_after(state: State, t: float) -> Quaternion:
    """Return the attitude of a sphere, upright at first, after the time t; its rate is constant."""
    omega = state.omega_b
    rate = math.hypot(*omega)
    s = math.sin(0.5 * rate * t) / rate
    return math.cos(0.5 * rate * t), s * omega[0], s * omega[1], s * omega[2]


def scene_of(
    body: Mapping[str, Any], start: State, asked: Sequence[str], stop: float, step: float,
    loads: Mapping[str, Any] = MappingProxyType({"gravity_a": ZERO}), accuracy: float = 1e-6, **initial: Any,
) -> Scene:  # fmt: skip
    """Return the scene of a body of 1 kg, unless another mass is given, without loads, unless there are some."""
    return Scene.from_dict({
        "body": {"mass": 1.0, **body},
        "initial": {"attitude": {"quaternion": list(start.q_ab)}, "omega_b": list(start.omega_b), **initial},
        "loads": dict(loads),
        "outputs": {"quantities": list(asked)},
        "run": {"stop": stop, "step": step, "accuracy": accuracy},
    })  # fmt: skip


def free_motion(moments: Vec3, start: State, stop: float, step: float) -> Result:
    """Return the torque-free motion by the product's model."""
    scene = scene_of({"inertia": moments}, start, ["omega_b"], stop, step)
    return simulate(scene, planned=Plan("torque-free body", "", 3))


def damped_rate(planned: Plan, x: float) -> float:
    """Return the rate after one step of a product's model from a damped spin of 1 rad/s with h d / I = x."""
    loads = {"gravity_a": ZERO, "damping_b": (x, x, x)}
    scene = scene_of({"inertia": SPHERE}, spin(1.0), ["omega_b"], 1.0, 1.0, loads)
    return float(simulate(scene, planned=planned).omega_b[1, 2])


def rotational_energy(moments: Vec3, state: State) -> float:
    """Return omega . M omega / 2."""
    return kinetic_energy(0.0, diagonal(moments), ZERO, state.omega_b)


def top_energy(state: State) -> float:
    """Return the kinetic and potential energy of the heavy top."""
    q = state.q_ab
    return rotational_energy(TOP_MOMENTS, state) + 1.0 - 2.0 * (q[1] * q[1] + q[2] * q[2])


def one_step(method: str | OneStepMethod) -> Any:
    """Return `step(state, h, body, loads)` to an integrator's own form, or of DOP853 without normalisation."""
    if method == "DOP853":
        return dop853_step_of_state
    taken = integrator(method)
    return lambda state, h, body, loads: taken.path(state, h, [1], body, loads)[0]


REFERENCES = Path(__file__).with_name("reference_motions.json")
"""The file is written by tests/support/references/stability_references.py."""
POINTS = 10
"""The number of points at which a motion is compared."""
STATE = ("quaternion", "omega_b", "position", "velocity")
DERIVED = ("omega_a", "angular_momentum_a", "kinetic_energy")
TURNED: Quaternion = (0.8, 0.4, -0.4, 0.2)
MOVING = {"position": [1.0, 2.0, 3.0], "velocity": [0.1, 0.2, -0.3]}
NO_WEIGHT = {"gravity_a": [0.0, 0.0, 0.0]}
HEAVY_BRICK = {"mass": 2.0, "inertia": [1.0, 2.0, 3.0]}
OFF_CENTRE = {
    "mass": 2.0,
    "inertia": [[1.0, 0.1, 0.05], [0.1, 1.2, 0.02], [0.05, 0.02, 1.5]],
    "r_oc_b": [0.1, -0.2, 0.3],
}
PENDULUM = {"mass": 2.0, "inertia": [1.0, 2.0, 2.5], "r_oc_b": [0.0, 0.0, -0.5], "pivot": True}
TOP = {"mass": 1.0, "inertia": [0.984375, 0.984375, 0.3], "r_oc_b": [0.0, 0.0, 0.125], "pivot": True}
"""With the loads `TOP_WEIGHT`, this is the heavy top (case c) of the work-precision diagrams."""
TOP_WEIGHT = {"gravity_a": [0.0, 0.0, -8.0]}
LOADED = {
    "gravity_a": [0.0, 0.0, -1.0], "force_b": [1.0, 0.5, 0.2], "force_a": [0.3, 0.1, -0.4],
    "torque_b": [0.1, 0.2, 0.1], "torque_a": [0.05, 0.0, 0.02], "damping_b": [0.1, 0.05, 0.02],
}  # fmt: skip


def _motion(
    body: Mapping[str, Any], omega_b: tuple[float, float, float], stop: float, loads: Mapping[str, Any],
    quantities: tuple[str, ...] = (*STATE, *DERIVED), quaternion: Quaternion = TURNED,
) -> Scene:  # fmt: skip
    moving = {} if "pivot" in body else MOVING
    return scene_of(body, at(quaternion, omega_b), quantities, stop, stop / POINTS, loads, 1e-9, **moving)


def _swing(rate: float, **loads: Any) -> Scene:
    """Return a pendulum that hangs down and starts with a rate about x, in rad/s."""
    gravity = {"gravity_a": [0.0, 0.0, -9.81]}
    return _motion(PENDULUM, (rate, 0.0, 0.0), 20.0, gravity | loads, quaternion=UPRIGHT)


_OVER_THE_TOP = 2.0 * math.sqrt(2.0 * 9.81 * 0.5 / 1.5)
"""The initial rate in rad/s that just takes the pendulum to its upright position."""

MOTIONS: dict[str, Scene] = {
    "fall": _motion(HEAVY_BRICK, (0.0, 0.0, 0.0), 20.0, {"force_a": [0.3, 0.1, 0.7]}, ("position", "velocity")),
    "spin": _motion(HEAVY_BRICK, (0.0, 0.0, 3.7), 100.0, NO_WEIGHT),
    "sphere": _motion({"mass": 2.0, "inertia": [1.5, 1.5, 1.5]}, (1.0, -2.0, 3.0), 100.0, NO_WEIGHT),
    "run-down": _motion(HEAVY_BRICK, (0.0, 0.0, 3.7), 60.0,
                        NO_WEIGHT | {"torque_b": [0, 0, 0.6], "damping_b": [0, 0, 0.2]}),
    "slow run-down": _motion(HEAVY_BRICK, (0.0, 3.7, 0.0), 20.0, NO_WEIGHT | {"damping_b": [0, 0.01, 0]}),
    "swing": _swing(1.0),
    "nearly upright": _swing(_OVER_THE_TOP * (1.0 - 1e-7)),
    "turning over": _swing(9.0),
    "damped swing": _swing(9.0, damping_b=[0.2, 0.0, 0.0], torque_b=[1.0, 0.0, 0.0]),
    "coin": _motion({"mass": 2.0, "inertia": [1.0, 1.0, 1.6]}, (1.0, -2.0, 3.0), 100.0, NO_WEIGHT),
    "spin-up": _motion({"mass": 2.0, "inertia": [1.0, 1.0, 0.6]}, (0.3, -0.2, 1.0), 40.0,
                       NO_WEIGHT | {"torque_b": [0, 0, 0.4], "damping_b": [0.02, 0.02, 0.1]},
                       ("omega_b", "kinetic_energy")),
    "tumble": _motion(HEAVY_BRICK, (0.3, 1.0, 0.2), 200.0, NO_WEIGHT),
    "flips": _motion({"mass": 2.0, "inertia": [3.0, 1.0, 2.0]}, (1e-4, 1e-4, 2.0), 60.0, NO_WEIGHT),
    "top": _motion(TOP, (0.0, 0.0, 50.0), 10.0, TOP_WEIGHT),
    "gentle top": _motion(TOP, (0.0, 0.0, 5.0), 10.0, TOP_WEIGHT),
    "pulled": _motion(HEAVY_BRICK, (1.0, 2.0, -1.0), 20.0, NO_WEIGHT | {"torque_a": [0.1, 0.2, -0.1]},
                      ("angular_momentum_a",)),
    "pulled sphere": _motion({"mass": 2.0, "inertia": [1.5, 1.5, 1.5]}, (1.0, -2.0, 3.0), 20.0,
                             NO_WEIGHT | {"torque_a": [0.1, 0.2, -0.1]},
                             ("omega_a", "angular_momentum_a", "kinetic_energy")),
    "body force": _motion(HEAVY_BRICK, (1.0, 2.0, -1.0), 20.0, NO_WEIGHT | {"force_b": [0.3, -0.2, 0.5]}),
    "loaded": _motion(OFF_CENTRE, (1.0, 2.0, -1.0), 20.0, LOADED),
    "damped rates": _motion(HEAVY_BRICK, (1.0, 2.0, -1.0), 20.0,
                            NO_WEIGHT | {"torque_b": [0.1, 0.2, -0.1], "damping_b": [0.1, 0.05, 0.02]}, ("omega_b",)),
    "motor": _motion(HEAVY_BRICK, (0.1, 0.2, 0.3), 20.0, NO_WEIGHT | {"torque_b": [0.1, 0.05, -0.2]}),
}  # fmt: skip


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
    worst = 0.0
    for name, values in found.items():
        rows = values.reshape(len(values), -1)
        if not np.all(np.isfinite(rows)):
            return math.inf
        if name == "quaternion":
            error = attitude_error(rows, true[name])
        else:
            size = max(float(np.max(np.linalg.norm(true[name], axis=1))), float(name in ("position", "velocity")))
            error = float(np.max(np.linalg.norm(rows - true[name], axis=1))) / size
        worst = max(worst, error)
    return worst


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
