"""Named tuples of numbers as flat records: kernels that store and read them, made from their fields."""

import sys
from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar, get_args, get_type_hints

from .compile.decorator import kernel

R = TypeVar("R")


class Record(NamedTuple):
    """The kernels of one kind of named tuple: `size, put, read, flatten = record(Kind)`."""

    size: int
    """How many numbers it holds."""
    put: Any
    """`put(z, i, value)` stores the value from z[i] on."""
    read: Any
    """`read(numbers)` returns the value whose numbers a buffer's slice or a flat tuple holds."""
    flatten: Any
    """`flatten(value)` returns its numbers as one flat tuple."""


def record(kind: type[tuple[Any, ...]], size: int = 0) -> Record:
    """Return the kernels that store and read a named tuple of floats, tuples of floats, and named tuples of these.

    size: how many numbers `flatten` gives at least; it fills up with zeros.
    """
    name, paths = kind.__name__, _paths(kind, "value")
    stores = [f"    z[i + {k}] = {path}" for k, path in enumerate(paths)]
    names = {part.__name__: part for part in _named(kind)}
    put = _kernel(kind, names, f"put_{name}", "(z, i, value):", *stores)
    read = _kernel(
        kind, names, f"read_{name}", "(numbers):", f"    return {_expression(kind, iter(range(len(paths))))}"
    )
    padded = [*paths, *["0.0"] * (size - len(paths))]
    flatten = _kernel(kind, names, f"flatten_{name}", "(value):", f"    return ({', '.join(padded)},)")
    return Record(len(paths), put, read, flatten)


def _kernel(kind: Any, scope: dict[str, Any], name: str, *lines: str) -> Callable[..., Any]:
    """Compile generated source as a kernel of the module that defines the named tuple, whose cache it shares."""
    module = sys.modules[kind.__module__]
    made = scope | {"__name__": kind.__module__}
    exec(compile("\n".join([f"def {name}{lines[0]}", *lines[1:]]), str(module.__file__), "exec"), made)
    return kernel(made[name])


def _fields(kind: Any) -> dict[str, Any]:
    """Return the types of a tuple's fields, by what follows the tuple in an expression."""
    if hasattr(kind, "_fields"):
        return {f".{name}": part for name, part in get_type_hints(kind).items()}
    return {f"[{i}]": part for i, part in enumerate(get_args(kind))}


def _paths(kind: Any, value: str) -> list[str]:
    """Return the expressions of all numbers of a value, in order."""
    if kind is float:
        return [value]
    return [path for step, part in _fields(kind).items() for path in _paths(part, value + step)]


def _expression(kind: Any, places: Any) -> str:
    """Return the expression that makes a value of numbers[0], numbers[1], ..."""
    if kind is float:
        return f"numbers[{next(places)}]"
    parts = [_expression(part, places) for part in _fields(kind).values()]
    return f"{kind.__name__}({', '.join(parts)})" if hasattr(kind, "_fields") else f"({', '.join(parts)},)"


def _named(kind: Any) -> list[Any]:
    """Return the named tuples that a value is made of."""
    own = [kind] if hasattr(kind, "_fields") else []
    return own + [named for part in _fields(kind).values() if part is not float for named in _named(part)]
