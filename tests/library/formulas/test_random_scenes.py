"""Scenes with formulas drawn by a grammar, against SciPy's DOP853 on the same texts as Python reads them.

Each is drawn from its seed; a failure prints the scene.
By hand: python -m tests.library.formulas.test_random_scenes 0 300
"""

import math
import random
import sys
import time

import numpy as np
import pytest

import rbfmu
from tests.library.formulas.test_scenes import B, by_scipy, worst

ACCURACY = 1e-8
LOOSE = 5e-9
"""What SciPy's tight run may be off beside corners, where its steps go across."""
SCALARS = ("t", "c", "omega_b[{i}]", "position[{i}]", "velocity[{i}]", "R_ab[{i},{j}]", "u", "q_ab[{k}]")
FUNCTIONS = ("sin({})", "cos({})", "exp(-abs({}))", "log(2 + ({})**2)", "sqrt(1.5 + ({})**2)", "atan2({}, 2.5)",
             "({})/(2 + cos({}))", "clip({}, -0.6, 0.7)", "min({}, {})", "max({}, 0.3*({}))", "abs({})",
             "where({} > 0.2, {}, -0.3)", "(1 + ({})**2)**0.7", "table(ramp, {})", "table(wave, {})",
             "norm([{}, 1, {}])", "tan(0.4*sin({}))", "asin(0.8*cos({}))")  # fmt: skip
VECTORS = ("omega_b", "velocity", "position", "omega_a", "to_a(omega_b)", "to_b(velocity)", "M_c @ omega_b", "w",
           "to_b([cos(c*t), sin(c*t), 0])")  # fmt: skip
SHOWN = (["omega_b"], ["quaternion", "omega_b"], ["position", "omega_b"])


class Drawn:
    """One scene's texts."""

    def __init__(self, seed):
        self.r, self.seed = random.Random(seed), seed
        self.states = self.r.random() < 0.5

    def scalar(self, depth):
        r = self.r
        if depth <= 0 or r.random() < 0.25:
            text = r.choice([s for s in SCALARS if self.states or s != "u"])
            return text.format(i=r.randint(1, 3), j=r.randint(1, 3), k=r.randint(1, 4))
        if r.random() < 0.4:
            return f"({self.scalar(depth - 1)}) {r.choice('+-*')} ({self.scalar(depth - 1)})"
        if r.random() < 0.2:
            return f"dot({self.vector(depth - 2)}, {self.vector(depth - 2)})"
        made = r.choice(FUNCTIONS)
        return made.format(*(self.scalar(depth - 1) for _ in range(made.count("{}"))))

    def vector(self, depth):
        r = self.r
        if depth <= 0 or r.random() < 0.3:
            return r.choice([v for v in VECTORS if self.states or v != "w"])
        if r.random() < 0.3:
            return f"cross({self.vector(depth - 1)}, {self.vector(depth - 1)})"
        if r.random() < 0.5:
            return f"({self.scalar(depth - 1)}) * ({self.vector(depth - 1)})"
        return f"[{', '.join(self.scalar(depth - 1) for _ in range(3))}]"

    def bounded(self, depth):
        """A vector that stays small, and damps what may grow."""
        text = self.vector(depth)
        return f"0.8*({text})/(1 + norm({text}))"

    def tables(self):
        r = self.r
        pivot = r.random() < 0.25
        q = np.random.default_rng(self.seed).standard_normal(4)
        q = (q / np.linalg.norm(q)).tolist()
        initial = {"attitude": {"quaternion": q}, "omega_b": [r.uniform(-1, 1) for _ in range(3)]}
        initial |= {} if pivot else {n: [r.uniform(-1, 1) for _ in range(3)] for n in ("velocity", "position")}
        names = ["torque_a", "torque_b"] + ([] if pivot else ["force_a", "force_b"])
        loads = {name: self.bounded(3) for name in r.sample(names, r.randint(1, 2))}
        loads |= {"damping_b": [0.3, 0.3, 0.3], "gravity_a": [0.0, 0.0, -1.0 if r.random() < 0.5 else 0.0]}
        found = {
            "body": B | {"pivot": pivot}, "initial": initial, "loads": loads,
            "constants": {"c": r.uniform(0.5, 2.0)},
            "tables": {"ramp": {"x": [-1.0, 0.0, 0.5, 2.0], "y": [0.2, -0.4, 0.5, 0.1]},
                       "wave": {"x": [-1.0, 0.2, 1.0], "y": [0.3, -0.2, 0.4], "method": "cubic"}},
            "outputs": {"quantities": r.choice(SHOWN[: 2 if pivot else 3])},
            "run": {"stop": 3.0, "step": 0.1, "accuracy": ACCURACY},
        }  # fmt: skip
        if self.states:
            found["states"] = {"u": {"start": 0.2, "rate": f"-u + 0.5*tanh({self.scalar(2)})".replace("tanh", "sin")},
                               "w": {"start": [0.1, 0.2, 0.3], "rate": f"-w + 0.5*({self.bounded(2)})"}}  # fmt: skip
        return found


class Counted:
    """What is counted from 1, for Python."""

    def __init__(self, values):
        self.values = np.asarray(values, float)

    def __getitem__(self, index):
        return self.values[tuple(k - 1 for k in index) if isinstance(index, tuple) else index - 1]


