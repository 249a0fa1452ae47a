"""A tile has the numbers of sixteen items on the stack; the values of one number for successive items are neighbours.

The loops of `gufunc` use these Numba intrinsics: they move items between memory and tile, and give hints to LLVM. Eight
items at a time are transposed, from rows in memory to columns in vectors and back, by shuffles in registers.
"""

from collections.abc import Callable, Iterator, Sequence
from functools import wraps

import numpy as np
from llvmlite import ir
from numba import float64, intp, types
from numba.extending import intrinsic

from .codegen import Builder, Context, Intrinsic, Signature, Value, load, store
from .numba_private import cgutils

LANES = 8  # items that are transposed at a time
ITEMS = 16
"""Two vectors of the widest machines, so that their chains of dependent operations overlap (see `in_vectors`)."""
_AHEAD = 2048  # bytes: how far ahead of the tile memory is prefetched
_POINTER = types.CPointer(float64)
_double, _int32, _int64 = ir.DoubleType(), ir.IntType(32), ir.IntType(64)
_byte_pointer = ir.IntType(8).as_pointer()


def _at(builder: Builder, pointer: Value, index: int) -> Value:
    return builder.gep(pointer, [_int32(index)])


def _shuffled(builder: Builder, a: Value, b: Value, places: list[int]) -> Value:
    return builder.shuffle_vector(a, b, ir.Constant(ir.VectorType(_int32, len(places)), places))


def columns_of(builder: Builder, items: Value, index: int, width: int) -> list[Value]:
    """Return the `width` columns of eight items, which are packed from items[index] on with `width` numbers each."""
    if width in (1, 2, 4):
        return _unzipped(builder, [load(builder, _at(builder, items, index + LANES * n), LANES) for n in range(width)])
    if width < LANES:
        wide = load(builder, _at(builder, items, index), LANES * width)
        return [_shuffled(builder, wide, wide, [n + width * i for i in range(LANES)]) for n in range(width)]
    columns: list[Value] = []
    for n in range(0, width - LANES + 1, LANES):
        rows = [load(builder, _at(builder, items, index + width * i + n), LANES) for i in range(LANES)]
        columns += _unzipped(builder, rows)
    for n in range(len(columns), width):
        column = ir.Constant(ir.VectorType(_double, LANES), ir.Undefined)
        for i in range(LANES):
            number = builder.load(_at(builder, items, index + width * i + n))
            column = builder.insert_element(column, number, _int32(i))
        columns.append(column)
    return columns


def store_items(builder: Builder, columns: list[Value], items: Value, index: int) -> None:
    """Store the columns of eight items in memory, as `columns_of` reads them."""
    width = len(columns)
    if width in (1, 2, 4):
        for i, row in enumerate(_zipped(builder, columns)):
            store(builder, row, _at(builder, items, index + LANES * i))
    elif width < LANES:
        wide = columns[0]
        for column in columns[1:]:
            count = wide.type.count
            padded = _shuffled(builder, column, column, [i % LANES for i in range(count)])
            wide = _shuffled(builder, wide, padded, [*range(count + LANES)])
        order = [n * LANES + i for i in range(LANES) for n in range(width)]
        store(builder, _shuffled(builder, wide, wide, order), _at(builder, items, index))
    else:
        whole = width - width % LANES
        for n in range(0, whole, LANES):
            for i, row in enumerate(_zipped(builder, columns[n : n + LANES])):
                store(builder, row, _at(builder, items, index + width * i + n))
        for n, i in np.ndindex(width - whole, LANES):
            number = builder.extract_element(columns[whole + n], _int32(i))
            builder.store(number, _at(builder, items, index + width * i + whole + n))


def _unzipped(builder: Builder, vectors: list[Value]) -> list[Value]:
    """Return w vectors, each with every w-th number of the w given ones, by log2(w) even-odd splits; w: 1, 2, 4, 8."""
    even, odd = [*range(0, 2 * LANES, 2)], [*range(1, 2 * LANES, 2)]
    for _ in range(len(vectors).bit_length() - 1):
        pairs = [*zip(vectors[::2], vectors[1::2], strict=True)]
        vectors = [_shuffled(builder, a, b, places) for places in (even, odd) for a, b in pairs]
    return vectors


def _zipped(builder: Builder, vectors: list[Value]) -> list[Value]:
    """Return the inverse of `_unzipped`: interleave the first half of the vectors with the second, log2(w) times."""
    both = [place for i in range(LANES) for place in (i, i + LANES)]
    for _ in range(len(vectors).bit_length() - 1):
        half = len(vectors) // 2
        pairs = zip(vectors[:half], vectors[half:], strict=True)
        vectors = [_shuffled(builder, a, b, part) for a, b in pairs for part in (both[:LANES], both[LANES:])]
    return vectors


def _doing(signature: Signature, do: Callable[..., None]) -> Intrinsic:
    """Return an intrinsic without a result; do(builder, *arguments) makes its instructions."""

    def generate(context: Context, builder: Builder, signature: Signature, args: Sequence[Value]) -> Value:
        do(builder, *args)
        return context.get_dummy_value()

    return signature, generate


