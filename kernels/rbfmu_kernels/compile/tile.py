"""A tile: numbers of sixteen items on the stack, a number's values for successive items side by side.

These are Numba intrinsics behind the loops of `tiled_gufunc`: moves between memory and tile, and hints to LLVM. Items
of a few numbers each get from rows in memory to columns in vectors, and back, by shuffles in registers, eight at
a time.
"""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from llvmlite import ir
from numba import float64, intp, types
from numba.extending import intrinsic

LANES = 8  # items that are transposed at a time
ITEMS = 16
"""Two vectors of the widest machines, whose chains of dependent operations then overlap (see `in_vectors`)."""
_AHEAD = 2048  # bytes: how far ahead of the tile memory is asked for
_POINTER = types.CPointer(float64)
_double, _int32, _int64 = ir.DoubleType(), ir.IntType(32), ir.IntType(64)
_byte_pointer = ir.IntType(8).as_pointer()


def constant(n: int) -> Any:
    """Return an integer of 32 bits."""
    return ir.Constant(_int32, n)


def _at(builder: Any, pointer: Any, index: int, kind: Any) -> Any:
    return builder.bitcast(builder.gep(pointer, [constant(index)]), kind.as_pointer())


def load(builder: Any, pointer: Any, index: int, count: int) -> Any:
    """Load `count` numbers from pointer[index] on as a vector."""
    return builder.load(_at(builder, pointer, index, ir.VectorType(_double, count)), align=8)


def store(builder: Any, value: Any, pointer: Any, index: int) -> None:
    """Store a vector's numbers from pointer[index] on."""
    builder.store(value, _at(builder, pointer, index, value.type), align=8)


def _shuffled(builder: Any, a: Any, b: Any, places: list[int]) -> Any:
    return builder.shuffle_vector(a, b, ir.Constant(ir.VectorType(_int32, len(places)), places))


def columns_of(builder: Any, items: Any, index: int, width: int) -> list[Any]:
    """Return the columns of eight items of `width` numbers, packed from items[index] on."""
    if width in (1, 2, 4):
        return _unzipped(builder, [load(builder, items, index + LANES * n, LANES) for n in range(width)])
    if width < LANES:
        wide = load(builder, items, index, LANES * width)
        return [_shuffled(builder, wide, wide, [n + width * i for i in range(LANES)]) for n in range(width)]
    columns: list[Any] = []
    for n in range(0, width - LANES + 1, LANES):
        columns += _unzipped(builder, [load(builder, items, index + width * i + n, LANES) for i in range(LANES)])
    for n in range(len(columns), width):
        column = ir.Constant(ir.VectorType(_double, LANES), ir.Undefined)
        for i in range(LANES):
            number = builder.load(builder.gep(items, [constant(index + width * i + n)]))
            column = builder.insert_element(column, number, constant(i))
        columns.append(column)
    return columns


def store_items(builder: Any, columns: list[Any], items: Any, index: int) -> None:
    """Store the columns of eight items where `columns_of` finds them."""
    width = len(columns)
    if width in (1, 2, 4):
        for i, row in enumerate(_zipped(builder, columns)):
            store(builder, row, items, index + LANES * i)
    elif width < LANES:
        wide = columns[0]
        for column in columns[1:]:
            count = wide.type.count
            padded = _shuffled(builder, column, column, [i % LANES for i in range(count)])
            wide = _shuffled(builder, wide, padded, [*range(count + LANES)])
        order = [n * LANES + i for i in range(LANES) for n in range(width)]
        store(builder, _shuffled(builder, wide, wide, order), items, index)
    else:
        whole = width - width % LANES
        for n in range(0, whole, LANES):
            for i, row in enumerate(_zipped(builder, columns[n : n + LANES])):
                store(builder, row, items, index + width * i + n)
        for n, i in np.ndindex(width - whole, LANES):
            number = builder.extract_element(columns[whole + n], constant(i))
            builder.store(number, builder.gep(items, [constant(index + width * i + whole + n)]))


