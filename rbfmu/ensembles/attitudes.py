"""Means of what is no number: attitudes, of which q and -q are one, and angles, which begin anew after a turn.

Both come of sums that merge as those of numbers do: of q q^T, and of sines and cosines.
"""

import numpy as np

from rbfmu.types import Array

ATTITUDE, ANGLES = "quaternion", "rpy"


def moments_of(name: str, count: int, mean: Array, products: Array) -> tuple[Array, Array]:
    """Return mean and covariance of a quantity; NaN of no member, and of one.

    mean (n, k), products (n, k, k): of so many members' numbers, and summed up of their deviations; of angles those of
    sine and cosine, of one after the other.
    """
    if name == ATTITUDE:
        mean, products = _mean_attitude(count, mean, products)
    elif name == ANGLES:
        mean, products = _mean_direction(mean, products)
    covariance = products / (count - 1.0) if count > 1 else np.full_like(products, np.nan)
    return (mean if count else np.full_like(mean, np.nan)), covariance


def _mean_attitude(count: int, mean: Array, products: Array) -> tuple[Array, Array]:
    """Return the attitude q (n, 4) to which sum (q q_i)^2 is largest, whatever the signs of q_i.

    And the sums (n, 3, 3) of products of twice the vector parts of q* q_i: of small rotations, in b. Markley, Cheng,
    Crassidis and Oshman, Journal of Guidance, Control, and Dynamics 30 (2007).
    """
    q = np.linalg.eigh(products + count * mean[:, :, None] * mean[:, None, :])[1][:, :, -1]
    turned = np.sum(q * np.vstack([mean[:1], q[:-1]]), axis=1) < 0.0
    q = q * np.where(np.cumsum(turned) % 2, -1.0, 1.0)[:, None]  # without jumps, from the members' own sign on
    return q, _mapped(2.0 * _relative_to(q)[:, 1:], count, mean, products)


def _relative_to(q: Array) -> Array:
    """Return the matrices (n, 4, 4) that take an attitude q_i to q* q_i."""
    w, x, y, z = q.T
    return np.array([[w, x, y, z], [-x, w, z, -y], [-y, -z, w, x], [-z, y, -x, w]]).transpose(2, 0, 1)


def from_their_mean(q: Array) -> Array:
    """Return attitudes (m, 4) as they are turned from their mean, each of that sign by which it is nearer to none."""
    mean = np.linalg.eigh(q.T @ q)[1][:, -1]
    turned = q @ _relative_to(mean[None])[0].T
    return np.asarray(np.copysign(1.0, turned[:, :1]) * turned)


def _mean_direction(mean: Array, products: Array) -> tuple[Array, Array]:
    """Return the angles (n, k) of the sums of unit vectors, and sums (n, k, k) of products of sines of deviations."""
    angle = np.arctan2(mean[:, 0::2], mean[:, 1::2])
    sine = np.zeros((len(mean), angle.shape[1], mean.shape[1]))
    for k in range(angle.shape[1]):
        sine[:, k, 2 * k], sine[:, k, 2 * k + 1] = np.cos(angle[:, k]), -np.sin(angle[:, k])
    return angle, _mapped(sine, 0, mean, products)


def _mapped(A: Array, count: int, mean: Array, products: Array) -> Array:
    """Return the sums of products (n, i, i) of A x, less a mean of 0; those of a mean that is not 0 are added."""
    of_mean = (A @ mean[:, :, None])[:, :, 0]
    return np.asarray(A @ products @ A.transpose(0, 2, 1) + count * of_mean[:, :, None] * of_mean[:, None, :])


def around(mean: Array, angles: Array) -> Array:
    """Return angles less the whole turns by which they are nearer to the mean so."""
    return np.asarray(angles - 2.0 * np.pi * np.rint((angles - mean) / (2.0 * np.pi)))
