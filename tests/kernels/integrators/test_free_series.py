"""Series about exact states of a free body: as exact as the closed form at every output, saved, refused, uncompiled."""

import math

import numpy as np
import pytest

from rbfmu.runs.plan import Plan
from rbfmu.scene.scene import Scene
from rbfmu_kernels.buffer import OK, STEP_REJECTED
from rbfmu_kernels.compile.tiered import interpreted
from rbfmu_kernels.integrators.dense_output import VALID
from rbfmu_kernels.models.free import FREE_TRIAXIAL
from tests.support.covering import some_of
from tests.support.references.free_rotation_mp import angle_to, closed_form, relative_distance
from tests.support.scenes import model_cases
from tests.support.sources import assert_same_in_plain_python

EPS = 2.0**-52
LEANING = (0.5, 0.5, 0.5, 0.5)
BODIES = {
    "generic": ((1.0, 2.0, 3.0), (0.3, 1.0, 0.2)), "flipping": ((1.0, 2.0, 3.0), (1e-4, 2.0, 1e-4)),
    "in another order": ((2.5, 1.0, 2.0), (1.0, -2.0, 0.5)), "a thin rod": ((1e-6, 1.0, 1.0000005), (3.0, 0.4, -0.7)),
    "nearly round": ((1.0, 1.0 + 1e-9, 1.5), (0.7, 0.2, 2.0)), "fast": ((1.0, 2.0, 2.5), (20.0, -30.0, 10.0)),
    "slow": ((1e9, 2e9, 2.5e9), (1e-5, 2e-5, -1e-5)),
}  # fmt: skip


class Unit(model_cases.Unit):
    """A free body in closed form."""

    def __init__(self, name="generic", wanted=("quaternion", "omega_b"), **more):
        moments, omega = BODIES[name]
        tables = {"body": {"mass": 2.0, "inertia": list(moments)}, "loads": {"gravity_a": [0.0, 0.0, -9.81]},
                  "initial": {"omega_b": list(omega), "velocity": [1.0, 2.0, 3.0],
                              "attitude": {"quaternion": list(LEANING)}},
                  "outputs": {"quantities": list(wanted)}, "run": {"stop": 10.0}}  # fmt: skip
        super().__init__(Scene.from_dict(tables | more, name), Plan("torque-free body", "", 4))

    @property
    def is_on_series(self):
        return self["validity"] == VALID and self["since"][0] > 0.0

    @property
    def outputs(self):
        return np.concatenate([self[name] for name in ("quaternion", "omega_b")])


def steps_of(name):
    """Return a step some fifty times shorter than series reach, a power of two."""
    return 2.0 ** math.floor(math.log2(0.01 / np.linalg.norm(BODIES[name][1])))


@pytest.mark.thorough
@pytest.mark.parametrize("name", some_of([*BODIES], 3))
def test_every_output_is_exact(name):
    """Against 90 digits, at random steps of some hundred radians."""
    unit, h, done, served = Unit(name), steps_of(name), 0, 0
    for k in np.sort(np.random.default_rng(5).integers(1, 15000, 25)).tolist():
        unit.step(h, k - done)
        done = k
        served += unit.is_on_series
        q, omega = closed_form(*BODIES[name][:1], LEANING, BODIES[name][1], k * h)
        assert angle_to(unit["quaternion"], q) <= 10 * EPS
        assert relative_distance(unit["omega_b"], omega) <= 10 * EPS
    assert served >= 20


@pytest.mark.parametrize("name", ["generic", "flipping", "fast"])
def test_outputs_are_those_of_the_closed_form(name):
    """Of steps that are too long for series."""
    unit, exact, h = Unit(name), Unit(name), steps_of(name)
    for _ in range(40):
        unit.step(h, 64)
        exact.step(64 * h)
        assert not exact.is_on_series
        np.testing.assert_allclose(unit["quaternion"], exact["quaternion"], rtol=0.0, atol=10 * EPS)


