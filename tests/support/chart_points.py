"""Points of charts, made up, and the true states of its motions."""

import math
from dataclasses import replace

from rbfmu.studies.work_precision.cases import CASES, reference
from rbfmu.studies.work_precision.collection import (
    Collection,
    Point,
)  # fmt: skip
from rbfmu.studies.work_precision.plans import verdicts
from rbfmu_kernels.mechanics.equations_of_motion import State


def true_states(key: str):
    truth, case = reference(key), CASES[key]
    rows = zip(truth["r_c"], truth["q"], truth["omega_b"], strict=True)
    return [State(tuple(r), case.start.v_c, tuple(q), tuple(w)) for r, q, w in rows]


def turned_by(q, angle: float):
    e, x, y, z = q
    c, s = math.cos(0.5 * angle), math.sin(0.5 * angle)
    return (e * c - x * s, x * c + e * s, y * c + z * s, z * c - y * s)


def made_point(method: str, family: str, error: float, seconds: float) -> Point:
    drifts = (error, error, math.nan)
    return Point("a", "free body", 5, method, "", family, "step (s)", 0.1, error, 0.0, *drifts, 1.0, seconds, 10.0, 0.0)


def at_rest(method: str, family: str, error: float, seconds: float) -> Point:
    return replace(made_point(method, family, error, seconds), case="e", title="damped spin", value=1e-9)


def judged(error: float, others: float, peer: float, noise: float = 1.1):
    """A plan of 1 µs at 1e-9, whose rival costs so many µs, and a peer."""
    points = [
        replace(at_rest("rbfmu, as planned", "planned", error, 1e-6), detail="closed form"),
        at_rest("exact", "exact", 1e-16, 2e-6),
        at_rest("Taylor, order 16", "Taylor", 1e-11, others * 1e-6),
        at_rest("heyoka.py", "peer", 1e-10, peer * 1e-6),
        at_rest("RK4, matrix", "classic", 1e-8, 1e-9),
    ]
    (found,) = verdicts(Collection([replace(p, spread=noise) for p in points], []))
    return found
