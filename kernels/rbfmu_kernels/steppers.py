"""One-step methods for the motion of a body: state (position, velocity, quaternion, body rate) in, state out.

The interface: `METHOD_step(motion, h, state, body, loads)`, all tuples. The attitude is normalised once a step:
without, classical Runge-Kutta shrinks |q| by 1 - (h omega)^6 / 9216 a step, and scales the forces with it.
"""

import math

from ._kernel import kernel
from .dynamics import Body, Loads, Rates, State, state_rates
from .quaternion import add_scaled_quaternion
from .vec3 import add_scaled


@kernel
def advance(state: State, s: float, rates: Rates) -> State:
    """State + s rates."""
    return (
        add_scaled(state[0], s, rates[0]),
        add_scaled(state[1], s, rates[1]),
        add_scaled_quaternion(state[2], s, rates[2]),
        add_scaled(state[3], s, rates[3]),
    )


@kernel
def unit_attitude(state: State) -> State:
    """The state with its quaternion scaled to length 1, as a step leaves it within 10 % of that."""
    q = state[2]
    s = 1.0 / math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    return state[0], state[1], (s * q[0], s * q[1], s * q[2], s * q[3]), state[3]


@kernel(inline=False)
def rk4_step(state: State, h: float, body: Body, loads: Loads) -> State:
    """Classical Runge-Kutta: order 4, stable to h omega = 4 sqrt 2 (attitude) and h d / I = 2.785 (damping)."""
    k1 = state_rates(state, body, loads)
    k2 = state_rates(advance(state, 0.5 * h, k1), body, loads)
    k3 = state_rates(advance(state, 0.5 * h, k2), body, loads)
    k4 = state_rates(advance(state, h, k3), body, loads)
    rates = advance(advance(advance(k1, 1.0, k4), 2.0, k2), 2.0, k3)  # one rounding of the state, not four
    return unit_attitude(advance(state, h / 6.0, rates))
