"""The graph of formulas: operations on numbers that are not known yet; each operation occurs once.

Kernels that run as plain Python accept these numbers like floats, so that the equations of motion become part of the
graph without being written again.
"""

import math
import operator
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

from rbfmu_kernels.numerics import elementary

MOST_OPERATIONS = 20_000
"""The most operations of a scene's formulas: a hundred times what an attitude controller needs."""


class Operation(NamedTuple):
    """One operation: its kind, the indices of its arguments, and a number (of "number") or a name (of a leaf)."""

    kind: str
    of: tuple[int, ...] = ()
    value: float | str = 0.0


LEAVES = ("place", "state", "input")
"""The kinds of named numbers: a parameter in the buffer, constant in a run; a state; a port, which may change."""


class TooLargeError(ValueError):
    """Formulas need more operations than `MOST_OPERATIONS`."""


class Graph:
    """A list of operations, each after its arguments."""

    def __init__(self, numbers: Mapping[str, float] | None = None) -> None:
        """numbers: present values of places, by which kernels choose between forms that differ only in round-off."""
        self.numbers = numbers or {}
        self.operations: list[Operation] = []
        self.varies: list[bool] = []
        """For each operation whether it depends on states or inputs."""
        self.powers: dict[int, tuple[int, float]] = {}
        """Operations that are powers of a square root: the radicand and its exponent, for finite slopes at its zero."""
        self._at: dict[Operation, int] = {}

    def add(self, kind: str, *of: "Number", value: float | str = 0.0) -> "Symbol":
        """Return the result of an operation, which is added if the graph does not have it yet.

        Raises TooLargeError beyond `MOST_OPERATIONS`.
        """
        operation = Operation(kind, tuple(self.index_of(x) for x in of), value)
        if operation not in self._at:
            if len(self.operations) >= MOST_OPERATIONS:
                raise TooLargeError(f"at most {MOST_OPERATIONS} operations")
            self._at[operation] = len(self.operations)
            self.operations.append(operation)
            self.varies.append(kind in ("state", "input") or any(self.varies[i] for i in operation.of))
        return Symbol(self, self._at[operation])

    def index_of(self, x: "Number") -> int:
        """Return the index of the operation whose result is a number."""
        return x.index if isinstance(x, Symbol) else self.add("number", value=float(x)).index

    def symbol_of(self, x: "Number") -> "Symbol":
        """Return a number as a symbol of the graph."""
        return Symbol(self, self.index_of(x))

    def leaf(self, kind: str, name: str) -> "Symbol":
        """Return a number that has only a name; kind: one of LEAVES."""
        return self.add(kind, value=name)

    def reached(self, numbers: Iterable["Number"], last: str = "") -> list[int]:
        """Return the indices of all operations on which numbers depend, in order; last: a kind to search no further."""
        seen: set[int] = set()
        left = [x.index for x in numbers if isinstance(x, Symbol)]
        while left:
            i = left.pop()
            if i not in seen:
                seen.add(i)
                left += () if self.operations[i].kind == last else self.operations[i].of
        return sorted(seen)

    def reached_of(self, kinds: Collection[str], numbers: Iterable["Number"], last: str = "") -> list[Operation]:
        """Return the operations of some kinds on which numbers depend; last: see `reached`."""
        return [x for i in self.reached(numbers, last) if (x := self.operations[i]).kind in kinds]


