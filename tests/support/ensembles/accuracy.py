"""Whether all members of an ensemble meet its accuracy: random ensembles of series, each member against tight series.

Of all that were run, the CHECKED members that look worst, and as many others, are judged in quadruple precision.
By hand: python -m tests.support.ensembles.accuracy 0 200 1000
"""

import random
import sys
import time
import warnings
from dataclasses import replace
from typing import NamedTuple

import numpy as np

import rbfmu
from rbfmu.ensembles.chunks import Chunk, Work, run_chunk
from rbfmu.ensembles.members import draw, member
from rbfmu.ensembles.planning import plan_ensemble
from rbfmu.runs.motion import attitude_error
from tests.support.quadruple.errors import quantity_error
from tests.support.quadruple.reference import TooDearError, motion, parameters_of

CHECKED = 30


class Member(NamedTuple):
    """A member, its error over the accuracy beside tight series, and its outputs."""

    error: float
    seed: int
    row: int
    outputs: dict[str, np.ndarray]

    def in_quadruple(self, runs: int) -> float:
        """Its error over the accuracy in quadruple precision; NaN where that takes too long."""
        scene = drawn(self.seed, runs)
        own = member(scene, draw(scene, 0, runs), self.row)
        steps = np.diff(np.linspace(0.0, own.run.stop, round(own.run.stop / own.run.step) + 1))
        try:
            truth = motion(parameters_of(own), steps)
        except TooDearError:
            return float("nan")
        return max(quantity_error(name, rows, truth) for name, rows in self.outputs.items()) / scene.run.accuracy


def drawn(seed: int, runs: int) -> rbfmu.Scene:
    """An ensemble under loads by its seed: pivots upright and hanging, free bodies, few and many outputs."""
    r = random.Random(seed)
    near = lambda size: [r.gauss(0.0, size) for _ in range(3)]  # noqa: E731
    a, b = sorted(r.uniform(0.3, 3.0) for _ in range(2))
    c = r.uniform(b - a + 0.05, a + b - 0.05)
    pivot = r.random() < 0.5
    mass, accuracy = r.uniform(0.5, 5.0), 10.0 ** r.uniform(-10.0, -4.0)
    stop = 10.0 ** r.uniform(0.3, 1.5)
    spin = [0.0, 0.0, 0.0] if r.random() < 0.2 else near(10.0 ** r.uniform(-1.0, 0.7))
    tables = {
        "body": {"mass": mass, "inertia": [a, b, c], "pivot": pivot, "r_oc_b": near(0.3)},
        "initial": {"omega_b": spin, "attitude": {"euler": "xyz", "angles": near(1.5)}},
        "loads": {"gravity_a": [0.0, 0.0, -9.81] if r.random() < 0.8 else [0.0, 0.0, 0.0], "torque_b": near(0.3)},
        "outputs": {"quantities": r.choice((["omega_b"], ["quaternion"], ["quaternion", "omega_b"]))},
        "run": {"stop": stop, "step": stop / r.choice((1, 7, 60)), "accuracy": accuracy},
    }
    if r.random() < 0.3:
        tables["loads"]["damping_b"] = [r.uniform(0.0, 0.3) for _ in range(3)]
    if r.random() < 0.3:
        tables["loads"]["force_a" if not pivot else "torque_a"] = near(0.3)
    vary = {"initial.omega_b": {"normal": [spin, [10.0 ** r.uniform(-3.0, -0.5)] * 3]}}
    if r.random() < 0.4:
        vary["body.mass"] = {"normal": [mass, 0.05 * mass]}
    if r.random() < 0.4:
        vary["loads.torque_b"] = {"normal": [tables["loads"]["torque_b"], [0.05] * 3]}
    return rbfmu.Scene.from_dict({**tables, "ensemble": {"runs": runs, "keep": ["all"], "vary": vary}}, f"seed {seed}")


def run(scene: rbfmu.Scene, plan: rbfmu.Plan) -> Chunk:
    """All members."""
    return run_chunk(Work(scene, plan, scene.ensemble.runs), 0)


def errors(scene: rbfmu.Scene, plan: rbfmu.Plan) -> np.ndarray:
    """The error of each member over the accuracy; NaN of those that fail."""
    return errors_beside(scene, run(scene, plan), run(scene, tight(plan)))


def errors_beside(scene: rbfmu.Scene, found: Chunk, truth: Chunk) -> np.ndarray:
    """The same of members that were run."""
    a, b = found.arrays, truth.arrays
    worst = np.zeros(found.members)
    for name in scene.outputs.names:
        if name == "quaternion":
            one = np.array([attitude_error(x, y).max() for x, y in zip(a[name], b[name], strict=True)])
        else:
            size = np.linalg.norm(b[name], axis=-1).max(axis=1)
            one = np.linalg.norm(a[name] - b[name], axis=-1).max(axis=1) / np.where(size > 0.0, size, 1.0)
        worst = np.maximum(worst, one)
    return worst / scene.run.accuracy


def tight(plan: rbfmu.Plan) -> rbfmu.Plan:
    return replace(plan, order=24, tolerance=1e-17, span=0.0, interpolated=False)


def main(first: int, last: int, runs: int) -> None:
    warnings.simplefilter("ignore")
    beyond, longest, chosen = [], 0.0, random.Random(first)
    worst_looking: list[Member] = []
    others: list[Member] = []
    for seed in range(first, last):
        scene = drawn(seed, runs)
        begin = time.process_time()
        try:
            plan = plan_ensemble(scene)
        except rbfmu.SceneError as error:
            print(seed, "refused:", error, flush=True)
            continue
        taken = time.process_time() - begin
        longest = max(longest, taken)
        if plan.model != "body under loads, by series":
            print(seed, plan.model)
            continue
        rows = run(scene, plan)
        found = errors_beside(scene, rows, run(scene, tight(plan)))
        worst = np.nanmax(found)
        outputs = {name: rows.arrays[name] for name in scene.outputs.names}
        of_row = lambda i: Member(found[i], seed, i, {name: v[i] for name, v in outputs.items()})  # noqa: B023, E731
        worst_looking = sorted([*worst_looking, of_row(int(np.nanargmax(found)))], reverse=True)[:CHECKED]
        others.append(of_row(chosen.choice(np.flatnonzero(np.isfinite(found)).tolist())))
        beyond += [seed] if worst > 1.0 else []
        how = "all pilots" if plan.span == 0.0 else "one by one"
        print(f"{seed}: worst {worst:.2g} median {np.nanmedian(found):.2g} of {scene.run.accuracy:.1e}, {how}, order "
              f"{plan.order}, pilots {plan.error / scene.run.accuracy:.2g}, planned in {taken:.3f} s"
              f"{' BEYOND' if worst > 1.0 else ''}", flush=True)  # fmt: skip
    print(f"beyond: {beyond}; longest plan {longest:.2f} s")
    for name, some in (("worst", worst_looking), ("other", chosen.sample(others, min(CHECKED, len(others))))):
        for one in some:
            true = one.in_quadruple(runs)
            found = f"{one.error:.3g}, in quadruple precision {true:.3g}"
            print(f"{name} {one.seed}, member {one.row}: {found}", flush=True)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
