"""Taylor series and the two-point formula: orders, remainders, tolerance, limits of stability, steps that fit."""

import math

import numpy as np
import pytest

from rbfmu.runs.motion import attitude_error
from rbfmu.runs.plan import Plan, filled_buffer, initialize
from rbfmu.scene.scene import Scene
from rbfmu.studies.chart.cases import CASES
from rbfmu_kernels.buffer import OK
from rbfmu_kernels.integrators.substeps import Method, Room
from rbfmu_kernels.integrators.taylor import derivatives_of_attitude, taylor_advance
from rbfmu_kernels.integrators.taylor_coefficients import MAX_ORDER, WORK
from rbfmu_kernels.mechanics.equations_of_motion import ROTATION, STATE_SIZE, constant_loads
from rbfmu_kernels.models.loaded import LOADED_TAYLOR
from tests.support.references import reference_mp as reference
from tests.support.scenes.model_cases import ALL_LOADS

EPS = 2.0**-52
SIZE = STATE_SIZE + WORK
ROOM = Room(state=0, work=STATE_SIZE, size=SIZE)


def open_loop(order):
    """Steps of the size that is kept."""
    return Method(ROTATION, order, math.inf, 0.0)


def buffer_of(case, h):
    """A state and work space; steps of h."""
    r, v, q, omega = case.start
    z = np.zeros(SIZE + 2)
    z[0:4], z[4:7], z[8:11], z[11:14], z[SIZE] = q, omega, r, v, h
    return z


def unit_of(scene, order, tolerance):
    planned = Plan("body under loads, by series", "Taylor", 13, tolerance=tolerance, order=order)
    z = filled_buffer(scene, planned)
    initialize(scene, LOADED_TAYLOR, z)
    return z


def block(z, name):
    return z[LOADED_TAYLOR.BLOCKS[name]]


