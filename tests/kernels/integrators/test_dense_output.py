"""Series that serve many steps: as accurate at every output, saved, refused, driven; the same bits in plain Python."""

import math

import numpy as np
import pytest

from rbfmu.runs.motion import attitude_error
from rbfmu.runs.plan import Plan
from rbfmu.scene.scene import Scene
from rbfmu.studies.chart.cases import CASES
from rbfmu_kernels.buffer import STEP_REJECTED
from rbfmu_kernels.models.loaded import LOADED_TAYLOR
from tests.support.references import reference_mp as reference
from tests.support.scenes import model_cases
from tests.support.sources import assert_same_in_plain_python

EPS = 2.0**-52
SCENES = {
    "torque in b": CASES["d"].scene, "top": CASES["c"].scene, "heavy body": CASES["c'"].scene,
    "thruster": CASES["f"].scene, "all loads": Scene(**model_cases.ALL_LOADS, run={"stop": 5.0}),
    "damped": CASES["e"].scene,
}  # fmt: skip


class Unit(model_cases.Unit):
    """A body by series."""

    def __init__(self, scene, order=16, tolerance=1e-10, span=0.0, ports=()):
        tables = scene.to_dict() | {"inputs": {"ports": list(ports)}, "outputs": {}}
        plan = Plan("body under loads, by series", "", 13, tolerance=tolerance, order=order, span=span)
        super().__init__(Scene.from_dict(tables, "dense"), plan)

    @property
    def series(self):
        return self["substeps"]

    @property
    def outputs(self):
        return np.concatenate([self[name] for name in ("position", "velocity", "quaternion", "omega_b")])

    def errors(self, truth):
        return reference.errors([truth], *([self[name]] for name in ("quaternion", "omega_b", "position", "velocity")))


@pytest.mark.parametrize("size", [1e-12, 1e-8])
def test_a_small_swing_keeps_its_digits(size):
    """Two pendulums, one about each axis, as their angles are so small that sines are angles."""
    body = {"mass": 6.6, "inertia": [10.0, 13.0, 14.0], "pivot": True, "r_oc_b": [0.0, 0.0, -1.46]}
    loads, run = {"gravity_a": [0.0, 0.0, -9.81]}, {"stop": 2.0, "step": 0.02}
    scene = Scene(body=body, initial={"omega_b": [size, 2.0 * size, 0.0]}, loads=loads, run=run)
    unit, moments = Unit(scene, order=20, tolerance=1e-12), np.array([10.0, 13.0]) + 6.6 * 1.46**2
    for k in range(1, 101):
        unit.step(0.02, 1)
        swung = size * np.array([1.0, 2.0]) * np.cos(np.sqrt(6.6 * 9.81 * 1.46 / moments) * 0.02 * k)
        assert np.max(np.abs(unit["omega_b"][:2] - swung)) <= 1e-12 * 2.0 * size
    assert unit.series < 20.0


def natural_step(scene, order, tolerance, span):
    """Return the mean time between series."""
    unit = Unit(scene, order, tolerance).step(span / 3000.0, 3000)
    assert unit.series < 1000.0
    return span / unit.series


@pytest.mark.thorough
@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("denser", [10, 100])
def test_every_output_is_within_the_tolerances_of_the_series_begun(name, denser):
    """Against 40 digits, at times all over the run."""
    scene, order, tolerance, span = SCENES[name], 16, 1e-9, 1.5
    h = natural_step(scene, order, tolerance, span) / denser
    n = math.ceil(span / h)
    chosen = np.linspace(1, n, 12).astype(int)
    truth = reference.motion(scene, tuple(h * k for k in chosen.tolist()))
    unit, done = Unit(scene, order, tolerance), 0
    for k, point in zip(chosen, truth, strict=True):
        unit.step(h, k - done)
        done = k
        assert max(unit.errors(point).values()) <= unit.series * tolerance + 40 * EPS
    assert unit.series <= 1.2 * n / denser + 1


@pytest.mark.parametrize("name", SCENES)
def test_series_do_not_care_when_outputs_are_asked_for(name):
    """Where they begin is theirs: outputs at one time differ by the round-off of clocks, and of adding up a path."""
    unit, denser = Unit(SCENES[name]), Unit(SCENES[name])
    h = 1e-3
    for _ in range(50):
        unit.step(20 * h)
        denser.step(h, 20)
        np.testing.assert_allclose(denser.outputs, unit.outputs, rtol=0.0, atol=4000 * EPS)
    assert unit.series == denser.series


@pytest.mark.thorough
@pytest.mark.parametrize("name", SCENES)
def test_steps_of_any_size_are_served(name):
    """Longer ones than a series reaches over too, which may take substeps."""
    scene, rng, span = SCENES[name], np.random.default_rng(3), 1.5
    times = np.sort(np.concatenate([rng.uniform(0.0, 0.2, 40), rng.uniform(0.0, 1.2, 5), rng.uniform(1.2, span, 40)]))
    (truth,) = reference.motion(scene, (float(times[-1]),))
    unit = Unit(scene, 14, 1e-9)
    for h in np.diff(times, prepend=0.0):
        unit.step(float(h))
    assert max(unit.errors(truth).values()) <= unit.series * 1e-9 + 400 * EPS


@pytest.mark.parametrize("name", SCENES)
def test_a_copy_in_mid_series_goes_on_with_the_same_bits(name):
    unit = Unit(SCENES[name]).step(0.002, 17)
    saved = unit.z.copy()
    first = unit.step(0.002, 120).step(0.5).step(0.001, 9).z.copy()
    unit.z[:] = saved
    np.testing.assert_array_equal(unit.step(0.002, 120).step(0.5).step(0.001, 9).z, first)


