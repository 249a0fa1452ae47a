"""Scenes whose exact model is smaller than it looks: thrust along the spin, spheres, angular momentum alone."""

from fractions import Fraction

import mpmath as mp
import numpy as np
import pytest
from numba import config

import rbfmu
from rbfmu.planning.select import plan
from rbfmu.runs.plan import Plan, filled_buffer, initialize
from rbfmu.scene.scene import Scene
from rbfmu_kernels.buffer import OK, STEP_REJECTED
from rbfmu_kernels.models.free import _POINTS, _WEIGHTS, ORDERS
from tests.library.planning.test_smallest_model import error_of
from tests.support.covering import some_of
from tests.support.references import reference_mp as reference

EPS = 2.0**-52
NO_GRAVITY = {"gravity_a": [0.0, 0.0, 0.0]}
TRIAXIAL, BALL = {"mass": 2.0, "inertia": [1.0, 2.0, 2.5]}, {"mass": 3.0, "inertia": [0.4, 0.4, 0.4]}
TURNED = {"rotvec": [0.3, -0.8, 0.5]}
STATE = ["quaternion", "omega_b", "position", "velocity"]
compiled = pytest.mark.skipif(bool(config.DISABLE_JIT), reason="too many steps to interpret")


def made(body, omega_b=(0.0, 0.0, 0.0), loads=None, quantities=STATE, accuracy=1e-12, **inputs):
    velocity = {} if body.get("pivot") else {"velocity": [0.3, 0.1, -0.2]}
    initial = {"omega_b": list(omega_b), "attitude": TURNED} | velocity
    run = {"stop": 10.0, "step": 0.1, "accuracy": accuracy}
    asked = {"outputs": {"quantities": list(quantities)}, "inputs": inputs, "run": run}
    return Scene.from_dict({"body": body, "initial": initial, "loads": NO_GRAVITY | (loads or {})} | asked)


def reasons(found):
    return " ".join(found.reasons)


# Thrust along the axis of spin

SPIN, THRUST = [0.0, 0.0, 2.0], {"force_b": [0.0, 0.0, 5.0]}
ON_AXIS = TRIAXIAL | {"r_oc_b": [0.0, 0.0, -0.7]}
AXIAL = {
    "thrust": ("constant rate", made(TRIAXIAL, SPIN, THRUST)),
    "thrust on the axis": ("constant rate", made(ON_AXIS, SPIN, THRUST)),
    "against the spin, falling": ("constant rate", made(ON_AXIS, [0.0, 0.0, -2.0], THRUST | {"gravity_a": [0, 1, -2]})),
    "about the middle axis": ("constant rate", made(TRIAXIAL, [0.0, 3.0, 0.0], {"force_b": [0.0, -1.0, 0.0]})),
    "spun up": ("one axis", made(ON_AXIS, SPIN, THRUST | {"torque_b": [0.0, 0.0, 0.3], "damping_b": [0.0, 0.0, 0.1]})),
    "at rest": ("no rotation", made(ON_AXIS, [0.0] * 3, THRUST)),
    "a ball's": ("constant rate", made(BALL, [0.3, -0.6, 0.7], {"force_b": [0.9, -1.8, 2.1]})),
}


@pytest.mark.parametrize("name", AXIAL)
def test_thrust_along_the_axis_of_spin_turns_nothing(name):
    model, scene = AXIAL[name]
    found = plan(scene)
    assert (found.model, found.pinned) == (model, ())
    assert error_of(scene, found) <= 50 * EPS
    assert "constant acceleration" in reasons(found)
    assert "turns with the body" not in reasons(found)


def test_a_plan_says_by_how_much_forces_accelerate_the_body():
    assert "constant acceleration 2.5 m/s2" in reasons(plan(made(TRIAXIAL, SPIN, THRUST)))
    held = {"force_a": [0.0, 0.0, 6.0], "gravity_a": [0.0, 0.0, -4.0]}
    assert "constant acceleration 1 m/s2" in reasons(plan(made(TRIAXIAL, SPIN, held)))


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("body", "spin", "force_b"),
    [(TRIAXIAL, SPIN, [1e-9, 0.0, 5.0]), (TRIAXIAL | {"r_oc_b": [1e-9, 0.0, 0.0]}, SPIN, [0.0, 0.0, 5.0]),
     (TRIAXIAL, [1e-9, 0.0, 2.0], [0.0, 0.0, 5.0])],
    ids=["aslant", "off the centre", "coning"],
)  # fmt: skip
def test_thrust_hardly_off_the_axis_turns_the_path(body, spin, force_b):
    scene = made(body, spin, {"force_b": force_b})
    found = plan(scene)
    assert found.model not in ("no rotation", "constant rate", "one axis")
    assert "turns with the body" in reasons(found)
    assert error_of(scene, found) <= scene.run.accuracy


