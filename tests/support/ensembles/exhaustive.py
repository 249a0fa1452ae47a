"""How much more an ensemble's plan costs than the cheapest order and tolerance that keep every member, by search.

Costs are those of plans, and CPU times of members run in turns (medians of nine).
By hand: python -m tests.support.ensembles.exhaustive 5000 40 1000
"""

import math
import sys
import time
import warnings
from dataclasses import replace
from itertools import islice

import numpy as np

import rbfmu
from rbfmu.ensembles.chunks import Work, run_chunk
from rbfmu.ensembles.fitting import highest_in_lanes
from rbfmu.ensembles.members import draw, member
from rbfmu.ensembles.planning import OF_SERIES, _pilots, plan_ensemble
from rbfmu.models.question import Question
from rbfmu.planning.judge import Judge
from rbfmu.planning.methods import series_cost, whole_series, with_cost
from rbfmu.runs.plan import start_run
from rbfmu.runs.steps import substeps_counted
from tests.support.ensembles.accuracy import drawn, errors_beside, tight

QUARTERS = range(-20, 9)
"""Of a decade, the tolerances that are tried over the accuracy; the error is taken to grow with them."""
COUNTED, ROUNDS = 16, 9
"""Members whose substeps are counted, and rounds in which times are taken."""


class Searched:
    """An ensemble by its seed, its plan, and the cheapest of all others that keep its members within the accuracy."""

    def __init__(self, seed, runs):
        self.scene, self.runs = drawn(seed, runs), runs
        self.plan = plan_ensemble(self.scene)
        self.truth = self._run(tight(self.plan))
        samples = draw(self.scene, 0, COUNTED)
        self.members = [member(self.scene, samples, k) for k in range(COUNTED)]

    def best(self):
        judges = [Judge(Question(pilot)) for pilot in islice(_pilots(self.scene), OF_SERIES)]
        highest = highest_in_lanes(judges, whole_series(self.scene, 0, self.scene.run.accuracy))
        found = [self._loosest(order) for order in range(6, highest + 2, 2)]
        return min(filter(None, found), key=self.cost, default=None)

    def _loosest(self, order):
        low, high, kept = 0, len(QUARTERS) - 1, None
        while low <= high:
            k = (low + high) // 2
            tolerance = self.scene.run.accuracy * 10.0 ** (0.25 * QUARTERS[k])
            plan = replace(self.plan, order=order, tolerance=tolerance, span=0.0)
            kept, low, high = (plan, k + 1, high) if self.worst(plan) <= 1.0 else (kept, low, k - 1)
        return kept

    def _run(self, plan):
        return run_chunk(Work(self.scene, plan, self.runs), 0)

    def worst(self, plan):
        return float(np.nanmax(errors_beside(self.scene, plan, self._run(plan), self.truth)))

    def cost(self, plan):
        """Of a step of a member, ns, as plans count it."""
        asked, steps, total = Question(self.members[0]), self.scene.run.count, 0.0
        for one in self.members:
            z = start_run(one, plan)
            for _ in range(steps):
                plan.kernels.step(z, self.scene.run.step)
            total += substeps_counted(plan.kernels, z)
        substeps = max(total / len(self.members), 1e-9) / steps
        return with_cost(
            asked, replace(plan, states=0, cost=series_cost(plan.order, asked.load_shares) * substeps)
        ).cost

    def seconds(self, plans):
        """CPU times of all members by each plan, in turns: medians."""
        taken = [[] for _ in plans]
        for _ in range(ROUNDS):
            for times, plan in zip(taken, plans, strict=True):
                begin = time.process_time()
                self._run(plan)
                times.append(time.process_time() - begin)
        return [float(np.median(times)) for times in taken]


def main(first, count, runs):
    warnings.simplefilter("ignore")
    ratios = []
    for seed in range(first, first + count):
        try:
            searched = Searched(seed, runs)
        except rbfmu.SceneError as error:
            print(seed, "refused:", error, flush=True)
            continue
        if not math.isclose(searched.plan.span, 0.0):
            print(f"{seed}: no tolerance is likely to hold for the worst member", flush=True)
            continue
        own, best = searched.plan, searched.best()
        if best is None:
            said = any("nearly equal starts" in reason for reason in own.reasons)
            print(f"{seed}: no order and tolerance keeps all; the plan says so: {said}", flush=True)
            continue
        mine, other = searched.seconds([own, best])
        ratios.append((searched.cost(own) / searched.cost(best), mine / other))
        print("{}: {:.2f} by its cost, {:.2f} by CPU time".format(seed, *ratios[-1]))
        for plan in (own, best):
            looseness = plan.tolerance / searched.scene.run.accuracy
            print(f"    order {plan.order}, tolerance {looseness:.2g}, worst {searched.worst(plan):.2g}", flush=True)
    for name, column in zip(("cost", "CPU time"), zip(*ratios, strict=True), strict=True):
        print(f"{name}: median {np.median(column):.2f}, largest {max(column):.2f}, "
              f"above 1.15: {sum(x > 1.15 for x in column)} of {len(column)}")  # fmt: skip


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