@pytest.mark.parametrize("h", [0.0, -1.0, math.nan, math.inf, 1e300])
@pytest.mark.parametrize("name", ["top", "thruster", "all loads"])
def test_a_refused_step_leaves_a_series_as_it_was(name, h):
    reach = Unit(SCENES[name]).step(0.002, 11)["reach"]
    for served, first in ((11, 0.002), (int(300.0 * reach), 0.6 * reach)):  # in the second the series ends
        unit, other = (Unit(SCENES[name]).step(0.002, served) for _ in range(2))
        before = unit.outputs
        assert LOADED_TAYLOR.step(unit.z, h) == STEP_REJECTED
        np.testing.assert_array_equal(unit.outputs, before)
        for further in (first, *[0.002] * 60):
            np.testing.assert_array_equal(unit.step(further).outputs, other.step(further).outputs)


@pytest.mark.parametrize("name", ["torque in b", "thruster", "all loads"])
@pytest.mark.parametrize(
    ("change", "value"), [("torque_b", 1e200), ("torque_b_rate", 1e200), ("force_a", math.inf), ("force_a", math.nan)]
)
def test_a_step_refused_for_its_inputs_leaves_a_series_as_it_was(name, change, value):
    unit, other = (Unit(SCENES[name], ports=("torque_b", "force_a")).step(0.002, 11) for _ in range(2))
    kept = unit[change]
    unit[change] = [value, value, 0.0]
    assert LOADED_TAYLOR.step(unit.z, 1.0) == STEP_REJECTED
    unit[change] = kept
    for _ in range(60):
        np.testing.assert_array_equal(unit.step(0.002).outputs, other.step(0.002).outputs)


def fresh(unit, scene, torque):
    """A unit that starts from another's state under a torque that it knows."""
    tables = scene.to_dict()
    tables["initial"] = {"attitude": {"quaternion": unit["quaternion"].tolist()}, "omega_b": unit["omega_b"].tolist(),
                         "position": unit["position"].tolist(), "velocity": unit["velocity"].tolist()}  # fmt: skip
    tables["loads"]["torque_b"] = torque
    return Scene.from_dict(tables, "fresh")


@pytest.mark.parametrize("name", ["torque in b", "heavy body", "thruster"])
def test_an_input_changed_in_mid_series_acts_as_from_a_fresh_start(name):
    scene, torque, tolerance = SCENES[name], [0.3, -0.2, 0.1], 1e-10
    known = scene.to_dict()["loads"].get("torque_b", [0.0, 0.0, 0.0])
    unit = Unit(scene, tolerance=tolerance, ports=("torque_b",)).step(0.003, 25)
    (truth,) = reference.motion(fresh(unit, scene, np.add(known, torque).tolist()), (0.3,))
    begun = unit.series
    unit["torque_b"] = torque
    unit.step(0.003, 100)
    assert max(unit.errors(truth).values()) <= (unit.series - begun) * tolerance + 400 * EPS
    assert unit.series - begun < 60.0


def test_inputs_that_hold_go_on_with_the_series_and_those_that_change_do_not_wait_for_one():
    """A series that is begun for one step alone would cost more than a substep."""
    unit = Unit(SCENES["torque in b"], ports=("torque_b",)).step(0.01, 50)
    assert unit.series == 1.0
    for k in range(50):
        unit["torque_b"] = [0.01 * k + 0.01, 0.0, 0.0]
        unit.step(0.01)
    assert unit.series == 51.0
    assert unit.step(0.01, 50).series == 52.0


def test_inputs_that_change_within_a_step_end_a_series():
    scene = SCENES["torque in b"]
    unit, other = Unit(scene, ports=("torque_b",)), Unit(scene, ports=("torque_b",))
    unit.step(0.01, 10)
    unit["torque_b_rate"] = [1.0, 0.0, 0.0]
    unit.step(0.01).step(0.01, 30)
    other["step_size"] = 0.01  # too short for series
    other.step(0.01, 10)
    other["torque_b_rate"] = [1.0, 0.0, 0.0]
    other.step(0.01).step(0.01, 30)
    assert unit["torque_b"][0] == 0.01
    assert attitude_error(unit["quaternion"], other["quaternion"]) <= 1e-9
    assert unit.series < other.series


@pytest.mark.thorough
def test_a_motion_that_turns_fast_leaves_the_series():
    """Spun up from rest: natural steps shrink below the communication step."""
    scene = Scene(body={"mass": 1.0, "inertia": [1.0, 1.2, 1.5]}, loads={"torque_b": [30.0, 20.0, 80.0]},
                  run={"stop": 2.0})  # fmt: skip
    unit = Unit(scene, 12, 1e-9)
    (truth,) = reference.motion(scene, (2.0,))
    unit.step(0.05, 40)
    assert max(unit.errors(truth).values()) <= unit.series * 1e-9 * 2.0
    assert unit.series > 40.0


@pytest.mark.thorough
def test_a_tolerance_for_a_whole_run_is_kept():
    scene, span = SCENES["heavy body"], 5.0
    (truth,) = reference.motion(scene, (span,))
    for tolerance in (1e-5, 1e-8):
        unit = Unit(scene, 16, tolerance, span).step(0.005, 1000)
        assert max(unit.errors(truth).values()) <= 3.0 * tolerance
        assert unit.series < 500.0


BITS = """
import sys
from tests.kernels.integrators.test_dense_output import SCENES, Unit
for name, scene in SCENES.items():
    unit = Unit(scene, 8, 1e-6, ports=("torque_b",)).step(0.003, 25)
    unit["torque_b"] = [0.1, 0.0, 0.0]
    unit.step(0.003, 12)
    print(unit.outputs.tobytes().hex())
"""


@pytest.mark.thorough
def test_plain_python_has_the_same_bits():
    assert_same_in_plain_python(BITS, len(SCENES))
