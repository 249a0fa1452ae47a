"""A tile: numbers of sixteen items on the stack, a number's values for successive items side by side.

Numba's intrinsics behind the loops of `_batch`: moves between memory and tile, and hints to LLVM.
"""

import math
from typing import Any

import numpy as np
from llvmlite import ir
from numba import float64, intp, types
from numba.core import cgutils
from numba.extending import intrinsic

ITEMS = 16
_LANES = 8  # items that are transposed at a time
_AHEAD = 2048  # bytes: how far ahead of the tile memory is asked for
_POINTER = types.CPointer(float64)
_double, _int32 = ir.DoubleType(), ir.IntType(32)
_byte_pointer = ir.IntType(8).as_pointer()


@intrinsic  # type: ignore[untyped-decorator]
def address(typingctx: Any, pointer: Any, offset: Any) -> Any:
    """The address `offset` bytes after a double*."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return cgutils.pointer_add(builder, args[0], args[1])

    return _POINTER(_POINTER, intp), generate


@intrinsic(prefer_literal=True)  # type: ignore[untyped-decorator]
def tile_of(typingctx: Any, rows: Any) -> Any:
    """A tile with `rows` (a literal) numbers for each item, in a function that may use the widest vectors there are."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        set.add(builder.function.attributes, '"prefer-vector-width"="512"')  # not among those that llvmlite checks for
        array = cgutils.alloca_once(builder, ir.ArrayType(_double, ITEMS * rows.literal_value))
        array.align = 64
        return builder.bitcast(array, _double.as_pointer())

    return _POINTER(rows), generate


@intrinsic(prefer_literal=True)  # type: ignore[untyped-decorator]
def to_tile(typingctx: Any, tile: Any, items: Any, row: Any, size: Any) -> Any:
    """Sixteen items of `size` numbers, packed at `items`, to the tile's rows from `row` on."""
    first, width = row.literal_value, size.literal_value

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        for half in range(0, ITEMS, _LANES):
            _ask_for(builder, args[1], half * width, width, writing=False)
            for n, column in enumerate(_columns(builder, args[1], half * width, width)):
                _store(builder, column, args[0], (first + n) * ITEMS + half)

    return types.void(_POINTER, _POINTER, row, size), _without_result(generate)


@intrinsic(prefer_literal=True)  # type: ignore[untyped-decorator]
def from_tile(typingctx: Any, tile: Any, items: Any, row: Any, size: Any) -> Any:
    """The tile's rows from `row` on to sixteen items of `size` numbers, packed at `items`."""
    first, width = row.literal_value, size.literal_value

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        for half in range(0, ITEMS, _LANES):
            _ask_for(builder, args[1], half * width, width, writing=True)
            rows = range(first, first + width)
            columns = [_load(builder, args[0], n * ITEMS + half, _LANES) for n in rows]
            _store_items(builder, columns, args[1], half * width)

    return types.void(_POINTER, _POINTER, row, size), _without_result(generate)


@intrinsic(prefer_literal=True)  # type: ignore[untyped-decorator]
def item_to_tile(typingctx: Any, column: Any, item: Any, row: Any, shape: Any, strides: Any) -> Any:
    """One item anywhere in memory to the tile, `column` being the address of its place in the first row.

    shape: of the item, such as (3, 3); strides: in bytes.
    """

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        cells = _cells(builder, args[0], row.literal_value, _lengths(shape))
        for cell, place in zip(cells, _places(builder, args[1], args[4], _lengths(shape)), strict=True):
            builder.store(builder.load(place), cell)
        _keep_scalar(builder)

    return types.void(_POINTER, _POINTER, row, shape, strides), _without_result(generate)


