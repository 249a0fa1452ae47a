"""A program written out as kernels, which a reader can print: `rbfmu plan SCENE --code`.

`constants` sets what stays as it is over a series, `first` the values at its begin, `further` the k-th coefficients,
`values` what is wanted of the states now, and `feedthrough` how that changes at once with inputs.
Four sums of products are made at once, so that what the sums of a level need stands side by side: a row of the work
space has the k-th coefficients of the states and of all factors of the next orders' sums.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any

from rbfmu.formulas.graph import Graph, Number, Symbol, numbers_of
from rbfmu.formulas.program import WIDTH, Factor, Layout, Program, level_of

MOST_SUMS = 12
"""How many groups of sums a loop makes beside one another: more find no register, of 16, and go through memory."""
SERIES = ("constants", "first", "further")
KERNELS = (*SERIES, "values", "feedthrough")
KERNELS_OVER = ("values", "feedthrough", "loads")
_NEEDED = """import math

from rbfmu_kernels.compile.wide import choose
from rbfmu_kernels.numerics.elementary import atan2, exponential, logarithm, sincos
"""
HEAD = '''\
"""Formulas of a scene as kernels, written by rbfmu.formulas.source; places are those of the model's buffer."""

import math

from rbfmu_kernels.buffer import NOT_FINITE
from rbfmu_kernels.compile.decorator import kernel
from rbfmu_kernels.compile.simd import add_lanes, lanes, lanes_at, multiply_lanes, numbers
from rbfmu_kernels.compile.wide import choose
from rbfmu_kernels.models import model_named
from rbfmu_kernels.models.formula_models import make_formulas, make_over
from rbfmu_kernels.numerics.elementary import atan2, exponential, logarithm, sincos
from rbfmu_kernels.types import Buffer

