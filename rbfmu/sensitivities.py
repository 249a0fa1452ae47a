"""How a motion depends on each number of its scene: derivatives along the motion, by the variational equations."""

import math
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from rbfmu import arrays, on_disk
from rbfmu.arrays.from_kernel import as_floats, no_numbers
from rbfmu.exceptions import SceneError, path_of
from rbfmu.models import formulas, question, registry
from rbfmu.models.varied import TURN, Column, VariedModel
from rbfmu.planning import judge, methods, reference
from rbfmu.result import write_npz
from rbfmu.runs.inputs import HOLD, Drive, drive_of, input_tables
from rbfmu.runs.plan import KEYS, Plan, checked_plan
from rbfmu.runs.steps import SAME, Steps, substeps_counted
from rbfmu.scene import own
from rbfmu.scene.body import six_numbers
from rbfmu.scene.scene import Scene, of_scene_or_path
from rbfmu.types import Array, ArrayLike
from rbfmu_kernels.buffer import NO_OUTPUTS
from rbfmu_kernels.compile.tiered import tiered
from rbfmu_kernels.quantities import IN_BUFFER_ORDER, OUTPUT, elements, indices

TIGHTER = 0.3
"""The tolerance of the run over the scene's accuracy: derivatives are evaluated along the motion, with its errors.

Of three motions at 1e-6, slopes were off by 0.001 to 0.005 of the accuracy, relative to their largest; with the
accuracy itself as the tolerance by 0.005 to 0.01, with three times as much by 0.04 to 0.1.
"""
SHARE = 1e-4
"""The part of the tolerance for one substep, of hundreds in a run: it determines the order of least cost."""
AT_ZERO = 1e-6
"""What an event watches counts as zero below this part of its size: round-off of larger terms does, a jump does not."""
ATTITUDE = "initial.attitude"
TAKEN = ("attitude", "errors", "slopes", "numbers")
"""Names that no own output can have, as they have other meanings in `Sensitivity.of`, in a run, or in files."""
PERCENT, ENDINGS = 0.01, (".csv", ".npz")


@dataclass(frozen=True, eq=False, repr=False)
class Sensitivity:
    """The result of `sensitivity`; SI units.

    time (times,): s; numbers: names of the numbers that vary; sizes (numbers,): their absolute values, 0 for an
    attitude; of: by the name of each output, its derivatives (times, k, numbers), k numbers of the output;
    `of["attitude"]` (times, 3, numbers), in place of the quaternion, is the derivative of the attitude as a rotation
    vector in b; values: outputs (times, k) by name; covariance: of each output (times, k, k), if a covariance of the
    numbers was given.
    """

    time: Array
    numbers: tuple[str, ...]
    sizes: Array
    of: Mapping[str, Array]
    values: Mapping[str, Array]
    covariance: Mapping[str, Array]

    def __repr__(self) -> str:
        return f"Sensitivity(of {', '.join(self.of)} by {', '.join(self.numbers)}; {len(self.time)} times)"

    @property
    def keys(self) -> dict[str, list[int]]:
        """Return the keys of the numbers, with the indices of their numbers; a key with one number has its name."""
        return {key if len(at) > 1 else self.numbers[at[0]]: at for key, at in by_key(self.numbers).items()}

    def changes(self, name: str) -> dict[str, Array]:
        """Return for each key the change of an output (times,), in its unit, if the key's numbers change by 1 %.

        Each number of a key changes by 0.01 of the largest of them, or by 0.01 (rad for an attitude) if all are zero.
        The effects of the numbers are added like independent errors: the square root of the sum of squares.
        """
        scales = {key: PERCENT * (float(np.max(self.sizes[at])) or 1.0) for key, at in self.keys.items()}
        slopes = self.of[name]
        return {key: scales[key] * np.linalg.norm(slopes[:, :, at], axis=(1, 2)) for key, at in self.keys.items()}

    def save(self, path: str | Path) -> None:
        """Write `.npz` (time, and derivatives by output) or `.csv` (a column `omega_b[1] by constants.k` each)."""
        path = path_of(path)
        if path.suffix not in ENDINGS:
            raise ValueError(f"cannot save to {str(path)!r}: the name must end in {' or '.join(ENDINGS)}")
        with on_disk.replacing(path) as file:
            if path.suffix == ".npz":
                carried = {f"covariance {name}": rows for name, rows in self.covariance.items()}
                write_npz(file, {"time": self.time, "numbers": self.numbers, **self.of, **carried})
                return
            of = [element for name, rows in self.of.items() for element in elements(name, rows.shape[1])]
            header = ",".join(f'"{name}"' for name in ("time", *(f"{e} by {n}" for e in of for n in self.numbers)))
            table = np.column_stack([self.time, *(rows.reshape(len(rows), -1) for rows in self.of.values())])
            np.savetxt(file, table, fmt="%.17g", delimiter=",", header=header, comments="", encoding="utf-8")

    def plot(self, path: str | Path | None = None, title: str = "") -> Any:
        """Draw the `changes` of each output over time; return the matplotlib.figure.Figure.

        path: a file to draw to, whose ending (.png, .svg, .pdf) sets the format.
        """
        from rbfmu.plot import plot_changes

        return plot_changes(self.time, {name: self.changes(name) for name in self.of}, path, title)


