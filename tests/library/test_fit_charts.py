"""How numbers vary in a fit: inside what a body can have, in units of their own, attitudes by turns."""

import numpy as np
import pytest

import rbfmu
from rbfmu.identification.charts import changes, chart_of


@pytest.mark.parametrize("inertia", [[1.0, 2.0, 2.5], [[1.0, 0.1, 0.2], [0.1, 1.5, -0.3], [0.2, -0.3, 2.0]]])
def test_an_inertia_stays_one_that_a_body_can_have(inertia):
    scene = rbfmu.Scene(body={"mass": 1.0, "inertia": inertia})
    chart = chart_of(scene, "body.inertia")
    rng = np.random.default_rng(1)
    for p in rng.normal(size=(50, chart.count)) * 2.0:
        rbfmu.check_inertia(np.array(chart.value(p)))
    p, step = 0.1 * rng.normal(size=chart.count), 1e-6 * np.eye(chart.count)
    slopes = np.array([(chart.numbers(p + dp) - chart.numbers(p - dp)) / 2e-6 for dp in step]).T
    np.testing.assert_allclose(chart.slopes(p), slopes, rtol=0, atol=1e-8)
    np.testing.assert_allclose(chart.value(0.0 * p), scene.body.M_c, rtol=1e-14, atol=1e-14)


def test_an_inertia_shrinks_no_further_than_a_mass():
    """A search that came to a rod of 2e-12 kg m2 under a torque took hours: its rates grow by how thin it is."""
    scene = rbfmu.Scene(body={"mass": 2.0, "inertia": [1.0, 2.0, 2.5]})
    for key, lowest in (("body.mass", 2.0), ("body.inertia", 0.25)):
        chart = chart_of(scene, key)
        low, high = chart.bounds
        assert np.all(chart.numbers(np.minimum(low, 0.0)) > 1e-7 * lowest)
        assert np.all(chart.numbers(np.maximum(high, 0.0))[:3] > 1e6 * lowest)


def test_a_number_that_gets_a_larger_unit_stays_what_it_is():
    body = {"mass": 1.0, "inertia": [1.0, 2.0, 2.5]}
    scene, p = rbfmu.Scene(body=body, loads={"torque_b": [1.0, 0.0, 0.5]}), np.array([50.0, 0.0, 3.0])
    chart = chart_of(scene, "loads.torque_b")
    before = chart.numbers(p)
    assert chart.outgrown(p)
    np.testing.assert_allclose(chart.numbers(p), before, rtol=1e-15)
    assert p[0] == pytest.approx(50.0 / 51.0)
    assert not chart.outgrown(p)


def test_numbers_of_one_vector_that_are_free_one_by_one_all_change():
    scene = rbfmu.Scene(body={"mass": 1.0, "inertia": [1.0, 2.0, 2.5]}, initial={"omega_b": [4.0, 2.0, 1.0]})
    charts = [chart_of(scene, f"initial.omega_b[{k}]") for k in (1, 3)]
    assert changes(charts, np.array([0.5, -1.0])) == {"initial.omega_b": [6.0, 2.0, -3.0]}


def test_an_attitude_varies_by_turns_of_any_size():
    scene = rbfmu.Scene(
        body={"mass": 1.0, "inertia": [1.0, 2.0, 2.5]}, initial={"attitude": {"rotvec": [1.0, 2.0, 0.3]}}
    )
    chart, p = chart_of(scene, "initial.attitude"), np.array([0.8, -0.5, 1.1])

    def q_ab(x):
        return np.array(chart.value(x)["quaternion"])

    for k in range(3):
        dp = 1e-6 * np.eye(3)[k]
        turn = rbfmu.compose_quaternions(q_ab(p - dp) * [1, -1, -1, -1], q_ab(p + dp))
        np.testing.assert_allclose(chart.slopes(p)[:, k], turn[1:] / 1e-6, rtol=0, atol=1e-9)