@intrinsic  # type: ignore[untyped-decorator]
def address(typingctx: Context, pointer: types.Type, offset: types.Type) -> Intrinsic:
    """Return the address `offset` bytes after a double*."""
    return _POINTER(_POINTER, intp), lambda context, builder, signature, args: _moved(builder, *args)


@intrinsic(prefer_literal=True)  # type: ignore[untyped-decorator]
def tile_of(typingctx: Context, rows: types.Literal) -> Intrinsic:
    """Return a tile with `rows` numbers per item; the function around it may use vectors of 512 bits."""

    def generate(context: Context, builder: Builder, signature: Signature, args: Sequence[Value]) -> Value:
        set.add(builder.function.attributes, '"prefer-vector-width"="512"')  # not among those that llvmlite checks for
        return _stack(builder, ITEMS * rows.literal_value)

    return _POINTER(rows), generate


def _move(move: Callable[..., None]) -> Callable[..., None]:
    """Return the intrinsic `(tile, items, row, size)` that moves sixteen items of `size` numbers, packed at `items`.

    In the tile they have the rows from `row` on; row and size are literals.
    """

    @intrinsic(prefer_literal=True)  # type: ignore[untyped-decorator]
    @wraps(move)
    def moving(
        typingctx: Context, tile: types.Type, items: types.Type, row: types.Literal, size: types.Literal
    ) -> Intrinsic:
        def put(builder: Builder, tile: Value, items: Value, *_: Value) -> None:
            move(builder, tile, items, row.literal_value, size.literal_value)

        return _doing(types.void(_POINTER, _POINTER, row, size), put)

    return moving  # type: ignore[no-any-return]


@_move
def to_tile(builder: Builder, tile: Value, items: Value, row: int, size: int) -> None:
    """Move items to the tile."""
    for half in range(0, ITEMS, LANES):
        _ask_for(builder, items, half * size, size, writing=False)
        for n, column in enumerate(columns_of(builder, items, half * size, size)):
            store(builder, column, _at(builder, tile, (row + n) * ITEMS + half))


@_move
def from_tile(builder: Builder, tile: Value, items: Value, row: int, size: int) -> None:
    """Move the tile's rows to items."""
    for half in range(0, ITEMS, LANES):
        _ask_for(builder, items, half * size, size, writing=True)
        _store_rows(builder, tile, row, size, items, half)


@_move
def stream_tile(builder: Builder, tile: Value, items: Value, row: int, size: int) -> None:
    """Move items as `from_tile` does, but past the caches, in whole cache lines.

    Then the processor need not read the memory before it overwrites it.
    """
    lines, count = _stack(builder, ITEMS * size), _int64(ITEMS * size)
    for half in range(0, ITEMS, LANES):
        _store_rows(builder, tile, row, size, lines, half)
    builder.asm(ir.FunctionType(ir.VoidType(), [lines.type]), "", "r,~{memory}", [lines], True)  # stored by here
    before = _before_line(builder, items, count)
    behind = builder.add(before, builder.and_(builder.sub(count, before), _int64(-LANES)))
    for start, stop, step in ((_int64(0), before, 1), (before, behind, LANES), (behind, count, 1)):
        with cgutils.for_range_slice(builder, start, stop, _int64(step), _int64) as (i, _):
            _stream(builder, builder.gep(lines, [i]), builder.gep(items, [i]), step)


def _hint(put: Callable[[Builder], None]) -> Callable[[], None]:
    """Return an intrinsic without arguments or result; put(builder) makes its instruction."""
    return intrinsic(wraps(put)(lambda typingctx: _doing(types.void(), put)))  # type: ignore[no-any-return]


@_hint
def end_stream(builder: Builder) -> None:
    """Make streamed results visible to other threads before they can see the end of the call."""
    kind = ir.FunctionType(ir.VoidType(), [])
    builder.call(builder.module.declare_intrinsic("llvm.x86.sse.sfence", (), kind), [])


@_hint
def in_turn(builder: Builder) -> None:
    """Keep LLVM from vectorising a copying loop, as gathers and scatters are slow, by an empty instruction."""
    builder.asm(ir.FunctionType(ir.VoidType(), []), "", "~{memory}", [], True)


@_hint
def in_vectors(builder: Builder) -> None:
    """At the end of a loop's body: tell LLVM to interleave two vectors, and not to unroll before it vectorises.

    A single chain of dependent operations would leave the processor idle half of the time.
    """
    module, branch = builder.module, builder.branch

    def branch_with_hints(target: ir.Block) -> Value:
        del builder.branch
        jump = branch(target)
        loop = module.add_metadata([_int32(len(module.metadata))])
        hints = [["llvm.loop.interleave.count", _int32(2)], ["llvm.loop.unroll.disable"]]
        loop.operands = (loop, *map(module.add_metadata, hints))  # a loop's first operand is itself
        jump.set_metadata("llvm.loop", loop)
        return jump

    builder.branch = branch_with_hints  # used for the next branch, which goes back to the loop's start


