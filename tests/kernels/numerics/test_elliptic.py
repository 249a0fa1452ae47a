"""Elliptic functions and integrals of the free body, and its short theta series, against mpmath."""

import math

import mpmath as mp
import numpy as np
import pytest

from rbfmu_kernels.exact.free_rotation_series import (
    NEAR,
    TUMBLING,
    attitude,
    attitude_near,
    near_series_of,
    place_of,
    series_of,
)
from rbfmu_kernels.numerics.elementary import sincos_half_turns
from rbfmu_kernels.numerics.elliptic import NEAREST_KC, angle_in_half_turns, climb_scale, jacobi_near, near_series, nome

EPS = 2.0**-52


def moduli(seed, n):
    """Complementary moduli: near 1, ordinary, small, tiny."""
    rng = np.random.default_rng(seed)
    ranges = np.array([1e-9, 0.1, 1.0, 5.0, 20.0, 290.0])[np.arange(n) % 6]
    return rng, (10.0 ** (-ranges * rng.random(n))).tolist()


def digits_for(kc):
    """Enough for 1 - kc^2 to keep 40 digits of kc."""
    return int(45 - 2.2 * math.log10(kc))


def as_dd(x):
    return (float(x), float(x - mp.mpf(float(x))))


def value(a):
    return mp.mpf(a[0]) + mp.mpf(a[1])


@pytest.mark.parametrize("count", [12, pytest.param(90, marks=pytest.mark.thorough)])
def test_scale_gives_agm_third_kind_and_phase_beyond_double(count):
    rng, kcs = moduli(2, count)
    for i, kc in enumerate(kcs):
        n = float(rng.random() ** (1, 6)[i % 2])
        am = float(rng.random()) * math.pi / 2
        with mp.workdps(digits_for(kc)):
            s, c = as_dd(mp.sin(am)), as_dd(mp.cos(am))
            agm, total, x = climb_scale((kc, 0.0), (n, 0.0), s, c)
            m, mean = 1 - mp.mpf(kc) ** 2, mp.agm(1, kc)
            assert abs(value(agm) / mean - 1) < 1e-31
            sum_ = (2 - 4 * mean / mp.pi * mp.ellippi(-mp.mpf(n), m)) * (1 + mp.mpf(n)) / mp.mpf(n)
            assert abs(value(total) / sum_ - 1) < 1e-26
            phase = mp.ellipf(mp.atan2(value(s), value(c)), m) * mean / mp.pi
            assert abs(value(x) - phase) < 2e-19


def test_angles_in_all_quadrants():
    rng = np.random.default_rng(4)
    with mp.workdps(50):
        for angle in [*rng.uniform(-1.0, 1.0, 300).tolist(), 0.0, 0.25, 0.5, -0.5, 1.0, 1e-17, -1e-9]:
            y, x = as_dd(mp.sinpi(angle)), as_dd(mp.cospi(angle))
            truth = mp.atan2(value(y), value(x)) / mp.pi
            assert abs(value(angle_in_half_turns(y, x)) - truth) < 3e-19


# Theta series


def shapes(rng, n, below):
    """(kappa, rho, kc): kappa and rho up to 1e6 apart; kc below NEAREST_KC or not."""
    for i in range(n):
        spread = mp.mpf(10) ** mp.mpf(rng.uniform(-6.0, 6.0))
        if below:
            kc = mp.mpf(10) ** mp.mpf(-rng.uniform(0.0, (1.0, 12.0)[i % 2])) * NEAREST_KC
            k = mp.sqrt(1 - kc**2)
        else:
            k = mp.mpf(10) ** mp.mpf(-rng.uniform(0.0, (1.0, 12.0)[i % 2])) * 0.94
            kc = mp.sqrt(1 - k**2)
        yield k * spread, k / spread, kc


def shift(kappa, kc):
    """a of sn(a, k') = 1 / sqrt(1 + kappa)."""
    return mp.ellipf(mp.atan(1 / mp.sqrt(kappa)), kc**2)