@pytest.mark.parametrize(("varies", "turns"), [
    ({"parameters": ["force_b"]}, True), ({"ports": ["force_b"]}, True), ({"parameters": ["r_oc_b"]}, True),
    ({"parameters": ["mass", "gravity_a", "position_0", "velocity_0"]}, False), ({"ports": ["force_a"]}, False),
])  # fmt: skip
def test_thrust_that_may_leave_the_axis_gets_a_larger_model_and_what_bends_no_path_may_vary(varies, turns):
    found = plan(made(TRIAXIAL, SPIN, THRUST, accuracy=1e-6, **varies))
    assert (found.model, found.pinned) == ("constant rate", ()) or turns
    assert found.model not in ("constant rate", "one axis") or not turns


# A sphere: every axis is principal

ALONG = np.array([0.1, -0.2, 0.3])
TURNED_ALONG = rbfmu.rotate(rbfmu.quaternion_from_rotvec(np.array(TURNED["rotvec"])), ALONG)
DAMPED = {"damping_b": [0.2, 0.2, 0.2]}
THRUSTING = "thrust along"
OBLIQUE = {
    "fixed in b, from rest": ([0.0] * 3, {"torque_b": ALONG}),
    "fixed in a, from rest": ([0.0] * 3, {"torque_a": TURNED_ALONG}),
    "fixed in b, along the rate": (-7.0 * ALONG, {"torque_b": ALONG}),
    "fixed in a, along the rate": (7.0 * ALONG, {"torque_a": TURNED_ALONG}),
    "both, damped": (3.0 * ALONG, {"torque_a": 0.7 * TURNED_ALONG, "torque_b": ALONG} | DAMPED),
    "damped": ([0.3, -1.2, 0.7], DAMPED),
    THRUSTING: (3.0 * ALONG, {"torque_b": ALONG, "force_b": -0.3 * ALONG}),
}


def as_lists(loads):
    return {name: list(map(float, value)) for name, value in loads.items()}


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("name", "arm"),
    [(name, arm) for name in OBLIQUE for arm in ([0.0] * 3, [0.2, 0.1, -0.3]) if name != THRUSTING or not any(arm)],
)
def test_a_sphere_turns_about_one_axis_however_oblique(name, arm):
    omega_b, loads = OBLIQUE[name]
    scene = made(BALL | {"r_oc_b": arm}, map(float, omega_b), as_lists(loads), accuracy=1e-12)
    found = plan(scene)
    assert (found.model, found.pinned) == ("one axis", ())
    assert error_of(scene, found) <= found.error + 50 * EPS


@pytest.mark.thorough
@pytest.mark.parametrize(("omega_b", "loads"), [
    (2.0 * ALONG + [1e-9, 0.0, 0.0], {"torque_b": ALONG}),
    (2.0 * ALONG, {"damping_b": [0.2, 0.2, 0.2 + 1e-9]}),
    ([0.0] * 3, {"torque_b": ALONG, "torque_a": ALONG}),
], ids=["rate beside the torque", "uneven damping", "two torques"])  # fmt: skip
def test_a_sphere_driven_beside_its_rate_turns_about_more(omega_b, loads):
    scene = made(BALL, map(float, omega_b), as_lists(loads))
    found = plan(scene)
    assert found.model not in ("no rotation", "constant rate", "one axis")
    assert error_of(scene, found) <= scene.run.accuracy


def test_reasons_name_only_the_loads_that_act():
    for loads, said, unsaid in (
        ({"torque_b": ALONG}, "under torque_b", "damping"),
        (DAMPED, "under damping_b", "torque"),
        ({"torque_b": ALONG} | DAMPED, "under damping_b and torque_b", "torque_a"),
    ):
        words = reasons(plan(made(BALL, map(float, 2.0 * ALONG), as_lists(loads))))
        assert said in words
        assert unsaid not in words


# Angular momentum alone

SPIN_ANY, TORQUE = [0.4, -0.5, 0.6], {"torque_a": [0.1, -0.3, 0.2]}


