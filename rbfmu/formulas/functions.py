"""What formulas can use: constants, functions and tables, and the kinds of their arguments."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from rbfmu.formulas import graph
from rbfmu_kernels.compile.tiered import interpreted
from rbfmu_kernels.rotations import vec3

Array = Any
"""A scalar (a float or a graph's Symbol), or a NumPy array of scalars with one axis or two."""
CONSTANTS = {"pi": math.pi, "deg": math.pi / 180.0, "rpm": math.pi / 30.0}
"""Numbers that every formula can read."""


class Condition(NamedTuple):
    """A condition: 1 if it is true, -1 if it is false."""

    side: graph.Number


class Function(NamedTuple):
    """A function of formulas: the names of its arguments, its meaning, and a function that makes its result."""

    takes: str
    meaning: str
    make: Callable[..., Array]


class Table(NamedTuple):
    """A function of one number x, by cubic polynomials between knots: constant outside.

    rows: for each interval the coefficients of powers 0 to 3 of the distance of x from the knot where it begins.
    """

    knots: tuple[float, ...]
    rows: tuple[tuple[float, float, float, float], ...]

    @classmethod
    def through(cls, x: Sequence[float], y: Sequence[float], cubic: bool) -> "Table":
        """Return the table through points (x, y), by straight lines, or as the natural cubic spline."""
        step = np.diff(x)
        slope, bend = np.diff(y) / step, np.zeros(len(x))
        if cubic and len(x) > 2:  # second derivatives, zero at the ends (de Boor, A Practical Guide to Splines, IV)
            n = len(x) - 2
            matrix = np.diag(2.0 * (step[:-1] + step[1:])) + np.diag(step[1:-1], 1) + np.diag(step[1:-1], -1)
            bend[1 : n + 1] = np.linalg.solve(matrix, 6.0 * np.diff(slope))
        first = slope - step * (2.0 * bend[:-1] + bend[1:]) / 6.0
        rows = np.stack([y[:-1], first, 0.5 * bend[:-1], np.diff(bend) / (6.0 * step)], axis=1).tolist()
        flat = [(float(y[0]), 0.0, 0.0, 0.0), *map(tuple, rows), (float(y[-1]), 0.0, 0.0, 0.0)]
        return cls(tuple(map(float, x)), tuple(flat))

    def at(self, x: graph.Number) -> graph.Number:
        """Return the value at x; the row is chosen by the signs of x less each knot."""
        total: graph.Number = 0.0
        sides = [graph.side(x - knot) for knot in self.knots]
        beyond = x - self._choose(sides, (self.knots[0], *self.knots))
        for power in (3, 2, 1, 0):
            total = total * beyond + self._choose(sides, [row[power] for row in self.rows])
        return total

    @staticmethod
    def _choose(sides: Sequence[graph.Number], values: Sequence[float]) -> graph.Number:
        found: graph.Number = values[0]
        for side, value in zip(sides, values[1:], strict=True):
            found = graph.select(side, value, found)
        return found


NO_NUMBER = (Condition, Table)
"""Values in formulas that are no scalar, vector or matrix."""


class MismatchError(ValueError):
    """An error that says what was expected instead of the arguments."""


def _require(x: Array, fits: bool, expected: str) -> Any:
    if not fits:
        raise MismatchError(expected)
    return x


def as_scalar(x: Array) -> graph.Number:
    """Return a scalar unchanged. Raises MismatchError for anything else, as the functions below do."""
    return _require(x, not isinstance(x, np.ndarray | Condition | Table), "a scalar")  # type: ignore[no-any-return]


def as_number(x: Array) -> Array:
    """Return a scalar, a vector or a matrix unchanged."""
    return _require(x, not isinstance(x, NO_NUMBER), "a number")


def as_vector(x: Array) -> Array:
    """Return a vector of 3 numbers unchanged."""
    return _require(x, shape_of(x) == (3,), "a vector of 3 numbers")


def as_condition(x: Array) -> Condition:
    """Return a condition unchanged."""
    return _require(x, isinstance(x, Condition), "a condition, such as x > 0")  # type: ignore[no-any-return]


def _table(table: Array, x: Array) -> graph.Number:
    known: Table = _require(table, isinstance(table, Table), "the name of a table, then a scalar")
    return known.at(as_scalar(x))


def _of_scalars(function: Callable[..., graph.Number]) -> Callable[..., Array]:
    return lambda *numbers: function(*map(as_scalar, numbers))


def _dot(a: Array, b: Array) -> graph.Number:
    if len(shape_of(a)) != 1 or shape_of(a) != shape_of(b):
        raise MismatchError("two vectors of one length")
    return 0.0 + a @ b  # type: ignore[no-any-return]  # not -0.0


def _length(v: Array) -> graph.Number:
    return graph.square_root(_dot(_require(v, len(shape_of(v)) == 1, "a vector"), v))


def cross(a: Array, b: Array) -> Array:
    """Return the vector product a x b."""
    return np.array(interpreted(vec3.cross)(as_vector(a), as_vector(b)), object)


def legs(x: graph.Number) -> tuple[graph.Number, graph.Number]:
    """Return a cosine x and its sine >= 0: the square root of 1 - x^2, as a product, which is accurate near |x| = 1."""
    return x, graph.square_root((1.0 - x) * (1.0 + x))


def inverse_cosines(legs: Callable[[graph.Number], tuple[graph.Number, graph.Number]]) -> dict[str, Function]:
    """Return `asin` and `acos`; legs: a function that returns a cosine and its sine, as `legs` does."""
    return {
        "asin": Function("x", "angle in [-pi/2, pi/2], rad", _of_scalars(lambda x: graph.arctangent(*legs(x)))),
        "acos": Function("x", "angle in [0, pi], rad", _of_scalars(lambda x: graph.arctangent(*legs(x)[::-1]))),
    }


def _angle(y: graph.Number, x: graph.Number) -> graph.Number:
    """Return the angle of (x, y) in (-pi, pi], rad.

    The series of an angle is smooth where the angle jumps from pi to -pi. For negative x, the angle is therefore that
    of the opposite point plus or minus half a turn, with the sign of y: at its sign change the series ends.
    """
    half_turn = graph.select(graph.side(y), math.pi, -math.pi)
    return graph.select(graph.side(x), graph.arctangent(y, x), graph.arctangent(-y, -x) + half_turn)


def _minimum(a: graph.Number, b: graph.Number) -> graph.Number:
    return graph.select(graph.side(b - a), a, b)


def _maximum(a: graph.Number, b: graph.Number) -> graph.Number:
    return graph.select(graph.side(a - b), a, b)


def clipped(x: graph.Number, low: graph.Number, high: graph.Number) -> graph.Number:
    """Return x, but no smaller than low, and no larger than high."""
    return _minimum(_maximum(x, low), high)


def _where(condition: Array, a: Array, b: Array) -> Array:
    if shape_of(a) != shape_of(b):
        raise MismatchError("two values of one shape")
    side = as_condition(condition).side
    return np.frompyfunc(lambda a, b: graph.select(side, a, b), 2, 1)(as_number(a), as_number(b))


FUNCTIONS: Mapping[str, Function] = {
    "dot": Function("a, b", "scalar product of two vectors", _dot),
    "cross": Function("a, b", "vector product of two vectors", cross),
    "norm": Function("v", "length of a vector", _length),
    "sin": Function("x", "sine of an angle in rad", _of_scalars(graph.sine)),
    "cos": Function("x", "cosine of an angle in rad", _of_scalars(graph.cosine)),
    "tan": Function("x", "tangent of an angle in rad", _of_scalars(lambda x: graph.sine(x) / graph.cosine(x))),
    **inverse_cosines(legs),
    "atan2": Function("y, x", "angle of (x, y) in (-pi, pi], rad", _of_scalars(_angle)),
    "exp": Function("x", "exponential", _of_scalars(graph.exponential)),
    "tanh": Function("x", "hyperbolic tangent", _of_scalars(lambda x: 1.0 - 2.0 * graph.logistic(-2.0 * x))),
    "log": Function("x", "natural logarithm", _of_scalars(graph.logarithm)),
    "sqrt": Function("x", "square root", _of_scalars(graph.square_root)),
    "abs": Function("x", "absolute value", _of_scalars(lambda x: graph.select(graph.side(x), x, -x))),
    "min": Function("a, b", "the smaller of two scalars", _of_scalars(_minimum)),
    "max": Function("a, b", "the larger of two scalars", _of_scalars(_maximum)),
    "clip": Function("x, low, high", "x, but no smaller than low, and no larger than high", _of_scalars(clipped)),
    "table": Function("name, x", "a table of the scene at x", _table),
    "where": Function("condition, a, b", "a where the condition holds, else b", _where),
}
"""The functions of formulas; `to_a` and `to_b` are added for a scene."""


def shape_of(x: Array) -> tuple[int, ...]:
    """Return the shape of a scalar (), a vector (n,) or a matrix (n, m)."""
    return np.shape(x) if isinstance(x, np.ndarray) else ()
