"""Exact torque-free motion against mpmath, and the laws it obeys."""

import ast
import math
import os
import subprocess
import sys

import numpy as np
import pytest
from numba import config, njit

from rbfmu.arrays.bodies import free_rotation as free_rotation_array
from rbfmu_kernels import compose_quaternions, free_rotation as body_at
from rbfmu_kernels.exact.free_rotation import free_rotation_at, free_rotation_is_singular, free_rotation_setup
from tests.support.covering import some_of
from tests.support.paths import ROOT
from tests.support.references.free_rotation_mp import (
    CLASSES,
    angle_to,
    closed_form,
    mp,
    random_case,
    relative_distance,
    taylor,
)

EPS = 2.0**-52
I_123, Q, OMEGA = (1.0, 2.0, 3.0), (0.5, 0.5, 0.5, 0.5), (0.3, 1.0, 0.2)
compiled_only = pytest.mark.skipif(config.DISABLE_JIT, reason="speed, or a million steps")
KERNELS = ROOT / "kernels"


def errors(case, truth=closed_form):
    """Angle of the attitude's error and relative error of omega, in eps. A wrong sign of q counts as 2 pi."""
    q, omega = body_at(*case)
    q_true, omega_true = truth(*case)
    return angle_to(q, q_true) / EPS, relative_distance(omega, omega_true) / EPS


def check_class(kind, n, seed):
    """Medians of 300 were 0.5 to 1.4 eps (omega 0.3), maxima up to 4.3 (omega 3)."""
    rng = np.random.default_rng([seed, CLASSES.index(kind)])
    angles, rates = np.transpose([errors(random_case(kind, rng)) for _ in range(n)])
    assert np.median(angles) <= 1.8
    assert np.max(angles) <= 5.0
    assert np.max(rates) <= 4.0


@pytest.mark.thorough
@pytest.mark.parametrize("kind", some_of([*CLASSES], 4))
def test_random_bodies_are_exact_to_rounding(kind):
    check_class(kind, 16, seed=1)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [11, 12])
@pytest.mark.parametrize("kind", CLASSES)
def test_300_held_out_bodies_are_exact_to_rounding(kind, seed):
    check_class(kind, 300, seed)


@pytest.mark.parametrize("seed", range(4))
def test_the_two_truths_agree(seed):
    case = random_case("generic", np.random.default_rng([seed, 99]))
    case = (*case[:3], case[3] / 10.0)
    for a, b in zip(closed_form(*case), taylor(*case), strict=True):
        assert max(abs(x - y) for x, y in zip(a, b, strict=True)) < mp.mpf(10) ** -40


@pytest.mark.thorough
def test_slender_bodies_beside_the_separatrix():
    """Boxes whose sides are up to 1e5 apart: the slow and the fast axis' rates are both right."""
    rng = np.random.default_rng(5)
    for _ in range(24):
        sides = np.sort(10.0 ** rng.uniform(-5.0, 0.0, 3)) ** 2
        low, middle, high = sides[0] + sides[1], sides[0] + sides[2], sides[1] + sides[2]
        x = float(rng.normal())
        z = x * math.sqrt(low * (middle - low) / (high * (high - middle))) * (1.0 + 10.0 ** rng.uniform(-8.0, 0.0))
        y = math.hypot(x, z) * 10.0 ** rng.uniform(-1.0, 2.0)
        t = 10.0 ** rng.uniform(0.0, 5.0) / math.hypot(x, y, z)
        assert max(errors(((low, middle, high), Q, (x, y, z), t))) <= 5.0


# 6 (6 - 4) 1^2 = 3 (4 - 3) 2^2: these bodies are on the separatrix, with no rounding.
ON_SEPARATRIX = [
    ((3.0, 4.0, 6.0), Q, (2.0, 0.7, 1.0), 30.0), ((3.0, 4.0, 6.0), Q, (2.0, -0.7, -1.0), -20.0),
    ((6.0, 4.0, 3.0), Q, (1.0, -0.7, -2.0), 12.0), ((4.0, 3.0, 6.0), Q, (1.0, 2e-5, 1e-5), 40.0),
]  # fmt: skip


