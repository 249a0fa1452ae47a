"""The graph of formulas: each operation on numbers that are not known yet, once, whoever asks for it.

Kernels that run as plain Python take these numbers as they take others, so that the equations of motion become part of
the graph without being written again.
"""

import math
import operator
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

from rbfmu_kernels.numerics import elementary

MOST_OPERATIONS = 20_000
"""What a scene's formulas may come to: a hundred times what an attitude controller needs."""


class Operation(NamedTuple):
    """One operation: its kind, the places of what it is of, and a number (of "number") or a name (of a leaf)."""

    kind: str
    of: tuple[int, ...] = ()
    value: float | str = 0.0


LEAVES = ("place", "state", "input")
"""What operations begin with: a parameter, constant through a run; what is integrated; a port, which may change."""


class TooLargeError(ValueError):
    """Formulas come to more operations than `MOST_OPERATIONS`."""


class Graph:
    """Operations in an order in which each comes after those that it is of."""

    def __init__(self, numbers: Mapping[str, float] | None = None) -> None:
        """numbers: what places hold now, by which kernels choose between forms that are equal but for round-off."""
        self.numbers = numbers or {}
        self.operations: list[Operation] = []
        self.varies: list[bool] = []
        """Of each operation whether it comes of states or inputs."""
        self.powers: dict[int, tuple[int, float]] = {}
        """Powers of roots, by which number to which power they are: finite slopes where that is zero."""
        self._at: dict[Operation, int] = {}

    def add(self, kind: str, *of: "Number", value: float | str = 0.0) -> "Symbol":
        """Return the number that an operation gives, the same each time."""
        operation = Operation(kind, tuple(self.index_of(x) for x in of), value)
        if operation not in self._at:
            if len(self.operations) >= MOST_OPERATIONS:
                raise TooLargeError(f"at most {MOST_OPERATIONS} operations")
            self._at[operation] = len(self.operations)
            self.operations.append(operation)
            self.varies.append(kind in ("state", "input") or any(self.varies[i] for i in operation.of))
        return Symbol(self, self._at[operation])

    def index_of(self, x: "Number") -> int:
        """Return the place of the operation that gives a number."""
        return x.index if isinstance(x, Symbol) else self.add("number", value=float(x)).index

    def symbol_of(self, x: "Number") -> "Symbol":
        """Return a number as one of the graph."""
        return Symbol(self, self.index_of(x))

    def leaf(self, kind: str, name: str) -> "Symbol":
        """Return a number that is known by its name alone; kind: one of LEAVES."""
        return self.add(kind, value=name)

    def reached(self, numbers: Iterable["Number"], last: str = "") -> list[int]:
        """Return the places of all operations that numbers come of, in order; last: a kind to look no further than."""
        seen: set[int] = set()
        left = [x.index for x in numbers if isinstance(x, Symbol)]
        while left:
            i = left.pop()
            if i not in seen:
                seen.add(i)
                left += () if self.operations[i].kind == last else self.operations[i].of
        return sorted(seen)

    def reached_of(self, kinds: Collection[str], numbers: Iterable["Number"], last: str = "") -> list[Operation]:
        """Return those operations of some kinds that numbers come of; last: see `reached`."""
        return [x for i in self.reached(numbers, last) if (x := self.operations[i]).kind in kinds]


class Symbol:
    """A number of a graph. What is added and multiplied is one as well, or a float where all is known."""

    __slots__ = ("graph", "index")

    def __init__(self, graph: Graph, index: int) -> None:
        self.graph, self.index = graph, index

    @property
    def operation(self) -> Operation:
        """What gives the number."""
        return self.graph.operations[self.index]

    @property
    def is_constant(self) -> bool:
        """Whether it stays as it is through a run."""
        return not self.graph.varies[self.index]

    @property
    def scaled(self) -> "tuple[Number, Symbol]":
        """A constant and a number whose product it is: 1 and itself where it was not made so."""
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
        """Return whether it is that number for certain: no float is one, as a kernel must keep what may not be zero."""
        return isinstance(other, Symbol) and other.graph is self.graph and other.index == self.index

    def __hash__(self) -> int:
        return self.index

    def __lt__(self, other: "Number") -> bool:
        return self.known < (other.known if isinstance(other, Symbol) else other)

    def __gt__(self, other: "Number") -> bool:
        return self.known > (other.known if isinstance(other, Symbol) else other)

    @property
    def known(self) -> float:
        """What a place holds now. Raises TypeError for what is not known when the graph is made."""
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
        """Return the product: a x times b y, with constants a and b, is a b times x y, which is made once for all."""
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


# Functions of one number or two, of floats or of symbols


