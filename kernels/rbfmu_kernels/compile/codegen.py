"""Machine code that is written here: types of what Numba and LLVM hand over, functions made known to Numba, vectors."""

from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

from llvmlite import ir
from numba import types
from numba.extending import lower_builtin, type_callable

Builder: TypeAlias = ir.IRBuilder
Value: TypeAlias = ir.Value
Signature: TypeAlias = Any  # Numba's types of arguments and result
Context: TypeAlias = Any  # Numba's contexts of types and of code

Generate = Callable[[Context, Builder, Signature, Sequence[Value]], Value]
"""What makes the code of a call: of context, builder, signature and arguments."""
Intrinsic = tuple[Signature, Generate]
"""What a function of Numba's `intrinsic` returns."""
Make = Callable[..., Value]
"""What makes instructions: of LLVM's builder and the operands, which are vectors."""


def register(
    function: Callable[..., object], typer: Callable[..., types.Type | Signature | None], *kinds: tuple[object, ...]
) -> Callable[[Generate], Generate]:
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


def cast_all(
    context: Context, builder: Builder, signature: Signature, args: Sequence[Value], kind: types.Type
) -> list[Value]:
    """Return arguments as ones of the same type."""
    return [context.cast(builder, a, own, kind) for a, own in zip(args, signature.args, strict=True)]


# Vectors


def splat(builder: Builder, number: Value, width: int) -> Value:
    """Return a vector of equal numbers."""
    one = ir.Constant(ir.VectorType(number.type, width), ir.Undefined)
    one = builder.insert_element(one, number, ir.Constant(ir.IntType(32), 0))
    return builder.shuffle_vector(one, one, ir.Constant(ir.VectorType(ir.IntType(32), width), [0] * width))


def load(builder: Builder, place: Value, count: int) -> Value:
    """Load `count` numbers from an address on as a vector."""
    return builder.load(builder.bitcast(place, ir.VectorType(ir.DoubleType(), count).as_pointer()), align=8)


def store(builder: Builder, vector: Value, place: Value) -> None:
    """Store a vector's numbers from an address on."""
    builder.store(vector, builder.bitcast(place, vector.type.as_pointer()), align=8)
