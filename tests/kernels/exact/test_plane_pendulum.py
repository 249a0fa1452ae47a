"""The undamped pendulum's kernels against mpmath: any swing, any turning over, their border, any time."""

import math

import mpmath as mp
import numpy as np
import pytest

from rbfmu_kernels.compile.tiered import interpreted
from rbfmu_kernels.exact.pendulum import half_angle_rates, pendulum_at, pendulum_setup, sincos_of_half_angle
from rbfmu_kernels.numerics.elementary import sincos
from rbfmu_kernels.numerics.elliptic import NEAREST_KC, jacobi_from_theta, theta_series

EPS = 2.0**-52


def as_dd(x):
    return (float(x), float(x - mp.mpf(float(x))))


def value(a):
    return mp.mpf(a[0]) + mp.mpf(a[1])


def test_theta_series_give_jacobis_functions():
    rng, worst = np.random.default_rng(1), 0.0
    with mp.workdps(50):
        for i in range(200):
            kc = (1.0 - 0.665 * 10.0 ** rng.uniform(-15.0, 0.0), rng.uniform(NEAREST_KC, 1.0), NEAREST_KC)[i % 3]
            near_quarter = 0.5 * math.pi * int(rng.integers(-3, 4)) + 10.0 ** rng.uniform(-9.0, 0.0)
            s, c = sincos(rng.uniform(-6.0, 6.0) if i % 2 else near_quarter)
            u, m = mp.atan2(s, c) / mp.agm(1, kc), 1 - mp.mpf(kc) ** 2
            for name, found in zip(("sn", "cn", "dn"), jacobi_from_theta(s, c, theta_series((kc, 0.0))), strict=True):
                worst = max(worst, float(abs(found / mp.ellipfun(name, u, m=m) - 1)) / EPS)
    assert 1.5 < worst <= 5.0


def truth(x, y, z, t):
    """(sin(phi / 2), cos(phi / 2), phi')."""
    w_0, w, sign = mp.hypot(x, z), mp.hypot(x, y), 1 if y >= 0 else -1
    swings = abs(y) < z
    m, fastest = ((w / w_0) ** 2, w_0) if swings else ((w_0 / w) ** 2, w)
    u = mp.ellipf(mp.atan2(x, y) if swings else mp.atan2(sign * x, z), m) + fastest * t
    sn, cn, dn = (mp.ellipfun(name, u, m=m) for name in ("sn", "cn", "dn"))
    return (w / w_0 * sn, dn, 2 * w * cn) if swings else (sign * sn, cn, sign * 2 * w * dn)


def starts(kind, rng):
    """(w_0 sin(phi / 2), phi' / 2, w_0 cos(phi / 2)) as double-doubles."""
    w_0, half = mp.mpf(10) ** mp.mpf(rng.uniform(-3.0, 3.0)), mp.mpf(rng.uniform(-0.5, 0.5)) * mp.pi
    x, z, sign = w_0 * mp.sin(half), w_0 * mp.cos(half), float(rng.choice([-1.0, 1.0]))
    if kind == "tiny":
        x, z = x * mp.mpf(10) ** mp.mpf(rng.uniform(-150.0, -2.0)), w_0
        y = sign * abs(x) * mp.mpf(10) ** mp.mpf(rng.uniform(-2.0, 2.0))
    else:
        y = (
            sign
            * {
                "swing": z * mp.mpf(rng.random()),
                "near": z * (1 + rng.choice([-1.0, 1.0]) * mp.mpf(10) ** mp.mpf(rng.uniform(-28.0, -1.0))),
                "over": z + w_0 * mp.mpf(rng.random()),
                "fast": w_0 * mp.mpf(10) ** mp.mpf(rng.uniform(0.1, 9.0)),
            }[kind]
        )
    return as_dd(x), as_dd(y), as_dd(z)


@pytest.mark.parametrize("kind", [pytest.param("tiny", marks=pytest.mark.thorough), "swing", "near", "over", "fast"])
def test_a_pendulum_moves_as_jacobis_functions(kind):
    """Some 1e7 periods at most: the phase is double-double; a tiny swing is right relative to itself."""
    rng, worst = np.random.default_rng(2), 0.0
    for _ in range(150):
        with mp.workdps(340 if kind == "tiny" else 80):
            start = starts(kind, rng)
            x, y, z = map(value, start)
            t = 10.0 ** rng.uniform(-2.0, 8.0) / float(mp.hypot(y, mp.hypot(x, z)))
            sine, cosine, rate = truth(x, y, z, mp.mpf(t))
            found, w = pendulum_at(pendulum_setup(*start), (t, 0.0)), mp.hypot(x, y)
            largest = min(mp.mpf(1), w / mp.hypot(x, z))
            errors = (found[0] - sine) / largest, found[1] - cosine, (found[2] - rate) / (2 * w)
            worst = max(worst, *(float(abs(e)) / EPS for e in errors))
    assert 1.0 < worst <= 4.0


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_pendulum_on_the_separatrix_creeps_to_the_top(sign):
    """sin(phi / 2) = tanh u, phi' = 2 w_0 / cosh u, to that many digits of themselves that u keeps."""
    for x in (-2.4, 0.0, 1.8):
        z = (as_dd(mp.sqrt(9 - mp.mpf(x) ** 2)))[0]  # w_0 = 3, but for round-off
        start = (x, 0.0), (sign * z, 0.0), (z, 0.0)
        with mp.workdps(60):
            w_0 = mp.hypot(x, z)
            for t in (0.0, 0.01, 1.0, 20.0, 190.0):
                u = mp.atanh(sign * x / w_0) + w_0 * t
                sine, cosine, rate = pendulum_at(pendulum_setup(*start), (t, 0.0))
                assert abs(sine - sign * mp.tanh(u)) <= 4 * EPS
                assert abs(cosine * mp.cosh(u) - 1) <= 4 * (1 + abs(u)) * EPS
                assert abs(rate * mp.cosh(u) / (2 * w_0) - sign) <= 4 * (1 + abs(u)) * EPS
        sine, cosine, rate = pendulum_at(pendulum_setup(*start), (1e9, 0.0))
        assert abs(sine - sign) <= EPS
        assert 0.0 < cosine < 1e-250
        assert 0.0 < sign * rate < 1e-250