KNOWN: Mapping[str, Callable[..., float]] = {
    "add": operator.add, "subtract": operator.sub, "multiply": operator.mul, "divide": operator.truediv,
    "sqrt": math.sqrt, "sin": lambda x: elementary.sincos(x)[0], "cos": lambda x: elementary.sincos(x)[1],
    "exp": math.exp, "log": math.log,
    "power": math.pow, "atan2": lambda y, x, _: math.atan2(y, x), "logistic": lambda x, _: elementary.logistic(x),
    "side": lambda x: math.copysign(1.0, x + 0.0), "select": lambda condition, a, b: a if condition > 0.0 else b,
}  # fmt: skip
"""What each operation is of floats."""


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
    """Return x / y: by the logistic function where y is 1 + e^u, which may be too large for a number."""
    operations = y.graph.operations
    if y.operation.kind == "add":
        first, last = y.operation.of
        if operations[first].kind == "exp" and operations[last] == ("number", (), 1.0):
            u = Symbol(y.graph, operations[first].of[0])
            a, e = x.scaled if isinstance(x, Symbol) else (x, 1.0)
            return a * logistic(u) if e == Symbol(y.graph, first) else x * logistic(-u)
    return y.graph.add("divide", x, y)


def logistic(x: Number, _: object = None) -> Number:
    """Return 1 / (1 + e^-x)."""
    return _operation("logistic")(x, -x)


def power(x: Number, exponent: Number) -> Number:
    """Return x to a power: products where it is a small whole number, roots where it is half of one."""
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
    if isinstance(x, Symbol) and x.operation.kind == "sqrt":  # which would have no series beside zero either
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
"""What each operation is of numbers that may be symbols."""


def numbers_of(
    graph: Graph, ends: Sequence[Number], leaves: Mapping[str, Any], functions: Mapping[str, Callable[..., Any]] = KNOWN
) -> list[Any]:
    """Return what numbers come to; leaves: by their names. Raises ArithmeticError or ValueError where one is none.

    functions: the operations, by which what leaves are may be no numbers, but another's expressions or text.
    """
    found: dict[int, Any] = {}
    for i in graph.reached(ends):
        kind, of, value = graph.operations[i]
        if kind == "number":
            found[i] = float(value)
        else:
            found[i] = leaves[str(value)] if kind in LEAVES else functions[kind](*(found[j] for j in of))
    return [found[x.index] if isinstance(x, Symbol) else float(x) for x in ends]


# Derivatives


def gradient(y: Number, variables: Sequence[Symbol]) -> list[Number]:
    """Return the derivatives of a number, by one sweep from it to what it comes of (reverse accumulation).

    Griewank & Walther, Evaluating Derivatives, 2nd ed. 2008, ch. 3. What is frozen counts as constant.
    """
    if not isinstance(y, Symbol):
        return [0.0] * len(variables)
    graph = y.graph
    slopes: dict[int, Number] = {y.index: 1.0}
    for i in reversed(graph.reached([y])):
        slope = slopes.get(i, 0.0)
        if slope != 0.0:
            for of, partial in _partials(Symbol(graph, i)):
                slopes[of] = slopes.get(of, 0.0) + slope * partial
    return [slopes.get(x.index, 0.0) for x in variables]


def changes_of(numbers: Sequence[Number], of_leaves: Mapping[Symbol, Number]) -> list[Number]:
    """Return how much numbers change at once as leaves do, by one sweep from these to them (forward accumulation)."""
    changes = {leaf.index: change for leaf, change in of_leaves.items()}
    for x in (x for x in numbers if isinstance(x, Symbol)):
        for i in x.graph.reached([x]):
            if i not in changes:
                changes[i] = sum((changes[j] * slope for j, slope in _partials(Symbol(x.graph, i))), 0.0)
    return [changes[x.index] if isinstance(x, Symbol) else 0.0 for x in numbers]


_PARTIALS: Mapping[str, Callable[[Symbol, Symbol, Symbol, Symbol], Sequence[Number]]] = {
    "add": lambda y, a, b, c: (1.0, 1.0),
    "subtract": lambda y, a, b, c: (1.0, -1.0),
    "multiply": lambda y, a, b, c: (b, a),
    "divide": lambda y, a, b, c: (1.0 / b, -(y / b)),
    "sqrt": lambda y, a, b, c: (0.5 / y,),
    "sin": lambda y, a, b, c: (cosine(a),),
    "cos": lambda y, a, b, c: (-sine(a),),
    "exp": lambda y, a, b, c: (y,),
    "logistic": lambda y, a, b, c: (y * (1.0 - y), 0.0),  # the last, -x, is there for where series end
    "log": lambda y, a, b, c: (1.0 / a,),
    "atan2": lambda y, a, b, c: (b / c, -(a / c), 0.0),  # the last, x^2 + y^2, is there for its series alone
    "power": lambda y, a, b, c: (b * power(a, b - 1.0), y * logarithm(a)),
    "select": lambda y, a, b, c: (0.0, select(a, 1.0, 0.0), select(a, 0.0, 1.0)),
}
"""The derivatives of an operation y by each of the numbers that it is of; those of a side are zero."""


def _partials(y: Symbol) -> list[tuple[int, Number]]:
    """Return what an operation changes with, and the derivatives by that."""
    kind, of, _ = y.operation
    if y.index in y.graph.powers:
        under, exponent = y.graph.powers[y.index]
        return [(under, exponent * power(Symbol(y.graph, under), exponent - 1.0))]
    a, b, c = (*(Symbol(y.graph, i) for i in of), y, y, y)[:3]
    slopes = _PARTIALS[kind](y, a, b, c) if kind in _PARTIALS else (0.0,) * len(of)
    return [*zip(of, slopes, strict=True)]
