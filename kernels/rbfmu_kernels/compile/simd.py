"""Four numbers side by side, on which the same is done at once: a vector of the machine, or a tuple in Python.

A lane's arithmetic is that of plain numbers, so that no bit depends on how wide the machine's vectors are.
"""

from typing import Any

from llvmlite import ir
from numba import config, float64, intp, types
from numba.extending import intrinsic, models, register_model

Lanes = tuple[float, float, float, float]


class _Type(types.Type):  # type: ignore[misc]
    def __init__(self) -> None:
        super().__init__("Lanes")


_LANES = _Type()
_VECTOR, _INT = ir.VectorType(ir.DoubleType(), 4), ir.IntType(32)


@register_model(_Type)
class _Model(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _VECTOR)


@intrinsic  # type: ignore[untyped-decorator]
def lanes(typingctx: Any, a: Any, b: Any, c: Any, d: Any) -> Any:
    """Return four numbers side by side."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        vector = ir.Constant(_VECTOR, ir.Undefined)
        for k, number in enumerate(args):
            vector = builder.insert_element(vector, number, _INT(k))
        return vector

    return _LANES(float64, float64, float64, float64), generate


@intrinsic  # type: ignore[untyped-decorator]
def numbers(typingctx: Any, a: Any) -> Any:
    """Return the four numbers."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return context.make_tuple(
            builder, signature.return_type, [builder.extract_element(args[0], _INT(k)) for k in range(4)]
        )

    return types.UniTuple(float64, 4)(a), generate


@intrinsic  # type: ignore[untyped-decorator]
def lanes_at(typingctx: Any, z: Any, i: Any) -> Any:
    """Return the four numbers from z[i] on."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        vector = builder.load(_place(context, builder, signature, args), typ=_VECTOR)
        vector.align = 8
        return vector

    return _LANES(z, intp), generate


@intrinsic  # type: ignore[untyped-decorator]
def put_lanes(typingctx: Any, z: Any, i: Any, a: Any) -> Any:
    """Store four numbers from z[i] on."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        builder.store(args[2], _place(context, builder, signature, args)).align = 8
        return context.get_dummy_value()

    return types.none(z, intp, a), generate


def _place(context: Any, builder: Any, signature: Any, args: Any) -> Any:
    data = context.make_array(signature.args[0])(context, builder, args[0]).data
    return builder.bitcast(builder.gep(data, [args[1]]), _VECTOR.as_pointer())


@intrinsic  # type: ignore[untyped-decorator]
def add_lanes(typingctx: Any, a: Any, b: Any) -> Any:
    """Add lane by lane."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.fadd(*args)

    return a(a, b), generate


@intrinsic  # type: ignore[untyped-decorator]
def multiply_lanes(typingctx: Any, a: Any, b: Any) -> Any:
    """Multiply lane by lane."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.fmul(*args)

    return a(a, b), generate


def _plain_lanes(a: float, b: float, c: float, d: float) -> Lanes:
    """Return four numbers side by side."""
    return (a, b, c, d)


def _plain_numbers(a: Lanes) -> Lanes:
    """Return the four numbers."""
    return a


def _plain_lanes_at(z: Any, i: int) -> Lanes:
    """Return the four numbers from z[i] on."""
    return (z[i], z[i + 1], z[i + 2], z[i + 3])


def _plain_put_lanes(z: Any, i: int, a: Lanes) -> None:
    """Store four numbers from z[i] on."""
    z[i : i + 4] = a


def _plain_add_lanes(a: Lanes, b: Lanes) -> Lanes:
    """Add lane by lane."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3])


def _plain_multiply_lanes(a: Lanes, b: Lanes) -> Lanes:
    """Multiply lane by lane."""
    return (a[0] * b[0], a[1] * b[1], a[2] * b[2], a[3] * b[3])


IN_PYTHON: tuple[tuple[Any, Any], ...] = (
    (lanes, _plain_lanes),
    (numbers, _plain_numbers),
    (lanes_at, _plain_lanes_at),
    (put_lanes, _plain_put_lanes),
    (add_lanes, _plain_add_lanes),
    (multiply_lanes, _plain_multiply_lanes),
)
"""What stands for each in a kernel that runs in plain Python."""

if config.DISABLE_JIT:
    lanes, numbers, lanes_at, put_lanes, add_lanes, multiply_lanes = (plain for _, plain in IN_PYTHON)
