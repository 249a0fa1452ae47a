"""The graph of formulas: each operation on numbers that are not known yet, once, whoever asks for it.

Kernels that run as plain Python take these numbers as they take others, so that the equations of motion become part of
the graph without being written again.
"""

import math
import operator
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import NamedTuple

from rbfmu_kernels.numerics.elementary import sincos

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
        self._at: dict[Operation, int] = {}

    def add(self, kind: str, *of: "Number", value: float | str = 0.0) -> "Symbol":
        """Return the number that an operation gives, the same each time."""
        operation = Operation(kind, tuple(self.index_of(x) for x in of), value)
        if operation not in self._at:
            if len(self.operations) >= MOST_OPERATIONS:
                raise TooLargeError(f"at most {MOST_OPERATIONS} operations")
            self._at[operation] = len(self.operations)
            self.operations.append(operation)
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

    def reached(self, numbers: Iterable["Number"]) -> list[int]:
        """Return the places of all operations that numbers come of, in order."""
        seen: set[int] = set()
        left = [x.index for x in numbers if isinstance(x, Symbol)]
        while left:
            i = left.pop()
            if i not in seen:
                seen.add(i)
                left += self.operations[i].of
        return sorted(seen)


class Symbol:
    """A number of a graph. What is added and multiplied is one as well, or a float where all is known."""

    __slots__ = ("graph", "index")
    __array_ufunc__ = None  # NumPy leaves operators to it

    def __init__(self, graph: Graph, index: int) -> None:
        self.graph, self.index = graph, index

    @property
    def operation(self) -> Operation:
        """What gives the number."""
        return self.graph.operations[self.index]

    @property
    def is_constant(self) -> bool:
        """Whether it stays as it is through a run."""
        return not any(self.graph.operations[i].kind in ("state", "input") for i in self.graph.reached([self]))

    def __repr__(self) -> str:
        kind, of, value = self.operation
        return f"{kind}({', '.join(repr(Symbol(self.graph, i)) for i in of)})" if of else f"{value}"

    def __eq__(self, other: object) -> bool:
        """Return whether it is that number for certain: a kernel must keep what may not be zero."""
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
        first, last = sorted((self, other), key=hash)
        return 2.0 * self if self == other else self.graph.add("add", first, last)

    __radd__ = __add__

    def __neg__(self) -> "Number":
        return -1.0 * self

    def __sub__(self, other: "Number") -> "Number":
        if self == other:
            return 0.0
        return self if other == 0.0 else self.graph.add("subtract", self, other)

    def __rsub__(self, other: "Number") -> "Number":
        return -self if other == 0.0 else self.graph.add("subtract", other, self)

    def __mul__(self, other: "Number") -> "Number":
        if not isinstance(other, Symbol):
            if other == 0.0:
                return 0.0
            kind, of, _ = self.operation
            if kind == "multiply" and (known := self.graph.operations[of[0]]).kind == "number" and other == -1.0:
                return -float(known.value) * Symbol(self.graph, of[1])
            return self if other == 1.0 else self.graph.add("multiply", other, self)
        return self.graph.add("multiply", *sorted((self, other), key=hash))

    __rmul__ = __mul__

    def __truediv__(self, other: "Number") -> "Number":
        if isinstance(other, Symbol):
            return 1.0 if self == other else self.graph.add("divide", self, other)
        return self if other == 1.0 else self.graph.add("divide", self, other)

    def __rtruediv__(self, other: "Number") -> "Number":
        return 0.0 if other == 0.0 else self.graph.add("divide", other, self)


Number = float | Symbol


# Functions of one number or two, of floats or of symbols


def _of(kind: str, known: Callable[..., float]) -> Callable[..., Number]:
    def function(*numbers: Number) -> Number:
        for x in numbers:
            if isinstance(x, Symbol):
                return x.graph.add(kind, *numbers)
        return known(*numbers)

    return function


