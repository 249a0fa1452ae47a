"""What the laws measure, of a method of the reader's own: no theory predicts it, an exact motion stands beside it."""

import math
from collections.abc import Callable, Sequence

import numpy as np

from rbfmu.studies.reference_methods import OneStepMethod
from rbfmu.studies.stability.findings import OWN, Finding, Study, exponent
from rbfmu.studies.stability.maps import verdict_of_steps
from rbfmu.studies.stability.method_laws import (
    crossing,
    decay_factor,
    energies,
    growth,
    passage_error,
    rod_growth,
)

CURVE = "your method"
"""The column of a study that has its curve."""
ROUND_OFF, ROUGH, RATIO = 1e-11, 1e-3, 0.1


def own_laws(method: OneStepMethod, studies: Sequence[Study]) -> Study:
    """Return what is found of a method, and put its curves beside those of the studies that were measured."""
    curves: dict[str, Callable[[float], float]] = {
        "growth_factors": lambda x: growth(method, x),
        "gimbal_passage": lambda x: passage_error(method, x),
        "damping_limits": lambda x: abs(decay_factor(method, x)),
    }
    for study in studies:
        x = next(iter(study.columns.values()))
        if study.name in curves:
            study.columns[CURVE] = [curves[study.name](value) for value in x]
        elif study.name == "energy_drift":
            study.columns[CURVE] = [abs(error) for error in energies(method, 0.1, x)]
        elif study.name == "gyroscopic_blow_up":
            study.columns[CURVE] = rod_growth(method)
    short, long = (abs(error) for error in energies(method, 0.1, [1000, 10_000]))
    measured = (
        (1, "growth of |q| in a step less 1, h omega = 0.1", 0.0, growth(method, 0.1) - 1.0),
        (2, "largest h omega up to which |q| does not grow", math.inf, largest_stable(curves["growth_factors"])),
        (4, "error in rad at h omega / delta = 1", 0.0, passage_error(method, 1.0)),
        (5, "thin rod, nutation over its start after 1 s", 1.0, rod_growth(method)[-1]),
        (6, "largest h d / I", math.inf, largest_stable(curves["damping_limits"])),
        (8, "relative energy error after 1000 steps, h = 0.1", 0.0, short),
        (8, "relative energy error after 10,000 steps", 0.0, long),
        (14, "order: the power of h in the attitude's error", math.inf, order(method)),
    )
    findings = [Finding(law, f"{method.name}: {what}", exact, found, 0.0, OWN) for law, what, exact, found in measured]
    return Study("your_method", findings)


def largest_stable(factor: Callable[[float], float]) -> float:
    """Return up to where a step's factor is at most 1, but for round-off; infinite if no end is found."""

    def without_round_off(x: float) -> float:
        return factor(x) - 1e-12

    last = 0.0
    for x in np.linspace(0.05, 20.0, 400).tolist():
        if not without_round_off(x) <= 1.0:
            return crossing(without_round_off, last, x)
        last = x
    return math.inf


def order(method: OneStepMethod) -> float:
    """Return the order between two steps where the error is small, yet more than round-off, else NaN."""
    before = math.inf
    for k in range(10):
        error = verdict_of_steps(method, 0.5 * 0.5**k, RATIO)[1]
        if error < ROUGH and before < 64.0 * ROUGH:
            return exponent(before, error) if error > ROUND_OFF else math.nan
        before = error
    return math.nan
