"""Four numbers side by side, which are added and multiplied at once: a vector in compiled code, a tuple in Python.

Each lane has the arithmetic of plain numbers, so no bit depends on the width of the machine's vectors. The functions
below run in Python; in compiled code Numba replaces them by vector instructions. Four wide numbers (see `wide`) are
four vectors.
"""

import operator
from collections.abc import Callable, Sequence
from struct import Struct
from typing import cast

from llvmlite import binding, ir
from numba import config, float64, intp, types
from numba.extending import intrinsic, lower_cast, models, register_model

from ..types import Buffer
from .codegen import Builder, Context, Intrinsic, Make, Signature, Value, cast_all, load, register, splat, store
from .wide import WideType, is_four_wide

Lanes = tuple[float, float, float, float]
_four_from = cast(Callable[[Buffer, int], Lanes], Struct("4d").unpack_from)


def lanes(a: float, b: float, c: float, d: float) -> Lanes:
    """Return four numbers as the lanes of a vector."""
    return (a, b, c, d)


def numbers(a: Lanes) -> Lanes:
    """Return the four lanes as a tuple of numbers."""
    return a


def lanes_at(z: Buffer, i: int) -> Lanes:
    """Return the four numbers from z[i] on."""
    return _four_from(z, 8 * i)  # Python's numbers, which are added faster than NumPy's


def put_lanes(z: Buffer, i: int, a: Lanes) -> None:
    """Store four numbers from z[i] on."""
    z[i], z[i + 1], z[i + 2], z[i + 3] = a


def cyclic_at(z: Buffer, i: int, j: int) -> Lanes:
    """Return (y, z, x, w) of the numbers (x, y, z, w) from z[i] on.

    Four plain numbers are read in this order from z[j] on, where `put_cyclic` has stored them; wide ones from z[i] on.
    """
    return lanes_at(z, j)


def put_cyclic(z: Buffer, j: int, a: Lanes) -> None:
    """Store four plain numbers from z[j] on, for `cyclic_at`; does nothing for wide ones, which it reads elsewhere."""
    put_lanes(z, j, a)


def add_lanes(a: Lanes, b: Lanes) -> Lanes:
    """Add lane by lane."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3])


def multiply_lanes(a: Lanes, b: Lanes) -> Lanes:
    """Multiply lane by lane."""
    return (a[0] * b[0], a[1] * b[1], a[2] * b[2], a[3] * b[3])


_INSTRUCTIONS = binding.get_host_cpu_features().flatten() if config.CPU_FEATURES is None else config.CPU_FEATURES
"""The features of the processor that Numba compiles for; its cache distinguishes code by them too."""
WIDEST = 8 if "+avx512f" in _INSTRUCTIONS else 4
"""The best number of lanes with these features; no bit depends on it."""


# Wide numbers in a buffer


class WideArrayType(types.Type):  # type: ignore[misc]
    """The type of a buffer whose every place has a wide number, of `width` lanes."""

    def __init__(self, width: int) -> None:
        self.width = width
        super().__init__(f"WideArrayType({width})")


@register_model(WideArrayType)
class _Pointer(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, manager: object, of: WideArrayType) -> None:
        super().__init__(manager, of, ir.DoubleType().as_pointer())


def _place(context: Context, builder: Builder, kind: types.Type, z: Value, i: Value) -> Value:
    """Return the address of a buffer's place i: of its number, or of the first lane of its wide number."""
    if isinstance(kind, WideArrayType):
        return builder.gep(z, [builder.mul(i, i.type(kind.width))])
    return builder.gep(context.make_array(kind)(context, builder, z).data, [i])


@intrinsic(prefer_literal=True)  # type: ignore[untyped-decorator]
def wide_at(typingctx: Context, z: types.Array, i: types.Type, width: types.IntegerLiteral) -> Intrinsic:
    """Return the numbers from z[i] on as a buffer of wide numbers; width: how many lanes each has, a constant."""
    kind = WideArrayType(width.literal_value)
    return kind(z, intp, width), lambda context, builder, signature, args: _place(context, builder, z, *args[:2])


@intrinsic  # type: ignore[untyped-decorator]
def width_of(typingctx: Context, z: WideArrayType) -> Intrinsic:
    """Return the number of lanes of a buffer of wide numbers."""
    return intp(z), lambda context, builder, signature, args: context.get_constant(intp, z.width)


@intrinsic  # type: ignore[untyped-decorator]
def lane_at(typingctx: Context, z: WideArrayType, i: types.Type, lane: types.Type) -> Intrinsic:
    """Return one lane of the wide number z[i]."""

    def generate(context: Context, builder: Builder, signature: Signature, args: Sequence[Value]) -> Value:
        return builder.load(builder.gep(_place(context, builder, z, *args[:2]), [args[2]]))

    return float64(z, intp, intp), generate


@intrinsic  # type: ignore[untyped-decorator]
def put_lane_at(typingctx: Context, z: WideArrayType, i: types.Type, lane: types.Type, value: types.Type) -> Intrinsic:
    """Set one lane of the wide number z[i]."""

    def generate(context: Context, builder: Builder, signature: Signature, args: Sequence[Value]) -> Value:
        builder.store(args[3], builder.gep(_place(context, builder, z, *args[:2]), [args[2]]))
        return context.get_dummy_value()

    return types.none(z, intp, intp, float64), generate


@register(
    operator.getitem,
    lambda z, i: WideType(z.width)(z, intp) if isinstance(z, WideArrayType) and isinstance(i, types.Integer) else None,
    (WideArrayType, types.Integer),
)
def _getitem(context: Context, builder: Builder, signature: Signature, args: Sequence[Value]) -> Value:
    return load(builder, _place(context, builder, signature.args[0], *args), signature.args[0].width)


