"""A graph as Taylor series: which sums of products each order needs, and in which sequence they can be computed.

With y(t) = sum of y[k] t^k, the k-th coefficient of an operation follows by a recurrence from those of its arguments.
All nonlinear operations need sums over j of A[j] B[k - j] (Hairer, Norsett & Wanner, Solving Ordinary Differential
Equations I, 2nd ed. 1993, I.8; Griewank & Walther, Evaluating Derivatives, 2nd ed. 2008, ch. 13). For a function f(x)
with the derivative g(x), such as exp with g = f, k f[k] is the sum of g[k - j] times the slopes j x[j].
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

from rbfmu.formulas.graph import Graph, Number, Operation, Symbol, cosine, sine
from rbfmu_kernels.integrators import formula_operations

WIDTH = 4
"""The number of sums that are computed at once."""


class Recurrence(NamedTuple):
    """An operation's k-th coefficient, k > 0. sums: the two factors of each sum of products; text: the formula.

    Factors: y is the operation itself; a, b, c its arguments; z the result of `pair_of`; with ', the slopes j x[j]. If
    y is a factor, its k-th coefficient counts as zero in the sum, as the recurrence is solved for it. In the text: 0,
    1, 2: the sums; a: the k-th coefficient of a; b: the value of a constant exponent; inverse: 1 / k; x: the first
    coefficient (k = 0) of the divisor, which is the operation that `divisor` names.
    """

    sums: tuple[str, ...]
    text: str
    divisor: str = ""


RECURRENCES: Mapping[str, Recurrence] = {
    "multiply": Recurrence(("a b",), "{0}"),
    "divide": Recurrence(("b y",), "({a} - {0}) / {x}", "b"),
    "sqrt": Recurrence(("y y",), "choose({x} != 0.0, 0.5 * ({a} - {0}) / {x}, 0.0)", "y"),
    "exp": Recurrence(("a' y",), "{0} * inverse"),
    "logistic": Recurrence(("a' z",), "{0} * inverse"),
    "sin": Recurrence(("a' z",), "{0} * inverse"),
    "cos": Recurrence(("a' z",), "-{0} * inverse"),
    "log": Recurrence(("y' a",), "({a} - {0} * inverse) / {x}", "a"),
    "power": Recurrence(("a' y", "a y'"), "choose({x} != 0.0, ({b} * {0} - {1}) / {x} * inverse, 0.0)", "a"),
    # x y' - y x', then its quotient by x^2 + y^2
    "atan2": Recurrence(("b a'", "a b'", "c y'"), "({0} - {1} - {2}) / {x} * inverse", "c"),
}
"""The recurrences of nonlinear operations. A product with a constant factor is linear, and a quotient with a constant
divisor."""


PAIRS = ("sin", "cos", "logistic")
"""Operations whose slope is the slope of their argument times another operation: see `pair_of`."""
RISING = ("exp", "logistic")
"""Operations that may be negligible until their argument has risen. A logistic function may also be 1 until its second
argument, the negative of the first, has risen."""
ROOTS = tuple(formula_operations.KINDS[kind] for kind in formula_operations.ROOTS)
"""Square roots and powers."""
TOUCHING = (*ROOTS, "atan2")
"""Operations that have no series at a zero of their argument: see `zero_argument`."""


class Factor(NamedTuple):
    """A factor of the products of a sum: an operation's coefficients x[j], or its slopes j x[j]."""

    of: int
    slope: bool = False


class Sum(NamedTuple):
    """Sum number n of operation `of`: over j of first[j] last[k - j]; it is computed before operations of its level."""

    of: int
    n: int
    level: int
    first: Factor
    last: Factor

    @property
    def name(self) -> str:
        """Return the name of its variable in generated text."""
        return f"p{self.of}_{self.n}" if self.n else f"p{self.of}"


