"""Newton-Euler about the centre of mass and about a body point, and energy: against 50 digits."""

import numpy as np
import pytest
from hypothesis import given, strategies as st

from rbfmu_kernels.compile.tiered import interpreted
from rbfmu_kernels.mechanics import inertia, newton_euler
from rbfmu_kernels.rotations.matrix import matrix_from_quaternion
from rbfmu_kernels.rotations.quaternion import normalize
from tests.support.references.exact import EPS, add, apply, cross, error, exact, mp, scaled, solve

NUMBER = st.floats(-100.0, 100.0, allow_subnormal=False).map(lambda x: x if abs(x) > 1e-6 else 0.0)
VECTOR = st.tuples(NUMBER, NUMBER, NUMBER)


def size(v):
    return max(abs(float(x)) for x in v)


def random_inertia(rng, diagonal=False):
    """Moments of a box, in random axes unless diagonal."""
    box = inertia.box_inertia(1.0, tuple(rng.uniform(0.3, 1.5, 3).tolist()))
    q = normalize(tuple(rng.normal(size=4).tolist()))
    return box if diagonal else inertia.rotate_inertia(matrix_from_quaternion(q), box)


def vectors(rng, n):
    return [tuple(v) for v in rng.normal(size=(n, 3)).tolist()]


def test_kinetic_energy_loses_two_eps_at_most():
    rng = np.random.default_rng(3)
    worst = 0.0
    for _ in range(300):
        M, mass, (v_c, omega) = random_inertia(rng), rng.uniform(0.5, 2.0), vectors(rng, 2)
        found = newton_euler.kinetic_energy(mass, M, v_c, omega)
        v, w = exact(v_c), exact(omega)
        truth = (mp.mpf(mass) * mp.fdot(v, v) + mp.fdot(w, apply(exact(M), w))) / 2
        worst = max(worst, error(found, truth, truth))
    assert worst <= 2


@pytest.mark.parametrize("diagonal", [True, False], ids=["principal axes", "any axes"])
def test_euler_equation_solves_its_equation(diagonal):
    rng = np.random.default_rng(4)
    worst = 0.0
    for _ in range(300):
        M, (omega, torque) = random_inertia(rng, diagonal), vectors(rng, 2)
        alpha = newton_euler.euler_equation(M, omega, torque)
        w = exact(omega)
        truth = solve(exact(M), add(exact(torque), scaled(-1, cross(w, apply(exact(M), w)))))
        inverse = np.linalg.inv(np.array(M))
        scale = np.linalg.norm(inverse, 2) * (np.linalg.norm(torque) + np.linalg.norm(M, 2) * np.dot(omega, omega))
        worst = max(worst, error(alpha, truth, scale * (1.0 if diagonal else np.linalg.cond(np.array(M)))))
    assert worst <= 2


def test_euler_equation_in_principal_axes_keeps_each_component_s_digits():
    """Nothing cancels but torque against gyroscopic torque, however near the moments are to each other."""
    rng = np.random.default_rng(5)
    worst = 0.0
    for near in (1.0, 1e-3, 1e-10):
        for _ in range(100):
            moments = (1.0 + near * rng.uniform(-0.3, 0.3, 3)).tolist()
            (omega,) = vectors(rng, 1)
            alpha = newton_euler.euler_equation(inertia.diagonal(tuple(moments)), omega, (0.0, 0.0, 0.0))
            (a, b, c), (x, y, z) = exact(moments), exact(omega)
            truth = [(b - c) * y * z / a, (c - a) * z * x / b, (a - b) * x * y / c]
            worst = max(worst, *(error(f, t, abs(t)) for f, t in zip(alpha, truth, strict=True)))
    assert worst <= 2.5


@given(st.integers(0, 2), st.floats(0.1, 3.0), st.floats(0.1, 3.0), VECTOR)
def test_a_symmetric_body_has_no_gyroscopic_torque_about_its_own_axis(axis, transverse, own, omega):
    moments = [transverse] * 3
    moments[axis] = own
    assert newton_euler.gyroscopic_torque(inertia.diagonal(tuple(moments)), omega)[axis] == 0.0


@given(VECTOR, st.tuples(NUMBER, NUMBER, NUMBER), st.integers(0, 2))
def test_a_beam_does_not_accelerate_about_itself(rate, torque, axis):
    """Its rate about itself is zero, as a scene demands; the others are free, and so is the torque."""
    moments, omega = [0.75] * 3, list(rate)
    moments[axis] = omega[axis] = 0.0
    alpha = newton_euler.euler_equation(inertia.diagonal(tuple(moments)), tuple(omega), torque)
    assert alpha[axis] == 0.0
    for i in range(3):
        assert i == axis or abs(alpha[i] - torque[i] / 0.75) <= 3 * EPS * abs(torque[i])


