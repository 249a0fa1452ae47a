"""Random scenes over the whole hierarchy of models and their borders."""

import numpy as np
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from rbfmu.scene.scene import Scene

DECADES = st.integers(-13, -2).map(lambda k: 10.0**k)
KINDS = (
    *("none", "none", "weight", "weight", "axis", "tiny", "tiny", "pivot", "swing", "spun"),
    *("force_b", "thrust", "ball", "all"),
)
"""Of loads."""
SIGNS = st.sampled_from([-1.0, 1.0])


def vectors(largest=1.0):
    number = st.integers(-1000, 1000).map(lambda n: largest * n / 1000.0)
    return st.tuples(number, number, number)


@st.composite
def bodies(draw):
    """A sphere, a beam, symmetric, nearly symmetric or triaxial, sometimes in axes that are not principal."""
    kind = draw(st.sampled_from(["sphere", "beam", "symmetric", "nearly symmetric", "triaxial", "triaxial"]))
    moment = draw(st.sampled_from([0.7, 1.0, 1.3]))
    near = 1.0 + draw(DECADES)
    moments = {
        "sphere": (1.0, 1.0, 1.0), "beam": (0.0, 1.0, 1.0), "symmetric": (1.0, 1.0, moment),
        "nearly symmetric": (1.0, near, moment), "triaxial": (1.0, 1.2, moment + 0.3),
    }[kind]  # fmt: skip
    moments = draw(st.permutations(moments))
    if kind != "beam" and draw(st.integers(0, 3)) == 0:
        R = Rotation.from_rotvec(draw(vectors(3.0))).as_matrix()
        M = R @ np.diag(moments) @ R.T
        return {"mass": 2.0, "inertia": (0.5 * (M + M.T)).tolist()}, moments, R
    return {"mass": 2.0, "inertia": list(moments)}, moments, np.eye(3)


@st.composite
def spins(draw, moments, R):
    """At rest, about a principal axis, near one, or anyhow; a beam never about itself."""
    kind = draw(st.sampled_from(["rest", "principal", "near", "near", "any", "any"]))
    k = draw(st.integers(0, 2))
    size = draw(st.sampled_from([0.03, 1.0, 3.0])) * draw(SIGNS)
    omega = np.zeros(3)
    if kind != "rest":
        omega[k] = size
    if kind == "near":
        omega += np.array(draw(vectors(draw(DECADES))))
    elif kind == "any":
        omega = np.array(draw(vectors(2.0)))
    omega[[m == 0.0 for m in moments]] = 0.0
    return (R @ omega).tolist(), k


@st.composite
def swings(draw):
    """About x, which stays level: on a pivot, or free and pushed beside the centre of mass; damped or hardly or not."""
    pivot, damping = draw(st.integers(0, 3)) > 0, draw(st.sampled_from([0.0, 0.0, 0.1, draw(DECADES)]))
    arm = [0.0, 0.3, draw(st.sampled_from([0.0, -0.2]))]
    body = {"mass": 2.0, "inertia": [1.0, 1.2, 1.4], "pivot": pivot, "r_oc_b": arm}
    omega_b = [draw(st.sampled_from([0.0, 0.0, 1.0, 3.0, draw(DECADES)])) * draw(SIGNS), 0.0, 0.0]
    turn = [draw(st.sampled_from([0.0, 1.0, -1.5707963267948966, 1.5707963])), 0.0, 0.0]
    push = {"gravity_a": [0.0, 0.0, -1.0]} if pivot else {"gravity_a": [0.0] * 3, "force_a": [0.0, 0.0, -1.0]}
    return body, omega_b, turn, push | {"damping_b": [damping, 0.0, 0.0]}


@st.composite
def spun(draw):
    """A symmetric body, or nearly, under torque and damping about its axis, or nearly: some ask for the rates alone."""
    moments, own = [1.0, 1.0, 1.0], draw(st.integers(0, 2))
    moments[own] = draw(st.sampled_from([0.4, 1.3]))
    moments[(own + 1) % 3] += draw(st.sampled_from([0.0, 0.0, draw(DECADES)]))
    torque, damping = [0.0] * 3, [draw(st.sampled_from([0.0, 0.2]))] * 3
    torque[own], damping[own] = draw(st.sampled_from([0.3, -1.0])), draw(st.sampled_from([0.0, 0.1]))
    torque[(own + 1) % 3] = draw(st.sampled_from([0.0, 0.0, draw(DECADES)]))
    loads = {"gravity_a": [0.0] * 3, "torque_b": torque, "damping_b": damping}
    return {"mass": 2.0, "inertia": moments}, list(draw(vectors(2.0))), loads


