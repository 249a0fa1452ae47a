"""Laws 13 and 14: the product's models against 40-digit references, their orders, and their error control."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from rbfmu.runs.motion import Steps, substeps_counted
from rbfmu.runs.plan import Plan, start_run
from rbfmu.simulation import simulate
from rbfmu.studies.dop853 import Dop853Plan
from rbfmu.studies.stability.findings import AT_MOST, RECORDED, Finding, Study, exponent
from rbfmu.studies.stability.motions import MOTIONS, POINTS, STATE, error_of, error_of_model, prescribed_error, truth

SWING, LOADED, SERIES, TOP = "one swinging axis", "body under loads", "body under loads, by series", "symmetric top"
MOMENTUM, BODY_FORCE = "angular momentum", "torque-free body, body force"


class Case(NamedTuple):
    """A model, the motion that it is tested on, the bound of its error, and its settings."""

    model: str
    motion: str
    bound: float
    substep: float = math.inf
    tolerance: float = 0.0
    order: int = 0

    @property
    def planned(self) -> Plan:
        """Return the plan that `simulate` is given."""
        kind = Dop853Plan if self.model == LOADED else Plan
        return kind(self.model, "", 0, self.substep, self.tolerance, self.order)

    @property
    def name(self) -> str:
        """Return the name of the model with the settings that are varied."""
        order = f", order {self.order}" if self.order else ""
        if self.model == BODY_FORCE:
            order = f", {self.order} points"
        if self.model == LOADED:
            order = ", DOP853" + (", fixed steps" if self.substep < math.inf else "")
        return f"{self.model}{order}"


QUADRATURE_BOUNDS = {3: 5e-11, 4: 3e-14, 5: 3e-15, 6: 3e-15, 7: 3e-15, 8: 3e-15}
"""Error bounds by the number of points of Gauss's rule, in panels of 0.1 s; fewer points are tested by order."""
CASES = (
    Case("no rotation", "fall", 3e-15),
    Case("constant rate", "spin", 3e-15),
    Case("constant rate", "sphere", 3e-15),
    Case("one axis", "run-down", 5e-14),
    Case("one axis", "slow run-down", 5e-14),
    *(Case("undamped pendulum", motion, 3e-15) for motion in ("swing", "nearly upright", "turning over")),
    Case(SWING, "damped swing", 2e-11, tolerance=1e-14, order=4),
    *(Case(SWING, "damped swing", 2e-12, tolerance=t, order=n) for n, t in ((8, 1e-15), (16, 1e-16))),
    Case("torque-free symmetric body", "coin", 3e-15),
    Case("symmetric body spun up", "spin-up", 3e-15),
    *(Case("torque-free body", motion, 3e-15) for motion in ("tumble", "flips", "coin")),
    *(Case(MOMENTUM, motion, 3e-15) for motion in ("pulled", "pulled sphere")),
    *(Case(BODY_FORCE, "body force", bound, substep=0.1, order=n) for n, bound in QUADRATURE_BOUNDS.items()),
    Case(TOP, "top", 1e-8, substep=1e-4, order=2),
    Case(TOP, "top", 1e-12, substep=1e-3, order=4),
    Case(TOP, "top", 1e-12, substep=5e-3, order=6),
    *(Case(LOADED, motion, 2e-13, substep=0.02) for motion in ("loaded", "damped rates", "motor")),
    *(Case(LOADED, motion, 2e-12, tolerance=1e-14) for motion in ("loaded", "damped rates", "motor", "gentle top")),
    *(Case(SERIES, motion, 2e-12, tolerance=1e-14, order=n)
      for n in (6, 8, 12, 16, 20, 24) for motion in ("loaded", "damped rates", "motor", "gentle top")),
)  # fmt: skip
"""Every model, and every method and order that a plan may choose."""


def product_models(quick: bool) -> Study:
    """Measure law 13: the error of each model stays within its bound; `quick` changes nothing here."""
    rows = [(case.name, case.motion, case.bound, error_of_model(case.motion, case.planned)) for case in CASES]
    rows.append(("prescribed rates", "held, then changing", 1e-14, prescribed_error()))
    findings = [Finding(13, f"{name}: largest error", most, error, 0.0, AT_MOST, at) for name, at, most, error in rows]
    findings.append(Finding(13, "series and DOP853 apart, loads that change", 1e-11, _apart(), 0.0, AT_MOST))
    columns = dict(zip(("model", "motion", "bound", "error"), map(list, zip(*rows, strict=True)), strict=True))
    return Study("product_models", findings, columns)


_CHANGING = {
    "force_a": (0.1, -0.2, 0.3),
    "force_b": (0.2, 0.1, -0.1),
    "torque_a": (-0.1, 0.05, 0.1),
    "torque_b": (0.1, 0.1, -0.2),
}
"""Loads through ports; their first derivatives equal their values, their second derivatives are half of them."""


