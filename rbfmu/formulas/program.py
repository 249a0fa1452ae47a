"""What a graph comes to as Taylor series: which sums of products each order takes, and in which order they can be had.

With y(t) = sum of y[k] t^k, every operation gives its k-th coefficient by a recurrence from those of what it is of, and
all that is not linear is a sum over j of A[j] B[k - j] (Hairer, Norsett & Wanner, Solving Ordinary Differential
Equations I, 2nd ed. 1993, I.8; Griewank & Walther, Evaluating Derivatives, 2nd ed. 2008, ch. 13). A function f with
f' = g x', such as exp with g = f, gives k f[k] as the sum of g[k - j] times the slopes j x[j].
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

from rbfmu.formulas.graph import Graph, Number, Operation, Symbol, cosine, sine
from rbfmu_kernels.integrators import formula_operations

WIDTH = 4
"""How many sums are made at once."""


class Recurrence(NamedTuple):
    """An operation's k-th coefficient, k > 0. sums: those that it takes, by their factors; text: what it makes of them.

    Factors: y for the operation itself, a, b, c for what it is of, z for what `pair_of` gives; with ',
    the slopes j x[j]. Where y is one of the factors, its k-th coefficient counts as zero, for which the recurrence is
    solved. In the text: 0, 1, 2 for the sums; a: that coefficient of a; b: the value of a constant exponent; x: the
    first coefficient of what is divided by, which `divisor` names.
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
"""Those of operations that are not linear; a product is, and a quotient, where all but one factor, or the divisor, is
constant."""


PAIRS = ("sin", "cos", "logistic")
"""Operations whose slope is that of what they are of, times another operation: see `pair_of`."""
RISING = ("exp", "logistic")
"""Operations that may be nothing until what they are of has risen; a logistic function is one until its second number,
the negative of the first, has."""
ROOTS = tuple(formula_operations.KINDS[kind] for kind in formula_operations.ROOTS)
TOUCHING = (*ROOTS, "atan2")
"""Operations that have no series where what they are of is zero: see `under`."""


class Factor(NamedTuple):
    """One of the two factors of products that are summed: an operation's coefficients, or their slopes j x[j]."""

    of: int
    slope: bool = False


class Sum(NamedTuple):
    """A sum over j of first[j] last[k - j], number n of an operation's; level: the first one at which it can be had."""

    of: int
    n: int
    level: int
    first: Factor
    last: Factor

    @property
    def name(self) -> str:
        """Return its variable."""
        return f"p{self.of}_{self.n}" if self.n else f"p{self.of}"


