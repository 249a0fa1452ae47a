"""Makes an array function (a NumPy gufunc with fixed core sizes) from a scalar kernel's one definition.

The loop is generated as source and compiled by `numba.cfunc` at the first call: contiguous rows take a loop
that LLVM vectorises, all else (broadcasting, slices, transposes) one that follows the strides.
"""

import inspect
from collections.abc import Callable
from typing import Any

import numpy as np
from numba import carray, cfunc, config, float64, intp, types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np.ufunc import _internal

from .shapes import Shape, shape_of, shapes_of_result

_LOOP_SIGNATURE = types.void(
    types.CPointer(types.CPointer(float64)), types.CPointer(intp), types.CPointer(intp), types.voidptr
)
_clear_float_flags = types.ExternalFunction("feclearexcept", types.int32(types.int32))
_ALL_FLAGS = 0x3D  # FE_ALL_EXCEPT of x86; its bits contain those of the other platforms


@intrinsic
def _at(typingctx: Any, pointer: Any, offset: Any) -> Any:
    """The address `offset` bytes after a double*."""
    signature = types.CPointer(float64)(types.CPointer(float64), intp)

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return cgutils.pointer_add(builder, args[0], args[1])

    return signature, generate


def core_shapes(kernel: Callable[..., Any]) -> tuple[dict[str, Shape], list[Shape]]:
    """Argument names with core shapes, and result shapes, from the kernel's annotations (ints are left out)."""
    signature = inspect.signature(python_function(kernel))
    arguments = {n: shape_of(p.annotation) for n, p in signature.parameters.items() if p.annotation is not int}
    return arguments, shapes_of_result(signature.return_annotation)


def python_function(kernel: Callable[..., Any]) -> Callable[..., Any]:
    """The undecorated function of a kernel (the kernel itself where numba's JIT is disabled)."""
    return getattr(kernel, "py_func", kernel)


def gufunc(kernel: Callable[..., Any], *constants: int) -> np.ufunc:
    """A gufunc that maps `kernel(*constants, ...)` over leading axes. Compiles now (or loads from the cache)."""
    arguments, results = core_shapes(kernel)
    if config.DISABLE_JIT:
        return _interpreted(kernel, constants, [*arguments.values()], results)
    name = python_function(kernel).__name__
    source = _loop_source(name, constants, [*arguments.values()], results)
    filename = inspect.getfile(python_function(kernel))  # so that the cache is kept beside the kernel's
    scope: dict[str, Any] = {"__name__": python_function(kernel).__module__, "carray": carray, "_at": _at}
    scope |= {"kernel": kernel, "clear_float_flags": _clear_float_flags}
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
    return _internal.fromfunc(  # type: ignore[no-any-return]
        name, kernel.__doc__ or "", [compiled.address], [double], len(arguments), len(results), [None], compiled, -1,
        layout, (),
    )  # fmt: skip


def _layout(shapes: list[Shape]) -> str:
    return ",".join("(" + ",".join(map(str, s)) + ")" for s in shapes)


def _loop_name(name: str, constants: tuple[int, ...]) -> str:
    return "_".join([name, "loop", *map(str, constants)])


def _cells(shape: Shape, cell: Callable[[tuple[int, ...]], str], index: tuple[int, ...] = ()) -> str:
    """Source text of a (nested) tuple of cells: `(a[i, 0], a[i, 1], a[i, 2])`."""
    if len(index) == len(shape):
        return cell(index)
    return "(" + ", ".join(_cells(shape, cell, (*index, i)) for i in range(shape[len(index)])) + ")"


def _loop_source(name: str, constants: tuple[int, ...], arguments: list[Shape], results: list[Shape]) -> str:
    shapes = arguments + results
    core_stride = len(shapes)  # in `steps`, the core strides follow one outer stride for each operand
    lines = [f"def {_loop_name(name, constants)}(args, dims, steps, data):", "    n = dims[0]"]
    conditions, strided, contiguous = [], [], []
    for k, shape in enumerate(shapes):
        size = int(np.prod(shape, dtype=int))
        lines.append(f"    p{k} = args[{k}]; s{k} = steps[{k}]")
        conditions.append(f"s{k} == {8 * size}")
        axes = range(core_stride, core_stride + len(shape))
        core_stride += len(shape)
        row_sizes = [8 * int(np.prod(shape[i + 1 :], dtype=int)) for i in range(len(shape))]
        conditions += [f"steps[{axis}] == {row}" for axis, row in zip(axes, row_sizes, strict=True)]

        def strided_cell(index: tuple[int, ...], k: int = k, axes: range = axes) -> str:
            offset = " + ".join([f"i * s{k}", *(f"{i} * c{axis}" for i, axis in zip(index, axes, strict=True))])
            return f"_at(p{k}, {offset})[0]"

        def contiguous_cell(index: tuple[int, ...], k: int = k, shape: Shape = shape, size: int = size) -> str:
            return f"a{k}[i, {np.ravel_multi_index(index, shape) if shape else 0}]"

        strided.append(_cells(shape, strided_cell))
        contiguous.append(_cells(shape, contiguous_cell))
    inputs = len(arguments)

    def call(cells: list[str]) -> str:
        return f"{', '.join(cells[inputs:])} = kernel({', '.join([*map(str, constants), *cells[:inputs]])})"

    lines.append(f"    if {' and '.join(conditions)}:")
    lines += [f"        a{k} = carray(p{k}, (n, {int(np.prod(s, dtype=int))}))" for k, s in enumerate(shapes)]
    lines += ["        for i in range(n):", f"            {call(contiguous)}"]
    lines.append("    else:")
    lines += [f"        c{axis} = steps[{axis}]" for axis in range(len(shapes), core_stride)]
    lines += ["        for i in range(n):", f"            {call(strided)}"]
    # Branch-free code evaluates what it does not select; its flags would become NumPy warnings.
    lines.append(f"    clear_float_flags({_ALL_FLAGS})")
    return "\n".join(lines) + "\n"


def _interpreted(kernel: Callable[..., Any], constants: tuple[int, ...], arguments: list[Shape],
                 results: list[Shape]) -> Any:  # fmt: skip
    """The same map without compilation, for NUMBA_DISABLE_JIT=1."""

    def one(*arrays: Any) -> Any:
        tuples = [_as_tuple(a) for a in arrays]
        value = kernel(*constants, *tuples)
        return np.asarray(value) if len(results) == 1 else tuple(map(np.asarray, value))

    letters = _layout(arguments) + "->" + _layout(results)
    named = "".join({"3": "k", "4": "q"}.get(c, c) for c in letters)
    mapped = np.vectorize(one, otypes=[float] * len(results), signature=named)

    def call(*args: Any, out: Any = None) -> Any:
        value = mapped(*(np.asarray(a, float) for a in args))
        if out is None:
            return value
        for target, part in zip(out if isinstance(out, tuple) else (out,), np.atleast_1d(value), strict=True):
            target[...] = part
        return out

    return call


def _as_tuple(array: Any) -> Any:
    return tuple(_as_tuple(a) for a in array) if np.ndim(array) else float(array)
