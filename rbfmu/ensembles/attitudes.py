"""Means of attitudes, for which q and -q are the same, and of angles, for which a whole turn is zero.

Both are computed from sums that can be merged like sums of numbers: of q q^T, and of sines and cosines.
"""

import numpy as np

from rbfmu.types import Array

ATTITUDE, ANGLES = "quaternion", "rpy"


def moments_of(name: str, count: int, mean: Array, products: Array) -> tuple[Array, Array]:
    """Return the mean and the covariance of a quantity: NaN of no member, and the covariance also of one.

    count: of members; mean (n, k): of their numbers; products (n, k, k): summed products of their deviations. Angles
    are given by their sines and cosines, in turns.
    """
    if name == ATTITUDE:
        mean, products = _mean_attitude(count, mean, products)
    elif name == ANGLES:
        mean, products = _mean_direction(mean, products)
    covariance = products / (count - 1.0) if count > 1 else np.full_like(products, np.nan)
    return (mean if count else np.full_like(mean, np.nan)), covariance


def _mean_attitude(count: int, mean: Array, products: Array) -> tuple[Array, Array]:
    """Return the attitude q (n, 4) with the largest sum (q q_i)^2, whatever the signs of q_i.

    Return also the sums (n, 3, 3) of products of twice the vector part of q* q_i, which is the rotation vector, in b,
    of a small rotation. Markley, Cheng, Crassidis and Oshman, Journal of Guidance, Control, and Dynamics 30 (2007).
    """
    q = np.linalg.eigh(products + count * mean[:, :, None] * mean[:, None, :])[1][:, :, -1]
    turned = np.sum(q * np.vstack([mean[:1], q[:-1]]), axis=1) < 0.0
    q = q * np.where(np.cumsum(turned) % 2, -1.0, 1.0)[:, None]  # signs without jumps, at first the members'
    return q, _products_of_images(2.0 * _relative_to(q)[:, 1:], count, mean, products)


def _relative_to(q: Array) -> Array:
    """Return the matrices (n, 4, 4) that take an attitude q_i to q* q_i."""
    w, x, y, z = q.T
    return np.array([[w, x, y, z], [-x, w, z, -y], [-y, -z, w, x], [-z, y, -x, w]]).transpose(2, 0, 1)


def from_their_mean(q: Array) -> Array:
    """Return attitudes (m, 4) relative to their mean, each with the sign that makes its scalar part positive."""
    mean = np.linalg.eigh(q.T @ q)[1][:, -1]
    turned = q @ _relative_to(mean[None])[0].T
    return np.asarray(np.copysign(1.0, turned[:, :1]) * turned)


def _mean_direction(mean: Array, products: Array) -> tuple[Array, Array]:
    """Return the angles (n, k) of the sums of unit vectors, and sums (n, k, k) of products of sines of deviations.

    The numbers behind mean and products are sine and cosine of each angle.
    """
    angle = np.arctan2(mean[:, 0::2], mean[:, 1::2])
    sine = np.zeros((len(mean), angle.shape[1], mean.shape[1]))
    for k in range(angle.shape[1]):
        sine[:, k, 2 * k], sine[:, k, 2 * k + 1] = np.cos(angle[:, k]), -np.sin(angle[:, k])
    return angle, _products_of_images(sine, 0, mean, products)


def _products_of_images(A: Array, count: int, mean: Array, products: Array) -> Array:
    """Return the sums (n, i, i) of products of A x about zero, given mean and products of x; count = 0: A mean is 0."""
    of_mean = (A @ mean[:, :, None])[:, :, 0]
    found = np.asarray(A @ products @ A.transpose(0, 2, 1) + count * of_mean[:, :, None] * of_mean[:, None, :])
    squares = np.einsum("nii->ni", found)  # a view, in which sums of zero may be negative by round-off
    np.maximum(squares, 0.0, out=squares)
    return found


def around(mean: Array, angles: Array) -> Array:
    """Return angles shifted by whole turns so that each is within half a turn of the mean."""
    return np.asarray(angles - 2.0 * np.pi * np.rint((angles - mean) / (2.0 * np.pi)))
