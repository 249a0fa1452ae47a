"""Rows of charts, made up, and the true states of the eight motions, without velocities."""

import json
import math
from dataclasses import replace

import numpy as np

from rbfmu.studies.chart import Chart, verdicts
from rbfmu.studies.chart.cases import REFERENCES
from rbfmu.studies.chart.result import Row, kind_of


def true_states(key: str):
    truth = json.loads(REFERENCES.read_text(encoding="utf-8"))["motions"][key]
    rows = zip(*(np.array(truth[name], dtype=float) for name in ("r_c", "quaternion", "omega_b")), strict=True)
    return [(*q, *w, *r) for r, q, w in rows]


def turned_by(q, angle: float):
    e, x, y, z = q
    c, s = math.cos(0.5 * angle), math.sin(0.5 * angle)
    return (e * c - x * s, x * c + e * s, y * c + z * s, z * c - y * s)


def made_row(method: str, family: str, error: float, seconds: float, **more: object) -> Row:
    row = Row(kind_of(method, family), method, "", family, "step (s)", 0.1, error, seconds, 10.0 * seconds, 1.0, 1.0)
    return replace(row, **more)


def made_plan(error: float, seconds: float, **more: object) -> Row:
    how = {"detail": "closed form", "value": 1e-9} | more
    return made_row("rbfmu, as planned", "planned", error, seconds, **how)


def made_chart(*rows: Row, **more: object) -> Chart:
    """A chart of the damped spin."""
    chart = Chart("damped spin", "one axis", 1e-9, 10.0, 5, (), rows, (), (), (), "", ("a processor",), key="e")
    return replace(chart, **more)


def judged(error: float, others: float, peer: float, noise: float = 1.1):
    """A plan of 1 µs at 1e-9, whose rival costs so many µs, and a peer."""
    rows = [
        made_plan(error, 1e-6), made_row("one axis", "exact", 1e-16, 2e-6),
        made_row("Taylor, order 16", "Taylor", 1e-11, others * 1e-6), made_row("heyoka.py", "peer", 1e-10, peer * 1e-6),
        made_row("RK4, matrix", "classic", 1e-8, 1e-9),
    ]  # fmt: skip
    (found,) = verdicts([made_chart(*(replace(row, spread=noise) for row in rows))])
    return found
