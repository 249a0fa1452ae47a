"""A table of a scene: the rules of its keys, the messages about values that break them, all faults at once."""

import difflib
import json
import math
import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from copy import copy
from datetime import date, time
from numbers import Real
from typing import Any, ClassVar, Self

from pydantic import BaseModel, ConfigDict, GetCoreSchemaHandler, ValidationError
from pydantic_core import core_schema

from rbfmu.exceptions import SceneError as SceneError
from rbfmu_kernels.quantities import BY_NAME, NOT_NEGATIVE

LONGEST = 72
"""Characters of a value that a message shows."""


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
        pairs = (f"{joined('', str(key))} = {_spelling(item, depth + 1)}" for key, item in _first(value.items()))
        return "{ " + ", ".join(pairs) + " }" if value else "{}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_spelling(item, depth + 1) for item in _first(value)) + "]"
    try:
        return str(value) if isinstance(value, Real | date | time) else repr(value)
    except ValueError:  # str() refuses an integer of thousands of digits
        return "a very large integer"


def _first(items: Collection[Any]) -> Iterator[Any]:
    return (item for item, _ in zip(items, range(LONGEST), strict=False))


def joined(path: str, key: str) -> str:
    """Return a dotted key, quoted where TOML requires it."""
    key = key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else json.dumps(key)
    return f"{path}.{key}" if path else key


class Rule:
    """The rule of one key: a call returns the value to store, or raises a ValueError that says what was expected.

    words: which values are allowed. read: returns what is stored of a value, and None of one that is refused in these
    words; it may raise a ValueError in words of its own. choice: the words in a list of keys, where unit and meaning do
    not suffice.

    Pydantic keeps, compares, copies and writes the tables; it does not check values. Its own checks (`Field(gt=0)`,
    `Literal`, unions) know neither unit nor shape, speak of each component of a vector and of each branch of a union
    by itself, and would need a table that turns every kind of error back into the words of these rules.
    """

    def __init__(self, words: str, read: Callable[[Any], Any], choice: str = "") -> None:
        self.words, self.read, self.choice, self.meaning = words, read, choice, ""

    def means(self, meaning: str) -> Self:
        """Return the rule of a key with this meaning."""
        rule = copy(self)
        rule.meaning = meaning
        return rule

    def __call__(self, value: Any) -> Any:
        """Return the value as stored."""
        if (found := self.read(value)) is None:
            raise ValueError(self.words)
        return found

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> core_schema.CoreSchema:
        return core_schema.no_info_plain_validator_function(self)


class Numbers(Rule):
    """The rule of finite floats within a bound: one, a tuple, or rows. Integers are accepted, bools are not.

    then: makes what is stored of the floats, or raises a ValueError that says what was expected.
    """

    def __init__(
        self,
        shape: tuple[int, ...],
        unit: str = "",
        bound: str = "",
        holds: Callable[[float], bool] = math.isfinite,
        then: Callable[[Any], Any] | None = None,
    ) -> None:
        self.shape, self.unit, self.bound, self.holds, self.then = shape, unit, bound, holds, then
        super().__init__(self._words(""), self._read)

    def _words(self, finite: str) -> str:
        unit = f" ({self.unit})" if self.unit else ""
        sized = {0: f"a {finite}number", 1: f"{self.shape[0] if self.shape else 1} {finite}numbers"}
        return sized.get(len(self.shape), f"3 rows of 3 {finite}numbers") + self.bound + unit

    def _read(self, value: Any) -> Any:
        floats = self.floats(value, self.shape)
        if not all(map(math.isfinite, flattened(floats))):
            raise ValueError(self._words("finite "))
        if not all(map(self.holds, flattened(floats))):
            return None
        return self.then(floats) if self.then else floats

    def floats(self, value: Any, shape: tuple[int, ...]) -> Any:
        """Return the value as (nested) tuples of floats, infinite where an integer is too large."""
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


def plain(value: Any) -> Any:
    """Return NumPy's arrays and numbers as Python's, anything else as it is."""
    return value.tolist() if hasattr(value, "tolist") else value


def flattened(value: Any) -> Iterator[float]:
    """Yield the floats of a nested tuple."""
    if isinstance(value, tuple):
        for item in value:
            yield from flattened(item)
    else:
        yield value


def positive(unit: str, *shape: int) -> Numbers:
    """Return the rule of numbers above 0."""
    return Numbers(shape, unit, " > 0", lambda x: x > 0.0)


def numbers(name: str) -> Numbers:
    """Return the rule of a parameter, a load or an initial value, given its name in the table of quantities."""
    row = BY_NAME[name]
    shape = () if row.size == 1 else (row.size,)
    unit = "" if row.unit == "1" else row.unit
    if row.bounds != NOT_NEGATIVE:
        rule = Numbers(shape, unit)
    elif getattr(row, "positive", False):
        rule = positive(unit, *shape)
    else:
        rule = Numbers(shape, unit, " >= 0", not_negative)
    return rule.means(row.meaning)


def not_negative(x: float) -> bool:
    """Return whether x >= 0."""
    return x >= 0.0


def whole(least: int, most: int) -> Rule:
    """Return the rule of a whole number from `least` to `most`."""

    def read(value: Any) -> int | None:
        value = plain(value)
        return value if isinstance(value, int) and not isinstance(value, bool) and least <= value <= most else None

    return Rule(f"a whole number from {least} to {most}", read)


FLAG = Rule("true or false", lambda value: value if isinstance(value, bool) else None)


