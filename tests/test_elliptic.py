"""Elliptic functions and integrals of the free body against mpmath."""

import math

import mpmath as mp
import numpy as np

from rbfmu_kernels.elementary import sincos
from rbfmu_kernels.elliptic import angle_in_half_turns, climb_scale, jacobi_from_phase, scale_levels

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


def test_jacobi_functions():
    rng, kcs = moduli(1, 150)
    worst = {"sn": 0.0, "cn": 0.0, "dn": 0.0, "relative": 0.0}
    for i, kc in enumerate(kcs):
        near_quarter = math.pi / 2 - 10.0 ** rng.uniform(-9.0, 0.0)
        x = rng.uniform(-0.5, 0.5) * math.pi if i % 3 else (near_quarter, -near_quarter)[i % 2]
        s, c = sincos(x)
        found = jacobi_from_phase(s, c, scale_levels((kc, 0.0)))
        with mp.workdps(digits_for(kc)):
            u, m = mp.atan2(s, c) / mp.agm(1, kc), 1 - mp.mpf(kc) ** 2
            for name, value_ in zip(("sn", "cn", "dn"), found, strict=True):
                truth = mp.ellipfun(name, u, m=m)
                worst[name] = max(worst[name], float(abs(value_ - truth)) / EPS)
                relative = float(abs(value_ / truth - 1)) / EPS
                worst["relative"] = max(worst["relative"], relative / max(1.0, abs(float(u))))
    assert 1.5 < max(worst["sn"], worst["cn"], worst["dn"]) <= 5.0
    assert 3.0 < worst["relative"] <= 12.0


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
