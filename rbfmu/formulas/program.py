"""What a graph comes to as Taylor series: which sums of products each order takes, and in which order they can be had.

With y(t) = sum of y[k] t^k, every operation gives its k-th coefficient by a recurrence from those of what it is of, and
all that is not linear is a sum over j of A[j] B[k - j] (Hairer, Norsett & Wanner, Solving Ordinary Differential
Equations I, 2nd ed. 1993, I.8; Griewank & Walther, Evaluating Derivatives, 2nd ed. 2008, ch. 13). A function f with
f' = g x', such as exp with g = f, gives k f[k] as the sum of g[k - j] times the slopes j x[j].
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

from rbfmu.formulas.graph import LEAVES, Graph, Number, Operation, Symbol, cosine, sine

WIDTH = 4
"""How many sums are made at once."""


class Factor(NamedTuple):
    """One of the two factors of products that are summed: an operation's coefficients, or their slopes j x[j]."""

    of: int
    slope: bool = False


class Slot(NamedTuple):
    """A sum over j of first[j] last[k - j]."""

    first: Factor
    last: Factor


class Program(NamedTuple):
    """Operations as series.

    constants: those that stay as they are over a series, in order; levels: the others, so that each level needs sums
    that the level before has completed; slots: the sums of an operation, by its place; sides: of what changes, on which
    side of zero it is, which stays over a series, that ends where it changes; touching: roots, and
    angles of points (x, y): where that which a root is of, or x^2 + y^2, comes down to zero, the series would go on
    with the wrong sign, and ends; wanted: what is asked for, by name; rates: the derivatives of the states, by name;
    beside: numbers whose series are kept for others to read.
    """

    graph: Graph
    constants: tuple[int, ...]
    levels: tuple[tuple[int, ...], ...]
    slots: Mapping[int, tuple[Slot, ...]]
    sides: tuple[int, ...]
    touching: tuple[int, ...]
    rates: Mapping[str, Number]
    wanted: Mapping[str, Number]
    beside: tuple[Number, ...] = ()

    @property
    def varying(self) -> list[int]:
        """Return the operations that change over a series."""
        return [i for level in self.levels for i in level]

    @property
    def states(self) -> list[str]:
        """Return the names of the numbers that are integrated."""
        return list(self.rates)


def program(
    graph: Graph,
    rates: Mapping[str, Number],
    wanted: Mapping[str, Number],
    watched: Iterable[Number] = (),
    beside: Sequence[Number] = (),
) -> Program:
    """Return the program of states' rates, with what else is wanted, of which values serve and no series are made.

    watched: sides that no rate rests on, of which series are made as well; beside: see `Program`.
    """
    reached = with_pairs(graph, [*rates.values(), *watched, *beside])
    changing = _changing(graph, reached)
    level: dict[int, int] = {}
    slots = {}
    for i in reached:
        if i in changing:
            kind, of, _ = graph.operations[i]
            slots[i] = _slots(graph.operations[i], i, changing, graph)
            before = max((level[j] for j in of if j in changing), default=0)
            level[i] = before + (2 if kind == "atan2" else 1 if slots[i] else 0)
    levels = [tuple(i for i in reached if level.get(i) == n) for n in range(max(level.values(), default=0) + 1)]
    sides = tuple(i for i in reached if graph.operations[i].kind == "side" and graph.operations[i].of[0] in changing)
    roots = [i for i in reached if i in changing and graph.operations[i].kind in ("sqrt", "atan2")]
    touching = tuple(i for i in roots if graph.operations[i].of[-1] in changing)
    constants = (i for i in reached if i not in {*changing, *sides} and graph.operations[i].kind != "number")
    used = {i: s for i, s in slots.items() if s}
    return Program(graph, tuple(constants), tuple(levels), used, sides, touching, rates, wanted, tuple(beside))


def with_pairs(graph: Graph, numbers: Iterable[Number]) -> list[int]:
    """Return the operations that numbers come of, with the cosine of each sine: each is the other's derivative."""
    ends = [*numbers]
    for i in graph.reached(ends):
        operation = graph.operations[i]
        if operation.kind in ("sin", "cos"):
            angle = Symbol(graph, operation.of[0])
            ends += [sine(angle), cosine(angle)]
    return graph.reached(ends)


