"""Variations of a motion: how errors of its start and of parameters grow. Templates that are bound as in `formulas`.

Errors e of the motion obey the linear variational equations e' = A(t) e + B(t), with a column for each number that
varies. The scene's generated kernels make the series of the entries of A and B that are not zero, beside those of the
motion. The series of e follow from e[k + 1] = (sum over j of A[j] e[k - j] + B[k]) / (k + 1), four columns at a time.
They are used over the reach of the motion's series, which keeps the bits of a run without them; or over less where they
bound the reach as well (BOUNDED), as an accurate motion need not have accurate derivatives: a body at rest has them
too.

Where rates jump at a corner of a load, errors shift the time of the jump, and so the motion after it: e jumps by (rates
before - rates after) times that shift (the saltation matrix: R. I. Leine & H. Nijmeijer, Dynamics and Bifurcations of
Non-Smooth Mechanical Systems, 2004, ch. 7).
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
"""The relative differences from which on shifts of two corners, and rates before and after one, count as different."""
BEGINNING = 4
"""The order up to which terms set the size of errors: errors of a path that a torque causes begin with t^4."""


def corner_at_end(z: Buffer) -> int:
    """Return which number is at its corner where the series ends, the first of several; or -1."""
    for i in range(NUMBER_OF_SIDES):
        if z[NEXT + i] != 0.0:
            return i
    return -1


def shift_by(z: Buffer, side: int, d: int) -> float:
    """Return by how much the errors of a column shift the time of this corner, s.

    Slopes are those at the series' end; at its beginning where it begins beside its corner, as for (t - p)^9 both
    slopes are round-off at the end.
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
    """Store the shifts of the time of the corner at the series' end, s, and the rates before it; 0 if there is none.

    A shift is NaN where several corners coincide whose shifts differ, as it is unknown at which of them rates jump.
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
    """Add the sum over j <= last of a series' coefficient j times the columns of a row of errors, j orders lower."""
    for d in range(0, COLUMNS, 4):
        total = lanes_at(z, to + d)
        for j in range(last + 1):
            a = z[term + j * ROW]
            total = add_lanes(total, multiply_lanes(lanes(a, a, a, a), lanes_at(z, of + d - j * ROW)))
        put_lanes(z, to + d, total)


def vary_series(z: Buffer, ended: bool) -> None:
    """Make the series of errors, which first jump at a corner; ended: whether the last series was used to its end."""
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
    """Return the sums of squares of the terms of orders at .. last at h, over rows first .. end, for four columns."""
    total, power = lanes(0.0, 0.0, 0.0, 0.0), substeps.power_of(h * h, at)
    for k in range(at, last + 1):
        four = lanes(power, power, power, power)
        for i in range(OF_ERRORS + k * ROW + first, OF_ERRORS + k * ROW + end, COLUMNS):
            total = add_lanes(total, multiply_lanes(four, multiply_lanes(lanes_at(z, i), lanes_at(z, i))))
        power *= h * h
    return total


def excess_of_errors(z: Buffer, h: float) -> float:
    """Return the ratio of the last two terms of the errors' series at h to the tolerance, the largest of all columns.

    Terms are relative to the size that the first terms give to the same vector's errors by then.
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
    """Return the longest step, at most h, at which the last two terms of the errors' series are within the tolerance.

    Where errors turn much faster than the motion, as those of a flywheel's rate across its axis, the sizes from their
    first terms are far too large at h, and much smaller once h is cut: h is cut again as long as each cut halves the
    ratio. Where terms overflow, h is cut to a tenth.
    """
    n, before, excess = int(z[ORDER]), math.inf, excess_of_errors(z, h)
    while excess > 1.0 and (excess < 0.5 * before or excess == math.inf):
        h *= exponential(-logarithm(excess) / (n - 2)) if excess < math.inf else 0.1
        before, excess = excess, excess_of_errors(z, h)
    return h


def put_errors_at(z: Buffer, t: float) -> None:
    """Set the errors to their series at t."""
    n, times = int(z[ORDER]), lanes(t, t, t, t)
    for i in range(0, NUMBER_OF_ERRORS * COLUMNS, 4):
        total = lanes_at(z, OF_ERRORS + n * ROW + i)
        for k in range(n - 1, -1, -1):
            total = add_lanes(multiply_lanes(total, times), lanes_at(z, OF_ERRORS + k * ROW + i))
        put_lanes(z, ERRORS + i, total)