def momentum_errors(scene, result):
    """Of angular_momentum_a and omega_a in 40 digits, relative to the largest."""
    points = reference.motion(scene, result.time.tolist())
    M = [[mp.mpf(x) for x in row] for row in scene.body.M]
    with mp.workdps(reference.DIGITS):
        h = [reference.matvec(p.R_ab, reference.matvec(M, p.omega_b)) for p in points]
        w = [reference.matvec(p.R_ab, p.omega_b) for p in points]
    truth = {"angular_momentum_a": h, "omega_a": w}
    return {
        name: max(map(reference.distance, values, truth[name])) / reference.largest_size(truth[name], 0.0)
        for name, values in result.quantities.items()
        if name in truth
    }


@pytest.mark.thorough
@pytest.mark.parametrize(("body", "quantities"), [
    (TRIAXIAL, ["angular_momentum_a"]),
    (TRIAXIAL | {"r_oc_b": [0.1, 0.2, 0.3]}, ["angular_momentum_a"]),
    (TRIAXIAL | {"r_oc_b": [0.1, 0.2, 0.3], "pivot": True}, ["angular_momentum_a"]),
    (TRIAXIAL, ["angular_momentum_a", "position", "velocity", "acceleration"]),
    (BALL, ["omega_a"]),
    (BALL, ["omega_a", "angular_momentum_a", "kinetic_energy", "position"]),
])  # fmt: skip
def test_angular_momentum_is_linear_in_time_under_a_torque_fixed_in_space(body, quantities):
    scene = made(body, SPIN_ANY, TORQUE, quantities)
    found = plan(scene)
    assert (found.model, found.pinned) == ("angular momentum", ())
    result = rbfmu.simulate(scene)
    assert max(momentum_errors(scene, result).values()) <= 8 * EPS
    if "kinetic_energy" in quantities:
        energy = 0.5 * 0.4 * np.sum(result.omega_a**2, axis=1) + 0.5 * 3.0 * 0.14
        np.testing.assert_allclose(result.kinetic_energy, energy, rtol=8 * EPS)
    if "position" in quantities:
        path = result.time[:, None] * [0.3, 0.1, -0.2]
        np.testing.assert_allclose(result.position, path, rtol=0.0, atol=8 * EPS * 4.0)


OFF_CENTRE, LISTED = {"r_oc_b": [0.1, 0.0, 0.0]}, ["omega_b_0", "quaternion_0", "inertia", "mass", "torque_a"]


@pytest.mark.parametrize(("body", "quantities", "loads", "varies", "alone"), [
    (TRIAXIAL, ["angular_momentum_a", "omega_a"], {}, [], False),
    (TRIAXIAL, ["kinetic_energy"], {}, [], False),
    *((BALL, ["omega_a", other], {}, [], False) for other in ("omega_b", "alpha_b", "rpy")),
    (BALL | OFF_CENTRE, ["omega_a", "position"], {}, [], False),
    (TRIAXIAL, ["angular_momentum_a"], {"torque_b": [0.0, 0.0, 0.1]}, [], False),
    (TRIAXIAL, ["angular_momentum_a"], {"damping_b": [0.0, 0.0, 0.1]}, [], False),
    (TRIAXIAL | OFF_CENTRE, ["angular_momentum_a"], {"force_a": [0.0, 0.0, 0.1]}, [], False),
    (TRIAXIAL, ["angular_momentum_a", "position"], {"force_b": [0.0, 0.0, 0.1]}, [], False),
    (TRIAXIAL, ["angular_momentum_a"], {}, LISTED, True),
    (TRIAXIAL, ["angular_momentum_a"], {}, ["torque_b"], False),
    (TRIAXIAL, ["angular_momentum_a"], {}, ["damping_b"], False),
    (TRIAXIAL, ["angular_momentum_a", "position"], {}, ["r_oc_b"], False),
    (BALL, ["omega_a"], {}, ["omega_b_0", "torque_a"], True),
    (BALL, ["omega_a"], {}, ["inertia"], False),
])  # fmt: skip
def test_the_angular_momentum_is_left_alone_where_nothing_needs_the_attitude(body, quantities, loads, varies, alone):
    scene = made(body, SPIN_ANY, TORQUE | loads, quantities, accuracy=1e-6, parameters=varies)
    assert (plan(scene).model == "angular momentum") == alone


def test_angular_momentum_follows_a_port():
    scene = made(TRIAXIAL, SPIN_ANY, TORQUE, ["angular_momentum_a"], ports=["torque_a"])
    found = plan(scene)
    assert found.model == "angular momentum"
    unit, z, random = found.kernels, filled_buffer(scene, found), np.random.default_rng(3)
    initialize(scene, unit, z)
    block = unit.BLOCKS["angular_momentum_a"]
    h = z[block].copy()
    for _ in range(200):
        z[unit.BLOCKS["torque_a"]] = torque = random.normal(size=3) * random.integers(2)
        assert unit.step(z, 0.125) == OK
        h += 0.125 * (torque + TORQUE["torque_a"])
    np.testing.assert_allclose(z[block], h, rtol=0.0, atol=200 * EPS * 5.0)
    before = z.copy()
    z[unit.BLOCKS["torque_b"]] = [0.0, 0.0, 1.0]
    assert unit.step(z, 0.125) == STEP_REJECTED
    np.testing.assert_array_equal(z[block], before[block])


