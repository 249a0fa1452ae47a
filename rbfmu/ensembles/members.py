"""The members of an ensemble: the numbers drawn for each, the values applied, which are refused, and the scene of one.

Applied are attitudes as quaternions, inertia as matrices, and all other numbers by their keys.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType
from typing import Any

import numpy as np

from rbfmu import arrays
from rbfmu.ensembles import draws, variables
from rbfmu.scene.body import SHAPES, Body
from rbfmu.scene.ensemble import GRID, Ensemble, nominal_value
from rbfmu.scene.scene import Scene, SceneError
from rbfmu.scene.variations import ATTITUDE, AXES, DEGREES, INERTIA, RULES, SHAPE, UNIFORM, Marginal, Variation
from rbfmu.types import Array, Indices
from rbfmu_kernels.compile.tiered import evaluated, tiered
from rbfmu_kernels.mechanics import inertia
from rbfmu_kernels.rotations import euler_angles, quaternion, rotation_vector

ATTEMPTS = 100
"""How often a member with an inertia that is not physically possible is drawn again; after that it is refused.

If half of the draws are possible, one member in 1e30 is refused. If none is possible, the scene is wrong, and the user
should learn this soon.
"""


@dataclass(frozen=True)
class Samples:
    """Members of an ensemble, one a row.

    first: the number of the first member; applied: SI numbers (count, ...) by the key of the scene, attitudes q_ab as
    quaternions, scalar first, inertia as matrices; drawn: the drawn numbers (count,) by name, in the file's units,
    relative ones as factors; redrawn: how often each member was drawn again because its inertia was impossible.
    """

    first: int
    applied: Mapping[str, Array]
    drawn: Mapping[str, Array]
    redrawn: Indices

    def __len__(self) -> int:
        return len(self.redrawn)


def ensemble_of(scene: Scene) -> Ensemble:
    """Return the scene's ensemble. Raises SceneError where there is none."""
    if scene.ensemble is None:
        expected = 'a table [ensemble.vary] with keys that vary, such as "body.mass" = { normal = [50.0, 0.5] }'
        raise SceneError(f"ensemble is missing: expected {expected}", scene.name)
    return scene.ensemble


def with_runs(scene: Scene, runs: int | None) -> Scene:
    """Return the scene with this number of runs; None keeps the scene's own.

    Raises SceneError without an ensemble, for another number of runs of a grid, or if two kept results would have the
    same name.
    """
    ensemble_of(scene)
    variables.check_names(scene)
    return scene if runs is None else scene.replace({"ensemble.runs": runs})


def for_ends(scene: Scene) -> Scene:
    """Return the scene with the whole run as one communication step if only final values are kept, without ports.

    Nobody reads the results of shorter steps. They would end a series before its reach, and prevent members from
    running side by side: 600 steps under a constant torque took 7 times as long. A scene with events keeps its steps,
    as there may be many events in a run.
    """
    if ensemble_of(scene).keep != (variables.FINAL,) or scene.inputs.ports or scene.events:
        return scene
    return scene.replace({"run.step": scene.run.stop - scene.run.start})


def draw(scene: Scene, first: int, count: int) -> Samples:
    """Return `count` >= 1 members from number `first` on; a member's row is the same whichever others are asked for.

    Raises SceneError without an ensemble, ValueError for members that it does not have.
    """
    ensemble = ensemble_of(scene)
    if not 0 <= first < first + count <= ensemble.runs:
        raise ValueError(f"draw: first = {first}, count = {count}: expected members of the {ensemble.runs} runs")
    found = samples_at(scene, draws.points(ensemble, first, count), first)
    return found if ensemble.design == GRID else _with_possible_inertia(scene, found)


def samples_at(scene: Scene, cube: Array, first: int = 0) -> Samples:
    """Return the members at points (count, n) of the unit cube, whether their inertia is possible or not."""
    drawn = draws.correlated_values(ensemble_of(scene), cube)
    applied = dict(_Appliance(scene, drawn, len(cube)).values())
    return Samples(first, applied, drawn, np.zeros(len(cube), dtype=np.int64))


