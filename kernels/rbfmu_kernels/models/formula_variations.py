"""Variations of a motion: what errors of its start and of parameters become, in templates bound as those of `formulas`.

Errors e of the motion obey e' = A(t) e + B(t), linear along it, with a column for each number that varies. The scene's
generated kernels make the series of what is not zero in A and B beside those of the motion; from these the series of e
follow by the same recurrence, e[k + 1] = (sum over j of A[j] e[k - j] + B[k]) / (k + 1), for four columns at a time.
They reach as far as those of the motion, with the bits of a run without them, or less far where they bound substeps as
well (BOUNDED): how well a motion is known does not tell how well its derivatives are, which a body at rest has too.

Where rates jump, at a side of what loads depend on, errors move the time at which that happens, and so the motion after
it: e jumps by (rates before - rates after) times that shift of time (the saltation matrix: R. I. Leine & H. Nijmeijer,
Dynamics and Bifurcations of Non-Smooth Mechanical Systems, 2004, ch. 7).
"""

import math

from ..compile.simd import Lanes, add_lanes, lanes, lanes_at, multiply_lanes, numbers, put_lanes
from ..integrators import polynomials, substeps
from ..numerics.elementary import exponential, logarithm
from ..types import Buffer

# What templates are bound to, see `formulas`. NUMBER_OF_ERRORS: rows of e, each COLUMNS wide; STATE_OF: of each row the
# column of the state whose error it is, or -1; GROUPS: the first row of each vector's errors, and the one after them.
# The pattern has four numbers for each entry: row, from what (a row, or -1 - column for B), the column of its series,
# and 1 where that is constant. Rows beyond the errors are those of sides.
NUMBER_OF_ERRORS = COLUMNS = ERRORS = PATTERN = NUMBER_OF_SLOPES = SHIFTS = RATES_BEFORE = OF_ERRORS = OF_SLOPES = 0
STATE_OF: tuple[int, ...] = (-1,)
OF_EVENT: tuple[int, ...] = ()
GROUPS: tuple[tuple[int, int], ...] = ((0, 0),)
ORDER = TOLERANCE = SPAN = REACH = ON = NEXT = WATCHED = NUMBER_OF_SIDES = ROWS = ROW = 0

ONE_SHIFT, NO_JUMP = 1e-6, 1e-9
"""The parts by which shifts of corners, and rates before and after them, differ at least."""
BEGINNING = 4
"""The last of the terms that set the size of errors: those of a path, by a torque's, begin to grow with t^4."""


def corner_at_end(z: Buffer) -> int:
    """Return which side comes to its corner where the series end, the first of several; or -1."""
    for i in range(NUMBER_OF_SIDES):
        if z[NEXT + i] != 0.0:
            return i
    return -1


def shift_by(z: Buffer, side: int, d: int) -> float:
    """Return how far the errors of a column shift the time at which this side comes to its corner.

    Of (t - p)^9 both slopes are round-off at the end of a series; one that begins beside its corner has them there.
    """
    n, at_corner, change = int(z[ORDER]), z[REACH] if z[ON + side] >= 0.0 else 0.0, 0.0
    for e in range(NUMBER_OF_SLOPES):
        at = PATTERN + 4 * e
        if int(z[at]) == NUMBER_OF_ERRORS + side:
            slope, of = polynomials.polynomial(z, OF_SLOPES + int(z[at + 2]), ROW, n - 1, at_corner), int(z[at + 1])
            if of >= 0:
                change += slope * z[ERRORS + of * COLUMNS + d]
            elif of == -1 - d:
                change += slope
    return -change / polynomials.slope_of(z, WATCHED + side, ROW, n, at_corner) if change != 0.0 else 0.0


def shift_of_corner(z: Buffer) -> None:
    """Note how errors shift the time of the corner at which the series end, and the rates before it; or no shift.

    Where several come there at one time and go on apart, nothing tells which of them rates jump by: NaN.
    """
    n, reach, first = int(z[ORDER]), z[REACH], -1
    for d in range(COLUMNS):
        z[SHIFTS + d] = 0.0
    for i in range(NUMBER_OF_SIDES):
        if z[NEXT + i] != 0.0 and OF_EVENT[i] < 0:  # no rate jumps at an event
            first = i if first < 0 else first
            for d in range(COLUMNS):
                shift = shift_by(z, i, d)
                if i == first:
                    z[SHIFTS + d] = shift
                elif abs(shift - z[SHIFTS + d]) > ONE_SHIFT * max(abs(shift), abs(z[SHIFTS + d])):
                    z[SHIFTS + d] = math.nan
    for i in range(NUMBER_OF_ERRORS if first >= 0 else 0):
        z[RATES_BEFORE + i] = polynomials.slope_of(z, ROWS + STATE_OF[i], ROW, n, reach) if STATE_OF[i] >= 0 else 0.0


