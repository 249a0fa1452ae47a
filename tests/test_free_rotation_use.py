"""Exact torque-free motion in use: array function, compiled code, and its cost in plain RK4 steps."""

import math
import time

import numpy as np
import pytest
from free_rotation_mp import angle_to, random_case
from numba import config, njit

import rbfmu
from rbfmu_kernels import free_rotation as body_at
from rbfmu_kernels.free_rotation import FREE_ROTATION_SIZE, free_rotation_at, free_rotation_setup

I_123, Q, OMEGA = (1.0, 2.0, 3.0), (0.5, 0.5, 0.5, 0.5), (0.3, 1.0, 0.2)
compiled_only = pytest.mark.skipif(config.DISABLE_JIT, reason="speed")


@compiled_only
def test_constants_fit_a_flat_buffer_and_serve_in_compiled_code():
    @njit
    def last(setup, n):
        for i in range(n):
            state = free_rotation_at(setup, 0.5 * i)
        return state

    setup = free_rotation_setup(I_123, Q, OMEGA)
    buffer = np.array(setup)
    assert buffer.shape == (FREE_ROTATION_SIZE,)
    assert buffer.dtype == np.float64
    assert last(tuple(buffer.tolist()), 11) == body_at(I_123, Q, OMEGA, 5.0)


def test_array_function_equals_the_kernel_over_bodies_and_times():
    rng = np.random.default_rng(5)
    cases = [random_case("generic", rng) for _ in range(3)]
    moments, q_0, omega_0, _ = (np.array(a) for a in zip(*cases, strict=True))
    times = np.array([[0.0], [1.0], [1e6], [-3.0]])
    q, omega = rbfmu.free_rotation(moments, q_0, omega_0, times)
    assert (q.shape, omega.shape) == ((4, 3, 4), (4, 3, 3))
    one_each = rbfmu.free_rotation(moments, q_0, omega_0, times[2])
    out = (np.empty((4, 3, 4)), np.empty((4, 3, 3)))
    assert rbfmu.free_rotation(moments, q_0, omega_0, times, out=out)[0] is out[0]
    np.testing.assert_array_equal(out[0], q)
    for k, case in enumerate(cases):
        for j, t in enumerate(times[:, 0].tolist()):
            assert body_at(*case[:3], t) == (tuple(q[j, k].tolist()), tuple(omega[j, k].tolist()))
        np.testing.assert_array_equal(one_each[0][k], q[2, k])


@pytest.mark.parametrize(("arguments", "message"), [
    (((1.0, 2.0), Q, OMEGA, 1.0), "moments must have trailing shape"),
    ((I_123, Q, OMEGA, "now"), "t must be "),
    ((I_123, Q, np.ones((3, 3)), np.ones(4)), "do not broadcast"),
])  # fmt: skip
def test_array_function_names_the_wrong_argument(arguments, message):
    with pytest.raises(ValueError, match=f"free_rotation: .*{message}"):
        rbfmu.free_rotation(*arguments)
    with pytest.raises(TypeError, match="takes 4 arguments"):
        rbfmu.free_rotation(I_123, Q)


@compiled_only
def test_array_function_of_many_times_sets_up_once():
    """Times of one body cost an evaluation each; so many bodies cost four times that."""
    times = np.linspace(0.0, 10.0, 2000)
    bodies = np.broadcast_to(OMEGA, (2000, 3)).copy()
    rbfmu.free_rotation(I_123, Q, OMEGA, times), rbfmu.free_rotation(I_123, Q, bodies, 1.0)
    once, each = [], []
    for _ in range(40):
        once.append(seconds(lambda: rbfmu.free_rotation(I_123, Q, OMEGA, times)))
        each.append(seconds(lambda: rbfmu.free_rotation(I_123, Q, bodies, 1.0)))
    assert min(once) < 0.5 * min(each)


def seconds(call):
    start = time.perf_counter()
    call()
    return time.perf_counter() - start


@njit(error_model="numpy")
def rk4_steps(moments, q, omega, h, n):
    """Plain RK4 on Euler parameters and Euler's equations: the unit of cost."""
    k = ((moments[1] - moments[2]) / moments[0], (moments[2] - moments[0]) / moments[1],
         (moments[0] - moments[1]) / moments[2])  # fmt: skip
    y = (q[0], q[1], q[2], q[3], omega[0], omega[1], omega[2])
    for _ in range(n):
        a = _rhs(k, y)
        b = _rhs(k, _plus(y, 0.5 * h, a))
        c = _rhs(k, _plus(y, 0.5 * h, b))
        d = _rhs(k, _plus(y, h, c))
        y = _plus(_plus(_plus(_plus(y, h / 6.0, a), h / 3.0, b), h / 3.0, c), h / 6.0, d)
    return y


@njit(error_model="numpy", inline="always")
def _rhs(k, y):
    e, x, y_, z, a, b, c = y
    return (
        -0.5 * (x * a + y_ * b + z * c), 0.5 * (e * a + y_ * c - z * b), 0.5 * (e * b - x * c + z * a),
        0.5 * (e * c + x * b - y_ * a), k[0] * b * c, k[1] * c * a, k[2] * a * b,
    )  # fmt: skip


@njit(error_model="numpy", inline="always")
def _plus(y, h, d):
    return (
        y[0] + h * d[0], y[1] + h * d[1], y[2] + h * d[2], y[3] + h * d[3],
        y[4] + h * d[4], y[5] + h * d[5], y[6] + h * d[6],
    )  # fmt: skip


@njit(error_model="numpy")
def evaluations(setup, h, n):
    total = 0.0
    for i in range(n):
        q, omega = free_rotation_at(setup, h * i)
        total += q[0] + omega[0]
    return total


@njit(error_model="numpy")
def exact_steps(moments, q, omega, h, n):
    for _ in range(n):
        q, omega = body_at(moments, q, omega, h)
    return q, omega


@compiled_only
@pytest.mark.parametrize("omega", [OMEGA, (1e-9, 1.0, 1e-9)], ids=["generic", "near the middle axis"])
def test_an_evaluation_costs_at_most_5_rk4_steps_and_60_with_its_setup(omega):
    """Measured 3.3 and 33, near the middle axis 3.3 and 39. The least of many short, interleaved runs."""
    setup = free_rotation_setup(I_123, Q, omega)
    n = 300
    runs = {
        "rk4": lambda: rk4_steps(I_123, Q, omega, 1e-3, n),
        "at": lambda: evaluations(setup, 0.1, n),
        "step": lambda: exact_steps(I_123, Q, omega, 0.1, n),
    }
    for run in runs.values():
        run()
    least = dict.fromkeys(runs, math.inf)
    for _ in range(300):
        for name, run in runs.items():
            least[name] = min(least[name], seconds(run))
    assert least["at"] <= 5.0 * least["rk4"]
    assert least["step"] <= 60.0 * least["rk4"]


def test_rk4_of_the_cost_unit_is_right():
    y = rk4_steps(I_123, Q, OMEGA, 1e-3, 1000)
    assert angle_to(y[:4], body_at(I_123, Q, OMEGA, 1.0)[0]) < 1e-12
