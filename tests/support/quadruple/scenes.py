"""Random scenes over all models and their borders, each from its seed."""

import numpy as np
from scipy.spatial.transform import Rotation

from rbfmu.scene.scene import PARAMETERS, PORTS, QUANTITIES, Scene

KINDS = (
    "no rotation", "constant rate", "one axis", "pendulum", "swinging", "swinging", "prescribed", "free",
    "free symmetric", "spun", "top", "top", "top", "loads", "loads", "loads", "loads", "weight off centre",
    "equilibrium", "rod", "tiny loads", "momentum", "sphere", "pushed", "pushed", "thrust",
)  # fmt: skip
STEPS = (1, 2, 3, 5, 10, 10, 30, 30, 100, 100, 300, 1000, 3000)


class Draw:
    """Random numbers of a scene."""

    def __init__(self, seed):
        self.rng = np.random.default_rng(seed)

    def one(self, *items):
        return items[self.rng.integers(len(items))]

    def chance(self, p):
        return bool(self.rng.random() < p)

    def log(self, low, high):
        return float(10.0 ** self.rng.uniform(low, high))

    def vector(self, size=1.0):
        v = self.rng.normal(size=3)
        return size * v / np.linalg.norm(v)

    def some(self, names, p):
        return [n for n in names if self.chance(p)]

    def rotation(self):
        return Rotation.from_rotvec(self.vector(self.rng.uniform(0.0, 3.1)))


def rounded(x, digits=4):
    """Few digits, so that scenes can be pasted."""
    if isinstance(x, float | int):
        return float(f"{x:.{digits}g}")
    return [rounded(y, digits) for y in np.asarray(x).tolist()]


def moments_of(draw, kind):
    """Three principal moments of size 1; which of them is the symmetric body's own, if there is one."""
    own = int(draw.rng.integers(3))
    ratio = draw.one(0.4, 0.7, 1.3, 1.9, draw.rng.uniform(0.1, 1.95))
    symmetric = np.ones(3)
    symmetric[own] = ratio
    if kind in ("top", "spun", "free symmetric"):
        return symmetric, own
    if kind == "sphere" or (kind == "momentum" and draw.chance(0.4)):
        return np.ones(3), own
    if kind == "rod":
        symmetric[own] = draw.one(0.0, draw.log(-9, -2), draw.log(-6, -2))
        return symmetric, own
    shape = draw.one("sphere", "symmetric", "near", "triaxial", "triaxial", "triaxial")
    if shape == "sphere":
        return np.ones(3), own
    if shape == "symmetric":
        return symmetric, own
    if shape == "near":
        symmetric[(own + 1) % 3] += draw.log(-13, -2)
        return symmetric, own
    a, b, c = draw.rng.uniform(0.05, 1.0, 3)
    return np.array([b + c, c + a, a + b]), own


def body_of(draw, kind):
    """(table, moments, axes as columns, own axis, size of the moments)"""
    moments, own = moments_of(draw, kind)
    size = draw.one(1.0, 1.0, draw.log(-3, 3))
    moments = np.array(rounded(size * moments, 15 if draw.chance(0.1) else 4))
    R = np.eye(3)
    mass = rounded(draw.one(1.0, 2.0, draw.log(-1, 2)) * size)
    inertia = moments.tolist()
    if draw.chance(0.2) and min(moments) > 0.0:
        R = draw.rotation().as_matrix()
        M = R @ np.diag(moments) @ R.T
        inertia = (0.5 * (M + M.T)).tolist()
    return {"mass": mass, "inertia": inertia}, moments, R, own, size


def rates_of(draw, kind, R, own, moments):
    rate = draw.one(0.03, 1.0, 3.0, 20.0, draw.log(-2, 2.3))
    way = draw.one("rest", "principal", "near", "any", "any", "any")
    ways = {
        **dict.fromkeys(("constant rate", "one axis", "thrust"), "principal"),
        **dict.fromkeys(("pendulum", "swinging"), draw.one("rest", "principal")),
        **dict.fromkeys(("free", "pushed"), draw.one("near", "any")), "equilibrium": "rest",
        "no rotation": draw.one("rest", "any"), "top": draw.one("near", "any", "any"),
    }  # fmt: skip
    way = ways.get(kind, way)
    axis = R[:, own]
    if way == "rest":
        return np.zeros(3), axis
    omega = rate * axis * draw.one(1.0, -1.0)
    if way == "near":
        omega = omega + draw.vector(rate * draw.log(-13, -1))
    if way == "any":
        omega = draw.vector(rate)
    omega = omega - R @ np.where(moments == 0.0, R.T @ omega, 0.0)
    return np.array(rounded(omega)) if np.array_equal(R, np.eye(3)) else omega, axis


