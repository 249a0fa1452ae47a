"""Random scenes whose plans could take long, each from its seed: rods, discs, heavy, light, at rest, stiff."""

import numpy as np

from rbfmu.scene.scene import PARAMETERS, QUANTITIES, Scene
from tests.support.quadruple.scenes import Draw, rounded, wanted_of

KINDS = ("rod", "disc", "heavy", "light", "at rest", "stiff")
STEPS = (1, 1, 3, 10, 40, 100, 273, 1000, 10_000)
LOADS = ("torque_a", "torque_b", "force_a", "force_b")


def hard_scene(seed):
    """(kind, scene); raises SceneError where its tables contradict each other."""
    draw = Draw([seed, 13])
    kind = KINDS[seed % len(KINDS)]
    size = {"heavy": draw.log(6, 20), "light": draw.log(-15, -6)}.get(kind, draw.log(-2, 3))
    moments, own = moments_of(draw, kind), int(draw.rng.integers(3))
    moments = rounded(size * np.roll(moments, own), 3)
    body = {"mass": rounded(size * draw.log(-1, 1), 3), "inertia": moments}
    if draw.chance(0.7 if kind == "at rest" else 0.3):
        body |= {"r_oc_b": rounded(draw.vector(draw.log(-2, 0)), 3), "pivot": kind == "at rest" or draw.chance(0.3)}
    span = rounded(draw.log(-1, 3.3), 3)
    initial, loads = {"omega_b": [0.0] * 3}, {"gravity_a": draw.one([0.0] * 3, [0.0, 0.0, -9.81])}
    if draw.chance(0.7):
        initial["omega_b"] = rounded(draw.log(-2, 2) * draw.one(draw.vector(), np.eye(3)[own]), 3)
    if draw.chance(0.5):
        initial["attitude"] = {"rotvec": rounded(draw.vector(draw.rng.uniform(0, 3.1)), 3)}
    if not body.get("pivot") and draw.chance(0.3):
        initial["velocity"] = rounded(draw.vector(draw.log(-1, 2)), 3)
    if kind not in ("heavy", "at rest") or draw.chance(0.3):
        for name in draw.some(LOADS, 0.5):
            loads[name] = rounded(draw.vector(size * draw.log(-4, 0)), 3)
    if kind in ("heavy", "at rest", "stiff") or draw.chance(0.2):
        decay = draw.log(2, 7) if kind == "stiff" else draw.log(0, 3)  # e^-decay is what is left of a rate
        loads["damping_b"] = rounded(np.array(draw.one(np.ones(3), np.eye(3)[own])) * max(moments) * decay / span, 3)
    listed = draw.some([p for p in PARAMETERS if not (body.get("pivot") and p == "velocity_0")], 0.2)
    names = [q for q in QUANTITIES if not (body.get("pivot") and q in ("position", "velocity", "acceleration"))]
    wanted = draw.one(["omega_b"], ["quaternion", "omega_b"], names, wanted_of(draw, kind, body.get("pivot")))
    run = {"stop": span, "step": rounded(span / draw.one(*STEPS), 6), "accuracy": rounded(draw.log(-11, -2), 3)}
    return kind, Scene(name=f"hard_{seed}", body=body, initial=initial, loads=loads, run=run,
                       inputs={"parameters": listed if draw.chance(0.3) else []},
                       outputs={"quantities": wanted})  # fmt: skip


def moments_of(draw, kind):
    """Three principal moments of size 1."""
    if kind == "rod":
        return np.array([1.0, 1.0, draw.one(draw.log(-7, -2), draw.log(-4, -2))])
    if kind == "disc":
        return np.array([0.5, 0.5 * (1.0 + draw.one(0.0, draw.log(-9, -2))), 1.0])
    a, b, c = draw.rng.uniform(0.05, 1.0, 3)
    return draw.one(np.array([b + c, c + a, a + b]), np.array([1.0, 1.0, draw.rng.uniform(0.1, 1.9)]))