class Program:
    """Operations as series, and where their numbers stand in a row of the work space: states, sides, factors.

    constants: those that stay as they are over a series, in order; levels: the others, so that each level needs sums
    that the level before has completed; level_of: of each of them; sums: of all; sides: of what changes, on which side
    of zero it is, which stays over a series, that ends where it changes; touching: ROOTS, and angles of points (x, y):
    where that which a root is of, or x^2 + y^2, comes down to zero, the series would go on with the wrong sign, and
    ends; rising: what exponentials are of, which may be nothing before; groups: sums of one level that are made at
    once. head: where their factors begin in a row; beside_at: where the numbers beside; row: its length, in which
    others may take room; start: where the first row begins, after the constants.
    """

    def __init__(
        self, graph: Graph, rates: Mapping[str, Number], wanted: Mapping[str, Number],
        watched: Iterable[Number] = (), beside: Sequence[Number] = (),
    ) -> None:  # fmt: skip
        """Take states' rates by name, and what else is wanted, of which values serve and no series are made.

        watched: sides that no rate rests on, of which series are made as well; beside: numbers whose series are kept
        for others to read.
        """
        self.graph, self.rates, self.wanted, self.beside = graph, rates, wanted, tuple(beside)
        reached = with_pairs(graph, [*rates.values(), *watched, *beside])
        self.level_of: dict[int, int] = {}
        self.sums: list[Sum] = []
        for i in reached:
            self._take(i)
        count = max(self.level_of.values(), default=0) + 1
        self.levels = [tuple(i for i in reached if self.level_of.get(i) == n) for n in range(count)]
        kinds = {i: graph.operations[i] for i in reached}
        self.sides = tuple(i for i, x in kinds.items() if x.kind == "side" and x.of[0] in self.level_of)
        self.touching = tuple(i for i, x in kinds.items() if x.kind in TOUCHING and under(x) in self.level_of)
        rising = (x.of for i, x in kinds.items() if x.kind in RISING and i in self.level_of)
        self.rising = tuple(dict.fromkeys(i for of in rising for i in of))
        known = {*self.level_of, *self.sides}
        self.constants = tuple(i for i, x in kinds.items() if i not in known and x.kind != "number")
        self.groups: list[list[Sum]] = []
        for n in range(len(self.levels)):
            here = [one for one in self.sums if one.level == n]
            self.groups += [here[j : j + WIDTH] for j in range(0, len(here), WIDTH)]
        self.start = _whole(len(self.constants))
        self.head = _whole(len(rates) + len(self.watched))
        self.beside_at = self.head + 2 * WIDTH * len(self.groups)
        self.row = self.beside_at + _whole(len(self.beside))

    def _take(self, i: int) -> None:
        """Find level and sums of what changes over a series: what comes of states and inputs, but no side."""
        kind, of, _ = self.graph.operations[i]
        before = [self.level_of[j] for j in of if j in self.level_of]
        if kind == "side" or not (before or kind in ("state", "input")):
            return
        level, sums = max(before, default=0), self._sums_of(i)
        steps = 2 if kind == "atan2" else 1 if sums else 0  # of an angle's three sums the first two make the third
        self.level_of[i] = level + steps
        last = [level + steps - (kind == "atan2" and n < 2) for n in range(len(sums))]
        self.sums += [Sum(i, n, at, *factors) for n, (at, factors) in enumerate(zip(last, sums, strict=True))]

    def _sums_of(self, i: int) -> list[list[Factor]]:
        kind, of, _ = self.graph.operations[i]
        is_linear = kind == "multiply" and not self.level_of.keys() >= {*of}
        if kind not in RECURRENCES or is_linear or (kind == "divide" and of[1] not in self.level_of):
            return []
        pairs = (factors.split() for factors in RECURRENCES[kind].sums)
        return [[Factor(self.operand(i, one[0]), one.endswith("'")) for one in pair] for pair in pairs]

    def operand(self, i: int, letter: str) -> int:
        """Return the operation that a letter of an operation's recurrence stands for."""
        if letter == "z":
            return pair_of(self.graph, i).index
        return i if letter == "y" else self.graph.operations[i].of["abc".index(letter)]

    @property
    def varying(self) -> list[int]:
        """Return the operations that change over a series."""
        return [i for level in self.levels for i in level]

    @property
    def watched(self) -> list[Symbol]:
        """Return what has sides, what may touch zero and its roots, and what rises: they stand after the states."""
        known = self.graph.operations
        found = [*(known[i].of[0] for i in self.sides), *(under(known[i]) for i in self.touching), *self.touching]
        return [Symbol(self.graph, i) for i in (*found, *self.rising)]


def under(operation: Operation) -> int:
    """Return what one of TOUCHING has no series beside the zero of: of an angle it is x^2 + y^2."""
    return operation.of[2 if operation.kind == "atan2" else 0]


def _whole(count: int) -> int:
    """Return the places of numbers in whole vectors."""
    return -(-count // WIDTH) * WIDTH


def pair_of(graph: Graph, i: int) -> Symbol:
    """Return by what one of PAIRS changes with what it is of, but for the sign of a cosine."""
    kind, of, _ = graph.operations[i]
    if kind == "logistic":
        y = Symbol(graph, i)
        return graph.symbol_of(y * (1.0 - y))
    angle = Symbol(graph, of[0])
    return graph.symbol_of(cosine(angle) if kind == "sin" else sine(angle))


def with_pairs(graph: Graph, numbers: Iterable[Number]) -> list[int]:
    """Return the operations that numbers come of, with the pair of each of PAIRS."""
    ends = [*numbers]
    for i in graph.reached(ends):
        if graph.operations[i].kind in PAIRS:
            ends += [Symbol(graph, i), pair_of(graph, i)]
    return graph.reached(ends)
