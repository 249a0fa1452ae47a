"""A table of a scene: the rules of its keys, and messages about values that break them, all faults at once."""

import difflib
import json
import math
import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from copy import copy
from datetime import date, time
from functools import partial
from inspect import Parameter, Signature, get_annotations
from numbers import Real
from typing import Any, ClassVar, Self, TypeVar, dataclass_transform, get_args

from rbfmu.exceptions import SceneError as SceneError
from rbfmu_kernels.quantities import BY_NAME, NOT_NEGATIVE as NO_LESS_THAN_ZERO

T = TypeVar("T")
LONGEST = 72
"""The most characters of a value in a message."""


def fault(path: str, value: object, expected: str) -> str:
    """Return one line that names the key, its value, and what was expected."""
    return f"{path} = {as_toml(value)}: expected {expected}"


def as_toml(value: object) -> str:
    """Return a value as TOML spells it, shortened."""
    text = _spelling(value, depth=0)
    return text if len(text) <= LONGEST else text[: LONGEST - 4].rstrip() + " ..."


def _spelling(value: object, depth: int) -> str:
    value = plain(value)
    if callable(value):
        return "a function"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value[: 2 * LONGEST], ensure_ascii=not value.isprintable())
    if isinstance(value, Mapping | list | tuple) and depth > 4:
        return "..."
    if isinstance(value, Mapping):
        first = [*value.items()][:LONGEST]
        pairs = (f"{joined('', str(key))} = {_spelling(item, depth + 1)}" for key, item in first)
        return "{ " + ", ".join(pairs) + " }" if value else "{}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_spelling(item, depth + 1) for item in value[:LONGEST]) + "]"
    try:
        return str(value) if isinstance(value, Real | date | time) else repr(value)
    except ValueError:  # str() refuses an integer of thousands of digits
        return "a very large integer"


def joined(path: str, key: str) -> str:
    """Return a dotted key, quoted where TOML requires it."""
    key = key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else json.dumps(key, ensure_ascii=not key.isprintable())
    return f"{path}.{key}" if path else key


Apart = tuple[Mapping[str, object], dict[str, object]]


def checked(read: Callable[[object, str], Any], value: object, path: str, faults: list[str]) -> Any:
    """Return read(value, path); if the value is refused, add its faults and return None."""
    try:
        return read(value, path)
    except SceneError as error:
        faults += error.faults
        return None


def read_each(table: Mapping[str, object], path: str, read: Callable[[str, object, str], T]) -> dict[str, T]:
    """Return read(key, value, path) for each value of a table, by key. Raises SceneError with all faults."""
    faults: list[str] = []
    found = {k: checked(partial(read, str(k)), x, joined(path, str(k)), faults) for k, x in table.items()}
    if faults:
        raise SceneError(faults)
    return found


class Rule:
    """The rule of one key: a call returns the value to store, or raises a ValueError that says what was expected.

    words: the allowed values. convert: returns the value to store, or None for a refused one, which is reported with
    these words; it may raise a ValueError with other words. choice: the words in a list of keys, if unit and meaning
    are not enough.

    These rules are our own, not a library's: one rule says what a whole vector must be, with its unit. The checks of
    Pydantic (`Field(gt=0)`, `Literal`, unions) report each component, and each branch of a union, by itself, and would
    need a table that converts every kind of error to these words. Without it the first scene is ready a sixth sooner.
    """

    def __init__(self, words: str, convert: Callable[[object], object], choice: str = "", unit: str = "") -> None:
        self.words, self.convert, self.choice, self.unit, self.meaning = words, convert, choice, unit, ""

    def means(self, meaning: str) -> Self:
        """Return the rule of a key with this meaning."""
        rule = copy(self)
        rule.meaning = meaning
        return rule

    def __call__(self, value: object) -> Any:
        """Return the value as stored."""
        if (found := self.convert(value)) is None:
            raise ValueError(self.words)
        return found

    def read(self, value: object, path: str) -> Any:
        """Return the value as stored. Raises SceneError if it is refused."""
        try:
            return self(value)
        except SceneError:
            raise
        except ValueError as error:
            raise SceneError(fault(path, value, str(error))) from None


