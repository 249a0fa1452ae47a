"""Where methods fail: the laws of stability, measured and compared with their predictions, with pictures and maps.

`run_stability` writes all numbers to CSV files first and draws afterwards. `read_findings` reads all findings,
`failures` those that do not hold.
"""

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any
from warnings import catch_warnings, simplefilter

from rbfmu.exceptions import SceneWarning
from rbfmu.studies.own_method import method_of_file
from rbfmu.studies.stability import method_laws, model_laws, top_laws
from rbfmu.studies.stability.findings import Finding, Study, failures, read_findings, write_columns, write_findings
from rbfmu.studies.stability.maps import METHODS, QUICK_METHODS, Row, findings_of_maps, verdicts
from rbfmu.studies.stability.own_laws import own_laws

__all__ = ["STUDIES", "Finding", "Study", "failures", "read_findings", "run_stability", "write_findings"]

STUDIES: tuple[Callable[[bool], Study], ...] = (
    method_laws.growth_factors, method_laws.drift, method_laws.gimbal_passage, method_laws.gyroscopic_blow_up,
    method_laws.damping_limits, method_laws.moser_veselov_limits, method_laws.energy_drift, method_laws.small_angles,
    top_laws.intermediate_axis, top_laws.sleeping_top, top_laws.splitting_resonance,
    model_laws.product_models, model_laws.orders_and_error_control,
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
    with a method of one's own, which is measured as well (`rbfmu.studies.own_method`).
    """
    from rbfmu.studies.stability.pictures import draw, draw_maps

    own = None if method is None else method_of_file(method)
    folder.mkdir(parents=True, exist_ok=True)
    studies: list[Study] = []
    rows: list[Row] = []
    pictures: list[Path] = []
    tables: list[Path] = []
    names = QUICK_METHODS if quick else tuple(METHODS)
    parts: list[Callable[[], object]] = [lambda study=study: studies.append(study(quick)) for study in STUDIES]  # type: ignore[misc]
    parts += [lambda name=name: rows.extend(verdicts(name, quick)) for name in names]  # type: ignore[misc]
    if own:
        parts += [lambda: studies.append(own_laws(own, studies)), lambda: rows.extend(verdicts(own, quick))]
    parts.append(lambda: tables.extend(_write(folder, studies, rows)))
    parts += [lambda k=k: pictures.append(draw(studies[k], folder)) for k in range(len(STUDIES))]  # type: ignore[misc]
    parts.append(lambda: pictures.append(draw_maps(rows, folder / "maps.png")))
    with catch_warnings():
        simplefilter("ignore", SceneWarning)  # whole turns between points are intended here
        for part in parts if progress is None else progress(parts):
            part()
    return tables + pictures


def _write(folder: Path, studies: Sequence[Study], rows: list[Row]) -> list[Path]:
    findings = [f for study in studies for f in study.findings] + findings_of_maps(rows)
    names = ("method", "h_omega", "moment_ratio", "verdict", "error")
    maps = {name: [row[k] for row in rows] for k, name in enumerate(names)}
    return [
        write_findings(folder / "laws.csv", sorted(findings, key=lambda f: f.law)),
        *(write_columns(folder / f"{study.name}.csv", study.columns) for study in studies if study.columns),
        write_columns(folder / "maps.csv", maps),
    ]