class Program:
    """Operations as series, and the places of their numbers in a row of the work space: states, sides, factors.

    constants: operations that are constant over a series, in order. levels: the other operations; k-th coefficients of
    a level need only sums of factors from lower levels. level_of: the level of each. sums: all sums. sides: the signs
    of changing numbers; a sign is constant over a series, which ends where it changes. touching: ROOTS and angles of
    points (x, y). A series ends where the argument of a square root or power, or x^2 + y^2, touches zero: beyond it, it
    would have the wrong sign. rising: the arguments of exponentials, which may be negligible before they rise. groups:
    sums of one level that are computed at once. head: where their factors begin in a row; beside_at: where the numbers
    of `beside` begin; row: the length of a row, which others may increase; start: where the first row begins, after the
    constants.
    """

    def __init__(
        self, graph: Graph, rates: Mapping[str, Number], wanted: Mapping[str, Number],
        watched: Iterable[Number] = (), beside: Sequence[Number] = (),
    ) -> None:  # fmt: skip
        """rates: of the states, by name; wanted: other numbers by name, of which only values are needed, no series.

        watched: sides that need series although no rate depends on them; beside: numbers whose series are stored for
        others to read.
        """
        self.graph, self.rates, self.wanted, self.beside = graph, rates, wanted, tuple(beside)
        reached = with_pairs(graph, [*rates.values(), *watched, *beside])
        self.level_of: dict[int, int] = {}
        self.sums: list[Sum] = []
        for i in reached:
            self._add_operation(i)
        count = max(self.level_of.values(), default=0) + 1
        self.levels = [tuple(i for i in reached if self.level_of.get(i) == n) for n in range(count)]
        kinds = {i: graph.operations[i] for i in reached}
        self.sides = tuple(i for i, x in kinds.items() if x.kind == "side" and x.of[0] in self.level_of)
        self.touching = tuple(i for i, x in kinds.items() if x.kind in TOUCHING and zero_argument(x) in self.level_of)
        rising = (x.of for i, x in kinds.items() if x.kind in RISING and i in self.level_of)
        self.rising = tuple(dict.fromkeys(i for of in rising for i in of))
        known = {*self.level_of, *self.sides}
        self.constants = tuple(i for i, x in kinds.items() if i not in known and x.kind != "number")
        self.groups: list[list[Sum]] = []
        for n in range(len(self.levels)):
            here = [sum_ for sum_ in self.sums if sum_.level == n]
            self.groups += [here[j : j + WIDTH] for j in range(0, len(here), WIDTH)]
        self.start = whole_vectors(len(self.constants))
        self.head = whole_vectors(len(rates) + len(self.watched))
        self.beside_at = self.head + 2 * WIDTH * len(self.groups)
        self.row = self.beside_at + whole_vectors(len(self.beside))

    def _add_operation(self, i: int) -> None:
        """Find the level and the sums of an operation that depends on states or inputs and is not a side."""
        kind, of, _ = self.graph.operations[i]
        before = [self.level_of[j] for j in of if j in self.level_of]
        if kind == "side" or not (before or kind in ("state", "input")):
            return
        level, sums = max(before, default=0), self._sums_of(i)
        steps = 2 if kind == "atan2" else 1 if sums else 0  # an angle's third sum needs the first two
        self.level_of[i] = level + steps
        last = [level + steps - (kind == "atan2" and n < 2) for n in range(len(sums))]
        self.sums += [Sum(i, n, at, *factors) for n, (at, factors) in enumerate(zip(last, sums, strict=True))]

    def _sums_of(self, i: int) -> list[list[Factor]]:
        kind, of, _ = self.graph.operations[i]
        is_linear = kind == "multiply" and not self.level_of.keys() >= {*of}
        if kind not in RECURRENCES or is_linear or (kind == "divide" and of[1] not in self.level_of):
            return []
        pairs = (factors.split() for factors in RECURRENCES[kind].sums)
        return [[Factor(self.operand(i, factor[0]), factor.endswith("'")) for factor in pair] for pair in pairs]

    def operand(self, i: int, letter: str) -> int:
        """Return the operation that a letter means in operation i's recurrence."""
        if letter == "z":
            return pair_of(self.graph, i).index
        return i if letter == "y" else self.graph.operations[i].of["abc".index(letter)]

    @property
    def varying(self) -> list[int]:
        """Return the operations that change over a series."""
        return [i for level in self.levels for i in level]

    @property
    def watched(self) -> list[Symbol]:
        """Return the numbers after the states in a row: arguments of sides, those of touching, touching, rising."""
        known = self.graph.operations
        sides, zeros = (known[i].of[0] for i in self.sides), (zero_argument(known[i]) for i in self.touching)
        return [Symbol(self.graph, i) for i in (*sides, *zeros, *self.touching, *self.rising)]


def zero_argument(operation: Operation) -> int:
    """Return the argument of one of TOUCHING at whose zero it has no series; for an angle this is x^2 + y^2."""
    return operation.of[2 if operation.kind == "atan2" else 0]


def whole_vectors(count: int) -> int:
    """Return a count rounded up to whole vectors."""
    return -(-count // WIDTH) * WIDTH


def pair_of(graph: Graph, i: int) -> Symbol:
    """Return the derivative of one of PAIRS by its argument, but for a cosine without the sign."""
    kind, of, _ = graph.operations[i]
    if kind == "logistic":
        y = Symbol(graph, i)
        return graph.symbol_of(y * (1.0 - y))
    angle = Symbol(graph, of[0])
    return graph.symbol_of(cosine(angle) if kind == "sin" else sine(angle))


def with_pairs(graph: Graph, numbers: Iterable[Number]) -> list[int]:
    """Return the operations on which numbers depend, in order, with the pair of each of PAIRS."""
    ends = [*numbers]
    for i in graph.reached(ends):
        if graph.operations[i].kind in PAIRS:
            ends += [Symbol(graph, i), pair_of(graph, i)]
    return graph.reached(ends)
