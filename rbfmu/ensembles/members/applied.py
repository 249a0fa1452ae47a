"""From the numbers drawn to what is applied: attitudes as quaternions, inertia as matrices, all else by its key."""

from collections.abc import Iterator, Mapping
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rbfmu import arrays
from rbfmu.ensembles.columns import symmetric
from rbfmu.scene.body import SHAPES, Body
from rbfmu.scene.ensemble import nominal_value
from rbfmu.scene.marginals import RELATIVE, Marginal
from rbfmu.scene.scene import Scene
from rbfmu.scene.variations import ATTITUDE, AXES, DEGREES, INERTIA, SHAPE, UNIFORM_ROTATIONS, Variation
from rbfmu_kernels.compile.tiered import evaluated, tiered
from rbfmu_kernels.mechanics import inertia, shape_inertia
from rbfmu_kernels.rotations import euler_angles, quaternion, rotation_vector

Array = NDArray[np.float64]
Drawn = Mapping[str, Array]
FEW = 2_000
"""The runs up to which array functions are not worth their compilation."""


def applied(scene: Scene, drawn: Drawn, count: int) -> dict[str, Array]:
    """Return what is applied to `count` members, by the keys of the scene: SI numbers (count, ...)."""
    return dict(_Appliance(scene, drawn, count).values())


