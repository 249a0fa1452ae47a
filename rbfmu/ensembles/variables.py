"""The variables of an ensemble: columns of a member's outputs; names, dimensions, units and frames of kept arrays."""

from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from rbfmu.ensembles.attitudes import ANGLES, ATTITUDE
from rbfmu.models.model_buffer import places_of
from rbfmu.result import AXES
from rbfmu.scene.body import SHAPES, TRIANGLE
from rbfmu.scene.scene import Scene, SceneError
from rbfmu.scene.variations import QUANTITY_OF, SHAPE
from rbfmu.types import Array, Indices, NDArray
from rbfmu_kernels.buffer import places
from rbfmu_kernels.quantities import OUTPUT, TIME, Load, Output, Parameter, Quantity

FINAL, STATISTICS, ALL = "final", "statistics", "all"
"""What may be kept of the runs."""
SIZES = {f"{SHAPE}.{name}": shape._rules[name] for shape in SHAPES.values() for name in shape.sizes()}
"""The rule of each size of a body's shape."""
_SIZED = {key: Parameter(key.removeprefix(f"{SHAPE}."), int(np.prod(rule.shape)), "m", "size of the body's shape")
          for key, rule in SIZES.items()}  # fmt: skip
KEYS: Mapping[str, Parameter | Load] = {**QUANTITY_OF, **_SIZED}
"""The quantity that is set by each key that may vary, the sizes of shapes among them."""


ALIKE = 1e-12
"""The largest difference between runs that may be round-off, as a part of a quantity's largest number.

Members that differed only in a mass without effect, as a shape's inertia depends on it, differed by 5e-16 (free, 10 s)
to 8e-13 (a pendulum). If the motion magnifies round-off more, as to 2e-11, a key without effect is not reported.
"""

_ROWS, _COLUMNS = np.transpose(TRIANGLE)


def flat(values: Array) -> Array:
    """Return values (m, ...) as rows of numbers (m, k); of matrices (m, 3, 3) the six numbers of an inertia."""
    chosen = values[:, _ROWS, _COLUMNS] if values.ndim == 3 else values
    return chosen.reshape(len(values), -1)


def symmetric(numbers: Array) -> Array:
    """Return the matrices (m, 3, 3) of the six numbers of inertias (m, 6)."""
    M = np.empty((len(numbers), 3, 3))
    M[:, _ROWS, _COLUMNS] = M[:, _COLUMNS, _ROWS] = numbers
    return M


def differ(values: Array) -> NDArray[np.bool_]:
    """Return for each component (k,) of numbers (n, k) whether its values differ by more than round-off."""
    return np.asarray(np.ptp(values, axis=0) > ALIKE * np.max(np.abs(values), initial=0.0))


def output_rows(scene: Scene) -> dict[str, Output]:
    """Return the rows of a scene's outputs by name, its own among them."""
    known = {name: OUTPUT[name] for name in scene.outputs.quantities}
    if not scene.outputs.own:
        return known
    from rbfmu.models.formulas import equations_of  # only if needed, as it loads slowly

    return known | equations_of(scene).own_rows


def varied_rows(scene: Scene) -> Mapping[str, Parameter | Load]:
    """Return the quantity set by each key of a scene that may vary, its own constants and states among them."""
    return {**KEYS, **scene.own_parameters}


def columns_of(scene: Scene) -> "Columns":
    """Return the columns of a scene's outputs."""
    return Columns((*output_rows(scene).values(),))


@dataclass(frozen=True)
class Columns:
    """The columns of quantities, given their rows."""

    rows: tuple[Output, ...]

    @property
    def _sizes(self) -> dict[str, int]:
        return {row.name: row.size for row in self.rows}

    @property
    def slices(self) -> dict[str, slice]:
        """Return the columns of each quantity."""
        return places(self._sizes)[0]

    @property
    def width(self) -> int:
        """Return the number of columns."""
        return sum(self._sizes.values())

    @property
    def angles(self) -> Indices:
        """Return the columns of angles; their sines and cosines are summed up in columns after all others."""
        return np.arange(self.width, dtype=np.int64)[self.slices.get(ANGLES, slice(0))]

    @property
    def ranked(self) -> Indices:
        """Return the columns that have quantiles: all except those of attitudes."""
        return np.delete(np.arange(self.width), self.slices.get(ATTITUDE, slice(0)))

    @property
    def summed(self) -> dict[str, Indices]:
        """Return for each quantity the columns that have means and covariances: for angles those of sine and cosine."""
        every = np.arange(self.width + 2 * len(self.angles))
        return {name: every[self.width :] if name == ANGLES else every[s] for name, s in self.slices.items()}

    @property
    def pairs(self) -> Indices:
        """Return the pairs of columns (P, 2) that have a covariance: all pairs within one quantity."""
        found = [(a, b) for columns in self.summed.values() for k, a in enumerate(columns) for b in columns[k:]]
        return np.array(found, dtype=np.int64)

    def split(self, rows: Array) -> dict[str, Array]:
        """Return each quantity of rows (..., K): as (...) if it is one number, else as (..., k)."""
        return {n: rows[..., s.start if self._sizes[n] == 1 else s] for n, s in self.slices.items()}

    def matrices(self, products: Array) -> dict[str, Array]:
        """Return for each quantity the symmetric matrices (..., k, k), given rows (..., P) of products of `pairs`."""
        found, first = {}, 0
        for name, columns in self.summed.items():
            row, column = np.triu_indices(len(columns))
            part = products[..., first : first + len(row)]
            found[name] = np.empty((*products.shape[:-1], len(columns), len(columns)))
            found[name][..., row, column] = found[name][..., column, row] = part
            first += len(row)
        return found

    def places(self, blocks: dict[str, slice]) -> Indices:
        """Return the places of the columns in a model's buffer."""
        return places_of(blocks, self._sizes)


