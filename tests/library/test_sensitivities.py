"""Derivatives of motions by numbers of their scenes: against differences in quadruple precision, and known ones."""

import csv
import math
import pickle
import tomllib

import numpy as np
import pytest

import rbfmu
from rbfmu.models.formulas import FormulaModel
from rbfmu.sensitivities import Varied
from rbfmu_kernels.buffer import NO_OUTPUTS, OK
from tests.support.paths import ROOT
from tests.support.quadruple import reference, slopes
from tests.support.quadruple.scenes import random_scene
from tests.support.scenes.balls import ball

BODY = {"mass": 2.0, "inertia": [1.0, 2.0, 3.0]}
TURNED_BEAM = (np.eye(3) - np.outer((1, 2, 2), (1, 2, 2)) / 9.0).tolist()
"""Its least moment comes out above zero by round-off."""


def scene(loads=None, **tables):
    known = {"body": BODY, "initial": {"omega_b": [0.0, 0.0, 1.0]}, "loads": loads or {},
             "outputs": {"quantities": ["quaternion", "omega_b"]}, "run": {"stop": 2.0, "step": 0.25}}  # fmt: skip
    return rbfmu.Scene.from_dict(known | tables)


@pytest.mark.thorough
@pytest.mark.skipif(reference.library() is None, reason="needs a C compiler with quadruple precision")
@pytest.mark.parametrize("seed", [9001, 9009, 9013, 9021])
def test_derivatives_are_those_of_quadruple_precision(seed):
    """Of a swing, a body under loads, a weight off centre and a thrust that turns with the body."""
    _, one = random_scene(seed)
    one = one.replace({"run.accuracy": 1e-9, "inputs": {}})
    error, output, number = slopes.worst(one, slopes.chosen(one))
    assert error < 1e-6, (output, number)


def test_the_motion_is_that_of_a_run():
    one = scene({"torque_b": "-k*norm(omega_b)*omega_b + [0.1, 0, 0]*sin(3*t)"}, constants={"k": 0.1})
    planned = rbfmu.plan(one)
    found, run = rbfmu.sensitivity(one, ["constants.k"], planned), rbfmu.simulate(one, planned=planned)
    np.testing.assert_array_equal(found.time, run.time)
    np.testing.assert_array_equal(found.values["omega_b"], run.omega_b)
    np.testing.assert_array_equal(found.values["quaternion"], run.quaternion)


def test_the_places_of_errors_take_none_of_the_motion_s():
    """One of them and one of the events had one name: steps began by writing over whatever stood at that number."""
    text = "body = { mass = 1, inertia = [1, 2, 2.5] }\ninitial = { omega_b = [1, 2, 3] }\nevents.e.when = 'omega_b[1]'"
    model = Varied(rbfmu.Scene.from_dict(tomllib.loads(text)), ["initial.omega_b"]).model
    of_motion = FormulaModel._places.fget(model)
    assert "EVENT_SIDES" in of_motion
    assert {name: model._places[name] for name in of_motion} == of_motion


def test_a_switch_moves_in_time_and_a_corner_without_a_jump_leaves_derivatives_as_they_are():
    """omega_3 = 1 + 2 t / 3 up to t = k, then - t / 3: its derivative by k jumps from 0 to 1 / 3 + 2 / 3."""
    switch, corner = (rbfmu.sensitivity(scene({"torque_b": text}, constants={"k": 0.9}), ["constants.k"])
                      for text in ("where(t > k, -1, 2)*[0, 0, 1]", "abs(t - k)*[0, 0, 3]"))  # fmt: skip
    t = switch.time
    for found, expected in (
        (switch.of["omega_b"], np.where(t > 0.9, 1.0, 0.0)), (switch.of["attitude"], np.maximum(t - 0.9, 0.0)),
        (corner.of["omega_b"], np.minimum(t, 1.8 - t)),
    ):  # fmt: skip
        np.testing.assert_allclose(found[:, 2, 0], expected, rtol=0, atol=1e-13)