class Symbol:
    """A number of a graph. Sums and products with it are symbols as well, or floats if their value is known."""

    __slots__ = ("graph", "index")

    def __init__(self, graph: Graph, index: int) -> None:
        self.graph, self.index = graph, index

    @property
    def operation(self) -> Operation:
        """The operation whose result is the number."""
        return self.graph.operations[self.index]

    @property
    def is_constant(self) -> bool:
        """Whether it is constant in a run."""
        return not self.graph.varies[self.index]

    @property
    def scaled(self) -> "tuple[Number, Symbol]":
        """A constant factor and the number that it multiplies: 1 and the symbol itself if it is no such product."""
        kind, of, _ = self.operation
        if kind != "multiply" or self.graph.varies[of[0]] or not self.graph.varies[of[1]]:
            return 1.0, self
        first = self.graph.operations[of[0]]
        constant = float(first.value) if first.kind == "number" else Symbol(self.graph, of[0])
        return constant, Symbol(self.graph, of[1])

    def __repr__(self) -> str:
        kind, of, value = self.operation
        return f"{kind}({', '.join(repr(Symbol(self.graph, i)) for i in of)})" if of else f"{value}"

    def __eq__(self, other: object) -> bool:
        """Return whether it is certainly the same number: never for a float, as kernels keep what may not be zero."""
        return isinstance(other, Symbol) and other.graph is self.graph and other.index == self.index

    def __hash__(self) -> int:
        return self.index

    def __lt__(self, other: "Number") -> bool:
        return self.known < (other.known if isinstance(other, Symbol) else other)

    def __gt__(self, other: "Number") -> bool:
        return self.known > (other.known if isinstance(other, Symbol) else other)

    @property
    def known(self) -> float:
        """The present value of a place. Raises TypeError for a number that is not known when the graph is made."""
        if self.operation.kind != "place":
            raise TypeError(f"{self!r} is not known yet")
        return self.graph.numbers[str(self.operation.value)]

    def __add__(self, other: "Number") -> "Number":
        if not isinstance(other, Symbol):
            return self if other == 0.0 else self.graph.add("add", self, other)
        (a, x), (b, y) = self.scaled, other.scaled
        if x == y:
            return (a + b) * x
        if b == -1.0 or a == -1.0:
            return self - y if b == -1.0 else other - x
        return self.graph.add("add", *sorted((self, other), key=hash))

    __radd__ = __add__

    def __neg__(self) -> "Number":
        return -1.0 * self

    def __sub__(self, other: "Number") -> "Number":
        if not isinstance(other, Symbol):
            return self if other == 0.0 else self.graph.add("subtract", self, other)
        (a, x), (b, y) = self.scaled, other.scaled
        if x == y:
            return (a - b) * x
        return self + y if b == -1.0 else self.graph.add("subtract", self, other)

    def __rsub__(self, other: "Number") -> "Number":
        return -self if other == 0.0 else self.graph.add("subtract", other, self)

    def __mul__(self, other: "Number") -> "Number":
        """Return the product; a x times b y with constants a and b becomes (a b) (x y), so that x y is made once."""
        if not isinstance(other, Symbol):
            if other == 0.0:
                return 0.0
            a, x = self.scaled
            if x != self:
                return (other * a) * x
            return self if other == 1.0 else self.graph.add("multiply", other, self)
        if other.is_constant and not self.is_constant:
            return other * self
        (a, x), (b, y) = self.scaled, other.scaled
        if self.is_constant and y != other:
            return (self * b) * y
        if x != self or y != other:
            return (a * b) * (x * y)
        of = (self, other) if self.is_constant else sorted((self, other), key=hash)
        return self.graph.add("multiply", *of)

    __rmul__ = __mul__

    def __truediv__(self, other: "Number") -> "Number":
        if isinstance(other, Symbol):
            return 1.0 if self == other else _quotient(self, other)
        return self if other == 1.0 else self.graph.add("divide", self, other)

    def __rtruediv__(self, other: "Number") -> "Number":
        return 0.0 if other == 0.0 else _quotient(other, self)


Number = float | Symbol


# Functions of numbers, which may be floats or symbols


KNOWN: Mapping[str, Callable[..., float]] = {
    "add": operator.add, "subtract": operator.sub, "multiply": operator.mul, "divide": operator.truediv,
    "sqrt": math.sqrt, "sin": lambda x: elementary.sincos(x)[0], "cos": lambda x: elementary.sincos(x)[1],
    "exp": math.exp, "log": math.log,
    "power": math.pow, "atan2": lambda y, x, _: math.atan2(y, x), "logistic": lambda x, _: elementary.logistic(x),
    "side": lambda x: math.copysign(1.0, x + 0.0), "select": lambda condition, a, b: a if condition > 0.0 else b,
}  # fmt: skip
"""Each operation as a function of floats."""


def _operation(kind: str) -> Callable[..., Number]:
    def function(*numbers: Number) -> Number:
        for x in numbers:
            if isinstance(x, Symbol):
                return x.graph.add(kind, *numbers)
        return KNOWN[kind](*numbers)

    return function


square_root, sine, cosine, exponential, logarithm, side = map(_operation, ("sqrt", "sin", "cos", "exp", "log", "side"))


def arctangent(y: Number, x: Number) -> Number:
    """Return the angle of (x, y), rad."""
    return _operation("atan2")(y, x, x * x + y * y)


