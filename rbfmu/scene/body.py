"""The body of a scene: its mass, its inertia about the centre of mass, and its pivot."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

from rbfmu.scene import section as rules
from rbfmu_kernels.compile.tiered import evaluated
from rbfmu_kernels.mechanics import inertia as _inertia
from rbfmu_kernels.quantities import BY_NAME
from rbfmu_kernels.types import Matrix, Vec3

_UNIT = BY_NAME["inertia"].unit
ZERO = (0.0, 0.0, 0.0)
TRIANGLE = tuple((int(row) - 1, int(column) - 1) for row, column in (e.split(",") for e in BY_NAME["inertia"].elements))
"""Row and column of each of the six numbers of an inertia, in their order."""


class Inertia(rules.Numbers):
    """The rule of an inertia: principal moments or a matrix, stored as a symmetric and physically possible matrix."""

    def __init__(self) -> None:
        super().__init__((3, 3), _UNIT)
        self.choice = "3 principal moments or a 3x3 matrix"
        self.words = f"{self.choice} about the centre of mass ({_UNIT})"

    def _convert(self, value: object) -> Matrix:
        value = rules.plain(value)
        items = value if isinstance(value, list | tuple) else ()
        rows = any(isinstance(item, list | tuple) or getattr(item, "shape", ()) for item in items)
        floats = self.floats(value, (3, 3) if rows else (3,))
        return possible_inertia(floats if rows else evaluated(_inertia.diagonal, floats))


def possible_inertia(M: Matrix) -> Matrix:
    """Return an inertia matrix, symmetric to the last bit. Raises ValueError if no body can have it."""
    reason = int(evaluated(_inertia.check_inertia, M))
    if reason == _inertia.NOT_FINITE:
        raise ValueError(f"finite moments of inertia ({_UNIT})")
    if reason == _inertia.NOT_SYMMETRIC:
        raise ValueError(f"a symmetric 3x3 matrix ({_UNIT})")
    M = _symmetric(M)
    if reason == _inertia.NEGATIVE:
        raise ValueError(f"principal moments >= 0 ({_UNIT}), not {_moments(M)}")
    if reason == _inertia.TRIANGLE:
        raise ValueError(f"each principal moment at most the sum of the other two ({_UNIT}), not {_moments(M)}")
    return M


def six_numbers(M: Sequence[Sequence[float]]) -> list[float]:
    """Return the numbers of a symmetric matrix in the order of `TRIANGLE`."""
    return [M[i][j] for i, j in TRIANGLE]


def _symmetric(M: Matrix) -> Matrix:
    x, y, z = (M[i][j] if M[i][j] == M[j][i] else 0.5 * (M[i][j] + M[j][i]) for i, j in ((0, 1), (0, 2), (1, 2)))
    return ((M[0][0], x, y), (x, M[1][1], z), (y, z, M[2][2]))


@lru_cache(maxsize=64)
def principal_axes(M: Matrix) -> tuple[Vec3, Matrix]:
    """Return the principal moments in ascending order, and the axes as columns."""
    return evaluated(_inertia.principal_axes, M)


def _least_moment(M: Matrix) -> float:
    """Return the largest moment that counts as zero, kg m2."""
    return _inertia.INERTIA_TOLERANCE * evaluated(_inertia.trace, M)


def axis_without_moment(M: Matrix) -> Vec3 | None:
    """Return the axis about which an inertia (kg m2) has no moment, if there is one."""
    (low, _, _), R = principal_axes(M)
    return (R[0][0], R[1][0], R[2][0]) if low <= _least_moment(M) else None


def _moments(M: Matrix) -> str:
    return ", ".join(f"{moment:.6g}" for moment in principal_axes(M)[0])


KINDS = ("box", "beam", "cylinder", "sphere", "ellipsoid")
_KINDS = " or ".join(f'"{kind}"' for kind in KINDS)


class Shape(rules.Section, path="body.shape"):
    """The table of a homogeneous body's shape: its kind, and its sizes in the order of the kernel's arguments."""

    kind: Annotated[str, rules.one_word(KINDS, _KINDS)]

    @classmethod
    def sizes(cls) -> list[str]:
        """Return the keys of the sizes."""
        return [key for key in cls._keys if key != "kind"]

    def inertia(self, mass: float) -> Matrix:
        """Return M_c, kg m2."""
        kernel: Callable[..., Matrix] = getattr(_inertia, f"{self.kind}_inertia")
        return evaluated(kernel, mass, *(getattr(self, key) for key in self.sizes()))


_SIZE, _SIZES = rules.Numbers((), "m", *rules.POSITIVE), rules.Numbers((3,), "m", *rules.POSITIVE)


class _Beam(Shape):
    length: Annotated[float, _SIZE.means("beam along x: its length")]


class _Box(Shape):
    sides: Annotated[Vec3, _SIZES.means("box: its sides along x, y, z")]


class _Cylinder(Shape):
    radius: Annotated[float, _SIZE.means("cylinder about z: its radius")]
    length: Annotated[float, _SIZE.means("cylinder about z: its length")]


class _Sphere(Shape):
    radius: Annotated[float, _SIZE.means("sphere: its radius")]


class _Ellipsoid(Shape):
    semiaxes: Annotated[Vec3, _SIZES.means("ellipsoid: its semiaxes along x, y, z")]


SHAPES: Mapping[str, type[Shape]] = dict(zip(KINDS, (_Box, _Beam, _Cylinder, _Sphere, _Ellipsoid), strict=True))


def _read_shape(value: object) -> Shape:
    if not isinstance(value, Mapping) or "kind" not in value:
        raise rules.SceneError(rules.fault("body.shape", value, f"a table with kind = {_KINDS}"))
    return SHAPES[Shape._rules["kind"].read(value["kind"], "body.shape.kind")].read(value)


_SHAPE = rules.Rule("a table", _read_shape).means("a table in place of inertia: a homogeneous body of that shape")


class Body(rules.Section, path="body"):
    """A rigid body; `inertia` is M_c, symmetric, from 3 principal moments, a 3x3 matrix or a `shape` table."""

    _instead: ClassVar = {"shape": ("inertia", _SHAPE)}

    mass: Annotated[float, rules.numbers("mass")]
    inertia: Annotated[Matrix, Inertia().means(BY_NAME["inertia"].meaning)]
    r_oc_b: Annotated[Vec3, rules.numbers("r_oc_b")] = ZERO
    pivot: Annotated[bool, rules.FLAG.means("whether o is fixed in space")] = False

    if TYPE_CHECKING:

        def __init__(
            self, *, mass: float, inertia: Sequence[float] | Sequence[Sequence[float]] = ...,
            shape: Mapping[str, Any] = ..., r_oc_b: Sequence[float] = ZERO, pivot: bool = False,
        ) -> None: ...  # fmt: skip

    def _non_defaults(self) -> dict[str, object]:
        """Return the fields that differ from the defaults; a diagonal inertia is given by its three moments."""
        M = self.inertia
        moments = (M[0][0], M[1][1], M[2][2])
        return super()._non_defaults() | ({"inertia": moments} if evaluated(_inertia.diagonal, moments) == M else {})

    @property
    def M_c(self) -> Matrix:
        """Return the inertia about the centre of mass, kg m2."""
        return self.inertia

    @property
    def M_o(self) -> Matrix:
        """Return the inertia about the body's origin, kg m2."""
        return evaluated(_inertia.parallel_axis, self.inertia, self.mass, self.r_oc_b)

    @property
    def M(self) -> Matrix:
        """Return the inertia, kg m2, about o with a pivot, else about the centre of mass."""
        return self.M_o if self.pivot else self.M_c

    @property
    def given_shape(self) -> Any:
        """Return the table `shape` from which the inertia was computed, or None."""
        return self._given["inertia"][1]

    @property
    def axis_without_inertia(self) -> Vec3 | None:
        """Return the body axis about which `M` has no moment (a slender beam's own), if there is one."""
        return axis_without_moment(self.M)

    def _faults_together(self) -> Iterator[str]:
        """Compute M_c of a shape; yield a fault if it is not finite and positive."""
        good = vars(self)
        if isinstance(shape := good.get("inertia"), Shape):
            M = shape.inertia(good.get("mass", 1.0))
            good["inertia"] = M
            if not all(map(math.isfinite, rules.flattened(M))) or not evaluated(_inertia.trace, M) > 0.0:
                expected = f"a size whose inertia is a normal number ({_UNIT})"
                yield rules.fault("body.shape", self._given["inertia"][1], expected)

    def _contradictions(self) -> Iterator[str]:
        """Yield a fault if `M` is not finite or two of its moments are zero: a free point mass has no attitude."""
        if not all(map(math.isfinite, rules.flattened(self.M))):
            yield rules.fault("body.r_oc_b", self.r_oc_b, f"a distance whose inertia about o is finite ({_UNIT})")
        elif principal_axes(self.M)[0][1] <= _least_moment(self.M):
            about = "o, the pivot" if self.pivot else "the centre of mass"
            expected = f"at most one zero moment about {about} (a slender beam has one)"
            yield rules.fault("body.inertia", self._non_defaults()["inertia"], expected)
