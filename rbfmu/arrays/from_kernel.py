"""Array functions made from scalar kernels: they broadcast, take `out=`, compile at the first call, can use threads."""

import inspect
import math
import os
import reprlib
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from contextvars import copy_context
from functools import partial, wraps
from numbers import Integral, Real
from typing import Any

import numpy as np

from rbfmu.exceptions import warn_caller
from rbfmu_kernels.compile.gufunc import STREAMED, Item, core_shapes, gufuncs
from rbfmu_kernels.rotations.euler_angles import sequence
from rbfmu_kernels.types import Array, Function, Shape, python_function

Arguments = tuple[Any, ...]
Keywords = dict[str, Any]

CHUNK = 16384  # the least number of items that a thread takes at a time
CHUNKS = 4  # per thread in a large call: cores are seldom equally free, and a chunk costs some microseconds
THRESHOLD = 16 * CHUNK  # the number of items from which on threads are faster

Singular = Callable[..., bool]
_threads = 1
_pool: ThreadPoolExecutor | None = None


def set_threads(n: int) -> None:
    """Let array functions use n threads, including the caller's, for about 3e5 items and more. The default is 1.

    With more than one thread, calls on fewer items take about 0.3 us longer. Raises ValueError for a wrong n.
    """
    global _threads, _pool
    if not isinstance(n, Integral) or isinstance(n, bool) or n < 1:
        raise ValueError(f"set_threads: n must be a whole number of at least 1, got {n!r}")
    n = int(n)
    # The former pool is not shut down, as calls may still use it. Its threads end when the last of these calls ends.
    _threads, _pool = n, ThreadPoolExecutor(n - 1, "rbfmu") if n > 1 else None


if hasattr(os, "register_at_fork"):  # a forked process has none of the pool's threads, and would wait for them for ever
    os.register_at_fork(after_in_child=lambda: set_threads(_threads))


def array_function(kernel: Function, *constants: int, singular: Singular | None = None, warning: str = "") -> Function:
    """Return the array function of a scalar kernel: with its name, arguments and docstring, for any leading axes.

    constants: leading arguments of the kernel that are fixed; singular: a kernel of the first few arguments; if it is
    true for an item, `warning` is given as a RuntimeWarning.
    """
    loops: Any = None  # two gufuncs, for whole arrays and for pieces of them, made at the first call
    shapes = core_shapes(kernel)[0].values()
    limits = [(len(shape) + 1, math.prod(shape)) for shape in shapes]  # (number of core axes + 1, numbers of an item)
    report = partial(warn_of_singular, warning) if singular else None

    @documented_by(kernel)
    def call(*args: Any, **kwargs: Any) -> Any:
        nonlocal loops
        if kwargs:
            args, kwargs = in_order(kernel, args, kwargs)
            if report and "axes" in kwargs:
                kwargs["axes"] = [(), *kwargs["axes"]]  # the first is for the mark
        if loops is None:
            loops = gufuncs(Item(kernel, constants, singular))
        pool = _pool  # another thread may change it during the call
        try:
            given = plain_arrays(args, len(limits))
            few = pool is None or _are_few(given, limits)
            if report is None:
                return loops[0](*given, **kwargs) if few else _in_threads(pool, loops, kernel, given, kwargs)
            mark = np.zeros(())
            result = loops[0](mark, *given, **kwargs) if few else _in_threads(pool, loops, kernel, given, kwargs, mark)
            if mark:
                report()
            return result
        except (TypeError, ValueError) as error:
            raise clear_error(kernel, args, kwargs, error) from None

    return call


def checked_function(kernel: Function, singular: Singular | None, warning: str, *constants: int) -> Function:
    """Return the array function of a kernel; its warning begins with its name."""
    text = f"{python_function(kernel).__name__}: {warning}"
    return array_function(kernel, *constants, singular=singular, warning=text)


def sequence_function(kernel: Function, singular: Singular | None = None, warning: str = "") -> Function:
    """Return the array function of a kernel of Euler angles, which is compiled once for each sequence.

    singular: as in `array_function`; warning: its text, in which {seq} is replaced by the sequence's name, and {poles}
    by the middle angles, in degrees, at which the outer axes are parallel.
    """
    functions: dict[str, Function] = {}

    @documented_by(kernel)
    def call(seq: str, *args: Any, **kwargs: Any) -> Any:
        try:
            function = functions[seq]
        except (KeyError, TypeError):
            number = sequence(seq)
            text = warning.format(seq=seq, poles="0 or 180" if seq[0] == seq[2] else "-90 or 90")
            function = functions[seq] = checked_function(kernel, singular, text, number)
        return function(*args, **kwargs)

    return call