square_root: Callable[[Number], Number] = _of("sqrt", math.sqrt)
sine: Callable[[Number], Number] = _of("sin", lambda x: sincos(x)[0])
cosine: Callable[[Number], Number] = _of("cos", lambda x: sincos(x)[1])
exponential: Callable[[Number], Number] = _of("exp", math.exp)
logarithm: Callable[[Number], Number] = _of("log", math.log)
side: Callable[[Number], Number] = _of("side", lambda x: math.copysign(1.0, x))


def arctangent(y: Number, x: Number) -> Number:
    """Return the angle of (x, y), rad."""
    return _of("atan2", lambda b, a, _: math.atan2(b, a))(y, x, x * x + y * y)


def select(condition: Number, a: Number, b: Number) -> Number:
    """Return a where the condition is 1, b where it is -1."""
    if not isinstance(condition, Symbol):
        return a if condition > 0.0 else b
    return a if a == b else condition.graph.add("select", condition, a, b)


def power(x: Number, exponent: Number) -> Number:
    """Return x to a power: products where it is a small whole number, roots where it is half of one."""
    if not isinstance(exponent, Symbol):
        if exponent == int(exponent) and abs(exponent) <= 64.0:
            whole = _whole_power(x, abs(int(exponent)))
            return whole if exponent >= 0.0 else 1.0 / whole
        if 2.0 * exponent == int(2.0 * exponent) and abs(exponent) <= 32.0:
            return power(square_root(x), 2.0 * exponent)
    if isinstance(exponent, Symbol) and not exponent.is_constant:
        return exponential(exponent * logarithm(x))
    return _of("power", math.pow)(x, exponent)


def _whole_power(x: Number, n: int) -> Number:
    if n < 2:
        return x if n else 1.0
    half = _whole_power(x, n // 2)
    return half * half * x if n % 2 else half * half


_KNOWN: dict[str, Callable[..., float]] = {
    "add": operator.add, "subtract": operator.sub, "multiply": operator.mul, "divide": operator.truediv,
    "sqrt": math.sqrt, "sin": math.sin, "cos": math.cos, "exp": math.exp, "log": math.log, "power": math.pow,
    "atan2": lambda y, x, _: math.atan2(y, x), "side": lambda x: math.copysign(1.0, x),
    "select": lambda side, a, b: a if side > 0.0 else b,
}  # fmt: skip


def numbers_of(graph: Graph, ends: Sequence[Number], leaves: Mapping[str, float]) -> list[float]:
    """Return what numbers come to; leaves: by their names. Raises ArithmeticError or ValueError where one is none."""
    found: dict[int, float] = {}
    for i in graph.reached(ends):
        kind, of, value = graph.operations[i]
        if kind == "number":
            found[i] = float(value)
        else:
            found[i] = leaves[str(value)] if kind in LEAVES else _KNOWN[kind](*(found[j] for j in of))
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
        if isinstance(slope, Symbol) or slope != 0.0:
            here = Symbol(graph, i)
            for of, partial in zip(here.operation.of, _partials(here), strict=True):
                slopes[of] = slopes.get(of, 0.0) + slope * partial
    return [slopes.get(x.index, 0.0) for x in variables]


def _partials(y: Symbol) -> Sequence[Number]:
    """Return the derivative of an operation by each of the numbers that it is of."""
    kind, of, _ = y.operation
    a, b, c = (*(Symbol(y.graph, i) for i in of), y, y, y)[:3]
    match kind:
        case "add":
            return 1.0, 1.0
        case "subtract":
            return 1.0, -1.0
        case "multiply":
            return b, a
        case "divide":
            return 1.0 / b, -(y / b)
        case "sqrt":
            return (0.5 / y,)
        case "sin":
            return (cosine(a),)
        case "cos":
            return (-sine(a),)
        case "exp":
            return (y,)
        case "log":
            return (1.0 / a,)
        case "atan2":  # the last, x^2 + y^2, is there for its series alone
            return b / c, -(a / c), 0.0
        case "power":
            return b * y / a, y * logarithm(a)
        case "select":
            return 0.0, select(a, 1.0, 0.0), select(a, 0.0, 1.0)
    return (0.0,) * len(of)
