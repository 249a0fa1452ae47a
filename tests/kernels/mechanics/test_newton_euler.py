"""Newton-Euler about the centre of mass and about a body point, momentum, energy: against rational arithmetic."""

from fractions import Fraction
from itertools import product as pairs

import numpy as np
import pytest
from hypothesis import given, strategies as st

import rbfmu
from rbfmu_kernels.compile.tiered import interpreted
from rbfmu_kernels.mechanics import inertia, newton_euler
from rbfmu_kernels.rotations.matrix import matrix_from_quaternion
from rbfmu_kernels.rotations.quaternion import normalize, rotate

EPS = 2.0**-52
NUMBER = st.floats(-100.0, 100.0, allow_subnormal=False).map(lambda x: x if abs(x) > 1e-6 else 0.0)
VECTOR = st.tuples(NUMBER, NUMBER, NUMBER)


def exact(v):
    return [Fraction(x) for x in v]


def cross(a, b):
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def dot(a, b):
    return sum(x * y for x, y in zip(a, b, strict=True))


def add(*vectors):
    return [sum(c) for c in zip(*vectors, strict=True)]


def scaled(s, v):
    return [s * x for x in v]


def transform(M, v):
    return [dot(map(Fraction, row), v) for row in M]


def solve(M, b):
    """M^-1 b by Cramer's rule, in fractions."""
    x, y, z = (exact(row) for row in M)
    det = dot(x, cross(y, z))
    return [
        (b[0] * c0 + b[1] * c1 + b[2] * c2) / det
        for c0, c1, c2 in zip(cross(y, z), cross(z, x), cross(x, y), strict=True)
    ]


def size(v):
    return max(abs(float(x)) for x in v)


def difference(v, truth):
    return size(add(exact(v), scaled(-1, truth)))


def random_inertia(rng, diagonal=False):
    """Moments of a box, in random axes unless diagonal."""
    box = inertia.box_inertia(1.0, tuple(rng.uniform(0.3, 1.5, 3).tolist()))
    q = normalize(tuple(rng.normal(size=4).tolist()))
    return box if diagonal else inertia.rotate_inertia(matrix_from_quaternion(q), box)


def vectors(rng, n):
    return [tuple(v) for v in rng.normal(size=(n, 3)).tolist()]


def test_angular_momentum_is_inertia_times_rate():
    rng = np.random.default_rng(1)
    worst = 0.0
    for _ in range(300):
        M, (omega,) = random_inertia(rng), vectors(rng, 1)
        h = newton_euler.angular_momentum(M, omega)
        scale = np.linalg.norm(M, 2) * np.linalg.norm(omega)
        worst = max(worst, difference(h, transform(M, exact(omega))) / scale)
    assert worst <= 1.5 * EPS


def test_kinetic_energy_is_that_of_the_particles():
    """Four particles, moving as one body: sum of m v^2 / 2."""
    rng = np.random.default_rng(2)
    worst = 0.0
    for _ in range(50):
        m, r = rng.uniform(0.5, 1.0, 4), rng.normal(size=(4, 3))
        mass, r_oc, M_c = rbfmu.inertia_of_points(m, r)
        omega, v_c = vectors(rng, 2)
        velocities = [np.array(v_c) + np.cross(omega, p - r_oc) for p in r]
        truth = sum(0.5 * mk * v @ v for mk, v in zip(m, velocities, strict=True))
        worst = max(worst, abs(rbfmu.kinetic_energy(mass, M_c, v_c, omega) / truth - 1.0))
    assert worst <= 6 * EPS  # the sum over particles has round-off of its own


def test_kinetic_energy_loses_two_eps_at_most():
    rng = np.random.default_rng(3)
    worst = 0.0
    for _ in range(300):
        M, mass, (v_c, omega) = random_inertia(rng), rng.uniform(0.5, 2.0), vectors(rng, 2)
        found = newton_euler.kinetic_energy(mass, M, v_c, omega)
        v, w = exact(v_c), exact(omega)
        truth = (Fraction(mass) * dot(v, v) + dot(w, transform(M, w))) / 2
        worst = max(worst, float(abs(Fraction(found) - truth) / truth))
    assert worst <= 2 * EPS