def plain_arrays(args: Arguments, count: int) -> Arguments:
    """Return the arguments, the first `count` of them as NumPy's own arrays.

    Objects of pandas and xarray would take over the call: they align labels, and their errors name other shapes.
    """
    given = [a if type(a) is np.ndarray and a.dtype is _FLOAT64 else _plain_array(a) for a in args[:count]]
    return (*given, *args[count:])


_FLOAT64 = np.dtype(np.float64)


def _is_masked(value: object) -> bool:
    """Return whether an array has a mask; for plain arrays, the usual case, NumPy's masked arrays are not imported."""
    return type(value) is not np.ndarray and isinstance(value, np.ma.MaskedArray)


def _plain_array(value: object) -> Array:
    if _is_masked(value):
        raise ValueError(MASKED)
    array = np.asarray(value)
    if array.dtype == object and all(isinstance(number, Real) for number in array.flat):
        with suppress(OverflowError):  # objects: whole numbers beyond 64 bits, or a row of a table with words elsewhere
            return array.astype(np.float64)
    return array


MASKED = "must have no mask; x.filled(np.nan) of such an array x gives NaN where it is masked"


def _are_few(args: Arguments, limits: list[tuple[int, int]]) -> bool:
    """Return, quickly, whether each argument has at most one leading axis and fewer than `THRESHOLD` items."""
    for array, (axes, size) in zip(args, limits):  # noqa: B905, SIM110 - each would cost half as much as the rest
        if array.ndim > axes or array.size >= THRESHOLD * size:
            return False
    return True