def _driven(case: Case) -> dict[str, Any]:
    """Return the state of the loaded body after five steps with changing loads, or nothing if a step is refused."""
    scene, kernels = MOTIONS["loaded"].replace({"inputs.ports": list(_CHANGING)}), case.planned.kernels
    z = start_run(scene, case.planned)
    for _ in range(5):
        for name, value in _CHANGING.items():
            for block, part in ((name, 1.0), (f"{name}_rate", 1.0), (f"{name}_rate_2", 0.5)):
                z[kernels.BLOCKS[block]] = part * np.array(value)
        if kernels.step(z, 1.0):
            return {}
    return {name: z[kernels.BLOCKS[name]].copy()[None, :] for name in STATE}


def _apart() -> float:
    cases = (Case(model, "", 0.0, tolerance=1e-14, order=n) for model, n in ((SERIES, 16), (LOADED, 0)))
    one, other = map(_driven, cases)
    return error_of(one, other) if one and other else math.inf


_ORDERS = (
    ("splitting of order 2", 2.0, 0.01, Case(TOP, "top", 0.0, order=2)),
    ("splitting of order 4", 4.0, 0.04, Case(TOP, "gentle top", 0.0, order=4)),
    ("splitting of order 6", 6.0, 0.1, Case(TOP, "top", 0.0, order=6)),
    ("Gauss's rule of 1 point", 2.0, 0.125, Case(BODY_FORCE, "body force", 0.0, order=1)),
    ("Gauss's rule of 2 points", 4.0, 0.125, Case(BODY_FORCE, "body force", 0.0, order=2)),
    ("DOP853", 8.0, 0.4, Case(LOADED, "motor", 0.0)),
    ("series of order 6, attitude by 3 derivatives", 6.0, 0.125, Case(SERIES, "motor", 0.0, order=6)),
    ("series of order 8, attitude by 3 derivatives", 6.0, 0.125, Case(SERIES, "motor", 0.0, order=8)),
)
"""The name, the order, a step in s, and the case: halving that step divides the error by 2 to the order."""


def _error_at(case: Case, step: float) -> float:
    """Return the error with a substep; of series, which choose their own, with such communication steps."""
    if case.model != SERIES:
        return error_of_model(case.motion, case._replace(substep=step).planned)
    scene = MOTIONS[case.motion]
    every, planned = round(scene.run.step / step), case._replace(tolerance=math.inf).planned
    result = simulate(scene.replace({"run.step": step}), planned=planned)
    return error_of({name: values[every::every] for name, values in result.quantities.items()}, truth(case.motion))


_CONTROLLED = (
    ("DOP853", Case(LOADED, "gentle top", 0.0), 1.0 / 8.0, 17.2),
    ("series of order 6", Case(SERIES, "gentle top", 0.0, order=6), 1.0 / 5.0, 0.107),
    ("series of order 8", Case(SERIES, "motor", 0.0, order=8), 1.0 / 7.0, 0.766),
    ("series of one angle, order 4", Case(SWING, "damped swing", 0.0, order=4), 1.0 / 4.0, 28.4),
    ("series of one angle, order 8", Case(SWING, "damped swing", 0.0, order=8), 1.0 / 8.0, 9.75),
)
"""The name, the case, the power of 1 / tolerance in the substeps, and the recorded error / tolerance at 1e-10."""


def _substeps(case: Case) -> float:
    """Return the number of substeps; NaN if a step is refused."""
    scene = MOTIONS[case.motion]
    run = Steps(scene, case.planned, [scene.run.step] * POINTS, ())
    done = all(run.advance(k + 1) for k in range(POINTS))
    return substeps_counted(run.kernels, run.z) if done else math.nan


def orders_and_error_control(quick: bool) -> Study:
    """Measure law 14: the order says how errors fall with the step and how substeps grow with the accuracy."""
    findings: list[Finding] = []
    halvings = range(4)
    columns: dict[str, Sequence[float]] = {"halvings of the step": list(halvings)}
    for name, order, h, case in _ORDERS:
        errors = columns[name] = [_error_at(case, h * 0.5**k) for k in halvings]
        findings.append(Finding(14, f"{name}: order", order, exponent(errors[0], errors[1]), 0.02))
    for name, case, power, ratio in _CONTROLLED:
        few, many = (_substeps(case._replace(tolerance=t)) for t in (1e-10, 1e-14))
        error = error_of_model(case.motion, case._replace(tolerance=1e-10).planned)
        findings += [
            Finding(14, f"{name}: power of 1 / tolerance in substeps", power, exponent(many, few, 1e4), 0.05),
            Finding(14, f"{name}: error / tolerance", ratio, error / 1e-10, 0.02, RECORDED),
        ]
    return Study("orders_and_error_control", findings, columns)