@pytest.mark.parametrize("diagonal", [True, False], ids=["principal axes", "any axes"])
def test_euler_equation_solves_its_equation(diagonal):
    rng = np.random.default_rng(4)
    worst = 0.0
    for _ in range(300):
        M, (omega, torque) = random_inertia(rng, diagonal), vectors(rng, 2)
        alpha = newton_euler.euler_equation(M, omega, torque)
        w = exact(omega)
        gyroscopic = cross(w, transform(M, w))
        truth = solve(M, add(exact(torque), scaled(-1, gyroscopic)))
        error = difference(alpha, truth)
        inverse = np.linalg.inv(np.array(M))
        scale = np.linalg.norm(inverse, 2) * (np.linalg.norm(torque) + np.linalg.norm(M, 2) * dot(omega, omega))
        worst = max(worst, error / scale / (1.0 if diagonal else np.linalg.cond(np.array(M))))
    assert worst <= 2 * EPS


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
            worst = max(worst, *(float(abs(Fraction(f) / t - 1)) for f, t in zip(alpha, truth, strict=True)))
    assert worst <= 2.5 * EPS


@given(st.floats(1e-3, 1e3), VECTOR)
def test_a_ball_has_no_gyroscopic_torque(mass, omega):
    assert newton_euler.gyroscopic_torque(inertia.sphere_inertia(mass, 0.7), omega) == (0.0, 0.0, 0.0)


@given(st.integers(0, 2), st.floats(0.1, 3.0), st.floats(0.1, 3.0), VECTOR)
def test_a_symmetric_body_has_no_gyroscopic_torque_about_its_own_axis(axis, transverse, own, omega):
    moments = [transverse] * 3
    moments[axis] = own
    assert newton_euler.gyroscopic_torque(inertia.diagonal(tuple(moments)), omega)[axis] == 0.0


def test_the_gyroscopic_torque_does_no_work():
    rng = np.random.default_rng(6)
    worst = 0.0
    for _ in range(100):
        M, (omega,) = random_inertia(rng), vectors(rng, 1)
        work = np.dot(omega, newton_euler.gyroscopic_torque(M, omega))
        worst = max(worst, abs(work) / (np.linalg.norm(M, 2) * np.linalg.norm(omega) ** 3))
    assert worst <= 0.25 * EPS


@given(VECTOR, st.tuples(NUMBER, NUMBER, NUMBER), st.integers(0, 2))
def test_a_beam_does_not_accelerate_about_itself(rate, torque, axis):
    """Its rate about itself is zero, as a scene demands; the others are free, and so is the torque."""
    moments, omega = [0.75] * 3, list(rate)
    moments[axis] = omega[axis] = 0.0
    alpha = newton_euler.euler_equation(inertia.diagonal(tuple(moments)), tuple(omega), torque)
    assert alpha[axis] == 0.0
    for i in range(3):
        assert i == axis or abs(alpha[i] - torque[i] / 0.75) <= 3 * EPS * abs(torque[i])


def test_a_turned_beam_does_not_accelerate_about_itself_but_for_round_off():
    rng = np.random.default_rng(7)
    worst = 0.0
    for _ in range(100):
        R = matrix_from_quaternion(normalize(tuple(rng.normal(size=4).tolist())))
        M = inertia.rotate_inertia(R, inertia.beam_inertia(1.0, 3.0))  # its axis is R's first column
        across, torque = rng.normal(size=2), rng.normal(size=3)
        omega = np.array(R) @ np.array([0.0, *across])
        alpha = np.array(newton_euler.euler_equation(M, tuple(omega.tolist()), tuple(torque.tolist())))
        scale = (np.linalg.norm(torque) + omega @ omega) / 0.75
        worst = max(worst, abs(alpha @ np.array(R)[:, 0]) / scale)
    assert worst <= 3 * EPS


def test_newton_euler_c_is_newton_and_euler():
    rng = np.random.default_rng(8)
    for _ in range(50):
        M, mass, (omega, force, torque) = random_inertia(rng), float(rng.uniform(0.5, 2.0)), vectors(rng, 3)
        a_c, alpha = newton_euler.newton_euler_c(mass, M, omega, force, torque)
        assert alpha == newton_euler.euler_equation(M, omega, torque)
        assert difference(a_c, scaled(1 / Fraction(mass), exact(force))) <= 1 * EPS * size(force) / mass


