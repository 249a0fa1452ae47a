"""Results beyond the caches, which are written past them: the same bits, and nothing beside them."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from numba import config

import rbfmu
from rbfmu_kernels.compile import gufunc
from tests.support.references.hard_cases import random_quaternions

pytestmark = pytest.mark.skipif(bool(config.DISABLE_JIT), reason="needs the compiled functions")

SIZES = {rbfmu.rotate: 3, rbfmu.compose_quaternions: 4, rbfmu.matrix_from_quaternion: 9}
ENOUGH = {function: -(-gufunc.STREAMED // (8 * size)) for function, size in SIZES.items()}
Q = np.array(random_quaternions(1000, 75))
FEW = 800  # items: no multiple of it, nor of a tile, begins a cache line in all of the arrays below


def arguments(function, n):
    q = np.resize(Q, (n, 4))
    others = {rbfmu.rotate: [np.resize(Q[:, 1:], (n, 3))], rbfmu.compose_quaternions: [q[::-1].copy()]}
    return (q, *others.get(function, []))


def in_pieces(function, args):
    """The results, a few items at a time: not streamed."""
    n = len(args[0])
    return np.concatenate([function(*(a[i : i + FEW] for a in args)) for i in range(0, n, FEW)])


@pytest.mark.parametrize("function", SIZES)
@pytest.mark.parametrize("more", [-1, 0, 1, 31])
def test_bits_do_not_depend_on_the_number_of_items(function, more):
    args = arguments(function, ENOUGH[function] + more)
    assert (function(*args) == in_pieces(function, args)).all()


@pytest.mark.parametrize("function", SIZES)
@pytest.mark.parametrize("offset", range(8))
def test_results_may_begin_anywhere_in_a_cache_line(function, offset):
    args = arguments(function, ENOUGH[function] + 5)
    expected = in_pieces(function, args)
    larger = np.full(expected.size + 16, np.pi)
    out = larger[offset + 4 : offset + 4 + expected.size].reshape(expected.shape)
    assert function(*args, out=out) is out
    assert (out == expected).all()
    assert (larger[: offset + 4] == np.pi).all()
    assert (larger[offset + 4 + expected.size :] == np.pi).all()


@pytest.mark.parametrize("step", [-1, 2])
def test_results_may_be_strided_or_unaligned(step):
    args = arguments(rbfmu.rotate, ENOUGH[rbfmu.rotate])
    expected = in_pieces(rbfmu.rotate, args)
    out = np.empty((len(expected) * abs(step), 3))[::step]
    assert (rbfmu.rotate(*args, out=out) == expected).all()
    unaligned = np.empty(expected.nbytes + 3, np.uint8)[3:].view(np.float64).reshape(expected.shape)
    assert (rbfmu.rotate(*args, out=unaligned) == expected).all()


def test_several_results_and_results_over_an_argument():
    q, _ = arguments(rbfmu.compose_quaternions, ENOUGH[rbfmu.compose_quaternions])
    axes, angles = rbfmu.axis_angle_from_quaternion(q)
    assert (axes[-len(Q) :] == rbfmu.axis_angle_from_quaternion(q[-len(Q) :])[0]).all()
    assert (angles[-len(Q) :] == rbfmu.axis_angle_from_quaternion(q[-len(Q) :])[1]).all()
    expected = in_pieces(rbfmu.compose_quaternions, (q, q))
    assert (rbfmu.compose_quaternions(q, q, out=q) == expected).all()


def test_two_threads_may_stream_to_one_array():
    """Both write to the cache line between them."""
    n = ENOUGH[rbfmu.rotate] + 3
    args = arguments(rbfmu.rotate, n)
    expected = in_pieces(rbfmu.rotate, args)
    out = np.empty((2 * n, 3))
    with ThreadPoolExecutor(2) as pool:
        for _ in range(5):
            out[:] = np.nan
            halves = [pool.submit(rbfmu.rotate, *args, out=half) for half in (out[:n], out[n:])]
            assert all((half.result() == expected).all() for half in halves)