@pytest.mark.parametrize("case", some_of([*ON_SEPARATRIX], 2))
def test_on_the_separatrix_itself(case):
    assert max(errors(case, taylor)) <= 3.0


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_on_the_separatrix_a_body_comes_to_rest_at_the_middle_axis(sign):
    _, omega = body_at((3.0, 4.0, 6.0), Q, (2.0, 0.7, 1.0), sign * 1e9)
    g_over_i = math.hypot(6.0, 2.8, 6.0) / 4.0
    assert omega[1] == pytest.approx(sign * g_over_i, rel=4.0 * EPS)
    assert 0.0 < abs(omega[0]) < 1e-200


@pytest.mark.parametrize("seed", range(4))
def test_within_a_rounding_of_the_separatrix_thousands_of_flips_later(seed):
    """The distance from the separatrix is the sum of products that agree in 16 digits: taken to 60."""
    rng = np.random.default_rng(seed)
    low, middle, high = np.sort(rng.uniform(0.5, 1.0, 3)).tolist()
    x = float(rng.normal())
    exact = [mp.mpf(v) for v in (low, middle, high)]
    z = float(x * mp.sqrt(exact[0] * (exact[1] - exact[0]) / (exact[2] * (exact[2] - exact[1]))))
    assert max(errors(((low, middle, high), Q, (x, 1.0, z), 1e6))) <= 5.0


def test_modulus_below_double_counts_over_many_turns():
    """2026-11-21: kc = 1 - 1.7e-17 was taken for 1, which in 430 rad of polhode and precession cost 17 eps."""
    moments = (0.10275292341150757, 0.10275292341140566, 0.6804328061430918)
    omega = (-0.07637359374105758, 0.00966524504199646, -2.1168366759412764)
    assert max(errors((moments, Q, omega, 1e4))) <= 5.0


def test_the_worst_attitude_that_hill_climbing_found():
    moments = (19.369439909422496, 22.847430185392536, 13.578866073086271)
    q = (0.29167642368145885, -0.03568217881790747, -0.4411452027673638, -0.5106480417215391)
    omega = (0.020883999302736593, -2.053803515011934e-19, -2.266815033150636e-15)
    assert 5.0 < max(max(errors((moments, q, omega, t))) for t in (453.2640523923582, 283638457693.2572)) <= 6.0


def test_a_difference_in_double_double_that_loses_8_digits_shows_after_1e13_turns():
    """6e-9 from the separatrix, the most at which terms are not added exactly; 1e-2 from it there is nothing to see."""
    moments = (3.417827024813804, 1.1060552866017404, 3.7781901925119104)
    omega = (0.9294044789833651, -1.0775526724658817)
    for z, bound in ((-1.4766830778072884, 5e-26), (-1.46, 5e-29)):
        turned = 8e13
        error = max(errors((moments, Q, (*omega, z), turned / math.hypot(*omega, z))))
        assert error <= 6.0 + bound * turned / EPS
    assert errors((moments, Q, (*omega, -1.4766830778072884), 4e8))[0] <= 6.0


@pytest.mark.parametrize(("t", "bound"), [
    (1e9, 2.0), (-1e12, 2.0), (1e15, 3.0), (1e18, 3e-31 * 1e18 / EPS), (1e22, 3e-31 * 1e22 / EPS),
])  # fmt: skip
def test_error_grows_with_time_by_double_double_only(t, bound):
    assert errors((I_123, Q, OMEGA, t))[0] <= bound


@pytest.mark.parametrize("t", [1e30, 1e200, math.inf, math.nan])
def test_where_no_digit_is_left_there_is_none(t):
    assert np.isnan(np.concatenate(body_at(I_123, Q, OMEGA, t))).all()


@pytest.mark.parametrize("size_i", [1e-300, 1e-150, 1e150, 1e300])
@pytest.mark.parametrize("size_w", [1e-299, 1e-150, 1.0, 1e150])
def test_tiny_and_huge_bodies(size_i, size_w):
    case = (tuple(size_i * i for i in I_123), Q, tuple(size_w * w for w in OMEGA), 20.0 / size_w)
    assert max(errors(case)) <= 3.0