@intrinsic(prefer_literal=True)  # type: ignore[untyped-decorator]
def read(typingctx: Context, item: types.Type, shape: types.BaseTuple, strides: types.BaseTuple) -> Intrinsic:
    """Return an item in the tile, or anywhere in memory, as a number or a (nested) tuple.

    item: its address; shape: its core shape, such as (3, 3); strides: in bytes, one per axis.
    """
    lengths, kind = [n.literal_value for n in shape.types], float64
    for length in reversed(lengths):
        kind = types.UniTuple(kind, length)

    def generate(context: Context, builder: Builder, signature: Signature, args: Sequence[Value]) -> Value:
        numbers = map(builder.load, _places(builder, args[0], args[2], lengths))

        def value_of(part: types.Type) -> Value:
            return next(numbers) if part == float64 else context.make_tuple(builder, part, [*map(value_of, part)])

        return value_of(kind)

    return kind(_POINTER, shape, strides), generate


@intrinsic(prefer_literal=True)  # type: ignore[untyped-decorator]
def write(
    typingctx: Context, item: types.Type, shape: types.BaseTuple, strides: types.BaseTuple, value: types.Type
) -> Intrinsic:
    """Set an item in the tile, or anywhere in memory, from a number or a (nested) tuple."""
    lengths = [n.literal_value for n in shape.types]

    def put(builder: Builder, item: Value, shape: Value, strides: Value, value: Value) -> None:
        for place, index in zip(_places(builder, item, strides, lengths), np.ndindex(*lengths), strict=True):
            builder.store(builder.extract_value(value, index) if index else value, place)

    return _doing(types.void(_POINTER, shape, strides, value), put)


def _places(builder: Builder, item: Value, strides: Value, lengths: list[int]) -> Iterator[Value]:
    """Yield the addresses of an item's numbers."""
    for index in np.ndindex(*lengths):
        offset = _int64(0)
        for axis, i in enumerate(index):
            stride = builder.extract_value(strides, axis)
            offset = builder.add(offset, builder.mul(stride, stride.type(i)))
        yield _moved(builder, item, offset)


def _moved(builder: Builder, pointer: Value, offset: Value) -> Value:
    """Return the pointer moved by `offset` bytes."""
    place = builder.gep(builder.bitcast(pointer, _byte_pointer), [offset])  # integer addresses prevent vectorising
    return builder.bitcast(place, pointer.type)


def _stack(builder: Builder, count: int) -> Value:
    """Return the address of room for `count` numbers on the stack, at the beginning of a cache line."""
    with builder.goto_entry_block():
        array = builder.alloca(ir.ArrayType(_double, count))
    array.align = 8 * LANES
    return builder.bitcast(array, _double.as_pointer())


def _before_line(builder: Builder, pointer: Value, count: Value) -> Value:
    """Return how many numbers lie before the next cache line; `count` if the address is no multiple of 8 bytes."""
    place = builder.ptrtoint(pointer, _int64)
    numbers = builder.and_(builder.neg(builder.lshr(place, _int64(3))), _int64(LANES - 1))
    aligned = builder.icmp_unsigned("==", builder.and_(place, _int64(7)), _int64(0))
    return builder.select(aligned, numbers, count)


def _stream(builder: Builder, source: Value, target: Value, count: int) -> None:
    """Store one number, or a whole cache line at the beginning of one, past the caches."""
    kind = ir.VectorType(_double, count) if count > 1 else _int64
    value = builder.load(builder.bitcast(source, kind.as_pointer()), align=8)
    stored = builder.store(value, builder.bitcast(target, kind.as_pointer()), align=8 * count)
    stored.set_metadata("nontemporal", builder.module.add_metadata([_int32(1)]))


def _ask_for(builder: Builder, pointer: Value, index: int, lines: int, *, writing: bool) -> None:
    """Prefetch `lines` cache lines (8 numbers each), `_AHEAD` bytes ahead; beyond an array's end this does nothing."""
    kind = ir.FunctionType(ir.VoidType(), [_byte_pointer, _int32, _int32, _int32])
    prefetch = builder.module.declare_intrinsic("llvm.prefetch.p0", (), kind)
    for line in range(lines):
        place = builder.bitcast(_at(builder, pointer, index + 8 * line + _AHEAD // 8), _byte_pointer)
        builder.call(prefetch, [place, _int32(int(writing)), _int32(3), _int32(1)])


def _store_rows(builder: Builder, tile: Value, first: int, width: int, items: Value, half: int) -> None:
    """Store half of a tile's items, eight from `half` on, from `width` rows of the tile, packed at `items`."""
    columns = [load(builder, _at(builder, tile, (first + n) * ITEMS + half), LANES) for n in range(width)]
    store_items(builder, columns, items, half * width)