@pytest.mark.thorough
@pytest.mark.parametrize(("order", "steps"), [(4, 800), (6, 300), (8, 80), (10, 64)])
def test_rates_converge_at_the_series_order_and_attitude_at_the_two_point_formula_s(order, steps):
    """2 m of m derivatives, whose error is some 1e-3 of the series' until far below what is asked for.

    Smaller steps, which are nearer to the law, drown in round-off: beside rates of order 10 the attitude shows 7.87.
    """
    case, span = CASES["d"], 16.0
    (truth,) = reference.motion(case.scene, (span,))
    errors = []
    for n in (steps, steps * 3 // 2):
        z = buffer_of(case, span / n)
        assert taylor_advance(z, ROOM, open_loop(order), span, case.body, constant_loads(case.loads)) == OK
        errors.append([reference.distance(z[4:7], truth.omega_b), reference.angle_to(z[0:4], truth.R_ab)])
    rates, attitude = np.log(np.divide(*errors)) / math.log(1.5)
    assert np.min(errors) > 100 * EPS
    assert rates == pytest.approx(order, abs=0.1)
    assert attitude == pytest.approx(min(order, 2 * derivatives_of_attitude(order)), abs=0.16)


def test_position_and_velocity_converge_at_the_two_point_formula_s_order():
    """A force that turns with a body of constant rate: 2 m of m derivatives."""
    scene = Scene(body={"mass": 1.0, "inertia": [1.0, 1.0, 1.0]}, initial={"omega_b": [0.6, 0.8, 0.0]},
                  loads={"force_b": [1.0, 0.5, -0.3], "gravity_a": [0.0, 0.0, 0.0]}, run={"stop": 4.0})  # fmt: skip
    (truth,) = reference.motion(scene, (4.0,))
    for order, steps in ((4, 8), (8, 4), (12, 2)):
        m, errors = derivatives_of_attitude(order), []
        for n in (steps, 2 * steps):
            z = unit_of(scene, order, math.inf)
            block(z, "step_size")[:] = 4.0 / n
            assert LOADED_TAYLOR.step(z, 4.0) == OK
            errors.append(
                [reference.distance(block(z, "position"), truth.position),
                 reference.distance(block(z, "velocity"), truth.velocity),
                 reference.angle_to(block(z, "quaternion"), truth.R_ab)]
            )  # fmt: skip
        assert np.log2(np.divide(*errors)) == pytest.approx([2.0 * m] * 3, abs=0.15)


@pytest.mark.parametrize("m", [2, 3, 5])
def test_a_steady_spin_s_error_is_the_two_point_formula_s_remainder(m):
    """An angle too small by 2 (m! / (2m)!)^2 / (2m + 1) (h omega / 2)^(2m+1) a step: Pade's approximation of exp."""
    order = next(n for n in range(4, MAX_ORDER) if derivatives_of_attitude(n) == m)
    case, turn = CASES["d"], 0.4 if m > 3 else 0.1
    z = buffer_of(case, 1.0)
    z[4:7] = 0.0, 0.0, turn
    loads = constant_loads(case.loads._replace(torque_b=(0.0, 0.0, 0.0)))
    assert taylor_advance(z, ROOM, open_loop(order), 1.0, case.body, loads) == OK
    ratio = math.factorial(m) / math.factorial(2 * m)
    error = 2.0 * ratio**2 / (2 * m + 1) * (0.5 * turn) ** (2 * m + 1)
    assert turn - 2.0 * math.atan2(z[3], z[0]) == pytest.approx(error, rel=0.05, abs=2 * EPS)


@pytest.mark.parametrize("order", [6, 8, 12, 16, 20, 24])
@pytest.mark.parametrize("tolerance", [1e-4, 1e-8, 1e-12])
def test_errors_stay_below_the_sum_of_tolerances(order, tolerance):
    """On a motion that does not magnify them."""
    scene = Scene(**ALL_LOADS, run={"stop": 5.0, "step": 0.5})
    z = unit_of(scene, order, tolerance)
    for _ in range(10):
        assert LOADED_TAYLOR.step(z, 0.5) == OK
    steps = float(block(z, "substeps")[0])
    errors = reference.errors(reference.motion(scene, (5.0,)), *([block(z, name)] for name in
                              ("quaternion", "omega_b", "position", "velocity")))  # fmt: skip
    assert max(errors.values()) <= steps * tolerance + 40 * EPS


@pytest.mark.parametrize("order", [8, 12, 16, 20])
@pytest.mark.parametrize("tolerance", [1e-6, 1e-8, 1e-10])
def test_loads_that_their_series_carry_on_stay_true(order, tolerance):
    """A fast top's weight turns in b much more than it changes the rate: its own last terms bound the step."""
    case = CASES["c'"]
    for steps in (1, 5):
        z = unit_of(case.scene, order, tolerance)
        for _ in range(steps):
            assert LOADED_TAYLOR.step(z, case.span / steps) == OK
        error = attitude_error(block(z, "quaternion"), case.truth["quaternion"][-1])
        assert error <= 0.3 * tolerance * float(block(z, "substeps")[0])


def test_the_first_step_is_as_long_as_the_series_allow():
    """Not as a rule of thumb has it: few substeps for one second of slow motion, many of a fast one."""
    counts = []
    for rate in (0.1, 1.0, 100.0):
        scene = Scene(body={"mass": 1.0, "inertia": [1.0, 2.0, 3.0]}, initial={"omega_b": [rate, rate, 0.5 * rate]},
                      loads={"torque_b": [0.01, 0.0, 0.0]}, run={"stop": 1.0})  # fmt: skip
        z = unit_of(scene, 12, 1e-9)
        assert LOADED_TAYLOR.step(z, 1.0) == OK
        counts.append(float(block(z, "substeps")[0]))
    assert counts[0] == 1.0
    assert counts[1] <= 4.0
    assert 100.0 < counts[2] < 400.0


@pytest.mark.parametrize("order", [8, 12, 16])
def test_damping_is_stable_to_the_series_own_limit(order):
    """h d / I up to where |sum of x^k / k!| = 1: 4.314, 5.823, 7.324 for orders 8, 12, 16."""
    limit = {8: 4.314, 12: 5.823, 16: 7.324}[order]
    for share, grows in ((0.999, False), (1.001, True)):
        scene = Scene(body={"mass": 1.0, "inertia": [1.0, 1.0, 1.0]}, initial={"omega_b": [0.0, 0.0, 1e-3]},
                      loads={"damping_b": [1.0, 1.0, 1.0]}, run={"stop": 1.0})  # fmt: skip
        z = unit_of(scene, order, math.inf)
        h = share * limit
        block(z, "step_size")[:] = h
        assert LOADED_TAYLOR.step(z, h) == OK
        assert (abs(block(z, "omega_b")[2]) > 1e-3) == grows


def test_a_body_at_rest_without_loads_takes_one_series():
    scene = Scene(body={"mass": 1.0, "inertia": [1.0, 2.0, 3.0]}, loads={"gravity_a": [0.0, 0.0, 0.0]})
    z = unit_of(scene, 12, 1e-12)
    for h in (1e-3, 1.0, 1e6):
        assert LOADED_TAYLOR.step(z, h) == OK
    assert float(block(z, "substeps")[0]) == 1.0
    np.testing.assert_array_equal(block(z, "quaternion"), [1.0, 0.0, 0.0, 0.0])
