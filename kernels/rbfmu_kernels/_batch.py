"""Makes an array function (a NumPy gufunc with fixed core sizes) from a scalar kernel's one definition.

The loop is generated as source and compiled by `numba.cfunc` at the first call. LLVM vectorises it over items:
directly where items are short and contiguous; all else (matrices, broadcasting, slices, transposes) goes through
a small tile on the stack in which a number's values for successive items are neighbours.
"""

import inspect
import math
import platform
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from llvmlite import ir
from numba import carray, cfunc, config, float64, intp, types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np.ufunc import _internal  # type: ignore[attr-defined]

from ._kernel import SOURCES
from .shapes import Shape, shape_of, shapes_of_result

_LOOP_SIGNATURE = types.void(
    types.CPointer(types.CPointer(float64)), types.CPointer(intp), types.CPointer(intp), types.voidptr
)
_clear_float_flags = types.ExternalFunction("feclearexcept", types.int32(types.int32))
_raise_float_flags = types.ExternalFunction("feraiseexcept", types.int32(types.int32))
_TILE = 32  # items
_DIVISION_BY_ZERO = 0x04 if platform.machine() in ("x86_64", "AMD64") else 0x02  # FE_DIVBYZERO
_ALL_FLAGS = 0x3D  # FE_ALL_EXCEPT of x86; its bits contain those of the other platforms


@intrinsic  # type: ignore[untyped-decorator]
def _at(typingctx: Any, pointer: Any, offset: Any) -> Any:
    """The address `offset` bytes after a double*."""
    signature = types.CPointer(float64)(types.CPointer(float64), intp)

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return cgutils.pointer_add(builder, args[0], args[1])

    return signature, generate


@intrinsic(prefer_literal=True)  # type: ignore[untyped-decorator]
def _scratch(typingctx: Any, size: Any) -> Any:
    """Address of `size` (a literal) doubles on the stack."""
    signature = types.CPointer(float64)(size)

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        array = cgutils.alloca_once(builder, ir.ArrayType(ir.DoubleType(), size.literal_value))
        array.align = 64
        return builder.bitcast(array, ir.DoubleType().as_pointer())

    return signature, generate


@intrinsic  # type: ignore[untyped-decorator]
def _scalar(typingctx: Any) -> Any:
    """An empty instruction that keeps LLVM from vectorising a copying loop: its gathers and scatters are slow."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        builder.asm(ir.FunctionType(ir.VoidType(), []), "", "~{memory}", [], True)
        return context.get_dummy_value()

    return types.void(), generate


@cache
def core_shapes(kernel: Callable[..., Any]) -> tuple[dict[str, Shape], list[Shape]]:
    """Argument names with core shapes, and result shapes, from the kernel's annotations (ints are left out)."""
    return _argument_shapes(kernel), shapes_of_result(inspect.signature(python_function(kernel)).return_annotation)


def _argument_shapes(kernel: Callable[..., Any]) -> dict[str, Shape]:
    parameters = inspect.signature(python_function(kernel)).parameters
    return {name: shape_of(p.annotation) for name, p in parameters.items() if p.annotation is not int}


def python_function(kernel: Callable[..., Any]) -> Callable[..., Any]:
    """The undecorated function of a kernel (the kernel itself where numba's JIT is disabled)."""
    return getattr(kernel, "py_func", kernel)