def _unzipped(builder: Any, vectors: list[Any]) -> list[Any]:
    """Gather every w-th number of w vectors in a row, w = 1, 2, 4 or 8: part even from odd places, log2(w) times."""
    even, odd = [*range(0, 2 * LANES, 2)], [*range(1, 2 * LANES, 2)]
    for _ in range(len(vectors).bit_length() - 1):
        pairs = [*zip(vectors[::2], vectors[1::2], strict=True)]
        vectors = [_shuffled(builder, a, b, places) for places in (even, odd) for a, b in pairs]
    return vectors


def _zipped(builder: Any, vectors: list[Any]) -> list[Any]:
    """Undo `_unzipped`: put the first half of the numbers between those of the second, log2(w) times."""
    both = [place for i in range(LANES) for place in (i, i + LANES)]
    for _ in range(len(vectors).bit_length() - 1):
        half = len(vectors) // 2
        pairs = zip(vectors[:half], vectors[half:], strict=True)
        vectors = [_shuffled(builder, a, b, part) for a, b in pairs for part in (both[:LANES], both[LANES:])]
    return vectors


@intrinsic  # type: ignore[untyped-decorator]
def address(typingctx: Any, pointer: Any, offset: Any) -> Any:
    """Return the address `offset` bytes after a double*."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return _moved(builder, args[0], args[1])

    return _POINTER(_POINTER, intp), generate


@intrinsic(prefer_literal=True)  # type: ignore[untyped-decorator]
def tile_of(typingctx: Any, rows: Any) -> Any:
    """Return a tile of `rows` (a literal) numbers an item; its function may use the widest vectors there are."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        set.add(builder.function.attributes, '"prefer-vector-width"="512"')  # not among those that llvmlite checks for
        return _stack(builder, ITEMS * rows.literal_value)

    return _POINTER(rows), generate


@intrinsic(prefer_literal=True)  # type: ignore[untyped-decorator]
def to_tile(typingctx: Any, tile: Any, items: Any, row: Any, size: Any) -> Any:
    """Move sixteen items of `size` numbers, packed at `items`, to the tile's rows from `row` on."""
    first, width = row.literal_value, size.literal_value

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        for half in range(0, ITEMS, LANES):
            _ask_for(builder, args[1], half * width, width, writing=False)
            for n, column in enumerate(columns_of(builder, args[1], half * width, width)):
                store(builder, column, args[0], (first + n) * ITEMS + half)

    return types.void(_POINTER, _POINTER, row, size), _without_result(generate)


@intrinsic(prefer_literal=True)  # type: ignore[untyped-decorator]
def from_tile(typingctx: Any, tile: Any, items: Any, row: Any, size: Any) -> Any:
    """Move the tile's rows from `row` on to sixteen items of `size` numbers, packed at `items`."""
    first, width = row.literal_value, size.literal_value

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        for half in range(0, ITEMS, LANES):
            _ask_for(builder, args[1], half * width, width, writing=True)
            _store_rows(builder, args[0], range(first, first + width), args[1], half)

    return types.void(_POINTER, _POINTER, row, size), _without_result(generate)


@intrinsic(prefer_literal=True)  # type: ignore[untyped-decorator]
def stream_tile(typingctx: Any, tile: Any, items: Any, row: Any, size: Any) -> Any:
    """Move items as `from_tile` does, but past the caches, in whole cache lines.

    Memory that is written only need not be read first.
    """
    first, width = row.literal_value, size.literal_value

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        count = ir.Constant(_int64, ITEMS * width)
        lines = _stack(builder, ITEMS * width)
        for half in range(0, ITEMS, LANES):
            _store_rows(builder, args[0], range(first, first + width), lines, half)
        builder.asm(ir.FunctionType(ir.VoidType(), [lines.type]), "", "r,~{memory}", [lines], True)  # all in place
        before = _before_line(builder, args[1], count)
        behind = builder.add(before, builder.and_(builder.sub(count, before), _int64(-LANES)))
        for start, stop, step in ((_int64(0), before, 1), (before, behind, LANES), (behind, count, 1)):
            with _counted(builder, start, stop, step) as i:
                _stream(builder, builder.gep(lines, [i]), builder.gep(args[1], [i]), step)

    return types.void(_POINTER, _POINTER, row, size), _without_result(generate)


