"""Steps of the units behind FMUs and `simulate`: time chopped, snapshots, atomic steps, refusals."""

import math
from fractions import Fraction

import numpy as np
import pytest

from rbfmu.models.registry import MODELS
from rbfmu.runs.motion import attitude_error
from rbfmu.runs.plan import Plan
from rbfmu_kernels.buffer import FAULTS, NEGATIVE
from rbfmu_kernels.quantities import active_flags
from tests.support.covering import some_of
from tests.support.scenes.model_cases import (
    EPS,
    GRAVITY,
    LEANING,
    LOADED,
    MOVING,
    NO_GRAVITY,
    OFFSET,
    TOP,
    TRIAXIAL,
    TURNED,
    Unit,
    assert_refused,
    distance,
    made,
    plan_by_hand,
)


@pytest.mark.thorough
@pytest.mark.parametrize("body", [OFFSET, OFFSET | {"pivot": True}], ids=["free", "pivot"])
def test_chopping_time_changes_results_within_the_accuracy_only(body):
    initial = {"omega_b": [1.0, 2.0, -1.0], "attitude": TURNED}
    scene = made(body, initial, {"gravity_a": [0.0, 0.0, -9.81], "torque_b": [0.1, 0.2, 0.3]}, stop=3.0)
    whole, parts = Unit(scene).step(3.0), Unit(scene).step(0.1, 30)
    odd = Unit(scene)
    for h in np.diff(np.sort(np.concatenate([[0.0, 3.0], np.random.default_rng(1).uniform(0.0, 3.0, 20)]))):
        odd.step(h)
    for other in (parts, odd):
        assert attitude_error(other["quaternion"], whole["quaternion"]) <= 2e-10
        assert distance(other["omega_b"], whole["omega_b"]) <= 2e-10 * np.linalg.norm(whole["omega_b"])
        assert distance(other["position"], whole["position"]) <= 2e-10 * max(1.0, np.linalg.norm(whole["position"]))


def test_round_off_in_the_importer_s_clock_changes_the_result_by_round_off():
    """0.1 + 0.2 - 0.2 is not 0.1; no further substep comes of it."""
    scene = made(TRIAXIAL, {"omega_b": [1.0, 2.0, -1.0]})
    exact, shaky = Unit(scene), Unit(scene)
    for k in range(10):
        exact.step(0.1)
        shaky.step((0.1 * k + 0.2) - (0.1 * k + 0.1))
    assert attitude_error(exact["quaternion"], shaky["quaternion"]) <= 40 * EPS


def scene_of(model):
    """The plainest scene that is planned as this model."""
    return {
        "no rotation": lambda: made(TRIAXIAL),
        "constant rate": lambda: made(TRIAXIAL, {"omega_b": [1.0, 0.0, 0.0]}),
        "one axis": lambda: made(TRIAXIAL, {"omega_b": [1.0, 0.0, 0.0]}, NO_GRAVITY | {"damping_b": [1.0, 0.0, 0.0]}),
        "angular momentum": lambda: made(TRIAXIAL, {"omega_b": [1.0, 2.0, 0.0]}, NO_GRAVITY | {
            "torque_a": [0.1, 0.2, 0.3]}, outputs={"quantities": ["angular_momentum_a"]}),
        "torque-free symmetric body": lambda: made({"mass": 3.0, "shape": {"kind": "beam", "length": 2.0}}),
        "symmetric body spun up": lambda: made(
            {"mass": 1.0, "inertia": [2.0, 1.0, 2.0]}, {"omega_b": [0.1, 2.0, 0.2]}, NO_GRAVITY | {
                "torque_b": [0.0, 0.3, 0.0], "damping_b": [0.1, 0.2, 0.1]}, outputs={"quantities": ["omega_b"]}),
        "torque-free body": lambda: made(TRIAXIAL),
        "torque-free body, body force": lambda: made(
            TRIAXIAL, {"omega_b": [1.0, 2.0, 0.0]}, NO_GRAVITY | {"force_b": [0.1, 0.2, 0.3]}),
        "undamped pendulum": lambda: made(
            {"mass": 3.0, "shape": {"kind": "beam", "length": 2.0}, "r_oc_b": [1.0, 0.0, 0.0], "pivot": True},
            {"attitude": {"rotvec": [0.0, 1.0, 0.0]}}, GRAVITY),
        "one swinging axis": lambda: made(
            TRIAXIAL | {"r_oc_b": [0.0, 0.0, 1.0], "pivot": True}, {"attitude": {"rotvec": [1.0, 0.0, 0.0]}},
            GRAVITY | {"damping_b": [1.0, 0.0, 0.0]}),
        "body under loads, by series": lambda: made(TRIAXIAL, {}, NO_GRAVITY | {"torque_b": [0.1, 0.2, 0.3]}),
        "symmetric top": lambda: made(TOP, {"omega_b": [0.0, 0.0, 200.0], "attitude": LEANING}, GRAVITY, 1e-3),
        "prescribed rates": lambda: made(None, {"attitude": TURNED}, inputs={"ports": ["omega_b"]}),
    }[model]()  # fmt: skip