class _Appliance:
    """What is known of some members: the scene, and the numbers drawn (count,)."""

    def __init__(self, scene: Scene, drawn: Drawn, count: int) -> None:
        assert scene.ensemble is not None
        self.scene, self.ensemble, self.drawn, self.count = scene, scene.ensemble, drawn, count

    def values(self) -> Iterator[tuple[str, Array]]:
        """Yield the keys with what is applied."""
        for variation in self.ensemble.vary:
            if variation.key == ATTITUDE:
                yield ATTITUDE, self._attitude(variation)
            elif variation.key == SHAPE:
                yield from self._sizes(variation)
            elif variation.key != INERTIA:
                yield variation.key.removesuffix("_deg"), self._numbers(variation)
        if self.ensemble.of(INERTIA) or self.ensemble.of(SHAPE):
            yield INERTIA, self._inertia()

    def call(self, kernel: Any, *columns: Array, sequence: str = "") -> Array:
        """Return a kernel's values for each member: by array functions where there are many, with the same bits."""
        names = (sequence,) if sequence else ()
        if self.ensemble.runs > FEW:
            return np.asarray(getattr(arrays, kernel.__name__)(*names, *columns))
        of_one = partial(tiered(kernel, self.count), *map(euler_angles.sequence, names))
        rows = zip(*(map(_tuples, column.tolist()) for column in columns), strict=True)
        return np.array([of_one(*row) for row in rows])

    # Numbers that stand for themselves

    def column(self, marginal: Marginal) -> Array:
        """Return the values of one number, which may be the same for all."""
        found = self.drawn.get(marginal.name)
        return np.full(self.count, marginal.constant) if found is None else found

    def _columns(self, variation: Variation, prefix: str = "") -> Array:
        return np.column_stack([self.column(m) for m in variation.marginals if m.name.startswith(prefix)])

    def _numbers(self, variation: Variation) -> Array:
        rows = self._columns(variation)
        if variation.form == RELATIVE:
            rows *= np.array(nominal_value(variation.key.removesuffix("_deg"), vars(self.scene)))
        elif variation.key == DEGREES:
            rows *= np.pi / 180.0
        return rows if _is_vector(variation) else rows[:, 0]

    def _sizes(self, variation: Variation) -> Iterator[tuple[str, Array]]:
        for name in _sizes_of(variation):
            rows = self._columns(variation, f"{SHAPE}.{name}")
            yield f"{SHAPE}.{name}", rows if rows.shape[1] > 1 else rows[:, 0]

    # Attitudes

    def _attitude(self, variation: Variation) -> Array:
        rows, form = self._columns(variation), variation.form
        if form.endswith("_deg"):
            rows = rows * (np.pi / 180.0)
        if form == UNIFORM_ROTATIONS:
            q = self._any_rotation(rows)
        elif form.startswith("angles"):
            q = self.call(euler_angles.quaternion_from_euler, rows, sequence=variation.table["euler"])
        else:
            q = self.call(rotation_vector.quaternion_from_rotvec, rows)
        if form.startswith("about"):
            q = self.call(quaternion.compose_quaternions, self._all(self.scene.initial.quaternion), q)
        return self.call(quaternion.normalize, q)

    def _any_rotation(self, u: Array) -> Array:
        """Return quaternions that are uniform on all rotations, from three numbers in [0, 1] each.

        Source: Shoemake, Uniform random rotations, Graphics Gems III (1992).
        """
        first, second = (self._unit_circle(2.0 * np.pi * u[:, k]) for k in (1, 2))
        return np.column_stack([np.sqrt(1.0 - u[:, :1]) * first, np.sqrt(u[:, :1]) * second])

    def _unit_circle(self, angle: Array) -> Array:
        """Return (cos, sin), by the kernels' own functions."""
        zero = np.zeros(self.count)
        return self.call(rotation_vector.quaternion_from_rotvec, np.column_stack([zero, zero, 2.0 * angle]))[:, [0, 3]]

    # Inertia

    def _inertia(self) -> Array:
        """Return M_c, symmetric to the bit."""
        variation = self.ensemble.of(INERTIA)
        if variation is None:
            return self._inertia_of_shape()
        own = self._columns(variation, f"{INERTIA}[") if variation.form else None
        if own is not None and own.shape[1] == 6:
            return symmetric(own)
        M = self._along_axes(own, variation)
        if any(m.name.startswith(f"{INERTIA}.{AXES}") for m in variation.marginals):
            u = self._columns(variation, f"{INERTIA}.{AXES}") * (np.pi / 180.0)
            M = self.call(inertia.rotate_inertia, self.call(rotation_vector.matrix_from_rotvec, u), M)
        return 0.5 * (M + M.transpose(0, 2, 1))

    def _along_axes(self, own: Array | None, variation: Variation) -> Array:
        """Return M_c with the scene's own axes, its principal moments varied; own: moments, or factors of them."""
        if self.ensemble.of(SHAPE):
            M = self._inertia_of_shape()
            return M if own is None else M * (own[:, None, :] * np.eye(3))
        assert self.scene.body is not None
        if own is None:
            return self._all(self.scene.body.inertia)
        moments, R_bp = axes_of(self.scene.body)
        M = (own * moments if variation.form == RELATIVE else own)[:, None, :] * np.eye(3)
        return M if R_bp is None else self.call(inertia.rotate_inertia, self._all(R_bp), M)

    def _inertia_of_shape(self) -> Array:
        variation = self.ensemble.of(SHAPE)
        assert variation is not None
        assert self.scene.body is not None
        mass = self.ensemble.of("body.mass")
        masses = self._numbers(mass) if mass else np.full(self.count, self.scene.body.mass)
        # A member with a negative number is refused for that, and not drawn again for its inertia.
        sizes = (np.abs(value) for _, value in self._sizes(variation))
        return self.call(getattr(shape_inertia, f"{variation.form}_inertia"), np.abs(masses), *sizes)

    def _all(self, value: Any) -> Array:
        return np.broadcast_to(np.array(value), (self.count, *np.shape(value)))


def axes_of(body: Body) -> tuple[Array, Any]:
    """Return the principal moments of M_c and R_bp; in the order of the body's axes, and None, where these serve."""
    M = np.array(body.inertia)
    if not np.any(M - np.diag(np.diag(M))):
        return np.diag(M), None
    moments, R_bp = evaluated(inertia.principal_axes, body.inertia)
    return np.array(moments), R_bp


def _tuples(value: Any) -> Any:
    return tuple(map(_tuples, value)) if isinstance(value, list) else value


def _is_vector(variation: Variation) -> bool:
    return variation.marginals[0].name.endswith("]")


def _sizes_of(variation: Variation) -> list[str]:
    return [key for key in SHAPES[variation.form]._keys() if key != "kind"]