@intrinsic  # type: ignore[untyped-decorator]
def end_stream(typingctx: Any) -> Any:
    """Let other threads see what was streamed before they see that the call is over."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        kind = ir.FunctionType(ir.VoidType(), [])
        builder.call(builder.module.declare_intrinsic("llvm.x86.sse.sfence", (), kind), [])

    return types.void(), _without_result(generate)


@intrinsic(prefer_literal=True)  # type: ignore[untyped-decorator]
def item_to_tile(typingctx: Any, column: Any, item: Any, row: Any, shape: Any, strides: Any) -> Any:
    """Move one item anywhere in memory to the tile, where `column` is the address of its place in the first row.

    shape: the item's, such as (3, 3); strides: in bytes.
    """

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        cells = _cells(builder, args[0], row.literal_value, _lengths(shape))
        for cell, place in zip(cells, _places(builder, args[1], args[4], _lengths(shape)), strict=True):
            builder.store(builder.load(place), cell)
        _keep_scalar(builder)

    return types.void(_POINTER, _POINTER, row, shape, strides), _without_result(generate)


@intrinsic(prefer_literal=True)  # type: ignore[untyped-decorator]
def item_from_tile(typingctx: Any, column: Any, item: Any, row: Any, shape: Any, strides: Any) -> Any:
    """Move an item of the tile, as `item_to_tile` does, back to memory."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        cells = _cells(builder, args[0], row.literal_value, _lengths(shape))
        for cell, place in zip(cells, _places(builder, args[1], args[4], _lengths(shape)), strict=True):
            builder.store(builder.load(cell), place)
        _keep_scalar(builder)

    return types.void(_POINTER, _POINTER, row, shape, strides), _without_result(generate)


@intrinsic(prefer_literal=True)  # type: ignore[untyped-decorator]
def read(typingctx: Any, column: Any, row: Any, shape: Any) -> Any:
    """Return an item of the tile as a number or a (nested) tuple."""
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
    """Set an item of the tile from a number or a (nested) tuple."""
    lengths = _lengths(shape)

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        cells = _cells(builder, args[0], row.literal_value, lengths)
        for cell, index in zip(cells, np.ndindex(*lengths), strict=True):
            builder.store(builder.extract_value(args[3], index) if index else args[3], cell)

    return types.void(_POINTER, row, shape, item), _without_result(generate)


def _lengths(shape: Any) -> list[int]:
    return [n.literal_value for n in shape.types]


def _cells(builder: Any, column: Any, row: int, lengths: list[int]) -> list[Any]:
    return [builder.gep(column, [constant((row + n) * ITEMS)]) for n in range(math.prod(lengths))]


def _places(builder: Any, item: Any, strides: Any, lengths: list[int]) -> Any:
    """Return the addresses of an item's numbers."""
    for index in np.ndindex(*lengths):
        offset = ir.Constant(_int64, 0)
        for axis, i in enumerate(index):
            stride = builder.extract_value(strides, axis)
            offset = builder.add(offset, builder.mul(stride, ir.Constant(stride.type, i)))
        yield _moved(builder, item, offset)


def _keep_scalar(builder: Any) -> None:
    """Put an empty instruction that keeps LLVM from vectorising a copying loop, whose gathers and scatters are slow."""
    builder.asm(ir.FunctionType(ir.VoidType(), []), "", "~{memory}", [], True)


