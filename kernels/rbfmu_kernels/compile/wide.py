"""A wide number has a number of each of several bodies, in the lanes of a vector; kernels accept it like a number.

Each lane has the arithmetic of plain numbers, so a body's bits depend neither on its neighbours nor on the width of the
machine's vectors. These types are for Numba; without compiling, bodies are computed one after the other.

A condition on wide numbers may differ from lane to lane, and Numba refuses to branch on it. A kernel for plain and wide
numbers selects values by `choose`, and branches on `any_of` or `all_of` of the condition.
"""

import math
import operator
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TypeVar

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import lower_builtin, lower_cast, models, register_model, type_callable

from .codegen import Builder, Context, Make, Signature, Value, cast_all, register, splat

T = TypeVar("T")


def choose(condition: bool, a: T, b: T) -> T:
    """Return a in the lanes where the condition holds, b in the others; both are evaluated."""
    return a if condition else b


def any_of(condition: bool) -> bool:
    """Return whether the condition holds in any lane."""
    return condition


def all_of(condition: bool) -> bool:
    """Return whether the condition holds in all lanes."""
    return condition


def alike(x: float, value: float) -> float:
    """Return the value in each lane of x; as a plain number if x is plain."""
    return value


def bits_of(x: float) -> np.int64:
    """Return the bits of a number as an integer."""
    return np.float64(x).view(np.int64)


def number_of(bits: np.int64) -> float:
    """Return the double whose bits are those of an integer."""
    return float(np.int64(bits).view(np.float64))


# Types with one value in each lane


class InLanes(types.Type):  # type: ignore[misc]
    """The type of a vector of `width` lanes.

    lane: the type of one lane's value; plain: types of values that are the same for all lanes.
    """

    lane, plain = types.float64, types.Number

    def __init__(self, width: int) -> None:
        self.width = width
        super().__init__(f"{type(self).__name__}({width})")

    def unify(self, typingctx: object, other: types.Type) -> types.Type | None:
        """Return this type for a variable that elsewhere has a plain value, which is then that of all lanes."""
        return self if isinstance(other, self.plain) else None


class WideType(InLanes):
    """The type of a number in each lane."""

    def unify(self, typingctx: object, other: types.Type) -> types.Type | None:
        """Return also the type of four wide numbers (see `simd`), for a variable that elsewhere has four plain ones."""
        return other if is_four_wide(other) else super().unify(typingctx, other)


class MaskType(InLanes):
    """The type of a condition in each lane, on which no code can branch."""

    lane, plain = types.boolean, types.Boolean


class WideIntType(InLanes):
    """The type of the bits of a number in each lane."""

    lane, plain = types.int64, types.Integer


def is_four_wide(kind: types.Type) -> bool:
    """Return whether a type is that of four wide numbers."""
    return isinstance(kind, types.UniTuple) and len(kind) == 4 and isinstance(kind.dtype, WideType)


@register_model(WideType)
@register_model(MaskType)
@register_model(WideIntType)
class _Vector(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, manager: Mapping[types.Type, models.DataModel], of: InLanes) -> None:
        super().__init__(manager, of, ir.VectorType(manager[of.lane].get_value_type(), of.width))


@lower_cast(types.Number, WideType)  # type: ignore[untyped-decorator]
@lower_cast(types.Boolean, MaskType)  # type: ignore[untyped-decorator]
@lower_cast(types.Integer, WideIntType)  # type: ignore[untyped-decorator]
def _one_for_all(context: Context, builder: Builder, source: types.Type, target: InLanes, one: Value) -> Value:
    return splat(builder, context.cast(builder, one, source, target.lane), target.width)


# Functions


def _register_unary(function: Callable[..., object], make: Make) -> None:
    lower = register(function, lambda a: a if isinstance(a, WideType) else None, (WideType,))
    lower(lambda context, builder, signature, args: make(builder, args[0]))


def _register_binary(function: Callable[..., object], kind: type[InLanes], result: type[InLanes], make: Make) -> None:
    """Register a binary operation with Numba; one operand may be plain, which is then that of all lanes."""

    def typer(a: types.Type, b: types.Type) -> types.Type | None:
        widths = [x.width for x in (a, b) if isinstance(x, kind)]
        return result(*widths[:1]) if widths and all(isinstance(x, kind | kind.plain) for x in (a, b)) else None

    @register(function, typer, (kind, kind), (kind, kind.plain), (kind.plain, kind))
    def _(context: Context, builder: Builder, signature: Signature, args: Sequence[Value]) -> Value:
        return make(builder, *cast_all(context, builder, signature, args, kind(signature.return_type.width)))