@pytest.mark.parametrize("interpolate", ["hold", "linear"])
def test_a_switch_moves_where_it_comes_at_a_row_of_inputs(interpolate):
    """2026-11-28: one that came later than the row by round-off was passed over, and the derivative stayed 1."""
    ports, rows = {"ports": [{"name": "u", "size": 1, "unit": ""}]}, {"u": (np.arange(4) / 10, [[0], [1], [3], [2]])}
    one = scene({"torque_b": "[0, 0, where(omega_b[3] > 1.9, -3, -9) + 0*u]"}, inputs=ports,
                initial={"omega_b": [0, 0, 2]}, run={"stop": 0.3, "step": 0.1})  # fmt: skip
    found = rbfmu.sensitivity(one, ["initial.omega_b[3]"], inputs=rows, interpolate=interpolate)
    np.testing.assert_allclose(found.of["omega_b"][:, 2, 0], [1.0, 3.0, 3.0, 3.0], rtol=0, atol=1e-12)


def test_an_event_that_jumps_over_zero_does_not_shift_as_a_root_does():
    """2026-11-28: the last row was that of a root at the slopes of what jumps: 0 with the input, 1 without."""
    ports, rows = {"ports": [{"name": "u", "size": 1, "unit": ""}]}, {"u": ([0.0, 0.3, 2.0], [[0], [1], [1]])}
    one = scene({"torque_b": [0, 0, -3]}, events={"end": {"when": "omega_b[3] - u", "stop": True}}, inputs=ports)
    found = rbfmu.sensitivity(one, ["initial.omega_b[3]"], inputs=rows)
    np.testing.assert_allclose(found.of["attitude"][:, 2, 0], found.time, rtol=0, atol=1e-12)
    assert found.time[-1] == pytest.approx(0.3, abs=1e-12)
    text = "where(omega_b[3] > 0.67, 1, -1)*(1 + 0.1*t) + 0*u"
    one = scene({"torque_b": [0, 0, -3]}, events={"end": {"when": text, "stop": True}}, inputs=ports)
    for row, interpolate in ((0.335, "hold"), (0.33, "linear")):  # a jump soon after the event at 0.33 s; a bend at it
        rows = {"u": ([0.0, row, 2.0], [[0], [1], [1]])}
        with pytest.raises(ValueError, match="end: expected one that comes to zero"):
            rbfmu.sensitivity(one, ["initial.omega_b[3]"], inputs=rows, interpolate=interpolate)


@pytest.mark.parametrize("potential", [
    "0.4*k*max(-position[3], 0)**2.5", "where(position[3] < 0, 0.4*k*(-position[3])**2.5, 0)",
])  # fmt: skip
def test_a_contact_by_the_law_of_hertz_has_derivatives(potential):
    """2026-12-01: the second was refused for what it does not select: a force of 0 times a root of less than zero.

    As a potential it was refused as well: the derivative of a half power is 0/0 by those of root and products.

    A ball is back after tau = 2 d/v times the integral of dx/sqrt(1 - x**2.5) over [0, 1], with d**2.5 = 1.25 v**2/k.
    """
    k, v, z, stop = 400.0, 2.0, 0.3, 0.8
    tables = {"initial": {"position": [0.0, 0.0, z], "velocity": [0.0, 0.0, -v]}, "constants": {"k": k},
              "loads": {"gravity_a": [0, 0, 0], "potential": potential}}  # fmt: skip
    one = ball(stop=stop, step=0.4, accuracy=1e-9, shows=["position"], **tables)
    found = rbfmu.sensitivity(one, ["constants.k", "initial.position"])
    tau = 2.0 / v * (1.25 * v**2 / k) ** 0.4 * math.sqrt(math.pi) * math.gamma(1.4) / math.gamma(0.9)
    assert found.values["position"][-1, 2] == pytest.approx(v * (stop - tau) - z, rel=0, abs=1e-9)
    np.testing.assert_allclose(found.of["position"][-1, 2, [0, 3]], [0.4 * v * tau / k, -1.0], rtol=1e-7)


