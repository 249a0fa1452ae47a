"""Elliptic functions and integrals of the free body against mpmath."""

import math

import mpmath as mp
import numpy as np

from rbfmu_kernels.numerics.elliptic import angle_in_half_turns, climb_scale

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


def test_scale_gives_agm_third_kind_and_phase_beyond_double():
    rng, kcs = moduli(2, 90)
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
