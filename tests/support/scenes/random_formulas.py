"""Scenes with formulas drawn by a grammar, and how far their runs are from the same texts as Python reads them.

Each is drawn from its seed, with corners for certain where that is odd. The campaign, by hand, in 120 bits:
python -m tests.support.scenes.random_formulas 0 300
"""

import collections
import random
import sys
import time
import types
from itertools import islice
from unittest.mock import patch

import numpy as np

import rbfmu
from tests.support.references.by_scipy import B, worst
from tests.support.references.formulas_by_eval import BITS_120, DOUBLES, Motion, NoTruthError

ACCURACY, STEP, PARTS, ROWS = 1e-8, 0.1, 7, 28
"""The step is planned; it is also taken that many times longer and shorter."""
SCALARS = ("t", "c", "omega_b[{i}]", "position[{i}]", "velocity[{i}]", "R_ab[{i},{j}]", "u", "q_ab[{k}]")
FUNCTIONS = ("sin({})", "cos({})", "exp(-abs({}))", "log(2 + ({})**2)", "sqrt(1.5 + ({})**2)", "atan2({}, 2.5)",
             "({})/(2 + cos({}))", "clip({}, -0.6, 0.7)", "min({}, {})", "max({}, 0.3*({}))", "abs({})",
             "where({} > 0.2, {}, -0.3)", "(1 + ({})**2)**0.7", "table(ramp, {})", "table(wave, {})",
             "norm([{}, 1, {}])", "tan(0.4*sin({}))", "asin(0.8*cos({}))")  # fmt: skip
VECTORS = ("omega_b", "velocity", "position", "omega_a", "to_a(omega_b)", "to_b(velocity)", "M_c @ omega_b", "w",
           "to_b([cos(c*t), sin(c*t), 0])")  # fmt: skip
SHOWN = (["omega_b"], ["quaternion", "omega_b"], ["position", "omega_b"])


CORNERED = ("abs({})", "clip({}, -0.4, 0.3)", "max({}, 0.1)", "where({} > 0.2, 0.5, -0.3)", "table(ramp, {})",
            "norm(({})*[1, 0.5 + sin(t), 0])")  # fmt: skip


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

    def cornered(self):
        """A vector that reads the constant, and passes a corner again and again."""
        passing = (
            f"sin({self.r.uniform(1.0, 3.0):.3f}*c*t + {self.r.uniform(0.0, 6.0):.3f}) + 0.3*sin({self.scalar(1)})"
        )
        return f"0.3*{self.r.choice(CORNERED).format(passing)}*[1, 0.5, -0.3]"

    def tables(self, cornered=False):
        """cornered: with a load that reads the constant and passes corners for certain."""
        r = self.r
        pivot = r.random() < 0.25
        q = np.random.default_rng(self.seed).standard_normal(4)
        q = (q / np.linalg.norm(q)).tolist()
        initial = {"attitude": {"quaternion": q}, "omega_b": [r.uniform(-1, 1) for _ in range(3)]}
        initial |= {} if pivot else {n: [r.uniform(-1, 1) for _ in range(3)] for n in ("velocity", "position")}
        names = ["torque_a", "torque_b"] + ([] if pivot else ["force_a", "force_b"])
        loads = {name: self.bounded(3) for name in r.sample(names, r.randint(1, 2))}
        if cornered:
            name = next(iter(loads))
            loads[name] += f" + {self.cornered()}"
        loads |= {"damping_b": [0.3, 0.3, 0.3], "gravity_a": [0.0, 0.0, -1.0 if r.random() < 0.5 else 0.0]}
        found = {
            "body": B | {"pivot": pivot}, "initial": initial, "loads": loads,
            "constants": {"c": r.uniform(0.5, 2.0)},
            "tables": {"ramp": {"x": [-1.0, 0.0, 0.5, 2.0], "y": [0.2, -0.4, 0.5, 0.1]},
                       "wave": {"x": [-1.0, 0.2, 1.0], "y": [0.3, -0.2, 0.4], "method": "cubic"}},
            "outputs": {"quantities": r.choice(SHOWN[: 2 if pivot else 3])},
            "run": {"stop": ROWS * STEP, "step": STEP, "accuracy": ACCURACY},
        }  # fmt: skip
        if self.states:
            found["states"] = {"u": {"start": 0.2, "rate": f"-u + 0.5*tanh({self.scalar(2)})".replace("tanh", "sin")},
                               "w": {"start": [0.1, 0.2, 0.3], "rate": f"-w + 0.5*({self.bounded(2)})"}}  # fmt: skip
        return found


