"""Series of a motion that serve many communication steps: dense output.

The body rate's series is that of `taylor_coefficients`. The attitude's begins at q_ab itself, as dq/dt = q o (0, omega)
/ 2 is linear, and goes on until its terms are small. Both are evaluated up to their reach.
"""

import math
from typing import Any

from ..buffer_access import quaternion_at, vec3_at
from ..compile.decorator import kernel
from ..compile.simd import add_lanes, lanes, lanes_at, multiply_lanes, numbers, put_lanes
from ..rotations.vec3 import largest_component, norm
from ..types import Quaternion, Vec3
from .taylor_coefficients import PER, RATE, ROW, ROWS, TURN, term

_HALF, _THIRD = ROW // 2, ROW * 25
_AT_ONCE = 4
"""The terms that evaluation takes at once."""
_NEAR = 1e-8
"""How near to 1 the square of a length is whose root is linear to round-off."""


@kernel
def _put_turn(s: Any, products: int, k: int, q: Quaternion) -> None:
    """Store the k-th coefficient of the attitude, and its products q o i, q o j, q o k."""
    a, b, c, d = q
    row = term(products, k)
    put_lanes(s, term(TURN, k), lanes(a, b, c, d))
    put_lanes(s, row, lanes(-b, a, d, -c))
    put_lanes(s, row + _HALF, lanes(-c, -d, a, b))
    put_lanes(s, row + _THIRD, lanes(-d, c, -b, a))


@kernel
def _turn_product(s: Any, products: int, j: int, i: int) -> Any:
    """Return q_j o (0, omega_i) of coefficients."""
    row = term(products, j)
    x, y, z = vec3_at(s, term(RATE, i & ROWS))
    along_i = multiply_lanes(lanes_at(s, row), lanes(x, x, x, x))
    along_j = multiply_lanes(lanes_at(s, row + _HALF), lanes(y, y, y, y))
    along_k = multiply_lanes(lanes_at(s, row + _THIRD), lanes(z, z, z, z))
    return add_lanes(add_lanes(along_i, along_j), along_k)


@kernel
def _turn_rate(s: Any, products: int, k: int) -> Quaternion:
    """Return the k-th coefficient of q o (0, omega), of which the newest term is waited for least."""
    even = odd = lanes(0.0, 0.0, 0.0, 0.0)
    for j in range(0, k - 1, 2):
        even = add_lanes(even, _turn_product(s, products, j, k - j))
        odd = add_lanes(odd, _turn_product(s, products, j + 1, k - j - 1))
    if k & 1 == 1:
        even = add_lanes(even, _turn_product(s, products, k - 1, 1))
    a, b, c, d = numbers(add_lanes(add_lanes(even, odd), _turn_product(s, products, k, 0)))
    return (a, b, c, d)


@kernel
def end_series(s: Any, u: int, order: int) -> None:
    """Set the terms behind `order` to zero, to the next multiple of those that evaluation takes at once."""
    for k in range(order + 1, (order + _AT_ONCE - 1) // _AT_ONCE * _AT_ONCE + 1):
        put_lanes(s, term(u, k), lanes(0.0, 0.0, 0.0, 0.0))


@kernel
def turning_of(omega: Vec3, alpha: Vec3) -> float:
    """Return how fast a motion of this rate and angular acceleration turns, rad/s."""
    return norm(omega) + math.sqrt(norm(alpha))


@kernel
def likely_reach(s: Any, order: int, longest: float) -> float:
    """Return how far series of an order, of which omega's is there, reach at most if they turn; at most `longest`."""
    turning = turning_of(vec3_at(s, RATE), vec3_at(s, term(RATE, 1)))
    return min(longest, order / turning) if turning > 0.0 else longest


@kernel
def _largest(q: Quaternion) -> float:
    return max(abs(q[0]), largest_component((q[1], q[2], q[3])))


@kernel
def last_terms_of_attitude(s: Any, order: int, h: float) -> float:
    """Return the larger of the last two terms at h, per h^(order - 1)."""
    return max(_largest(quaternion_at(s, term(TURN, order - 1))), h * _largest(quaternion_at(s, term(TURN, order))))


@kernel(inline=False)
def attitude_series(s: Any, products: int, q: Quaternion, order: int, reach: float, bound: float) -> int:
    """Set the attitude's coefficients from q on, to at most `order`, and return the last one's order.

    They end where the last two are at most `bound` at `reach`. products: where in s there is room for two series.
    """
    _put_turn(s, products, 0, q)
    power, were_small = 1.0, False
    for k in range(order):
        a, b, c, d = _turn_rate(s, products, k)
        half = 0.5 * PER[k]
        q = (half * a, half * b, half * c, half * d)
        _put_turn(s, products, k + 1, q)
        power *= reach
        small = _largest(q) * power <= bound
        if small and were_small and 2 * k >= order:
            order = k + 1
            break
        were_small = small
    end_series(s, TURN, order)
    return order


@kernel
def _value(s: Any, u: int, order: int, t: float) -> tuple[float, float, float, float]:
    """Return a series at t: four sums side by side, of which none waits for another."""
    t_2 = t * t
    t_4 = t_2 * t_2
    once, twice, steps = lanes(t, t, t, t), lanes(t_2, t_2, t_2, t_2), lanes(t_4, t_4, t_4, t_4)
    a = b = c = d = lanes(0.0, 0.0, 0.0, 0.0)
    for i in range((order - 1) // _AT_ONCE, -1, -1):
        k = term(u, _AT_ONCE * i)
        a = add_lanes(multiply_lanes(a, steps), lanes_at(s, k + ROW))
        b = add_lanes(multiply_lanes(b, steps), lanes_at(s, k + 2 * ROW))
        c = add_lanes(multiply_lanes(c, steps), lanes_at(s, k + 3 * ROW))
        d = add_lanes(multiply_lanes(d, steps), lanes_at(s, k + 4 * ROW))
    a, c = add_lanes(a, multiply_lanes(b, once)), add_lanes(c, multiply_lanes(d, once))
    a = add_lanes(a, multiply_lanes(c, twice))
    x, y, z, v = numbers(add_lanes(lanes_at(s, u), multiply_lanes(a, once)))
    return (x, y, z, v)


@kernel
def rate_at(s: Any, w: int, order: int, t: float) -> Vec3:
    """Return omega_ab_b at t of the series that stand from s[w] on."""
    x, y, z, _ = _value(s, w + RATE, order, t)
    return (x, y, z)


@kernel
def attitude_at(s: Any, w: int, order: int, t: float) -> Quaternion:
    """Return q_ab at t, of unit length, of the series that stand from s[w] on."""
    a, b, c, d = _value(s, w + TURN, order, t)
    over = (a * a + b * b) + (c * c + d * d) - 1.0
    r = 1.0 - 0.5 * over if abs(over) < _NEAR else 1.0 / math.sqrt(1.0 + over)
    return (r * a, r * b, r * c, r * d)
