"""Names of an array function's arguments: calls by keyword, and what `help` shows."""

import inspect
from collections.abc import Callable
from functools import wraps
from typing import Any

from rbfmu_kernels.compile.shapes import core_shapes, python_function

_NUMPY_KEYWORDS = {"out", "where", "axes", "order", "subok", "casting", "dtype"}
_NAMED, _KEYWORD = inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY


def documented_by(kernel: Callable[..., Any]) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Give an array function the name, the docstring and the arguments of its kernel, and `out`."""
    function = python_function(kernel)
    names = function.__code__.co_varnames[: function.__code__.co_argcount]
    parameters = [inspect.Parameter(name, _NAMED) for name in names]
    parameters.append(inspect.Parameter("out", _KEYWORD, default=None))

    def decorate(call: Callable[..., Any]) -> Callable[..., Any]:
        named: Any = wraps(function, assigned=("__module__", "__name__", "__qualname__", "__doc__"))(call)
        named.__signature__ = inspect.Signature(parameters)
        return named  # type: ignore[no-any-return]

    return decorate


def in_order(
    kernel: Callable[..., Any], args: tuple[Any, ...], kwargs: dict[str, Any]
) -> tuple[tuple[Any, ...], dict[str, Any]]:
    """Put arguments given by name in their places. What is left of the keywords is NumPy's, such as `out`."""
    if kwargs.keys() <= _NUMPY_KEYWORDS:
        return args, kwargs
    name, names = python_function(kernel).__name__, list(core_shapes(kernel)[0])
    unknown = [key for key in kwargs if key not in names and key not in _NUMPY_KEYWORDS]
    if unknown:
        raise TypeError(f"{name}: unexpected keyword {unknown[0]!r}; arguments are {', '.join(names)}, out")
    twice = [key for key in names[: len(args)] if key in kwargs]
    if twice:
        raise TypeError(f"{name}: {twice[0]} is given twice, by position and by name")
    missing = [key for key in names[len(args) :] if key not in kwargs]
    if missing:
        raise TypeError(f"{name}: {' and '.join(missing)} missing; arguments are {', '.join(names)}, out")
    by_name = [kwargs[key] for key in names[len(args) :]]
    return (*args, *by_name), {key: value for key, value in kwargs.items() if key in _NUMPY_KEYWORDS}
