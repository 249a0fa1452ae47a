"""Named tuples in flat buffers: nothing is lost, nothing beside them touched, from Python and from compiled code."""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from rbfmu_kernels.buffer_access import record
from rbfmu_kernels.types import Vec3


class Inner(NamedTuple):
    high_and_low: tuple[float, float]
    sign: float


class Outer(NamedTuple):
    kind: float
    inner: Inner
    axis: Vec3


VALUE = Outer(1.0, Inner((2.0, 3.0), 4.0), (5.0, 6.0, 7.0))
SIZE, PUT, READ, FLATTEN = record(Outer)
_, _, READ_INNER, FLATTEN_INNER = record(Inner, 5)


def test_numbers_stand_in_the_order_of_the_fields():
    assert SIZE == 7
    assert FLATTEN(VALUE) == (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0)


def test_what_is_read_is_what_was_stored_and_no_other_number_changes():
    z = np.full(SIZE + 5, math.nan)
    PUT(z, 2, VALUE)
    assert READ(z[2 : 2 + SIZE]) == VALUE
    assert READ(FLATTEN(VALUE)) == VALUE
    assert np.isnan(z).nonzero()[0].tolist() == [0, 1, 9, 10, 11]


def test_a_short_record_is_filled_up_with_zeros():
    assert FLATTEN_INNER(VALUE.inner) == (2.0, 3.0, 4.0, 0.0, 0.0)
    assert READ_INNER(FLATTEN_INNER(VALUE.inner)) == VALUE.inner


def test_compiled_code_reads_fields_by_name():
    @njit
    def sign_times_axis(z):
        value = READ(z)
        return value.inner.sign * value.axis[2] + value.inner.high_and_low[1]

    assert sign_times_axis(np.array(FLATTEN(VALUE))) == 31.0
