"""The spline through measured quaternions, against a motion that is known exactly."""

import numpy as np
import pytest

import rbfmu

MOMENTS, Q_0, OMEGA_0 = [1.0, 2.0, 3.0], [0.5, 0.5, -0.5, 0.5], [0.3, 1.0, 0.2]
BETWEEN = np.linspace(0.0, 16.0, 801)


def motion(t):
    return rbfmu.free_rotation(MOMENTS, Q_0, OMEGA_0, t)


def spline_of(points, sign=None):
    times = np.linspace(0.0, 16.0, points)
    q, _ = motion(times)
    return rbfmu.attitude_spline(times, q if sign is None else q * sign[:, np.newaxis])


def errors(spline):
    """The largest, ends and all, of attitude, rates and accelerations; these by Euler's equation."""
    q, omega = motion(BETWEEN)
    alpha = rbfmu.euler_equation(np.diag(MOMENTS), omega, np.zeros(3))
    return np.array([
        rbfmu.angle_between(spline(BETWEEN), q).max(),
        np.linalg.norm(spline.omega_b(BETWEEN) - omega, axis=1).max(),
        np.linalg.norm(spline.alpha_b(BETWEEN) - alpha, axis=1).max(),
    ])  # fmt: skip


def test_errors_fall_as_stated():
    """As h^4 of attitudes, h^3 of rates, h^2 of accelerations, also at the ends."""
    coarse, fine = errors(spline_of(129)), errors(spline_of(257))
    assert (np.log2(coarse / fine) > [3.7, 2.7, 1.7]).all()
    assert (coarse < [1e-5, 3e-4, 1e-2]).all()


def test_it_goes_through_every_attitude():
    spline = spline_of(33)
    assert rbfmu.angle_between(spline(spline.times), motion(spline.times)[0]).max() < 1e-14


def test_signs_and_lengths_do_not_matter_and_the_result_does_not_jump():
    signs = np.random.default_rng(5).choice([-1.0, 1.0], 65) * np.linspace(0.5, 2.0, 65)
    signs[0] = 1.0
    plain, mixed = spline_of(65)(BETWEEN), spline_of(65, signs)(BETWEEN)
    np.testing.assert_allclose(mixed, plain, atol=1e-14)
    assert (np.sum(mixed[1:] * mixed[:-1], axis=1) > 0.99).all()


def test_rates_are_derivatives_of_the_attitude():
    spline, h = spline_of(33), 1e-5
    t = BETWEEN[5:-5]
    dq = (spline(t + h) - spline(t - h)) / (2.0 * h)
    np.testing.assert_allclose(rbfmu.omega_b_from_quaternion_rate(spline(t), dq), spline.omega_b(t), atol=1e-8)
    difference = (spline.omega_b(t + h) - spline.omega_b(t - h)) / (2.0 * h)
    np.testing.assert_allclose(difference, spline.alpha_b(t), atol=1e-4)


def test_noise_makes_errors_of_the_rates_as_stated():
    rng, times, h, noise = np.random.default_rng(6), np.arange(400) * 0.1, 0.1, 1e-4
    q = rbfmu.quaternion_from_rotvec(noise * rng.standard_normal((400, 3)))
    spread = rbfmu.attitude_spline(times, q).omega_b(np.linspace(1.0, 38.0, 2000)).std()
    assert 1.0 < spread / (noise / h) < 2.0


def test_one_time_and_any_shape_of_times():
    spline = spline_of(33)
    assert spline(3.0).shape == (4,)
    assert spline.omega_b([[1.0, 2.0, 3.0]]).shape == (1, 3, 3)
    assert (spline.alpha_b([2.0]) == spline.alpha_b(2.0)).all()


def test_a_spline_keeps_its_times_though_the_caller_moves_his():
    times = np.linspace(0.0, 16.0, 33)
    spline = rbfmu.attitude_spline(times, motion(times)[0])
    before = spline(3.3)
    times += 100.0 * np.sin(times)
    assert (spline(3.3) == before).all()


@pytest.mark.parametrize(("times", "q_ab", "said"), [
    ([0.0, 1.0, 2.0], np.ones((3, 4)), r"times must be 4 or more in one row that increase, got shape \(3,\)"),
    ([0.0, 1.0, 1.0, 2.0], np.ones((4, 4)),
     r"times must be 4 or more in one row that increase, got times\[2\] = 1.0 after 1.0"),
    ([0.0, 1.0, 2.0, 3.0], np.ones((4, 3)), r"q_ab must have shape \(4, 4\), one for each time, got \(4, 3\)"),
    ([0.0, 1.0, 2.0, 3.0], np.diag([1.0, 1.0, 0.0, 1.0]), r"q_ab\[2\] must be finite and not zero"),
    ([0.0, 1.0, 2.0, np.nan], np.ones((4, 4)), r"times must be finite numbers, got nan at \[3\]"),
    ([0.0, 1.0, 2.0, 3.0], np.diag([1.0, np.inf, 1.0, 1.0]), r"q_ab must be finite numbers, got inf at \[1, 1\]"),
    (["now", 1.0, 2.0, 3.0], np.ones((4, 4)), "times must be real numbers"),
])  # fmt: skip
def test_a_wrong_argument_is_named(times, q_ab, said):
    with pytest.raises(ValueError, match=f"^attitude_spline: {said}"):
        rbfmu.attitude_spline(times, q_ab)


def test_times_that_are_no_numbers_are_named():
    with pytest.raises(ValueError, match="attitude_spline: t must be real numbers, got 'now'"):
        spline_of(9)("now")


@pytest.mark.parametrize("t", [-1e-9, 16.1, np.nan])
def test_times_outside_are_refused(t):
    with pytest.raises(ValueError, match="t must be times from 0 to 16 s"):
        spline_of(9).omega_b(t)