def _compared(sign: str) -> Make:
    return lambda builder, a, b: (builder.fcmp_unordered if sign == "!=" else builder.fcmp_ordered)(sign, a, b)


def _intrinsic(name: str) -> Make:
    def make(builder: Builder, *numbers: Value) -> Value:
        kind, module = numbers[0].type, builder.module
        full = f"{name}.v{kind.count}f64"
        known = module.globals.get(full) or ir.Function(module, ir.FunctionType(kind, [kind] * len(numbers)), full)
        return builder.call(known, numbers)

    return make


_SIGNS = {
    "<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge, "==": operator.eq, "!=": operator.ne,
}  # fmt: skip
_BINARY: list[tuple[type[InLanes], type[InLanes], dict[Callable[..., object], Make]]] = [
    (WideType, WideType, {
        operator.add: Builder.fadd, operator.iadd: Builder.fadd, operator.sub: Builder.fsub,
        operator.isub: Builder.fsub, operator.mul: Builder.fmul, operator.imul: Builder.fmul,
        operator.truediv: Builder.fdiv, math.copysign: _intrinsic("llvm.copysign"),
        max: lambda builder, a, b: builder.select(builder.fcmp_ordered(">", b, a), b, a),
    }),
    (WideType, MaskType, {function: _compared(sign) for sign, function in _SIGNS.items()}),
    (MaskType, MaskType, {operator.and_: Builder.and_, operator.or_: Builder.or_, operator.xor: Builder.xor}),
    (WideIntType, WideIntType, {
        operator.and_: Builder.and_, operator.xor: Builder.xor, operator.lshift: Builder.shl,
        operator.rshift: Builder.ashr, operator.sub: Builder.sub, operator.add: Builder.add,
    }),
    (WideIntType, MaskType, {operator.ne: lambda builder, a, b: builder.icmp_unsigned("!=", a, b)}),
]  # fmt: skip
"""Binary operations: the type of at least one operand, the type of the result, the instructions of each operation."""
for _kind, _result, _functions in _BINARY:
    for _function, _make in _functions.items():
        _register_binary(_function, _kind, _result, _make)
_register_unary(operator.neg, Builder.fneg)
_register_unary(abs, _intrinsic("llvm.fabs"))
_register_unary(math.sqrt, _intrinsic("llvm.sqrt"))
_register_unary(math.ceil, _intrinsic("llvm.ceil"))


def _register_summary(function: Callable[..., object], sign: str, bits_of: Callable[[int], int]) -> None:
    """Register a function that compares a mask's bits with a number; it returns a plain condition unchanged."""

    @register(function, lambda a: types.boolean if isinstance(a, MaskType | types.Boolean) else None)
    def _(context: Context, builder: Builder, signature: Signature, args: Sequence[Value]) -> Value:
        if not isinstance(signature.args[0], MaskType):
            return args[0]
        bits = builder.bitcast(args[0], ir.IntType(args[0].type.count))
        return builder.icmp_unsigned(sign, bits, bits.type(bits_of(bits.type.width)))


_register_summary(any_of, "!=", lambda width: 0)
_register_summary(all_of, "==", lambda width: (1 << width) - 1)


@register(alike, lambda x, value: x if isinstance(x, WideType | types.Float) else None)
def _alike(context: Context, builder: Builder, signature: Signature, args: Sequence[Value]) -> Value:
    return context.cast(builder, args[1], signature.args[1], signature.return_type)


def _type_of_choice(context: Context, condition: types.Type, a: types.Type, b: types.Type) -> types.Type | None:
    if isinstance(condition, MaskType):
        return WideType(condition.width)
    return context.unify_pairs(a, b) if isinstance(condition, types.Boolean) else None


type_callable(choose)(lambda context: partial(_type_of_choice, context))


@lower_builtin(choose, types.VarArg(types.Any))  # type: ignore[untyped-decorator]
def _choose(context: Context, builder: Builder, signature: Signature, args: Sequence[Value]) -> Value:
    kind = signature.return_type
    a, b = (context.cast(builder, x, k, kind) for x, k in zip(args[1:], signature.args[1:], strict=True))
    return builder.select(args[0], a, b)


def _type_of_bits(x: types.Type) -> types.Type | None:
    return WideIntType(x.width) if isinstance(x, WideType) else types.int64 if isinstance(x, types.Float) else None


def _type_of_number(x: types.Type) -> types.Type | None:
    return WideType(x.width) if isinstance(x, WideIntType) else types.float64 if isinstance(x, types.Integer) else None


@register(bits_of, _type_of_bits)
@register(number_of, _type_of_number)
def _bits(context: Context, builder: Builder, signature: Signature, args: Sequence[Value]) -> Value:
    return builder.bitcast(args[0], context.get_value_type(signature.return_type))
