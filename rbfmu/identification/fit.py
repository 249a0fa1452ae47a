"""A scene fitted to measured motion: nonlinear least squares with derivatives of the motion.

The result is numbers with their errors, also as a scene file with comments, and as an ensemble of the uncertainty.
"""

import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rbfmu import exceptions, extras, on_disk
from rbfmu.ensembles.variables import symmetric
from rbfmu.identification import noise
from rbfmu.identification.charts import INERTIA, MASS, OWN, Chart, by_chart, changes, chart_of, value_of
from rbfmu.identification.measured import QUATERNION, Data, Measured, read_measured, residuals
from rbfmu.runs.inputs import HOLD, drive_of, input_tables, with_times
from rbfmu.runs.motion import FLOORS
from rbfmu.scene.ensemble import RANDOM
from rbfmu.scene.scene import SECTIONS, Scene, of_scene_or_path
from rbfmu.sensitivities import ATTITUDE, Varied, by_key, keys_of
from rbfmu.types import Array

LOSSES = ("linear", "soft_l1", "huber", "cauchy")
PARTS = (0.03, 0.1, 0.3)
"""The parts of the time that are fitted before all of it: over a long time the phase of a wrong rate is lost.

Of twenty fits to 10 s (`tests.support.fits`, seeds from 7000 on), all of the time at once misses one and takes 135
evaluations a fit; these parts miss none and take 89.
"""
HELD, HELD_LAST = 0.3, 1e-4
"""HELD: the weight that holds coordinates at their earlier values while a part of the time is fitted, as if known to
1 / HELD. HELD_LAST: the same for all of the time, so that what the data do not determine stays where it is. The same
fits take 120 evaluations with HELD at 1e-4, and 79 at 3."""
MOST_SIZES = 12
"""How often numbers that are far larger than at the start may get a larger unit."""
MOST_TRIES, MOST_LAST = 60, 400
"""The most evaluations for one part, and for all of the time."""
LONGEST, LONGER, BESIDE = 3e5, 100.0, 0.25
"""A run of more than LONGEST substeps, and more than LONGER times those of the first run, is refused. A doubt is added
if the search was refused such a run, and ends at one of more than BESIDE of that number.

Data that contradict a model lead to ever stiffer motions: measured rates of zero under a torque to infinite damping,
with runs of 12 s each before they were refused.
"""
REFUSED = 1e6
"""The residual, over its standard deviation, of a motion that the scene refuses."""
NO_RUN = (exceptions.SceneError, exceptions.SimulationError, ValueError, OverflowError)
"""The errors of a run with numbers that give no motion."""
UNTOLD = 1.0
"""The relative standard error above which the data do not determine a direction."""
STILL_FALLS = 0.01
"""The largest further decrease of the sum of squares, over its mean for one number, with which a search may end."""