def plan_of(model, **settings):
    if model == "symmetric top":
        return Plan(model, "splitting of order 2", 7, substep=1e-3, order=2)
    return plan_by_hand(model, **settings)


ANY_BODY = [
    (1, {"mass": 0.0}), (1, {"mass": -1.0}), (2, {"inertia": [1e308, 1e308, 1e308, 0.0, 0.0, 0.0]}),
    (4, {"inertia": [-1.0, 2.0, 2.5, 0.0, 0.0, 0.0]}), (4, {"inertia": [1.0, 2.0, 2.5, 9.0, 0.0, 0.0]}),
    (5, {"inertia": [1.0, 2.0, 3.1, 0.0, 0.0, 0.0]}),
    (6, {"inertia": [0.0, 0.0, 0.0, 0.0, 0.0, 0.0], "r_oc_b": [0.0, 0.0, 0.0]}),
    (7, {"quaternion_0": [0.0, 0.0, 0.0, 0.0]}), (8, {"mass": math.inf}),
    (8, {"inertia": [math.nan, 2.0, 2.5, 0.0, 0.0, 0.0]}), (8, {"position_0": [0.0, 0.0, -math.inf]}),
    (8, {"constant_torque_b": [0.0, math.nan, 0.0]}), (NEGATIVE, {"damping_b": [0.0, -1e-9, 0.0]}),
]  # fmt: skip
FAULTY = [(model, *fault) for model in MODELS if model != "prescribed rates" for fault in ANY_BODY]
FAULTY += [
    ("torque-free symmetric body", 9, {"omega_b_0": [1e-3, 1.0, 0.0]}),
    ("torque-free body", 10, {"omega_b_0": [1e200, 1e200, 1e200]}),
    ("body under loads, by series", 10, {"omega_b_0": [1e200, 1e200, 1e200]}),
    ("body under loads, by series", 10, {"mass": 1e-310}),
    ("torque-free body", 11, {"constant_torque_a": [0.0, 1e-9, 0.0]}),
    ("torque-free body", 11, {"damping_b": [0.0, 0.0, 1.0]}),
    ("torque-free body", 11, {"r_oc_b": [1.0, 0.0, 0.0], "constant_force_a": [0.0, 1.0, 0.0]}),
    ("torque-free body, body force", 11, {"damping_b": [0.0, 0.0, 1.0]}),
    ("torque-free body, body force", 11, {"r_oc_b": [1e-9, 0.0, 0.0]}),
    ("symmetric top", 12, {"inertia": [0.5, 0.6, 0.3, 0.0, 0.0, 0.0]}),
    ("symmetric top", 12, {"damping_b": [0.0, 0.0, 1.0]}), ("symmetric top", 13, {"omega_b_0": [0.0, 0.0, 2e4]}),
    ("no rotation", 14, {"omega_b_0": [0.0, 0.0, 1e-9]}), ("no rotation", 14, {"constant_torque_b": [0.0, 0.0, 1e-9]}),
    ("constant rate", 15, {"omega_b_0": [1.0, 1e-9, 0.0]}),
    ("constant rate", 15, {"constant_torque_b": [1e-9, 0.0, 0.0]}),
    ("angular momentum", 20, {"constant_torque_b": [0.0, 0.0, 1e-9]}),
    ("angular momentum", 20, {"damping_b": [0.0, 0.0, 1e-9]}),
    ("angular momentum", 20, {"active": active_flags(["omega_a"])}), ("one axis", 17, {"omega_b_0": [1.0, 1e-9, 0.0]}),
    ("one axis", 17, {"constant_torque_b": [1.0, 0.0, 1e-9]}),
    ("one axis", 17, {"r_oc_b": [0.0, 1.0, 0.0], "constant_force_a": [0.0, 1.0, 0.0]}),
    ("one axis", 17, {"inertia": [1.0, 2.0, 2.5, 0.1, 0.0, 0.0]}),
    ("undamped pendulum", 17, {"omega_b_0": [0.0, 1.0, 1e-9]}),
    ("undamped pendulum", 17, {"quaternion_0": [0.9, 0.1, 0.4, 0.0], "r_oc_b": [1.0, 0.1, 0.0]}),
    ("undamped pendulum", 18, {"damping_b": [0.0, 1e-9, 0.0]}),
    ("undamped pendulum", 18, {"constant_torque_b": [0.0, 1e-9, 0.0]}),
    ("symmetric body spun up", 19, {"inertia": [2.0, 1.0, 2.1, 0.0, 0.0, 0.0]}),
    ("symmetric body spun up", 19, {"damping_b": [0.1, 0.2, 0.11]}),
    ("symmetric body spun up", 19, {"constant_torque_b": [1e-9, 0.3, 0.0]}),
    ("symmetric body spun up", 19, {"constant_torque_a": [0.0, 1e-9, 0.0]}),
    ("one swinging axis", 17, {"omega_b_0": [1.0, 1e-9, 0.0]}),
    ("torque-free symmetric body", 16, {"inertia": [1.0, 2.0, 2.5, 0.0, 0.0, 0.0]}),
    ("torque-free symmetric body", 11, {"constant_torque_b": [0.0, 1.0, 0.0]}),
    *(("prescribed rates", 7, {"quaternion_0": [x, 0.0, 0.0, y]}) for x, y in ((0, 0), (math.nan, 1), (math.inf, 1))),
]  # fmt: skip


