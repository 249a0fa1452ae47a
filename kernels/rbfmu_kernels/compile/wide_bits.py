"""The bits of a number, and those of numbers of several bodies side by side: for Numba, as `wide`."""

import operator
from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import models, register_model

from .wide import MaskType, WideType, register, splat


def bits_of(x: float) -> np.int64:
    """Return the bits of a number as an integer."""
    return np.float64(x).view(np.int64)


def number_of(bits: np.int64) -> float:
    """Return the number that an integer has the bits of."""
    return float(np.int64(bits).view(np.float64))


class WideIntType(types.Type):  # type: ignore[misc]
    """The type of the bits of a number in each of `width` lanes."""

    def __init__(self, width: int) -> None:
        self.width = width
        super().__init__(f"WideInt({width})")


@register_model(WideIntType)
class _WideIntModel(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, ir.VectorType(ir.IntType(64), kind.width))


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