def gufunc(kernel: Callable[..., Any], *constants: int, singular: Callable[..., bool] | None = None) -> Any:
    """A gufunc that maps `kernel(*constants, ...)` over leading axes. Compiles now (or loads from the cache).

    singular: a kernel of the first few arguments; where it is true for an item, NumPy reports a division by zero
    (by default a RuntimeWarning).
    """
    arguments, results = core_shapes(kernel)
    if config.DISABLE_JIT:
        return interpreted(kernel, *constants, singular=singular)
    name = python_function(kernel).__name__
    checked = len(_argument_shapes(singular)) if singular else 0
    source = _loop_source(name, constants, [*arguments.values()], results, checked)
    filename = inspect.getfile(python_function(kernel))  # so that the cache is kept beside the kernel's
    scope: dict[str, Any] = {"__name__": python_function(kernel).__module__, "carray": carray, "kernel": kernel}
    scope |= {"singular": singular, "raise_float_flags": _raise_float_flags}
    scope |= {"_at": _at, "_scratch": _scratch, "_scalar": _scalar, "clear_float_flags": _clear_float_flags}
    exec(compile(source, filename, "exec"), scope)
    loop = scope[_loop_name(name, constants)]
    options = {"error_model": "numpy", "nopython": True}
    try:
        compiled = cfunc(_LOOP_SIGNATURE, cache=True, **options)(loop)
    except RuntimeError:  # no folder for the cache can be written
        compiled = cfunc(_LOOP_SIGNATURE, **options)(loop)
    layout = _layout([*arguments.values()]) + "->" + _layout(results)
    operands = len(arguments) + len(results)
    double = [np.dtype(np.float64).num] * operands
    return _internal.fromfunc(
        name, kernel.__doc__ or "", [compiled.address], [double], len(arguments), len(results), [None], compiled, -1,
        layout, (),
    )  # fmt: skip


def _layout(shapes: list[Shape]) -> str:
    return ",".join("(" + ",".join(map(str, s)) + ")" for s in shapes)


def _loop_name(name: str, constants: tuple[int, ...]) -> str:
    return "_".join([name, "loop", *map(str, constants), SOURCES])


def _loop_source(
    name: str, constants: tuple[int, ...], arguments: list[Shape], results: list[Shape], checked: int
) -> str:
    """The loop over items. Operands of up to 4 contiguous numbers are vectorised as they lie in memory.

    checked: how many arguments `singular` takes (0: there is nothing to check).
    """
    operands = _operands(arguments + results)
    inputs = len(arguments)
    lines = [f"def {_loop_name(name, constants)}(args, dims, steps, data):", "    n = dims[0]"]
    lines += [f"    p{o.k} = args[{o.k}]; s{o.k} = steps[{o.k}]" for o in operands]

    fixed = [*map(str, constants)]
    # Branch-free code evaluates what it does not select; its flags would become NumPy warnings.
    end = [f"clear_float_flags({_ALL_FLAGS})"]
    if checked:
        lines.append("    found = 0")
        end += ["if found > 0:", f"    raise_float_flags({_DIVISION_BY_ZERO})"]

    def body(cells: list[str]) -> list[str]:
        call = f"{', '.join(cells[inputs:])} = kernel({', '.join([*fixed, *cells[:inputs]])})"
        test = f"found += 1 if singular({', '.join([*fixed, *cells[:checked]])}) else 0"
        return [test, call] if checked else [call]

    leaves_gaps = bool(constants and checked)  # rates of Euler angles leave one out: LLVM would gather, slow in memory
    if all(o.size <= 4 for o in operands) and not leaves_gaps:
        lines.append(f"    if {' and '.join(condition for o in operands for condition in o.contiguity())}:")
        lines += [f"        a{o.k} = carray(p{o.k}, (n, {o.size}))" for o in operands]
        lines.append("        for i in range(n):")
        lines += ["            " + line for line in body([o.cells(o.in_array) for o in operands])]
        lines += ["        " + line for line in [*end, "return"]]
    cells_of_tile = _TILE * sum(o.size for o in operands)
    lines += [f"    c{o.k}_{axis} = steps[{axis}]" for o in operands for axis in o.axes]
    lines.append(f"    tile = carray(_scratch({cells_of_tile}), ({cells_of_tile},))")
    lines += [f"    for start in range(0, n, {_TILE}):", f"        m = min({_TILE}, n - start)"]
    for o in operands[:inputs]:
        lines += _per_item([f"{o.in_tile(index)} = {o.strided(index)}" for index in np.ndindex(*o.shape)])
    lines.append("        for i in range(m):")
    lines += ["            " + line for line in body([o.cells(o.in_tile) for o in operands])]
    for o in operands[inputs:]:
        lines += _per_item([f"{o.strided(index)} = {o.in_tile(index)}" for index in np.ndindex(*o.shape)])
    return "\n".join([*lines, *("    " + line for line in end)]) + "\n"