POSITIVE = " > 0", lambda x: x > 0.0
NOT_NEGATIVE = " >= 0", lambda x: x >= 0.0
"""Bounds of numbers: in words, and a test of a number."""


class Numbers(Rule):
    """The rule of finite floats within a bound: one, a tuple, or rows. Integers are accepted, bools are not.

    then: returns the value to store for the floats, or raises a ValueError that says what was expected.
    """

    def __init__(
        self, shape: tuple[int, ...], unit: str = "", bound: str = "", holds: Callable[[float], bool] = math.isfinite,
        then: Callable[[Any], object] = lambda floats: floats,
    ) -> None:  # fmt: skip
        self.shape, self.bound, self.holds, self.then = shape, bound, holds, then
        self._unit_said = f" ({unit})" if unit else ""
        super().__init__(self._words(""), self._convert, unit=unit)

    def _words(self, finite: str) -> str:
        sized = {0: f"a {finite}number", 1: f"{self.shape[0] if self.shape else 1} {finite}numbers"}
        return sized.get(len(self.shape), f"3 rows of 3 {finite}numbers") + self.bound + self._unit_said

    def _convert(self, value: object) -> object:
        floats = self.floats(value, self.shape)
        if not all(map(math.isfinite, flattened(floats))):
            raise ValueError(self._words("finite "))
        return self.then(floats) if all(map(self.holds, flattened(floats))) else None

    def floats(self, value: object, shape: tuple[int, ...]) -> Any:
        """Return the value as (nested) tuples of floats; an integer that is too large becomes infinity."""
        value = plain(value)
        if shape:
            if not isinstance(value, list | tuple) or len(value) != shape[0]:
                raise ValueError(self.words)
            return tuple(self.floats(item, shape[1:]) for item in value)
        if not isinstance(value, Real) or isinstance(value, bool):
            raise ValueError(self.words)
        try:
            return float(value)
        except OverflowError:
            return math.inf


def plain(value: object) -> object:
    """Return NumPy's arrays and numbers as Python's, anything else unchanged."""
    return value.tolist() if hasattr(value, "tolist") else value


def flattened(value: Any) -> Iterator[float]:
    """Yield the floats of a nested tuple."""
    if isinstance(value, tuple):
        for item in value:
            yield from flattened(item)
    else:
        yield value


def numbers(name: str) -> Numbers:
    """Return the rule of a parameter, a load or an initial value, given its name in the table of quantities."""
    row = BY_NAME[name]
    bound = () if row.bounds != NO_LESS_THAN_ZERO else POSITIVE if getattr(row, "positive", False) else NOT_NEGATIVE
    shape = () if row.size == 1 else (row.size,)
    return Numbers(shape, "" if row.unit == "1" else row.unit, *bound).means(row.meaning)


def whole(least: int, most: int) -> Rule:
    """Return the rule of a whole number from `least` to `most`."""

    def convert(value: object) -> int | None:
        value = plain(value)
        return value if isinstance(value, int) and not isinstance(value, bool) and least <= value <= most else None

    return Rule(f"a whole number from {least} to {most}", convert)


FLAG = Rule("true or false", lambda value: value if isinstance(value, bool) else None)


def line(words: str, longest: int, unwanted: str = "") -> Rule:
    """Return the rule of a printable line; if some characters are unwanted, it must not be blank either."""

    def convert(value: object) -> str | None:
        if not isinstance(value, str) or not value.isprintable() or len(value) > longest:
            return None
        return value if not unwanted or (value.strip() and not set(value) & set(unwanted)) else None

    return Rule(words, convert)


def one_word(known: Collection[str], words: str) -> Rule:
    """Return the rule of a choice: one of some words."""
    return Rule(words, lambda value: value if isinstance(value, str) and value in known else None)


def texts(value: object) -> tuple[str, ...] | None:
    """Return a list of texts as a tuple, or None for anything else."""
    return tuple(value) if isinstance(value, list | tuple) and all(isinstance(x, str) for x in value) else None