def test_powers_of_two_in_moments_and_time_change_no_bit():
    q, omega = body_at(I_123, Q, OMEGA, 100.0)
    k, w = 2.0**300, 2.0**-200
    moments = tuple(k * i for i in I_123)
    assert body_at(moments, Q, tuple(w * o for o in OMEGA), 100.0 / w) == (q, tuple(w * o for o in omega))


@pytest.mark.thorough
@pytest.mark.parametrize("tiny", some_of([1e-20, 1e-100, 1e-200, 1e-290], 2))
def test_tiny_departures_from_the_middle_axis_turn_the_body_over(tiny):
    case = (I_123, Q, (0.3 * tiny, 1.0, 0.2 * tiny), 1e4)
    assert max(errors(case, lambda *c: closed_form(*c, digits=640))) <= 3.0


@pytest.mark.thorough
@pytest.mark.parametrize("axis", [0, 2])
def test_tiny_wobble_keeps_its_relative_digits(axis):
    omega = [3e-200, 2e-200, 1e-200]
    omega[axis] = 1.0
    truth = closed_form(I_123, Q, omega, 77.0, digits=640)[1]
    found = body_at(I_123, Q, tuple(omega), 77.0)[1]
    assert [float(f / t) for f, t in zip(found, truth, strict=True)] == pytest.approx([1.0] * 3, rel=4.0 * EPS)


@njit(error_model="numpy")
def steps(moments, q, omega, h, n):
    """The state after n steps, and the largest relative change of energy and angular momentum on the way."""
    a, b, c = moments
    energy = a * omega[0] ** 2 + b * omega[1] ** 2 + c * omega[2] ** 2
    momentum = (a * omega[0]) ** 2 + (b * omega[1]) ** 2 + (c * omega[2]) ** 2
    worst = 0.0
    for _ in range(n):
        q, omega = body_at(moments, q, omega, h)
        x, y, z = omega
        worst = max(worst, abs((a * x * x + b * y * y + c * z * z) / energy - 1.0))
        worst = max(worst, 0.5 * abs(((a * x) ** 2 + (b * y) ** 2 + (c * z) ** 2) / momentum - 1.0))
    return q, omega, worst


@pytest.mark.thorough
@compiled_only
@pytest.mark.parametrize(("moments", "omega", "h"), [
    (I_123, OMEGA, 0.1), ((1.0, 1.2, 1.5), (0.3, 0.4, 1.0), 0.1), ((3.0, 2.0, 1.5), (0.3, 0.4, 1.0), 1.0),
    ((1.0, 1.0, 0.3), (0.3, 0.4, 5.0), 0.1), (I_123, (1e-3, 1.0, 1e-3), 0.1),
])  # fmt: skip
def test_1e5_steps_keep_energy_and_angular_momentum(moments, omega, h):
    """Rounding walks at random, some 0.3 eps sqrt(1e5) = 2e-14; a bias of 0.01 eps a step would show as 2e-13."""
    assert steps(moments, Q, omega, h, 100_000)[2] <= 1e-13


@pytest.mark.parametrize("kind", CLASSES)
def test_attitude_is_continuous_and_starts_at_q_0(kind):
    """|dq/dt| = |omega| / 2, across flips, turns of the polhode and of psi; a jump would be 2."""
    moments, q_0, omega_0, _ = random_case(kind, np.random.default_rng([3, CLASSES.index(kind)]))
    setup = free_rotation_setup(moments, q_0, omega_0)
    assert angle_to(free_rotation_at(setup, 0.0)[0], q_0) <= 4.0 * EPS
    times = np.linspace(-100.0, 100.0, 20_001)
    q, omega = free_rotation_array(moments, q_0, omega_0, times)
    change = np.linalg.norm(np.diff(q, axis=0), axis=1)
    assert np.all(change <= 0.5 * 0.01 * np.linalg.norm(omega, axis=1).max() * 1.01)
    assert np.abs(np.linalg.norm(q, axis=1) - 1.0).max() <= 2.0 * EPS


def test_beam_is_the_limit_of_a_thin_rod():
    beam, rod = body_at((0.0, 1.0, 1.0), Q, OMEGA, 5.0), body_at((1e-20, 1.0, 1.0), Q, OMEGA, 5.0)
    np.testing.assert_allclose(np.concatenate(beam), np.concatenate(rod), rtol=0.0, atol=4.0 * EPS)
    assert beam[1][0] == OMEGA[0]
    across = (math.cos(2.5), 0.0, 0.6 * math.sin(2.5), 0.8 * math.sin(2.5))
    q, _ = body_at((0.0, 1.0, 1.0), Q, (0.0, 3.0, 4.0), 1.0)
    assert angle_to(q, compose_quaternions(Q, across)) <= 4.0 * EPS