@of_scene_or_path
def sensitivity(
    scene: Scene,
    /,
    by: Sequence[str],
    planned: Plan | None = None,
    covariance: ArrayLike | None = None,
    *,
    inputs: Any = None,
    interpolate: str = HOLD,
) -> Sensitivity:
    """Return the derivatives of a scene's outputs over time by numbers of its start, body, loads and constants.

    by: keys such as "initial.omega_b", "initial.attitude" (a small rotation in b, rad), "body.inertia" (three moments
    if its products are zero, else all six), "body.inertia[1,2]", "constants.k", "states.charge".
    planned: a plan by series, whose order and tolerance are used; as these are chosen for the motion alone, derivatives
    may be less accurate than the motion; covariance (numbers, numbers): of the numbers, from which the derivatives give
    covariances of outputs; inputs, interpolate: see `simulate`.

    The derivatives obey the variational equations of the motion, and are integrated together with it by the same
    series, whatever model a plan would choose; substeps are short enough for both. At a corner of a formula they jump,
    as the time of the corner shifts. In a run that an event stops, the last row is at the event, whose time shifts as
    well. If a motion begins exactly where rates jump, the derivatives are for changes after which it begins beyond the
    jump.
    Raises SceneError, SimulationError; ValueError for a key without a number, for a plan that is `interpolated`, if a
    corner is grazed, two corners are met at one time, or the event that ends the run is a jump over zero that no input
    makes.
    """
    varied, tables = Varied(scene, by), input_tables(scene, inputs, interpolate)
    if scene.has_formulas and planned is None:  # a motion that ends early would take ever shorter substeps
        with suppress(reference.ReferenceTooLongError):
            reference.reference_motion(scene, [scene.run.stop - scene.run.start], judge.MAX_REFERENCE_STEPS)
    return varied.along(scene, drive_of(scene, tables, interpolate), checked_plan(planned, stepped=True), covariance)


