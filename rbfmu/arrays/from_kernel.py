"""Array functions from scalar kernels: NumPy broadcasting, `out=`, compiled at the first call, threads on request."""

import itertools
import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextvars import copy_context
from functools import partial
from typing import Any

import numpy as np

from rbfmu.arrays.argument_names import documented_by, in_order
from rbfmu.arrays.errors import clear_error
from rbfmu.arrays.singular import Singular, warn_of_singular
from rbfmu_kernels.compile.array_functions.gufunc import STREAMED, gufuncs
from rbfmu_kernels.compile.shapes import core_shapes, python_function
from rbfmu_kernels.rotations.euler_angles import sequence

CHUNK = 16384  # items that a thread takes at a time, at least
CHUNKS = 4  # of a large call, for each thread: the cores are seldom equally free, and a chunk costs some microseconds
THRESHOLD = 16 * CHUNK  # items from which on threads pay

_threads = 1
_pool: ThreadPoolExecutor | None = None


def set_threads(n: int) -> None:
    """Let array functions use n threads, the caller's included, on some 3e5 items and more. The default is 1.

    With more than one, calls on fewer items take some 0.3 us longer.
    """
    global _threads, _pool
    if n < 1:
        raise ValueError(f"set_threads: n must be at least 1, got {n}")
    # The pool before is not shut down: calls that hold it end with it, and then its threads end with their pool.
    _threads, _pool = n, ThreadPoolExecutor(n - 1, "rbfmu") if n > 1 else None


def array_function(
    kernel: Callable[..., Any], *constants: int, singular: Singular | None = None, warning: str = ""
) -> Callable[..., Any]:
    """Return the array function of a scalar kernel: same name, arguments and docstring, any leading axes.

    singular: a kernel of the first few arguments; where it is true for an item, the warning of that text is given.
    """
    loops: Any = None  # gufuncs of whole arrays, and of pieces
    limits: list[tuple[int, int]] = []  # of each argument: core axes and one more, numbers of an item
    report = partial(warn_of_singular, warning) if singular else None

    @documented_by(kernel)
    def call(*args: Any, **kwargs: Any) -> Any:
        nonlocal loops
        if kwargs:
            args, kwargs = in_order(kernel, args, kwargs)
            if loops and report and "axes" in kwargs:
                kwargs["axes"] = [(), *kwargs["axes"]]  # the mark's
        pool = _pool  # another thread may set it meanwhile
        few = pool is None or _are_few(args, limits)
        try:
            if report is None:
                return loops[0](*args, **kwargs) if few else _in_threads(pool, loops, kernel, args, kwargs)
            mark = np.zeros(())
            result = loops[0](mark, *args, **kwargs) if few else _in_threads(pool, loops, kernel, args, kwargs, mark)
            if mark:
                report()
            return result
        except TypeError as error:
            if loops is not None:
                raise clear_error(kernel, args, kwargs, error) from None
        except ValueError as error:
            raise clear_error(kernel, args, kwargs, error) from None
        loops = gufuncs(kernel, *constants, singular=singular)
        limits[:] = [(len(shape) + 1, math.prod(shape)) for shape in core_shapes(kernel)[0].values()]
        return call(*args, **kwargs)

    return call


def checked_function(kernel: Callable[..., Any], singular: Singular, warning: str) -> Callable[..., Any]:
    """Return the array function of a kernel, whose warning begins with its name."""
    return array_function(kernel, singular=singular, warning=f"{python_function(kernel).__name__}: {warning}")


def sequence_function(
    kernel: Callable[..., Any], singular: Singular | None = None, warning: Callable[[str], str] = str
) -> Callable[..., Any]:
    """Return the array function of a kernel of Euler angles: it is compiled once for each sequence.

    singular: as of `array_function`; warning: what is said then, by the sequence's name.
    """
    functions: dict[str, Callable[..., Any]] = {}

    @documented_by(kernel)
    def call(seq: str, *args: Any, **kwargs: Any) -> Any:
        try:
            function = functions[seq]
        except (KeyError, TypeError):
            number = sequence(seq)
            said = f"{call.__name__}: {warning(seq)}"
            function = functions[seq] = array_function(kernel, number, singular=singular, warning=said)
        return function(*args, **kwargs)

    return call


def _are_few(args: Any, limits: list[tuple[int, int]]) -> bool:
    """Return, after a quick look, whether arguments have one leading axis at most and fewer items than a bound."""
    try:
        for array, (axes, size) in zip(args, limits):  # noqa: B905 - naming `strict` costs half as much as the rest
            if array.ndim > axes or array.size >= THRESHOLD * size:
                return False
    except AttributeError:  # no array
        return False
    return True


def _in_threads(pool: Any, loops: Any, kernel: Any, args: Any, kwargs: dict[str, Any], *mark: Any) -> Any:
    """Make the call in chunks along its longest leading axis; as a whole where it is small or unusual."""
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
    outs: tuple[Any, ...] = out if isinstance(out, tuple) else (out,) * len(results)
    outs = tuple(np.empty(leading + s) if o is None else o for o, s in zip(outs, results, strict=True))
    if any(o.shape != leading + s for o, s in zip(outs, results, strict=True)) or _overlap(arrays, outs):
        return whole(*mark, *args, **kwargs)
    axis = int(np.argmax(leading)) - len(leading)  # counted from the last leading axis: -1 is the last
    items = math.prod(leading)
    rows = max(1, max(CHUNK, items // (CHUNKS * _threads)) * leading[axis] // items)

    def cut(array: Any, shape: tuple[int, ...], piece: slice) -> Any:
        position = array.ndim - len(shape) + axis
        if position < 0 or array.shape[position] == 1:
            return array
        return array[(slice(None),) * position + (piece,)]

    of_chunk = pieces if sum(o.nbytes for o in outs) >= STREAMED else whole
    starts = iter(range(0, leading[axis], rows))  # shared: whoever is free takes the next chunk

    def work() -> None:
        for start in starts:
            piece = slice(start, start + rows)
            inputs = [cut(a, s, piece) for a, s in zip(arrays, shapes, strict=True)]
            of_chunk(*mark, *inputs, out=tuple(cut(o, s, piece) for o, s in zip(outs, results, strict=True)))

    others = [pool.submit(copy_context().run, work) for _ in range(_threads - 1)]
    try:
        work()
    finally:
        for other in others:
            other.result()
    return outs if len(outs) > 1 else outs[0]


def _overlap(arrays: Any, outs: Any) -> bool:
    """Return whether a chunk's results may be written over what another chunk reads or writes.

    NumPy reads a copy where results overlap arguments, within one call; each chunk is a call of its own. An argument
    that is the result itself is cut as that is, so that each chunk overlaps itself alone.
    """
    pairs = [*itertools.product(arrays, outs), *itertools.combinations(outs, 2)]
    return any(np.may_share_memory(a, o, 1) and not _are_same(a, o) for a, o in pairs)  # type: ignore[arg-type]  # as hard as ufuncs try


def _are_same(a: Any, b: Any) -> bool:
    return bool(a.shape == b.shape and a.strides == b.strides and a.ctypes.data == b.ctypes.data)
