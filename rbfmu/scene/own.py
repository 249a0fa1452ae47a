"""What a scene names itself: constants, formulas, states and outputs, and loads given as text.

Texts are checked where all of them are together, see `rbfmu.formulas.check`.
"""

import keyword
from collections.abc import Callable, Collection, Mapping, Sequence
from itertools import pairwise
from typing import Any, NamedTuple, TypeGuard, TypeVar

from rbfmu.scene.section import FLAG, Numbers, Rule, as_toml, joined, line, one_word, plain
from rbfmu_kernels.quantities import Parameter

T = TypeVar("T")
LOADS = ("force_a", "force_b", "torque_a", "torque_b", "potential")
"""The loads that may be given as formulas; of the potential, J, follow a force and a torque."""
ENERGIES = {
    "potential_energy": "potential energy of gravity, constant force_a and loads.potential",
    "total_energy": "kinetic and potential energy",
}
"""Outputs that are made as those of one's own are, by name."""
PARAMETER_END = {"constants": "", "states": "_0"}
"""The tables whose names are parameters, by what follows the name: of a state that is its start."""
_UNIT, _ABOUT = line("a unit, such as N m", 40), line("at most 200 printable characters", 200)
_BESIDE = {"unit": _UNIT, "about": _ABOUT}
_TEXT = "a formula, such as 2*k*sin(t)"
_METHOD = one_word(("linear", "cubic"), "linear or cubic")
DIRECTIONS = {"rising": 1.0, "falling": -1.0, "any": 0.0}
_DIRECTION = one_word(tuple(DIRECTIONS), "rising, falling or any")
_SCALAR, _VECTOR = Numbers(()), Numbers((3,))


class Named(dict[str, T]):
    """A table with names of one's own, which nobody changes."""

    def __hash__(self) -> int:  # type: ignore[override]
        return hash(tuple(self.items()))


class Constant(NamedTuple):
    """A number or a vector of one's own."""

    value: tuple[float, ...]
    unit: str = ""
    about: str = ""

    @property
    def numbers(self) -> tuple[float, ...]:
        """Return the parameter's numbers."""
        return self.value


class State(NamedTuple):
    """A state of one's own: its start, and its rate as a formula."""

    start: tuple[float, ...]
    rate: str
    unit: str = ""
    about: str = ""

    @property
    def numbers(self) -> tuple[float, ...]:
        """Return the parameter's numbers."""
        return self.start


class Shown(NamedTuple):
    """An output of one's own: its value as a formula."""

    value: str
    unit: str = ""
    about: str = ""


class Event(NamedTuple):
    """An event: when a formula comes to zero, in which direction, and whether the run ends there."""

    when: str
    direction: str = "any"
    stop: bool = False
    about: str = ""


class Port(NamedTuple):
    """An input of one's own, that formulas read."""

    name: str
    start: tuple[float, ...] = ()
    size: int = 3
    unit: str = ""
    about: str = ""


def is_own(key: str) -> bool:
    """Return whether a key such as constants.k names a parameter of a scene's own."""
    return key.partition(".")[0] in PARAMETER_END


def parameter_of(key: str) -> str:
    """Return the name of the parameter that a key of a scene's own sets."""
    table, _, name = key.partition(".")
    return f"{name}{PARAMETER_END[table]}"


def parameters(tables: Mapping[str, Mapping[str, Constant | State]]) -> dict[str, Parameter]:
    """Return the parameters of a scene's own by the keys that set them."""
    found = {}
    for table, end in PARAMETER_END.items():
        for name, one in tables[table].items():
            meaning = (one.about or table.removesuffix("s")) + (", at the start" if end else "")
            block = f"{table}.{name}{end}"
            own = Parameter(f"{name}{end}", len(one.numbers), one.unit or "1", meaning, own_block=block)
            found[f"{table}.{name}"] = own
    return found


def as_written(rows: Mapping[str, Any]) -> dict[str, Any]:
    """Return a table of constants, states or outputs as a file has it."""
    return {
        name: {key: _plain(value) for key, value in row._asdict().items() if value != ""} for name, row in rows.items()
    }


def _plain(value: Any) -> Any:
    return value if isinstance(value, str | int) else value[0] if len(value) == 1 else list(value)


class Table(NamedTuple):
    """A table of one's own: y over x, by straight lines or a natural cubic spline."""

    x: tuple[float, ...]
    y: tuple[float, ...]
    method: str = "linear"
    about: str = ""


def port(value: Any) -> Port:
    """Return an input of one's own; its size is that of its start, if that is given."""
    rules: dict[str, Callable[[Any], Any]] = {"name": _identifier, "start": one_or_three, "size": _size, **_BESIDE}
    found = _entry(Port, rules, value, ("start", "size", *_BESIDE))
    size = len(found.start) if found.start and "size" not in value else found.size
    if found.start and len(found.start) != size:
        raise ValueError(f"as many numbers in start as size says, not {len(found.start)} and {size}")
    return found._replace(start=found.start or (0.0,) * size, size=size)


def _size(value: Any) -> int:
    if value not in (1, 3) or isinstance(value, bool):
        raise ValueError("1 or 3")
    return int(value)


def _identifier(name: Any) -> str:
    if not (isinstance(name, str) and name.isidentifier() and name.isascii() and not keyword.iskeyword(name)):
        raise ValueError("letters, digits and _")
    return name


MOST_ROWS = 64


