"""Counts and times of levels that rates of torque-free bodies pass, to 40 digits; the product must find as many.

A rate is monotonic between the zeros of the two others (Euler's equations), and these lie far apart: so no passage of a
level is overlooked. Two levels are drawn a millionth of a second apart, and a run is one communication step.
The campaign, by hand: python -m tests.support.references.events_mp 0 30
"""

import sys
from itertools import pairwise

import mpmath as mp
import numpy as np

import rbfmu
from tests.support.references.free_rotation_mp import closed_form

ACCURACY, APART, POINTS, DIGITS = 1e-9, 1e-6, 150, 60
TOLD = 2e-14
"""How far what is watched goes between two roots, over its size or what round-off of the level makes of
it, that doubles tell it from zero for certain."""
UNTURNED = (1.0, 0.0, 0.0, 0.0)


class Tumbling:
    """A torque-free body drawn from a seed, and its rates at any time."""

    def __init__(self, seed):
        rng = np.random.default_rng(seed)
        parts = np.sort(rng.uniform(0.3, 2.0, 3))
        self.moments = [
            float(x) for x in rng.permutation([parts[0] + parts[1], parts[0] + parts[2], parts[1] + parts[2]])
        ]
        self.omega_0 = [float(x) for x in rng.normal(0.0, 1.0, 3)]
        self.stop = float(rng.uniform(20.0, 60.0)) / float(np.linalg.norm(self.omega_0))
        self.axis, self.rng = int(np.argmin(np.abs(np.array(self.moments) - np.median(self.moments)))), rng
        self.known = {}

    def levels(self):
        """Two levels passed so near each other, where the rate changes fastest of some times drawn.

        What is watched goes from zero to zero there by a square of 5e-7 of the slope, which doubles must tell from it.
        """
        times = [mp.mpf(self.stop) * float(x) for x in self.rng.uniform(0.1, 0.9, 20)]
        first = max(times, key=lambda t: abs(self.omega(t + APART)[self.axis] - self.omega(t)[self.axis]))
        return [float(self.omega(t)[self.axis]) for t in (first, first + APART)]

    def omega(self, t):
        if t not in self.known:
            self.known[t] = closed_form(self.moments, UNTURNED, self.omega_0, t)[1]
        return self.known[t]

    def zeros(self, axis, level=0):
        """Times in ascending order at which a rate passes a level that it reaches once between two of POINTS."""
        grid = [mp.mpf(self.stop) * k / POINTS for k in range(POINTS + 1)]
        return [self.root(axis, level, a, b) for a, b in pairwise(grid) if self.passes(axis, level, a, b)]

    def passes(self, axis, level, a, b):
        return (self.omega(a)[axis] - level) * (self.omega(b)[axis] - level) < 0

    def root(self, axis, level, a, b):
        return mp.findroot(lambda t: self.omega(t)[axis] - level, (a, b), solver="anderson", tol=1e-60)

    def passages(self, level):
        """Times at which the rate passes a level: at most once between two of its extremes."""
        others = [k for k in range(3) if k != self.axis]
        ends = sorted([mp.mpf(0), *(t for k in others for t in self.zeros(k)), mp.mpf(self.stop)])
        return [self.root(self.axis, level, a, b) for a, b in pairwise(ends) if self.passes(self.axis, level, a, b)]


def judged(seed):
    """(roots, touches, how many roots there are, whether doubles tell all, the size there over the accuracy)."""
    with mp.workdps(DIGITS):
        body = Tumbling(seed)
        levels = body.levels()
        truth = sum(len(body.passages(level)) for level in levels)
    watched = "*".join(f"(omega_b[{body.axis + 1}] - ({level!r}))" for level in levels)
    scene = rbfmu.Scene.from_dict({
        "body": {"mass": 1.0, "inertia": body.moments},
        "initial": {"omega_b": body.omega_0},
        "events": {"passage": watched},
        "outputs": {"quantities": ["omega_b"]},
        "run": {"stop": body.stop, "step": body.stop, "accuracy": ACCURACY},
    })  # fmt: skip
    run = rbfmu.simulate(scene)
    found, touches = run.events["passage"], len(run.touches["passage"])
    with mp.workdps(DIGITS):
        sizes = [abs(mp.fprod(body.omega(mp.mpf(t))[body.axis] - x for x in levels)) for t in (*found, 0.0, body.stop)]
        told = (0.5 * (levels[1] - levels[0])) ** 2 > TOLD * max(max(sizes), mp.sqrt(max(sizes)) * abs(levels[0]))
    return len(found), touches, truth, told, float(max(sizes[:-2], default=0.0) / max(sizes) / mp.mpf(ACCURACY))


def right(roots, touches, true, told):
    """Whether all roots are found; two that doubles do not tell from a touch may be one."""
    return roots == true and not touches if told else roots + 2 * touches == true


def _main(first, count):
    wrong, worst, total, left = 0, 0.0, 0, 0
    for seed in range(first, first + count):
        *counts, size = judged(seed)
        print(
            f"{seed}: {counts[0]} roots, {counts[1]} touches of {counts[2]} roots, told: {counts[3]}; {size:.1g}",
            flush=True,
        )
        wrong, worst, total, left = wrong + (not right(*counts)), max(worst, size), total + counts[2], left + counts[1]
    print(
        f"{count} motions, {total} roots: {wrong} wrong, {left} pairs that touch; at most {worst:.1g} of the accuracy"
    )


if __name__ == "__main__":
    _main(*map(int, sys.argv[1:]))