def loads_of(draw, kind, body, omega, axis, R, moments):
    """Known loads; body is given arm and pivot."""
    size, mass, rate = float(np.max(moments)), body["mass"], max(float(np.linalg.norm(omega)), 0.3)
    twist = size * rate * rate * draw.one(0.003, 0.1, 1.0)
    loads = {"gravity_a": draw.one([0.0] * 3, [0.0, 0.0, -9.81])}
    if min(moments) == 0.0:
        if draw.chance(0.5):
            body |= {"pivot": True, "r_oc_b": rounded(draw.rng.uniform(-0.5, 0.5) * axis)}
            loads["gravity_a"] = [0.0, 0.0, -9.81]
        return loads
    damping = draw.one(0.0, 0.0, 0.02, 0.3) * size * rate
    if kind == "one axis":
        loads |= {"torque_b": (twist * axis).tolist(), "damping_b": [damping] * 3}
    if kind in ("pendulum", "swinging"):
        own = int(np.argmax(np.abs(R.T @ axis)))
        turn = Rotation.from_rotvec(draw.rng.uniform(-3.0, 3.0) * axis)
        body |= {"pivot": True, "r_oc_b": (draw.rng.uniform(0.05, 0.7) * turn.apply(R[:, own - 1])).tolist()}
        loads["gravity_a"] = (9.81 * R[:, own - 2]).tolist()
        if kind == "swinging":
            loads |= {"torque_b": (twist * axis).tolist(), "damping_b": [damping] * 3}
    if kind == "equilibrium":
        down = draw.one(-1.0, -1.0, 1.0)
        body |= {"pivot": draw.chance(0.7), "r_oc_b": [0.0, 0.0, down * draw.one(0.1, 1.0)]}
        loads["gravity_a"] = [0.0, 0.0, -9.81]
        if not body["pivot"]:
            loads["force_a"] = [0.0, 0.0, 9.81 * mass]
        loads["damping_b"] = rounded([damping] * 3)
    if kind == "momentum":
        loads["torque_a"] = rounded(draw.vector(twist))
    if kind == "sphere":
        way = np.linalg.norm(omega) and omega / np.linalg.norm(omega)
        loads |= {"torque_b": (twist * (way if np.any(way) else draw.vector())).tolist()} if draw.chance(0.8) else {}
        loads["damping_b"] = rounded([draw.one(0.0, damping)] * 3)
    if kind in ("pushed", "thrust"):
        loads["force_b"] = (mass * draw.log(-2, 1) * (axis if kind == "thrust" else draw.vector())).tolist()
    if kind == "spun":
        loads |= {"torque_b": (twist * axis).tolist(), "damping_b": rounded([draw.one(0.0, damping)] * 3)}
    if kind in ("top", "weight off centre"):
        arm = axis if kind == "top" and draw.chance(0.7) else draw.vector()
        body |= {"pivot": draw.chance(0.7), "r_oc_b": (draw.one(0.02, 0.1, 0.5) * draw.one(1, -1) * arm).tolist()}
        loads["gravity_a"] = [0.0, 0.0, -9.81]
        loads |= {
            n: rounded(draw.vector(size)) for n, size in (("force_a", mass), ("torque_a", twist)) if draw.chance(0.4)
        }
    if kind in ("loads", "tiny loads"):
        small = draw.log(-13, -2) if kind == "tiny loads" else 1.0
        names = draw.some(("torque_a", "torque_b", "force_a", "force_b", "damping_b"), 0.45) or ["torque_b"]
        sizes = {
            "torque_a": twist, "torque_b": twist, "force_a": mass, "force_b": mass, "damping_b": damping or 0.1 * size,
        }  # fmt: skip
        loads |= {
            n: rounded(np.abs(v) if n == "damping_b" else v) for n in names for v in [draw.vector(small * sizes[n])]
        }
        if draw.chance(0.4):
            body |= {"r_oc_b": rounded(draw.vector(draw.one(0.05, 0.4))), "pivot": draw.chance(0.3)}
    if kind == "rod":
        free = np.linalg.norm(R[:, np.argmin(moments)])
        loads |= {"torque_b": rounded(draw.vector(twist * free))} if draw.chance(0.7) else {}
    if kind in ("no rotation", "constant rate", "free", "free symmetric") and draw.chance(0.4):
        loads["force_a"] = rounded(draw.vector(mass))
    return loads