@intrinsic(prefer_literal=True)  # type: ignore[untyped-decorator]
def item_from_tile(typingctx: Any, column: Any, item: Any, row: Any, shape: Any, strides: Any) -> Any:
    """The same back."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        cells = _cells(builder, args[0], row.literal_value, _lengths(shape))
        for cell, place in zip(cells, _places(builder, args[1], args[4], _lengths(shape)), strict=True):
            builder.store(builder.load(cell), place)
        _keep_scalar(builder)

    return types.void(_POINTER, _POINTER, row, shape, strides), _without_result(generate)


@intrinsic(prefer_literal=True)  # type: ignore[untyped-decorator]
def read(typingctx: Any, column: Any, row: Any, shape: Any) -> Any:
    """An item of the tile as a number or a (nested) tuple."""
    lengths = _lengths(shape)

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        cells = iter(_cells(builder, args[0], row.literal_value, lengths))

        def item(kind: Any) -> Any:
            if kind is float64:
                return builder.load(next(cells))
            return context.make_tuple(builder, kind, [item(part) for part in kind])

        return item(signature.return_type)

    kind = float64
    for length in reversed(lengths):
        kind = types.UniTuple(kind, length)
    return kind(_POINTER, row, shape), generate


@intrinsic(prefer_literal=True)  # type: ignore[untyped-decorator]
def write(typingctx: Any, column: Any, row: Any, shape: Any, item: Any) -> Any:
    """The same back."""
    lengths = _lengths(shape)

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        cells = _cells(builder, args[0], row.literal_value, lengths)
        for cell, index in zip(cells, np.ndindex(*lengths), strict=True):
            builder.store(builder.extract_value(args[3], index) if index else args[3], cell)

    return types.void(_POINTER, row, shape, item), _without_result(generate)


def _lengths(shape: Any) -> list[int]:
    return [n.literal_value for n in shape.types]


def _cells(builder: Any, column: Any, row: int, lengths: list[int]) -> list[Any]:
    return [builder.gep(column, [_index((row + n) * ITEMS)]) for n in range(math.prod(lengths))]


def _places(builder: Any, item: Any, strides: Any, lengths: list[int]) -> Any:
    """The addresses of an item's numbers."""
    for index in np.ndindex(*lengths):
        offset = ir.Constant(ir.IntType(64), 0)
        for axis, i in enumerate(index):
            stride = builder.extract_value(strides, axis)
            offset = builder.add(offset, builder.mul(stride, ir.Constant(stride.type, i)))
        yield cgutils.pointer_add(builder, item, offset)


def _keep_scalar(builder: Any) -> None:
    """An empty instruction that keeps LLVM from vectorising a copying loop: its gathers and scatters are slow."""
    builder.asm(ir.FunctionType(ir.VoidType(), []), "", "~{memory}", [], True)


@intrinsic  # type: ignore[untyped-decorator]
def in_vectors(typingctx: Any) -> Any:
    """At the end of a loop's body: LLVM shall not unroll it before vectorising, and mix two vectors' instructions.

    (A chain of dependent operations leaves the processor's units idle half of the time.)
    """

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        module, branch = builder.module, builder.branch

        def branch_with_hints(target: Any) -> Any:
            del builder.branch
            jump = branch(target)
            loop = module.add_metadata([_index(len(module.metadata))])
            hints = [["llvm.loop.interleave.count", _index(2)], ["llvm.loop.unroll.disable"]]
            loop.operands = (loop, *map(module.add_metadata, hints))  # a loop's first operand is itself
            jump.set_metadata("llvm.loop", loop)
            return jump

        builder.branch = branch_with_hints  # the next one, from which the loop starts over

    return types.void(), _without_result(generate)


