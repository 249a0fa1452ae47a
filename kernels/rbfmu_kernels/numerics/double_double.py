"""Double-double arithmetic: a number as an unevaluated sum (high, low), |low| <= half an ulp of high, 106 bits.

Error-free sums by Knuth, products by Dekker (1971) with Veltkamp's splitting (no fused multiply-add: the same bits
on every platform).  Algorithms and bounds: Joldes, Muller & Popescu, ACM TOMS 44 (2017), u = 2^-53.
Callers must scale their numbers: beyond 1e299 the splitting overflows, and products below 1e-290 lose their low part.
"""

import math

from ..compile.decorator import kernel
from ..compile.wide import choose as choose_part
from ..types import Array, Vec3

DoubleDouble = tuple[float, float]
Two = tuple[DoubleDouble, DoubleDouble]
Three = tuple[DoubleDouble, DoubleDouble, DoubleDouble]
Vector = Three

PI: DoubleDouble = (3.141592653589793116, 1.224646799147353207e-16)
ONE_OVER_PI: DoubleDouble = (0.3183098861837907, -1.9678676675182486e-17)

_SPLIT = 134217729.0  # 2^27 + 1


@kernel
def two_sum(a: float, b: float) -> DoubleDouble:
    """Return a + b exactly (Knuth)."""
    s = a + b
    t = s - a
    return (s, (a - (s - t)) + (b - t))


@kernel
def quick_two_sum(a: float, b: float) -> DoubleDouble:
    """Return a + b exactly, for |a| >= |b| or a = 0 (Dekker)."""
    s = a + b
    return (s, b - (s - a))


@kernel
def two_product(a: float, b: float) -> DoubleDouble:
    """Return the product a b exactly (Dekker, Veltkamp).

    |a|, |b| < 1e299, and |a b| not in (0, 1e-290).
    """
    c = _SPLIT * a
    a1 = c - (c - a)
    a2 = a - a1
    c = _SPLIT * b
    b1 = c - (c - b)
    b2 = b - b1
    p = a * b
    return (p, ((a1 * b1 - p) + a1 * b2 + a2 * b1) + a2 * b2)


@kernel
def negate(a: DoubleDouble) -> DoubleDouble:
    """Return -a."""
    return (-a[0], -a[1])


@kernel
def scale(power: float, a: DoubleDouble) -> DoubleDouble:
    """Return power a, exact for a power of two (or a sign)."""
    return (power * a[0], power * a[1])


@kernel
def add(a: DoubleDouble, b: DoubleDouble) -> DoubleDouble:
    """Return a + b.  Error <= 3 u^2 (|a| + |b|): relative only as far as they do not cancel."""
    s, e = two_sum(a[0], b[0])
    return quick_two_sum(s, e + (a[1] + b[1]))


@kernel
def subtract(a: DoubleDouble, b: DoubleDouble) -> DoubleDouble:
    """Return a - b.  Error <= 3 u^2 (|a| + |b|)."""
    return add(a, negate(b))


@kernel
def add_float(a: DoubleDouble, b: float) -> DoubleDouble:
    """Return a + b.  Error <= 2 u^2 (|a| + |b|)."""
    s, e = two_sum(a[0], b)
    return quick_two_sum(s, e + a[1])


@kernel
def multiply(a: DoubleDouble, b: DoubleDouble) -> DoubleDouble:
    """Return a b.  Relative error <= 7 u^2."""
    p, e = two_product(a[0], b[0])
    return quick_two_sum(p, e + (a[0] * b[1] + a[1] * b[0]))


@kernel
def multiply_float(a: DoubleDouble, b: float) -> DoubleDouble:
    """Return a b.  Relative error <= 3 u^2."""
    p, e = two_product(a[0], b)
    return quick_two_sum(p, e + a[1] * b)


@kernel
def vector(v: Vec3) -> Vector:
    """Return floats as double-double numbers, exactly."""
    return ((v[0], 0.0), (v[1], 0.0), (v[2], 0.0))


@kernel
def scale_vector(power: float, v: Vector) -> Vector:
    """Return power v, exact for a power of two."""
    return (scale(power, v[0]), scale(power, v[1]), scale(power, v[2]))


@kernel
def dot(a: Vector, b: Vector) -> DoubleDouble:
    """Return a . b.  Error <= 20 u^2 |a| |b|."""
    return add(add(multiply(a[0], b[0]), multiply(a[1], b[1])), multiply(a[2], b[2]))


@kernel
def dot_of_floats(a: Vec3, b: Vec3) -> DoubleDouble:
    """Return a . b.  Error <= 6 u^2 |a| |b|, as the products are exact."""
    return add(add(two_product(a[0], b[0]), two_product(a[1], b[1])), two_product(a[2], b[2]))


@kernel
def divide(a: DoubleDouble, b: DoubleDouble) -> DoubleDouble:
    """Return a / b, b != 0.  Relative error <= 15 u^2."""
    inverse = 1.0 / b[0]
    quotient = a[0] * inverse
    p, e = two_product(quotient, b[0])
    rest = ((a[0] - p) - e) + (a[1] - quotient * b[1])
    return quick_two_sum(quotient, rest * inverse)


@kernel
def root(a: DoubleDouble) -> DoubleDouble:
    """Return the square root; 0 for a <= 0.  Relative error <= 4 u^2 (one Newton step, Karp & Markstein 1997)."""
    none = a[0] <= 0.0  # False for NaN, which is treated like a positive number
    first = math.sqrt(choose_part(none, 1.0, a[0]))
    half_inverse = 0.5 / first
    p, e = two_product(first, first)
    high, low = quick_two_sum(first, (((a[0] - p) - e) + a[1]) * half_inverse)
    return (choose_part(none, 0.0, high), choose_part(none, 0.0, low))


@kernel
def choose(condition: bool, a: DoubleDouble, b: DoubleDouble) -> DoubleDouble:
    """Return a where the condition holds, else b."""
    return (choose_part(condition, a[0], b[0]), choose_part(condition, a[1], b[1]))


@kernel
def equal(a: DoubleDouble, b: DoubleDouble) -> bool:
    """Return whether a = b."""
    return (a[0] == b[0]) & (a[1] == b[1])


@kernel
def less(a: DoubleDouble, b: DoubleDouble) -> bool:
    """Return whether a < b."""
    return (a[0] < b[0]) | ((a[0] == b[0]) & (a[1] < b[1]))


@kernel
def at(s: Array, i: int) -> DoubleDouble:
    """Return the number s[:, i]."""
    return (s[0, i], s[1, i])


@kernel
def put(s: Array, i: int, a: DoubleDouble) -> None:
    """Set s[:, i]."""
    s[0, i], s[1, i] = a