def _in_threads(pool: Any, loops: Any, kernel: Function, args: Arguments, kwargs: Keywords, *mark: Array) -> Any:
    """Make the call in chunks along its longest leading axis; make it as a whole if it is small or unusual."""
    whole, pieces = loops
    arguments, results = core_shapes(kernel)
    shapes = [*arguments.values()]
    if len(args) != len(shapes) or kwargs.keys() - {"out"}:
        return whole(*mark, *args, **kwargs)
    arrays = [np.asarray(a) for a in args]
    depths = [a.ndim - len(s) for a, s in zip(arrays, shapes, strict=True)]
    leading = np.broadcast_shapes(*(a.shape[:d] for a, d in zip(arrays, depths, strict=True) if d > 0), ())
    if min(depths) < 0 or math.prod(leading) < THRESHOLD:
        return whole(*mark, *args, **kwargs)
    out = kwargs.get("out")
    outs: Arguments = out if isinstance(out, tuple) else (out,) * len(results)
    outs = tuple(np.empty(leading + s) if o is None else o for o, s in zip(outs, results, strict=True))
    fits = all(isinstance(o, np.ndarray) and o.shape == leading + s for o, s in zip(outs, results, strict=True))
    if not fits or _overlap(arrays, outs):
        return whole(*mark, *args, **kwargs)
    axis, items = int(np.argmax(leading)), math.prod(leading)
    rows = max(1, max(CHUNK, items // (CHUNKS * _threads)) * leading[axis] // items)
    inputs = [np.broadcast_to(a, leading + s) for a, s in zip(arrays, shapes, strict=True)]
    of_chunk = pieces if sum(o.nbytes for o in outs) >= STREAMED else whole
    starts = iter(range(0, leading[axis], rows))  # shared by all threads: a free one takes the next chunk

    def work() -> None:
        for start in starts:
            piece = (slice(None),) * axis + (slice(start, start + rows),)
            of_chunk(*mark, *(a[piece] for a in inputs), out=tuple(o[piece] for o in outs))

    others = [pool.submit(copy_context().run, work) for _ in range(_threads - 1)]
    try:
        work()
    finally:
        for other in others:
            other.result()
    return outs if len(outs) > 1 else outs[0]


def _overlap(arrays: Sequence[Array], outs: Sequence[Array]) -> bool:
    """Return whether the results of a chunk may overwrite what another chunk reads or writes.

    If results overlap arguments, NumPy reads a copy, but only within one call, and each chunk is a call of its own. An
    argument that is itself the result is cut in the same way, so that a chunk overlaps only itself.
    """
    pairs = [(a, o) for k, o in enumerate(outs) for a in (*arrays, *outs[:k])]
    return any(a is not o and np.may_share_memory(a, o, 1) for a, o in pairs)  # type: ignore[arg-type]  # as hard as ufuncs try


_NUMPY_KEYWORDS = {"out", "where", "axes", "order", "subok", "casting", "dtype"}
_SHORT = {"R": "R_ab", "q": "q_ab"}
"""Further names that an attitude may have as a keyword, as in `euler_from_quaternion("ZYX", q=q)`."""
_NAMED, _KEYWORD = inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY


# Names and shapes of arguments: calls by keyword, and what `help` shows


def documented_by(kernel: Function) -> Callable[[Function], Function]:
    """Give an array function the name, arguments and docstring of its kernel, with shapes added, and `out`."""
    function = python_function(kernel)
    names = function.__code__.co_varnames[: function.__code__.co_argcount]
    parameters = [inspect.Parameter(name, _NAMED) for name in names]
    parameters.append(inspect.Parameter("out", _KEYWORD, default=None))

    def decorate(call: Function) -> Function:
        named: Any = wraps(function, assigned=("__name__", "__qualname__"))(call)
        named.__module__ = "rbfmu"  # there pickle looks for it when it is sent to another process
        named.__signature__ = inspect.Signature(parameters)
        named.__doc__ = _with_shapes(inspect.getdoc(function) or "", kernel)
        return named  # type: ignore[no-any-return]

    return decorate


def _with_shapes(text: str, kernel: Function) -> str:
    """Return a docstring with a line about shapes before the one about units: `q_ab (4), v_b (3) -> (3)`."""
    arguments, results = core_shapes(kernel)
    takes = ", ".join(f"{name} {_in_brackets(shape)}" for name, shape in arguments.items())
    gives = ", ".join(map(_in_brackets, results))
    before, units, after = text.partition("\nUnits:")
    return f"{before}\nShapes: {takes} -> {gives}; leading axes broadcast.{units}{after}"


def _in_brackets(shape: Shape) -> str:
    return f"({', '.join(map(str, shape))})"


def _names(kernel: Function) -> list[str]:
    """Return the names of all arguments, including a sequence of Euler angles."""
    return [*inspect.signature(python_function(kernel)).parameters]


def in_order(kernel: Function, args: Arguments, kwargs: Keywords) -> tuple[Arguments, Keywords]:
    """Return (args, kwargs) with arguments given by name put in their places, and only NumPy's keywords, such as `out`.

    Raises TypeError for keywords that are unknown, given twice or missing.
    """
    if "out" in kwargs and kwargs["out"] is None:  # of several results NumPy refuses it
        kwargs = {key: value for key, value in kwargs.items() if key != "out"}
    if kwargs.keys() <= _NUMPY_KEYWORDS:
        return args, kwargs
    name, names = python_function(kernel).__name__, list(core_shapes(kernel)[0])
    for short, full in _SHORT.items():
        if short in kwargs and short not in names and full in names and full not in kwargs:
            kwargs = {full if key == short else key: value for key, value in kwargs.items()}
    known = f"arguments are {', '.join(_names(kernel))}, out"
    if unknown := [key for key in kwargs if key not in names and key not in _NUMPY_KEYWORDS]:
        raise TypeError(f"{name}: unexpected keyword {unknown[0]!r}; {known}")
    if twice := [key for key in names[: len(args)] if key in kwargs]:
        raise TypeError(f"{name}: {twice[0]} is given twice, by position and by name")
    if missing := [key for key in names[len(args) :] if key not in kwargs]:
        raise TypeError(f"{name}: {' and '.join(missing)} missing; {known}")
    by_name = [kwargs[key] for key in names[len(args) :]]
    return (*args, *by_name), {key: value for key, value in kwargs.items() if key in _NUMPY_KEYWORDS}


# Errors of NumPy, in words that name the argument


def clear_error(kernel: Function, args: Arguments, kwargs: Keywords, refused: Exception) -> Exception:
    """Return the error to raise in place of NumPy's `refused`."""
    shapes, results = core_shapes(kernel)
    name = python_function(kernel).__name__
    if not len(shapes) <= len(args) <= len(shapes) + len(results):
        names = _names(kernel)
        got = len(args) + len(names) - len(shapes)
        return TypeError(f"{name} takes {len(names)} arguments ({', '.join(names)}), got {got}")
    if error := _of_arguments(name, shapes, args) or _of_keywords(name, next(iter(shapes)), kwargs):
        return error
    leading = {n: np.shape(v)[: np.ndim(v) - len(s)] for (n, s), v in zip(shapes.items(), args, strict=False)}
    try:
        common = np.broadcast_shapes(*leading.values())
    except ValueError:
        return ValueError(f"{name}: leading shapes {leading} do not broadcast")
    if error := _of_out(name, results, common, args[len(shapes) :] or kwargs.get("out")):
        return error
    kind = TypeError if isinstance(refused, TypeError) else ValueError  # NumPy's own kinds take other arguments
    return refused if str(refused).startswith(f"{name}: ") else kind(f"{name}: {refused}")


def _of_arguments(name: str, shapes: dict[str, Shape], args: Arguments) -> Exception | None:
    for (argument, shape), value in zip(shapes.items(), args, strict=False):
        if wrong := no_numbers(value):
            return ValueError(f"{name}: {argument} {wrong}")
        array = _plain_array(value)
        if not np.can_cast(array.dtype, np.float64):
            return ValueError(f"{name}: {argument} must fit into float64, got {_brief(array)}; .astype rounds")
        if array.shape[array.ndim - len(shape) :] != shape or array.ndim < len(shape):
            are_moments = argument.partition("_")[0] == "M" and array.shape == (3,)  # of an inertia such as M_c
            hint = "; of principal moments give np.diag(moments)" if are_moments else ""
            return ValueError(f"{name}: {argument} must have trailing shape {shape}, got {array.shape}{hint}")
    return None


def no_numbers(value: object) -> str:
    """Return what is wrong with a value that must be real numbers; empty if nothing is."""
    if _is_masked(value):
        return MASKED
    try:
        kind = _plain_array(value).dtype.kind
    except ValueError:
        return f"must be a regular array of numbers, got {_brief(value)}"
    return "" if kind in "biuf" else f"must be real numbers, got {_brief(value)}"


def _brief(value: object) -> str:
    """Return a short text for a value, whatever its size."""
    return f"an array of {value.dtype}" if isinstance(value, np.ndarray) else reprlib.repr(value)


def _of_keywords(name: str, first: str, kwargs: Keywords) -> Exception | None:
    if "where" in kwargs:
        return TypeError(f"{name}: where is not supported; choose the items by an index, such as {first}[mask]")
    dtype = kwargs.get("dtype")
    if dtype is not None and dtype not in (float, np.float64, "d", "float64"):
        given = getattr(dtype, "__name__", dtype)
        return TypeError(f"{name}: dtype = {given}: all is computed in float64; use .astype on the result")
    return None


def _of_out(name: str, results: list[Shape], leading: tuple[int, ...], out: object) -> Exception | None:
    outs: Arguments = out if isinstance(out, tuple) else () if out is None else (out,)
    if outs and len(outs) != len(results):
        wanted = f"a tuple of {len(results)} arrays" if len(results) > 1 else "one array"
        return ValueError(f"{name}: out must be {wanted}, got {len(outs)}")
    for k, (array, core) in enumerate(zip(outs, results, strict=False)):
        label = f"{name}: out[{k}]" if len(results) > 1 else f"{name}: out"
        if array is None:
            continue
        if not isinstance(array, np.ndarray):
            return TypeError(f"{label} must be an array, got {_brief(array)}")
        if _is_masked(array):  # NumPy would join the masks of arguments of different shapes
            return ValueError(f"{label} must have no mask, as x.data of such an array x")
        if not _holds(array.shape, leading, core):
            return ValueError(f"{label} must have shape {leading + core}, got {array.shape}")
        if not np.can_cast(np.float64, array.dtype, "same_kind"):
            return TypeError(f"{label} must hold floats, got {array.dtype}")
        if not array.flags.writeable:
            return ValueError(f"{label} must be an array that can be written")
    return None


def _holds(shape: tuple[int, ...], leading: tuple[int, ...], core: Shape) -> bool:
    """Return whether results can be written to an array; NumPy repeats them along further leading axes."""
    axes = len(shape) - len(core)
    if axes < len(leading) or shape[axes:] != core:
        return False
    last = shape[axes - len(leading) : axes]
    return all(n in (1, m) for n, m in zip(leading, last, strict=True))


def as_floats(function: str, argument: str, value: object) -> Array:
    """Return an argument as an array of floats. Raises ValueError if it is not real numbers."""
    if wrong := no_numbers(value):
        raise ValueError(f"{function}: {argument} {wrong}")
    return np.asarray(_plain_array(value), dtype=np.float64)


# Warnings at singular arguments, with texts of our own, as NumPy would warn of a division by zero


def warn_of_singular(message: str) -> None:
    """Give a RuntimeWarning at the caller's line; NumPy's error state for divisions may ignore it or raise instead."""
    mode = np.geterr()["divide"]
    if mode == "raise":
        raise FloatingPointError(message)
    if mode != "ignore":
        warn_caller(message, RuntimeWarning)