def _without_result(generate: Any) -> Any:
    def generate_and_return(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        generate(context, builder, signature, args)
        return context.get_dummy_value()

    return generate_and_return


def _index(n: int) -> Any:
    return ir.Constant(_int32, n)


def _at(builder: Any, pointer: Any, index: int, kind: Any) -> Any:
    return builder.bitcast(builder.gep(pointer, [_index(index)]), kind.as_pointer())


def _load(builder: Any, pointer: Any, index: int, count: int) -> Any:
    return builder.load(_at(builder, pointer, index, ir.VectorType(_double, count)), align=8)


def _store(builder: Any, value: Any, pointer: Any, index: int) -> None:
    builder.store(value, _at(builder, pointer, index, value.type), align=8)


def _ask_for(builder: Any, pointer: Any, index: int, lines: int, *, writing: bool) -> None:
    """Prefetch `lines` cache lines (8 numbers each) some way ahead; beyond an array's end this does nothing."""
    arguments = [_byte_pointer, _int32, _int32, _int32]
    prefetch = cgutils.get_or_insert_function(
        builder.module, ir.FunctionType(ir.VoidType(), arguments), "llvm.prefetch.p0"
    )
    for line in range(lines):
        place = builder.bitcast(builder.gep(pointer, [_index(index + 8 * line + _AHEAD // 8)]), _byte_pointer)
        builder.call(prefetch, [place, _index(int(writing)), _index(3), _index(1)])


def _shuffled(builder: Any, a: Any, b: Any, places: list[int]) -> Any:
    return builder.shuffle_vector(a, b, ir.Constant(ir.VectorType(_int32, len(places)), places))


def _columns(builder: Any, items: Any, index: int, width: int) -> list[Any]:
    """Of eight items as rows."""
    if width in (1, 2, 4):
        return _unzipped(builder, [_load(builder, items, index + _LANES * n, _LANES) for n in range(width)])
    if width < _LANES:
        wide = _load(builder, items, index, _LANES * width)
        return [_shuffled(builder, wide, wide, [n + width * i for i in range(_LANES)]) for n in range(width)]
    columns: list[Any] = []
    for n in range(0, width - _LANES + 1, _LANES):
        columns += _unzipped(builder, [_load(builder, items, index + width * i + n, _LANES) for i in range(_LANES)])
    for n in range(len(columns), width):
        column = ir.Constant(ir.VectorType(_double, _LANES), ir.Undefined)
        for i in range(_LANES):
            number = builder.load(builder.gep(items, [_index(index + width * i + n)]))
            column = builder.insert_element(column, number, _index(i))
        columns.append(column)
    return columns


def _store_items(builder: Any, columns: list[Any], items: Any, index: int) -> None:
    width = len(columns)
    if width in (1, 2, 4):
        for i, row in enumerate(_zipped(builder, columns)):
            _store(builder, row, items, index + _LANES * i)
    elif width < _LANES:
        wide = columns[0]
        for column in columns[1:]:
            count = wide.type.count
            padded = _shuffled(builder, column, column, [i % _LANES for i in range(count)])
            wide = _shuffled(builder, wide, padded, [*range(count + _LANES)])
        order = [n * _LANES + i for i in range(_LANES) for n in range(width)]
        _store(builder, _shuffled(builder, wide, wide, order), items, index)
    else:
        whole = width - width % _LANES
        for n in range(0, whole, _LANES):
            for i, row in enumerate(_zipped(builder, columns[n : n + _LANES])):
                _store(builder, row, items, index + width * i + n)
        for n, i in np.ndindex(width - whole, _LANES):
            number = builder.extract_element(columns[whole + n], _index(i))
            builder.store(number, builder.gep(items, [_index(index + width * i + whole + n)]))


def _unzipped(builder: Any, vectors: list[Any]) -> list[Any]:
    """Every w-th number of w vectors in a row, w = 1, 2, 4 or 8: even from odd places, log2(w) times."""
    even, odd = [*range(0, 2 * _LANES, 2)], [*range(1, 2 * _LANES, 2)]
    for _ in range(len(vectors).bit_length() - 1):
        pairs = [*zip(vectors[::2], vectors[1::2], strict=True)]
        vectors = [_shuffled(builder, a, b, places) for places in (even, odd) for a, b in pairs]
    return vectors


def _zipped(builder: Any, vectors: list[Any]) -> list[Any]:
    """The same back: the first half of the numbers between those of the second, log2(w) times."""
    both = [place for i in range(_LANES) for place in (i, i + _LANES)]
    for _ in range(len(vectors).bit_length() - 1):
        half = len(vectors) // 2
        pairs = zip(vectors[:half], vectors[half:], strict=True)
        vectors = [_shuffled(builder, a, b, part) for a, b in pairs for part in (both[:_LANES], both[_LANES:])]
    return vectors
