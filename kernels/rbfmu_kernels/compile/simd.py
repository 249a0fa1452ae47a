"""Four numbers side by side, on which the same is done at once: a vector of the machine, or a tuple in Python.

A lane's arithmetic is that of plain numbers, so that no bit depends on how wide the machine's vectors are. What stands
here is for Python; Numba puts instructions on vectors in its place.
"""

from collections.abc import Callable
from inspect import signature
from struct import Struct
from typing import Any, cast

from llvmlite import ir
from numba import float64, intp, types
from numba.extending import lower_builtin, models, register_model, type_callable

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


def add_lanes(a: Lanes, b: Lanes) -> Lanes:
    """Add lane by lane."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3])


def multiply_lanes(a: Lanes, b: Lanes) -> Lanes:
    """Multiply lane by lane."""
    return (a[0] * b[0], a[1] * b[1], a[2] * b[2], a[3] * b[3])


class LanesType(types.Type):  # type: ignore[misc]
    """The type of four numbers side by side."""

    def __init__(self) -> None:
        super().__init__("Lanes")

    def unify(self, typingctx: Any, other: Any) -> Any:
        """Return the type of four wide numbers, see `wide`, for a variable that is sometimes four plain ones."""
        return other if isinstance(other, types.UniTuple) and len(other) == 4 else None


_LANES = LanesType()
_VECTOR, _INT = ir.VectorType(ir.DoubleType(), 4), ir.IntType(32)


@register_model(LanesType)
class _Model(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _VECTOR)


def _compiled(function: Callable[..., Any], kind: Callable[..., Any], *own: Any) -> Callable[[Any], Any]:
    """Return a decorator: what is decorated makes machine code.

    kind: the signature from the arguments' types; own: the classes of these, as others may register more.
    """

    def register(generate: Any) -> Any:
        def typer(*args: Any) -> Any:
            return kind(*args) if all(map(isinstance, args, own)) else None

        typer.pysig = signature(kind)  # type: ignore[attr-defined]
        type_callable(function)(lambda context: typer)
        lower_builtin(function, types.VarArg(types.Any))(generate)
        return generate

    return register


@_compiled(lanes, lambda a, b, c, d: _LANES(float64, float64, float64, float64), *[types.Number] * 4)
def _lanes(context: Any, builder: Any, signature: Any, args: Any) -> Any:
    vector = ir.Constant(_VECTOR, ir.Undefined)
    for k, number in enumerate(args):
        vector = builder.insert_element(vector, number, _INT(k))
    return vector


@_compiled(numbers, lambda a: types.UniTuple(float64, 4)(a), LanesType)
def _numbers(context: Any, builder: Any, signature: Any, args: Any) -> Any:
    parts = [builder.extract_element(args[0], _INT(k)) for k in range(4)]
    return context.make_tuple(builder, signature.return_type, parts)


@_compiled(lanes_at, lambda z, i: _LANES(z, intp), types.Array)
def _lanes_at(context: Any, builder: Any, signature: Any, args: Any) -> Any:
    vector = builder.load(_place(context, builder, signature, args), typ=_VECTOR)
    vector.align = 8
    return vector


@_compiled(put_lanes, lambda z, i, a: types.none(z, intp, a), types.Array)
def _put_lanes(context: Any, builder: Any, signature: Any, args: Any) -> Any:
    builder.store(args[2], _place(context, builder, signature, args)).align = 8
    return context.get_dummy_value()


def _place(context: Any, builder: Any, signature: Any, args: Any) -> Any:
    data = context.make_array(signature.args[0])(context, builder, args[0]).data
    return builder.bitcast(builder.gep(data, [args[1]]), _VECTOR.as_pointer())


@_compiled(add_lanes, lambda a, b: a(a, b), LanesType, LanesType)
def _add_lanes(context: Any, builder: Any, signature: Any, args: Any) -> Any:
    return builder.fadd(*args)


@_compiled(multiply_lanes, lambda a, b: a(a, b), LanesType, LanesType)
def _multiply_lanes(context: Any, builder: Any, signature: Any, args: Any) -> Any:
    return builder.fmul(*args)
