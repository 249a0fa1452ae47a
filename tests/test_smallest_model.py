"""Random scenes: the planned model meets the accuracy against 40 digits, and the next smaller one does not serve."""

from collections import Counter

import numpy as np
import pytest
import reference_mp as reference
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from numba import config
from random_scenes import scenes

import rbfmu
from rbfmu.comparison import largest_difference, watched
from rbfmu.explanations import GROWTH, growth_rate
from rbfmu.ladder import CLOSED
from rbfmu.models import Plan
from rbfmu.planning import SHARE, plan
from rbfmu.scene import Scene, SceneError
from rbfmu.times import time_grid
from rbfmu.unit import filled_buffer, initialize
from rbfmu_kernels.layout import FINE

pytestmark = pytest.mark.skipif(bool(config.DISABLE_JIT), reason="too many steps to interpret")
QUIET = {"deadline": None, "suppress_health_check": list(HealthCheck), "derandomize": True}
SEEN: Counter[str] = Counter()


def error_of(scene, planned):
    """The largest error against 40-digit arithmetic in what the scene asks for."""
    result = rbfmu.simulate(scene, planned=planned)
    points = reference.motion(scene, result.time.tolist())
    count = len(result.time)
    found = dict(result.quantities)
    if "rpy" in found:
        found["quaternion"] = rbfmu.quaternion_from_euler("ZYX", found.pop("rpy")[:, ::-1])
    blank = {"quaternion": np.tile([1.0, 0.0, 0.0, 0.0], (count, 1)), "omega_b": np.zeros((count, 3))}
    blank |= {"position": np.zeros((count, 3)), "velocity": np.zeros((count, 3))}
    rows = blank | found
    errors = reference.errors(points, rows["quaternion"], rows["omega_b"], rows["position"], rows["velocity"])
    names = {"quaternion": "attitude"}
    return max(errors[names.get(name, name)] for name in found)


def planned_or_assumed_away(scene):
    try:
        found = plan(scene)
    except SceneError as error:
        if "run.accuracy" not in str(error):
            raise
        assume(False)
    SEEN[found.model] += 1
    return found


def check(scene):
    found = planned_or_assumed_away(scene)
    assert error_of(scene, found) <= scene.run.accuracy
    for model in CLOSED[: CLOSED.index(found.model)] if found.model in CLOSED else CLOSED:
        unstable = growth_rate(scene) * scene.run.stop > GROWTH
        pushed = any(scene.loads.force_b) and set(scene.outputs.quantities) & {"position", "velocity"}
        if not unstable and not (pushed and model != "no rotation"):
            smaller = Plan(model, "", 0, held=("all",))
            assert error_of(scene, smaller) > 0.9 * SHARE * scene.run.accuracy, (model, found.model)


def with_ports(scene, ports):
    try:
        return Scene.from_dict(scene.to_dict() | {"inputs": {"ports": ports}})
    except SceneError:  # a beam that a port would turn about itself
        assume(False)


def driven(scene, planned, seed=1):
    """What the scene asks for, under random inputs held over each communication step."""
    unit, z, random = planned.unit, filled_buffer(scene, planned), np.random.default_rng(seed)
    names = watched(scene)
    z[unit.BLOCKS["unwanted"]] = [float(name not in names) for name in unit.OUTPUTS]
    initialize(scene, unit, z)
    rows = []
    for h in np.diff(time_grid(scene.run.start, scene.run.stop, scene.run.step)):
        for port in scene.inputs.ports:
            z[unit.BLOCKS[port]] = random.normal(size=3)
        assert unit.step(z, float(h)) == FINE
        rows.append([z[unit.BLOCKS[name]].copy() for name in names])
    return {name: np.array(column) for name, column in zip(names, zip(*rows, strict=True), strict=True)}, names


def check_driven(scene):
    """Against Taylor series of order 20 at round-off: to 40 digits a body under random inputs takes too long."""
    found = planned_or_assumed_away(scene)
    tight = Plan("body under loads, by series", "", 13, tolerance=1e-18, order=20)
    motion, names = driven(scene, found)
    assert largest_difference(motion, driven(scene, tight)[0], names) <= scene.run.accuracy


PORTS = st.lists(st.sampled_from(["force_a", "force_b", "torque_a", "torque_b"]), min_size=1, max_size=2, unique=True)


@given(scenes(), PORTS)
@settings(max_examples=30, **QUIET)
def test_the_plan_with_ports_is_right_whatever_comes_through_them(scene, ports):
    check_driven(with_ports(scene, ports))


@pytest.mark.slow
@given(scenes(), PORTS)
@settings(max_examples=300, **QUIET)
def test_the_plan_with_ports_is_right_on_hundreds_of_scenes(scene, ports):
    check_driven(with_ports(scene, ports))


@given(scenes())
@settings(max_examples=40, **QUIET)
def test_the_plan_is_right_and_smallest(scene):
    check(scene)


@pytest.mark.slow
@given(scenes())
@settings(max_examples=600, **QUIET)
def test_the_plan_is_right_and_smallest_on_hundreds_of_scenes(scene):
    check(scene)


@pytest.mark.slow
def test_the_random_scenes_reach_every_rung():
    """Runs after the hundreds."""
    assert set(SEEN) >= {*CLOSED, "one swinging axis", "symmetric top", "body under loads, by series"}, SEEN
