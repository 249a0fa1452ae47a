"""Four numbers side by side, on which the same is done at once: a vector of the machine, or a tuple in Python.

A lane's arithmetic is that of plain numbers, so that no bit depends on how wide the machine's vectors are. What stands
here is for Python; Numba puts instructions on vectors in its place.
"""

import operator
from collections.abc import Callable
from functools import cache
from struct import Struct
from typing import Any, cast

from llvmlite import binding, ir
from numba import float64, intp, types
from numba.extending import lower_cast

from .wide import InLanes, WideType, register, register_value, splat, width_among

Lanes = tuple[float, float, float, float]
_four_from = cast(Callable[[Any, int], Lanes], Struct("4d").unpack_from)


def lanes(a: float, b: float, c: float, d: float) -> Lanes:
    """Return four numbers side by side."""
    return (a, b, c, d)


def numbers(a: Lanes) -> Lanes:
    """Return the four numbers."""
    return a


def lanes_at(z: Any, i: int) -> Lanes:
    """Return the four numbers from z[i] on."""
    return _four_from(z, 8 * i)  # Python's numbers, which are added faster than NumPy's


def put_lanes(z: Any, i: int, a: Lanes) -> None:
    """Store four numbers from z[i] on."""
    z[i], z[i + 1], z[i + 2], z[i + 3] = a


def cyclic_at(z: Any, i: int, j: int) -> Lanes:
    """Return (y, z, x, w) of the numbers (x, y, z, w) at z[i]; these stand at z[j] where no vector has one of each."""
    return lanes_at(z, j)


def put_cyclic(z: Any, j: int, a: Lanes) -> None:
    """Store what `cyclic_at` reads at z[j], where it does."""
    put_lanes(z, j, a)