def _with_possible_inertia(scene: Scene, found: Samples) -> Samples:
    """Return the members, with all numbers of those with an impossible inertia drawn again, by their own streams."""
    if ensemble_of(scene).variation_of(INERTIA) is None:
        return found
    rows = _to_draw_again(found)
    for attempt in range(1, ATTEMPTS + 1):
        if not len(rows):
            break
        other = samples_at(scene, draws.at_random(ensemble_of(scene), found.first, len(found), attempt)[rows])
        for mine, theirs in ((found.applied, other.applied), (found.drawn, other.drawn)):
            for key, values in mine.items():
                values[rows] = theirs[key]
        found.redrawn[rows] += 1
        rows = rows[_to_draw_again(other)]
    return found


def _to_draw_again(samples: Samples) -> Indices:
    """Return the rows with an impossible inertia, except those whose mass is not positive: these are refused."""
    rows = impossible_rows(samples.applied[INERTIA])
    mass = samples.applied.get("body.mass")
    return rows if mass is None else rows[mass[rows] > 0.0]


# Scenes of members


def member(scene: Scene, samples: Samples, row: int, more: Mapping[str, Any] = MappingProxyType({})) -> Scene:
    """Return the scene of one member, as a user would have written it, with more changes; no event ends its run.

    Raises SceneError if the member is refused.
    """
    changes: dict[str, Any] = {"ensemble": None, **more}
    if any(event.stop for event in scene.events.values()):
        changes["events"] = {name: row | {"stop": False} for name, row in scene.to_dict()["events"].items()}
    for key, values in samples.applied.items():
        value = values[row].tolist()
        if key == ATTITUDE:
            changes[key] = {"quaternion": value}
        elif not key.startswith(f"{SHAPE}."):
            changes[key] = value
    try:
        _check_shape(scene, samples, row)
        return scene.replace(changes)
    except SceneError as error:
        raise SceneError(error.faults, f"{scene.name}, member {samples.first + row}") from None


def refusals(scene: Scene, samples: Samples) -> dict[int, str]:
    """Return for each refused member its row and the message, by the scene's own checks."""
    messages = {}
    for row in np.unique(np.concatenate(list(_rows_in_doubt(scene, samples)))).tolist():
        try:
            member(scene, samples, row)
        except SceneError as error:
            messages[row] = str(error)
    return messages


def _check_shape(scene: Scene, samples: Samples, row: int) -> None:
    """Raise SceneError for a shape that a scene refuses, as its inertia alone may look possible."""
    if shape := ensemble_of(scene).variation_of(SHAPE):
        sizes = {key.removeprefix(f"{SHAPE}."): value[row].tolist() for key, value in samples.applied.items()
                 if key.startswith(f"{SHAPE}.")}  # fmt: skip
        SHAPES[shape.form].read({"kind": shape.form, **sizes})


def _rows_in_doubt(scene: Scene, samples: Samples) -> list[Indices]:
    """Return the rows that a scene's checks may refuse: few, except for slender beams."""
    found, known = [np.empty(0, dtype=np.int64)], {**RULES, **variables.SIZES}
    for key, values in samples.applied.items():
        rows, rule = values.reshape(len(samples), -1), known.get(key)
        if not np.isfinite(rows).all():
            found.append(np.flatnonzero(~np.isfinite(rows).all(axis=1)))
        if rule is not None and not rule.holds(float(rows.min())):
            found.append(np.flatnonzero([not rule.holds(least) for least in rows.min(axis=1).tolist()]))
    M = samples.applied.get(INERTIA)
    if M is not None:
        found += [impossible_rows(M), thin_rows(M)]
    elif scene.body is not None and len(thin_rows(np.array([scene.body.inertia]))):
        found.append(np.arange(len(samples)))
    return found


def _in_si(key: str) -> str:
    """Return the key under which numbers are applied in SI units; a user's own name may end in `_deg` as well."""
    return "initial.omega_b" if key == DEGREES else key


FEW = 2_000
"""The number of runs up to which compiling array functions does not pay."""