def line(words: str, longest: int, unwanted: str = "") -> Rule:
    """Return the rule of a printable line; one in which some characters are unwanted is not blank either."""

    def read(value: Any) -> str | None:
        good = isinstance(value, str) and value.isprintable() and len(value) <= longest
        return value if good and (not unwanted or (value.strip() and not set(value) & set(unwanted))) else None

    return Rule(words, read)


def one_word(known: Collection[str], words: str) -> Rule:
    """Return the rule of a choice: one of some words."""
    return Rule(words, lambda value: value if isinstance(value, str) and value in known else None)


def names(known: tuple[str, ...], least: int = 0) -> Rule:
    """Return the rule of a list of distinct, known names."""
    choice = f"out of {', '.join(known)}"
    words = f"a list of distinct names {choice}"

    def read(value: Any) -> tuple[str, ...] | None:
        if not isinstance(value, list | tuple) or not all(isinstance(name, str) for name in value):
            return None
        for name in value:
            if name not in known:
                if near := closest(name, known):
                    raise ValueError(f"{near} in place of {as_toml(name)}, or another {choice}")
                raise ValueError(f"{words}, not {as_toml(name)}")
        if twice := next((name for name in value if value.count(name) > 1), ""):
            raise ValueError(f"each name once, not {value.count(twice)} times {twice}")
        if len(value) < least:
            raise ValueError(f"{words}, at least one")
        return tuple(value)

    return Rule(words, read, choice)


def closest(name: str, known: Iterable[str]) -> str:
    """Return the known name closest to a mistyped one, or an empty string if none is close."""
    lower = {k.lower(): k for k in known}
    near = difflib.get_close_matches(name.lower(), lower, n=1)
    return lower[near[0]] if near else ""


class Section(BaseModel):
    """A table of the scene: immutable, compared by value; an invalid one raises SceneError with all of its faults."""

    model_config = ConfigDict(frozen=True, defer_build=True)
    _path: ClassVar[str] = ""
    _spellings: ClassVar[Mapping[str, tuple[str, ...]]] = {}
    _other_keys: ClassVar[Mapping[str, tuple[str, str]]] = {}
    """The unit and the meaning of each key that is not a field."""
    _homes: ClassVar[dict[str, str]] = {}

    def __init__(self, /, **data: Any) -> None:
        faults = list(self._unknown_keys(data))
        values = self._resolved({key: value for key, value in data.items() if key in self._keys()}, faults)
        try:
            super().__init__(**values)
        except ValidationError as error:
            faults += [self._in_words(entry) for entry in error.errors(include_url=False)]
        if not faults:
            faults += self._contradictions()
        if faults:
            raise SceneError(faults)

    @classmethod
    def __pydantic_init_subclass__(cls, **kwargs: Any) -> None:
        """Record the table of each key, so that an error can name it where the key is misplaced."""
        for key in cls._keys() if cls._path else ():
            cls._homes.setdefault(key, joined(cls._path, key))

    def _set(self) -> dict[str, Any]:
        """Return the fields that are not as by default."""
        fields = type(self).model_fields
        return {name: getattr(self, name) for name in fields if getattr(self, name) != fields[name].default}

    def __repr_args__(self) -> Iterable[tuple[str | None, Any]]:
        return self._set().items()

    @classmethod
    def read(cls, value: Any) -> Self:
        """Return the section of a table, or the section itself."""
        if isinstance(value, cls):
            return value
        if not isinstance(value, Mapping):
            raise SceneError([fault(cls._path, value, f"a table with keys out of {', '.join(cls._keys())}")])
        return cls(**{str(key): item for key, item in value.items()})

    @classmethod
    def _keys(cls) -> list[str]:
        """Return the keys as the file spells them; several keys may stand for one field."""
        return [key for name in cls.model_fields for key in cls._spellings.get(name, (name,))]

    @classmethod
    def _rule(cls, name: str) -> Rule:
        return next(rule for rule in cls.model_fields[name].metadata if isinstance(rule, Rule))

    @classmethod
    def _resolved(cls, data: dict[str, Any], faults: list[str]) -> dict[str, Any]:
        """Return the fields, made from the keys that stand for them."""
        return data

    def _contradictions(self) -> Iterable[str]:
        """Return the contradictions between fields that are valid by themselves."""
        return ()

    @classmethod
    def _unknown_keys(cls, data: Mapping[str, Any]) -> Iterator[str]:
        keys = cls._keys()
        for key, value in data.items():
            if key not in keys:
                path = joined(cls._path, key)
                near = cls._homes.get(key, path)
                near = closest(key, keys) if near == path else near
                hint = f"did you mean {near}?" if near else f"expected one of {', '.join(keys)}"
                yield f"{path} = {as_toml(value)}: unknown key; {hint}"

    @classmethod
    def _in_words(cls, error: Mapping[str, Any]) -> str:
        name = str(error["loc"][0])
        path = joined(cls._path, name)
        if error["type"] == "missing":
            return f"{path} is missing: expected {cls._rule(name).words}"
        return fault(path, error["input"], str(error["ctx"]["error"]))


def one_of(section: type[Section], data: dict[str, Any], keys: tuple[str, ...], faults: list[str]) -> str:
    """Return the exclusive key that is given, or an empty string; several keys add a fault."""
    given = [key for key in keys if key in data]
    if len(given) > 1:
        path = joined(section._path, given[1])
        faults.append(fault(path, data[given[1]], f"{' or '.join(given)}, not {'both' if len(given) == 2 else 'all'}"))
    return given[0] if len(given) == 1 else ""