@dataclass(frozen=True, eq=False, repr=False)
class Fit:
    """The result of `fit`.

    scene: the fitted one; names, values, standard_errors (n,): of the free numbers; a number that the data do not
    determine has the value NaN and an infinite error. The value of an attitude is the rotation vector in b from the
    scene's attitude, rad; its error is that of a small rotation in b from the fitted one (the same as that of its
    components if the rotation is small). covariance, correlation: (n, n); unknown: what the data do not determine, in
    words; residuals: measured less fitted (times, k) by output, NaN at gaps, of a quaternion a rotation vector in b,
    rad; sigma: the standard deviation of each output's noise; doubts: how residuals do not look like noise, or why
    numbers and errors may be wrong, in words; measured: the data.
    """

    scene: Scene
    names: tuple[str, ...]
    values: Array
    standard_errors: Array
    covariance: Array
    unknown: tuple[str, ...]
    residuals: Mapping[str, Array]
    sigma: Mapping[str, float]
    doubts: tuple[str, ...]
    measured: Measured

    def __repr__(self) -> str:
        numbers = zip(self.names, self.values, self.standard_errors, strict=True)
        texts = ", ".join(f"{name} = {value:.6g} +- {error:.2g}" for name, value, error in numbers)
        return f"Fit({self.scene.name}: {texts})"

    @property
    def correlation(self) -> Array:
        """Return the correlation of the numbers' errors (n, n); NaN where the data do not determine it."""
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.asarray(self.covariance / np.outer(self.standard_errors, self.standard_errors))

    def posterior(self, runs: int = 1000, seed: int = 1) -> Scene:
        """Return the fitted scene with an ensemble of the remaining uncertainty: normal, with the fit's correlations.

        Raises ValueError if the data do not determine all numbers.
        """
        if self.unknown:
            raise ValueError(f"{self.scene.name}: expected data that tell all numbers: {'; '.join(self.unknown)}")
        places = by_key(self.names)
        spreads = {key: _spread(self, key, at) for key, at in places.items()}
        components = [name for _, names in spreads.values() for name in names]
        order = np.concatenate([*places.values()])  # numbers of one key may be free on both sides of another's
        matrix = self.correlation[np.ix_(order, order)]
        np.fill_diagonal(matrix, 1.0)
        vary = {key: distribution for key, (distribution, _) in spreads.items()}
        table: dict[str, object] = {"runs": runs, "seed": seed, "design": RANDOM, "vary": vary, "correlation": None}
        if len(components) > 1:
            table["correlation"] = {"components": components, "matrix": (0.5 * (matrix + matrix.T)).tolist()}
        return self.scene.replace({"ensemble": table})

    def save(self, path: str | Path, source: str | Path | None = None) -> None:
        """Write the fitted scene as a TOML file, each number with its standard error in a comment.

        source: the file of the scene that was fitted, to keep its comments. Needs tomlkit.
        """
        path, tomlkit = exceptions.path_of(path), extras.needed("tomlkit", "fit")
        whole = tomlkit.dumps(self.scene.to_dict()) if source is None else Path(source).read_text("utf-8-sig")
        document, places = tomlkit.parse(whole), by_key(self.names)
        for key, at in places.items():
            errors = ("not told" if np.isinf(e) else f"{e:.2g}" for e in self.standard_errors[at])
            _put_value(tomlkit, document, self.scene, key, f"fitted; standard error {', '.join(errors)}")
        if MASS in places and "shape" in document["body"]:
            _put_value(tomlkit, document, self.scene, INERTIA, "of the shape, with the mass that it had")
        written = tomlkit.dumps(document)
        Scene.from_dict(tomllib.loads(written), str(path))  # raises an error before a wrong file is written
        on_disk.write_whole(path, written.encode())  # path may be the source

    def plot(self, path: str | Path | None = None) -> Any:
        """Draw residuals over their standard deviation, a panel an output; return the matplotlib.figure.Figure."""
        from rbfmu.plot import plot_residuals

        of = {name: rows / (self.sigma[name] or 1.0) for name, rows in self.residuals.items()}
        return plot_residuals(self.measured.time, of, path, self.scene.name)


def _put_value(tomlkit: Any, document: Any, scene: Scene, key: str, comment: str) -> None:
    """Put a scene's value of a key into the tables of a file, in place of other keys that set the same field."""
    table, _, name = key.partition(".")
    rows = document.setdefault(table, tomlkit.table())
    keys = SECTIONS[table]._keys if table in SECTIONS else {}
    for other in [key for key in rows if name in keys and key != name and keys.get(key, ("",))[0] == keys[name][0]]:
        del rows[other]
    value = tomlkit.item(_as_written(scene, key))
    if key == ATTITUDE:
        value = tomlkit.inline_table().append("quaternion", value)
    if table in OWN and isinstance(rows.get(name), Mapping):
        rows[name][OWN[table]] = value
        rows[name].comment(comment)
        return
    value.comment(comment)
    rows[name] = value


def _as_written(scene: Scene, key: str) -> Any:
    """Return a scene's value of a key as in a file; a diagonal inertia is given by its three moments."""
    value = np.array(value_of(scene, key))
    if key == INERTIA:
        return (value if np.any(value - np.diag(np.diag(value))) else np.diag(value)).tolist()
    return value.tolist() if value.size > 1 else value.item()


def _spread(fit: Fit, key: str, at: list[int]) -> tuple[dict[str, Any], list[str]]:
    """Return the distribution of a key's numbers, and their names in the ensemble's correlation."""
    errors = fit.standard_errors[at]
    if key == ATTITUDE:
        return {"rotvec": errors.tolist()}, [f"{key}.rotvec[{k}]" for k in (1, 2, 3)]
    value = _as_written(fit.scene, key)
    if key == INERTIA and len(at) == 6:
        return {"normal": [value, symmetric(errors[None])[0].tolist()]}, [fit.names[n] for n in at]
    if not isinstance(value, list):
        return {"normal": [value, float(errors[0])]}, [key]
    places = [int(fit.names[n].partition("[")[2].partition(",")[0].rstrip("]")) for n in at]
    spread = np.zeros(len(value))
    spread[np.array(places) - 1] = errors
    return {"normal": [value, spread.tolist()]}, [f"{key}[{k}]" for k in places]


