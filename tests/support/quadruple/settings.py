"""Random settings of an importer, each from its seed: other steps, ports held, parameters changed."""

import numpy as np

from tests.support.quadruple.driving import Setting
from tests.support.quadruple.scenes import Draw, rounded

STEP_FACTORS = (0.1, 0.3, 3.0, 10.0, 30.0, 100.0, np.inf)
FACTORS = (0.0, 0.5, 2.0, 2.0, 5.0, 5.0, -1.0, 30.0, 100.0)


def changed(draw, block, values, scene):
    """Another value of a parameter, one that a body can have."""
    v = np.array(values, dtype=float)
    if block == "mass":
        return [rounded(v[0] * draw.one(0.5, 2.0, 10.0))]
    if block == "quaternion_0":
        return draw.rotation().as_quat(scalar_first=True).tolist()
    if block in ("position_0", "velocity_0"):
        return rounded(draw.one(0.0, 1.0, 100.0) * draw.vector() + draw.one(0.0, 1.0) * v)
    if block == "inertia":
        return inertia_changed(draw, v)
    if not np.any(v):
        v = rounded(draw.log(-1, 0.5) * draw.vector() * usual_size(block, scene))
        return np.abs(v).tolist() if block == "damping_b" else v
    if draw.chance(0.3):
        v = v + draw.vector(draw.log(-6, 0) * np.linalg.norm(v))
        return np.abs(v).tolist() if block == "damping_b" else v.tolist()
    factor = draw.one(*FACTORS)
    return ((abs(factor) if block == "damping_b" else factor) * v).tolist()


def inertia_changed(draw, v):
    M = np.array([[v[0], v[3], v[4]], [v[3], v[1], v[5]], [v[4], v[5], v[2]]])
    way = draw.one("scaled", "scaled", "turned", "near", "other")
    if way == "scaled":
        M = draw.one(0.5, 2.0, 5.0) * M
    elif way == "turned":
        R = draw.rotation().as_matrix()
        M = R @ M @ R.T
    else:
        t = np.trace(M)
        a, b, c = draw.rng.uniform(0.05, 0.5, 3) * t
        other = np.diag([b + c, c + a, a + b])
        M = M + draw.log(-9, -2) * other if way == "near" else other
    return [M[0, 0], M[1, 1], M[2, 2], M[0, 1], M[0, 2], M[1, 2]]


def usual_size(block, scene):
    """Of a load or a rate that turns the body by a radian over the run or so."""
    M, mass = np.trace(scene.body.inertia), scene.body.mass
    rate = max(float(np.linalg.norm(scene.initial.omega_b)), 1.0 / (scene.run.stop - scene.run.start))
    sizes = {"omega_b_0": rate, "r_oc_b": np.sqrt(M / mass), "gravity_a": 1.6, "damping_b": 0.1 * M * rate}
    torque = 0.1 * M * rate * rate
    return sizes.get(block, torque / np.sqrt(M / mass) if block.startswith("force") else torque)


def random_inputs(draw, scene):
    """Rows of each port: constant, or changing a few times."""
    rows = draw.one(1, 1, 3, 5)
    if scene.body is None:
        span = scene.run.stop - scene.run.start
        rate = draw.one(0.0, draw.log(-0.5, 2.2) / span, draw.log(-0.5, 3) / span)
        return {"omega_b": [rounded(draw.vector(rate)) for _ in range(rows)]}
    factor = draw.one(0.1, 1.0, 1.0, 3.0)
    return {p: [rounded(factor * draw.vector(usual_size(p, scene))) for _ in range(rows)] for p in scene.inputs.ports}


def other_step(draw, scene):
    span = scene.run.stop - scene.run.start
    step = min(scene.run.step * draw.one(*STEP_FACTORS), span)
    return max(rounded(step, 6), span / 30_000.0) if step < span else span


def random_settings(seed, scene, offered):
    """(label, setting) of a scene whose FMU has the parameters `offered`, by block name with their values."""
    draw = Draw([seed, 12])
    inputs = random_inputs(draw, scene) if scene.inputs.ports else {}
    if scene.body is not None or inputs:
        yield "as planned", Setting(inputs=inputs if scene.body is None else {})
    yield "other step", Setting(step=other_step(draw, scene), inputs=inputs if scene.body is None else {})
    if inputs:
        yield "ports", Setting(inputs=inputs)
        yield "ports, other step", Setting(inputs=random_inputs(draw, scene), step=other_step(draw, scene))
    blocks = list(offered)
    for k in range(3 if blocks else 0):
        names = [draw.one(*blocks)] if k < 2 else draw.some(blocks, 0.4)
        listed = [b for b in blocks if b in scene.inputs.parameters]
        if k == 0 and listed:
            names = [draw.one(*listed)]
        changes = {b: changed(draw, b, offered[b], scene) for b in names}
        step = other_step(draw, scene) if k == 1 and draw.chance(0.5) else None
        held = inputs if scene.body is None or (inputs and k == 2) else {}
        yield "parameters", Setting(changes=changes, step=step, inputs=held)
