"""A scene's own names: constants, formulas, states, tables, events, inputs and outputs; and loads given as text.

The meaning of texts is checked for all of them together, see `rbfmu.formulas.check`.
"""

import keyword
import math
from collections.abc import Iterator, Mapping
from itertools import pairwise
from typing import Annotated, Any, NoReturn, Self, TypeVar

import numpy as np

from rbfmu.scene import section as rules
from rbfmu_kernels.quantities import Parameter

T = TypeVar("T")
LOADS = ("force_a", "force_b", "torque_a", "torque_b", "potential")
"""The loads that may be given as formulas; a force and a torque follow from the potential, J."""
ENERGIES = {
    "potential_energy": "potential energy of gravity, constant force_a and loads.potential",
    "total_energy": "kinetic and potential energy",
}
"""Outputs that are computed by formulas, like own outputs, with their meanings."""
PARAMETER_END = {"constants": "", "states": "_0"}
"""The tables whose names are parameters, and the ending of the parameter's name: for a state it is the start."""
DIRECTIONS = {"rising": 1.0, "falling": -1.0, "any": 0.0}
MOST_ROWS = 64
_UNIT, _ABOUT = rules.line("a unit, such as N m", 40), rules.line("at most 200 printable characters", 200)
_SCALAR, _VECTOR = rules.Numbers(()), rules.Numbers((3,))


def _one_or_three(value: object) -> object:
    if isinstance(given := rules.plain(value), list | tuple):
        if any(isinstance(item, list | tuple) for item in given):
            raise ValueError("a number, or 3 numbers; a matrix stands as a text under [formulas]")
        return _VECTOR(value)
    try:
        number = _SCALAR.floats(value, ())
    except ValueError:  # the rule's own words name both shapes
        return None
    if not math.isfinite(number):
        raise ValueError("a finite number, or 3 finite numbers")
    return (number,)


def _row(value: object) -> tuple[float, ...] | None:
    rows = rules.plain(value)
    return tuple(map(_SCALAR, rows)) if isinstance(rows, list | tuple) else None


def _text(value: object) -> str | None:
    """Return a formula; a list of formulas is their sum."""
    if items := rules.texts(value):
        return " + ".join(f"({item})" for item in items)
    return value if isinstance(value, str) and value.strip() else None


def _is_name(value: object) -> bool:
    return isinstance(value, str) and value.isidentifier() and value.isascii() and not keyword.iskeyword(value)


class Text(rules.Rule):
    """The rule of a formula: its grammar; its names are checked later, for all formulas together."""

    def read(self, value: object, path: str) -> str:
        """Return the text. Raises SceneError if it is no formula."""
        from rbfmu.formulas.text import FormulaError, read  # only if needed, as it loads slowly

        text: str = super().read(value, path)
        try:
            read(text)
        except FormulaError as error:
            raise rules.SceneError(f"{path}: {error}") from None
        return text


NUMBERS = rules.Rule("a number, or 3 numbers", _one_or_three)
TEXT = Text("a formula, such as 2*k*sin(t)", _text)
_NAME = rules.Rule(
    "letters, digits and _, no digit first and no word of Python such as from",
    lambda value: value if _is_name(value) else None,
)
_ROW = rules.Rule("a list of numbers", _row)


class Named(dict[str, T]):
    """An immutable table with a user's own names; their order matters, as results and FMUs have the same order."""

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Mapping) and tuple(self.items()) == tuple(other.items())

    def __ne__(self, other: object) -> bool:
        return not self == other

    def __hash__(self) -> int:  # type: ignore[override]
        return hash(tuple(self.items()))

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (dict(self),)

    def _refuse(self, *_: object, **__: object) -> NoReturn:
        raise ValueError("a table of a scene is frozen: Scene.replace returns a scene with other values")

    __setitem__ = __delitem__ = __ior__ = update = setdefault = pop = popitem = clear = _refuse


NOTHING: Mapping[str, Any] = Named()


class Entry(rules.Section):
    """The entry of an own name: a table, or only the value of the table's first key."""

    about: Annotated[str, _ABOUT] = ""

    @classmethod
    def read(cls, value: object, path: str = "") -> Self:
        """Return the entry of a value; an entry is returned unchanged."""
        return super().read(value if isinstance(value, cls | Mapping) else {next(iter(cls._rules)): value}, path)

    @property
    def numbers(self) -> tuple[float, ...]:
        """Return the numbers of its first key: the value of a constant, the start of a state."""
        return tuple(getattr(self, next(iter(self._rules))))

    def table(self) -> dict[str, Any]:
        """Return the entry as in a file."""
        found = {name: value for name, value in super().table().items() if value != ""}
        return {name: x[0] if isinstance(x, list) and len(x) == 1 else x for name, x in found.items()}

    def _arguments(self) -> dict[str, object]:
        return {name: x for name, x in self.table().items() if name in self._non_defaults()}


class WithUnit(Entry):
    """An entry with a unit."""

    unit: Annotated[str, _UNIT] = ""


class Constant(WithUnit):
    """A number or a vector of your own."""

    value: Annotated[tuple[float, ...], NUMBERS]


class State(WithUnit):
    """A state of your own: its start, and its rate as a formula."""

    start: Annotated[tuple[float, ...], NUMBERS]
    rate: Annotated[str, TEXT]


class Shown(WithUnit):
    """An output of your own: its value as a formula."""

    value: Annotated[str, TEXT]


class Event(Entry):
    """An event: when a formula comes to zero, in which direction, and whether the run ends there."""

    when: Annotated[str, TEXT]
    direction: Annotated[str, rules.one_word(DIRECTIONS, "rising, falling or any")] = "any"
    stop: Annotated[bool, rules.FLAG] = False