def fastest(body, omega, loads, moments):
    """Some rate that the motion may come to, rad/s, and an angular acceleration."""
    least = max(float(np.min(moments[moments > 0.0])), 1e-3 * float(np.max(moments)))
    arm = np.linalg.norm(body.get("r_oc_b", 0.0))
    force = sum(np.linalg.norm(loads.get(n, 0.0)) for n in ("force_a", "force_b"))
    torque = sum(np.linalg.norm(loads.get(n, 0.0)) for n in ("torque_a", "torque_b"))
    if body.get("pivot"):
        least, force = least + body["mass"] * arm**2, body["mass"] * np.linalg.norm(loads["gravity_a"])
    damping = np.max(np.abs(loads.get("damping_b", 0.0)))
    return float(np.linalg.norm(omega)) + np.sqrt(force * arm / least) + damping / least, torque / least


def run_of(draw, rate, acceleration):
    turn = draw.log(-0.5, draw.one(1.3, 2.2))
    stop = turn / rate if rate > 0.0 else draw.log(0, 2)
    if acceleration > 0.0:
        stop = min(stop, np.sqrt(2.0 * turn / acceleration))
    stop = rounded(min(stop, 1000.0), 2)
    start = draw.one(0.0, 0.0, 0.0, 0.0, 0.0, 1.0, -3.5, 1e5)
    return {"start": start, "stop": start + stop, "step": rounded(stop / draw.one(*STEPS), 6),
            "accuracy": rounded(draw.log(draw.one(-12, -6), -3), 2)}  # fmt: skip


def wanted_of(draw, kind, pivot):
    names = [q for q in QUANTITIES if not (pivot and q in ("position", "velocity", "acceleration"))]
    if kind == "prescribed":
        names = ["quaternion", "rpy", "omega_a"]
    if kind == "spun" and draw.chance(0.5):
        return ["omega_b"]
    if kind == "momentum" and draw.chance(0.6):
        return draw.one(["angular_momentum_a"], ["omega_a"], ["angular_momentum_a", "omega_a"])
    if kind in ("no rotation", "pushed", "thrust") and not pivot:
        names = draw.one(names, ["position", "velocity"], ["position", "velocity", "acceleration"])
    way = draw.one("one", "one", "few", "few", "all")
    if way == "one":
        return [draw.one(*names)]
    return (draw.some(names, 0.35) or [draw.one(*names)]) if way == "few" else names


def random_scene(seed):
    """(kind, scene); raises SceneError where its tables contradict each other."""
    draw = Draw([seed, 11])
    kind = KINDS[seed % len(KINDS)]
    if kind == "prescribed":
        q = {"quaternion": draw.rotation().as_quat(scalar_first=True).tolist()}
        run = run_of(draw, draw.log(-1, 2), 0.0)
        return kind, Scene(name=f"seed_{seed}", initial={"attitude": q}, inputs={"ports": ["omega_b"]}, run=run,
                           outputs={"quantities": wanted_of(draw, kind, False)})  # fmt: skip
    body, moments, R, own, _ = body_of(draw, kind)
    omega, axis = rates_of(draw, kind, R, own, moments)
    loads = loads_of(draw, kind, body, omega, axis, R, moments)
    beam = min(moments) == 0.0
    initial = {"omega_b": np.asarray(omega).tolist()}
    upright = kind == "equilibrium" and draw.chance(0.8)
    if not upright and kind not in ("pendulum", "swinging") and draw.chance(0.7):
        initial["attitude"] = {"rotvec": rounded(draw.vector(draw.rng.uniform(0, 3.1)))}
    if not body.get("pivot") and draw.chance(0.5):
        initial |= {
            "velocity": rounded(draw.vector(draw.log(-1, 3))),
            "position": rounded(draw.vector(draw.log(-1, 3))),
        }
    ports = draw.some(PORTS[:4], 0.3) if draw.chance(0.25) and not beam else []
    listed = draw.some([p for p in PARAMETERS if p not in ports], 0.25) if draw.chance(0.25) and not beam else []
    listed = [p for p in listed if not (body.get("pivot") and p == "velocity_0")]
    run = run_of(draw, *fastest(body, np.asarray(omega), loads, moments))
    return kind, Scene(name=f"seed_{seed}", body=body, initial=initial, loads=loads, run=run,
                       inputs={"ports": ports, "parameters": listed},
                       outputs={"quantities": wanted_of(draw, kind, body.get("pivot"))})  # fmt: skip
