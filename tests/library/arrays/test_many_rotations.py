"""The stated errors once more, on so many rotations that a rare bad one shows; truth in 80-bit arithmetic."""

import numpy as np
import pytest

import rbfmu
from tests.kernels.rotations import test_attitude_error, test_quaternion, test_rodrigues, test_rotation
from tests.support.references.exact import EPS
from tests.support.references.hard_cases import of_all_sizes, rng

Long = np.longdouble
TABLES = (test_quaternion, test_rotation, test_rodrigues, test_attitude_error)
LAWS = {law.name: law for module in TABLES for law in module.LAWS}
pytestmark = pytest.mark.skipif(np.finfo(Long).eps > 1e-18, reason="long double has no more digits than double here")


def many_quaternions(n, seed):
    """A quarter each: near half a turn, with components of unlike sizes, and uniform (half)."""
    r = rng(seed)
    q = r.standard_normal((n, 4))
    q[: n // 4, 0] *= of_all_sizes(r, -9, 0, n // 4)
    q[n // 4 : n // 2] *= of_all_sizes(r, -2, 0, (n // 4, 4))
    return r.permutation(q / np.linalg.norm(q, axis=1, keepdims=True))


N = 200_000
Q, P = many_quaternions(N, 81), many_quaternions(N, 82)
V = rng(83).standard_normal((N, 3))
LONG_Q, LONG_P = (q * rng(seed).uniform(0.5, 2.0, (N, 1)) for q, seed in ((Q, 84), (P, 85)))
"""The same of any lengths."""


def unit(q):
    q = q.astype(Long)
    return q / np.sqrt((q * q).sum(axis=1, keepdims=True))


def matrix(q):
    """R of q / |q|, E&G (6.163)."""
    w, x, y, z = unit(q).T
    rows = [
        [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
    ]
    return np.moveaxis(np.array(rows), -1, 0)


def product(q, p):
    a, b = q.astype(Long), p.astype(Long)
    scalar = a[:, 0] * b[:, 0] - (a[:, 1:] * b[:, 1:]).sum(axis=1)
    return np.column_stack([scalar, a[:, :1] * b[:, 1:] + b[:, :1] * a[:, 1:] + np.cross(a[:, 1:], b[:, 1:])])


def with_eta_above_zero(q):
    return q * np.where(q[:, :1] < 0, -1, 1)


def length(v):
    return np.sqrt((v.astype(Long) ** 2).sum(axis=1))


def mrp(q):
    q = with_eta_above_zero(unit(q))
    return q[:, 1:] / (1 + q[:, :1])


def quaternion_of(sigma):
    s = sigma.astype(Long)
    square = (s * s).sum(axis=1, keepdims=True)
    return np.column_stack([1 - square, 2 * s]) / (1 + square)


LENGTHS = length(V)
R = matrix(Q).astype(float)
S = matrix(P).astype(float)
CASES = {
    "rotate": ((LONG_Q, V), lambda: matrix(LONG_Q) @ V[..., np.newaxis].astype(Long), LENGTHS),
    "transform": ((R, V), lambda: R.astype(Long) @ V[..., np.newaxis].astype(Long), LENGTHS),
    "compose_quaternions": ((LONG_Q, LONG_P), lambda: product(LONG_Q, LONG_P), length(LONG_Q) * length(LONG_P)),
    "compose_matrices": ((R, S), lambda: R.astype(Long) @ S.astype(Long), 1.0),
    "normalize": ((LONG_Q,), lambda: unit(LONG_Q), 1.0),
    "matrix_from_quaternion": ((LONG_Q,), lambda: matrix(LONG_Q), 1.0),
    "quaternion_from_matrix": ((R,), lambda: with_eta_above_zero(unit(Q)), 1.0),
    "gibbs_from_quaternion": ((Q,), lambda: Q[:, 1:].astype(Long) / Q[:, :1], length(Q[:, 1:] / Q[:, :1])),
    "quaternion_from_gibbs": ((V,), lambda: unit(np.column_stack([np.ones(N), V])), 1.0),
    "mrp_from_quaternion": ((Q,), lambda: mrp(Q), length(mrp(Q))),
    "quaternion_from_mrp": ((V,), lambda: quaternion_of(V), 1.0),
    "mrp_shadow": ((V,), lambda: -V.astype(Long) / LENGTHS[:, np.newaxis] ** 2, 1 / LENGTHS),
    "attitude_error": ((P, Q), lambda: with_eta_above_zero(product(P * [1, -1, -1, -1], Q)), 1.0),
}


OF_UNIT = {
    "compose_quaternions": ((Q, P), lambda: product(Q, P), 1.2, "of unit ones 1.2 eps"),
    "matrix_from_quaternion": ((Q,), lambda: matrix(Q), 2.0, "of a unit q_ab 2 eps"),
}


def worst_of(name, args, truth, scale=1.0):
    ours = getattr(rbfmu, name)(*args).reshape(N, -1)
    return np.max(np.abs(ours - truth().reshape(N, -1)).max(axis=1) / scale) / EPS


@pytest.mark.parametrize("name", CASES)
def test_error_is_as_stated_for_many_rotations(name):
    assert 0.5 * LAWS[name].bound <= worst_of(name, *CASES[name]) <= LAWS[name].bound


@pytest.mark.parametrize("name", OF_UNIT)
def test_error_is_as_stated_for_many_unit_quaternions(name):
    args, truth, bound, stated = OF_UNIT[name]
    assert 0.5 * bound <= worst_of(name, args, truth) <= bound
    assert stated in LAWS[name].kernel.__doc__
