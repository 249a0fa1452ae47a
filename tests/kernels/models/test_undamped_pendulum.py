"""The undamped pendulum as a unit and in FMUs: bodies that swing about one axis, against 40 digits."""

import math

import mpmath as mp
import numpy as np
import pytest

import rbfmu
import rbfmu_fmu
from rbfmu.planning.select import plan
from rbfmu.runs.motion import attitude_error
from rbfmu.runs.plan import Plan
from rbfmu.scene.scene import Scene
from tests.kernels.exact.test_plane_pendulum import truth
from tests.support.covering import some_of
from tests.support.fmu.fmu_importer import ERROR, OK, Fmu
from tests.support.fmu.fmus import unzipped_at
from tests.support.references import reference_mp as reference
from tests.support.scenes.model_cases import EPS, GRAVITY, NO_GRAVITY, TRIAXIAL, Unit

MODEL = "undamped pendulum"
RUN = {"stop": 8.0, "step": 0.5, "accuracy": 1e-12}
BEAM = {"mass": 3.0, "shape": {"kind": "beam", "length": 2.0}, "r_oc_b": [1.0, 0.0, 0.0], "pivot": True}
HUNG = {"mass": 2.0, "inertia": [1.0, 1.3, 1.7], "r_oc_b": [0.0, 0.3, -0.2], "pivot": True}
PUSHED = TRIAXIAL | {"r_oc_b": [0.1, 0.0, -0.2]}
"""Free, with a force beside its centre of mass."""


def about(axis, angle, rate):
    """An attitude and a rate about one of the body's axes, 1 to 3."""
    turn, omega = [0.0] * 3, [0.0] * 3
    turn[axis - 1], omega[axis - 1] = angle, rate
    return {"attitude": {"rotvec": turn}, "omega_b": omega}


def scene_of(body, initial, loads=GRAVITY, run=RUN, **other):
    other = {"outputs": {"quantities": STATE[: 2 if body.get("pivot") else 4]}} | other
    return Scene(body=body, initial=initial, loads=loads, run=run, **other)


STATE = ["quaternion", "omega_b", "position", "velocity"]
CASES = {
    "beam from rest": (BEAM, about(2, 0.3, 0.0), GRAVITY),
    "beam, tiny swing": (BEAM, about(2, math.pi / 2 - 1e-6, 0.0), GRAVITY),
    "beam, from nearly the top": (BEAM, about(2, -math.pi / 2 + 1e-7, 0.0), GRAVITY),
    "hung, swinging": (HUNG, about(1, 0.4, -2.0), GRAVITY),
    "hung, nearly over": (HUNG, about(1, 1.0, 4.6), GRAVITY),
    "hung, turning over": (HUNG, about(1, 2.0, 7.0), GRAVITY),
    "hung, turning over backwards": (HUNG, about(1, -0.5, -60.0), GRAVITY),
    "pushed beside the centre": (PUSHED, about(2, 1.2, 1.0) | {"velocity": [1.0, 2.0, 3.0]},
                                 NO_GRAVITY | {"force_a": [0.3, 0.0, -2.0]}),
}  # fmt: skip


@pytest.mark.thorough
@pytest.mark.parametrize("name", some_of([*CASES], 2))
@pytest.mark.parametrize("steps", [1, 16])
def test_a_pendulum_is_that_of_40_digits(name, steps):
    """However long the steps; rates relative to the largest, also of a tiny swing."""
    body, initial, loads = CASES[name]
    scene = scene_of(body, initial, loads, run=RUN | {"step": RUN["stop"] / steps})
    assert plan(scene).model == MODEL
    result = rbfmu.simulate(scene)
    zero = np.zeros((steps + 1, 3))
    errors = reference.errors(reference.motion(scene, result.time.tolist()), result.quaternion, result.omega_b,
                              getattr(result, "position", zero), getattr(result, "velocity", zero))  # fmt: skip
    assert errors["attitude"] <= 8 * EPS
    assert errors["omega_b"] <= 16 * EPS
    if "pivot" not in body:
        assert max(errors["position"], errors["velocity"]) <= 8 * EPS
    norms = np.linalg.norm(result.quaternion, axis=1)
    assert np.max(np.abs(norms - 1.0)) <= 6 * EPS