class Truth:
    """The motion of a scene's tables, by row of the shortest steps."""

    def __init__(self, tables, arithmetic, parts=PARTS, start=0.0):
        motion, number = Motion(tables, arithmetic), arithmetic.number
        times = (start + k * (STEP / parts) for k in range(ROWS * parts + 1))  # in doubles, as results have them
        self.rows = motion.rows(start, [number(t) - number(start) for t in times])
        self.names, self.parts = tables["outputs"]["quantities"], parts
        self.corners = list(map(float, motion.at_corners))

    def ratio(self, result, step=STEP):
        """The error over the accuracy."""
        every = round(step / STEP * self.parts)
        return worst(result, {name: rows[::every] for name, rows in self.rows.items()}, self.names) / ACCURACY


def tried(seed, arithmetic=DOUBLES):
    """The error over the accuracy, or what was said, as planned."""
    tables = Drawn(seed).tables(cornered=bool(seed % 2))
    found = _planned(tables)
    return found if isinstance(found, str) else _run(found[0], found[1], Truth(tables, arithmetic, 1))


def _planned(tables):
    """(scene, plan), or what was said."""
    scene = rbfmu.Scene.from_dict(tables, "drawn")
    try:
        return scene, rbfmu.plan(scene)
    except rbfmu.SceneError as error:
        return str(error)


def _run(scene, planned, truth, step=STEP):
    """The error over the accuracy, or what was said."""
    try:
        return truth.ratio(rbfmu.simulate(scene.replace({"run.step": step}), planned=planned), step)
    except (rbfmu.SceneError, rbfmu.SimulationError) as error:
        return str(error)


LATE, BESIDE = 1.7e9, 1e-9


def campaign(seed):
    """Yield (setting, error over the accuracy or what was said) of all that a scene must bear."""
    tables = Drawn(seed).tables(cornered=bool(seed % 2))
    if isinstance(found := _planned(tables), str):
        yield "as planned", found
    else:
        truth = Truth(tables, BITS_120)
        for setting, step in (("as planned", STEP), ("times 7", STEP * PARTS), ("over 7", STEP / PARTS)):
            yield setting, _run(*found, truth, step)
        for corner in [one for one in truth.corners if one % STEP > BESIDE][:MOST_CORNERS]:
            yield "restored", _restored(*found, truth, corner)
    late = tables | {"run": tables["run"] | {"start": LATE, "stop": LATE + ROWS * STEP}}
    found = _planned(late)
    try:
        yield "late", found if isinstance(found, str) else _run(*found, Truth(late, BITS_120, 1, LATE))
    except NoTruthError:  # what matters to no output may turn 1e9 times a second
        yield "late", "no truth"
    for end, error in zip(RANGE, at_ends(seed, BITS_120), strict=True):
        yield f"c = {end}", error


# Constants at both ends of a stated range

RANGE = (0.5, 2.0)
"""Of the constant c, whose value a scene that lists it leaves open."""


def at_ends(seed, arithmetic=DOUBLES):
    """[error over accuracy at each end of the range, or what was said], under the one plan of a scene that lists c."""
    tables = Drawn(seed).tables(cornered=True)
    tables |= {"constants": {"c": sum(RANGE) / 2.0}, "inputs": {"parameters": ["c"]}}
    if isinstance(found := _planned(tables), str):
        return [found] * len(RANGE)
    scene, planned = found
    try:
        truths = [Truth(tables | {"constants": {"c": end}}, arithmetic, 1) for end in RANGE]
    except NoTruthError:  # as above
        return ["no truth"] * len(RANGE)
    return [_run(scene.replace({"constants.c": c}), planned, truth) for c, truth in zip(RANGE, truths, strict=True)]


# Saved and restored beside a corner

MOST_CORNERS, AFTER = 3, 6
"""Of a scene the corners beside which it is restored, and the steps that are taken after each."""