@pytest.mark.parametrize("kc2", [1e-3, 1e-12, 1e-17, 1e-25])
@pytest.mark.parametrize("seed", [1, 2])
def test_near_the_separatrix_the_error_is_of_the_digits_of_the_modulus(kc2, seed):
    """After some 1e6 swings or turns; cos(phi / 2) and phi' are small at the top, relative to which they are right."""
    rng = np.random.default_rng(seed)
    for beyond in (1.0 - kc2, 1.0 + kc2):
        for t in (0.7, 19.0, 1e3, 1e7 * (1.0 + rng.random())):
            with mp.workdps(80):
                beside = 1 + (mp.mpf(beyond < 1.0) * -2 + 1) * mp.mpf(kc2) / 2
                start = as_dd(mp.mpf(rng.uniform(-1.0, 1.0))), as_dd(beside), as_dd(mp.mpf(1))
                x, y, z = map(value, start)
                sine, cosine, rate = truth(x, y, z, mp.mpf(t))
                found, w_0 = pendulum_at(pendulum_setup(*start), (t, 0.0)), mp.hypot(x, z)
                digits = mp.mpf(1e-32) * w_0 * t / (abs(z * z - y * y) / max(w_0, mp.hypot(x, y)) ** 2)
                assert abs(found[0] - sine) <= 4 * EPS + digits
                length = mp.hypot(cosine, rate / (2 * w_0))
                errors = found[1] - cosine, (found[2] - rate) / (2 * w_0)
                assert max(map(abs, errors)) <= (4 * EPS + digits) * length


@pytest.mark.parametrize("t", [0.0, 0.3, 1e3, 1e20])
def test_equilibria_stay(t):
    zero, three = (0.0, 0.0), (3.0, 0.0)
    assert pendulum_at(pendulum_setup(zero, zero, three), (t, 0.0)) == (0.0, 1.0, 0.0)
    assert pendulum_at(pendulum_setup(zero, zero, zero), (t, 0.0)) == (0.0, 1.0, 0.0)
    for side in (-1.0, 1.0):
        sine, cosine, rate = pendulum_at(pendulum_setup((3.0 * side, 0.0), zero, zero), (t, 0.0))
        assert abs(sine - side) <= EPS
        assert abs(cosine) < 1e-250
        assert rate == 0.0


def test_without_weight_the_rate_is_constant():
    zero = (0.0, 0.0)
    for t in (0.1, 7.0, 1e5):
        s, c, rate = pendulum_at(pendulum_setup(zero, (-1.5, 0.0), zero), (t, 0.0))
        with mp.workdps(40):
            assert max(abs(s + mp.sin(1.5 * mp.mpf(t))), abs(c - mp.cos(1.5 * mp.mpf(t)))) <= 4 * EPS
        assert rate == -3.0


def test_there_is_no_phase_left_after_1e28_turns():
    setup = pendulum_setup((1.0, 0.0), (0.5, 0.0), (2.0, 0.0))
    assert all(math.isnan(x) for x in pendulum_at(setup, (1e30, 0.0)))


@pytest.mark.parametrize("way", [half_angle_rates, interpreted(half_angle_rates)])
@pytest.mark.parametrize("a", [0.0, 5e-324, -5e-324])
def test_a_load_of_which_no_half_is_left_is_none(way, a):
    assert way((a, 0.0), (0.0, 0.0)) == ((0.0, 0.0), (0.0, 0.0))


@pytest.mark.parametrize("size", [1e-200, 1.0, 1e150])
@pytest.mark.parametrize("angle", [0.0, 1e-30, -1e-9, 0.4, -1.6, 3.0, -3.141592, 3.14159265358979])
def test_the_angle_from_equilibrium_keeps_its_digits(angle, size):
    """Of phi'' = a cos theta + b sin theta = -w_0^2 sin(theta + phi), beside hanging and beside the top."""
    with mp.workdps(60):
        a, b = -size * mp.sin(angle), -size * mp.cos(angle)
        x, z = half_angle_rates(as_dd(a), as_dd(b))
        for found, true in (
            (x, mp.sqrt(size) * mp.sin(mp.mpf(angle) / 2)),
            (z, mp.sqrt(size) * mp.cos(mp.mpf(angle) / 2)),
        ):
            assert abs(value(found) - true) <= 1e-15 * EPS * abs(true)
        s, c = sincos_of_half_angle(x, z)
        assert abs(s - mp.sin(mp.mpf(angle) / 2)) <= EPS * abs(s)
        assert abs(c - mp.cos(mp.mpf(angle) / 2)) <= EPS
