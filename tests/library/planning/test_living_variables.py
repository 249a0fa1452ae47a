"""Every parameter of a scene's FMU changes an output, or the scene lists it; each that would is there."""

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings, strategies as st

from rbfmu.models.question import Question
from rbfmu.planning.select import plan
from rbfmu.runs.plan import filled_buffer
from rbfmu.scene.scene import Scene, SceneError
from rbfmu_kernels.body.memory import OUTPUTS, PARAMETERS
from rbfmu_kernels.buffer import OK
from tests.support.scenes.random_scenes import scenes

QUIET = {"deadline": None, "suppress_health_check": list(HealthCheck), "derandomize": True}
TRIAXIAL = {"mass": 2.0, "inertia": [1.0, 2.0, 2.5]}
DISC = {"mass": 2.0, "shape": {"kind": "cylinder", "radius": 0.2, "length": 0.1}, "pivot": True}
STEPS = (0.3, 0.17)
START = ("position_0", "velocity_0", "quaternion_0", "omega_b_0")


def made(body, initial, loads, quantities, **inputs):
    tables = {"body": body, "initial": initial, "loads": {"gravity_a": [0.0, 0.0, -1.0]} | loads, "inputs": inputs}
    return Scene.from_dict(tables | {"outputs": {"quantities": quantities}, "run": {"stop": 1.0, "accuracy": 1e-4}})


def outputs_of(scene, planned, changes):
    """What the scene asks for after some steps, parameters changed in parts; no unit asks whether it serves them."""
    unit, z, random = planned.kernels, filled_buffer(scene, planned), np.random.default_rng(7)
    for block, part in changes.items():
        change(z[unit.BLOCKS[block]], block, part)
    z[unit.BLOCKS["skip_model_checks"]] = 1.0
    assert unit.initialize(z) == OK
    for h in STEPS:
        for port in scene.inputs.ports:
            z[unit.BLOCKS[port]] = 0.1 * random.normal(size=3)
        assert unit.step(z, h) == OK
        assert unit.outputs(z) == OK
    return np.concatenate([z[unit.BLOCKS[name]] for name in OUTPUTS if name in scene.outputs.quantities])


def change(values, block, part):
    """By a part, and so that a body stays a body; of loads and values at the start, which may be tiny, of 1."""
    if block == "inertia":
        values *= [1.0 + part, 1.0 + 0.9 * part, 1.0 + 0.8 * part, 1.0, 1.0, 1.0]
    elif block in ("mass", "r_oc_b"):
        values *= 1.0 + part * np.linspace(1.0, -0.7, len(values))
    else:
        values += part * np.linspace(1.0, 0.6, len(values)) * (-1.0) ** np.arange(len(values) if block in START else 1)


def differs(scene, planned, block, others):
    """Whether a change of one parameter shows, where others have been changed a little before."""
    before = dict.fromkeys(others, 0.02)
    after = before | {block: 0.05}
    a, b = outputs_of(scene, planned, before), outputs_of(scene, planned, after)
    return bool(np.max(np.abs(a - b)) > 1e-12 * (1.0 + np.max(np.abs(a))))


def living(scene, planned):
    """Names of the parameters (loads: that act) that change an output, at the scene's values or beside them."""
    z, unit = filled_buffer(scene, planned), planned.kernels
    blocks = [b for b in PARAMETERS if b in START or np.any(z[unit.BLOCKS[b]])]
    blocks = [b for b in blocks if b.removeprefix("constant_") not in scene.inputs.ports]
    return {b.removeprefix("constant_") for b in blocks if any(differs(scene, planned, b, o) for o in ((), blocks))}


def check(scene, planned):
    needed, alive = planned.spec.needed_parameters(Question(scene)), living(scene, planned)
    assert needed - alive <= set(scene.inputs.parameters), planned.model
    assert alive <= needed, planned.model


CASES = {
    "disc held at its centre of mass": (made(DISC, {"omega_b": [0, 0, 9]}, {"damping_b": [0, 0, 0.1]}, ["omega_b"]),
        {"inertia", "omega_b_0", "damping_b"}),
    "path alone": (
        made(TRIAXIAL, {"omega_b": [1, 2, 3]}, {"torque_b": [1, 0, 0], "damping_b": [1, 1, 1]}, ["position"]),
        {"gravity_a", "position_0", "velocity_0"},
    ),
    "speed alone": (made(TRIAXIAL, {"velocity": [1, 2, 3]}, {}, ["velocity"]), {"gravity_a", "velocity_0"}),
    "pushed": (made(TRIAXIAL, {}, {"force_a": [1, 0, 0], "torque_b": [1, 0, 0]}, ["velocity"]),
        {"gravity_a", "velocity_0", "force_a", "mass"}),
    "torque beside a path": (made(TRIAXIAL, {"velocity": [1, 0, 0]}, {"torque_b": [0, 0, 1]}, ["velocity", "omega_b"]),
        {"gravity_a", "velocity_0", "torque_b", "inertia", "omega_b_0"}),
    "listed all the same": (made(TRIAXIAL, {"velocity": [1, 0, 0]}, {}, ["velocity"], parameters=["mass", "torque_b"]),
        {"gravity_a", "velocity_0", "mass", "torque_b"}),
    "a force to come": (made(TRIAXIAL, {"velocity": [1, 0, 0]}, {}, ["velocity"], ports=["force_a"]),
        {"gravity_a", "velocity_0", "mass"}),
    "momentum": (made(TRIAXIAL, {"omega_b": [1, 2, 3]}, {"torque_a": [1, 0, 0]}, ["angular_momentum_a"]),
        {"inertia", "omega_b_0", "quaternion_0", "torque_a"}),
    "no lever": (made(TRIAXIAL | {"r_oc_b": [0, 0, 1]}, {"omega_b": [0, 0, 3]}, {"force_b": [0, 0, 1]}, ["quaternion"]),
        {"omega_b_0", "quaternion_0"}),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_a_scene_s_parameters_are_those_that_change_its_outputs(name):
    scene, expected = CASES[name]
    planned = plan(scene)
    assert planned.spec.needed_parameters(Question(scene)) == expected
    check(scene, planned)


@pytest.mark.thorough
@given(scenes(), st.lists(st.sampled_from(list(OUTPUTS)), min_size=1, max_size=2, unique=True))
@settings(max_examples=60, **QUIET)
def test_no_parameter_is_dead_and_none_is_missing(scene, quantities):
    tables = scene.to_dict() | {"outputs": {"quantities": quantities}}
    tables["run"] |= {"accuracy": 1e-3}
    scene = Scene.from_dict(tables)
    assume(not scene.body.axis_without_inertia)  # no rate there
    try:
        planned = plan(scene)
    except SceneError:
        assume(False)
    check(scene, planned)