'''


Changes = Mapping[int, Mapping[int, Number]]


def source_of(program: Program, layout: Layout, changes: Changes) -> str:
    """Return the text of a module with KERNELS; changes: see `_Writer.feedthrough`."""
    writer = _Writer(program, layout)
    series = map(writer.function, SERIES)
    return HEAD + "\n\n".join(["", *series, writer.values(), writer.feedthrough(changes)])[1:]


def source_over(program: Program, layout: Layout, changes: Changes, loads: Mapping[str, Number]) -> str:
    """Return the text of a module with KERNELS_OVER; loads: those that are set at the start, by the block's number."""
    writer = _Writer(program, layout)
    return HEAD + "\n\n".join(["", writer.values(), writer.feedthrough(changes), writer.values("loads", loads)])[1:]


def module_of(
    source: str, constant: str, layout: tuple[Mapping[str, slice], int], places: Mapping[str, object], base: str = ""
) -> str:
    """Return the text of a module that makes the model besides, its attribute MODEL.

    base: the closed form that it is over, as `models.model_named` takes it, if any.
    """
    kernels = KERNELS_OVER if base else KERNELS
    maker = f"make_over({constant!r}, model_named({base!r})," if base else f"make_formulas({constant!r},"
    blocks, size = layout
    return f"""{source}

inf = math.inf
BLOCKS = {blocks!r}
PLACES = {places!r}
KERNELS = {{{", ".join(f"{name!r}: {name}" for name in kernels)}}}
MODEL = {maker} (BLOCKS, {size}), KERNELS, PLACES)
"""


def source_of_lanes(program: Program, layout: Layout) -> str:
    """Return the text of a module with the kernels of series for several bodies side by side; layout: `wide_layout`."""
    return HEAD + "\n\n".join(["", *map(_WideWriter(program, layout).function, SERIES)])[1:]


def wide_layout(program: Program, layout: Layout) -> Layout:
    """Return a layout in whose rows each factor stands once: a lane is a body, and no sums of one go side by side."""
    return layout._replace(groups=(), row=layout.head + len(_factors_of(program)))


def _factors_of(program: Program) -> list[Factor]:
    return [*dict.fromkeys(factor for slots in program.slots.values() for slot in slots for factor in slot)]


def _kernel(name: str, takes: str, gives: str, lines: Iterable[str]) -> str:
    body = "".join(f"    {line}\n" for line in lines)
    return f"@kernel(inline=False)\ndef {name}({takes}) -> {gives}:\n{body}"


class _Writer:
    def __init__(self, program: Program, layout: Layout) -> None:
        self._program, self._layout, self._graph = program, layout, program.graph
        self._head = layout.head
        self._level_of = {i: n for n, level in enumerate(program.levels) for i in level}

    def function(self, name: str) -> str:
        """Return the text of one kernel."""
        takes, lines = "z: Buffer, w: int", []
        match name:
            case "constants":
                lines = [*self._read_sides(self._layout.constants)]
                lines += [f"{self._name(i)} = {self._value(i)}" for i in self._layout.constants]
                lines += [f"z[w + {at}] = {self._name(i)}" for i, at in self._layout.constants.items()]
            case "first":
                lines = [*self._read_constants(), f"r = w + {self._layout.start}"]
                lines += [f"{self._name(i)} = {self._value(i)}" for i in self._program.varying]
                lines += [f"z[r + {at}] = {text}" for at, text in self._first_factors()]
                lines += [f"z[r + {at}] = {self._name(i)}" for at, i in self._watched()]
                lines += [f"z[r + {at}] = {self._text(x)}" for at, x in self._beside()]
                lines += self._put_rates("")
            case "further":
                takes += ", k: int"
                lines = [*self._read_constants(), f"r = w + {self._layout.start} + k * {self._layout.row}"]
                lines += ["inverse = 1.0 / k", *self._orders(), *self._put_rates(" / (k + 1)")]
        return _kernel(name, takes, "None", lines or ["pass"])

    def values(self, name: str = "values", wanted: Mapping[str, Number] | None = None) -> str:
        """Return the text of the kernel that sets what is wanted, from the states in the buffer."""
        wanted = self._program.wanted if wanted is None else wanted
        lines = self._now(wanted.values())
        lines += [f"z[{self._layout.targets[element]}] = {self._text(x)}" for element, x in wanted.items()]
        sums = " + ".join(["0.0", *(f"0.0 * z[{self._layout.targets[element]}]" for element in wanted)])
        return _kernel(name, "z: Buffer", "int", [*lines, f"return 0 if {sums} == 0.0 else NOT_FINITE"])

    def feedthrough(self, changes: Changes) -> str:
        """Return the text of the kernel that, given by how much inputs change, sets by how much outputs do at once.

        changes: by the place of an output's number, its derivatives by the place of the input's number.
        """
        lines = self._now(x for slopes in changes.values() for x in slopes.values())
        for at, slopes in changes.items():
            terms = (f"{self._text(x)} * change[{place}]" for place, x in slopes.items())
            lines.append(f"change[{at}] = {' + '.join(terms) or 0.0}")
        return _kernel("feedthrough", "z: Buffer, change: Buffer", "int", [*lines, "return 0"])

    def _text(self, x: Number) -> str:
        return self._name(x.index) if isinstance(x, Symbol) else repr(float(x))

    def _now(self, numbers: Iterable[Number]) -> list[str]:
        """Return the lines that make what numbers come of from the states in the buffer."""
        reached = (i for i in self._graph.reached(numbers) if self._graph.operations[i].kind != "number")
        return [f"{self._name(i)} = {self._value(i, in_row=False)}" for i in reached]

    def _read_sides(self, readers: Iterable[int]) -> Iterator[str]:
        used = {j for i in readers for j in self._graph.operations[i].of}
        yield from (f"{self._name(i)} = {self._value(i)}" for i in self._program.sides if i in used)

    def _read_constants(self) -> list[str]:
        used = {j for i in self._program.varying for j in self._graph.operations[i].of}
        shown = (*self._program.rates.values(), *self._program.beside)
        used |= {x.index for x in shown if isinstance(x, Symbol)}
        known = [f"{self._name(i)} = z[w + {at}]" for i, at in self._layout.constants.items() if i in used]
        return [*self._read_sides(self._program.varying), *known]

    def _name(self, i: int) -> str:
        """Return the variable of an operation's value or k-th coefficient; a number is itself."""
        operation = self._graph.operations[i]
        return repr(operation.value) if operation.kind == "number" else f"v{i}"

    def _value(self, i: int, in_row: bool = True) -> str:
        """Return the text of an operation's value; in_row: whether states stand in a row of the work space."""
        kind, of, value = self._graph.operations[i]
        a, b, c = (*map(self._name, of), "", "", "")[:3]
        match kind:
            case "side" if in_row and i in self._layout.sides:
                return f"z[{self._layout.sides[i]}]"
            case "state" if in_row:
                return f"z[r + {self._layout.states[str(value)]}]"
            case "place" | "input" | "state":
                return f"z[{self._layout.leaves[str(value)][0]}]"
        return VALUES[kind].format(a, b, c)

    # Coefficients beyond the first

    def _orders(self) -> Iterator[str]:
        for n, level in enumerate(self._program.levels):
            groups = [g for g, group in enumerate(self._layout.groups) if self._level_of_group(group) == n]
            yield from self._sums(groups)
            for i in level:
                yield f"{self._name(i)} = {self._coefficient(i)}"
        yield from (f"z[r + {at}] = {text}" for at, text in self._factors_left)
        yield from (f"z[r + {at}] = {self._name(i)}" for at, i in self._watched())
        for at, x in self._beside():
            yield f"z[r + {at}] = {self._part(x.index) if isinstance(x, Symbol) else '0.0'}"

    def _beside(self) -> Iterator[tuple[int, Number]]:
        yield from enumerate(self._program.beside, self._layout.beside)

    def _watched(self) -> Iterator[tuple[int, int]]:
        """Yield the columns in a row of what has sides, of what may touch zero and its roots, and these."""
        watched = [self._graph.operations[i].of[0] for i in self._program.sides]
        watched += [self._graph.operations[i].of[-1] for i in self._program.touching]
        yield from enumerate((*watched, *self._program.touching), len(self._layout.states))

    def _level_of_group(self, group: tuple[tuple[int, int], ...]) -> int:
        return level_of(self._program, *group[0])

    def _sums(self, groups: list[int]) -> Iterator[str]:
        """Yield the lines that store the factors which are known by now, and sum the products of groups."""
        if not groups:
            return
        for g in groups:
            for at, factor in self._places(g):
                known = self._level_of.get(factor.of, -1) < self._level_of_group(self._layout.groups[g])
                yield f"z[r + {at}] = {self._factor(factor) if known else '0.0'}"
        for n in range(0, len(groups), MOST_SUMS):
            yield from self._loop(groups[n : n + MOST_SUMS])
        for g in groups:
            names = [self._sum(*slot) for slot in self._layout.groups[g]]
            yield f"{', '.join((names + ['_'] * WIDTH)[:WIDTH])} = numbers(s{g})"

    def _loop(self, groups: list[int]) -> Iterator[str]:
        """Yield the lines that sum the products of groups."""
        for g in groups:
            yield f"s{g} = lanes(0.0, 0.0, 0.0, 0.0)"
        yield "for j in range(k + 1):"
        yield f"    a, b = r - (k - j) * {self._layout.row}, r - j * {self._layout.row}"
        for g in groups:
            at = self._head + 2 * WIDTH * g
            product = f"multiply_lanes(lanes_at(z, a + {at}), lanes_at(z, b + {at + WIDTH}))"
            yield f"    s{g} = add_lanes(s{g}, {product})"

    def _sum(self, i: int, slot: int) -> str:
        return f"p{i}" if slot == 0 else f"p{i}_{slot}"

    def _places(self, g: int) -> Iterator[tuple[int, Factor]]:
        """Yield the places in a row of a group's factors."""
        at = self._head + 2 * WIDTH * g
        for lane, (i, s) in enumerate(self._layout.groups[g]):
            slot = self._program.slots[i][s]
            yield at + lane, slot.first
            yield at + WIDTH + lane, slot.last

    def _factors(self) -> Iterator[tuple[int, Factor]]:
        """Yield the places in a row of all factors."""
        return (place for g in range(len(self._layout.groups)) for place in self._places(g))

    def _first_factors(self) -> Iterator[tuple[int, str]]:
        for at, factor in self._factors():
            yield at, "0.0" if factor.slope else self._name(factor.of)

    @property
    def _factors_left(self) -> Iterator[tuple[int, str]]:
        """Yield the factors that were not known when their group's products were summed."""
        for g, group in enumerate(self._layout.groups):
            for at, factor in self._places(g):
                if self._level_of.get(factor.of, -1) >= self._level_of_group(group):
                    yield at, self._factor(factor)

    def _factor(self, factor: Factor) -> str:
        """Return the k-th coefficient of a factor, k > 0."""
        if factor.of not in self._level_of:
            return "0.0"
        return f"k * {self._name(factor.of)}" if factor.slope else self._name(factor.of)

    def _coefficient(self, i: int) -> str:
        """Return the text of an operation's k-th coefficient, k > 0."""
        kind, of, value = self._graph.operations[i]
        a, b, c = (*map(self._part, of), "", "", "")[:3]
        if kind == "state":
            return f"z[r + {self._layout.states[str(value)]}]"
        if kind == "input":
            _, rate, rate_2 = self._layout.leaves[str(value)]
            return f"z[{rate}] if k == 1 else 0.5 * z[{rate_2}] if k == 2 else 0.0"
        if kind == "select":
            return f"choose({self._name(of[0])} > 0.0, {b}, {c})"
        if i not in self._program.slots:
            return self._linear(kind, of, a, b)
        text, divisor = COEFFICIENTS[kind]
        first = "" if divisor is None else self._first((*of, i)[divisor])
        return text.format(*(self._sum(i, s) for s in range(3)), a=a, x=first, exponent=self._name(of[-1]))

    def _linear(self, kind: str, of: tuple[int, ...], a: str, b: str) -> str:
        """Return the text of a sum, a difference, or a product or quotient with a constant."""
        if kind == "multiply":
            return f"{self._name(of[0])} * {self._name(of[1])}"
        if kind == "divide":
            return f"{a} / {self._name(of[1])}"
        if kind == "add":
            return f"{a} + {b}" if a != "0.0" and b != "0.0" else a if b == "0.0" else b
        return f"{a} - {b}" if a != "0.0" and b != "0.0" else a if b == "0.0" else f"-{b}"

    def _part(self, i: int) -> str:
        """Return the k-th coefficient of an operand: none of a constant."""
        return self._name(i) if i in self._level_of else "0.0"

    def _first(self, i: int) -> str:
        """Return the text of an operation's first coefficient: where it is a factor, it stands in the first row."""
        at = next(at for at, factor in self._factors() if factor == Factor(i))  # of what is solved for
        return f"z[w + {self._layout.start + at}]"

    def _put_rates(self, divided: str) -> Iterator[str]:
        """Yield the lines that set the states' next coefficients."""
        for name, rate in self._program.rates.items():
            at = self._layout.states[name] + self._layout.row
            if isinstance(rate, Symbol) and rate.index in self._level_of:
                yield f"z[r + {at}] = {self._name(rate.index)}{divided}"
            else:
                known = self._name(rate.index) if isinstance(rate, Symbol) else repr(float(rate))
                yield f"z[r + {at}] = {'0.0' if divided else known}"


class _WideWriter(_Writer):
    """Writes the same sums for numbers of several bodies, with the same bits: each on its own, of factors that are kept
    once. What is not yet known of an order counts as zero, as it does where sums of one body go side by side."""

    def _factors(self) -> Iterator[tuple[int, Factor]]:
        yield from enumerate(_factors_of(self._program), self._head)

    def _orders(self) -> Iterator[str]:
        yield from (f"z[r + {at}] = 0.0" for at, _ in self._factors())
        slots = [(i, s) for i, own in self._program.slots.items() for s in range(len(own))]
        for n, level in enumerate(self._program.levels):
            yield from self._sums_of([slot for slot in slots if level_of(self._program, *slot) == n])
            yield from (f"{self._name(i)} = {self._coefficient(i)}" for i in level)
            yield from (f"z[r + {at}] = {self._factor(one)}" for at, one in self._factors() if one.of in level)
        yield from (f"z[r + {at}] = {self._name(i)}" for at, i in self._watched())

    def _sums_of(self, slots: list[tuple[int, int]]) -> Iterator[str]:
        if not slots:
            return
        places = {factor: at for at, factor in self._factors()}
        yield from (f"{self._sum(*slot)} = 0.0" for slot in slots)
        yield "for j in range(k + 1):"
        yield f"    a, b = r - (k - j) * {self._layout.row}, r - j * {self._layout.row}"
        for i, s in slots:
            first, last = self._program.slots[i][s]
            yield f"    {self._sum(i, s)} += z[a + {places[first]}] * z[b + {places[last]}]"


VALUES = {
    "add": "{} + {}",
    "subtract": "{} - {}",
    "multiply": "{} * {}",
    "divide": "{} / {}",
    "sqrt": "math.sqrt({})",
    "sin": "sincos({})[0]",
    "cos": "sincos({})[1]",
    "exp": "exponential({})",
    "log": "logarithm({})",
    "atan2": "atan2({}, {})",
    "power": "exponential({1} * logarithm({0}))",
    "side": "math.copysign(1.0, {})",
    "select": "choose({0} > 0.0, {1}, {2})",
}


COEFFICIENTS: Mapping[str, tuple[str, int | None]] = {
    "multiply": ("{0}", None),
    "divide": ("({a} - {0}) / {x}", 1),
    "sqrt": ("choose({x} != 0.0, 0.5 * ({a} - {0}) / {x}, 0.0)", -1),
    "exp": ("{0} * inverse", None),
    "sin": ("{0} * inverse", None),
    "cos": ("-{0} * inverse", None),
    "log": ("({a} - {0} * inverse) / {x}", 0),
    "power": ("({exponent} * {0} - {1}) / {x} * inverse", 0),
    "atan2": ("({0} - {1} - {2}) / {x} * inverse", 2),
}
"""The k-th coefficients, k > 0, of operations by their sums; a: that of what they are of; x: a first coefficient, and
of which of these it is, where -1 stands for the operation itself."""


def lines_of(
    graph: Graph, ends: Sequence[Number], leaves: Mapping[str, str], texts: Mapping[str, str]
) -> tuple[list[str], list[Any]]:
    """Return assignments in another's language, and what numbers come to by them; texts: of each operation."""
    lines: list[str] = []

    def line(text: str) -> Callable[..., str]:
        def add(*of: object) -> str:
            lines.append(f"v{len(lines)} = {text.format(*of)}")
            return f"v{len(lines) - 1}"

        return add

    found = numbers_of(graph, ends, leaves, {kind: line(text) for kind, text in texts.items()})
    return lines, found


def function_of(name: str, graph: Graph, ends: Sequence[Number], leaves: Mapping[str, str]) -> str:
    """Return the text of a function of t and y, as solvers of others take it, that puts numbers into f.

    leaves: the texts of parameters, states and inputs, by name.
    """
    lines, found = lines_of(graph, ends, leaves, VALUES)
    lines += [f"f[{i}] = {x}" for i, x in enumerate(found)]
    return f"{_NEEDED}\n\ndef {name}(t, f, y):\n" + "".join(f"    {one}\n" for one in lines or ["pass"])
