"""Buffers of wide numbers, and four of these where kernels take four plain ones side by side: for Numba, as `wide`."""

import operator
from collections.abc import Callable
from functools import cache
from typing import Any

from llvmlite import binding, ir
from numba import types
from numba.extending import lower_cast, models, register_model

from . import simd
from .wide import WideType, register, splat, widened, width_among


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


class WideArrayType(types.Type):  # type: ignore[misc]
    """The type of a buffer with a number a lane in each place."""

    def __init__(self, width: int) -> None:
        self.width = width
        super().__init__(f"WideArray({width})")


@register_model(WideArrayType)
class _WideArrayModel(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, ir.DoubleType().as_pointer())


def _is_array(kind: Any) -> bool:
    return isinstance(kind, WideArrayType)


_ALL = (types.VarArg(types.Any),)
_int = types.intp


def _register_array(function: Callable[..., Any], width: int) -> None:
    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        data = context.make_array(signature.args[0])(context, builder, args[0]).data
        return builder.gep(data, [args[1]])

    register(function, lambda z, i: WideArrayType(width)(z, _int), generate, _ALL)


_register_array(four_wide, 4)
_register_array(eight_wide, 8)
register(
    width_of,
    lambda z: _int if _is_array(z) else None,
    lambda context, builder, signature, args: context.get_constant(_int, signature.args[0].width),
    _ALL,
)


# Wide numbers in a buffer


def _place(builder: Any, array: Any, index: Any, width: int) -> Any:
    row = builder.gep(array, [builder.mul(index, index.type(width))])
    return builder.bitcast(row, ir.VectorType(ir.DoubleType(), width).as_pointer())


def _load(builder: Any, array: Any, index: Any, width: int) -> Any:
    number = builder.load(_place(builder, array, index, width), typ=ir.VectorType(ir.DoubleType(), width))
    number.align = 8
    return number


def _store(builder: Any, number: Any, array: Any, index: Any, width: int) -> None:
    builder.store(number, _place(builder, array, index, width)).align = 8


def _type_getitem(z: Any, i: Any) -> Any:
    return WideType(z.width)(z, _int) if _is_array(z) and isinstance(i, types.Integer) else None


def _getitem(context: Any, builder: Any, signature: Any, args: Any) -> Any:
    return _load(builder, args[0], args[1], signature.args[0].width)


def _type_setitem(z: Any, i: Any, value: Any) -> Any:
    known = _is_array(z) and isinstance(i, types.Integer) and isinstance(value, WideType | types.Number)
    return types.none(z, _int, value) if known else None


def _setitem(context: Any, builder: Any, signature: Any, args: Any) -> Any:
    width = signature.args[0].width
    _store(builder, widened(context, builder, args[2], signature.args[2], width), args[0], args[1], width)
    return context.get_dummy_value()


register(operator.getitem, _type_getitem, _getitem, (WideArrayType, types.Integer))
register(operator.setitem, _type_setitem, _setitem, (WideArrayType, types.Integer, types.Any))


def _lane(builder: Any, args: Any, width: int) -> Any:
    return builder.gep(args[0], [builder.add(builder.mul(args[1], args[1].type(width)), args[2])])


def _lane_at(context: Any, builder: Any, signature: Any, args: Any) -> Any:
    return builder.load(_lane(builder, args, signature.args[0].width), typ=ir.DoubleType())


def _put_lane_at(context: Any, builder: Any, signature: Any, args: Any) -> Any:
    builder.store(args[3], _lane(builder, args, signature.args[0].width))
    return context.get_dummy_value()


register(lane_at, lambda z, i, lane: types.float64(z, _int, _int), _lane_at, _ALL)
register(put_lane_at, lambda z, i, lane, value: types.none(z, _int, _int, types.float64), _put_lane_at, _ALL)


# Four wide numbers


def _are_four(kind: Any) -> bool:
    return isinstance(kind, types.UniTuple) and isinstance(kind.dtype, WideType)


def _type_lanes(a: Any, b: Any, c: Any, d: Any) -> Any:
    width = width_among(a, b, c, d)
    return types.UniTuple(WideType(width), 4) if width else None


def _lanes(context: Any, builder: Any, signature: Any, args: Any) -> Any:
    kind = signature.return_type
    wide = [context.cast(builder, a, k, kind.dtype) for a, k in zip(args, signature.args, strict=True)]
    return context.make_tuple(builder, kind, wide)


def _cast_lanes(context: Any, builder: Any, source: Any, target: Any, four: Any) -> Any:
    numbers = [builder.extract_element(four, ir.Constant(ir.IntType(32), k)) for k in range(4)]
    return context.make_tuple(builder, target, [splat(builder, n, target.dtype.width) for n in numbers])


def _type_lanes_at(z: Any, i: Any) -> Any:
    return types.UniTuple(WideType(z.width), 4)(z, _int) if _is_array(z) else None


def _lanes_at(context: Any, builder: Any, signature: Any, args: Any) -> Any:
    z, i = args
    wide = [_load(builder, z, builder.add(i, i.type(k)), signature.args[0].width) for k in range(4)]
    return context.make_tuple(builder, signature.return_type, wide)


def _type_put_lanes(z: Any, i: Any, a: Any) -> Any:
    return types.none(z, _int, a) if _is_array(z) else None


def _put_lanes(context: Any, builder: Any, signature: Any, args: Any) -> Any:
    z, i, four = args
    for k in range(4):
        _store(builder, builder.extract_value(four, k), z, builder.add(i, i.type(k)), signature.args[0].width)
    return context.get_dummy_value()


def _register_pairwise(function: Callable[..., Any], make: Callable[..., Any]) -> None:
    def typer(a: Any, b: Any) -> Any:
        wide = a if _are_four(a) else b
        return wide if _are_four(wide) and all(x == wide or isinstance(x, simd.LanesType) for x in (a, b)) else None

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        kind = signature.return_type
        fours = [context.cast(builder, a, k, kind) for a, k in zip(args, signature.args, strict=True)]
        parts = [[builder.extract_value(four, k) for four in fours] for k in range(4)]
        return context.make_tuple(builder, kind, [make(builder, a, b) for a, b in parts])

    four, plain = types.UniTuple, simd.LanesType
    register(function, typer, generate, (four, four), (four, plain), (plain, four))


lower_cast(simd.LanesType, types.UniTuple)(_cast_lanes)
register(simd.lanes, _type_lanes, _lanes, (WideType, types.Any, types.Any, types.Any))
register(
    simd.numbers,
    lambda a: a if _are_four(a) else None,
    lambda context, builder, signature, args: args[0],
    (types.UniTuple,),
)
register(simd.lanes_at, _type_lanes_at, _lanes_at, (WideArrayType, types.Any))
register(simd.put_lanes, _type_put_lanes, _put_lanes, (WideArrayType, types.Any, types.Any))
_register_pairwise(simd.add_lanes, lambda builder, a, b: builder.fadd(a, b))
_register_pairwise(simd.multiply_lanes, lambda builder, a, b: builder.fmul(a, b))