@pytest.mark.parametrize("condition", ["(t - k)**2*(t - 1.5) > 0", "(t - k)**2*exp(-t) > 0"])
def test_what_a_condition_comes_to_and_goes_back_from_does_not_move(condition):
    """2026-11-28: by round-off it turns for 4e-16 s, at whose end no corner was seen: the derivative was 2."""
    one = scene({"torque_b": f"where({condition}, 3, -3)*[0, 0, 1]"}, constants={"k": 1.0})
    np.testing.assert_allclose(rbfmu.sensitivity(one, ["constants.k"]).of["omega_b"][-1, 2], 0.0, rtol=0, atol=1e-6)


@pytest.mark.parametrize("beside", ["abs(u)", "max(u, 0)", "where(x > 0, 3, 1)"])
def test_what_is_zero_all_along_takes_no_corner_from_others(beside):
    """2026-11-28: a port at zero was at its corner wherever a series ended, and the switch did not move."""
    ports, states = {"ports": [{"name": "u", "size": 1, "unit": ""}]}, {"x": {"start": 0.0, "rate": "0*t"}}
    one = scene(
        {"torque_b": f"[0, 0, {beside} + where(t > k, -1, 2)]"}, constants={"k": 0.9}, inputs=ports, states=states
    )
    assert rbfmu.sensitivity(one, ["constants.k"]).of["omega_b"][-1, 2, 0] == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize(("beside", "derivative"), [("where(t > k, 3, 0)", 0.0), ("abs(t - 1)", None)])
def test_of_corners_at_one_time_that_move_apart_no_derivative_is_given(beside, derivative):
    """2026-11-28: all that jumps there moved with the first of them: it was 0 beside abs(t - 1)."""
    events, constants = {"first": "2 - 2*t"}, {"k": 1.0}
    one = scene({"torque_b": f"[0, 0, {beside} + where(t > k, -1, 2)]"}, constants=constants, events=events)
    if derivative is None:
        with pytest.raises(ValueError, match="meets no two at one time"):
            rbfmu.sensitivity(one, ["constants.k"])
    else:
        found = rbfmu.sensitivity(one, ["constants.k"]).of["omega_b"][-1, 2, 0]
        assert found == pytest.approx(derivative, abs=1e-12)


def test_the_last_row_is_that_at_the_event_which_moves():
    """At its end the rate is the level, whatever it began with, and the angle is 3 (omega_0 - level) / c."""
    events = {"slow": {"when": "omega_b[3] - level", "stop": True}}
    one = scene({"torque_b": "-c*omega_b"}, constants={"level": 0.5, "c": 1.5}, events=events)
    found = rbfmu.sensitivity(one, ["initial.omega_b[3]", "constants.level", "constants.c"])
    assert found.time[-1] == pytest.approx(2.0 * np.log(2.0), abs=1e-12)
    np.testing.assert_allclose(found.of["omega_b"][-1, 2], [0.0, 1.0, 0.0], rtol=0, atol=1e-10)
    np.testing.assert_allclose(found.of["attitude"][-1, 2], [2.0, -2.0, -1.0 / 1.5], rtol=0, atol=1e-9)


def test_at_the_event_a_port_that_changes_along_a_line_counts():
    """The port u = t reaches the level where omega_3 is 1 + level^2 / 6, and its rate level / 3."""
    port = {"name": "u", "size": 1}
    one = scene({"torque_b": "[0, 0, u]"}, constants={"level": 0.7}, inputs={"ports": [port]},
                events={"there": {"when": "u - level", "stop": True}},
                outputs={"quantities": ["omega_b", "alpha_b"], "twice": "2*u"})  # fmt: skip
    found = rbfmu.sensitivity(one, ["constants.level"], inputs={"u": ([0.0, 2.0], [0.0, 2.0])}, interpolate="linear")
    last = [found.of[name][-1, -1, 0] for name in one.outputs.names]
    np.testing.assert_allclose(last, [0.7 / 3.0, 1.0 / 3.0, 2.0], rtol=0, atol=1e-12)