def test_newton_euler_o_solves_its_equations():
    """F = m (a_o + alpha x r_c + omega x (omega x r_c)) ; T_o = M_o alpha + omega x (M_o omega) + m r_c x a_o."""
    rng = np.random.default_rng(9)
    worst = [0.0, 0.0]
    for _ in range(200):
        mass, (r_oc, omega, force, torque) = float(rng.uniform(0.5, 2.0)), vectors(rng, 4)
        M_o = inertia.parallel_axis(random_inertia(rng), mass, r_oc)
        a_o, alpha = map(exact, newton_euler.newton_euler_o(mass, M_o, r_oc, omega, force, torque))
        m, r, w = Fraction(mass), exact(r_oc), exact(omega)
        push = scaled(m, add(a_o, cross(alpha, r), cross(w, cross(w, r))))
        turn = add(transform(M_o, alpha), cross(w, transform(M_o, w)), scaled(m, cross(r, a_o)))
        M_c = np.array(M_o) - np.array(inertia.point_inertia(mass, r_oc))
        ill = np.linalg.cond(M_c) * np.linalg.norm(M_o, 2) / np.linalg.norm(M_c, 2)
        forces = np.linalg.norm(force) + mass * np.linalg.norm(r_oc) * (size(alpha) + np.dot(omega, omega))
        torques = np.linalg.norm(torque) + np.linalg.norm(M_o, 2) * (size(alpha) + np.dot(omega, omega)) + forces
        worst[0] = max(worst[0], difference(force, push) / forces)
        worst[1] = max(worst[1], difference(torque, turn) / torques / ill)
    assert worst[0] <= 1.5 * EPS
    assert worst[1] <= 1.5 * EPS


