"""Exact torque-free motion in use: array function, compiled code, and the unit of its cost."""

import numpy as np
import pytest
from numba import config, njit

import rbfmu
from rbfmu_kernels import free_rotation as body_at
from rbfmu_kernels.exact.free_rotation import FREE_ROTATION_SIZE, free_rotation_at, free_rotation_setup
from tests.support.fmu.fmus import bench
from tests.support.references.free_rotation_mp import angle_to, random_case

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


def test_rk4_of_the_cost_unit_is_right():
    y = bench("free_rotation").rk4_steps(I_123, Q, OMEGA, 1e-3, 1000)
    assert angle_to(y[:4], body_at(I_123, Q, OMEGA, 1.0)[0]) < 1e-12