def add_products_of(z: Buffer, to: int, term: int, of: int, last: int) -> None:
    """Add the sum over j <= last of a series' coefficients times the columns of a row of errors, j orders before."""
    for d in range(0, COLUMNS, 4):
        total = lanes_at(z, to + d)
        for j in range(last + 1):
            a = z[term + j * ROW]
            total = add_lanes(total, multiply_lanes(lanes(a, a, a, a), lanes_at(z, of + d - j * ROW)))
        put_lanes(z, to + d, total)


def vary_series(z: Buffer, ended: bool) -> None:
    """Make the series of errors; ended: whether that of the motion before ended, at a corner if a shift is noted."""
    n = int(z[ORDER])
    if ended:
        for i in range(NUMBER_OF_ERRORS):
            if STATE_OF[i] >= 0:
                before, after = z[RATES_BEFORE + i], z[ROWS + ROW + STATE_OF[i]]
                jumps = abs(before - after) > NO_JUMP * max(abs(before), abs(after))
                for d in range(COLUMNS):
                    if z[SHIFTS + d] != 0.0 and (jumps or not math.isnan(z[SHIFTS + d])):
                        z[ERRORS + i * COLUMNS + d] += (before - after) * z[SHIFTS + d]
    for i in range(NUMBER_OF_ERRORS * COLUMNS):
        z[OF_ERRORS + i] = z[ERRORS + i]
    for k in range(n):
        here = OF_ERRORS + k * ROW
        for i in range(NUMBER_OF_ERRORS * COLUMNS):
            z[here + ROW + i] = 0.0
        for e in range(NUMBER_OF_SLOPES):
            at = PATTERN + 4 * e
            row, of, term = int(z[at]), int(z[at + 1]), OF_SLOPES + int(z[at + 2])
            if row < NUMBER_OF_ERRORS:
                if of < 0:
                    z[here + ROW + row * COLUMNS - 1 - of] += z[term + k * ROW]
                else:
                    last = 0 if z[at + 3] != 0.0 else k
                    add_products_of(z, here + ROW + row * COLUMNS, term, here + of * COLUMNS, last)
        part = 1.0 / (k + 1)
        for i in range(NUMBER_OF_ERRORS * COLUMNS):
            z[here + ROW + i] *= part


def squares_at(z: Buffer, h: float, first: int, end: int, at: int, last: int) -> Lanes:
    """Return the sums of squares of what terms at .. last make of rows first .. end by h, for four columns."""
    total, power = lanes(0.0, 0.0, 0.0, 0.0), substeps.power_of(h * h, at)
    for k in range(at, last + 1):
        four = lanes(power, power, power, power)
        for i in range(OF_ERRORS + k * ROW + first, OF_ERRORS + k * ROW + end, COLUMNS):
            total = add_lanes(total, multiply_lanes(four, multiply_lanes(lanes_at(z, i), lanes_at(z, i))))
        power *= h * h
    return total


def excess_of_errors(z: Buffer, h: float) -> float:
    """Return by how much the last two terms of the errors' series at h are beyond the tolerance.

    Of each column, relative to what the first terms make of a vector's errors by then.
    """
    n, worst = int(z[ORDER]), 0.0
    for first, end in GROUPS:
        for d in range(0, COLUMNS, 4):
            sizes = numbers(squares_at(z, h, first * COLUMNS + d, end * COLUMNS, 0, BEGINNING))
            lasts = numbers(squares_at(z, h, first * COLUMNS + d, end * COLUMNS, n - 1, n))
            for size, last in zip(sizes, lasts):  # noqa: B905  (Numba knows no strict)
                if last == math.inf:
                    return math.inf
                worst = max(worst, last / size if size > 0.0 else 0.0)
    return math.sqrt(worst) / substeps.tolerance_of_substep(z[TOLERANCE], z[SPAN], h)


def reach_of_errors(z: Buffer, h: float) -> float:
    """Return how far the series of errors reach, at most h: where their last two terms are within the tolerance.

    Where errors turn much faster than the motion, as those of a flywheel's rate across its axis do, sizes at h are far
    too large, and at what is left of it much smaller: it is cut again, as long as that brings the terms down. Where
    terms overflow, nothing tells by how much.
    """
    n, before, excess = int(z[ORDER]), math.inf, excess_of_errors(z, h)
    while excess > 1.0 and (excess < 0.5 * before or excess == math.inf):
        h *= exponential(-logarithm(excess) / (n - 2)) if excess < math.inf else 0.1
        before, excess = excess, excess_of_errors(z, h)
    return h


def put_errors_at(z: Buffer, t: float) -> None:
    """Set the errors to those at t of their series."""
    n, times = int(z[ORDER]), lanes(t, t, t, t)
    for i in range(0, NUMBER_OF_ERRORS * COLUMNS, 4):
        total = lanes_at(z, OF_ERRORS + n * ROW + i)
        for k in range(n - 1, -1, -1):
            total = add_lanes(multiply_lanes(total, times), lanes_at(z, OF_ERRORS + k * ROW + i))
        put_lanes(z, ERRORS + i, total)