def distance(found, alpha, beta, sign):
    """From the unit quaternion of alpha and sign beta, conjugate for sign > 0."""
    truth = [alpha.real, sign * beta.real, -beta.imag, -sign * alpha.imag]
    size, length = mp.sqrt(sum(x * x for x in truth)), mp.sqrt(sum(mp.mpf(x) ** 2 for x in found))
    return float(mp.sqrt(sum((x / length - y / size) ** 2 for x, y in zip(found, truth, strict=True)))) / EPS


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_attitude_is_two_theta_functions(sign):
    rng, worst = np.random.default_rng(1), 0.0
    with mp.workdps(40):
        for kappa, rho, kc in shapes(rng, 100, below=False):
            x, tilt = float(rng.uniform(-1.0, 1.0)), mp.sqrt(rho) / (1 + mp.sqrt(1 + rho))
            series = series_of(float(kappa), float(tilt), float(kappa * rho), float(kc), sign)
            k, k_prime = mp.ellipk(1 - kc**2), mp.ellipk(kc**2)
            v = mp.mpc(mp.pi * x, mp.pi * shift(kappa, kc) / (2 * k))
            q2 = mp.exp(-2 * mp.pi * k_prime / k)
            found = attitude(*sincos_half_turns(x, 0.0), series)
            worst = max(worst, distance(found, mp.jtheta(4, v, q2), mp.jtheta(1, v, q2), sign))
    assert 0.5 < worst <= 4.0


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_attitude_near_the_separatrix_is_two_theta_functions(sign):
    rng, worst = np.random.default_rng(2), 0.0
    with mp.workdps(60):
        for kappa, _, kc in shapes(rng, 100, below=True):
            x = float(rng.uniform(-0.5, 0.5))
            series, width, turn = near_series_of(as_dd(mp.sqrt(kappa)), as_dd(kc), as_dd(mp.agm(1, kc)), sign)
            k, k_prime = mp.ellipk(1 - kc**2), mp.ellipk(kc**2)
            b = mp.pi * shift(kappa, kc) / (4 * k_prime)
            assert abs(turn - sign * 2 * b / mp.pi) <= EPS
            z, q = mp.mpc(b, -mp.pi * x * k / (2 * k_prime)), mp.exp(-mp.pi * k / (2 * k_prime))
            place = place_of(NEAR, (x, 0.0), width)
            found = attitude_near(place[0], place[1], series)
            worst = max(worst, distance(found, mp.jtheta(2, z, q), 1j * mp.jtheta(1, z, q), sign))
    assert 0.5 < worst <= 4.0


@pytest.mark.parametrize("least", [1.0, 20.0, pytest.param(290.0, marks=pytest.mark.thorough)])
def test_jacobis_functions_near_the_separatrix(least):
    rng, worst = np.random.default_rng(3), 0.0
    for i in range(100):
        kc = NEAREST_KC * 10.0 ** -rng.uniform(0.0, least)
        with mp.workdps(int(45 - 2.2 * math.log10(kc))):
            m = 1 - mp.mpf(kc) ** 2
            width = as_dd(mp.pi / mp.ln(2) * mp.agm(1, mp.sqrt(m)) / mp.agm(1, kc))
            x = rng.uniform(-0.5, 0.5) if i % 3 else math.copysign(0.5 - 10.0 ** rng.uniform(-9.0, -1.0), i % 2 - 0.5)
            e, side, _, _ = place_of(NEAR, (x, 0.0), width)
            u = mp.mpf(x) * mp.pi / mp.agm(1, kc)
            near = near_series(kc)
            for name, found in zip(("sn", "cn", "dn"), jacobi_near(e, side, near), strict=True):
                truth = mp.ellipfun(name, u, m=m)
                unit = 1 if name == "sn" else (abs(truth) if name == "dn" else max(abs(truth), mp.mpf(kc)))
                worst = max(worst, float(abs(found - truth) / unit) / EPS)
    assert 1.5 < worst <= 6.0


def test_places_beyond_a_half_turn_are_odd_and_even():
    width = (2.0, 0.0)
    for turns in (-3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0):
        e, side, flip, rest = place_of(NEAR, (turns + 0.25, 0.0), width)
        assert (rest, flip, side) == (0.25, -1.0 if turns % 2.0 else 1.0, 1.0)
        assert e == pytest.approx(2.0**-0.5, rel=EPS)
    s, c, _, _ = place_of(TUMBLING, (0.5, 0.0), width)
    assert (s, c) == pytest.approx((1.0, 0.0), abs=EPS)


def test_nome_keeps_its_digits_where_it_is_tiny():
    with mp.workdps(60):
        for lack in (1.0 - NEAREST_KC, 0.1, 1e-5, 1e-12):
            kc = 1 - mp.mpf(lack)
            truth = mp.exp(-mp.pi * mp.ellipk(kc**2) / mp.ellipk(1 - kc**2))
            assert float(abs(nome(lack, float(kc)) / truth - 1)) <= 4.0 * EPS
