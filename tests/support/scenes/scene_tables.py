"""The smallest scene, and Hypothesis strategies for valid ones, as nested tables."""

import numpy as np
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from rbfmu.scene.scene import PARAMETERS, PORTS, QUANTITIES, Scene
from rbfmu_kernels.rotations.euler_angles import NAMES

SMALLEST = {"body": {"mass": 2.0, "inertia": [1.0, 2.0, 2.5]}}
DEFAULTS = {
    "name": "scene",
    "body": {"mass": 2.0, "inertia": [[1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 2.5]], "r_oc_b": [0.0, 0.0, 0.0],
        "pivot": False},
    "initial": {"position": [0.0, 0.0, 0.0], "velocity": [0.0, 0.0, 0.0],
        "attitude": {"quaternion": [1.0, 0.0, 0.0, 0.0]}, "omega_b": [0.0, 0.0, 0.0]},
    "loads": {"gravity_a": [0.0, 0.0, -9.81], "force_a": [0.0, 0.0, 0.0], "force_b": [0.0, 0.0, 0.0],
        "torque_a": [0.0, 0.0, 0.0], "torque_b": [0.0, 0.0, 0.0], "damping_b": [0.0, 0.0, 0.0]},
    "inputs": {"ports": [], "parameters": []},
    "outputs": {
        "quantities": [
            *("position", "velocity", "acceleration", "quaternion", "rpy", "omega_b", "omega_a", "alpha_b"),
            *("angular_momentum_a", "kinetic_energy"),
        ]
    },
    "run": {"start": 0.0, "stop": 10.0, "step": 0.01, "accuracy": 1e-6},
}  # fmt: skip
"""What the smallest scene means: every key of the file with its default."""


def scene(**changes):
    return Scene.from_dict(SMALLEST | changes)


def numbers(low=-1e3, high=1e3):
    return st.floats(low, high)


def vectors(low=-1e3, high=1e3):
    return st.lists(numbers(low, high), min_size=3, max_size=3)


@st.composite
def bodies(draw):
    size = numbers(1e-2, 1e2)
    kind = draw(st.sampled_from(["moments", "matrix", "box", "cylinder", "sphere", "ellipsoid"]))
    body = {"mass": draw(numbers(1e-6, 1e3)), "r_oc_b": draw(vectors(-10, 10)), "pivot": draw(st.booleans())}
    if kind in ("box", "ellipsoid"):
        sides = draw(st.lists(size, min_size=3, max_size=3))
        return body | {"shape": {"kind": kind, "sides" if kind == "box" else "semiaxes": sides}}
    if kind in ("cylinder", "sphere"):
        lengths = {"radius": draw(size), "length": draw(size)}
        return body | {
            "shape": {"kind": kind} | {k: x for k, x in lengths.items() if kind == "cylinder" or k == "radius"}
        }
    x, y, z = draw(numbers(1e-3, 1)), draw(numbers(1e-3, 1)), draw(numbers(1e-3, 1))
    moments = [y + z, z + x, x + y]
    R = Rotation.from_rotvec(draw(vectors(-4, 4))).as_matrix()
    return body | {"inertia": moments if kind == "moments" else (R @ np.diag(moments) @ R.T).tolist()}


@st.composite
def attitudes(draw):
    way = draw(st.sampled_from(["euler", "euler_deg", "quaternion", "rotvec", "matrix"]))
    vector = draw(vectors(-7, 7))
    rotation = Rotation.from_rotvec(vector)
    if way.startswith("euler"):
        return {"euler": draw(st.sampled_from(NAMES)), "angles_deg" if way == "euler_deg" else "angles": vector}
    return {
        "quaternion": {"quaternion": rotation.as_quat(scalar_first=True).tolist()},
        "rotvec": {"rotvec": vector},
        "matrix": {"matrix": rotation.as_matrix().tolist()},
    }[way]


@st.composite
def scene_tables(draw):
    """Valid scenes in all their variety, but for slender beams, as nested tables."""
    some = lambda names, least=0: st.lists(st.sampled_from(names), unique=True, min_size=least)  # noqa: E731
    body = draw(bodies())
    ports = draw(some(PORTS[:4]))
    parameters = draw(some([p for p in PARAMETERS if p not in ports and not (body["pivot"] and p == "velocity_0")]))
    initial = {"position": draw(vectors()), "attitude": draw(attitudes())}
    initial[draw(st.sampled_from(["omega_b", "omega_b_deg"]))] = draw(vectors())
    if not body["pivot"]:
        initial["velocity"] = draw(vectors())
    start, span = draw(numbers()), draw(numbers(1e-3, 1e3))
    loads = {key: draw(vectors()) for key in ("gravity_a", "force_a", "force_b", "torque_a", "torque_b")}
    tables = {
        "name": draw(st.text(st.characters(categories=["L", "N"]), min_size=1, max_size=20)), "body": body,
        "initial": initial, "loads": loads | {"damping_b": draw(vectors(0, 1e3))},
        "inputs": {"ports": ports, "parameters": parameters},
        "outputs": {"quantities": draw(some(QUANTITIES, least=1))},
        "run": {"start": start, "stop": start + span, "step": span / 7, "accuracy": draw(numbers(1e-15, 1))},
    }  # fmt: skip
    kept = {key: value for key, value in tables.items() if key == "body" or draw(st.integers(0, 4))}
    return kept