class _Appliance:
    """Makes the values that are applied to members: SI numbers (count, ...) by key, from drawn numbers (count,)."""

    def __init__(self, scene: Scene, drawn: Mapping[str, Array], count: int) -> None:
        self.scene, self.ensemble, self.drawn, self.count = scene, ensemble_of(scene), drawn, count

    def values(self) -> Iterator[tuple[str, Array]]:
        """Yield the keys of the scene and the values that are applied."""
        for variation in self.ensemble.vary:
            if variation.key == ATTITUDE:
                yield ATTITUDE, self._attitude(variation)
            elif variation.key == SHAPE:
                yield from self._sizes(variation)
            elif variation.key != INERTIA:
                yield _in_si(variation.key), self._numbers(variation)
        if self.ensemble.variation_of(INERTIA) or self.ensemble.variation_of(SHAPE):
            yield INERTIA, self._inertia()

    def call(self, kernel: Any, *columns: Array, sequence: str = "") -> Array:
        """Return a kernel's values for each member; if there are many, by its array function, with the same bits."""
        names = (sequence,) if sequence else ()
        if self.ensemble.runs > FEW:
            return np.asarray(getattr(arrays, kernel.__name__)(*names, *columns))
        of_one = partial(tiered(kernel, self.count), *map(euler_angles.sequence, names))
        rows = zip(*(map(_tuples, column.tolist()) for column in columns), strict=True)
        return np.array([of_one(*row) for row in rows])

    # Numbers that are applied as drawn

    def column(self, marginal: Marginal) -> Array:
        """Return the values (count,) of one number; a constant is the same for all members."""
        found = self.drawn.get(marginal.name)
        return np.full(self.count, marginal.constant) if found is None else found

    def _columns(self, variation: Variation, prefix: str = "") -> Array:
        return np.column_stack([self.column(m) for m in variation.marginals if m.name.startswith(prefix)])

    def _numbers(self, variation: Variation) -> Array:
        rows = self._columns(variation)
        if variation.is_relative:
            rows *= np.array(nominal_value(_in_si(variation.key), vars(self.scene)))
        elif variation.key == DEGREES:
            rows *= np.pi / 180.0
        return rows if variation.marginals[0].name.endswith("]") else rows[:, 0]

    def _sizes(self, variation: Variation) -> Iterator[tuple[str, Array]]:
        for name in SHAPES[variation.form].sizes():
            rows = self._columns(variation, f"{SHAPE}.{name}")
            yield f"{SHAPE}.{name}", rows if rows.shape[1] > 1 else rows[:, 0]

    # Attitudes

    def _attitude(self, variation: Variation) -> Array:
        rows, form = self._columns(variation), variation.form
        if form.endswith("_deg"):
            rows = rows * (np.pi / 180.0)
        if form == UNIFORM:
            q = self._any_rotation(rows)
        elif form.startswith("angles"):
            q = self.call(euler_angles.quaternion_from_euler, rows, sequence=variation.table["euler"])
        else:
            q = self.call(rotation_vector.quaternion_from_rotvec, rows)
        if form.startswith("about"):
            q = self.call(quaternion.compose_quaternions, self._for_all(self.scene.initial.quaternion), q)
        return self.call(quaternion.normalize, q)

    def _any_rotation(self, u: Array) -> Array:
        """Return quaternions (count, 4) that are uniform over all rotations, from numbers u (count, 3) in [0, 1].

        Source: Shoemake, Uniform random rotations, Graphics Gems III (1992).
        """
        first, second = (self._unit_circle(2.0 * np.pi * u[:, k]) for k in (1, 2))
        return np.column_stack([np.sqrt(1.0 - u[:, :1]) * first, np.sqrt(u[:, :1]) * second])

    def _unit_circle(self, angle: Array) -> Array:
        """Return (cos, sin) (count, 2), by the kernels' own functions."""
        zero = np.zeros(self.count)
        return self.call(rotation_vector.quaternion_from_rotvec, np.column_stack([zero, zero, 2.0 * angle]))[:, [0, 3]]

    # Inertia

    def _inertia(self) -> Array:
        """Return M_c (count, 3, 3), symmetric to the last bit."""
        variation = self.ensemble.variation_of(INERTIA)
        if variation is None:
            return self._inertia_of_shape()
        own = self._columns(variation, f"{INERTIA}[") if variation.form else None
        if own is not None and own.shape[1] == 6:
            return variables.symmetric(own)
        M = self._along_axes(own, variation)
        if any(m.name.startswith(f"{INERTIA}.{AXES}") for m in variation.marginals):
            u = self._columns(variation, f"{INERTIA}.{AXES}") * (np.pi / 180.0)
            M = self.call(inertia.rotate_inertia, self.call(rotation_vector.matrix_from_rotvec, u), M)
        return 0.5 * (M + M.transpose(0, 2, 1))

    def _along_axes(self, own: Array | None, variation: Variation) -> Array:
        """Return M_c with the scene's own principal axes and varied moments; own: the moments, or factors on them."""
        if self.ensemble.variation_of(SHAPE):
            M = self._inertia_of_shape()
            return M if own is None else M * (own[:, None, :] * np.eye(3))
        assert self.scene.body is not None
        if own is None:
            return self._for_all(self.scene.body.inertia)
        moments, R_bp = axes_of(self.scene.body)
        M = (own * moments if variation.is_relative else own)[:, None, :] * np.eye(3)
        return M if R_bp is None else self.call(inertia.rotate_inertia, self._for_all(R_bp), M)

    def _inertia_of_shape(self) -> Array:
        variation = self.ensemble.variation_of(SHAPE)
        assert variation is not None
        assert self.scene.body is not None
        mass = self.ensemble.variation_of("body.mass")
        masses = self._numbers(mass) if mass else np.full(self.count, self.scene.body.mass)
        # A member with a negative number is refused for that number, and not drawn again because of its inertia.
        sizes = (np.abs(value) for _, value in self._sizes(variation))
        return self.call(getattr(inertia, f"{variation.form}_inertia"), np.abs(masses), *sizes)

    def _for_all(self, value: Any) -> Array:
        return np.broadcast_to(np.array(value), (self.count, *np.shape(value)))