@st.composite
def balls(draw):
    """A sphere driven along its rate, or nearly: any axis is a principal one."""
    along = np.array(draw(vectors(0.5)))
    beside = draw(st.sampled_from([0.0, 0.0, draw(DECADES)])) * np.array(draw(vectors()))
    omega_b = draw(st.sampled_from([0.0, 1.0, -3.0])) * along
    loads = {"gravity_a": [0.0] * 3, "damping_b": [draw(st.sampled_from([0.0, 0.2]))] * 3}
    loads["torque_b"] = (draw(st.sampled_from([0.0, 1.0])) * along + beside).tolist()
    loads["force_b"] = (draw(st.sampled_from([0.0, 2.0])) * along).tolist()
    return {"mass": 2.0, "inertia": [0.7] * 3}, omega_b.tolist(), loads


@st.composite
def tops(draw):
    """A heavy top on its pivot, as fast as splitting likes it."""
    body = {
        "mass": 1.0, "inertia": [0.5, 0.5, 0.3], "pivot": True,
        "r_oc_b": [0.0, 0.0, draw(st.sampled_from([0.5, -0.2]))],
    }  # fmt: skip
    omega_b = [draw(st.sampled_from([0.0, 0.3])), 0.0, draw(st.sampled_from([50.0, 200.0])) * draw(SIGNS)]
    return body, omega_b, [draw(st.sampled_from([0.1, 0.4, 1.5])), 0.0, 0.0], {"gravity_a": [0.0, 0.0, -9.81]}


@st.composite
def scenes(draw, kinds=KINDS):
    """Scenes that are good; whether their accuracy can be met is for the plan to say."""
    body, moments, R = draw(bodies())
    omega_b, k = draw(spins(moments, R))
    beam = 0.0 in moments
    kind = draw(st.sampled_from(kinds))
    loads = {"gravity_a": [0.0, 0.0, 0.0]}
    axis = R[:, k] if moments[k] else R[:, (np.flatnonzero(np.array(moments) > 0.0))[0]]
    if kind in ("weight", "pivot", "all"):
        loads["gravity_a"] = [0.0, 0.0, -1.0]
    if kind == "axis":
        loads["torque_b"] = (draw(st.sampled_from([0.0, 0.3, -1.0])) * axis).tolist()
        loads["damping_b"] = [0.0 if beam else draw(st.sampled_from([0.0, 0.2]))] * 3
    if kind in ("tiny", "all") and not beam:
        loads["torque_b"] = list(draw(vectors(draw(DECADES) if kind == "tiny" else 0.3)))
        loads["damping_b"] = [abs(x) for x in draw(vectors(draw(DECADES)))]
    if kind in ("force_b", "all"):
        loads["force_b"] = list(draw(vectors(0.5)))
    if kind == "thrust":
        aslant = np.array(draw(vectors(draw(st.sampled_from([0.0, 1e-9])))))
        loads["force_b"] = (draw(SIGNS) * R[:, k] + aslant).tolist()
    if kind == "pivot":
        body |= {"pivot": True, "r_oc_b": (draw(st.sampled_from([0.2, -0.3])) * R[:, (k + 1) % 3]).tolist()}
    elif kind != "swing" and draw(st.integers(0, 4)) == 0 and not beam:
        body |= {"r_oc_b": list(draw(vectors(0.3)))}
    turn = list(draw(vectors(draw(st.sampled_from([0.0, 1.0])))))
    if kind == "swing":
        body, omega_b, turn, loads = draw(swings())
    if kind == "top":
        body, omega_b, turn, loads = draw(tops())
    if kind == "spun":
        body, omega_b, loads = draw(spun())
    if kind == "ball":
        body, omega_b, loads = draw(balls())
    wanted = ["quaternion", "rpy", "omega_b", *(() if body.get("pivot") else ("position", "velocity"))]
    wanted = draw(st.lists(st.sampled_from(wanted), min_size=1, max_size=3, unique=True))
    if kind == "spun" and draw(st.booleans()):
        wanted = ["omega_b"]
    initial = {"omega_b": omega_b, "attitude": {"rotvec": turn}}
    if not body.get("pivot"):
        initial |= {"velocity": list(draw(vectors(draw(st.sampled_from([0.0, 2.0])))))}
    stop, steps = 0.5 if kind == "top" else draw(st.sampled_from([0.5, 5.0, 20.0])), draw(st.sampled_from([2, 10, 40]))
    run = {"stop": stop, "step": stop / steps, "accuracy": 10.0 ** -draw(st.integers(2, 11))}
    return Scene(body=body, initial=initial, loads=loads, outputs={"quantities": wanted}, run=run)