class Varied:
    """A scene and the numbers that vary: `along` returns the derivatives, also for other values of these numbers.

    argument: the name of the argument with their keys, for messages. Raises ValueError, SceneError.
    """

    def __init__(self, scene: Scene, by: Sequence[str], argument: str = "by") -> None:
        if scene.body is None:
            raise ValueError(f"{scene.name}: expected a scene with a body, not prescribed rates, for derivatives")
        if taken := [name for name in scene.outputs.own if name in TAKEN]:
            said = "expected another name where derivatives are taken, which call something else so"
            raise SceneError([f"outputs.{name}: {said}" for name in taken], scene.name)
        self.columns = [column for key in keys_of(by) for column in columns_of(scene, key, argument)]
        if not self.columns:
            raise ValueError(f"{argument}: expected at least one key")
        self.numbers = tuple(column.name for column in self.columns)
        if len({*self.numbers}) < len(self.numbers):
            raise ValueError(f"{argument}: expected each number once, not {', '.join(self.numbers)}")
        self.model = VariedModel(scene, self.columns)
        self.most, self.substeps = judge.MAX_SUBSTEPS, 0.0  # that a run may have; that the last one had

    def along(self, scene: Scene, drive: Drive, planned: Plan | None = None, covariance: Any = None) -> Sensitivity:
        """Return the derivatives at the communication points of a drive; scene: the first with other numbers.

        Raises as `sensitivity`.
        """
        try:
            run = _Run(self, scene, *self._plan(scene, planned), drive)
        except SceneError as error:
            if error.code != NO_OUTPUTS:
                raise
            why = "and norms, roots and angles of what is zero at the start have no derivative"
            raise SceneError([f"{fault}, {why}" for fault in error.faults], scene.name, error.code) from None
        of = run.slopes()
        for name, rows in of.items():
            known = np.isfinite(rows).all(axis=(1, 2))
            if not known.all():
                where = f"{scene.name}: {name} at t = {float(run.time[int(np.argmin(known))])!r} s"
                corners = "that grazes no corner, meets no two at one time"
                starts = "nor starts where a norm, a root or an angle is of zero (start a little off)"
                raise ValueError(f"{where}: expected a motion with finite derivatives, {corners}, {starts}")
        spread = {} if covariance is None else self._propagate(of, covariance)
        return Sensitivity(run.time, self.numbers, run.sizes, of, run.values, spread)

    def _propagate(self, of: Mapping[str, Array], numbers: Any) -> dict[str, Array]:
        n, wrong = len(self.columns), no_numbers(numbers)
        covariance = np.empty(0) if wrong else as_floats("sensitivity", "covariance", numbers)
        if covariance.shape != (n, n):
            why = f", which {wrong}" if wrong else ""
            raise ValueError(f"covariance: expected a matrix {(n, n)} for {', '.join(self.numbers)}{why}")
        if not (np.isfinite(covariance).all() and _least_variance(covariance) >= -1e-9):
            expected = "finite numbers, a symmetric matrix, and variances of at least 0, also of sums"
            raise ValueError(f"covariance: expected {expected}")
        return {name: np.einsum("tkn,nm,tlm->tkl", S, covariance, S) for name, S in of.items()}

    def _plan(self, scene: Scene, planned: Plan | None) -> tuple[Plan, bool]:
        """Return the plan of the run, and whether errors of derivatives limit substeps, which a given plan prevents."""
        # a splitting and a quadrature have orders as well, but no tolerance
        key, orders = registry.FORMULAS.key, self.model.model.ORDERS
        if planned is not None and planned.tolerance > 0.0 and planned.order in orders:
            return replace(planned, model=key, formulas=self.model), False
        asked, states = question.Question(scene), len(self.model.rates)
        tolerance = max(TIGHTER * asked.accuracy, methods.TIGHTEST)
        order = methods.likely_order(SHARE * tolerance)
        return Plan(key, "", states, tolerance=tolerance, order=order, span=asked.span, formulas=self.model), True


def _least_variance(covariance: Array) -> float:
    """Return the least eigenvalue of the correlations; -inf if a covariance is not symmetric or a variance is < 0."""
    deviations = np.sqrt(np.diag(covariance).clip(0.0))
    if np.any(np.diag(covariance) < 0.0):
        return -math.inf
    units = np.where(deviations > 0.0, deviations, 1.0)
    correlations = covariance / np.outer(units, units)
    return float(np.linalg.eigvalsh(correlations)[0]) if np.allclose(correlations, correlations.T) else -math.inf


def by_key(numbers: Sequence[str]) -> dict[str, list[int]]:
    """Return the keys of numbers, each with the indices of its numbers."""
    keys = [number.partition("[")[0] for number in numbers]
    return {key: [n for n, other in enumerate(keys) if other == key] for key in dict.fromkeys(keys)}


def keys_of(keys: object) -> list[Any]:
    """Return keys as a list, also a single one; `columns_of` checks them."""
    return [keys] if isinstance(keys, str) or not isinstance(keys, Iterable) else [*keys]


def _names_of_numbers(scene: Scene) -> dict[str, tuple[str, list[str]]]:
    """Return for each key with numbers their block, and their names."""
    rows = {KEYS[row.name]: row for row in IN_BUFFER_ORDER if row.name != "quaternion_0"} | scene.own_parameters
    found = {key: (row.block, [key + index for index in indices(row)]) for key, row in rows.items()}
    return {ATTITUDE: ("rotvec_b", elements(ATTITUDE, 3))} | found


def columns_of(scene: Scene, key: str, argument: str = "by") -> list[Column]:
    """Return the numbers of a key of an argument. Raises ValueError for a key that cannot vary."""
    known, expected = _names_of_numbers(scene), f"{argument} = {key!r}: expected"
    whole = key.partition("[")[0] if isinstance(key, str) else ""
    if whole not in known:
        raise ValueError(f"{expected} one of {', '.join(known)}")
    block, names = known[whole]
    on_graph = elements(block, len(names))
    found = [Column(name, on_graph[i], i) for i, name in enumerate(names)]
    if whole != key:
        found = [column for column in found if column.name == key]
        if not found:
            raise ValueError(f"{expected} one of {', '.join(names)}")
    elif whole == "body.inertia" and scene.body is not None and not any(six_numbers(scene.body.M_c)[3:]):
        found = found[:3]
    if whole in {f"loads.{name}" for name in scene.loads.made}:
        raise ValueError(f"{expected} {own.OF_NUMBERS}")
    if block in ("inertia", "r_oc_b") and scene.body is not None and scene.body.axis_without_inertia is not None:
        raise ValueError(f"{expected} another; a slender beam has no inertia about its axis to begin with")
    return found


