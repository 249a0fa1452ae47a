"""Laws of velocities and accelerations in moving frames."""

import pytest

from rbfmu_kernels.mechanics import kinematics
from tests.support.references import exact
from tests.support.references.exact import mp
from tests.support.references.hard_cases import (
    random_quaternions,
    random_vectors,
    rotation_matrices,
)
from tests.support.references.laws import Law

MATRICES = rotation_matrices(random_quaternions(300, 61))
A, B, C, D, E, F = (random_vectors(300, seed) for seed in range(62, 68))


def rows(*columns):
    return lambda: list(zip(*columns, strict=True))


def sizes(*terms):
    return mp.fsum([exact.norm(term) for term in terms])


def point_acceleration(a_o, omega, alpha, r, dr, ddr):
    """The lecture's terms one by one: transport, relative, Coriolis, Euler, centripetal."""
    coriolis = exact.scaled(2, exact.cross(omega, dr))
    centripetal = exact.cross(omega, exact.cross(omega, r))
    return exact.add(a_o, ddr, coriolis, exact.cross(alpha, r), centripetal)


def size_of_acceleration(a_o, omega, alpha, r, dr, ddr):
    w = exact.norm(omega)
    return sizes(a_o, ddr) + 2 * w * exact.norm(dr) + exact.norm(alpha) * exact.norm(r) + w * w * exact.norm(r)


LAWS = [
    Law(kinematics.compose_omega, lambda w, R, v: exact.add(w, exact.apply(R, v)), rows(A, MATRICES, B), 2.0,
        lambda w, R, v: sizes(w, v)),
    Law(kinematics.vector_rate, lambda R, w, u, du: exact.apply(R, exact.add(du, exact.cross(w, u))),
        rows(MATRICES, A, B, C), 3.0, lambda R, w, u, du: sizes(du) + exact.norm(w) * exact.norm(u)),
    Law(kinematics.point_velocity, lambda v, w, r, dr: exact.add(v, exact.cross(w, r), dr), rows(A, B, C, D), 1.5,
        lambda v, w, r, dr: sizes(v, dr) + exact.norm(w) * exact.norm(r)),
    Law(kinematics.point_acceleration, point_acceleration, rows(A, B, C, D, E, F), 3.0, size_of_acceleration),
]  # fmt: skip


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.name)
def test_error_is_as_stated(law):
    law.check()


def motion(t):
    """A frame that turns unevenly about two axes, its origin on a curve, and a point that moves in it."""
    R = exact.product(exact.simple_rotation(2, mp.sin(t) + t), exact.simple_rotation(0, t * t / 3))
    origin = [mp.cos(2 * t), t**3, mp.exp(-t)]
    point = [mp.sin(3 * t), 1 + t * t, mp.cos(t)]
    return R, origin, point


def derivatives(f, t, n):
    return [mp.diff(lambda s, k=k: exact.flat(f(s))[k], t, n) for k in range(len(exact.flat(f(t))))]


def omega_at(t):
    dR = derivatives(lambda s: motion(s)[0], t, 1)
    S = exact.product([dR[0:3], dR[3:6], dR[6:9]], exact.transpose(motion(t)[0]))
    return [S[2][1], S[0][2], S[1][0]]


@pytest.mark.parametrize("t", [0.3, 1.0, 2.2])
def test_velocity_and_acceleration_of_a_point_are_derivatives_of_its_position(t):
    """All in a: r, dr, ddr as seen from b are turned to a by R_ab. Differentiated by mpmath."""
    t = mp.mpf(t)
    R, _, _ = motion(t)

    def position(s):
        R, origin, point = motion(s)
        return exact.add(origin, exact.apply(R, point))

    seen = [exact.apply(R, derivatives(lambda s: motion(s)[2], t, n)) for n in range(3)]
    origin = [derivatives(lambda s: motion(s)[1], t, n) for n in range(3)]
    omega, alpha = omega_at(t), derivatives(omega_at, t, 1)
    velocity = kinematics.point_velocity(*exact.rounded([origin[1], omega, seen[0], seen[1]]))
    acceleration = kinematics.point_acceleration(*exact.rounded([origin[2], omega, alpha, *seen]))
    # arguments are rounded: up to 1/2 eps of each term
    assert exact.error(velocity, derivatives(position, t, 1), 1 + exact.norm(omega) * exact.norm(seen[0])) <= 3.0
    scale = size_of_acceleration(origin[2], omega, alpha, *seen)
    assert exact.error(acceleration, derivatives(position, t, 2), scale) <= 3.0


@pytest.mark.parametrize("t", [0.3, 1.0, 2.2])
def test_rate_of_a_vector_is_the_derivative_of_its_inertial_components(t):
    t = mp.mpf(t)
    R, _, u = motion(t)
    du = derivatives(lambda s: motion(s)[2], t, 1)
    omega_b = exact.apply(exact.transpose(R), omega_at(t))
    rate = kinematics.vector_rate(*exact.rounded([R, omega_b, u, du]))
    truth = derivatives(lambda s: exact.apply(motion(s)[0], motion(s)[2]), t, 1)
    assert exact.error(rate, truth, exact.norm(du) + exact.norm(omega_b) * exact.norm(u)) <= 3.0


def test_a_point_fixed_in_a_spinning_body_falls_towards_the_axis():
    """omega about z, r along x: speed omega r along y, acceleration -omega^2 r along x."""
    zero, omega, r = (0.0, 0.0, 0.0), (0.0, 0.0, 3.0), (2.0, 0.0, 0.0)
    assert kinematics.point_velocity(zero, omega, r, zero) == (0.0, 6.0, 0.0)
    assert kinematics.point_acceleration(zero, omega, zero, r, zero, zero) == (-18.0, 0.0, 0.0)
