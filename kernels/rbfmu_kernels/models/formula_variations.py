"""Variations of a motion: what errors of its start and of parameters become, in templates bound as those of `formulas`.

Errors e of the motion obey e' = A(t) e + B(t), linear along it, with a column for each number that varies. The scene's
generated kernels make the series of what is not zero in A and B beside those of the motion; from these the series of e
follow by the same recurrence, e[k + 1] = (sum over j of A[j] e[k - j] + B[k]) / (k + 1), for four columns at a time.
They reach as far as those of the motion, whose substeps do not hang on them: so its bits are those of a run without.

Where rates jump, at a side of what loads depend on, errors move the time at which that happens, and so the motion after
it: e jumps by (rates before - rates after) times that shift of time (the saltation matrix: R. I. Leine & H. Nijmeijer,
Dynamics and Bifurcations of Non-Smooth Mechanical Systems, 2004, ch. 7).
"""

from collections.abc import Callable, Mapping
from typing import Any

from ..compile.simd import add_lanes, lanes, lanes_at, multiply_lanes, put_lanes
from ..integrators.polynomials import polynomial, slope_of
from ..types import Buffer

# What templates are bound to, see `formulas`. NUMBER_OF_ERRORS: rows of e, each COLUMNS wide; STATE_OF: of each row the
# column of the state whose error it is, or -1. The pattern has four numbers for each entry: row, from what (a row, or
# -1 - column for B), the column of its series, and 1 where that is constant. Rows beyond the errors are those of sides.
NUMBER_OF_ERRORS = COLUMNS = ERRORS = PATTERN = ENTRIES = SHIFTS = RATES_BEFORE = OF_ERRORS = OF_ENTRIES = 0
STATE_OF: tuple[int, ...] = (-1,)
add_products: Any = None
ORDER = REACH = NEXT = WATCHED = NUMBER_OF_SIDES = ROWS = ROW = 0


def shift_of_corner(z: Buffer) -> None:
    """Note how errors shift the time of the corner at which the series end, and the rates before it; or no shift."""
    n, reach, at_corner = int(z[ORDER]), z[REACH], -1
    for i in range(NUMBER_OF_SIDES):
        if at_corner < 0 and z[NEXT + i] != 0.0:
            at_corner = i
    for d in range(COLUMNS):
        z[SHIFTS + d] = 0.0
    if at_corner < 0:
        return
    for e in range(ENTRIES):
        at = PATTERN + 4 * e
        if int(z[at]) == NUMBER_OF_ERRORS + at_corner:
            slope, of = polynomial(z, OF_ENTRIES + int(z[at + 2]), ROW, n - 1, reach), int(z[at + 1])
            if of < 0:
                z[SHIFTS - 1 - of] += slope
            else:
                for d in range(COLUMNS):
                    z[SHIFTS + d] += slope * z[ERRORS + of * COLUMNS + d]
    speed = slope_of(z, WATCHED + at_corner, ROW, n, reach)
    for d in range(COLUMNS):
        z[SHIFTS + d] = -z[SHIFTS + d] / speed if z[SHIFTS + d] != 0.0 else 0.0
    for i in range(NUMBER_OF_ERRORS):
        z[RATES_BEFORE + i] = slope_of(z, ROWS + STATE_OF[i], ROW, n, reach) if STATE_OF[i] >= 0 else 0.0


def add_products_of(z: Buffer, to: int, term: int, of: int, last: int) -> None:
    """Add the sum over j <= last of a series' coefficients times the columns of a row of errors, j orders before.

    Twelve columns at a time take each coefficient once, and their sums do not wait for one another.
    """
    d = 0
    while d + 12 <= COLUMNS:
        s0, s1, s2 = lanes_at(z, to + d), lanes_at(z, to + d + 4), lanes_at(z, to + d + 8)
        for j in range(last + 1):
            a, b = z[term + j * ROW], of + d - j * ROW
            four = lanes(a, a, a, a)
            s0 = add_lanes(s0, multiply_lanes(four, lanes_at(z, b)))
            s1 = add_lanes(s1, multiply_lanes(four, lanes_at(z, b + 4)))
            s2 = add_lanes(s2, multiply_lanes(four, lanes_at(z, b + 8)))
        put_lanes(z, to + d, s0)
        put_lanes(z, to + d + 4, s1)
        put_lanes(z, to + d + 8, s2)
        d += 12
    while d < COLUMNS:
        s0 = lanes_at(z, to + d)
        for j in range(last + 1):
            a = z[term + j * ROW]
            s0 = add_lanes(s0, multiply_lanes(lanes(a, a, a, a), lanes_at(z, of + d - j * ROW)))
        put_lanes(z, to + d, s0)
        d += 4


def vary_series(z: Buffer, ended: bool) -> None:
    """Make the series of errors; ended: whether that of the motion before ended, at a corner if a shift is noted."""
    n = int(z[ORDER])
    if ended:
        for i in range(NUMBER_OF_ERRORS):
            if STATE_OF[i] >= 0:
                jump = z[RATES_BEFORE + i] - z[ROWS + ROW + STATE_OF[i]]
                for d in range(COLUMNS):
                    z[ERRORS + i * COLUMNS + d] += jump * z[SHIFTS + d] if z[SHIFTS + d] != 0.0 else 0.0
    for i in range(NUMBER_OF_ERRORS * COLUMNS):
        z[OF_ERRORS + i] = z[ERRORS + i]
    for k in range(n):
        here = OF_ERRORS + k * ROW
        for i in range(NUMBER_OF_ERRORS * COLUMNS):
            z[here + ROW + i] = 0.0
        for e in range(ENTRIES):
            at = PATTERN + 4 * e
            row, of, term = int(z[at]), int(z[at + 1]), OF_ENTRIES + int(z[at + 2])
            if row < NUMBER_OF_ERRORS:
                if of < 0:
                    z[here + ROW + row * COLUMNS - 1 - of] += z[term + k * ROW]
                else:
                    last = 0 if z[at + 3] != 0.0 else k
                    add_products(z, here + ROW + row * COLUMNS, term, here + of * COLUMNS, last)
        part = 1.0 / (k + 1)
        for i in range(NUMBER_OF_ERRORS * COLUMNS):
            z[here + ROW + i] *= part


def put_errors_at(z: Buffer, t: float) -> None:
    """Set the errors to those at t of their series."""
    n, times = int(z[ORDER]), lanes(t, t, t, t)
    for i in range(0, NUMBER_OF_ERRORS * COLUMNS, 4):
        total = lanes_at(z, OF_ERRORS + n * ROW + i)
        for k in range(n - 1, -1, -1):
            total = add_lanes(multiply_lanes(total, times), lanes_at(z, OF_ERRORS + k * ROW + i))
        put_lanes(z, ERRORS + i, total)


TEMPLATES: Mapping[str, Callable[..., Any]] = {
    "shift_corner": shift_of_corner,
    "add_products": add_products_of,
    "vary": vary_series,
    "put_errors": put_errors_at,
}