def test_newton_euler_o_solves_its_equations():
    """F = m (a_o + alpha x r_c + omega x (omega x r_c)) ; T_o = M_o alpha + omega x (M_o omega) + m r_c x a_o."""
    rng = np.random.default_rng(9)
    worst = 0.0
    for _ in range(200):
        mass, (r_oc, omega, force, torque) = float(rng.uniform(0.5, 2.0)), vectors(rng, 4)
        M_o = inertia.parallel_axis(random_inertia(rng), mass, r_oc)
        a_o, alpha = map(exact, newton_euler.newton_euler_o(mass, M_o, r_oc, omega, force, torque))
        m, M, r, w = map(exact, (mass, M_o, r_oc, omega))
        push = scaled(m, add(a_o, cross(alpha, r), cross(w, cross(w, r))))
        turn = add(apply(M, alpha), cross(w, apply(M, w)), scaled(m, cross(r, a_o)))
        M_c = np.array(M_o) - np.array(inertia.point_inertia(mass, r_oc))
        ill = np.linalg.cond(M_c) * np.linalg.norm(M_o, 2) / np.linalg.norm(M_c, 2)
        forces = np.linalg.norm(force) + mass * np.linalg.norm(r_oc) * (size(alpha) + np.dot(omega, omega))
        torques = np.linalg.norm(torque) + np.linalg.norm(M_o, 2) * (size(alpha) + np.dot(omega, omega)) + forces
        worst = max(worst, error(force, push, forces), error(torque, turn, torques * ill))
    assert worst <= 1.5


@pytest.mark.parametrize("lever", [1e2, 1e4, 1e6])
def test_newton_euler_o_loses_the_digits_that_the_lever_takes(lever):
    """M_o holds M_c to eps m r^2 only: the error of alpha is that over the smallest moment about c."""
    M_c, r_oc, zero = inertia.diagonal((1.1, 1.3, 1.7)), (lever / 3.0, lever / 7.0, -lever / 1.7), (0.0, 0.0, 0.0)
    truth = np.array([1.0, 1.0, 1.0]) / [1.1, 1.3, 1.7]
    _, alpha = newton_euler.newton_euler_o(
        1.0, inertia.parallel_axis(M_c, 1.0, r_oc), r_oc, zero, zero, (1.0, 1.0, 1.0)
    )
    assert 0.02 * EPS * lever**2 < np.max(np.abs(alpha - truth)) < 0.2 * EPS * lever**2


def test_damping_takes_energy_about_every_axis():
    assert newton_euler.damping_torque((0.5, 1.0, 2.0), (1.0, -2.0, 3.0)) == (-0.5, 2.0, -6.0)


def test_a_body_point_moves_around_the_origin_of_its_arm():
    """omega x (omega x r) points at the axis, alpha x r along the circle."""
    found = newton_euler.relative_acceleration((0.0, 0.0, 2.0), (0.0, 0.0, 5.0), (3.0, 0.0, 0.0))
    assert found == (-12.0, 15.0, 0.0)


def test_jerk_of_a_body_point_is_the_derivative_of_its_acceleration_in_space():
    """Of a rate that is a quadratic in time: differences of five points are exact for powers to the fourth."""
    for omega, alpha, alpha_rate, r in np.random.default_rng(4).integers(-9, 10, (20, 4, 3)).astype(float).tolist():

        def acceleration(t, omega=omega, alpha=alpha, alpha_rate=alpha_rate, r=r):
            turning = add(omega, scaled(t, alpha), scaled(t * t / 2, alpha_rate))
            return add(cross(add(alpha, scaled(t, alpha_rate)), r), cross(turning, cross(turning, r)))

        in_body = add(*(scaled(mp.mpf(k) / 12, acceleration(t)) for t, k in ((-2, 1), (-1, -8), (1, 8), (2, -1))))
        truth = [*map(float, add(in_body, cross(omega, acceleration(0))))]
        assert interpreted(newton_euler.relative_jerk)(omega, alpha, alpha_rate, r) == pytest.approx(truth, rel=1e-13)


def test_of_one_kilogram_the_acceleration_is_the_force_and_of_none_it_is_infinite():
    sphere, still, force = inertia.diagonal((2.0, 2.0, 2.0)), (0.0, 0.0, 0.0), (1.0, -2.0, 3.0)
    for mass, expected in ((1.0, force), (0.0, (np.inf, -np.inf, np.inf))):
        assert newton_euler.newton_euler_c(mass, sphere, still, force, still)[0] == expected