@pytest.mark.parametrize("angle", [math.pi / 2, -math.pi / 2])
def test_a_beam_hung_or_balanced_exactly_stays(angle):
    unit = Unit(scene_of(BEAM, {}), Plan(MODEL, "", 2))
    unit["quaternion_0"] = [1.0, 0.0, math.copysign(1.0, angle), 0.0]
    assert unit.kernels.initialize(unit.z) == 0
    q = unit["quaternion"]
    unit.step(0.7, times=100)
    assert np.max(np.abs(unit["quaternion"] - q)) <= 2 * EPS
    assert not np.any(unit["omega_b"])


@pytest.mark.parametrize("factor", [1e-160, 3.0, 1e150])
def test_an_attitude_of_any_length_swings_alike(factor):
    ends = []
    for scale in (1.0, factor):
        unit = Unit(scene_of(HUNG, {}), Plan(MODEL, "", 2))
        unit["quaternion_0"] = np.array([0.8, 0.4, 0.0, 0.0]) * scale
        assert unit.kernels.initialize(unit.z) == 0
        ends.append(unit.step(0.3, times=7)["quaternion"])
    np.testing.assert_allclose(ends[1], ends[0], atol=16 * EPS)


@pytest.mark.parametrize("rate", [-2.0, 7.0, -40.0])
def test_the_quaternion_has_no_jumps_of_sign(rate):
    unit = Unit(scene_of(HUNG, about(1, 3.0, rate)))
    for _ in range(300):
        before = unit["quaternion"]
        assert unit.step(0.01)["quaternion"] @ before > 0.97


@pytest.mark.parametrize("steps", [1, 1024])
def test_millions_of_swings_later_the_motion_is_as_exact(steps):
    """After 2^22 s at 2.3 rad/s; neither the moment about the pivot nor the weight's lever is a double."""
    scene, t = scene_of(HUNG, about(1, 0.4, -2.0)), 2.0**22
    unit = Unit(scene).step(t / steps, times=steps)
    with mp.workdps(60):
        (r_y, r_z), mass, (e, x) = map(mp.mpf, HUNG["r_oc_b"][1:]), mp.mpf(2), map(mp.mpf, scene.initial.quaternion[:2])
        w_0 = mp.sqrt(mass * mp.mpf(9.81) * mp.hypot(r_y, r_z) / (1 + mass * (r_y**2 + r_z**2)))
        lowest = (mp.atan2(r_z, r_y) + mp.pi / 2) / 2
        half = mp.atan2(x, e) + lowest
        sine, cosine, rate = truth(w_0 * mp.sin(half), mp.mpf(-1), w_0 * mp.cos(half), t)
        half = mp.atan2(sine, cosine) - lowest
        assert attitude_error(unit["quaternion"], [float(mp.cos(half)), float(mp.sin(half)), 0.0, 0.0]) <= 8 * EPS
        assert abs(unit["omega_b"][0] - float(rate)) <= 16 * EPS


def test_damping_keeps_the_series_and_damping_too_weak_to_see_does_not():
    damped = GRAVITY | {"damping_b": [0.01, 0.0, 0.0]}
    assert plan(scene_of(HUNG, about(1, 0.4, -2.0), damped)).model == "one swinging axis"
    weakly = GRAVITY | {"damping_b": [1e-15, 0.0, 0.0]}
    assert plan(scene_of(HUNG, about(1, 0.4, -2.0), weakly)).model == MODEL


@pytest.mark.thorough
@pytest.mark.parametrize("kind", [pytest.param("python", marks=pytest.mark.thorough), "native"])
def test_an_fmu_of_a_pendulum_takes_another_start_and_refuses_damping(kind, tmp_path):
    scene = scene_of(HUNG, about(1, 0.4, -2.0), outputs={"quantities": ["quaternion", "omega_b"]})
    path = rbfmu_fmu.build(scene, tmp_path / f"{kind}.fmu", kind)
    assert rbfmu_fmu.verify(path).passed
    fmu = Fmu(unzipped_at(path, tmp_path / kind))
    for values, answer in (({"omega_b_0[1]": 1.5}, True), ({"omega_b_0[2]": 1e-3}, False)):
        instance = fmu.instance()
        assert instance.setup() == OK
        assert instance.enter() == OK
        assert instance.set(values) == OK
        assert (instance.exit() == OK) == answer
        if not answer:
            assert instance.exit() >= ERROR
            assert 'list "omega_b_0" under parameters' in " ".join(message[-1].decode() for message in instance.log)
