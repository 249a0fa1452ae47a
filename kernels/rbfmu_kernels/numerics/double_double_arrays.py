"""Double-double numbers in arrays whose first index is the part: s[0, ...] high, s[1, ...] low."""

from typing import Any

from ..compile.decorator import kernel
from .double_double import DoubleDouble, dd_add, dd_multiply, dd_subtract


@kernel
def dd_at(s: Any, i: int) -> DoubleDouble:
    """Return the number s[:, i]."""
    return (s[0, i], s[1, i])


@kernel
def put_dd(s: Any, i: int, a: DoubleDouble) -> None:
    """Set s[:, i]."""
    s[0, i], s[1, i] = a


@kernel(inline=False)
def add_product(s: Any, out: int, c: Any, i: int, x: Any, j: int) -> None:
    """Add c[i] x[j] to s[out]."""
    put_dd(s, out, dd_add(dd_at(s, out), dd_multiply(dd_at(c, i), dd_at(x, j))))


@kernel(inline=False)
def add_cross(s: Any, out: int, a: Any, i: int, b: Any, j: int) -> None:
    """Add a[i:] x b[j:] to s[out:]."""
    for n in range(3):
        y, z = (n + 1) % 3, (n + 2) % 3
        add_product(s, out + n, a, i + y, b, j + z)
        left = dd_multiply(dd_at(a, i + z), dd_at(b, j + y))
        put_dd(s, out + n, dd_subtract(dd_at(s, out + n), left))


@kernel(inline=False)
def add_transform(s: Any, out: int, c: Any, i: int, x: Any, j: int) -> None:
    """Add (matrix at c[i:]) x[j:] to s[out:]."""
    for n in range(3):
        for k in range(3):
            add_product(s, out + n, c, i + 3 * n + k, x, j + k)


@kernel(inline=False)
def clear(s: Any, first: int, count: int) -> None:
    """Set numbers to zero."""
    for i in range(first, first + count):
        s[0, i] = s[1, i] = 0.0