@pytest.mark.parametrize("before", [0.0, 1e-16, 1e-11])
def test_a_switch_where_a_port_jumps_moves_in_time(before):
    """What the port adds does not hang on k, wherever it jumps: beside the end of a step, or at it."""
    one = scene({"torque_b": "where(t > k, -1, 2)*[0, 0, 1]"}, constants={"k": 0.6 - before},
                inputs={"ports": ["torque_b"]})  # fmt: skip
    table = {"torque_b": ([0.0, 0.6, 1.3], [[0.0, 0.0, 0.1], [0.0, 0.0, 0.5], [0.0, 0.0, 0.0]])}
    found = rbfmu.sensitivity(one, ["constants.k"], inputs=table)
    expected = np.where(found.time > 0.6, 1.0, 0.0)
    np.testing.assert_allclose(found.of["omega_b"][:, 2, 0], expected, rtol=0, atol=1e-13)


@pytest.mark.thorough
@pytest.mark.parametrize("accuracy", [1e-5, 1e-8])
def test_errors_that_turn_much_faster_than_the_motion_are_followed(accuracy):
    """A flywheel runs down smoothly; a rate across its axis turns about it by (I_z/I_x - 1) times its angle."""
    wheel = rbfmu.load_scene(ROOT / "examples/scenes/flywheel.toml")
    found = rbfmu.sensitivity(wheel.replace({"run.stop": 20.0, "run.accuracy": accuracy}), ["initial.omega_b[2]"])
    across = 20.0 * (3.0 * 0.2**2 + 0.05**2) / 12.0
    turned = (0.4 / across - 1.0) * 100.0 * 20.0 * -np.expm1(-found.time / 20.0)
    exact = np.stack([-np.sin(turned), np.cos(turned), 0.0 * turned], axis=1)
    np.testing.assert_allclose(found.of["omega_b"][:, :, 0], exact, rtol=0.0, atol=accuracy)


def test_roll_pitch_and_yaw_have_derivatives():
    one = scene(initial={"omega_b": [0.1, 0.5, 1.0]}, outputs={"quantities": ["rpy"]})
    found = rbfmu.sensitivity(one, ["initial.omega_b[2]"])
    rpy = [rbfmu.simulate(one.replace({"initial.omega_b": [0.1, 0.5 + d, 1.0]})).rpy for d in (1e-4, -1e-4)]
    np.testing.assert_allclose(found.of["rpy"][:, :, 0], (rpy[0] - rpy[1]) / 2e-4, rtol=0, atol=1e-7)


def test_a_covariance_is_carried_along():
    one = scene(initial={"omega_b": [0.1, 0.5, 1.0]})
    deviations = np.array([0.01, -0.013, 0.017])
    covariance = np.outer(deviations, deviations)  # what moves together has sums without variance, but for round-off
    found = rbfmu.sensitivity(one, ["initial.omega_b"], covariance=covariance)
    S = found.of["omega_b"][5]
    np.testing.assert_allclose(found.covariance["omega_b"][5], S @ covariance @ S.T, rtol=1e-12)
    with pytest.raises(ValueError, match="variances of at least 0, also of sums"):
        rbfmu.sensitivity(one, ["initial.omega_b"], covariance=covariance + 3e-4 * (1.0 - np.eye(3)))
    with pytest.raises(ValueError, match=r"covariance: expected a matrix \(3, 3\) for initial.omega_b\[1\]"):
        rbfmu.sensitivity(one, ["initial.omega_b"], covariance=[1.0])
    for wrong in (math.nan, -1.0, -1e-12):
        with pytest.raises(ValueError, match="covariance: expected finite numbers"):
            rbfmu.sensitivity(one, "body.mass", covariance=[[wrong]])
    with pytest.raises(ValueError, match="a symmetric matrix"):
        rbfmu.sensitivity(one, ["initial.omega_b"], covariance=covariance + np.triu(covariance[:1]))
    lopsided = [[1e6, 0.0, 0.0], [0.0, 1e-12, 5e-13], [0.0, 0.0, 1e-12]]
    with pytest.raises(ValueError, match="a symmetric matrix"):
        rbfmu.sensitivity(one, ["initial.omega_b"], covariance=lopsided)