@pytest.mark.parametrize("tiny", [2e-309, 5e-324])
def test_a_wobble_without_an_inverse_is_none(tiny):
    """Of a symmetric body: 1 / tiny is infinite, and was multiplied by a nome of 0."""
    q, omega = body_at((1.0, 2.0, 1.0), Q, (tiny, 0.44, 0.0), 1.0)
    assert angle_to(q, compose_quaternions(Q, (math.cos(0.22), 0.0, math.sin(0.22), 0.0))) <= 4.0 * EPS
    assert omega[1] == 0.44


@pytest.mark.parametrize("tiny", [1e-165, 1e-300])
def test_a_beam_that_hardly_turns_has_an_attitude(tiny):
    q, omega = body_at((0.0, 1.0, 1.0), Q, (1.0, 0.6 * tiny, 0.8 * tiny), 1.0)
    assert angle_to(q, compose_quaternions(Q, (math.cos(0.5), math.sin(0.5), 0.0, 0.0))) <= 4.0 * EPS
    assert omega[0] == 1.0


def test_a_body_at_rest_stays():
    assert body_at(I_123, Q, (0.0, 0.0, 0.0), 1e9) == (Q, (0.0, 0.0, 0.0))


IMPOSSIBLE = [(-1.0, 2.0, 3.0), (-1.0, 1.0, 1.0), (0.0, 1.0, 2.0), (0.0, 0.0, 1.0), (1.0, 2.0, math.inf)]


@pytest.mark.parametrize("moments", IMPOSSIBLE)
def test_where_there_is_no_motion_there_are_nans_and_a_warning(moments):
    assert free_rotation_is_singular(moments)
    assert np.isnan(np.concatenate(body_at(moments, Q, OMEGA, 1.0))).all()
    for t in (1.0, [1.0, 2.0]):
        with pytest.warns(RuntimeWarning, match="free_rotation"):
            assert np.isnan(free_rotation_array(moments, Q, OMEGA, t)[0]).all()


@pytest.mark.parametrize("bad", [0, 1, 2])
def test_nan_propagates(bad):
    case = [I_123, Q, OMEGA]
    case[bad] = (*case[bad][:-1], math.nan)
    q, omega = body_at(*case, 1.0)
    assert np.isnan(q).all()
    assert np.isnan(omega).all() == (bad != 1)


def test_kernels_call_nothing_of_libm_but_square_roots_and_signs():
    own = ("exact/free_rotation", "exact/free_rotation_setup", "exact/free_rotation_series")
    for name in (*own, "numerics/elliptic", "numerics/double_double", "numerics/elementary"):
        tree = ast.parse((KERNELS / "rbfmu_kernels" / f"{name}.py").read_text())
        used = {n.attr for n in ast.walk(tree) if isinstance(n, ast.Attribute) and getattr(n.value, "id", "") == "math"}
        assert used <= {"sqrt", "copysign", "nan", "inf"}, name


@pytest.mark.thorough
@compiled_only
def test_plain_python_gives_the_same_bits():
    """No fused operations, no libm: what is true on this machine with and without LLVM is true on others."""
    script = f"""
from rbfmu_kernels import free_rotation
for case in {[*ON_SEPARATRIX, *SAME_BITS]!r}:
    print(*(x.hex() for part in free_rotation(*case) for x in part))
"""
    environment = os.environ | {"NUMBA_DISABLE_JIT": "1", "PYTHONPATH": str(KERNELS)}
    found = subprocess.run([sys.executable, "-c", script], env=environment, capture_output=True, text=True, check=True)
    compiled = [body_at(*case) for case in [*ON_SEPARATRIX, *SAME_BITS]]
    assert found.stdout.split() == [x.hex() for parts in compiled for part in parts for x in part]


SAME_BITS = [random_case(kind, np.random.default_rng([7, k])) for k, kind in enumerate(CLASSES)]