def test_newton_euler_about_o_and_about_c_are_one_motion():
    rng = np.random.default_rng(10)
    worst = 0.0
    for _ in range(100):
        M_c, mass, (r_oc, omega, force, torque_c) = random_inertia(rng), float(rng.uniform(0.5, 2.0)), vectors(rng, 4)
        torque_o = tuple(np.add(torque_c, np.cross(r_oc, force)).tolist())
        M_o = inertia.parallel_axis(M_c, mass, r_oc)
        a_c, alpha_c = newton_euler.newton_euler_c(mass, M_c, omega, force, torque_c)
        a_o, alpha_o = newton_euler.newton_euler_o(mass, M_o, r_oc, omega, force, torque_o)
        ill = np.linalg.cond(np.array(M_c)) * np.linalg.norm(M_o, 2) / np.linalg.norm(M_c, 2)
        scale = (np.linalg.norm(torque_o) + np.linalg.norm(M_o, 2) * np.dot(omega, omega)) * np.linalg.norm(
            inertia.inverse_inertia(M_c), 2
        )
        worst = max(worst, np.max(np.abs(np.subtract(alpha_o, alpha_c))) / ill / scale)
        carried = rbfmu.point_acceleration(a_o, omega, alpha_o, r_oc, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
        np.testing.assert_allclose(carried, a_c, atol=10 * EPS * (size(a_o) + size(a_c) + scale * size(r_oc)))
    assert worst <= 0.5 * EPS


@pytest.mark.parametrize("lever", [1e2, 1e4, 1e6])
def test_newton_euler_o_loses_the_digits_that_the_lever_takes(lever):
    """M_o holds M_c to eps m r^2 only: the error of alpha is that over the smallest moment about c."""
    M_c, r_oc, zero = inertia.diagonal((1.1, 1.3, 1.7)), (lever / 3.0, lever / 7.0, -lever / 1.7), (0.0, 0.0, 0.0)
    truth = np.array([1.0, 1.0, 1.0]) / [1.1, 1.3, 1.7]
    _, alpha = newton_euler.newton_euler_o(
        1.0, inertia.parallel_axis(M_c, 1.0, r_oc), r_oc, zero, zero, (1.0, 1.0, 1.0)
    )
    error = np.max(np.abs(alpha - truth))
    assert 0.02 * EPS * lever**2 < error < 0.2 * EPS * lever**2


def test_dynamics_do_not_depend_on_the_axes():
    """Turn all vectors and M by the same rotation: so is the result turned."""
    rng = np.random.default_rng(11)
    worst = 0.0
    for _ in range(100):
        M, (omega, torque) = random_inertia(rng, diagonal=True), vectors(rng, 2)
        q = normalize(tuple(rng.normal(size=4).tolist()))
        turned = inertia.rotate_inertia(matrix_from_quaternion(q), M)
        alpha = newton_euler.euler_equation(turned, rotate(q, omega), rotate(q, torque))
        again = rotate(q, newton_euler.euler_equation(M, omega, torque))
        scale = np.linalg.norm(inertia.inverse_inertia(M), 2) * (
            np.linalg.norm(torque) + np.linalg.norm(M, 2) * np.dot(omega, omega)
        )
        worst = max(worst, np.max(np.abs(np.subtract(alpha, again))) / scale / np.linalg.cond(np.array(M)))
    assert worst <= 3 * EPS


def test_power_is_the_rate_of_the_energy():
    """d/dt (omega . M omega / 2) = omega . T."""
    rng = np.random.default_rng(12)
    worst = 0.0
    for _ in range(100):
        M, (omega, torque) = random_inertia(rng), vectors(rng, 2)
        alpha = newton_euler.euler_equation(M, omega, torque)
        scale = (
            np.linalg.cond(np.array(M))
            * np.linalg.norm(omega)
            * (np.linalg.norm(torque) + np.linalg.norm(M, 2) * np.dot(omega, omega))
        )
        worst = max(worst, abs(np.dot(alpha, np.array(M) @ omega) - np.dot(omega, torque)) / scale)
    assert worst <= 2 * EPS


def test_damping_takes_energy_about_every_axis():
    assert newton_euler.damping_torque((0.5, 1.0, 2.0), (1.0, -2.0, 3.0)) == (-0.5, 2.0, -6.0)


def test_a_body_point_moves_around_the_origin_of_its_arm():
    """omega x (omega x r) points at the axis, alpha x r along the circle."""
    found = newton_euler.relative_acceleration((0.0, 0.0, 2.0), (0.0, 0.0, 5.0), (3.0, 0.0, 0.0))
    assert found == (-12.0, 15.0, 0.0)


@pytest.mark.parametrize(
    "name", ["euler_equation", "newton_euler_c", "newton_euler_o", "angular_momentum", "kinetic_energy"]
)
def test_array_functions_broadcast_the_kernel(name):
    rng = np.random.default_rng(13)
    M = np.array([random_inertia(rng) for _ in range(2)])
    core = {"mass": rng.uniform(1.0, 2.0, (4, 1)), "M_c": M, "M_o": M + 3.0 * np.eye(3)}
    names = {
        "euler_equation": ("M_c", "omega", "torque"),
        "newton_euler_c": ("mass", "M_c", "omega", "force", "torque"),
        "newton_euler_o": ("mass", "M_o", "r_oc", "omega", "force", "torque"),
        "angular_momentum": ("M_c", "omega"),
        "kinetic_energy": ("mass", "M_c", "v_c", "omega"),
    }[name]
    arguments = [core[n] if n in core else rng.normal(size=(4, 2, 3)) for n in names]
    found = getattr(rbfmu, name)(*arguments)
    rows = [
        np.broadcast_to(a, (4, 2, *np.shape(a)[np.ndim(a) - d :]))
        for a, d in zip(arguments, map(_depth, names), strict=True)
    ]
    for i, j in pairs(range(4), range(2)):
        single = getattr(newton_euler, name)(*(_tuples(a[i, j]) for a in rows))
        parts = zip(found, single, strict=True) if name.startswith("newton") else [(found, single)]
        for many, one in parts:
            np.testing.assert_array_equal(many[i, j], one)


def _depth(name):
    return {"mass": 0, "M_c": 2, "M_o": 2}.get(name, 1)


def _tuples(a):
    return tuple(map(_tuples, a)) if np.ndim(a) else float(a)


def test_jerk_of_a_body_point_is_the_derivative_of_its_acceleration_in_space():
    """Of a rate that is a quadratic in time: differences of five points are exact for powers to the fourth."""
    for omega, alpha, alpha_rate, r in np.random.default_rng(4).integers(-9, 10, (20, 4, 3)).astype(float).tolist():

        def acceleration(t, omega=omega, alpha=alpha, alpha_rate=alpha_rate, r=r):
            turning = add(omega, scaled(t, alpha), scaled(Fraction(t * t, 2), alpha_rate))
            return add(cross(add(alpha, scaled(t, alpha_rate)), r), cross(turning, cross(turning, r)))

        in_body = add(*(scaled(Fraction(k, 12), acceleration(t)) for t, k in ((-2, 1), (-1, -8), (1, 8), (2, -1))))
        truth = add(in_body, cross(omega, acceleration(0)))
        assert interpreted(newton_euler.relative_jerk)(omega, alpha, alpha_rate, r) == pytest.approx(truth, rel=1e-13)


def test_of_one_kilogram_the_acceleration_is_the_force_and_of_none_it_is_infinite():
    sphere, still, force = inertia.diagonal((2.0, 2.0, 2.0)), (0.0, 0.0, 0.0), (1.0, -2.0, 3.0)
    for mass, expected in ((1.0, force), (0.0, (np.inf, -np.inf, np.inf))):
        assert newton_euler.newton_euler_c(mass, sphere, still, force, still)[0] == expected