def _changing(graph: Graph, reached: Sequence[int]) -> set[int]:
    """Return the operations that change over a series: what comes of states and inputs, but for what is frozen."""
    found: set[int] = set()
    for i in reached:
        kind, of, _ = graph.operations[i]
        if kind in ("state", "input") or (kind != "side" and any(j in found for j in of)):
            found.add(i)
    return found


def _slots(operation: Operation, i: int, changing: set[int], graph: Graph) -> tuple[Slot, ...]:
    """Return the sums that an operation's k-th coefficient takes.

    Where it is itself one of the factors, its k-th coefficient counts as zero, for which the recurrence is solved.
    """
    kind, of, _ = operation
    if kind in LEAVES:
        return ()
    a, b = (*map(Factor, of), Factor(i), Factor(i))[:2]
    own, slope = Factor(i), Factor(of[0], slope=True)
    match kind:
        case "multiply":
            return (Slot(a, b),) if {*of} <= changing else ()
        case "divide":
            return (Slot(b, own),) if of[1] in changing else ()
        case "sqrt":
            return (Slot(own, own),)
        case "exp":
            return (Slot(slope, own),)
        case "log":
            return (Slot(Factor(i, slope=True), a),)
        case "sin" | "cos":
            other = graph.add("cos" if kind == "sin" else "sin", Symbol(graph, of[0])).index
            return (Slot(slope, Factor(other)),)
        case "power":
            return (Slot(slope, own), Slot(a, Factor(i, slope=True)))
        case "atan2":  # x y' - y x', then its quotient by x^2 + y^2
            products = (Slot(b, Factor(of[0], slope=True)), Slot(a, Factor(of[1], slope=True)))
            return (*products, Slot(Factor(of[2]), Factor(i, slope=True)))
    return ()


# Where its numbers stand


class Layout(NamedTuple):
    """Where what stands: leaves by name in the buffer, and in a row of the work space states and factors.

    leaves: the place of each parameter and each state; of each input that of its value, its rate and its second rate.
    targets: where what is wanted goes; sides: where they are kept; states: the column of each in a row, after which
    that which has sides stands; row: its length.
    """

    leaves: Mapping[str, tuple[int, ...]]
    targets: Mapping[str, int]
    sides: Mapping[int, int]
    states: Mapping[str, int]
    constants: Mapping[int, int]
    groups: tuple[tuple[tuple[int, int], ...], ...]
    head: int
    beside: int
    row: int

    @property
    def start(self) -> int:
        """Return where the first row begins in the work space, after the constants."""
        return -(-len(self.constants) // WIDTH) * WIDTH


def layout_of(program: Program, more: int = 0) -> Layout:
    """Return the places of a program's numbers in a row; those of the buffer are still missing.

    more: columns at its end for series that templates make. Each group of slots, (operation, which of its), is of one
    level.
    """
    groups: list[tuple[tuple[int, int], ...]] = []
    for n in range(len(program.levels)):
        here = [(i, s) for i, slots in program.slots.items() for s in range(len(slots)) if level_of(program, i, s) == n]
        groups += [tuple(here[j : j + WIDTH]) for j in range(0, len(here), WIDTH)]
    states = {name: i for i, name in enumerate(program.states)}
    head = -(-(len(states) + len(program.sides) + 2 * len(program.touching)) // WIDTH) * WIDTH
    constants = {i: n for n, i in enumerate(program.constants)}
    beside = head + 2 * WIDTH * len(groups)
    row = beside + -(-len(program.beside) // WIDTH) * WIDTH + more
    return Layout({}, {}, {}, states, constants, tuple(groups), head, beside, row)


def level_of(program: Program, i: int, slot: int) -> int:
    """Return the level that makes a sum: of an angle's three the first two make the third's numerator."""
    level = next(n for n, level in enumerate(program.levels) if i in level)
    return level - 1 if program.graph.operations[i].kind == "atan2" and slot < 2 else level
