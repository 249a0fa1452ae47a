"""Of unit quaternions errors are smaller than of others, as stated: on so many that a rare bad one shows."""

import numpy as np
import pytest

import rbfmu
from rbfmu_kernels.rotations import matrix, quaternion
from tests.support.references.exact import EPS
from tests.support.references.hard_cases import of_all_sizes, rng

Long = np.longdouble
pytestmark = pytest.mark.skipif(np.finfo(Long).eps > 1e-18, reason="long double has no more digits than double here")
N = 200_000


def many_quaternions(seed):
    """A quarter each: near half a turn, with components of unlike sizes, and uniform (half)."""
    r = rng(seed)
    q = r.standard_normal((N, 4))
    q[: N // 4, 0] *= of_all_sizes(r, -9, 0, N // 4)
    q[N // 4 : N // 2] *= of_all_sizes(r, -2, 0, (N // 4, 4))
    return r.permutation(q / np.linalg.norm(q, axis=1, keepdims=True))


def product(q, p):
    a, b = q.astype(Long), p.astype(Long)
    scalar = a[:, 0] * b[:, 0] - (a[:, 1:] * b[:, 1:]).sum(axis=1)
    return np.column_stack([scalar, a[:, :1] * b[:, 1:] + b[:, :1] * a[:, 1:] + np.cross(a[:, 1:], b[:, 1:])])


def turned(q):
    """R of q / |q|: its columns are q e q* of the axes e."""
    unit = q.astype(Long) / np.sqrt((q.astype(Long) ** 2).sum(axis=1, keepdims=True))
    columns = [product(product(unit, np.eye(4)[[k]]), unit * [1, -1, -1, -1])[:, 1:] for k in (1, 2, 3)]
    return np.stack(columns, axis=2).reshape(N, 9)


Q, P = many_quaternions(81), many_quaternions(82)


@pytest.mark.parametrize(("kernel", "arguments", "truth", "bound", "stated"), [
    (quaternion.compose_quaternions, (Q, P), product, 1.2, "of unit ones 1.2 eps"),
    (matrix.matrix_from_quaternion, (Q,), turned, 2.0, "of a unit q_ab 2 eps"),
])  # fmt: skip
def test_error_is_as_stated_for_many_unit_quaternions(kernel, arguments, truth, bound, stated):
    ours = getattr(rbfmu, kernel.__name__)(*arguments).reshape(N, -1)
    assert 0.5 * bound <= np.abs(ours - truth(*arguments)).max() / EPS <= bound
    assert stated in kernel.__doc__