def test_a_motion_that_slides_along_a_corner_is_said_to():
    """It was said that a step is not finite."""
    with pytest.raises(rbfmu.SceneError, match="torque_b slides along a corner"):
        rbfmu.sensitivity(scene({"torque_b": "[0, 0, where(omega_b[3] > 0.9, -1, 0.5)]"}), "initial.omega_b")


@pytest.mark.slow
def test_a_motion_that_grows_beyond_all_bounds_is_refused_as_a_run_of_it_is():
    """Its derivatives went on, in ever shorter substeps, for hours."""
    one = scene({"torque_b": "5*omega_b"}, initial={"omega_b": [0.3, 1.2, 0.2]}, run={"stop": 20.0, "step": 0.5})
    with pytest.raises(rbfmu.SceneError, match=r"run\.stop = 20\.0: expected a shorter run"):
        rbfmu.sensitivity(one, "initial.omega_b")


def test_a_motion_of_too_many_substeps_is_refused_without_formulas_too(monkeypatch):
    """A thin rod that a torque spins up took hours; a run of it is refused when it is planned."""
    monkeypatch.setattr("rbfmu.planning.judge.MAX_SUBSTEPS", 50.0)
    rod = ball(stop=10.0, body={"mass": 1.0, "inertia": [1e-4, 1.0, 1.0]}, loads={"torque_b": [0.01, 0.0, 0.0]})
    with pytest.raises(rbfmu.SimulationError, match=r" s takes \S+ substeps: expected a shorter run or slower rates"):
        rbfmu.sensitivity(rod, "initial.omega_b")


def test_an_inertia_has_the_numbers_that_are_not_zero():
    along_axes, full = scene(), scene(body={"mass": 2.0, "inertia": [[1.0, 0.1, 0.0], [0.1, 2.0, 0.0], [0, 0, 2.5]]})
    assert rbfmu.sensitivity(along_axes, ["body.inertia"]).numbers == tuple(f"body.inertia[{k},{k}]" for k in (1, 2, 3))
    assert len(rbfmu.sensitivity(full, ["body.inertia"]).numbers) == 6
    assert rbfmu.sensitivity(along_axes, ["body.inertia[1,3]"]).numbers == ("body.inertia[1,3]",)


@pytest.mark.parametrize(("by", "tables", "said"), [
    ([], {}, "by: expected at least one key"),
    (["initial.omega_b", "initial.omega_b[2]"], {}, r"by: expected each number once, not initial.omega_b\[1\]"),
    (["body.shape"], {}, "by = 'body.shape': expected one of initial.attitude, body.mass"),
    (["initial.omega_b[4]"], {}, r"by = 'initial.omega_b\[4\]': expected one of initial.omega_b\[1\]"),
    (["loads.torque_b"], {"loads": {"torque_b": "[t, 0, 0]"}}, "formulas or a potential make this one"),
    (["body.inertia"], {"body": {"mass": 1.0, "inertia": [1, 1, 0]}, "initial": {}}, "a slender beam"),
    (["body.inertia"], {"body": {"mass": 1.0, "inertia": TURNED_BEAM}, "initial": {}}, "a slender beam"),
    (["initial.omega_b"], {"outputs": {"off": "norm(to_b([0, 0, 1]) - [0, 0, 1])"}}, "zero at the start have no"),
    (["initial.attitude"], {"body": None, "inputs": {"ports": ["omega_b"]}, "outputs": {}, "initial": {}},
     "expected a scene with a body"),
])  # fmt: skip
def test_what_cannot_vary_is_said(by, tables, said):
    tables = {name: table for name, table in tables.items() if table is not None}
    one = scene(**tables) if "inputs" not in tables else rbfmu.Scene.from_dict(tables)
    with pytest.raises(ValueError, match=said):
        rbfmu.sensitivity(one, by)


