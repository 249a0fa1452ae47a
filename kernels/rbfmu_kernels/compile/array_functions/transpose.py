"""Eight items of a few numbers each, from rows in memory to columns in vectors and back, by shuffles in registers."""

from typing import Any

import numpy as np
from llvmlite import ir

LANES = 8  # items that are transposed at a time
_double, _int32 = ir.DoubleType(), ir.IntType(32)


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
