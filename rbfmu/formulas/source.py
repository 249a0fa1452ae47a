"""A program written out as kernels; a user can print them: `rbfmu plan SCENE --code`.

`constants` sets operations that are constant over a series, `first` the values at its beginning, `further` the k-th
coefficients, `values` the wanted numbers for the present states, and `feedthrough` their changes by changes of inputs.
Four sums of products are computed at once, so that the factors of these sums are side by side: a row of the work space
contains the k-th coefficients of the states, and of all factors that sums of higher orders need.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import groupby

from rbfmu.formulas.graph import LEAVES, Graph, Number, Symbol, numbers_of
from rbfmu.formulas.program import RECURRENCES, ROOTS, WIDTH, Factor, Program

MOST_SUMS = 12
"""The most groups of sums in one loop: more do not fit into the 16 vector registers, and would be kept in memory."""
SERIES = ("constants", "first", "further")
KERNELS = (*SERIES, "values", "feedthrough")
KERNELS_OVER = ("values", "feedthrough", "loads")
HEAD = '''\
"""Formulas of a scene as kernels, written by rbfmu.formulas.source; places are those of the model's buffer."""

import math

from rbfmu_kernels.buffer import NO_OUTPUTS
from rbfmu_kernels.compile.decorator import kernel
from rbfmu_kernels.compile.simd import add_lanes, lanes, lanes_at, multiply_lanes, numbers
from rbfmu_kernels.compile.wide import choose
from rbfmu_kernels.models import model_named
from rbfmu_kernels.models.formula_models import make_formulas, make_over
from rbfmu_kernels.numerics.elementary import atan2, exponential, logarithm, logistic, sincos
from rbfmu_kernels.types import Buffer