def test_a_refused_start_is_known_by_its_number():
    """Of whatever text; other errors have none."""
    one = scene(outputs={"quantities": ["omega_b"], "off": "1/norm(position)"})
    with pytest.raises(rbfmu.SceneError) as caught:
        rbfmu.simulate(one)
    assert caught.value.code == pickle.loads(pickle.dumps(caught.value)).code == NO_OUTPUTS
    with pytest.raises(rbfmu.SceneError) as other:
        one.replace({"run.stop": -1.0})
    assert other.value.code == OK


@pytest.mark.parametrize("name", ["attitude", "errors", "slopes", "numbers"])
def test_an_output_that_would_take_the_place_of_derivatives_is_refused(name):
    """One called attitude stood in place of the derivatives of the attitude, without a word."""
    one = scene(outputs={"quantities": ["quaternion"], name: "omega_b[1]"})
    with pytest.raises(rbfmu.SceneError, match=rf"outputs\.{name}: expected another name"):
        rbfmu.sensitivity(one, ["initial.omega_b"])


def test_they_are_saved_and_drawn(tmp_path):
    found = rbfmu.sensitivity(scene(), ["initial.omega_b", "initial.attitude"])
    found.save(tmp_path / "s.npz")
    with np.load(tmp_path / "s.npz") as saved:
        np.testing.assert_array_equal(saved["omega_b"], found.of["omega_b"])
    found.save(tmp_path / "s.csv")
    with (tmp_path / "s.csv").open() as file:
        rows = [*csv.DictReader(file)]
    for i, j in np.ndindex(3, 3):
        column = [float(row[f"omega_b[{i + 1}] by initial.omega_b[{j + 1}]"]) for row in rows]
        assert column == found.of["omega_b"][:, i, j].tolist()
    with pytest.raises(ValueError, match=r"must end in \.csv or \.npz"):
        found.save(tmp_path / "s.txt")
    axes = found.plot().axes
    assert [line.get_label() for line in axes[0].lines] == ["initial.omega_b", "initial.attitude"]
    legend = rbfmu.sensitivity(scene(), ["initial.omega_b", "body.mass"]).plot().axes[0].get_legend()
    assert [text.get_text() for text in legend.get_texts()] == ["initial.omega_b", "body.mass: without effect"]


def test_a_change_is_one_percent_of_the_largest_number_of_a_key():
    found = rbfmu.sensitivity(scene(initial={"omega_b": [0.0, 0.0, 3.0]}), ["initial.omega_b", "initial.attitude"])
    change = found.changes("omega_b")
    assert change["initial.omega_b"][0] == pytest.approx(0.03 * np.sqrt(3.0))
    assert change["initial.attitude"][0] == 0.0
    assert found.changes("attitude")["initial.attitude"][0] == pytest.approx(0.01 * np.sqrt(3.0))
    one = rbfmu.sensitivity(scene(), ["body.inertia[1,1]"])
    assert [*one.changes("omega_b")] == [*one.numbers] == ["body.inertia[1,1]"]


def test_a_run_that_stops_at_a_communication_point_has_it_once():
    """It falls 5 m in 1 s, two steps of 0.5 s."""
    falls = {"initial": {"position": [0, 0, 5.0]}, "loads": {"gravity_a": [0, 0, -10.0]},
             "events": {"hit": {"when": "position[3]", "direction": "falling", "stop": True}}}  # fmt: skip
    one = ball(stop=3.0, accuracy=1e-9, shows=["position"], **falls)
    along = rbfmu.sensitivity(one, ["initial.position"])
    assert along.time.tolist() == rbfmu.simulate(one).time.tolist() == [0.0, 0.5, 1.0]


@pytest.mark.parametrize("order", [6, 8])
def test_a_plan_that_is_not_by_series_leaves_the_order_to_derivatives(order):
    one, by = scene(), ["initial.omega_b"]
    planned = rbfmu.Plan("symmetric top" if order == 6 else "torque-free body, body force", "", 7, 0.1, order=order)
    found, own = rbfmu.sensitivity(one, by, planned), rbfmu.sensitivity(one, by)
    np.testing.assert_array_equal(found.of["attitude"], own.of["attitude"])
