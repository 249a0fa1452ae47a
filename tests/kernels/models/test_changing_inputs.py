"""Inputs that change within a step as polynomials of second degree: against 40 digits, and what a closed loop gains."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rbfmu.runs.plan import Plan
from rbfmu.scene.scene import Scene
from rbfmu.studies.dop853 import Dop853Plan
from rbfmu_kernels.buffer import OK, STEP_REJECTED
from rbfmu_kernels.compile.tiered import interpreted
from rbfmu_kernels.mechanics.equations_of_motion import LoadPolynomial, Loads, polynomial_after
from rbfmu_kernels.models.prescribed_rates import PRESCRIBED_RATES
from tests.support.references.driven_motion_mp import true_motion
from tests.support.references.stability_references import prescribed_attitudes
from tests.support.scenes import model_cases
from tests.support.scenes.model_cases import MOVING, OFFSET, TURNED

EPS = 2.0**-52
INPUTS = {
    "force_a": ([0.3, 0.1, -0.4], [0.5, -0.2, 0.1], [0.3, 0.6, -0.2]),
    "force_b": ([1.0, 0.5, 0.2], [-0.3, 0.4, 0.2], [0.1, -0.5, 0.4]),
    "torque_a": ([0.05, 0.0, 0.02], [0.2, 0.1, -0.3], [-0.2, 0.3, 0.1]),
    "torque_b": ([0.1, 0.2, 0.1], [-0.1, 0.3, 0.2], [0.4, -0.1, -0.3]),
}
METHODS = {
    "DOP853": Dop853Plan("body under loads", "DOP853", 13, tolerance=1e-14),
    "DOP853 in equal steps": Dop853Plan("body under loads", "DOP853", 13, substep=0.02),
    "Taylor series": Plan("body under loads, by series", "Taylor", 13, tolerance=1e-15, order=16),
}


class Unit(model_cases.Unit):
    """A unit as planned, and its inputs."""

    def __init__(self, plan, **tables):
        super().__init__(Scene(**tables), plan)

    def drive(self, inputs):
        """Set inputs and their derivatives."""
        for name, (value, rate, rate_2) in inputs.items():
            self[name], self[f"{name}_rate"], self[f"{name}_rate_2"] = value, rate, rate_2
        return self


def driven(plan, body, names):
    initial = {k: MOVING[k] for k in ("omega_b", "attitude")} if body.get("pivot") else MOVING
    tables = {"initial": initial, "loads": {"gravity_a": [0.0, 0.0, -1.0]}, "inputs": {"ports": list(names)}}
    return Unit(plan, body=body, run={"stop": 1.0, "step": 1.0}, **tables)


@pytest.mark.thorough
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("names", [*((name,) for name in INPUTS), tuple(INPUTS)], ids="+".join)
def test_loads_change_within_a_step_as_their_derivatives_say(method, names):
    inputs = {name: INPUTS[name] for name in names}
    unit = driven(METHODS[method], OFFSET, names).drive(inputs)
    assert unit.kernels.step(unit.z, 1.0) == OK
    q, omega, position, velocity = true_motion(OFFSET, MOVING, [(1.0, inputs)])[-1]
    for name, truth in (("quaternion", q), ("omega_b", omega), ("position", position), ("velocity", velocity)):
        np.testing.assert_allclose(unit[name], truth, atol=2e-13, err_msg=name)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("pivot", "names"), [(False, tuple(INPUTS)), (True, ("force_a", "force_b"))])
def test_after_the_step_an_input_holds_its_last_value(method, pivot, names):
    inputs = {name: INPUTS[name] for name in names}
    unit = driven(METHODS[method], OFFSET | {"pivot": pivot}, names).drive(inputs)
    assert unit.kernels.step(unit.z, 0.5) == OK
    for name, (u, u1, u2) in inputs.items():
        np.testing.assert_allclose(unit[name], np.array(u) + 0.5 * np.array(u1) + 0.125 * np.array(u2), rtol=4 * EPS)
        assert not unit[f"{name}_rate"].any()
        assert not unit[f"{name}_rate_2"].any()


@pytest.mark.parametrize(("order", "degree"), [(10, 1), (16, 1), (6, 2), (10, 2), (14, 2)])
def test_a_torque_that_rises_from_zero_turns_a_body_at_rest_as_accurately_as_any(order, degree):
    """Of each three terms two vanish, or of each four three: where the last two do, errors were up to 1e-3."""
    plan = Plan("body under loads, by series", "Taylor", 13, tolerance=1e-9, order=order)
    initial = {name: [0.0, 0.0, 0.0] for name in ("position", "velocity", "omega_b")} | {"attitude": TURNED}
    unit = Unit(plan, body=OFFSET, initial=initial, inputs={"ports": ["torque_b"]})
    parts = [[0.0, 0.0, 0.0] for _ in range(3)]
    parts[degree] = [18.0, -19.2, 14.4]
    assert unit.drive({"torque_b": parts}).kernels.step(unit.z, 1.0) == OK
    q, omega, *_ = true_motion(OFFSET, initial, [(1.0, {"torque_b": parts})])[-1]
    np.testing.assert_allclose(unit["quaternion"], q, atol=1e-8)
    np.testing.assert_allclose(unit["omega_b"], omega, rtol=1e-8)


@pytest.mark.parametrize(("order", "degree"), [(8, 1), (10, 2), (16, 2)])
def test_a_torque_that_rises_from_zero_turns_a_sphere_as_accurately_as_any(order, degree):
    """The attitude was off by up to 4e-4: its formula took derivatives at rest, which vanish, for those of the turn."""
    plan = Plan("body under loads, by series", "Taylor", 13, tolerance=1e-9, order=order)
    sphere = {"mass": 1.0, "inertia": [1.0, 1.0, 1.0]}
    unit = Unit(plan, body=sphere, inputs={"ports": ["torque_b"]})
    unit[f"torque_b_rate{'_2' * (degree - 1)}"] = [0.0, 0.0, 100.0]
    assert unit.kernels.step(unit.z, 1.0) == OK
    half = 50.0 / math.factorial(degree + 2)
    np.testing.assert_allclose(unit["quaternion"], [math.cos(half), 0.0, 0.0, math.sin(half)], atol=1e-8)


@pytest.mark.parametrize("degree", [1, 2])
def test_a_turning_force_that_rises_from_zero_moves_a_body_as_accurately_as_any(degree):
    """Where the force at the beginning alone was counted, the velocity was off by up to 6e-7 of itself."""
    plan = Plan("body under loads, by series", "Taylor", 13, tolerance=1e-9, order=12)
    body = {"mass": 2.0, "inertia": np.eye(3).tolist(), "r_oc_b": [0.0, 0.0, 0.0]}
    initial, parts = MOVING | {"omega_b": [3.0, 1.0, -2.0]}, [[0.0, 0.0, 0.0] for _ in range(3)]
    parts[degree] = [6e5, -6.4e5, 4.8e5]
    loads = {"gravity_a": [0.0, 0.0, -1.0]}
    unit = Unit(plan, body=body, initial=initial, loads=loads, inputs={"ports": ["force_b"]})
    assert unit.drive({"force_b": parts}).kernels.step(unit.z, 1.0) == OK
    velocity = true_motion(body, initial, [(1.0, {"force_b": parts})])[-1][3]
    assert np.linalg.norm(unit["velocity"] - velocity) <= 1e-8 * np.linalg.norm(velocity)


def test_an_input_of_which_the_second_derivative_alone_is_given_changes_also_in_mid_series():
    unit = driven(METHODS["Taylor series"], OFFSET, ("torque_b",)).step(1e-3, 3)
    assert unit["validity"] == 1.0
    unit["torque_b_rate_2"] = [8.0, -6.0, 4.0]
    np.testing.assert_allclose(unit.step(1e-3)["torque_b"], [4e-6, -3e-6, 2e-6], rtol=4 * EPS)
    assert not unit["torque_b_rate_2"].any()


@pytest.mark.parametrize("method", METHODS)
def test_a_refused_step_leaves_inputs_and_derivatives(method):
    unit = driven(METHODS[method], OFFSET, tuple(INPUTS)).drive(INPUTS)
    unit["torque_b_rate"] = [1e300, 1e300, 1e300]
    before = {
        name: unit[name] for name in unit.kernels.BLOCKS if name.startswith(tuple(INPUTS)) or name == "quaternion"
    }
    with np.errstate(all="ignore"):
        assert unit.kernels.step(unit.z, 1e9) == STEP_REJECTED
    for name, value in before.items():
        np.testing.assert_array_equal(unit[name], value, err_msg=name)


@pytest.mark.parametrize("method", METHODS)
def test_a_pivot_takes_the_forces_however_they_change(method):
    body = OFFSET | {"pivot": True}
    pushed, free = (driven(METHODS[method], body, ("force_a", "force_b")) for _ in range(2))
    pushed.drive({name: INPUTS[name] for name in ("force_a", "force_b")})
    for unit in (pushed, free):
        assert unit.kernels.step(unit.z, 1.0) == OK
    for name in ("quaternion", "omega_b", "position", "velocity"):
        np.testing.assert_allclose(pushed[name], free[name], atol=1e-13, err_msg=name)


@pytest.mark.parametrize("name", ["force_a", "torque_a"])
def test_who_is_pushed_in_a_after_a_step_without_load_has_turned_meanwhile(name):
    """Though nobody is shown the attitude: what turns the load into b has to follow it."""
    found = []
    for shown in (["omega_b"], ["omega_b", "quaternion"]):
        tables = {"initial": {"omega_b": [1.0, 2.0, -1.0]}, "outputs": {"quantities": shown}}
        loads = {"gravity_a": [0.0, 0.0, 0.0]}
        unit = Unit(METHODS["Taylor series"], body=OFFSET, loads=loads, inputs={"ports": [name]}, **tables)
        unit.step(1.0)
        unit[name] = [1.0, 0.5, -2.0]
        found.append(unit.step(1.0)["omega_b"])
    np.testing.assert_allclose(found[0], found[1], atol=1e-12)


PRESCRIBED = Plan("prescribed rates", "exact rotation", 4)
RATES = {"omega_b": ([0.8, -0.5, 0.3], [0.7, 1.1, -0.6], [-0.9, 0.4, 1.3])}


def test_prescribed_rates_change_within_a_step_as_their_derivatives_say():
    unit = Unit(PRESCRIBED, inputs={"ports": ["omega_b"]}).drive(RATES)
    assert PRESCRIBED_RATES.step(unit.z, 2.0) == OK
    np.testing.assert_allclose(unit["quaternion"], prescribed_attitudes([(2.0, *RATES["omega_b"])])[0], atol=8 * EPS)
    end = np.array(RATES["omega_b"][0]) + 2.0 * np.array(RATES["omega_b"][1]) + 2.0 * np.array(RATES["omega_b"][2])
    np.testing.assert_allclose(unit["omega_b"], end, rtol=8 * EPS)
    assert not unit["omega_b_rate"].any()


def test_prescribed_rates_that_stop_changing_turn_on_exactly():
    unit = Unit(PRESCRIBED, inputs={"ports": ["omega_b"]}).drive(RATES)
    assert PRESCRIBED_RATES.step(unit.z, 0.5) == OK
    start, omega = Rotation.from_quat(unit["quaternion"], scalar_first=True), unit["omega_b"]
    for _ in range(100):
        assert PRESCRIBED_RATES.step(unit.z, 0.01) == OK
    end = (start * Rotation.from_rotvec(omega)).as_quat(scalar_first=True)
    np.testing.assert_allclose(unit["quaternion"] * np.sign(unit["quaternion"] @ end), end, atol=4 * EPS)


def closed_loop(H, degree, span=4.0):
    """A PD attitude loop about z, its torque passed with derivatives up to a degree: attitude at the end.

    theta'' = -k theta - d theta': inertia 1; the controller computes its torque's derivatives from the plant's states.
    """
    k, d = 4.0, 1.0
    unit = Unit(METHODS["Taylor series"], body={"mass": 1.0, "inertia": [1.0, 1.0, 1.0]},
                initial={"attitude": {"rotvec": [0.0, 0.0, 1.0]}}, loads={"gravity_a": [0.0, 0.0, 0.0]},
                inputs={"ports": ["torque_b"]}, run={"stop": span, "step": H})  # fmt: skip
    for _ in range(round(span / H)):
        q, rate = unit["quaternion"], unit["omega_b"][2]
        angle = 2.0 * math.atan2(q[3], q[0])
        u = -k * angle - d * rate
        first = -k * rate - d * u
        second = -k * u - d * first
        values = [u, first if degree > 0 else 0.0, second if degree > 1 else 0.0]
        unit.drive({"torque_b": tuple([0.0, 0.0, x] for x in values)})
        assert unit.kernels.step(unit.z, H) == OK
    q = unit["quaternion"]
    return 2.0 * math.atan2(q[3], q[0])


@pytest.mark.parametrize("degree", [0, 1, 2])
def test_a_closed_loop_s_order_in_the_communication_step_is_one_above_the_derivatives_passed(degree):
    nu = math.sqrt(4.0 - 0.25)
    truth = math.exp(-2.0) * (math.cos(4.0 * nu) + 0.5 / nu * math.sin(4.0 * nu))
    errors = [abs(closed_loop(H, degree) - truth) for H in (0.02, 0.01)]
    assert math.log2(errors[0] / errors[1]) == pytest.approx(degree + 1.0, abs=0.1)


def test_loads_after_a_time_are_the_values_and_rates_of_their_polynomial():
    value, rate, rate_2 = np.random.default_rng(2).integers(-9, 10, (3, 5, 3)).astype(float)
    given = LoadPolynomial(*(Loads(*map(tuple, rows.tolist())) for rows in (value, rate, rate_2)))
    for t in (0.0, 0.5, 4.0):
        found = interpreted(polynomial_after)(given, t)
        np.testing.assert_array_equal(found.value, value + t * rate + 0.5 * t * t * rate_2)
        np.testing.assert_array_equal(found.rate, rate + t * rate_2)
        np.testing.assert_array_equal(found.rate_2, rate_2)
