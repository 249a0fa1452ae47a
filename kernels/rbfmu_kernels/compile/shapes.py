"""What an array function is made of: a kernel, core shapes from its annotations, and source of what an item takes."""

import inspect
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any, NamedTuple

from ..types import Function, Shape, shape_of, shapes_of_result


def python_function(kernel: Function) -> Function:
    """Return the undecorated function of a kernel (the kernel itself where Numba's JIT is disabled)."""
    return getattr(kernel, "py_func", kernel)


@cache
def core_shapes(kernel: Function) -> tuple[dict[str, Shape], list[Shape]]:
    """Return argument names with core shapes, and result shapes (arguments that are int are left out)."""
    return _argument_shapes(kernel), shapes_of_result(inspect.signature(python_function(kernel)).return_annotation)


def _argument_shapes(kernel: Function) -> dict[str, Shape]:
    parameters = inspect.signature(python_function(kernel)).parameters
    return {name: shape_of(p.annotation) for name, p in parameters.items() if p.annotation is not int}


class Item(NamedTuple):
    """What is done for an item: `kernel(*constants, ...)`, after a look by `singular` at the first few arguments."""

    kernel: Function
    constants: tuple[int, ...] = ()
    singular: Callable[..., bool] | None = None

    @property
    def checked(self) -> int:
        """Return how many arguments `singular` looks at, 0 where there is no such."""
        return len(_argument_shapes(self.singular)) if self.singular else 0

    @property
    def inputs(self) -> list[Shape]:
        """Return the core shapes of arguments, after that of the mark, where there is one."""
        return [()] * bool(self.singular) + [*core_shapes(self.kernel)[0].values()]

    @property
    def results(self) -> list[Shape]:
        """Return the core shapes of results."""
        return core_shapes(self.kernel)[1]

    def layout(self, size: str = "") -> str:
        """Return the core shapes as NumPy takes them; size: what stands before each number."""
        before, after = (
            ",".join(f"({','.join(f'{size}{n}' for n in shape)})" for shape in shapes)
            for shapes in (self.inputs, self.results)
        )
        return f"{before}->{after}"

    def lines(self, items: Sequence[str], found: str) -> list[str]:
        """Return source that sets r0, r1, ... to the results; items: source of arguments; found: done if singular."""
        given = [*map(str, self.constants), *items]
        check = [f"if singular({', '.join(given[: len(self.constants) + self.checked])}): {found}"]
        names = ", ".join(f"r{k}" for k in range(len(self.results)))
        return check * bool(self.singular) + [f"{names} = kernel({', '.join(given)})"]

    def function(self, kind: str, head: str, lines: Sequence[str], names: dict[str, Any]) -> Function:
        """Return the function of source, as if it stood beside the kernel, where its code is cached then."""
        function = python_function(self.kernel)
        name = "_".join([function.__name__, kind, *map(str, self.constants)])
        scope = {"__name__": function.__module__, "kernel": self.kernel, "singular": self.singular, **names}
        source = "\n    ".join([f"def {name}({head}):", *lines]) + "\n"
        exec(compile(source, inspect.getfile(function), "exec"), scope)
        return scope[name]  # type: ignore[no-any-return]
