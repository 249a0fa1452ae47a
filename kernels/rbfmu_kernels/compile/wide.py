"""A number of each of several bodies side by side, in the lanes of a vector: kernels take it where they take a number.

A lane's arithmetic is that of plain numbers, so that a body's bits depend neither on its neighbours nor on how wide the
machine's vectors are. What stands here is for Numba; where nothing is compiled, bodies go one after the other.

Where a kernel for both decides by a number, it asks `choose`, whose answer may differ from lane to lane. Numba refuses
to branch on a condition that may: it is asked `any_of` and `all_of`.
"""

import math
import operator
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import lower_builtin, lower_cast, models, register_model, type_callable

T = TypeVar("T")


def choose(condition: bool, a: T, b: T) -> T:
    """Return a where the condition holds, else b; both are known."""
    return a if condition else b


def any_of(condition: bool) -> bool:
    """Return whether the condition holds in any lane."""
    return condition


def all_of(condition: bool) -> bool:
    """Return whether the condition holds in all lanes."""
    return condition


def alike(x: float, value: float) -> float:
    """Return a value in as many lanes as x has."""
    return value


def always(x: float) -> bool:
    """Return the condition that holds in as many lanes as x has."""
    return True


class InLanes(types.Type):  # type: ignore[misc]
    """The type of what there is one of in each of `width` lanes."""

    def __init__(self, width: int) -> None:
        self.width = width
        super().__init__(f"{type(self).__name__}({width})")


def register_value(kind: type[types.Type], value: Callable[[int], Any]) -> None:
    """Let Numba know what LLVM has for a type; value: from its width."""

    @register_model(kind)
    class Value(models.PrimitiveModel):  # type: ignore[misc]
        def __init__(self, manager: Any, of: Any) -> None:
            super().__init__(manager, of, value(of.width))


class WideType(InLanes):
    """The type of a number in each of `width` lanes."""

    def unify(self, typingctx: Any, other: Any) -> Any:
        """Return itself as the type of a variable that is sometimes one number for all lanes."""
        return self if isinstance(other, types.Number) else None


class MaskType(InLanes):
    """The type of a condition in each of `width` lanes, on which no code can branch."""

    def unify(self, typingctx: Any, other: Any) -> Any:
        """Return itself as the type of a variable that is sometimes one condition for all lanes."""
        return self if isinstance(other, types.Boolean) else None


register_value(WideType, lambda width: ir.VectorType(ir.DoubleType(), width))


register_value(MaskType, lambda width: ir.VectorType(ir.IntType(1), width))


Generate = Callable[[Any, Any, Any, Any], Any]
"""What makes machine code: of Numba's context, LLVM's builder, the signature, the arguments."""


def register(function: Any, typer: Callable[..., Any], *kinds: tuple[Any, ...]) -> Callable[[Generate], Generate]:
    """Let Numba know a function: return a decorator of what makes its machine code.

    typer: the type of its result, or its signature, from the types of its arguments, None where others know them;
    kinds: tuples of types of arguments; any, if there are none.
    """
    type_callable(function)(lambda context: typer)

    def let_lower(generate: Generate) -> Generate:
        for arguments in kinds or ((types.VarArg(types.Any),),):
            lower_builtin(function, *arguments)(generate)
        return generate

    return let_lower


def width_among(kind: type[InLanes], *args: Any) -> int:
    """Return the width of the types of a kind among those of arguments, 0 where there is none."""
    return max((one.width for one in args if isinstance(one, kind)), default=0)


# One number for all lanes


def splat(builder: Any, number: Any, width: int) -> Any:
    """Return a vector of equal numbers."""
    one = ir.Constant(ir.VectorType(number.type, width), ir.Undefined)
    one = builder.insert_element(one, number, ir.Constant(ir.IntType(32), 0))
    return builder.shuffle_vector(one, one, ir.Constant(ir.VectorType(ir.IntType(32), width), [0] * width))


@lower_cast(types.Number, WideType)  # type: ignore[untyped-decorator]
def _wide_number(context: Any, builder: Any, source: Any, target: Any, number: Any) -> Any:
    return splat(builder, context.cast(builder, number, source, types.float64), target.width)


lower_cast(types.Boolean, MaskType)(
    lambda context, builder, source, target, condition: splat(builder, condition, target.width)
)


# Operations on two: one of them may be plain, which is that of all lanes


