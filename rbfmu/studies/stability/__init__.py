"""Where methods fail: the laws of stability, measured and compared with their predictions, with pictures and maps.

`run_stability` writes all numbers to CSV files first and draws afterwards. `read_findings` reads all findings,
`failures` those that do not hold.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import Any
from warnings import catch_warnings, simplefilter

import numpy as np

from rbfmu.exceptions import SceneWarning
from rbfmu.studies import write_rows
from rbfmu.studies.one_step import OneStepMethod, method_of_file
from rbfmu.studies.stability import method_laws as laws
from rbfmu.studies.stability import motion_laws
from rbfmu.studies.stability.findings import CURVE, OWN, Finding, Study, exponent, failures, read_findings
from rbfmu.studies.stability.findings import write_columns as write_columns
from rbfmu.studies.stability.findings import write_findings as write_findings
from rbfmu.studies.stability.motions import METHODS, QUICK_METHODS, Row, findings_of_maps, verdict_of_steps, verdicts

__all__ = ["STUDIES", "Finding", "Study", "failures", "read_findings", "run_stability", "write_findings"]

STUDIES: tuple[Callable[[bool], Study], ...] = (
    laws.growth_factors, laws.drift, laws.gimbal_passage, laws.gyroscopic_blow_up, laws.damping_limits,
    laws.moser_veselov_limits, laws.energy_drift, laws.small_angles,
    motion_laws.intermediate_axis, motion_laws.sleeping_top, motion_laws.splitting_resonance,
    motion_laws.product_models, motion_laws.orders_and_error_control,
)  # fmt: skip
"""Each measures one or more laws; the argument asks for a quick, coarse run."""


def run_stability(
    folder: Path,
    quick: bool = False,
    progress: Callable[[Sequence[Any]], Iterable[Any]] | None = None,
    method: str | Path | None = None,
) -> list[Path]:
    """Measure all laws and maps, write CSV files and pictures into a folder; return their paths, `laws.csv` first.

    progress: wraps the sequence of parts, for instance in a progress bar; a part takes a few seconds. method: a file
    with a method of one's own, which is measured as well (`rbfmu.studies.one_step`).
    """
    from rbfmu.studies.stability.pictures import draw, draw_maps

    own = None if method is None else method_of_file(method)
    folder.mkdir(parents=True, exist_ok=True)
    studies, rows, paths = list[Study](), list[Row](), list[Path]()
    judged = [(name, METHODS[name]) for name in (QUICK_METHODS if quick else METHODS)]
    judged += [(own.name, partial(verdict_of_steps, own))] if own else []
    parts: list[tuple[list[Any], Callable[[], Sequence[object]]]] = [
        *((studies, lambda study=study: [study(quick)]) for study in STUDIES),
        *((rows, partial(verdicts, *one, quick)) for one in judged),
        *([(studies, lambda: [own_laws(own, studies)])] if own else ()),
        (paths, lambda: _write(folder, studies, rows)),
        *((paths, lambda k=k: [draw(studies[k], folder)]) for k in range(len(STUDIES))),
        (paths, lambda: [draw_maps(rows, folder / "maps.png")]),
    ]
    with catch_warnings():
        simplefilter("ignore", SceneWarning)  # whole turns between points are intended here
        for found, part in parts if progress is None else progress(parts):
            found.extend(part())
    return paths


def _write(folder: Path, studies: Sequence[Study], rows: Sequence[Row]) -> list[Path]:
    findings = [f for study in studies for f in study.findings] + findings_of_maps(rows)
    return [
        write_findings(folder / "laws.csv", sorted(findings, key=lambda f: f.law)),
        *(write_columns(folder / f"{study.name}.csv", study.columns) for study in studies if study.columns),
        write_rows(folder / "maps.csv", (row._asdict() for row in rows), ()),
    ]


# A method of the reader's own: no theory predicts what it does, an exact motion stands beside it


ROUND_OFF, ROUGH, RATIO = 1e-11, 1e-3, 0.1


def own_laws(method: OneStepMethod, studies: Sequence[Study]) -> Study:
    """Return what is found of a method, and put its curves beside those of the studies that were measured."""
    for study in studies:
        if study.curve is not None:
            study.columns[CURVE] = study.curve(method)
    short, long = (abs(error) for error in laws.energies(method, laws.H, [1000, 10_000]))
    measured = (
        (1, "growth of |q| in a step less 1, h omega = 0.1", 0.0, laws.growth(method, 0.1) - 1.0),
        (2, "largest h omega up to which |q| does not grow", math.inf, largest_stable(partial(laws.growth, method))),
        (4, "error in rad at h omega / delta = 1", 0.0, laws.passage_error(method, 1.0)),
        (5, "thin rod, nutation over its start after 1 s", 1.0, laws.rod_growth(method)[-1]),
        (6, "largest h d / I", math.inf, largest_stable(partial(laws.decay_factor, method))),
        (8, "relative energy error after 1000 steps, h = 0.1", 0.0, short),
        (8, "relative energy error after 10,000 steps", 0.0, long),
        (14, "order: the power of h in the attitude's error", math.inf, order(method)),
    )
    findings = [Finding(law, f"{method.name}: {what}", exact, found, 0.0, OWN) for law, what, exact, found in measured]
    return Study("your_method", findings)


def largest_stable(factor: Callable[[float], float]) -> float:
    """Return up to where a step's factor is at most 1 in size, but for round-off; infinite if no end is found."""
    last = 0.0
    for x in np.linspace(0.05, 20.0, 400).tolist():
        if not abs(factor(x)) - 1e-12 <= 1.0:
            return laws.crossing(lambda x: abs(factor(x)) - 1e-12 <= 1.0, last, x)
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