@pytest.mark.parametrize(("model", "code", "values"), FAULTY)
def test_initialize_refuses_what_its_model_cannot_be(model, code, values):
    unit = Unit(scene_of(model), plan_of(model))
    for name, value in values.items():
        unit[name] = value
    with np.errstate(all="ignore"):
        assert unit.kernels.initialize(unit.z) == code


AT_A_TURN = {
    "torque-free symmetric body": lambda: made({"mass": 1.0, "inertia": [2.0, 1.0, 2.0]}, MOVING),
    "torque-free body": lambda: made(TRIAXIAL, MOVING),
    "body under loads, by series": lambda: made(OFFSET, MOVING, LOADED, inputs={"ports": ["torque_b", "force_a"]}),
}
WITH_ATTITUDE = MODELS.keys() - {"no rotation", "angular momentum", "symmetric body spun up"}


def turning(model):
    """A unit whose body turns."""
    scene = AT_A_TURN[model]() if model in AT_A_TURN else scene_of(model)
    unit = Unit(scene, plan_of(model, substep=0.1, tolerance=1e-9))
    if model == "prescribed rates":
        unit["omega_b"] = [1.0, 0.3, -0.5]
    return unit


@pytest.mark.parametrize("model", some_of([*sorted(WITH_ATTITUDE)], 5))
def test_the_quaternion_keeps_length_one(model):
    """To 4 eps at all times: scaled after each substep, or made anew from the start's at each step."""
    unit, random = turning(model), np.random.default_rng(2)
    for k in range(300):
        if model == "prescribed rates":
            unit["omega_b"] = [1.0, math.sin(k), -0.5]
        unit.step(random.uniform(0.001, 0.1))
        assert abs(sum(Fraction(float(x)) ** 2 for x in unit["quaternion"]) - 1) <= 2 * 4 * EPS
    assert distance(unit["quaternion"], unit["quaternion_0"]) > 0.1  # it turned


def test_a_copy_of_the_buffer_is_a_snapshot():
    for model in sorted(WITH_ATTITUDE):
        unit = turning(model).step(0.05, 2)
        snapshot = unit.z.copy()
        first = unit.step(0.037, 3).z.copy()
        unit.z[:] = snapshot
        np.testing.assert_array_equal(unit.step(0.037, 3).z, first, model)


@pytest.mark.parametrize("h", [0.0, -0.1, math.nan, math.inf, -math.inf, 1e300])
@pytest.mark.parametrize("model", ["body under loads, by series", "undamped pendulum", "prescribed rates"])
def test_a_step_of_no_size_is_refused_and_changes_nothing(model, h):
    unit, other = (turning(model).step(0.5) for _ in range(2))
    if model == "prescribed rates":
        unit["omega_b_rate"] = other["omega_b_rate"] = [0.7, 1.1, -0.6]
    assert_refused(unit, h)
    np.testing.assert_array_equal(unit.step(0.5)["quaternion"], other.step(0.5)["quaternion"])


@pytest.mark.parametrize(("model", "port", "value", "h"), [
    ("body under loads, by series", "torque_b", [1e200, 1e200, 0.0], 1.0),
    ("body under loads, by series", "torque_b", [math.nan, 0.0, 0.0], 1.0),
    ("body under loads, by series", "force_a", [0.0, math.inf, 0.0], 1.0),
    ("prescribed rates", "omega_b", [0.0, math.nan, 0.0], 0.1),
    ("prescribed rates", "omega_b", [0.0, math.inf, 0.0], 0.1),
    ("prescribed rates", "omega_b", [0.0, 1e10, 0.0], 1e6),
])  # fmt: skip
def test_a_step_out_of_the_numbers_is_refused_and_changes_nothing(model, port, value, h):
    unit, other = (turning(model).step(0.5) for _ in range(2))
    unit[port] = value
    assert_refused(unit, h)
    unit[port] = other[port]
    np.testing.assert_array_equal(unit.step(0.5)["quaternion"], other.step(0.5)["quaternion"])


def test_every_fault_is_reached():
    """But 3, not symmetric: the buffer has six numbers, a symmetric matrix by construction."""
    assert {code for _, code, _ in FAULTY} == FAULTS.keys() - {3}


def test_initialize_takes_a_quaternion_of_any_length():
    unit = Unit(made(TRIAXIAL))
    for factor in (1e-160, 3.0, 1e150):
        unit["quaternion_0"] = np.array([1.0, -1.0, 1.0, 1.0]) * factor
        assert unit.kernels.initialize(unit.z) == 0
        assert distance(unit["quaternion"], [0.5, -0.5, 0.5, 0.5]) <= 2 * EPS