def _per_item(moves: list[str]) -> list[str]:
    return ["        for i in range(m):", *("            " + move for move in moves), "            _scalar()"]


@dataclass(frozen=True)
class _Operand:
    """Argument or result k of a loop: the source text of its cells, as they lie in memory and in the tile."""

    k: int
    shape: Shape
    axes: range  # where `steps` has the strides of its core axes
    first_row: int  # in the tile

    @property
    def size(self) -> int:
        return math.prod(self.shape)

    def contiguity(self) -> list[str]:
        rows = [8 * math.prod(self.shape[i + 1 :]) for i in range(len(self.shape))]
        return [f"s{self.k} == {8 * self.size}"] + [f"steps[{a}] == {r}" for a, r in zip(self.axes, rows, strict=True)]

    def _flat(self, index: Shape) -> int:
        return sum(i * math.prod(self.shape[axis + 1 :]) for axis, i in enumerate(index))

    def in_array(self, index: Shape) -> str:
        return f"a{self.k}[i, {self._flat(index)}]"

    def in_tile(self, index: Shape) -> str:
        return f"tile[{_TILE * (self.first_row + self._flat(index))} + i]"

    def strided(self, index: Shape) -> str:
        terms = [f"{i} * c{self.k}_{axis}" for i, axis in zip(index, self.axes, strict=True)]
        return f"_at(p{self.k}, {' + '.join([f'(start + i) * s{self.k}', *terms])})[0]"

    def cells(self, cell: Callable[[Shape], str], index: Shape = ()) -> str:
        """A (nested) tuple of cells, such as `(a0[i, 0], a0[i, 1], a0[i, 2])`."""
        if len(index) == len(self.shape):
            return cell(index)
        return "(" + ", ".join(self.cells(cell, (*index, i)) for i in range(self.shape[len(index)])) + ")"


def _operands(shapes: list[Shape]) -> list[_Operand]:
    operands: list[_Operand] = []
    axis, row = len(shapes), 0  # in `steps`, the core strides follow one outer stride for each operand
    for k, shape in enumerate(shapes):
        operands.append(_Operand(k, shape, range(axis, axis + len(shape)), row))
        axis, row = axis + len(shape), row + operands[-1].size
    return operands


def interpreted(kernel: Callable[..., Any], *constants: int, singular: Callable[..., bool] | None = None) -> Any:
    """The same map item by item, without compilation (for NUMBA_DISABLE_JIT=1)."""
    arguments, results = core_shapes(kernel)
    shapes = [*arguments.values()]
    checked = len(_argument_shapes(singular)) if singular else 0

    def call(*args: Any, out: Any = None) -> Any:
        if len(args) != len(shapes):
            raise TypeError(f"{len(shapes)} arguments are needed")
        arrays = [np.asarray(a) for a in args]
        if any(a.dtype.kind not in "biuf" for a in arrays):
            raise TypeError("not real numbers")
        if any(a.shape[a.ndim - len(s) :] != s for a, s in zip(arrays, shapes, strict=True)):
            raise ValueError("wrong trailing shape")
        leading = np.broadcast_shapes(*(a.shape[: a.ndim - len(s)] for a, s in zip(arrays, shapes, strict=True)))
        arrays = [np.broadcast_to(a, leading + s) for a, s in zip(arrays, shapes, strict=True)]
        outs = out if isinstance(out, tuple) else (out,) * len(results)
        outs = tuple(np.empty(leading + s) if o is None else o for o, s in zip(outs, results, strict=True))
        for index in np.ndindex(*leading):
            items = [_as_tuple(a[index]) for a in arrays]
            if singular and singular(*constants, *items[:checked]):
                warnings.warn(f"divide by zero encountered in {kernel.__name__}", RuntimeWarning, stacklevel=3)
            value = kernel(*constants, *items)
            for target, part in zip(outs, value if len(results) > 1 else (value,), strict=True):
                target[index] = part
        values = tuple(o[()] if out is None else o for o in outs)
        return values if len(values) > 1 else values[0]

    return call


def _as_tuple(array: Any) -> Any:
    return tuple(_as_tuple(a) for a in array) if np.ndim(array) else float(array)