def axes_of(body: Body) -> tuple[Array, Any]:
    """Return the principal moments of M_c and R_bp.

    If M_c is diagonal, the moments are in the order of the body's axes, and R_bp is None.
    """
    M = np.array(body.inertia)
    if not np.any(M - np.diag(np.diag(M))):
        return np.diag(M), None
    moments, R_bp = evaluated(inertia.principal_axes, body.inertia)
    return np.array(moments), R_bp


def _tuples(value: Any) -> Any:
    return tuple(map(_tuples, value)) if isinstance(value, list) else value


NEAR = 1e3 * inertia.INERTIA_TOLERANCE
"""The distance from a border of the possible, as a part of the trace, within which the kernels' own check decides."""


def impossible_rows(M: Array) -> Indices:
    """Return the rows of symmetric matrices (n, 3, 3) that are no inertia of a body, by the kernels' own check."""
    found = [row for row in _near_a_border(M) if evaluated(inertia.check_inertia, _tuples(M[row].tolist()))]
    return np.array(found, dtype=np.int64)


def thin_rows(M: Array) -> Indices:
    """Return the rows with a moment that may count as zero, or with a number that is not finite."""
    rows: Indices = _near_a_border(M)
    finite = np.all(np.isfinite(M[rows]), axis=(1, 2))
    moments = np.linalg.eigvalsh(np.where(finite[:, None, None], M[rows], np.eye(3)))
    return np.asarray(rows[~finite | (moments[:, 0] <= NEAR * np.abs(moments).sum(axis=1))])


def _near_a_border(M: Array) -> Indices:
    """Return the rows that are not clearly possible: those where E = t/2 - M, t the trace, is not clearly positive.

    An eigenvalue of E is half the excess of the sum of two moments over the third. Each is at least det E / t^2. So a
    matrix far from the borders, a zero moment and an equality in the triangle inequality, is found without eigenvalues.
    """
    with np.errstate(all="ignore"):
        t = np.trace(M, axis1=1, axis2=2)
        x, y, z = (0.5 * t - M[:, k, k] for k in range(3))
        xy, xz, yz = M[:, 0, 1], M[:, 0, 2], M[:, 1, 2]
        minor = x * y - xy * xy
        determinant = x * (y * z - yz * yz) - xy * (xy * z + yz * xz) - xz * (xy * yz + y * xz)
        plain = (x > 0.0) & (minor > 0.0) & (determinant > NEAR * t * t * t) & np.isfinite(determinant)
    return np.flatnonzero(~plain)