def names(known: tuple[str, ...], least: int = 0) -> Rule:
    """Return the rule of a list of distinct, known names."""
    choice = f"out of {', '.join(known)}"
    words = f"a list of distinct names {choice}"

    def convert(value: object) -> tuple[str, ...] | None:
        if (given := texts(value)) is None:
            return None
        for name in given:
            if name not in known:
                if near := closest(name, known):
                    raise ValueError(f"{near} in place of {as_toml(name)}, or another {choice}")
                raise ValueError(f"{words}, not {as_toml(name)}")
        if twice := next((name for name in given if given.count(name) > 1), ""):
            raise ValueError(f"each name once, not {given.count(twice)} times {twice}")
        if len(given) < least:
            raise ValueError(f"{words}, at least one")
        return given

    return Rule(words, convert, choice)


def closest(name: str, known: Iterable[str]) -> str:
    """Return the known name closest to a mistyped one, or an empty string if none is close."""
    lower = {k.lower(): k for k in known}
    near = difflib.get_close_matches(name.lower(), lower, n=1)
    return lower[near[0]] if near else ""


@dataclass_transform(kw_only_default=True, frozen_default=True)
class Section:
    """A table of the scene: immutable, compared by value; an invalid one raises SceneError with all of its faults.

    A field's rule is in its annotation: `Annotated[type, rule]`, or the class of a section.
    """

    _path: ClassVar[str] = ""
    _hidden: ClassVar[tuple[str, ...]] = ()
    """The fields that are no keys."""
    _instead: ClassVar[Mapping[str, tuple[str, Rule]]] = {}
    """The keys that set a field of another name, with that field and the rule that makes its value."""
    _texts: ClassVar[tuple[str, ...]] = ()  # the keys that can only be formulas, which `_apart` reads
    _homes: ClassVar[dict[str, str]] = {}
    _rules: ClassVar[Mapping[str, Any]] = {}
    _keys: ClassVar[Mapping[str, tuple[str, Any]]] = {}
    """The field and the rule of each key."""
    __signature__: ClassVar[Signature]
    _given: Mapping[str, tuple[str, object]]
    """For each given field its key, and its value if the key has another name."""

    def __init_subclass__(cls, path: str = "") -> None:
        """Find the rules, own ones before a base's, and the table of each key, for messages about misplaced keys."""
        cls._path, found = path or cls._path, dict[str, Any]()
        for name, hint in get_annotations(cls).items():
            for candidate in (*getattr(hint, "__metadata__", ()), hint, *get_args(hint)):
                if isinstance(candidate, Rule) or (isinstance(candidate, type) and issubclass(candidate, Section)):
                    found.setdefault(name, candidate)
        cls._rules, cls._keys = {**found, **cls._rules, **found}, {}
        for name, rule in cls._rules.items():
            cls._keys |= {} if name in cls._hidden else {name: (name, rule)}
            cls._keys |= {key: way for key, way in cls._instead.items() if way[0] == name}
        for key in cls._keys if cls._path else ():
            cls._homes.setdefault(key, joined(cls._path, key))
        of = {key: getattr(cls, key, ... if key in cls._instead else Parameter.empty) for key in cls._keys}
        cls.__signature__ = Signature([Parameter(key, Parameter.KEYWORD_ONLY, default=x) for key, x in of.items()])

    def __init__(self, /, **data: Any) -> None:
        self._fill(self._path, data)

    def _fill(self, path: str, data: Mapping[str, object]) -> None:
        faults: list[str] = []
        data, beside = self._apart(data, faults)
        faults += self._unknown_keys(path, data)
        own, given = vars(self), dict[str, tuple[str, object]]()
        own |= {"_path": path, "_given": given}
        ways = [(joined(path, key), key, *way, data[key]) for key, way in self._keys.items() if key in data]
        ways += [(path, name, name, self._rules[name], value) for name, value in beside.items()]
        for here, key, name, rule, value in ways:
            known = len(faults)
            if name in given:
                faults.append(fault(here, value, f"{given[name][0]} or {key}, not both"))
                continue
            given[name] = key, None if key == name else value
            absent = value is None and isinstance(rule, type) and getattr(type(self), name, ...) is None
            stored = None if absent else checked(rule.read, value, here, faults)
            own |= {name: stored} if len(faults) == known else {}
        for name, rule in self._rules.items():
            if name not in given and hasattr(type(self), name):
                own[name] = getattr(type(self), name)
            elif name not in given:
                others = "".join(f", or a {key}" for key, way in self._instead.items() if way[0] == name)
                faults.append(f"{joined(path, name)} is missing: expected {rule.words}{others}")
        faults += self._faults_together()
        faults += [] if faults else self._contradictions()
        if faults:
            raise SceneError(faults)

    @classmethod
    def read(cls, value: object, path: str = "") -> Self:
        """Return the section of a table; a section is returned unchanged."""
        if isinstance(value, cls):
            return value
        path = path or cls._path
        if not isinstance(value, Mapping):
            raise SceneError([fault(path, value, f"a table with keys out of {', '.join((*cls._keys, *cls._texts))}")])
        made = cls.__new__(cls)
        made._fill(path, {str(key): item for key, item in value.items()})
        return made

    def __setattr__(self, name: str, value: object) -> None:
        raise ValueError(f"{type(self).__name__}.{name} is frozen: Scene.replace returns a scene with other values")

    def _values(self) -> dict[str, Any]:
        return {name: vars(self)[name] for name in self._rules}

    def __eq__(self, other: object) -> bool:
        return type(self) is type(other) and isinstance(other, Section) and self._values() == other._values()

    def __hash__(self) -> int:
        return hash((type(self), *self._values().values()))

    def _with(self, **fields: object) -> Self:
        """Return the section with other values, which are not checked."""
        other = copy(self)
        vars(other).update(fields)
        return other

    def _non_defaults(self) -> dict[str, object]:
        """Return the fields that differ from the defaults."""
        return {name: value for name, value in self._values().items() if value != getattr(type(self), name, None)}

    def _by_key(self, fields: dict[str, Any]) -> dict[str, Any]:
        """Return fields by the keys that set them; the value of a hidden field contains its keys."""
        for name in self._hidden:
            fields |= as_lists(fields.pop(name, {}))
        return fields

    def _arguments(self) -> dict[str, object]:
        """Return the keys and values from which an equal section can be made."""
        return self._by_key(self._non_defaults())

    def __repr__(self) -> str:
        return f"{type(self).__name__}({', '.join(f'{name}={value!r}' for name, value in self._arguments().items())})"

    def table(self) -> dict[str, Any]:
        """Return the table from which an equal section can be made; vectors are lists."""
        return self._by_key({name: as_lists(value) for name, value in self._values().items() if value is not None})

    def _apart(self, data: Mapping[str, object], faults: list[str]) -> Apart:
        """Return the table with only the section's keys, and fields made from the other keys, such as own names."""
        return data, {}

    def _faults_together(self) -> Iterable[str]:
        """Return the contradictions between those fields that are valid by themselves."""
        return ()

    def _contradictions(self) -> Iterable[str]:
        """Return the contradictions between fields that are all valid by themselves."""
        return ()

    def _unknown_keys(self, path: str, data: Mapping[str, object]) -> Iterator[str]:
        known = (*self._keys, *self._texts)
        for key, value in data.items():
            if key not in self._keys:
                here = joined(path, key)
                near = self._homes.get(key, here)
                near = closest(key, known) if near == here else near
                hint = f"did you mean {near}?" if near else f"expected one of {', '.join(known)}"
                yield f"{here} = {as_toml(value)}: unknown key; {hint}"


def as_lists(value: Any) -> Any:
    """Return a stored value as in a file."""
    if isinstance(value, Section):
        return value.table()
    if isinstance(value, Mapping):
        return {key: as_lists(item) for key, item in value.items()}
    return [as_lists(item) for item in value] if isinstance(value, tuple) else value
