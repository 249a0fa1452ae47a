"""What an ensemble's result consists of: arrays with the names of their dimensions, units and frames."""

from collections.abc import Collection, Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rbfmu.ensembles.chunks import ALL, FINAL, STATISTICS, Chunk, Work
from rbfmu.ensembles.columns import KEYS
from rbfmu.ensembles.statistics import Statistics, exact_quantiles
from rbfmu.results.tables import AXES
from rbfmu.runs.time_grid import time_grid
from rbfmu.scene.scene import Scene
from rbfmu_kernels.quantities import OUTPUT, TIME, Load, Quantity

Array = NDArray[np.float64]
PROBABILITIES = (0.01, 0.05, 0.25, 0.5, 0.75, 0.95, 0.99)
RUN, TIMES, PROBABILITY = "run", "time", "probability"
AT_ONCE = 2e7
"""Numbers of all runs that are sorted at once."""
RANK_ERROR = "quantile_rank_error"
REDRAWN = "redrawn"


class Variable(NamedTuple):
    """An array, the names of its dimensions, and what is said of it."""

    name: str
    dims: tuple[str, ...]
    attributes: dict[str, Any]


def variables(scene: Scene, sampled: Mapping[str, int]) -> Iterator[Variable]:
    """Yield all variables of a scene's ensemble; sampled: the number of dimensions of each key that varies."""
    keep = scene.ensemble.keep if scene.ensemble else ()
    for key, ndim in sampled.items():
        row = KEYS[key]
        yield Variable(key, (RUN, *_dims(row)[: ndim - 1], *("axis_2",) * (ndim - 2)), _attributes(row))
    redrawn = {"units": "1", "long_name": "how often the member was drawn again, as no body has its inertia"}
    yield Variable(REDRAWN, (RUN,), redrawn)
    if STATISTICS in keep:
        error = {"units": "1", "long_name": "by which part of the members quantiles are displaced, at most"}
        yield Variable(RANK_ERROR, (), error)
    for name in scene.outputs.quantities:
        yield from _of_output(keep, OUTPUT[name])


def variables_by_name(scene: Scene, arrays: Mapping[str, Any]) -> dict[str, Variable]:
    """Return what is known of the arrays of an ensemble's result."""
    sampled = {name: len(array.shape) for name, array in arrays.items() if name in KEYS}
    return {variable.name: variable for variable in variables(scene, sampled)}


def _of_output(keep: Collection[str], row: Any) -> Iterator[Variable]:
    dims, attributes, name = _dims(row), _attributes(row), row.name
    twice = (*dims, *(f"{dim}_2" for dim in dims))
    if FINAL in keep:
        yield Variable(f"{name}_final", (RUN, *dims), attributes)
    if ALL in keep:
        yield Variable(name, (RUN, TIMES, *dims), attributes)
    if STATISTICS in keep:
        yield Variable(f"{name}_mean", (TIMES, *dims), attributes)
        yield Variable(f"{name}_std", (TIMES, *dims), attributes)
        square = attributes | {"units": "1" if row.unit == "1" else f"({row.unit})2"}
        yield Variable(f"{name}_covariance", (TIMES, *twice), square)
        yield Variable(f"{name}_quantiles", (PROBABILITY, TIMES, *dims), attributes)


def _dims(row: Quantity) -> tuple[str, ...]:
    return () if row.size == 1 else (AXES.get(row.name.removesuffix("_0"), "axis"),)


def _attributes(row: Quantity) -> dict[str, Any]:
    attributes = {"units": row.unit, "long_name": row.meaning}
    frame = _AXES[row.frame] if isinstance(row, Load) else _frame_in(row.meaning)
    return attributes | ({"frame": frame} if frame else {})


def _frame_in(meaning: str) -> str:
    return next((frame for words, frame in _FRAMES.items() if words in meaning), "")


_AXES = {"a": "a (inertial)", "b": "b (body)"}
_FRAMES = {"inertial axes": _AXES["a"], "body axes": _AXES["b"], "q_ab": "ab (from body to inertial)"}


def coordinates(time: Array) -> dict[str, tuple[str, Any, dict[str, str]]]:
    """Return the coordinates with numbers: dimension, values, attributes."""
    parts = {"units": "1", "long_name": "part of the members below"}
    return {
        TIMES: (TIMES, time, {"units": TIME.unit, "long_name": TIME.meaning}),
        PROBABILITY: (PROBABILITY, np.array(PROBABILITIES), parts),
    }


def arrays_of_chunk(work: Work, chunk: Chunk) -> dict[str, Any]:
    """Return a chunk's part of all variables that have a row a run."""
    arrays: dict[str, Any] = {**chunk.samples, REDRAWN: chunk.redrawn}
    if work.keeps(FINAL):
        arrays |= {f"{name}_final": values for name, values in work.columns.split(chunk.rows[:, -1]).items()}
    if work.keeps(ALL):
        arrays |= work.columns.split(chunk.rows)
    return arrays


def results_of(work: Work, statistics: Statistics | None, rows: Mapping[str, Any]) -> dict[str, Array]:
    """Return the variables without a row a run: times, and statistics over time. rows: those with one."""
    run, probabilities = work.scene.run, np.array(PROBABILITIES)
    found = {TIMES: time_grid(run.start, run.stop, run.step), PROBABILITY: probabilities}
    if statistics is None:
        return found
    found[RANK_ERROR] = np.array(0.0 if work.keeps(ALL) else statistics.rank_error)
    split, covariance = work.columns.split, work.columns.matrices(statistics.covariance())
    quantiles = {} if work.keeps(ALL) else split(statistics.quantiles(probabilities))
    for name, mean in split(statistics.means()).items():
        matrix = covariance[name]
        variance = matrix if matrix.ndim == 1 else np.diagonal(matrix, axis1=1, axis2=2)
        found |= {f"{name}_mean": mean, f"{name}_std": np.sqrt(variance), f"{name}_covariance": matrix}
        found[f"{name}_quantiles"] = quantiles[name] if quantiles else _of_all(rows[name], probabilities)
    return found


def _of_all(values: Any, probabilities: Array) -> Array:
    """Return the quantiles over all runs (runs, n, ...), some times after others: those are read at once."""
    times = max(1, int(AT_ONCE // (values.size // values.shape[1] or 1)))
    parts = [exact_quantiles(values[:, k : k + times], probabilities) for k in range(0, values.shape[1], times)]
    return np.concatenate(parts, axis=1)


def attributes_of(work: Work, failed: Mapping[int, str]) -> dict[str, Any]:
    """Return what is said of the whole ensemble, for JSON."""
    return {
        "title": work.scene.name,
        "scene": work.scene.to_dict(),
        "model": f"{work.plan.model}: {work.plan.method}",
        "failed": {str(index): text for index, text in failed.items()},
    }