def table(value: Any) -> Table:
    """Return a table of numbers."""
    found = _entry(Table, {"x": _row, "y": _row, "method": _METHOD, "about": _ABOUT}, value, ("method", "about"))
    if len(found.x) != len(found.y) or not 2 <= len(found.x) <= MOST_ROWS:
        raise ValueError(f"as many y as x, 2 to {MOST_ROWS}, not {len(found.y)} and {len(found.x)}")
    if any(b <= a for a, b in pairwise(found.x)):
        raise ValueError("x that increases")
    return found


def _row(value: Any) -> tuple[float, ...]:
    rows = plain(value)
    if not isinstance(rows, list | tuple):
        raise ValueError("a list of numbers")
    return tuple(map(_SCALAR, rows))


def apart(loads: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the loads that are numbers, and those that are formulas, or several that add up."""
    texts = {
        name: value for name, value in loads.items() if name in LOADS and (isinstance(value, str) or _is_sum(value))
    }
    return {name: value for name, value in loads.items() if name not in texts}, texts


def listed_apart(inputs: Any, tables: Mapping[str, Any]) -> tuple[Any, tuple[str, ...]]:
    """Return the table of inputs without the constants and starts of states that its parameters list, and these."""
    known = {parameter_of(f"{table}.{name}") for table in PARAMETER_END for name in tables.get(table) or {}}
    listed = inputs.get("parameters") if isinstance(inputs, Mapping) else None
    if not isinstance(listed, list | tuple):
        return inputs, ()
    own = tuple(name for name in dict.fromkeys(x for x in listed if isinstance(x, str)) if name in known)
    return {**inputs, "parameters": [x for x in listed if x not in own]}, own


def _is_sum(value: Any) -> TypeGuard[Sequence[str]]:
    """Return whether a value is several texts, which add up."""
    return isinstance(value, list | tuple) and bool(value) and all(isinstance(x, str) for x in value)


def text(value: Any) -> str:
    """Return a formula; of a list of them the sum."""
    if _is_sum(value):
        return " + ".join(f"({item})" for item in value)
    if not isinstance(value, str) or not value.strip():
        raise ValueError(_TEXT)
    return value


def one_or_three(value: Any) -> tuple[float, ...]:
    """Return a number, or the numbers of a vector."""
    if isinstance(plain(value), list | tuple):
        return _VECTOR(value)  # type: ignore[no-any-return]
    try:
        return (_SCALAR(value),)
    except ValueError:
        raise ValueError("a number, or 3 numbers") from None


def _entry(
    kind: Callable[..., T],
    rules: Mapping[str, Callable[[Any], Any]],
    value: Any,
    optional: Collection[str] = ("unit", "about"),
) -> T:
    """Return an entry of a table, given as such or, where nothing else is said, by its first key's value."""
    if not isinstance(value, Mapping):
        value = {next(iter(rules)): value}
    if unknown := [key for key in value if key not in rules]:
        raise ValueError(f"keys out of {', '.join(rules)}, not {unknown[0]}")
    found = {}
    for key, rule in rules.items():
        if key in value:
            try:
                found[key] = rule(value[key])
            except ValueError as error:
                raise ValueError(f"{key} to be {error}, not {as_toml(value[key])}") from None
    if missing := [key for key in rules if key not in found and key not in optional]:
        raise ValueError(f"a table with {', '.join(missing)} as well")
    return kind(**found)


def _table(words: str, entry: Callable[[Any], T]) -> Rule:
    """Return the rule of a table with names of one's own."""

    def read(value: Any) -> Named[T] | None:
        if not isinstance(value, Mapping):
            return None
        found = Named[T]()
        for name, item in value.items():
            try:
                _identifier(name)
            except ValueError as error:
                raise ValueError(f"names of {error}, not {as_toml(name)}") from None
            try:
                found[name] = entry(item)
            except ValueError as error:
                raise ValueError(f"{joined('', name)} to be {error}") from None
        return found

    return Rule(words, read)


CONSTANTS = _table("a table of numbers", lambda x: _entry(Constant, {"value": one_or_three, **_BESIDE}, x)).means(
    "numbers of one's own: NAME = value, or { value, unit, about }"
)
TABLES = _table("a table of tables", table).means(
    "tables of one's own: NAME = { x, y, method, about }, with method linear or cubic; constant outside"
)
FORMULAS = _table("a table of formulas", text).means("names for parts of formulas: NAME = text")
STATES = _table(
    "a table of states", lambda x: _entry(State, {"start": one_or_three, "rate": text, **_BESIDE}, x)
).means("states of one's own: NAME = { start, rate, unit, about }, the rate as a formula")
OUTPUTS = _table("a table of formulas", lambda x: _entry(Shown, {"value": text, **_BESIDE}, x)).means(
    "outputs of one's own, which may also stand beside `quantities`: NAME = text, or { value, unit, about }"
)
_OF_AN_EVENT: dict[str, Callable[[Any], Any]] = {"when": text, "direction": _DIRECTION, "stop": FLAG, "about": _ABOUT}
EVENTS = _table("a table of events", lambda x: _entry(Event, _OF_AN_EVENT, x, ("direction", "stop", "about"))).means(
    "when a formula comes to zero: NAME = { when, direction, stop, about }, with direction rising, falling or any; "
    "stop = true ends the run there"
)
PORTS = _table("a table of inputs", port).means("inputs of one's own, as they stand in `ports`")