# The search


@of_scene_or_path
def fit(
    scene: Scene,
    /,
    data: Data,
    free: Sequence[str],
    sigma: float | Mapping[str, float] | None = None,
    loss: str = "linear",
    *,
    inputs: Any = None,
    interpolate: str = HOLD,
) -> Fit:
    """Return the scene whose motion is nearest to the measured motion, in the sense of least squares.

    data: see `measured.read_measured`: rates, quaternions of either sign or any outputs, at any times from run.start
    on, with gaps.
    free: keys as in `sensitivity`; the search begins at the scene's values. An inertia stays physically possible, a
    mass positive. sigma: the standard deviation of the noise, of all numbers or by output (for a quaternion that of a
    small rotation, rad); without it, it is estimated for each output. loss: "linear"; or "soft_l1", "huber", "cauchy"
    for data with outliers (`scipy.optimize.least_squares`). inputs, interpolate: what drove the ports, see `simulate`.

    Standard errors are for a motion that is linear in the numbers near the fit, and noise of the size of the residuals,
    or, with the loss "linear" and `sigma` for all outputs, of that size. Directions that the data do not determine (as
    torque-free motion determines only ratios of moments) are found by singular values and named in `unknown`.
    Needs SciPy. Raises SceneError, ValueError.
    """
    if loss not in LOSSES:
        raise ValueError(f"loss = {loss!r}: expected one of {', '.join(LOSSES)}")
    known = read_measured(scene, data)
    timed = with_times(scene, inputs, interpolate)  # a fit uses other steps
    return _Search(scene, known, keys_of(free), noise.given_deviations(sigma, known), loss, (timed, interpolate)).fit()


