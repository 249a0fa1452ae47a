"""Rules for the values of a scene's keys, and the messages about values that break them."""

import difflib
import json
import math
import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from datetime import date, time
from numbers import Real
from typing import Any, NoReturn

from pydantic import GetCoreSchemaHandler
from pydantic_core import core_schema

from rbfmu.exceptions import SceneError as SceneError
from rbfmu_kernels.quantities import BY_NAME, NOT_NEGATIVE

LONGEST = 72
"""Characters of a value that a message shows."""


def fault(path: str, value: object, expected: str) -> str:
    """Return one line that names the key, its value, and what was expected."""
    return f"{path} = {shown(value)}: expected {expected}"


def shown(value: object, longest: int = LONGEST) -> str:
    """Return a value as TOML spells it, shortened."""
    text = _spelled(value, depth=0)
    return text if len(text) <= longest else text[: longest - 4].rstrip() + " ..."


def _spelled(value: object, depth: int) -> str:
    if hasattr(value, "tolist"):
        value = value.tolist()
    if callable(value):
        return "a function"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value[: 2 * LONGEST], ensure_ascii=not value.isprintable())
    if isinstance(value, Mapping | list | tuple) and depth > 4:
        return "..."
    if isinstance(value, Mapping):
        pairs = (f"{joined('', str(key))} = {_spelled(item, depth + 1)}" for key, item in _first(value.items()))
        return "{ " + ", ".join(pairs) + " }" if value else "{}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_spelled(item, depth + 1) for item in _first(value)) + "]"
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


class Rule(ABC):
    """A rule for one key: a call returns the value to store, or raises a ValueError that says what was expected."""

    @abstractmethod
    def expected(self) -> str:
        """Return a phrase that says which values are allowed."""

    def choice(self) -> str:
        """Return a phrase that lists the choices; it is empty where unit and meaning suffice."""
        return ""

    @abstractmethod
    def __call__(self, value: Any) -> Any:
        """Return the value as stored."""

    def refuse(self, detail: str = "") -> NoReturn:
        """Raise the ValueError that says what was expected."""
        raise ValueError(self.expected() + detail)

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> core_schema.CoreSchema:
        return core_schema.no_info_plain_validator_function(self)


@dataclass(frozen=True)
class Numbers(Rule):
    """The rule of finite floats within a bound: one, a tuple, or rows. Integers are accepted, bools are not."""

    shape: tuple[int, ...]
    unit: str
    bound: str = ""
    holds: Callable[[float], bool] = field(default=math.isfinite, repr=False)

    def expected(self) -> str:
        """Return a phrase that says which values are allowed, such as `3 numbers (m)`."""
        return self._words("")

    def _words(self, finite: str) -> str:
        unit = f" ({self.unit})" if self.unit else ""
        sized = {0: f"a {finite}number", 1: f"{self.shape[0] if self.shape else 1} {finite}numbers"}
        return sized.get(len(self.shape), f"3 rows of 3 {finite}numbers") + self.bound + unit

    def __call__(self, value: Any) -> Any:
        """Return the value as floats."""
        floats = self.floats(value, self.shape)
        if not all(map(math.isfinite, flattened(floats))):
            raise ValueError(self._words("finite "))
        if not all(map(self.holds, flattened(floats))):
            self.refuse()
        return floats

    def floats(self, value: Any, shape: tuple[int, ...]) -> Any:
        """Return the value as (nested) tuples of floats, infinite where an integer is too large."""
        value = value.tolist() if hasattr(value, "tolist") else value
        if shape:
            if not isinstance(value, list | tuple) or len(value) != shape[0]:
                self.refuse()
            return tuple(self.floats(item, shape[1:]) for item in value)
        if not isinstance(value, Real) or isinstance(value, bool):
            self.refuse()
        try:
            return float(value)
        except OverflowError:
            return math.inf


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
        return Numbers(shape, unit)
    return positive(unit, *shape) if getattr(row, "positive", False) else Numbers(shape, unit, " >= 0", not_negative)


def not_negative(x: float) -> bool:
    """Return whether x >= 0."""
    return x >= 0.0


@dataclass(frozen=True)
class Flag(Rule):
    """The rule of a flag: true or false."""

    def expected(self) -> str:
        """Return a phrase that says which values are allowed."""
        return "true or false"

    def __call__(self, value: Any) -> bool:
        """Return the value if it is a bool."""
        return value if isinstance(value, bool) else self.refuse()


@dataclass(frozen=True)
class Name(Rule):
    """The rule of a name: a title that also serves as a file's name."""

    def expected(self) -> str:
        """Return a phrase that says which values are allowed."""
        return "1 to 200 printable characters without / and \\"

    def __call__(self, value: Any) -> str:
        """Return the value if it is a valid name."""
        if not isinstance(value, str) or not value.isprintable() or set(value) & set("/\\"):
            self.refuse()
        return value if value.strip() and len(value) <= 200 else self.refuse()


@dataclass(frozen=True)
class Text(Rule):
    """The rule of a line of text that tools show."""

    def expected(self) -> str:
        """Return a phrase that says which values are allowed."""
        return "at most 1000 printable characters"

    def __call__(self, value: Any) -> str:
        """Return the text, if it is one line of that length."""
        return value if isinstance(value, str) and value.isprintable() and len(value) <= 1000 else self.refuse()


@dataclass(frozen=True)
class OneOf(Rule):
    """The rule of a choice: one of some words."""

    known: tuple[str, ...]
    words: str

    def expected(self) -> str:
        """Return a phrase that says which values are allowed."""
        return self.words

    def __call__(self, value: Any) -> str:
        """Return the word, if it is one of them."""
        return value if isinstance(value, str) and value in self.known else self.refuse()


@dataclass(frozen=True)
class Names(Rule):
    """The rule of a list of distinct, known names."""

    known: tuple[str, ...]
    least: int = 0

    def expected(self) -> str:
        """Return a phrase that says which values are allowed."""
        return f"a list of distinct names {self.choice()}"

    def choice(self) -> str:
        """Return a phrase that lists the known names."""
        return f"out of {', '.join(self.known)}"

    def __call__(self, value: Any) -> tuple[str, ...]:
        """Return the names as a tuple."""
        if not isinstance(value, list | tuple) or not all(isinstance(name, str) for name in value):
            self.refuse()
        for name in value:
            if name not in self.known:
                if near := closest(name, self.known):
                    raise ValueError(f"{near} in place of {shown(name)}, or another {self.choice()}")
                self.refuse(f", not {shown(name)}")
        if len(set(value)) < len(value):
            twice = next(name for name in value if value.count(name) > 1)
            raise ValueError(f"each name once, not {value.count(twice)} times {twice}")
        if len(value) < self.least:
            self.refuse(", at least one")
        return tuple(value)


def closest(name: str, known: Iterable[str]) -> str:
    """Return the known name closest to a mistyped one, or an empty string if none is close."""
    lower = {k.lower(): k for k in known}
    near = difflib.get_close_matches(name.lower(), lower, n=1)
    return lower[near[0]] if near else ""