def _register_binary(function: Any, kind: type[InLanes], plain: Any, result: type[InLanes], make: Any) -> None:
    def typer(a: Any, b: Any) -> Any:
        width = width_among(kind, a, b)
        return result(width) if width and all(isinstance(x, kind | plain) for x in (a, b)) else None

    @register(function, typer, (kind, kind), (kind, plain), (plain, kind))
    def _(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        wide = kind(width_among(kind, *signature.args))
        return make(
            builder, *(context.cast(builder, a, own, wide) for a, own in zip(args, signature.args, strict=True))
        )


def _register_unary(function: Callable[..., Any], make: Callable[..., Any]) -> None:
    lower = register(function, lambda a: a if isinstance(a, WideType) else None, (WideType,))
    lower(lambda context, builder, signature, args: make(builder, args[0]))


def _compared(sign: str) -> Callable[..., Any]:
    return lambda builder, a, b: (builder.fcmp_unordered if sign == "!=" else builder.fcmp_ordered)(sign, a, b)


def _intrinsic(name: str) -> Callable[..., Any]:
    def make(builder: Any, *numbers: Any) -> Any:
        kind, module = numbers[0].type, builder.module
        full = f"{name}.v{kind.count}f64"
        known = module.globals.get(full) or ir.Function(module, ir.FunctionType(kind, [kind] * len(numbers)), full)
        return builder.call(known, numbers)

    return make


for _functions, _make in {
    (operator.add, operator.iadd): lambda builder, a, b: builder.fadd(a, b),
    (operator.sub, operator.isub): lambda builder, a, b: builder.fsub(a, b),
    (operator.mul, operator.imul): lambda builder, a, b: builder.fmul(a, b),
    (operator.truediv,): lambda builder, a, b: builder.fdiv(a, b),
    (max,): lambda builder, a, b: builder.select(builder.fcmp_ordered(">", b, a), b, a),
    (math.copysign,): _intrinsic("llvm.copysign"),
}.items():
    for _function in _functions:
        _register_binary(_function, WideType, types.Number, WideType, _make)
for _sign, _comparison in {
    "<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge, "==": operator.eq, "!=": operator.ne,
}.items():  # fmt: skip
    _register_binary(_comparison, WideType, types.Number, MaskType, _compared(_sign))
_register_unary(operator.neg, lambda builder, a: builder.fneg(a))
_register_unary(abs, _intrinsic("llvm.fabs"))
_register_unary(math.sqrt, _intrinsic("llvm.sqrt"))
_register_unary(math.ceil, _intrinsic("llvm.ceil"))


# Conditions


_register_binary(operator.and_, MaskType, types.Boolean, MaskType, lambda builder, a, b: builder.and_(a, b))
_register_binary(operator.xor, MaskType, types.Boolean, MaskType, lambda builder, a, b: builder.xor(a, b))
_register_binary(operator.or_, MaskType, types.Boolean, MaskType, lambda builder, a, b: builder.or_(a, b))


def _register_summary(function: Callable[..., Any], sign: str, bits_of: Callable[[int], int]) -> None:
    """Let a function compare a mask's bits with a number; a condition that is one for all lanes is itself."""

    @register(function, lambda a: types.boolean if isinstance(a, MaskType | types.Boolean) else None, (types.Any,))
    def _(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        if not isinstance(signature.args[0], MaskType):
            return args[0]
        bits = builder.bitcast(args[0], ir.IntType(args[0].type.count))
        return builder.icmp_unsigned(sign, bits, bits.type(bits_of(bits.type.width)))


_register_summary(any_of, "!=", lambda width: 0)
_register_summary(all_of, "==", lambda width: (1 << width) - 1)


@register(alike, lambda x, value: x if isinstance(x, WideType | types.Float) else None)
def _alike(context: Any, builder: Any, signature: Any, args: Any) -> Any:
    return context.cast(builder, args[1], signature.args[1], signature.return_type)


@register(always, lambda x: MaskType(x.width) if isinstance(x, WideType) else types.boolean)
def _always(context: Any, builder: Any, signature: Any, args: Any) -> Any:
    true = context.get_constant(types.boolean, True)
    return context.cast(builder, true, types.boolean, signature.return_type)


@type_callable(choose)  # type: ignore[untyped-decorator]
def _type_choose(context: Any) -> Any:
    def typer(condition: Any, a: Any, b: Any) -> Any:
        if isinstance(condition, MaskType):
            return WideType(condition.width)
        return context.unify_pairs(a, b) if isinstance(condition, types.Boolean) else None

    return typer


@lower_builtin(choose, types.VarArg(types.Any))  # type: ignore[untyped-decorator]
def _choose(context: Any, builder: Any, signature: Any, args: Any) -> Any:
    kind = signature.return_type
    a, b = (context.cast(builder, x, k, kind) for x, k in zip(args[1:], signature.args[1:], strict=True))
    return builder.select(args[0], a, b)


def bits_of(x: float) -> np.int64:
    """Return the bits of a number as an integer."""
    return np.float64(x).view(np.int64)


def number_of(bits: np.int64) -> float:
    """Return the number that an integer has the bits of."""
    return float(np.int64(bits).view(np.float64))


class WideIntType(InLanes):
    """The type of the bits of a number in each of `width` lanes."""


register_value(WideIntType, lambda width: ir.VectorType(ir.IntType(64), width))


@lower_cast(types.Integer, WideIntType)  # type: ignore[untyped-decorator]
def _wide_integer(context: Any, builder: Any, source: Any, target: Any, number: Any) -> Any:
    return splat(builder, context.cast(builder, number, source, types.int64), target.width)


def _register_bits(function: Callable[..., Any], one: Any, other: Any, wide: Any, other_wide: Any) -> None:
    def typer(a: Any) -> Any:
        return other_wide(a.width) if isinstance(a, wide) else (other if isinstance(a, one) else None)

    @register(function, typer)
    def _(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.bitcast(args[0], context.get_value_type(signature.return_type))


_register_bits(bits_of, types.Float, types.int64, WideType, WideIntType)
_register_bits(number_of, types.Integer, types.float64, WideIntType, WideType)
for _function, _result, _make in (
    (operator.and_, WideIntType, lambda builder, a, b: builder.and_(a, b)),
    (operator.xor, WideIntType, lambda builder, a, b: builder.xor(a, b)),
    (operator.lshift, WideIntType, lambda builder, a, b: builder.shl(a, b)),
    (operator.rshift, WideIntType, lambda builder, a, b: builder.ashr(a, b)),
    (operator.sub, WideIntType, lambda builder, a, b: builder.sub(a, b)),
    (operator.add, WideIntType, lambda builder, a, b: builder.add(a, b)),
    (operator.ne, MaskType, lambda builder, a, b: builder.icmp_unsigned("!=", a, b)),
):
    _register_binary(_function, WideIntType, types.Integer, _result, _make)