class _Search:
    def __init__(
        self, scene: Scene, data: Measured, keys: list[str], given: dict[str, float], loss: str, inputs: tuple[Any, str]
    ) -> None:
        self._least_squares = extras.needed("scipy.optimize", "fit").least_squares
        self._block_diagonal = extras.needed("scipy.linalg", "fit").block_diag
        self._scene, self._data, self._given, self._loss = scene, data, given, loss
        self._charts: list[Chart] = [chart_of(scene, key) for key in keys]
        self._asked = _scene_to_run(scene, data)
        self._varied = Varied(self._asked, keys, "free")
        self._names = self._varied.numbers
        count = len(self._names)
        least = count + (len(given) < len(data.values))  # one more to estimate noise
        if data.count < least:
            why = "as many as are free" if least == count else "more than are free, unless sigma is given"
            raise ValueError(f"data: {data.count} numbers: expected at least {least}, {why}")
        self._tables, self._interpolate = input_tables(self._asked, *inputs), inputs[1]  # a pipe can be read only once

    def fit(self) -> Fit:
        """Return the fit: of longer and longer parts of the time, then again with estimated noise if none was given."""
        p = np.zeros(len(self._names))
        self._run_at_start(p)
        sigma = {name: self._given.get(name) or noise.size_of(name, rows) for name, rows in self._data.values.items()}
        begin = self._scene.run.start
        for part in PARTS:
            data = self._data.until(begin + part * (self._data.time[-1] - begin))
            if data.count >= 2 * len(p) and data.time[-1] > begin:
                p = self._minimize(p, data, sigma, HELD)
        p = self._minimize(p, self._data, sigma, HELD_LAST)
        for _ in range(MOST_SIZES):
            grown = [chart.outgrown(row) for chart, row in by_chart(self._charts, p)]
            if not any(grown):
                break
            p = self._minimize(p, self._data, sigma, HELD_LAST)
        given = np.zeros_like(p)  # which may be nearer than what parts of the time lead to
        misfits = [np.linalg.norm(self._stack(x, self._data, sigma)[0]) for x in (given, p)]
        if misfits[0] < misfits[1]:
            p = self._minimize(given, self._data, sigma, HELD_LAST)
        for _ in range(0 if len(self._given) == len(self._data.values) else 2):
            sigma = self._estimate_sigma(p, sigma)
            p = self._minimize(p, self._data, sigma, HELD_LAST)
        return self._finish(p, sigma)

    def _estimate_sigma(self, p: Array, sigma: Mapping[str, float]) -> dict[str, float]:
        """Return standard deviations; those not given are estimated from residuals and the fit's degrees of freedom."""
        left, _ = self._evaluate(p, self._data)
        U, s, _ = np.linalg.svd(self._stack(p, self._data, sigma)[1] @ self._slopes(p), full_matrices=False)
        ends = np.cumsum([np.isfinite(rows).sum() for rows in left.values()])[:-1]
        followed = map(np.sum, np.split(U**2 @ (s**2 / (s**2 + HELD_LAST**2)), ends))
        of = zip(left, followed, strict=True)
        return {name: self._given.get(name) or noise.estimated(name, left[name], float(n)) for name, n in of}

    def _run_at_start(self, p: Array) -> None:
        """Run the scene as it was given: its substeps limit those of later runs (LONGEST), and its slopes give units.

        The unit of a number that begins at zero is the change that moves some output by its measured size.
        """
        try:
            _, slopes = self._evaluate(p, self._data)
        except NO_RUN:
            return
        self._varied.most = min(self._varied.most, max(LONGEST, LONGER * self._varied.substeps))
        measured = {name: float(np.linalg.norm(np.nan_to_num(rows))) for name, rows in self._data.values.items()}
        for chart, own in by_chart(self._charts, np.eye(len(p))):
            moved = {name: float(np.linalg.norm(np.nan_to_num(rows) @ own.T)) for name, rows in slopes.items()}
            sizes = [measured[name] / moved[name] for name in moved if measured[name] and moved[name]]
            if sizes and not chart.start.any():
                chart.size = min(sizes)

    def _evaluate(self, p: Array, data: Measured) -> tuple[dict[str, Array], dict[str, Array]]:
        """Return residuals, and their derivatives by numbers, by output. Raises an error of NO_RUN."""
        scene = self._asked.replace(changes(self._charts, p))
        time = np.unique(np.append(scene.run.start, data.time))
        found = self._varied.along(scene, drive_of(scene, self._tables, self._interpolate, time=time))
        rows = np.searchsorted(time, data.time)
        left, slopes = dict[str, Array](), dict[str, Array]()
        for name, values in data.values.items():
            of = found.of["attitude" if name == QUATERNION else name][rows]
            left[name], slopes[name] = residuals(name, found.values[name][rows], values, of)
        return left, slopes

    def _slopes(self, p: Array) -> Array:
        """Return the derivatives (n, n) of all numbers by coordinates."""
        return np.asarray(self._block_diagonal(*(chart.slopes(row) for chart, row in by_chart(self._charts, p))))

    def _minimize(self, p: Array, data: Measured, sigma: Mapping[str, float], held: float) -> Array:
        """Return the coordinates of the least sum of squares; held: the weight that holds them at their start p."""
        begin, seen, self._was_long = p.copy(), dict[bytes, tuple[Array, Array]](), False

        def f_and_J(x: Array) -> tuple[Array, Array]:
            if (key := x.tobytes()) not in seen:
                seen.clear()
                f, J = self._stack(x, data, sigma)
                seen[key] = f, J @ self._slopes(x)
            f, J = seen[key]
            return np.append(f, held * (x - begin)), np.vstack([J, held * np.eye(len(x))])

        low, high = (np.concatenate(side) for side in zip(*(chart.bounds for chart in self._charts), strict=True))
        found = self._least_squares(
            lambda x: f_and_J(x)[0], np.clip(p, low, high), lambda x: f_and_J(x)[1], bounds=(low, high), x_scale="jac",
            loss=self._loss, max_nfev=MOST_TRIES if held == HELD else MOST_LAST, xtol=1e-12, ftol=1e-12, gtol=1e-12,
        )  # fmt: skip
        self._ended = found.status > 0 or not _still_falls(found)
        return np.asarray(found.x)

    def _stack(self, p: Array, data: Measured, sigma: Mapping[str, float]) -> tuple[Array, Array]:
        """Return residuals over their standard deviation, without gaps, and their derivatives by numbers."""
        try:
            left, slopes = self._evaluate(p, data)
        except NO_RUN:
            self._was_long |= self._varied.substeps > self._varied.most
            return np.full(data.count, REFUSED), np.zeros((data.count, len(p)))
        f = np.concatenate([(left[name] / sigma[name]).ravel() for name in left])
        J = np.concatenate([(slopes[name] / sigma[name]).reshape(-1, len(p)) for name in left])
        known = np.isfinite(f)
        return f[known], J[known]

    def _finish(self, p: Array, sigma: Mapping[str, float]) -> Fit:
        scene = self._scene.replace(changes(self._charts, p))
        left, _ = self._evaluate(p, self._data)  # raises the scene's error if it is refused
        f = np.concatenate([noise.noisy(rows) / sigma[name] for name, rows in left.items()])
        J = self._stack(p, self._data, sigma)[1]
        values = np.concatenate([chart.numbers(row) for chart, row in by_chart(self._charts, p)])
        # by numbers, as a coordinate that is the logarithm of a tiny number would hide that no data determine it
        sizes = np.concatenate([np.full(chart.count, chart.scale(row)) for chart, row in by_chart(self._charts, p)])
        is_known = len(self._given) == len(self._data.values)
        accuracy, measured = self._scene.run.accuracy, self._data.values.items()
        relative, unknown = self._tell_apart(J * sizes, noise.scatter(f, self._loss, len(p), is_known))
        covariance = relative * np.outer(sizes, sizes)
        lost = noise.are_lost(unknown, np.sqrt(np.diag(relative)), accuracy * float(np.linalg.norm(J * sizes)))
        meanings = tuple(self._meaning(direction, sizes * direction) for direction in unknown)
        errors = np.where(lost, np.inf, np.sqrt(np.diag(covariance)))
        charts = by_chart(self._charts, np.arange(len(p)))
        edges = [chart.whole for chart, at in charts if chart.is_at_edge(p[at], covariance[np.ix_(at, at)])]
        covariance[lost, :] = covariance[:, lost] = np.nan
        ended = [] if self._ended else [f"the search came to no end in {MOST_LAST} runs: expected one begun nearer"]
        if self._was_long and self._varied.substeps > BESIDE * (most := self._varied.most):
            leads = "which are refused: expected data that the model can follow, or a search begun nearer"
            ended.append(f"the search leads to runs of more than {most:.1e} substeps, {leads}")
        ended += [f"{key} is within its error of what no body has: errors may be far too small" for key in edges]
        own = {name: accuracy * max(noise.largest(name, rows), FLOORS.get(name, 0.0)) for name, rows in measured}
        doubts = [*ended, *noise.trends(left, own), *noise.too_large(f, self._given)]
        if doubts and any(chart.whole == INERTIA and chart.count == 3 for chart in self._charts):
            doubts.append(f"{INERTIA} has no products, which stay zero: with a small one in the scene they vary too")
        return Fit(scene, self._names, np.where(lost, np.nan, values), errors, covariance, meanings, left, dict(sigma),
                   tuple(doubts), self._data)  # fmt: skip

    def _tell_apart(self, J: Array, scatter: float) -> tuple[Array, list[Array]]:
        """Return the covariance of numbers in directions that the data determine, and the other directions."""
        axes = np.eye(J.shape[1])
        seen = np.linalg.norm(J, axis=0) > 1e-12 * np.linalg.norm(J)
        _, s, V = np.linalg.svd(J[:, seen], full_matrices=False)
        V = V @ axes[seen]
        known = s * UNTOLD > math.sqrt(scatter)
        return scatter * (V[known].T / s[known] ** 2) @ V[known], [*axes[~seen], *V[~known]]

    def _meaning(self, relative: Array, direction: Array) -> str:
        """Return a message about an undetermined direction."""
        at = np.flatnonzero(np.abs(relative) > 0.05 * np.max(np.abs(relative)))
        if len(at) == 1:
            return f"{self._names[at[0]]}: nothing in these data tells it"
        first = direction[at[0]]
        ratio = " : ".join(f"{direction[n] / first:.3g}" for n in at)
        return f"{', '.join(self._names[n] for n in at)}: nothing tells a common change of them, as {ratio}"


def _still_falls(found: Any) -> bool:
    """Return whether, by its slopes where a search ended, the sum of squares would fall in determined directions."""
    _, s, V = np.linalg.svd(found.jac, full_matrices=False)
    step = V @ found.grad / s  # over the error of each direction
    share = max(1.0, 2.0 * found.cost / len(found.fun))
    determined = step[s * UNTOLD > math.sqrt(share)]
    return bool(determined @ determined > STILL_FALLS * share)


def _scene_to_run(scene: Scene, data: Measured) -> Scene:
    """Return the scene that runs as long as the data, shows the measured outputs, and has no events."""
    tables = {name: table for name, table in scene.to_dict().items() if name not in ("events", "ensemble")}
    own = {name: row for name, row in tables["outputs"].items() if name in data.values}
    tables["outputs"] = own | {"quantities": [name for name in data.values if name not in own]}
    end = float(data.time[-1])
    tables["run"] = tables["run"] | {"stop": end, "step": end - scene.run.start}
    return Scene.from_dict(tables, scene.name)