class Vector(np.ndarray):
    """A vector whose indices count from 1."""

    def __getitem__(self, index):
        inner = np.asarray(self)
        return inner[tuple(k - 1 for k in index) if isinstance(index, tuple) else index - 1]


def vector(values):
    return np.asarray(values, float).view(Vector)


def environment(tables, t, R, w, p, v, own):
    from scipy.interpolate import CubicSpline

    ramp, wave = tables["tables"]["ramp"], tables["tables"]["wave"]
    spline = CubicSpline(wave["x"], wave["y"], bc_type="natural")
    read = {"ramp": lambda x: float(np.interp(x, ramp["x"], ramp["y"])),
            "wave": lambda x: float(spline(min(max(x, wave["x"][0]), wave["x"][-1])))}  # fmt: skip
    plain = np.asarray
    return {
        "t": t, "c": tables["constants"]["c"], "omega_b": vector(w), "omega_a": vector(R @ w), "position": vector(p),
        "velocity": vector(v), "R_ab": vector(R), "M_c": vector(B["inertia"]), "q_ab": vector(own[-4:]),
        "u": own[0] if len(own) > 4 else 0.0, "w": vector(own[1:4]) if len(own) > 4 else None,
        "sin": math.sin, "cos": math.cos, "exp": math.exp, "log": math.log, "sqrt": math.sqrt, "atan2": math.atan2,
        "tan": math.tan, "asin": math.asin, "abs": abs, "min": min, "max": max,
        "clip": lambda x, a, b: min(max(x, a), b), "where": lambda c, a, b: a if c else b,
        "norm": lambda x: float(np.linalg.norm(plain(x))), "dot": lambda a, b: float(plain(a) @ plain(b)),
        "cross": lambda a, b: vector(np.cross(plain(a), plain(b))), "table": lambda f, x: f(x),
        "to_a": lambda x: vector(R @ plain(x)), "to_b": lambda x: vector(R.T @ plain(x)), **read,
    }  # fmt: skip


class InPython:
    """The same texts, as Python reads them."""

    def __init__(self, tables):
        self.tables = tables
        listed = lambda text: text.replace("[", "V([", 1) if text.startswith("[") else text  # noqa: E731
        texts = {k: v for k, v in tables["loads"].items() if isinstance(v, str)}
        self.loads = {k: compile(_with_vectors(listed(v)), k, "eval") for k, v in texts.items()}
        self.states = {k: compile(_with_vectors(row["rate"]), k, "eval") for k, row in tables.get("states", {}).items()}

    def __call__(self, t, R, w, p, v, own):
        names = environment(self.tables, t, R, w, p, v, own) | {"V": vector}
        return {k: np.asarray(eval(code, names), float) for k, code in self.loads.items()}

    def rates(self, t, R, w, p, v, own):
        names = environment(self.tables, t, R, w, p, v, own) | {"V": vector}
        return np.concatenate([np.ravel(np.asarray(eval(code, names), float)) for code in self.states.values()])


def _with_vectors(text):
    """Lists of numbers as vectors, by Python's own grammar."""
    import ast

    class Lists(ast.NodeTransformer):
        def visit_List(self, node):
            self.generic_visit(node)
            return ast.Call(ast.Name("V", ast.Load()), [node], [])

    tree = Lists().visit(ast.parse(text.replace("V([", "(["), mode="eval"))
    return ast.fix_missing_locations(tree)


def tried(seed):
    """(plan or None, error over accuracy, what was said, s of CPU)."""
    tables, begin = Drawn(seed).tables(), time.process_time()
    scene = rbfmu.Scene.from_dict(tables, f"seed_{seed}")
    try:
        planned = rbfmu.plan(scene)
        result = rbfmu.simulate(scene, planned=planned)
    except (rbfmu.SceneError, rbfmu.SimulationError) as error:
        return None, 0.0, str(error), time.process_time() - begin
    spent = time.process_time() - begin
    found = InPython(tables)
    truth = by_scipy(tables, found, result.time, found.rates if tables.get("states") else None,
                     [0.2, 0.1, 0.2, 0.3] if tables.get("states") else [], whole=True)  # fmt: skip
    return planned, worst(result, truth, scene.outputs.quantities) / ACCURACY, repr(planned), spent


@pytest.mark.parametrize("seed", range(6))
def test_random_formulas_meet_the_accuracy_or_are_refused(seed):
    _, error, said, _ = tried(seed)
    assert error <= 1.0 + LOOSE / ACCURACY, f"{said}\n{Drawn(seed).tables()}"


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(1000, 1300))
def test_300_random_formulas_meet_the_accuracy_or_are_refused(seed):
    _, error, said, _ = tried(seed)
    assert error <= 1.0 + LOOSE / ACCURACY, f"{said}\n{Drawn(seed).tables()}"


if __name__ == "__main__":
    first, count = map(int, sys.argv[1:])
    for number in range(first, first + count):
        planned, error, said, spent = tried(number)
        print(f"{number}: {spent:.1f} s, {error:.2g} of the accuracy: {said}", flush=True)