# A torque-free body that is pushed: exact rotation, and a quadrature for the path

PUSH, SPUN = {"force_b": [0.3, -0.2, 0.5], "gravity_a": [0.0, 0.1, -1.0]}, [0.5, 0.6, -0.6]


@pytest.mark.parametrize("order", ORDERS)
def test_points_and_weights_are_gauss_s_rule(order):
    first = order * (order - 1) // 2
    rule = list(zip(_POINTS[first : first + order], _WEIGHTS[first : first + order], strict=True))
    for degree in range(2 * order):
        total = sum(Fraction(w) * Fraction(c) ** degree for c, w in rule)
        assert abs(float(total - Fraction(1, degree + 1))) <= EPS
    assert len(_POINTS) == len(_WEIGHTS) == sum(ORDERS)


@pytest.mark.thorough
@pytest.mark.parametrize("accuracy", [1e-3, 1e-6, 1e-9, 1e-12])
def test_a_pushed_free_body_is_not_integrated(accuracy):
    scene = made(TRIAXIAL, SPUN, PUSH, accuracy=accuracy)
    found = plan(scene)
    assert (found.model, found.states) == ("torque-free body, body force", 13)
    assert error_of(scene, found) <= 1.1 * found.error + 4 * EPS
    assert found.error <= accuracy / 3.0
    assert "turns with the body" in reasons(found)


def ends(scene, found, steps):
    """The state after each of some steps."""
    unit, z = found.kernels, filled_buffer(scene, found)
    initialize(scene, unit, z)
    rows = []
    for h in steps:
        assert unit.step(z, h) == OK
        rows.append([z[unit.BLOCKS[name]].copy() for name in STATE])
    return [np.array(column) for column in zip(*rows, strict=True)]


@pytest.mark.parametrize("factor", some_of([0.1, 0.7, 3.3, 10.0, 100.0], 2))
def test_the_quadrature_holds_in_any_communication_step(factor):
    scene = made(TRIAXIAL, SPUN, PUSH, accuracy=1e-8)
    h = factor * scene.run.step
    steps = [h] * max(1, round(scene.run.stop / h))
    points = reference.motion(scene, np.cumsum(steps).tolist())
    assert max(reference.errors(points, *ends(scene, plan(scene), steps)).values()) <= 1e-8


@pytest.mark.thorough
@compiled
def test_a_pushed_path_gathers_no_round_off():
    """1e5 steps: plain sums lose 1e-12."""
    scene = made(TRIAXIAL, SPUN, PUSH)
    found = Plan("torque-free body, body force", "", 13, order=3, substep=1.0, pinned=("all",))
    rows = ends(scene, found, [2.0**-10] * 100_000)
    last = reference.motion(scene, [100_000 * 2.0**-10])
    assert max(reference.errors(last, *(column[-1:] for column in rows)).values()) <= 20 * EPS


@pytest.mark.parametrize(("body", "loads", "varies"), [
    (TRIAXIAL, PUSH | {"torque_b": [0.0, 0.0, 0.1]}, {}),
    (TRIAXIAL, PUSH | {"damping_b": [0.1, 0.0, 0.0]}, {}),
    (TRIAXIAL | {"r_oc_b": [0.1, 0.0, 0.0]}, PUSH, {}),
    *((TRIAXIAL, PUSH, {"parameters": [name]}) for name in ("force_b", "mass", "omega_b_0", "r_oc_b", "torque_a")),
    (TRIAXIAL, PUSH, {"ports": ["force_b"]}),
])  # fmt: skip
def test_what_turns_or_varies_is_integrated(body, loads, varies):
    assert plan(made(body, SPUN, loads, accuracy=1e-6, **varies)).model == "body under loads, by series"


def test_the_cheaper_of_quadrature_and_integrator_serves_a_symmetric_body():
    body = {"mass": 2.0, "inertia": [1.0, 1.0, 2.0]}
    scene = made(body, SPUN, PUSH, accuracy=1e-6)
    models = [plan(scene.replace({"run.step": step})).model for step in (0.1, 1.0)]
    assert models == ["body under loads, by series", "torque-free body, body force"]