def add_lanes(a: Lanes, b: Lanes) -> Lanes:
    """Add lane by lane."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3])


def multiply_lanes(a: Lanes, b: Lanes) -> Lanes:
    """Multiply lane by lane."""
    return (a[0] * b[0], a[1] * b[1], a[2] * b[2], a[3] * b[3])


class LanesType(InLanes):
    """The type of four numbers side by side."""

    def unify(self, typingctx: Any, other: Any) -> Any:
        """Return the type of four wide numbers, see `wide`, for a variable that is sometimes four plain ones."""
        return other if isinstance(other, types.UniTuple) and len(other) == 4 else None


_LANES = LanesType(4)
_VECTOR, _INT = ir.VectorType(ir.DoubleType(), 4), ir.IntType(32)


register_value(LanesType, lambda width: _VECTOR)


def _are(kind: Any, *args: Any) -> bool:
    return all(isinstance(one, kind) for one in args)


@register(lanes, lambda a, b, c, d: _LANES(*[float64] * 4) if _are(types.Number, a, b, c, d) else None)
def _lanes(context: Any, builder: Any, signature: Any, args: Any) -> Any:
    vector = ir.Constant(_VECTOR, ir.Undefined)
    for k, number in enumerate(args):
        vector = builder.insert_element(vector, number, _INT(k))
    return vector


@register(numbers, lambda a: types.UniTuple(float64, 4) if _are(LanesType, a) else None)
def _numbers(context: Any, builder: Any, signature: Any, args: Any) -> Any:
    parts = [builder.extract_element(args[0], _INT(k)) for k in range(4)]
    return context.make_tuple(builder, signature.return_type, parts)


@register(lanes_at, lambda z, i: _LANES(z, intp) if _are(types.Array, z) else None)
def _lanes_at(context: Any, builder: Any, signature: Any, args: Any) -> Any:
    vector = builder.load(_place(context, builder, signature, args), typ=_VECTOR)
    vector.align = 8
    return vector


@register(put_lanes, lambda z, i, a: types.none(z, intp, a) if _are(types.Array, z) else None)
def _put_lanes(context: Any, builder: Any, signature: Any, args: Any) -> Any:
    builder.store(args[2], _place(context, builder, signature, args)).align = 8
    return context.get_dummy_value()


@register(cyclic_at, lambda z, i, j: _LANES(z, intp, intp) if _are(types.Array, z) else None)
def _cyclic_at(context: Any, builder: Any, signature: Any, args: Any) -> Any:
    return _lanes_at(context, builder, signature, [args[0], args[2]])


register(put_cyclic, lambda z, j, a: types.none(z, intp, a) if _are(types.Array, z) else None)(_put_lanes)


def _place(context: Any, builder: Any, signature: Any, args: Any) -> Any:
    data = context.make_array(signature.args[0])(context, builder, args[0]).data
    return builder.bitcast(builder.gep(data, [args[1]]), _VECTOR.as_pointer())


@register(add_lanes, lambda a, b: a if _are(LanesType, a, b) else None)
def _add_lanes(context: Any, builder: Any, signature: Any, args: Any) -> Any:
    return builder.fadd(*args)


@register(multiply_lanes, lambda a, b: a if _are(LanesType, a, b) else None)
def _multiply_lanes(context: Any, builder: Any, signature: Any, args: Any) -> Any:
    return builder.fmul(*args)


@cache
def widest() -> int:
    """Return how many lanes serve best here, 8 or 4; no bit depends on it."""
    return 8 if binding.get_host_cpu_features().get("avx512f", False) else 4


def four_wide(z: Any, i: int) -> Any:
    """Return the buffer of numbers of four lanes that stand from z[i] on, place by place."""
    raise NotImplementedError


def eight_wide(z: Any, i: int) -> Any:
    """Return the same of eight lanes."""
    raise NotImplementedError


def width_of(z: Any) -> int:
    """Return the number of lanes of a buffer of wide numbers."""
    raise NotImplementedError


def lane_at(z: Any, i: int, lane: int) -> float:
    """Return one lane of the wide number z[i]."""
    raise NotImplementedError


def put_lane_at(z: Any, i: int, lane: int, value: float) -> None:
    """Set one lane of the wide number z[i]."""
    raise NotImplementedError


class WideArrayType(InLanes):
    """The type of a buffer with a number a lane in each place."""


register_value(WideArrayType, lambda width: ir.DoubleType().as_pointer())


def _register_array(function: Callable[..., Any], width: int) -> None:
    @register(function, lambda z, i: WideArrayType(width)(z, intp))
    def _(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        data = context.make_array(signature.args[0])(context, builder, args[0]).data
        return builder.gep(data, [args[1]])


_register_array(four_wide, 4)
_register_array(eight_wide, 8)


@register(width_of, lambda z: intp if _are(WideArrayType, z) else None)
def _width_of(context: Any, builder: Any, signature: Any, args: Any) -> Any:
    return context.get_constant(intp, signature.args[0].width)


# Wide numbers in a buffer


def _wide_place(builder: Any, array: Any, index: Any, width: int) -> Any:
    row = builder.gep(array, [builder.mul(index, index.type(width))])
    return builder.bitcast(row, ir.VectorType(ir.DoubleType(), width).as_pointer())


def _load(builder: Any, array: Any, index: Any, width: int) -> Any:
    number = builder.load(_wide_place(builder, array, index, width), typ=ir.VectorType(ir.DoubleType(), width))
    number.align = 8
    return number


def _store(builder: Any, number: Any, array: Any, index: Any, width: int) -> None:
    builder.store(number, _wide_place(builder, array, index, width)).align = 8


@register(
    operator.getitem,
    lambda z, i: WideType(z.width)(z, intp) if _are(WideArrayType, z) and _are(types.Integer, i) else None,
    (WideArrayType, types.Integer),
)
def _getitem(context: Any, builder: Any, signature: Any, args: Any) -> Any:
    return _load(builder, args[0], args[1], signature.args[0].width)


def _type_setitem(z: Any, i: Any, value: Any) -> Any:
    known = _are(WideArrayType, z) and _are(types.Integer, i) and _are(WideType | types.Number, value)
    return types.none(z, intp, value) if known else None


@register(operator.setitem, _type_setitem, (WideArrayType, types.Integer, types.Any))
def _setitem(context: Any, builder: Any, signature: Any, args: Any) -> Any:
    width = signature.args[0].width
    number = context.cast(builder, args[2], signature.args[2], WideType(width))
    _store(builder, number, args[0], args[1], width)
    return context.get_dummy_value()


def _lane(builder: Any, args: Any, width: int) -> Any:
    return builder.gep(args[0], [builder.add(builder.mul(args[1], args[1].type(width)), args[2])])


@register(lane_at, lambda z, i, lane: float64(z, intp, intp))
def _lane_at(context: Any, builder: Any, signature: Any, args: Any) -> Any:
    return builder.load(_lane(builder, args, signature.args[0].width), typ=ir.DoubleType())


@register(put_lane_at, lambda z, i, lane, value: types.none(z, intp, intp, float64))
def _put_lane_at(context: Any, builder: Any, signature: Any, args: Any) -> Any:
    builder.store(args[3], _lane(builder, args, signature.args[0].width))
    return context.get_dummy_value()


# Four wide numbers


def _are_four(kind: Any) -> bool:
    return isinstance(kind, types.UniTuple) and isinstance(kind.dtype, WideType)


def _type_lanes(a: Any, b: Any, c: Any, d: Any) -> Any:
    width = width_among(WideType, a, b, c, d)
    return types.UniTuple(WideType(width), 4) if width else None


@register(lanes, _type_lanes, (WideType, types.Any, types.Any, types.Any))
def _wide_lanes(context: Any, builder: Any, signature: Any, args: Any) -> Any:
    kind = signature.return_type
    wide = [context.cast(builder, a, k, kind.dtype) for a, k in zip(args, signature.args, strict=True)]
    return context.make_tuple(builder, kind, wide)


@lower_cast(LanesType, types.UniTuple)  # type: ignore[untyped-decorator]
def _cast_lanes(context: Any, builder: Any, source: Any, target: Any, four: Any) -> Any:
    parts = [builder.extract_element(four, _INT(k)) for k in range(4)]
    return context.make_tuple(builder, target, [splat(builder, n, target.dtype.width) for n in parts])


@register(numbers, lambda a: a if _are_four(a) else None, (types.UniTuple,))
def _wide_numbers(context: Any, builder: Any, signature: Any, args: Any) -> Any:
    return args[0]


@register(
    lanes_at,
    lambda z, i: types.UniTuple(WideType(z.width), 4)(z, intp) if _are(WideArrayType, z) else None,
    (WideArrayType, types.Any),
)
def _wide_lanes_at(context: Any, builder: Any, signature: Any, args: Any) -> Any:
    z, i = args
    wide = [_load(builder, z, builder.add(i, i.type(k)), signature.args[0].width) for k in range(4)]
    return context.make_tuple(builder, signature.return_type, wide)


@register(
    put_lanes,
    lambda z, i, a: types.none(z, intp, a) if _are(WideArrayType, z) else None,
    (WideArrayType, types.Any, types.Any),
)
def _put_wide_lanes(context: Any, builder: Any, signature: Any, args: Any) -> Any:
    z, i, four = args
    for k in range(4):
        _store(builder, builder.extract_value(four, k), z, builder.add(i, i.type(k)), signature.args[0].width)
    return context.get_dummy_value()


@register(
    cyclic_at,
    lambda z, i, j: types.UniTuple(WideType(z.width), 4)(z, intp, intp) if _are(WideArrayType, z) else None,
    (WideArrayType, types.Any, types.Any),
)
def _wide_cyclic_at(context: Any, builder: Any, signature: Any, args: Any) -> Any:
    z, i, _ = args
    wide = [_load(builder, z, builder.add(i, i.type(k)), signature.args[0].width) for k in (1, 2, 0, 3)]
    return context.make_tuple(builder, signature.return_type, wide)


@register(
    put_cyclic,
    lambda z, j, a: types.none(z, intp, a) if _are(WideArrayType, z) else None,
    (WideArrayType, types.Any, types.Any),
)
def _put_wide_cyclic(context: Any, builder: Any, signature: Any, args: Any) -> Any:
    return context.get_dummy_value()


def _register_pairwise(function: Callable[..., Any], make: Callable[..., Any]) -> None:
    def typer(a: Any, b: Any) -> Any:
        wide = a if _are_four(a) else b
        return wide if _are_four(wide) and all(x == wide or _are(LanesType, x) for x in (a, b)) else None

    four, plain = types.UniTuple, LanesType

    @register(function, typer, (four, four), (four, plain), (plain, four))
    def _(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        kind = signature.return_type
        fours = [context.cast(builder, a, k, kind) for a, k in zip(args, signature.args, strict=True)]
        parts = [[builder.extract_value(four, k) for four in fours] for k in range(4)]
        return context.make_tuple(builder, kind, [make(builder, a, b) for a, b in parts])


_register_pairwise(add_lanes, lambda builder, a, b: builder.fadd(a, b))
_register_pairwise(multiply_lanes, lambda builder, a, b: builder.fmul(a, b))