def select(condition: Number, a: Number, b: Number) -> Number:
    """Return a where the condition is 1, b where it is -1."""
    if not isinstance(condition, Symbol):
        return KNOWN["select"](condition, a, b)
    return a if a == b else condition.graph.add("select", condition, a, b)


def _quotient(x: Number, y: Symbol) -> Number:
    """Return x / y; if y is 1 + e^u, by the logistic function, as e^u may overflow."""
    operations = y.graph.operations
    if y.operation.kind == "add":
        first, last = y.operation.of
        if operations[first].kind == "exp" and operations[last] == ("number", (), 1.0):
            u = Symbol(y.graph, operations[first].of[0])
            a, e = x.scaled if isinstance(x, Symbol) else (x, 1.0)
            return a * logistic(u) if e == Symbol(y.graph, first) else x * logistic(-u)
    return y.graph.add("divide", x, y)


def logistic(x: Number, _: object = None) -> Number:
    """Return 1 / (1 + e^-x); the second argument is not used, as -x takes its place."""
    return _operation("logistic")(x, -x)


def power(x: Number, exponent: Number) -> Number:
    """Return x^exponent: by products for a small integer, by a square root and products for half of an odd integer."""
    if not isinstance(exponent, Symbol):
        if exponent == int(exponent) and abs(exponent) <= 1024.0:
            whole = _whole_power(x, abs(int(exponent)))
            if isinstance(whole, Symbol) and isinstance(x, Symbol) and x.operation.kind == "sqrt" and whole != x:
                whole.graph.powers[whole.index] = x.operation.of[0], 0.5 * abs(exponent)
            return whole if exponent >= 0.0 else 1.0 / whole
        if 2.0 * exponent == int(2.0 * exponent) and abs(exponent) <= 32.0:
            return power(square_root(x), 2.0 * exponent)
    if isinstance(exponent, Symbol) and not exponent.is_constant:
        return exponential(exponent * logarithm(x))
    if isinstance(x, Symbol) and x.operation.kind == "sqrt":  # drop the root, which has no series at zero
        return power(Symbol(x.graph, x.operation.of[0]), 0.5 * exponent)
    return _operation("power")(x, exponent)