@intrinsic  # type: ignore[untyped-decorator]
def in_vectors(typingctx: Any) -> Any:
    """End a loop's body so that LLVM does not unroll it before vectorising, but interleaves two vectors' instructions.

    A chain of dependent operations alone would leave the processor idle half of the time.
    """

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        module, branch = builder.module, builder.branch

        def branch_with_hints(target: Any) -> Any:
            del builder.branch
            jump = branch(target)
            loop = module.add_metadata([constant(len(module.metadata))])
            hints = [["llvm.loop.interleave.count", constant(2)], ["llvm.loop.unroll.disable"]]
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


def _moved(builder: Any, pointer: Any, offset: Any) -> Any:
    """Return the pointer moved by `offset` bytes."""
    place = builder.gep(builder.bitcast(pointer, _byte_pointer), [offset])  # as integers, vectors would be lost
    return builder.bitcast(place, pointer.type)


def _stack(builder: Any, count: int) -> Any:
    """Return room for numbers on the stack, from the beginning of a cache line on."""
    with builder.goto_entry_block():
        array = builder.alloca(ir.ArrayType(_double, count))
    array.align = 8 * LANES
    return builder.bitcast(array, _double.as_pointer())


@contextmanager
def _counted(builder: Any, start: Any, stop: Any, step: int) -> Iterator[Any]:
    """Make a loop over start, start + step, ... below stop; its counter."""
    before, head, body, end = (builder.block, *(builder.append_basic_block(name) for name in ("head", "body", "end")))
    builder.branch(head)
    builder.position_at_end(head)
    i = builder.phi(_int64)
    i.add_incoming(start, before)
    builder.cbranch(builder.icmp_signed("<", i, stop), body, end)
    builder.position_at_end(body)
    yield i
    i.add_incoming(builder.add(i, _int64(step)), builder.block)
    builder.branch(head)
    builder.position_at_end(end)


def _before_line(builder: Any, pointer: Any, count: Any) -> Any:
    """Return how many numbers there are before a cache line begins; `count` where none ever does at a number."""
    place = builder.ptrtoint(pointer, _int64)
    numbers = builder.and_(builder.neg(builder.lshr(place, _int64(3))), _int64(LANES - 1))
    aligned = builder.icmp_unsigned("==", builder.and_(place, _int64(7)), _int64(0))
    return builder.select(aligned, numbers, count)


def _stream(builder: Any, source: Any, target: Any, count: int) -> None:
    """Store one number, or a line of them to where one begins, without a place in the caches."""
    kind = ir.VectorType(_double, count) if count > 1 else _int64
    value = builder.load(builder.bitcast(source, kind.as_pointer()), align=8)
    stored = builder.store(value, builder.bitcast(target, kind.as_pointer()), align=8 * count)
    stored.set_metadata("nontemporal", builder.module.add_metadata([constant(1)]))


def _ask_for(builder: Any, pointer: Any, index: int, lines: int, *, writing: bool) -> None:
    """Prefetch `lines` cache lines (8 numbers each) some way ahead; beyond an array's end this does nothing."""
    arguments = [_byte_pointer, _int32, _int32, _int32]
    kind = ir.FunctionType(ir.VoidType(), arguments)
    prefetch = builder.module.declare_intrinsic("llvm.prefetch.p0", (), kind)
    for line in range(lines):
        place = builder.bitcast(builder.gep(pointer, [constant(index + 8 * line + _AHEAD // 8)]), _byte_pointer)
        builder.call(prefetch, [place, constant(int(writing)), constant(3), constant(1)])


def _store_rows(builder: Any, tile: Any, rows: range, items: Any, half: int) -> None:
    """Store half a tile's items from `rows`, packed at `items`."""
    columns = [load(builder, tile, n * ITEMS + half, LANES) for n in rows]
    store_items(builder, columns, items, half * len(rows))