class _Run:
    """The recorded run of a motion and its derivatives."""

    def __init__(self, varied: Varied, scene: Scene, plan: Plan, bounded: bool, drive: Drive) -> None:
        self._model, self._scene, self._count = varied.model, scene, len(varied.columns)
        run = Steps(scene, plan, drive, [name for name in self._model.shown if name in OUTPUT])
        blocks, z = plan.kernels.BLOCKS, run.z
        z[blocks["bounded"]] = bounded
        for name, row in self._model.numbers(z).items():
            z[blocks[name]] = row
        tiered(plan.kernels.outputs)(z)
        numbers = (column.element for column in varied.columns)
        self.sizes = np.array([0.0 if name in TURN else abs(z[self._model.place(name)]) for name in numbers])
        try:
            self.time, self.values = run.course((*self._model.shown, "errors", "slopes"), most=varied.most)
        finally:
            varied.substeps = substeps_counted(plan.kernels, z)
        self._event = run.events.ended_by if run.events else ""
        self._inputs, self._jumps = _inputs_at(drive, float(self.time[-1]))
        self._slopes = self.values.pop("slopes")
        self._errors = self.values.pop("errors").reshape(len(self.time), -1, self._model.columns)

    def slopes(self) -> dict[str, Array]:
        """Return the derivatives of each output; the last row of a run that an event ended is at the shifted event."""
        found, shift = {}, self._shift() if self._event else None
        for name in self._scene.outputs.names:
            of = "quaternion" if name == "rpy" else name
            rows = self._attitude_slopes() if of == "quaternion" else self._slopes_of(of)
            if shift is not None:
                rows[-1] += self._model.rates_at(of, self._slopes[-1], self._inputs)[:, None] * shift
            found["attitude" if name == "quaternion" else name] = self._angle_slopes(rows) if name == "rpy" else rows
        return found

    def _shift(self) -> Array:
        """Return the derivatives of the time of the event that ended the run; zero if a jump of inputs caused it.

        Raises ValueError if another jump caused it.
        """
        when = f"{formulas.EVENT}{self._event}"
        rate = self._model.rates_at(when, self._slopes[-1], self._inputs)[0]
        course = np.abs(self._slopes[:, self._model.wanted[np.ravel(self._model.shown[when])[0]]])
        size = np.max(course) + abs(rate) * (self.time[-1] - self.time[0])
        if course[-1] > max(self._scene.run.accuracy, AT_ZERO) * size:
            if not self._jumps:
                expected = "expected one that comes to zero, as of a jump over it no derivative is known"
                raise ValueError(f"{self._scene.name}: events.{self._event}: {expected}")
            return np.zeros(self._count)
        return np.asarray(-self._slopes_of(when)[-1, 0] / rate)

    def _slopes_of(self, name: str) -> Array:
        return self._model.slopes_at(name, self._errors, self._slopes, self._count)

    def _attitude_slopes(self) -> Array:
        return np.asarray(self._errors[:, [*map(self._model.errors.index, TURN)], : self._count])

    def _angle_slopes(self, turns: Array) -> Array:
        """Return the derivatives of roll, pitch and yaw; turns: the derivatives of the attitude."""
        angles = arrays.euler_from_quaternion("ZYX", self.values["quaternion"])
        rates: Array = arrays.euler_rate_b("ZYX", angles[:, None, :], np.moveaxis(turns, 1, 2))
        return np.moveaxis(rates[..., ::-1], 1, 2)


def _inputs_at(drive: Drive, t: float) -> tuple[dict[str, float], bool]:
    """Return the rate (1/s) of each number of the ports just before a time, by name, and whether one jumps then."""
    ends = drive.time[0] + np.cumsum(drive.lengths)
    piece = min(int(np.searchsorted(ends, t)), len(ends) - 1)
    names = [element for port, size in drive.ports.items() for element in elements(port, size)]
    rates = dict(zip(names, drive.slopes[piece].tolist(), strict=True))
    k = np.flatnonzero(np.abs(ends[:-1] - t) <= SAME * drive.lengths[:-1])  # the piece that ends there, if one does
    return rates, bool(np.any(drive.values[k + 1] != drive.values[k] + drive.lengths[k, None] * drive.slopes[k]))