def _type_setitem(z: types.Type, i: types.Type, value: types.Type) -> Signature | None:
    known = isinstance(z, WideArrayType) and isinstance(value, WideType | types.Number)
    return types.none(z, intp, value) if known else None


@register(operator.setitem, _type_setitem, (WideArrayType, types.Integer, types.Any))
def _setitem(context: Context, builder: Builder, signature: Signature, args: Sequence[Value]) -> Value:
    kind, _, given = signature.args
    number = context.cast(builder, args[2], given, WideType(kind.width))
    store(builder, number, _place(context, builder, kind, *args[:2]))
    return context.get_dummy_value()


# Four numbers, which are one vector, or four wide ones, which are a tuple of four


_FOUR = WideType(4)


def _four_in(z: types.Type) -> types.Type | None:
    """Return the type of four numbers that are read from a buffer; None if z is no buffer."""
    if isinstance(z, WideArrayType):
        return types.UniTuple(WideType(z.width), 4)
    return _FOUR if isinstance(z, types.Array) else None


def _parts(builder: Builder, kind: types.Type, four: Value) -> list[Value]:
    if kind == _FOUR:
        return [builder.extract_element(four, ir.IntType(32)(k)) for k in range(4)]
    return [builder.extract_value(four, k) for k in range(4)]


@lower_cast(WideType, types.UniTuple)  # type: ignore[untyped-decorator]
def _widen(context: Context, builder: Builder, source: WideType, target: types.UniTuple, four: Value) -> Value:
    wide = [splat(builder, number, target.dtype.width) for number in _parts(builder, source, four)]
    return context.make_tuple(builder, target, wide)


def _type_lanes(a: types.Type, b: types.Type, c: types.Type, d: types.Type) -> types.Type | Signature | None:
    wide = [one for one in (a, b, c, d) if isinstance(one, WideType)]
    plain = all(isinstance(one, types.Number) for one in (a, b, c, d))
    return types.UniTuple(wide[0], 4) if wide else (_FOUR(*[float64] * 4) if plain else None)


@register(lanes, _type_lanes)
def _lanes(context: Context, builder: Builder, signature: Signature, args: Sequence[Value]) -> Value:
    kind = signature.return_type
    if kind != _FOUR:
        return context.make_tuple(builder, kind, cast_all(context, builder, signature, args, kind.dtype))
    vector = ir.Constant(ir.VectorType(ir.DoubleType(), 4), ir.Undefined)
    for k, number in enumerate(args):
        vector = builder.insert_element(vector, number, ir.IntType(32)(k))
    return vector


@register(numbers, lambda a: types.UniTuple(float64, 4) if a == _FOUR else (a if is_four_wide(a) else None))
def _numbers(context: Context, builder: Builder, signature: Signature, args: Sequence[Value]) -> Value:
    return context.make_tuple(builder, signature.return_type, _parts(builder, signature.args[0], args[0]))


@register(lanes_at, lambda z, i: (four := _four_in(z)) and four(z, intp))
def _lanes_at(context: Context, builder: Builder, signature: Signature, args: Sequence[Value]) -> Value:
    (kind, *_), (z, i, *_) = signature.args, args
    if signature.return_type == _FOUR:
        return load(builder, _place(context, builder, kind, z, args[-1]), 4)
    order = (1, 2, 0, 3) if len(args) > 2 else range(4)
    places = [_place(context, builder, kind, z, builder.add(i, i.type(k))) for k in order]
    return context.make_tuple(builder, signature.return_type, [load(builder, place, kind.width) for place in places])


register(cyclic_at, lambda z, i, j: (four := _four_in(z)) and four(z, intp, intp))(_lanes_at)


@register(put_lanes, lambda z, i, a: types.none(z, intp, a) if a == _four_in(z) else None)
def _put_lanes(context: Context, builder: Builder, signature: Signature, args: Sequence[Value]) -> Value:
    (kind, _, given), (z, i, four) = signature.args, args
    for k, vector in enumerate([four] if given == _FOUR else _parts(builder, given, four)):
        store(builder, vector, _place(context, builder, kind, z, builder.add(i, i.type(k))))
    return context.get_dummy_value()


@register(put_cyclic, lambda z, j, a: types.none(z, intp, a) if a == _four_in(z) else None)
def _put_cyclic(context: Context, builder: Builder, signature: Signature, args: Sequence[Value]) -> Value:
    is_one_vector = signature.args[2] == _FOUR
    return _put_lanes(context, builder, signature, args) if is_one_vector else context.get_dummy_value()


def _register_pairwise(function: Callable[..., object], make: Make) -> None:
    def typer(a: types.Type, b: types.Type) -> types.Type | None:
        wide = a if is_four_wide(a) else b
        return wide if (wide == _FOUR or is_four_wide(wide)) and {a, b} <= {wide, _FOUR} else None

    @register(function, typer)
    def _(context: Context, builder: Builder, signature: Signature, args: Sequence[Value]) -> Value:
        kind = signature.return_type
        fours = cast_all(context, builder, signature, args, kind)
        if kind == _FOUR:
            return make(builder, *fours)
        pairs = zip(*(_parts(builder, kind, four) for four in fours), strict=True)
        return context.make_tuple(builder, kind, [make(builder, a, b) for a, b in pairs])


_register_pairwise(add_lanes, Builder.fadd)
_register_pairwise(multiply_lanes, Builder.fmul)