@pytest.mark.thorough
def test_steps_may_change_size():
    unit, rng, t = Unit(), np.random.default_rng(2), 0.0
    for k in range(400):
        h = float(rng.integers(1, 40 if k % 50 else 4000)) * 2.0**-10
        unit.step(h)
        t += h
        if k % 20 == 19:
            q, omega = closed_form(BODIES["generic"][0], LEANING, BODIES["generic"][1], t)
            assert angle_to(unit["quaternion"], q) <= 10 * EPS
            assert relative_distance(unit["omega_b"], omega) <= 10 * EPS


def test_damping_that_a_plan_has_left_out_makes_no_steps_in_the_rate():
    unit = Unit()
    unit["damping_b"], unit["skip_model_checks"] = [1e-5, 1e-5, 1e-5], 1.0
    h = np.array([np.linalg.norm(unit.step(0.01)["omega_b"] * BODIES["generic"][0]) for _ in range(400)])
    assert unit.is_on_series
    np.testing.assert_allclose(h, h[0], rtol=10 * EPS)


def test_a_copy_in_mid_series_goes_on_with_the_same_bits():
    unit = Unit().step(0.01, 17)
    assert unit.is_on_series
    saved = unit.z.copy()
    first = unit.step(0.01, 120).step(3.0).step(0.005, 9).z.copy()
    unit.z[:] = saved
    np.testing.assert_array_equal(unit.step(0.01, 120).step(3.0).step(0.005, 9).z, first)


@pytest.mark.parametrize("change", ["torque_b", "force_a"])
def test_a_refused_step_leaves_a_series_as_it_was(change):
    wanted = ("quaternion", "omega_b", "position")
    unit, other = (Unit(wanted=wanted).step(0.01, 11) for _ in range(2))
    before = unit.z.copy()
    unit[change] = [math.inf, 0.0, 0.0]
    assert FREE_TRIAXIAL.step(unit.z, 0.01) == STEP_REJECTED
    unit[change] = [0.0, 0.0, 0.0]
    np.testing.assert_array_equal(unit.z, before)
    for _ in range(100):
        np.testing.assert_array_equal(unit.step(0.01).outputs, other.step(0.01).outputs)


def test_derivatives_of_outputs_are_those_of_the_last_step():
    """Whether the closed form or a series served it."""
    unit, exact = Unit(wanted=("quaternion", "alpha_b")).step(0.0078125, 20), Unit(wanted=("quaternion", "alpha_b"))
    exact.step(20 * 0.0078125)
    assert unit.is_on_series
    for one in (unit, exact):
        assert FREE_TRIAXIAL.output_rates(one.z) == 0
    for name in ("d_quaternion", "d_omega_b", "d_alpha_b"):
        np.testing.assert_allclose(unit[name], exact[name], rtol=0.0, atol=40 * EPS)


@pytest.mark.parametrize("body", [
    {"inertia": [[1.0, 0.1, 0.0], [0.1, 2.0, 0.0], [0.0, 0.0, 2.5]]}, {"inertia": [1.0, 2.0, 2.5], "pivot": True},
])  # fmt: skip
def test_moments_that_doubles_round_keep_to_the_closed_form(body):
    unit = Unit(body={"mass": 2.0} | body, initial={"omega_b": [0.3, 1.0, 0.2]}).step(0.01, 30)
    assert not unit.is_on_series


def test_what_does_not_show_the_attitude_keeps_to_the_closed_form():
    assert not Unit(wanted=("omega_b",)).step(0.01, 30).is_on_series


BITS = """
from tests.kernels.integrators.test_free_series import BODIES, Unit, steps_of
for name in BODIES:
    print(Unit(name).step(steps_of(name), 100).outputs.tobytes().hex())
"""


@pytest.mark.thorough
def test_plain_python_has_the_same_bits():
    assert_same_in_plain_python(BITS, len(BODIES))


def test_a_short_run_that_is_not_compiled_has_the_same_bits():
    plain, unit = interpreted(FREE_TRIAXIAL.step), Unit()
    z = unit.z.copy()
    for _ in range(100):
        assert plain(z, 0.01) == OK
    np.testing.assert_array_equal(unit.step(0.01, 100).z, z)