'''
"""The beginning of modules of kernels, and of right-hand sides for other solvers."""


Changes = Mapping[int, Mapping[int, Number]]
Place = Callable[..., int]
"""Returns the place in the buffer of a leaf or of an element of a block; with "_rate" or "_rate_2", that of an input's
derivative."""


def source_of(program: Program, place: Place, changes: Changes) -> str:
    """Return the text of a module with KERNELS; changes: see `_Writer.feedthrough`."""
    writer = _Writer(program, place)
    return _module(*writer.series(), writer.values(program.wanted), writer.feedthrough(changes))


def source_over(program: Program, place: Place, changes: Changes, loads: Mapping[str, Number]) -> str:
    """Return the text of a module with KERNELS_OVER; loads: set at the start, by the names of blocks' elements."""
    writer = _Writer(program, place)
    return _module(writer.values(program.wanted), writer.feedthrough(changes), writer.values(loads, "loads"))


def source_of_lanes(program: Program, place: Place) -> tuple[str, int]:
    """Return the text of a module with SERIES for several bodies side by side, and the length of a row."""
    writer = _WideWriter(program, place)
    return _module(*writer.series()), writer.row


def _module(*kernels: str) -> str:
    return HEAD + "\n\n".join(["", *kernels])[1:]


def module_of(
    source: str, constant: str, layout: tuple[Mapping[str, slice], int], places: Mapping[str, object], base: str = ""
) -> str:
    """Return the text of a module that also makes the model, as its attribute MODEL.

    base: an argument of `models.model_named`: the closed form of which outputs are functions, if any.
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


def _kernel(name: str, takes: str, gives: str, lines: Iterable[str]) -> str:
    body = "".join(f"    {line}\n" for line in lines)
    return f"@kernel(inline=False)\ndef {name}({takes}) -> {gives}:\n{body}"


class _Writer:
    def __init__(self, program: Program, place: Place) -> None:
        self._program, self._place, self._graph, self.row = program, place, program.graph, program.row
        self._sides = {i: n for n, i in enumerate(program.sides)}
        self._columns = {name: at for at, name in enumerate(program.rates)}
        self._factors = [placed for g in range(len(program.groups)) for placed in self._factors_of(g)]
        roots = enumerate(program.touching if program.sides else ())
        self._resting = {i: n for n, i in roots if program.graph.operations[i].kind in ROOTS}
        self._sums = {i: [sum_.name for sum_ in own] for i, own in groupby(program.sums, lambda sum_: sum_.of)}

    def series(self) -> Iterator[str]:
        """Yield the texts of SERIES."""
        program = self._program
        constants = {i: f"z[w + {at}]" for at, i in enumerate(program.constants)}
        lines = [*self._read_sides(constants), *self._assignments(constants)]
        lines += [f"{at} = {self._name(i)}" for i, at in constants.items()]
        yield _kernel("constants", "z: Buffer, w: int", "None", lines or ["pass"])
        used = {x.index for x in (*program.rates.values(), *program.beside) if isinstance(x, Symbol)}
        used |= {j for i in program.varying for j in self._graph.operations[i].of}
        known = [*self._read_sides(program.varying)]
        known += [f"{self._name(i)} = {at}" for i, at in constants.items() if i in used]
        lines = [*known, f"r = w + {program.start}", *self._assignments(program.varying)]
        lines += [f"z[r + {at}] = {'0.0' if factor.slope else self._name(factor.of)}" for at, factor in self._factors]
        yield _kernel("first", "z: Buffer, w: int", "None", [*lines, *self._store(self._text)])
        lines = [*known, f"r = w + {program.start} + k * {self.row}", "inverse = 1.0 / k", *self._orders()]
        yield _kernel("further", "z: Buffer, w: int, k: int", "None", [*lines, *self._store(self._later, " / (k + 1)")])

    def values(self, wanted: Mapping[str, Number], name: str = "values") -> str:
        """Return the text of the kernel that sets wanted numbers, by the states in the buffer."""
        places = {f"z[{self._place(element)}]": x for element, x in wanted.items()}
        lines = [*self._value_lines(wanted.values()), *(f"{at} = {self._text(x)}" for at, x in places.items())]
        sums = " + ".join(["0.0", *(f"0.0 * {at}" for at in places)])
        return _kernel(name, "z: Buffer", "int", [*lines, f"return 0 if {sums} == 0.0 else NO_OUTPUTS"])

    def feedthrough(self, changes: Changes) -> str:
        """Return the text of the kernel that sets changes of outputs by given changes of inputs.

        changes: output's place -> input's place -> derivative.
        """
        lines = [*self._value_lines(x for slopes in changes.values() for x in slopes.values())]
        for at, slopes in changes.items():
            terms = (f"{self._text(x)} * change[{place}]" for place, x in slopes.items())
            lines.append(f"change[{at}] = {' + '.join(terms) or 0.0}")
        return _kernel("feedthrough", "z: Buffer, change: Buffer", "int", [*lines, "return 0"])

    # Values

    def _value_lines(self, numbers: Iterable[Number]) -> Iterator[str]:
        """Return the lines that compute all operations on which numbers depend, by the states in the buffer."""
        reached = self._graph.reached(numbers)
        return self._assignments((i for i in reached if self._graph.operations[i].kind != "number"), in_row=False)

    def _assignments(self, operations: Iterable[int], in_row: bool = True) -> Iterator[str]:
        """Return the lines that set values; in_row: whether states are in a row of the work space."""
        return (f"{self._name(i)} = {self._value(i, in_row)}" for i in operations)

    def _read_sides(self, readers: Iterable[int]) -> Iterator[str]:
        used = {j for i in readers for j in self._graph.operations[i].of}
        return self._assignments(i for i in self._sides if i in used)

    def _name(self, i: int) -> str:
        """Return the variable of an operation's value or k-th coefficient; for a number its text."""
        operation = self._graph.operations[i]
        return repr(operation.value) if operation.kind == "number" else f"v{i}"

    def _text(self, x: Number) -> str:
        return self._name(x.index) if isinstance(x, Symbol) else repr(float(x))

    def _value(self, i: int, in_row: bool) -> str:
        kind, of, value = self._graph.operations[i]
        if in_row and i in self._sides:
            return f"z[{self._place('series.sides') + self._sides[i]}]"
        if in_row and kind == "state":
            return f"z[r + {self._columns[str(value)]}]"
        names = [*map(self._name, of)]
        text = f"z[{self._place(value)}]" if kind in LEAVES else VALUES[kind].format(*names)
        if in_row and i in self._resting:
            of_zero = VALUES[kind].format("0.0", *names[1:])
            return f"choose(z[{self._place('series.resting') + self._resting[i]}] != 0.0, {of_zero}, {text})"
        return text

    def _store(self, text: Callable[[Number], str], divided: str = "") -> Iterator[str]:
        """Yield the lines that store watched numbers, numbers of `beside`, and the states' next coefficients."""
        program = self._program
        kept = (*enumerate(program.watched, len(self._columns)), *enumerate(program.beside, program.beside_at))
        yield from (f"z[r + {at}] = {text(x)}" for at, x in kept)
        for at, rate in enumerate(map(text, program.rates.values()), self.row):
            yield f"z[r + {at}] = {rate}{'' if rate == '0.0' else divided}"

    # Coefficients beyond the first

    def _orders(self) -> Iterator[str]:
        for n, level in enumerate(self._program.levels):
            yield from self._products(n)
            yield from (f"{self._name(i)} = {self._coefficient(i)}" for i in level)
        for g, group in enumerate(self._program.groups):  # factors that were not known when these products were summed
            left = ((at, x) for at, x in self._factors_of(g) if not self._is_known(x, group[0].level))
            yield from (f"z[r + {at}] = {self._factor(factor)}" for at, factor in left)

    def _is_known(self, factor: Factor, level: int) -> bool:
        """Return whether a factor's k-th coefficient is known when a level's sums are computed."""
        return self._program.level_of.get(factor.of, -1) < level

    def _factors_of(self, g: int) -> Iterator[tuple[int, Factor]]:
        """Yield a group's factors with their places in a row."""
        at = self._program.head + 2 * WIDTH * g
        for lane, sum_ in enumerate(self._program.groups[g], at):
            yield lane, sum_.first
            yield lane + WIDTH, sum_.last

    def _products(self, level: int) -> Iterator[str]:
        """Yield the lines that store the factors known so far, and sum the products of a level's groups."""
        groups = {g: group for g, group in enumerate(self._program.groups) if group[0].level == level}
        for at, factor in (placed for g in groups for placed in self._factors_of(g)):
            yield f"z[r + {at}] = {self._factor(factor) if self._is_known(factor, level) else '0.0'}"
        for first in range(0, len(groups), MOST_SUMS):
            some = [*groups][first : first + MOST_SUMS]
            yield from (f"s{g} = lanes(0.0, 0.0, 0.0, 0.0)" for g in some)
            yield from self._loop
            for g in some:
                at = self._program.head + 2 * WIDTH * g
                product = f"multiply_lanes(lanes_at(z, a + {at}), lanes_at(z, b + {at + WIDTH}))"
                yield f"    s{g} = add_lanes(s{g}, {product})"
        for g, group in groups.items():
            names = [*(sum_.name for sum_ in group), *["_"] * WIDTH][:WIDTH]
            yield f"{', '.join(names)} = numbers(s{g})"

    @property
    def _loop(self) -> tuple[str, str]:
        """The head of the loop over products of (k - j)-th and j-th coefficients."""
        return "for j in range(k + 1):", f"    a, b = r - (k - j) * {self.row}, r - j * {self.row}"

    def _factor(self, factor: Factor) -> str:
        """Return the text of a factor's k-th coefficient, k > 0."""
        part = self._part(factor.of)
        return f"k * {part}" if factor.slope and part != "0.0" else part

    def _coefficient(self, i: int) -> str:
        """Return the text of an operation's k-th coefficient, k > 0."""
        kind, of, value = self._graph.operations[i]
        a, b, c = (*map(self._part, of), "", "", "")[:3]
        match kind:
            case "state":
                return f"z[r + {self._columns[str(value)]}]"
            case "input":
                rate, rate_2 = (self._place(value, end) for end in ("_rate", "_rate_2"))
                return f"z[{rate}] if k == 1 else 0.5 * z[{rate_2}] if k == 2 else 0.0"
            case "select":
                return f"choose({self._name(of[0])} > 0.0, {b}, {c})"
            case _ if i in self._sums:
                _, text, divisor = RECURRENCES[kind]
                x = self._first(self._program.operand(i, divisor)) if divisor else ""
                return text.format(*self._sums[i], a=a, b=self._name(of[-1]), x=x)
            case "multiply":
                return f"{self._name(of[0])} * {self._name(of[1])}"
            case "divide":
                return f"{a} / {self._name(of[1])}"
        if "0.0" not in (a, b):
            return f"{a} {'+' if kind == 'add' else '-'} {b}"
        return a if b == "0.0" else b if kind == "add" else f"-{b}"

    def _part(self, i: int) -> str:
        """Return the text of an operand's k-th coefficient, k > 0: 0.0 for a constant."""
        return self._name(i) if i in self._program.level_of else "0.0"

    def _later(self, x: Number) -> str:
        return self._part(x.index) if isinstance(x, Symbol) else "0.0"

    def _first(self, i: int) -> str:
        """Return the text of an operation's first coefficient (k = 0), which is in the first row, as it is a factor."""
        at = next(at for at, factor in self._factors if factor == Factor(i))
        return f"z[w + {self._program.start + at}]"


class _WideWriter(_Writer):
    """Writes the same sums for numbers of several bodies, with the same bits.

    Sums are computed one by one, and each factor is stored once. Coefficients of an order that are not known yet count
    as zero, as in the sums of one body.
    """

    def __init__(self, program: Program, place: Place) -> None:
        super().__init__(program, place)
        factors = dict.fromkeys(factor for sum_ in program.sums for factor in (sum_.first, sum_.last))
        self._factors = [*enumerate(factors, program.head)]
        self.row = program.head + len(factors)

    def _orders(self) -> Iterator[str]:
        yield from (f"z[r + {at}] = 0.0" for at, _ in self._factors)
        for n, level in enumerate(self._program.levels):
            yield from self._products(n)
            yield from (f"{self._name(i)} = {self._coefficient(i)}" for i in level)
            yield from (f"z[r + {at}] = {self._factor(factor)}" for at, factor in self._factors if factor.of in level)

    def _products(self, level: int) -> Iterator[str]:
        at = {factor: place for place, factor in self._factors}
        sums = [sum_ for sum_ in self._program.sums if sum_.level == level]
        yield from (f"{sum_.name} = 0.0" for sum_ in sums)
        yield from self._loop if sums else ()
        yield from (f"    {s.name} += z[a + {at[s.first]}] * z[b + {at[s.last]}]" for s in sums)


VALUES = {
    "add": "{} + {}", "subtract": "{} - {}", "multiply": "{} * {}", "divide": "{} / {}", "sqrt": "math.sqrt({})",
    "sin": "sincos({})[0]", "cos": "sincos({})[1]", "exp": "exponential({})", "log": "logarithm({})",
    "logistic": "logistic({0})",
    "atan2": "atan2({}, {})", "power": "exponential({1} * logarithm({0}))", "side": "math.copysign(1.0, {} + 0.0)",
    "select": "choose({0} > 0.0, {1}, {2})",
}  # fmt: skip


def lines_of(
    graph: Graph, ends: Sequence[Number], leaves: Mapping[str, str], texts: Mapping[str, str]
) -> tuple[list[str], list[str | float]]:
    """Return assignments in another language, and the texts of numbers by their variables; texts: of operations."""
    lines: list[str] = []

    def line(text: str) -> Callable[..., str]:
        def add(*of: object) -> str:
            lines.append(f"v{len(lines)} = {text.format(*of)}")
            return f"v{len(lines) - 1}"

        return add

    found = numbers_of(graph, ends, leaves, {kind: line(text) for kind, text in texts.items()})
    return lines, found


def function_of(name: str, graph: Graph, ends: Sequence[Number], leaves: Mapping[str, str]) -> str:
    """Return the text of a function name(t, f, y), as other solvers call it, that puts numbers into f.

    leaves: the texts of parameters, states and inputs, by name.
    """
    lines, found = lines_of(graph, ends, leaves, VALUES)
    lines += [f"f[{i}] = {x}" for i, x in enumerate(found)]
    return f"{HEAD}\ndef {name}(t, f, y):\n" + "".join(f"    {line}\n" for line in lines or ["pass"])