class Port(WithUnit):
    """An input of your own, which formulas read; its size is that of its start, if that is given."""

    name: Annotated[str, _NAME]
    start: Annotated[tuple[float, ...], NUMBERS]
    size: Annotated[int, rules.Rule("1 or 3", lambda n: int(n) if rules.plain(n) in (1, 3) and n is not True else None)]

    def _apart(self, data: Mapping[str, object], faults: list[str]) -> rules.Apart:
        start = rules.plain(data.get("start"))
        size = rules.plain(data.get("size", 3 if start is None or isinstance(start, list | tuple) else 1))
        return {"start": [0.0] * 3 if size == 3 else 0.0, "size": size, **data}, {}

    def _contradictions(self) -> Iterator[str]:
        if len(self.start) != self.size:
            yield rules.fault(f"{self._path}.start", self.start, f"as many numbers as size says, {self.size}")


class Table(Entry):
    """A table of your own: y over x, by straight lines or a natural cubic spline."""

    x: Annotated[tuple[float, ...], _ROW]
    y: Annotated[tuple[float, ...], _ROW]
    method: Annotated[str, rules.one_word(("linear", "cubic"), "linear or cubic")] = "linear"

    @classmethod
    def read(cls, value: object, path: str = "") -> Self:
        """Return the table of a value; a table is returned unchanged."""
        if not isinstance(value, cls | Mapping):
            raise rules.SceneError(rules.fault(path, value, "a table { x, y } of two lists of numbers"))
        return super().read(value, path)

    def _contradictions(self) -> Iterator[str]:
        if len(self.x) != len(self.y) or not 2 <= len(self.x) <= MOST_ROWS:
            expected = f"as many y as x, 2 to {MOST_ROWS}, not {len(self.y)} and {len(self.x)}"
            yield rules.fault(f"{self._path}.y", self.y, expected)
        elif any(b <= a for a, b in pairwise(self.x)):
            yield rules.fault(f"{self._path}.x", self.x, "numbers that increase")
        else:
            from rbfmu.formulas.functions import Table as Polynomials  # only if needed, as it loads slowly

            with np.errstate(all="ignore"):
                rows = Polynomials.through(self.x, self.y, self.method == "cubic").rows
            if not np.isfinite(rows).all() or not np.isfinite(self.x[-1] - self.x[0]):
                yield rules.fault(f"{self._path}.y", self.y, "numbers of which slopes over x are finite")


class NamedTable(rules.Rule):
    """The rule of a table with a user's own names, each with an entry."""

    def __init__(self, entry: type[rules.Section] | rules.Rule, words: str, meaning: str) -> None:
        super().__init__(words, lambda value: value)
        self.entry, self.meaning = entry, meaning

    def read(self, value: object, path: str) -> Named[Any]:
        """Return the entries by name; such a table is returned unchanged."""
        if isinstance(value, Named):
            return value
        if not isinstance(value, Mapping):
            raise rules.SceneError(rules.fault(path, value, self.words))
        return Named(rules.read_each(value, path, self._named))

    def _named(self, name: str, value: object, path: str) -> Any:
        if not _is_name(name):
            raise rules.SceneError(rules.fault(path, value, f"a name of {_NAME.words}"))
        return self.entry.read(value, path)


CONSTANTS = NamedTable(Constant, "a table of numbers", "numbers of your own: NAME = value, or { value, unit, about }")
TABLES = NamedTable(
    Table,
    "a table of tables",
    "tables of your own: NAME = { x, y, method, about }, with method linear or cubic; constant outside",
)
FORMULAS = NamedTable(TEXT, "a table of formulas", "names for parts of formulas: NAME = text")
STATES = NamedTable(
    State, "a table of states", "states of your own: NAME = { start, rate, unit, about }, the rate as a formula"
)
OUTPUTS = NamedTable(
    Shown,
    "a table of formulas",
    "outputs of your own, which may also stand beside `quantities`: NAME = text, or { value, unit, about }",
)
EVENTS = NamedTable(
    Event,
    "a table of events",
    "when a formula comes to zero: NAME = { when, direction, stop, about }, with direction rising, falling or any; "
    "stop = true ends the run there",
)
PORTS = NamedTable(Port, "a table of inputs", "inputs of your own, as they stand in `ports`")
_LOAD = Text("a formula in one text, such as [0, 0, 2*k*sin(t)], or a list of those that add up", _text)
LOAD_FORMULAS = NamedTable(_LOAD, "a table of formulas", "loads that are formulas")
OF_NUMBERS = "a load of numbers; formulas or a potential make this one, whose constants may vary"
"""What a message expects in place of a load that formulas make."""


def is_own(key: str) -> bool:
    """Return whether a key names a scene's own parameter, such as constants.k."""
    return key.partition(".")[0] in PARAMETER_END


def parameter_of(key: str) -> str:
    """Return the name of the parameter that is set by a key such as constants.k."""
    table, _, name = key.partition(".")
    return f"{name}{PARAMETER_END[table]}"


def parameters(tables: Mapping[str, Mapping[str, Constant | State]]) -> dict[str, Parameter]:
    """Return a scene's own parameters by the keys that set them."""
    found = {}
    for table, end in PARAMETER_END.items():
        for name, entry in tables[table].items():
            meaning = (entry.about or table.removesuffix("s")) + (", at the start" if end else "")
            block, unit = f"{table}.{name}{end}", entry.unit or "1"
            found[f"{table}.{name}"] = Parameter(f"{name}{end}", len(entry.numbers), unit, meaning, own_block=block)
    return found


def has_text(value: object) -> bool:
    """Return whether a load is a text, or a list that contains a text."""
    return any(isinstance(item, str) for item in (value if isinstance(value, list | tuple) else [value]))