def _whole_power(x: Number, n: int) -> Number:
    if n < 2:
        return x if n else 1.0
    half = _whole_power(x, n // 2)
    return half * half * x if n % 2 else half * half


SYMBOLIC: Mapping[str, Callable[..., Number]] = {
    **KNOWN, "sqrt": square_root, "sin": sine, "cos": cosine, "exp": exponential, "log": logarithm, "power": power,
    "atan2": lambda y, x, _: arctangent(y, x), "logistic": logistic, "side": side, "select": select,
}  # fmt: skip
"""Each operation as a function of numbers, which may be symbols."""


def numbers_of(
    graph: Graph, ends: Sequence[Number], leaves: Mapping[str, Any], functions: Mapping[str, Callable[..., Any]] = KNOWN
) -> list[Any]:
    """Return the values of numbers; leaves: values by name. Raises ArithmeticError or ValueError if one has no value.

    functions: of each operation. With other functions, values need not be numbers: they may be other expressions or
    text.
    """
    found: dict[int, Any] = {}
    for i in graph.reached(ends):
        kind, of, value = graph.operations[i]
        if kind == "number":
            found[i] = float(value)
        else:
            found[i] = leaves[str(value)] if kind in LEAVES else functions[kind](*(found[j] for j in of))
    return [found[x.index] if isinstance(x, Symbol) else float(x) for x in ends]


def numbers_or_nan(graph: Graph, ends: Sequence[Number], leaves: Mapping[str, float]) -> list[float]:
    """Return the values of numbers, NaN for one that has none; what a number does not select need have none."""

    def value(kind: str, *of: float) -> float:
        try:
            return math.nan if kind in ("side", "select") and math.isnan(of[0]) else KNOWN[kind](*of)
        except (ArithmeticError, ValueError):
            return math.nan

    return numbers_of(graph, ends, leaves, {kind: lambda *of, kind=kind: value(kind, *of) for kind in KNOWN})


# Derivatives


def gradient(y: Number, variables: Sequence[Symbol]) -> list[Number]:
    """Return the derivatives of a number by variables, by one sweep from the number to its leaves (reverse mode).

    Griewank & Walther, Evaluating Derivatives, 2nd ed. 2008, ch. 3. Sides count as constant.
    """
    if not isinstance(y, Symbol):
        return [0.0] * len(variables)
    graph = y.graph
    slopes: dict[int, Number] = {y.index: 1.0}
    for i in reversed(graph.reached([y])):
        slope = slopes.get(i, 0.0)
        if slope != 0.0:
            for of, partial in _partials(Symbol(graph, i)):
                slopes[of] = slopes.get(of, 0.0) + _times(slope, partial)
    return [slopes.get(x.index, 0.0) for x in variables]


def changes_of(numbers: Sequence[Number], of_leaves: Mapping[Symbol, Number]) -> list[Number]:
    """Return the changes of numbers by given changes of leaves, by one sweep from leaves to numbers (forward mode)."""
    changes = {leaf.index: change for leaf, change in of_leaves.items()}
    for x in (x for x in numbers if isinstance(x, Symbol)):
        for i in x.graph.reached([x]):
            if i not in changes:
                kind, of, _ = x.graph.operations[i]
                if kind == "select":
                    changes[i] = _selected(Symbol(x.graph, of[0]), changes[of[1]], changes[of[2]])
                else:
                    changes[i] = sum((changes[j] * slope for j, slope in _partials(Symbol(x.graph, i))), 0.0)
    return [changes[x.index] if isinstance(x, Symbol) else 0.0 for x in numbers]


def _times(slope: Number, partial: Number) -> Number:
    """Return a product: 0 where a factor is 0, as its place is not selected, even if the other has no value there."""
    product, zero = slope * partial, ("number", (), 0.0)
    for x in (slope, partial):
        if isinstance(x, Symbol) and x.scaled[1].operation.kind == "select":
            condition, a, b = (Symbol(x.graph, i) for i in x.scaled[1].operation.of)
            if zero in (a.operation, b.operation):
                product = _selected(condition, *((product, 0.0) if b.operation == zero else (0.0, product)))
    return product


def _selected(condition: Number, a: Number, b: Number) -> Number:
    """Return `select`, where a constant factor beside a zero stays a factor, as in a product with 1 or 0."""
    kept = [x for x in (a, b) if isinstance(x, Symbol)]
    if len(kept) == 1 and 0.0 in (a, b):
        factor, x = kept[0].scaled
        return factor * (select(condition, x, 0.0) if b == 0.0 else select(condition, 0.0, x))
    return select(condition, a, b)


_PARTIALS: Mapping[str, Callable[[Symbol, Symbol, Symbol, Symbol], Sequence[Number]]] = {
    "add": lambda y, a, b, c: (1.0, 1.0),
    "subtract": lambda y, a, b, c: (1.0, -1.0),
    "multiply": lambda y, a, b, c: (b, a),
    "divide": lambda y, a, b, c: (1.0 / b, -(y / b)),
    "sqrt": lambda y, a, b, c: (0.5 / y,),
    "sin": lambda y, a, b, c: (cosine(a),),
    "cos": lambda y, a, b, c: (-sine(a),),
    "exp": lambda y, a, b, c: (y,),
    "logistic": lambda y, a, b, c: (y * (1.0 - y), 0.0),  # the last argument, -x, is only for where series end
    "log": lambda y, a, b, c: (1.0 / a,),
    "atan2": lambda y, a, b, c: (b / c, -(a / c), 0.0),  # the last argument, x^2 + y^2, is only for series
    "power": lambda y, a, b, c: (b * power(a, b - 1.0), y * logarithm(a)),
    "select": lambda y, a, b, c: (0.0, select(a, 1.0, 0.0), select(a, 0.0, 1.0)),
}
"""The derivatives of an operation y by each of its arguments; those of a side are zero."""


def _partials(y: Symbol) -> list[tuple[int, Number]]:
    """Return the indices of the numbers on which an operation depends directly, and the derivatives by these."""
    kind, of, _ = y.operation
    if y.index in y.graph.powers:
        under, exponent = y.graph.powers[y.index]
        return [(under, exponent * power(Symbol(y.graph, under), exponent - 1.0))]
    a, b, c = (*(Symbol(y.graph, i) for i in of), y, y, y)[:3]
    slopes = _PARTIALS[kind](y, a, b, c) if kind in _PARTIALS else (0.0,) * len(of)
    return [*zip(of, slopes, strict=True)]
