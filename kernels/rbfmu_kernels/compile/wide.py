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


def register(
    function: Callable[..., Any], typer: Callable[..., Any], generate: Generate, *kinds: tuple[Any, ...]
) -> None:
    """Let Numba know a function; typer: the type of its result from those of its arguments; kinds: tuples of these."""
    type_callable(function)(lambda context: typer)
    for arguments in kinds:
        lower_builtin(function, *arguments)(generate)


def _is_mask(*kinds: Any) -> bool:
    return all(isinstance(kind, MaskType) for kind in kinds)


def width_among(*kinds: Any) -> int:
    """Return the width of the wide numbers among types, 0 where there is none."""
    return max((kind.width for kind in kinds if isinstance(kind, WideType)), default=0)


# One number for all lanes


def splat(builder: Any, number: Any, width: int) -> Any:
    """Return a vector of equal numbers."""
    one = ir.Constant(ir.VectorType(number.type, width), ir.Undefined)
    one = builder.insert_element(one, number, ir.Constant(ir.IntType(32), 0))
    return builder.shuffle_vector(one, one, ir.Constant(ir.VectorType(ir.IntType(32), width), [0] * width))


def widened(context: Any, builder: Any, number: Any, kind: Any, width: int) -> Any:
    """Return a number of any kind as a wide one."""
    if isinstance(kind, WideType):
        return number
    return splat(builder, context.cast(builder, number, kind, types.float64), width)


lower_cast(types.Number, WideType)(
    lambda context, builder, source, target, number: widened(context, builder, number, source, target.width)
)
lower_cast(types.Boolean, MaskType)(
    lambda context, builder, source, target, condition: splat(builder, condition, target.width)
)


# Arithmetic: one of two operands may be a number, which is that of all lanes


def _register_binary(function: Any, result: Any, make: Callable[..., Any]) -> None:
    def typer(a: Any, b: Any) -> Any:
        width = width_among(a, b)
        return result(width) if width and all(isinstance(x, WideType | types.Number) for x in (a, b)) else None

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        kinds, width = signature.args, width_among(*signature.args)
        return make(builder, *(widened(context, builder, a, kind, width) for a, kind in zip(args, kinds, strict=True)))

    register(function, typer, generate, (WideType, WideType), (WideType, types.Number), (types.Number, WideType))


def _register_unary(function: Callable[..., Any], make: Callable[..., Any]) -> None:
    def typer(a: Any) -> Any:
        return a if isinstance(a, WideType) else None

    register(function, typer, lambda context, builder, signature, args: make(builder, args[0]), (WideType,))


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
        _register_binary(_function, WideType, _make)
for _sign, _comparison in {
    "<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge, "==": operator.eq, "!=": operator.ne,
}.items():  # fmt: skip
    _register_binary(_comparison, MaskType, _compared(_sign))
_register_unary(operator.neg, lambda builder, a: builder.fneg(a))
_register_unary(abs, _intrinsic("llvm.fabs"))
_register_unary(math.sqrt, _intrinsic("llvm.sqrt"))
_register_unary(math.ceil, _intrinsic("llvm.ceil"))


# Conditions


def _register_logic(function: Callable[..., Any], make: Callable[..., Any]) -> None:
    def typer(a: Any, b: Any) -> Any:
        return a if _is_mask(a, b) else None

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return make(builder, *args)

    register(function, typer, generate, (MaskType, MaskType))


_register_logic(operator.and_, lambda builder, a, b: builder.and_(a, b))
_register_logic(operator.or_, lambda builder, a, b: builder.or_(a, b))


def _register_summary(function: Callable[..., Any], sign: str, bits_of: Callable[[int], int]) -> None:
    """Let a function compare a mask's bits with a number; a condition that is one for all lanes is itself."""

    def typer(a: Any) -> Any:
        return types.boolean if isinstance(a, MaskType | types.Boolean) else None

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        if not _is_mask(*signature.args):
            return args[0]
        bits = builder.bitcast(args[0], ir.IntType(args[0].type.count))
        return builder.icmp_unsigned(sign, bits, bits.type(bits_of(bits.type.width)))

    register(function, typer, generate, (types.Any,))


_register_summary(any_of, "!=", lambda width: 0)
_register_summary(all_of, "==", lambda width: (1 << width) - 1)


def _alike(context: Any, builder: Any, signature: Any, args: Any) -> Any:
    return context.cast(builder, args[1], signature.args[1], signature.return_type)


def _always(context: Any, builder: Any, signature: Any, args: Any) -> Any:
    true = context.get_constant(types.boolean, True)
    return context.cast(builder, true, types.boolean, signature.return_type)


def _type_alike(x: Any, value: Any) -> Any:
    return x if isinstance(x, WideType | types.Float) else None


def _type_always(x: Any) -> Any:
    return MaskType(x.width) if isinstance(x, WideType) else types.boolean


register(alike, _type_alike, _alike, (types.VarArg(types.Any),))
register(always, _type_always, _always, (types.VarArg(types.Any),))


@type_callable(choose)  # type: ignore[untyped-decorator]
def _type_choose(context: Any) -> Any:
    def typer(condition: Any, a: Any, b: Any) -> Any:
        if _is_mask(condition):
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


def _bits_of(context: Any, builder: Any, signature: Any, args: Any) -> Any:
    return builder.bitcast(args[0], context.get_value_type(signature.return_type))


def _register_bits(function: Callable[..., Any], one: Any, other: Any, wide: Any, other_wide: Any) -> None:
    def typer(a: Any) -> Any:
        return other_wide(a.width) if isinstance(a, wide) else (other if isinstance(a, one) else None)

    register(function, typer, _bits_of, (types.VarArg(types.Any),))


_register_bits(bits_of, types.Float, types.int64, WideType, WideIntType)
_register_bits(number_of, types.Integer, types.float64, WideIntType, WideType)


def _register_on_bits(function: Any, make: Callable[..., Any], result: Any = WideIntType) -> None:
    """Lower an operation on wide bits with an integer that is the same in all lanes, or with others."""

    def typer(a: Any, b: Any) -> Any:
        return result(a.width) if isinstance(a, WideIntType) and isinstance(b, WideIntType | types.Integer) else None

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        a, b = args
        if not isinstance(signature.args[1], WideIntType):
            b = splat(builder, context.cast(builder, b, signature.args[1], types.int64), signature.args[0].width)
        return make(builder, a, b)

    register(function, typer, generate, (WideIntType, WideIntType), (WideIntType, types.Integer))


_register_on_bits(operator.and_, lambda builder, a, b: builder.and_(a, b))
_register_on_bits(operator.xor, lambda builder, a, b: builder.xor(a, b))
_register_on_bits(operator.lshift, lambda builder, a, b: builder.shl(a, b))
_register_on_bits(operator.add, lambda builder, a, b: builder.add(a, b))
_register_on_bits(operator.ne, lambda builder, a, b: builder.icmp_unsigned("!=", a, b), MaskType)