def restored_beside_corners(seed):
    """(how many states were restored beside corners, what of these had other bits than a run that goes on)."""
    scene = rbfmu.Scene.from_dict(Drawn(seed).tables(cornered=True), f"seed_{seed}")
    try:
        one = rbfmu.Simulator(scene)
    except rbfmu.SceneError:
        return 0, []
    with patch("rbfmu.simulation._plan", return_value=one.plan):
        other = rbfmu.Simulator(scene)
    tried, wrong = 0, []
    for k, before, after in islice(_corners(one, scene), MOST_CORNERS):
        for part in (before, after, before * (1.0 - 1e-7), after * (1.0 + 1e-7)):
            expected = _rows(one, k, part)
            for kind in ("gone on", "another"):
                tried += 1
                if not _same(_rows(one, k, part, one if kind == "gone on" else other), expected):
                    wrong.append(f"{kind}, {part!r} s after step {k}")
    return tried, wrong


def _restored(scene, planned, truth, corner):
    """The error over the accuracy, or what was said, where a run is saved and restored on both sides of a corner."""
    with patch("rbfmu.simulation._plan", return_value=planned):
        one, other = rbfmu.Simulator(scene), rbfmu.Simulator(scene)
    k, errors = int(corner / STEP), []
    for at in (corner - BESIDE, corner + BESIDE):
        one.reset()
        rows = {name: rows[:: truth.parts].copy() for name, rows in truth.rows.items()}
        try:
            for length in (*[STEP] * k, at - k * STEP):
                one.step(length)
            other.restore(one.save())
            other.step((k + 1) * STEP - at)
            for m in range(k + 1, ROWS + 1):
                for name in truth.names:
                    rows[name][m] = other.values()[name]
                if m < ROWS:
                    other.step(STEP)
        except (RuntimeError, rbfmu.SimulationError) as error:
            return str(error)
        errors.append(truth.ratio(types.SimpleNamespace(**rows)))
    return max(errors)


def _corners(simulator, scene):
    """Yield the step in which a side changes, and in it the last time before and the first after, side by side."""
    place = simulator.plan.kernels.BLOCKS.get("series.sides", slice(0, 0))
    steps, h = round((scene.run.stop - scene.run.start) / scene.run.step), scene.run.step
    sides = lambda: tuple(simulator.buffer()[place])  # noqa: E731
    found = []
    for k in range(steps - 1):
        before, begun, t = simulator.save(), sides(), simulator.time
        simulator.step(h)
        if all(begun) and sides() != begun:
            end, (low, high) = simulator.save(), (0.0, h)
            while low < (middle := 0.5 * (low + high)) < high and t < t + middle:  # else the step would be refused
                simulator.restore(before)
                simulator.step(middle)
                low, high = (middle, high) if sides() == begun else (low, middle)
            simulator.restore(end)
            found.append((k, low, high))
    return (corner for corner in found if corner[1] > 0.0)


def _rows(simulator, k, part, restored=None):
    """All outputs in steps after k whole ones and a part; restored: the simulator that goes on from the state saved."""
    simulator.reset()
    for length in [simulator.scene.run.step] * k + [part]:
        simulator.step(length)
    if restored is not None:
        saved = simulator.save()
        for _ in range(2):
            simulator.step(0.07)
        restored.restore(saved)
        simulator = restored
    rows = [simulator.values()]
    for length in [1e-9, 1e-3, *[0.03] * AFTER]:
        simulator.step(length)
        rows.append(simulator.values())
    return rows


def _same(rows, others):
    pairs = zip(rows, others, strict=True)
    return all(np.array_equal(row[name], other[name]) for row, other in pairs for name in row)


def _main(first, count):
    worst_of, said = collections.defaultdict(lambda: (0.0, None)), collections.Counter()
    for seed in range(first, first + count):
        begin, found = time.process_time(), []
        try:
            for setting, error in campaign(seed):
                found.append(f"{setting} {error if isinstance(error, str) else f'{error:.2g}'}")
                if isinstance(error, str):
                    said[setting] += 1
                else:
                    worst_of[setting] = max(worst_of[setting], (error, seed))
        except NoTruthError:
            found.append("no truth")
        print(f"{seed} ({time.process_time() - begin:.1f} s): {'; '.join(found)}", flush=True)
    for setting, (error, seed) in worst_of.items():
        print(f"{setting}: at most {error:.2g} of the accuracy (seed {seed}), {said[setting]} refused")


if __name__ == "__main__":
    _main(*map(int, sys.argv[1:]))
