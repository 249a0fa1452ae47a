"""Names and shapes of an array function's arguments: calls by keyword, and what `help` shows."""

import inspect
from collections.abc import Callable
from functools import wraps
from typing import Any

from rbfmu_kernels.compile.shapes import core_shapes, python_function
from rbfmu_kernels.types import Shape

_NUMPY_KEYWORDS = {"out", "where", "axes", "order", "subok", "casting", "dtype"}
_NAMED, _KEYWORD = inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY


def documented_by(kernel: Callable[..., Any]) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Give an array function the name, the docstring with shapes and the arguments of its kernel, and `out`."""
    function = python_function(kernel)
    names = function.__code__.co_varnames[: function.__code__.co_argcount]
    parameters = [inspect.Parameter(name, _NAMED) for name in names]
    parameters.append(inspect.Parameter("out", _KEYWORD, default=None))

    def decorate(call: Callable[..., Any]) -> Callable[..., Any]:
        named: Any = wraps(function, assigned=("__module__", "__name__", "__qualname__"))(call)
        named.__signature__ = inspect.Signature(parameters)
        named.__doc__ = _with_shapes(inspect.getdoc(function) or "", kernel)
        return named  # type: ignore[no-any-return]

    return decorate


def shapes_in_words(kernel: Callable[..., Any]) -> str:
    """Return the shapes of one item, such as `q_ab (4), v_b (3) -> (3)`, from the kernel's annotations."""
    arguments, results = core_shapes(kernel)
    before = ", ".join(f"{name} {_in_brackets(shape)}" for name, shape in arguments.items())
    return f"{before} -> {', '.join(map(_in_brackets, results))}"


def _in_brackets(shape: Shape) -> str:
    return f"({', '.join(map(str, shape))})"


def _with_shapes(text: str, kernel: Callable[..., Any]) -> str:
    """Return a docstring with a line about shapes before that about units."""
    before, units, after = text.partition("\nUnits:")
    return f"{before}\nShapes: {shapes_in_words(kernel)}; leading axes broadcast.{units}{after}"


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