PROBABILITIES = (0.01, 0.05, 0.25, 0.5, 0.75, 0.95, 0.99)
RUN, TIMES, PROBABILITY = "run", "time", "probability"
RANK_ERROR = "quantile_rank_error"
RESUME = "resume"
"""The group of the checkpoint in a folder of zarr; a variable of this name would collide with it."""
REDRAWN = "redrawn"
COUNT, FIRST = ".count", ".first"
"""Endings after the name of an event: how often it happened in each run, and when first."""


class Variable(NamedTuple):
    """The name of an array, the names of its dimensions, and its attributes."""

    name: str
    dims: tuple[str, ...]
    attributes: dict[str, Any]


def variables(scene: Scene, sampled: Mapping[str, int]) -> Iterator[Variable]:
    """Yield all variables of a scene's ensemble; sampled: the number of dimensions of the array of each varied key."""
    keep = scene.ensemble.keep if scene.ensemble else ()
    for key, ndim in sampled.items():
        varied = varied_rows(scene)[key]
        yield Variable(key, (RUN, *_dims(varied)[: ndim - 1], *("axis_2",) * (ndim - 2)), _attributes(varied))
    redrawn = {"units": "1", "long_name": "how often the member was drawn again, as no body has its inertia"}
    yield Variable(REDRAWN, (RUN,), redrawn)
    for name, event in scene.events.items():
        of_it = event.about or event.when
        yield Variable(f"{name}{COUNT}", (RUN,), {"units": "1", "long_name": f"how often {of_it} came to zero"})
        yield Variable(f"{name}{FIRST}", (RUN,), {"units": "s", "long_name": f"when {of_it} first came to zero"})
    if STATISTICS in keep:
        error = {"units": "1", "long_name": "by which part of the members quantiles are displaced, at most"}
        yield Variable(RANK_ERROR, (), error)
    for row in output_rows(scene).values():
        yield from _of_output(keep, row)


def check_names(scene: Scene) -> None:
    """Raise SceneError for a user's own output with the name of another variable, a dimension or a group."""
    known = list(variables(scene, {}))
    dims = {PROBABILITY, RESUME}.union(*(variable.dims for variable in known))
    counts = Counter([*dims, *(variable.name for variable in known)])
    if taken := [name for name in scene.outputs.own if counts[name] > 1]:
        expected = "another name where all of the runs is kept: an ensemble calls something else so"
        raise SceneError([f"outputs.{name}: expected {expected}" for name in taken], scene.name)


def variables_of(scene: Scene, arrays: Mapping[str, Any]) -> dict[str, Variable]:
    """Return the variables of an ensemble's result by name, given its arrays."""
    sampled = {name: len(array.shape) for name, array in arrays.items() if name in varied_rows(scene)}
    return {variable.name: variable for variable in variables(scene, sampled)}


def _of_output(keep: Collection[str], row: Any) -> Iterator[Variable]:
    dims, attributes, name = _dims(row), _attributes(row), row.name
    if FINAL in keep:
        yield Variable(f"{name}_final", (RUN, *dims), attributes)
    if ALL in keep:
        yield Variable(name, (RUN, TIMES, *dims), attributes)
    if STATISTICS in keep:
        yield Variable(f"{name}_mean", (TIMES, *dims), attributes)
        if name == ATTITUDE:  # how far members are turned from the mean
            dims, attributes = ("axis",), {"units": "rad", "long_name": "turn from the mean attitude, body axes"}
            attributes["frame"] = _AXES["b"]
        twice = (*dims, *(f"{dim}_2" for dim in dims))
        yield Variable(f"{name}_std", (TIMES, *dims), attributes)
        squared = {"units": "1" if attributes["units"] == "1" else f"({attributes['units']})2"}
        yield Variable(f"{name}_covariance", (TIMES, *twice), attributes | squared)
        yield Variable(f"{name}_quantiles", (PROBABILITY, TIMES, *(() if name == ATTITUDE else dims)), attributes)


def _dims(row: Quantity) -> tuple[str, ...]:
    return () if row.size == 1 else (AXES.get(row.name.removesuffix("_0"), "axis"),)


def _attributes(row: Quantity) -> dict[str, Any]:
    attributes = {"units": row.unit, "long_name": row.meaning}
    frames = (frame for words, frame in _FRAMES.items() if words in row.meaning)
    frame = _AXES[row.frame] if isinstance(row, Load) else next(frames, "")
    return attributes | ({"frame": frame} if frame else {})


_AXES = {"a": "a (inertial)", "b": "b (body)"}
_FRAMES = {"inertial axes": _AXES["a"], "body axes": _AXES["b"], "q_ab": "ab (from body to inertial)"}


def coordinates(time: Array) -> dict[str, tuple[str, Any, dict[str, str]]]:
    """Return the numeric coordinates by name: dimension, values, attributes."""
    parts = {"units": "1", "long_name": "part of the members below"}
    return {
        TIMES: (TIMES, time, {"units": TIME.unit, "long_name": TIME.meaning}),
        PROBABILITY: (PROBABILITY, np.array(PROBABILITIES), parts),
    }
