"""Scenes with formulas against SciPy's DOP853 on right-hand sides written by hand, and what they promise besides."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import rbfmu
from rbfmu.models.question import Question
from rbfmu.planning import reference
from rbfmu.planning.judge import Judge
from rbfmu.planning.methods import whole_series
from rbfmu.planning.reference import reference_motion
from rbfmu.runs.motion import attitude_error
from rbfmu.runs.plan import start_run
from rbfmu_kernels.compile.tiered import interpreted
from tests.support.command_line import call
from tests.support.covering import some_of
from tests.support.references.by_scipy import B, by_scipy, worst

A = {"attitude": {"quaternion": [0.8, 0.0, -0.6, 0.0]}, "omega_b": [0.3, -0.5, 0.9]}
MOVING = A | {"velocity": [0.1, 0.2, 0.3], "position": [1.0, 0.0, -0.5]}
ARM = np.array([0.2, 0.0, 0.1])
X, Y = (-1.0, -0.5, 0.0, 0.5, 1.0), (0.3, 0.4, 0.0, -0.4, -0.3)
CUBIC = CubicSpline(X, Y, bc_type="natural")


def scene(body=B, initial=MOVING, gravity=(0.0, 0.0, 0.0), quantities=("omega_b",), accuracy=1e-9, **tables):
    loads = {"gravity_a": list(gravity)} | tables.pop("loads", {})
    run = {"stop": 5.0, "step": 0.05, "accuracy": accuracy} | tables.pop("run", {})
    outputs = {"quantities": list(quantities)} | tables.pop("outputs", {})
    return {"body": body, "initial": initial, "loads": loads, "run": run, "outputs": outputs} | tables


def spring(t, R, w, p, v, own):
    arm = R @ ARM
    force = -5.0 * (p + arm)
    return {"force_a": force, "torque_a": np.cross(arm, force)}


def hull(t, R, w, p, v, own):
    depth = min(max(-p[2], 0.0), 1.0)
    drag = 3.0 * np.abs(v) * v if p[2] < 0.0 else np.zeros(3)
    return {"force_a": np.array([0.0, 0.0, 40.0 * depth]) - drag, "torque_b": -0.2 * np.abs(w) * w}


def square(name, factor):
    return "[" + ", ".join(f"{factor}*abs({name}[{k}])*{name}[{k}]" for k in (1, 2, 3)) + "]"


N = 0.3
CASES = {
    "gravity gradient": (
        scene(constants={"n": {"value": N, "unit": "rad/s"}}, formulas={"u_b": "to_b([cos(n*t), sin(n*t), 0])"},
              loads={"torque_b": "3*n**2 * cross(u_b, M_c @ u_b)"}, quantities=("quaternion", "omega_b")),
        lambda t, R, w, p, v, own: {"torque_b": 3 * N**2 * np.cross(
            u := R.T @ [math.cos(N * t), math.sin(N * t), 0.0], np.array(B["inertia"]) @ u)},
    ),
    "spring, thrust and a lag": (
        scene(constants={"k": 5.0, "c": 0.3, "tau": 0.7}, gravity=(0.0, 0.0, -9.81),
              loads={"force_a": "-k*position - c*norm(velocity)*velocity",
                     "force_b": ["[0, 0, 2*exp(-t/tau)]", "[u, 0, 0]"]},
              states={"u": {"start": 0.1, "rate": "(cos(t) - u)/tau"}}, quantities=("position", "quaternion"),
              outputs={"lag": {"value": "u", "unit": "N"}}),
        lambda t, R, w, p, v, own: {"force_a": -5 * p - 0.3 * np.linalg.norm(v) * v,
                                    "force_b": np.array([own[0], 0.0, 2 * math.exp(-t / 0.7)])},
    ),
    "functions at a pivot": (
        scene(body=B | {"pivot": True}, initial=A, gravity=(0.0, 0.0, -9.81), quantities=("quaternion", "omega_b"),
              loads={"damping_b": [0.1, 0.1, 0.1], "torque_b": "-[0.3*omega_b[1]*log(2 + omega_b[1]**2), "
                     "atan2(omega_b[2], 2), omega_b[3]*(1 + omega_b[3]**2)**0.3]"}),
        lambda t, R, w, p, v, own: {"torque_b": -np.array(
            [0.3 * w[0] * math.log(2 + w[0] ** 2), math.atan2(w[1], 2), w[2] * (1 + w[2] ** 2) ** 0.3])},
    ),
    "quadratic damping": (
        scene(loads={"torque_b": "-0.5*norm(omega_b)*omega_b"}, accuracy=1e-10),
        lambda t, R, w, p, v, own: {"torque_b": -0.5 * np.linalg.norm(w) * w},
    ),
    "spring by its potential": (
        scene(constants={"k": 5.0, "r": [0.2, 0.0, 0.1]}, gravity=(0.0, 0.0, -9.81),
              formulas={"end": "position + to_a(r)"}, loads={"potential": "0.5*k*dot(end, end)"},
              quantities=("position", "quaternion", "omega_b")),
        spring,
    ),
    "hull": (
        scene(body=B | {"r_oc_b": [0.0, 0.0, 0.0]}, initial=MOVING | {"position": [0.0, 0.0, 0.5]}, accuracy=1e-8,
              gravity=(0.0, 0.0, -9.81), quantities=("position", "omega_b"),
              formulas={"lift": "40*clip(-position[3], 0, 1)", "drag": "where(position[3] < 0, -3, 0)"},
              loads={"force_a": ["[0, 0, lift]", f"drag*{square('velocity', 1)}"],
                     "torque_b": square("omega_b", -0.2)}),
        hull,
    ),
    "a switch in time": (
        scene(loads={"torque_b": "[0, 0, where(t < 1.2345, 0.5, -0.3)]"}, accuracy=1e-10),
        lambda t, R, w, p, v, own: {"torque_b": np.array([0.0, 0.0, 0.5 if t < 1.2345 else -0.3])},
    ),
    "linear table": (
        scene(tables={"c": {"x": X, "y": Y}}, loads={"torque_b": "[table(c, omega_b[1]), 0, 0]"}),
        lambda t, R, w, p, v, own: {"torque_b": np.array([np.interp(w[0], X, Y), 0.0, 0.0])},
    ),
    "cubic table": (
        scene(tables={"c": {"x": X, "y": Y, "method": "cubic"}}, loads={"torque_b": "[table(c, omega_b[1]), 0, 0]"}),
        lambda t, R, w, p, v, own: {"torque_b": np.array([float(CUBIC(min(max(w[0], -1), 1))), 0.0, 0.0])},
    ),
    "corners where communication steps end": (
        scene(loads={"torque_b": "[0, 0, clip(t, -0.6, 0.7)]"}, accuracy=1e-10, run={"stop": 3.0, "step": 0.1}),
        lambda t, R, w, p, v, own: {"torque_b": np.array([0.0, 0.0, min(t, 0.7)])},
    ),
    "a corner at the start": (
        scene(loads={"torque_b": "[0, 0, abs(t + omega_b[1] - 0.3)]"}),
        lambda t, R, w, p, v, own: {"torque_b": np.array([0.0, 0.0, abs(t + w[0] - 0.3)])},
    ),
}  # fmt: skip
OWN_RATES = {"spring, thrust and a lag": (lambda t, own: [(math.cos(t) - own[0]) / 0.7], [0.1])}


@pytest.mark.thorough
@pytest.mark.parametrize("name", CASES)
def test_scenes_meet_their_accuracy_against_scipy(name):
    tables, loads = CASES[name]
    one = rbfmu.Scene.from_dict(tables, name)
    assert rbfmu.Scene.from_dict(one.to_dict()) == one
    result = rbfmu.simulate(one)
    truth = by_scipy(tables, loads, result.time, *OWN_RATES.get(name, ()))
    assert worst(result, truth, one.outputs.quantities) <= max(one.run.accuracy, 3e-9)  # near corners SciPy has 2e-9
    if name in OWN_RATES:
        np.testing.assert_allclose(result.lag, truth["own"][:, 0], rtol=1e-9, atol=1e-10)


@pytest.mark.parametrize("factor", [7.0, 1.0 / 7.0])
@pytest.mark.parametrize("name", some_of([*CASES], 3))
def test_other_steps_meet_the_accuracy_too(name, factor):
    one = rbfmu.Scene.from_dict(CASES[name][0], name)
    planned, other = rbfmu.plan(one), one.replace({"run.step": factor * one.run.step})
    result = rbfmu.simulate(other, planned=planned)
    truth = reference_motion(other, np.diff(result.time).tolist(), 100_000)
    assert worst(result, truth, one.outputs.quantities) <= 1.5 * one.run.accuracy


@pytest.mark.thorough
def test_bits_do_not_hang_on_compilation():
    one = rbfmu.Scene.from_dict(CASES["spring, thrust and a lag"][0])
    planned = rbfmu.plan(one)
    step, z = rbfmu.compiled_step(one, planned)
    other = z.copy()
    for _ in range(30):
        assert step(z, 0.05) == 0
        assert interpreted(planned.kernels.step)(other, 0.05) == 0
        np.testing.assert_array_equal(z, other)


def test_a_refused_step_changes_nothing():
    tables = scene(loads={"torque_b": "-0.1*omega_b"})
    tables["inputs"] = {"ports": ["torque_b"]}
    simulator, other = (rbfmu.Simulator(rbfmu.Scene.from_dict(tables)) for _ in range(2))
    for one in (simulator, other):
        one.step(torque_b=[0.1, 0.0, 0.0])
    with pytest.raises(rbfmu.SimulationError):
        simulator.step(torque_b=[1e308, 0.0, 0.0])
    for one in (simulator, other):
        one.step(torque_b=[0.1, 0.2, 0.0])
    np.testing.assert_allclose(simulator.omega_b, other.omega_b, rtol=1e-14)


@pytest.mark.parametrize(("loads", "outputs", "states"), [
    ({"torque_b": "-omega_b"}, ["omega_b"], 3),
    ({"torque_b": "-omega_b"}, ["quaternion"], 7),
    ({"torque_b": "[0, 0, sin(t)]"}, ["omega_b"], 3),
    ({"torque_b": "to_b([0, 0, 1])"}, ["omega_b"], 7),
    ({"force_a": "-position"}, ["position"], 6),
    ({"torque_b": "[0, 0, u]"}, ["position"], 6),
])  # fmt: skip
def test_what_formulas_read_decides_what_is_integrated(loads, outputs, states):
    tables = scene(body=B | {"r_oc_b": [0.0, 0.0, 0.0]}, loads=loads, quantities=outputs, accuracy=1e-6,
                   states={"u": {"start": 0.0, "rate": "1 - u"}})  # fmt: skip
    planned = rbfmu.plan(rbfmu.Scene.from_dict(tables))
    assert planned.states == states
    assert planned.model == "formulas"
    assert ("left out" in str(planned.reasons)) == (states < 13)
    assert "u, which no output needs" in str(planned.reasons)


def test_time_may_begin_at_any_date():
    """Clocks resolve 2e-7 s there, which is what formulas of t can know."""
    one = rbfmu.Scene.from_dict(CASES["gravity gradient"][0])
    late = one.replace({"run.start": 1.7e9, "run.stop": 1.7e9 + 5.0, "run.accuracy": 1e-6})
    shifted = one.replace({"formulas.u_b": "to_b([cos(n*(t - 1.7e9)), sin(n*(t - 1.7e9)), 0])"})
    assert shifted.formulas["u_b"] != one.formulas["u_b"]
    found, expected = rbfmu.simulate(late.replace({"formulas.u_b": shifted.formulas["u_b"]})), rbfmu.simulate(one)
    np.testing.assert_allclose(found.omega_b, expected.omega_b, rtol=0.0, atol=2e-6)


@pytest.mark.parametrize(("changes", "said"), [
    ({"outputs.off": {"value": "u_b[1]"}, "loads.torque_b": "[off, 0, 0]"},
     r"loads\.torque_b: expected one of .* in place of off\n.*\n +\^\n"
     r"off is an output: give its formula a name in \[form"),
    ({"loads.torque_b": "3*n*cross(u_c, u_b)"}, r"loads\.torque_b: expected one of .* in place of u_c\n.*\n +\^"),
    ({"loads.torque_b": "[table(wind, t), 0, 0]"}, r"a table in \[tables\] in place of wind: it has none\n.*\n {11}\^"),
    ({"tables": {"w": {"x": [0, 1], "y": [1, 2]}}, "loads.torque_b": "[table(v, t), 0, 0]"}, "one of w in place of v"),
    ({"tables": {"w": {"x": [0, 1], "y": [1, 2]}}, "loads.torque_b": "[w(t), 0, 0]"}, r"expected table\(w, x\)"),
    ({"loads.torque_b": "to_a(M_c) @ omega_a"}, r"loads\.torque_b: expected a vector of 3 numbers\n"),  # R_ab @ M_c
    ({"loads.torque_b": "to_b(n)"}, r"loads\.torque_b: expected a vector of 3 numbers\n"),
    ({"loads.torque_b": "n"}, r"loads\.torque_b: expected a vector of 3 numbers in one text, such as \[0, 0, t\]"),
    ({"loads.torque_b": ["0.02", "-t", "n"]}, r"such as \[0, 0, t\]; texts of a list add up\n +\(0\.02\) \+ \(-t\)"),
    ({"loads.torque_b": [0, 0, "n"]}, r'loads\.torque_b = \[0, 0, "n"\]: expected a formula in one text, such as'),
    ({"loads.force_a": 3.0}, r"loads\.force_a = 3\.0"),
    ({"formulas": {"u_b": "v", "v": "2*u_b"}}, r"formulas\.u_b: .* without a circle, not u_b -> v -> u_b"),
    ({"constants": {"n": math.nan}}, r"constants\.n\.value = nan: expected a finite number, or 3 f"),
    ({"constants": {"n": 1.0, "mass": 1.0}}, r"constants\.mass: expected another name"),
    ({"states": {"damping_b": {"start": 1.0, "rate": "1"}}}, r"states\.damping_b: expected another name"),
    ({"constants": {"n": 1.0, "h_0": 2.0}, "states": {"h": {"start": 1.0, "rate": "h_0"}}},
     r"constants\.h_0: expected another name: that is the start of states\.h"),
    ({"constants": {"n": "x"}}, r'constants\.n\.value = "x": expected a number, or 3 numbers'),
    ({"constants": {"n": np.eye(3)}}, r"\], .* expected a number, or 3 numbers; a matrix stands as a text under"),
    ({"constants": 3}, r"constants = 3: expected a table of numbers"),
    ({"constants": {"a-b": 1.0}}, r"constants\.a-b = 1\.0: expected a name of letters, digits and _"),
    ({"tables": {"from": {"x": [0, 1], "y": [1, 2]}}}, r"tables\.from = .*: expected a name .* no word of Python"),
    ({"states": {"h": {"start": 1.0}}}, r"states\.h\.rate is missing: expected a formula"),
    ({"states": {"h": {"start": 1.0, "rate": "u_b"}}}, r"states\.h\.rate: expected a scalar"),
    ({"tables": {"c": {"x": [-1e308, 1e308], "y": [1, 2]}}}, r"tables\.c\.y = \[1\.0, 2\.0\]: expected .* slopes"),
    ({"tables": {"c": {"x": [0, 0], "y": [1, 2]}}}, r"tables\.c\.x = \[0\.0, 0\.0\]: expected numbers that increase"),
    ({"tables": {"c": "wind.csv"}}, r"tables\.c = .*: expected a table \{ x, y \} of two lists of numbers$"),
    ({"outputs.tilt": "R_ab"}, r"outputs\.tilt\.value: expected a scalar or a vector"),
    ({"outputs.plot": "n"}, r"outputs\.plot: expected another name"),
    ({"loads.potential": "dot(velocity, velocity)"}, r"loads\.potential: expected a formula of position and attitude"),
    ({"outputs.quantities": ["total_energy"]}, r"quantities: expected no total_energy: torque_b has no pot"),
])  # fmt: skip
def test_mistakes_raise_with_key_and_place(changes, said):
    one = rbfmu.Scene.from_dict(CASES["gravity gradient"][0])
    with pytest.raises(rbfmu.SceneError, match=said):
        one.replace(changes)


def test_what_leads_nowhere_is_refused():
    relay = scene(loads={"torque_b": "[0, 0, where(omega_b[3] > 0, -1, 1)]"}, body=B | {"r_oc_b": [0.0, 0.0, 0.0]})
    with pytest.raises(rbfmu.SceneError, match=r"before t = .*, where loads\.torque_b slides along a corner"):
        rbfmu.plan(rbfmu.Scene.from_dict(relay))
    upright = scene(loads={"torque_b": "[1/gravity_a[1], 0, 0]"}, body=B)
    with pytest.raises(rbfmu.SceneError, match=r"loads\.torque_b: expected a finite number"):
        rbfmu.plan(rbfmu.Scene.from_dict(upright))
    grows = scene(states={"u": {"start": 1.0, "rate": "u**2"}}, outputs={"own": "u"}, body=B)
    with pytest.raises(rbfmu.SceneError, match=r"before t = 1 s, where the motion changes ever faster"):
        rbfmu.plan(rbfmu.Scene.from_dict(grows))
    singular = scene(loads={"force_a": "-position/norm(position)**3"}, initial=A, quantities=("position",))
    singular["body"] = B | {"r_oc_b": [0.0, 0.0, 0.0]}
    with pytest.raises(rbfmu.SceneError, match=r"another start or formula: at t = 0 s loads\.force_a is not finite"):
        rbfmu.plan(rbfmu.Scene.from_dict(singular))
    singular["loads"] = {"potential": "-1/norm(position)"}  # 2026-12-01: the force was named, of which there is no key
    with pytest.raises(rbfmu.SceneError, match=r"formula: at t = 0 s loads\.potential is not finite"):
        rbfmu.plan(rbfmu.Scene.from_dict(singular))


@pytest.mark.parametrize("text", ["1/c", "c**-1", "sqrt(c - 1)", "(1e200*t)**2"])
def test_a_load_of_constants_alone_that_is_no_number_is_named(text):
    """2026-11-25: a bare ZeroDivisionError or ValueError, as a closed form was looked for with the load's number."""
    tables = scene(loads={"torque_b": f"[0, {text}, 0]"}, body=B) | {"constants": {"c": 0.0}}
    with pytest.raises(rbfmu.SceneError, match=r"another start or formula: at t = 0 s loads\.torque_b is not finite"):
        rbfmu.plan(rbfmu.Scene.from_dict(tables))


@pytest.mark.parametrize(("gain", "text"), [(-1.0, "sqrt(gain)"), (1.0, "log(-gain - t)"), (1.0, "1/t")])
def test_an_output_that_is_not_finite_at_the_start_is_called_so(gain, text):
    """And no parameter, where an input's value or the formula is at fault; nor is planning said to take long."""
    ports, outputs = [{"name": "gain", "size": 1, "start": gain}], {"root": text, "time_left": "1 - t"}
    made = rbfmu.Scene(body=B, inputs={"ports": ports}, outputs=outputs, run={"stop": 1.0, "step": 0.5})
    with pytest.raises(rbfmu.SceneError, match=r"^scene: outputs\.root: expected finite numbers with these parameters"):
        rbfmu.simulate(made)


@pytest.mark.thorough
@pytest.mark.parametrize(("loads", "texts"), [
    ({"torque_b": [0.1, 0.2, 0.3]}, {"torque_b": "[0.1, 0.2, 0.3]"}),
    ({"torque_a": [0.1, 0.2, 0.3]}, {"torque_b": "to_b([0.1, 0.2, 0.3])"}),
    ({"force_b": [1.0, 0.2, 0.3]}, {"force_a": "to_a([1, 0.2, 0.3])"}),
    ({"force_a": [1.0, 0.2, 0.3]}, {"potential": "-dot([1, 0.2, 0.3], position)"}),
    ({"damping_b": [0.1, 0.2, 0.3]}, {"torque_b": "-[0.1*omega_b[1], 0.2*omega_b[2], 0.3*omega_b[3]]"}),
    ({"gravity_a": [0.0, 0.0, -9.81]}, {"potential": "9.81*mass*(position + to_a(r_oc_b))[3]"}),
])  # fmt: skip
def test_a_load_of_the_scene_and_the_same_as_a_formula_make_one_motion(loads, texts):
    """Judged to 1e-12, so that both are within that of it."""
    found = [
        rbfmu.simulate(rbfmu.Scene.from_dict(scene(loads=one, quantities=("quaternion", "position"), accuracy=1e-12)))
        for one in (loads, texts)
    ]
    assert attitude_error(found[0].quaternion, found[1].quaternion).max() <= 2e-12
    np.testing.assert_allclose(found[0].position, found[1].position, atol=2e-12 * np.abs(found[0].position).max())


@pytest.mark.parametrize("torque", [
    "norm(dot(omega_b, [1, 0, 0])*[1, 0.5 + t, 0])*[0, 0.3, 1]",
    "sqrt((omega_b[1]*(2 + sin(t)))**2)*[0, 0.2, 0.5]",
])  # fmt: skip
def test_what_comes_down_to_zero_and_rises_again_is_seen_at_any_tolerance(torque):
    """2026-11-23: where the terms that a series left out lifted it off zero, errors were up to 1e7 tolerances."""
    tables = scene(body=B | {"r_oc_b": [0.0, 0.0, 0.0]}, loads={"torque_b": torque}, run={"stop": 6.0, "step": 0.5})
    judge = Judge(Question(rbfmu.Scene.from_dict(tables)))
    for tolerance in (1e-6, 1e-7, 1e-8, 1e-9):
        for order in (8, 12, 20):
            assert judge.try_out(whole_series(judge.scene, order, tolerance))[0] <= 100.0 * tolerance


@pytest.mark.parametrize("rate", [1.0, 3.0])
def test_a_relay_switches_when_its_clock_says_so(rate):
    """2026-11-23: between switches all states are polynomials, and series reached where the clock's own were wrong."""
    loads = {"torque_b": f"where(sin({rate}*t) > 0.2, 1, -0.7)*[0, 0, 1]"}
    tables = scene(body={"mass": 1.0, "inertia": [1.0, 2.0, 3.0]}, initial={"omega_b": [0.0, 0.0, 0.1]}, loads=loads,
                   run={"stop": 10.0, "step": 2.5})  # fmt: skip
    result = rbfmu.simulate(rbfmu.Scene.from_dict(tables))
    on, turn = math.asin(0.2) / rate, 2.0 * math.pi / rate
    longest = math.pi / rate - 2.0 * on
    up = result.time // turn * longest + np.clip(result.time % turn - on, 0.0, longest)
    expected = 0.1 + (1.7 * up - 0.7 * result.time) / 3.0
    np.testing.assert_allclose(result.omega_b[:, 2], expected, rtol=0, atol=1e-9 * np.abs(expected).max())


def test_a_motion_that_becomes_too_fast_is_refused_and_not_followed_for_minutes(monkeypatch):
    """2026-11-23: a series went on from one communication point to the next for an hour."""
    monkeypatch.setattr(reference, "MOST_WORK", 100_000)
    fast = scene(loads={"torque_b": "[sin(1e8*max(t - 0.5, 0)), 0, 0]"}, run={"stop": 1.0, "step": 0.1})
    with pytest.raises(rbfmu.SceneError, match="expected a shorter run"):
        reference_motion(rbfmu.Scene.from_dict(fast), [0.05] * 20, 100_000)


def test_what_comes_to_rest_by_a_root_is_told_when_and_why(monkeypatch):
    """2026-11-30: it was told "expected a shorter run", and neither the time nor the formula."""
    monkeypatch.setattr(reference, "MOST_WORK", 100_000)
    drains = scene(states={"h": {"start": 1.0, "rate": "-0.5*sqrt(abs(h))"}}, outputs={"own": "h"})
    with pytest.raises(rbfmu.SceneError, match=r"before t = 4 s, where states\.h has a root or norm that comes to"):
        reference_motion(rbfmu.Scene.from_dict(drains), [0.05] * 100, 100_000)


def test_many_series_in_a_step_are_not_taken_for_creeping():
    one = rbfmu.Scene.from_dict(scene(loads={"torque_b": "-0.5*norm(omega_b)*omega_b"}))
    planned = rbfmu.plan(one)
    patient = planned.formulas.text.replace("PLACES = {", "PLACES = {'MOST_CREPT': 1, ", 1)
    names = {"__name__": "patient"}
    exec(patient, names)
    z = start_run(one, replace(planned, tolerance=1e-13, order=8))
    assert interpreted(names["MODEL"].step)(z, 5.0) == 0
    assert z[planned.kernels.BLOCKS["substeps"]] > 10.0


def test_the_command_runs_a_scene_with_a_formula_and_a_port_also_by_a_kept_plan(tmp_path):
    (tmp_path / "it.toml").write_text(
        "[body]\nmass = 1.0\ninertia = [1.0, 2.0, 3.0]\n[initial]\nomega_b = [0.1, 0.2, 0.3]\n[inputs]\n"
        'ports = ["torque_b"]\n[loads]\ntorque_b = "-0.2*norm(omega_b)*omega_b"\n[outputs]\nquantities = ["omega_b"]\n'
        "[run]\nstop = 1.0\nstep = 0.5\naccuracy = 1e-6\n"
    )
    first, second = (call("run", tmp_path / "it.toml").stdout for _ in range(2))
    assert first == second
    assert "at the end" in first
    assert "a loop closed through them" not in first


@pytest.mark.parametrize("zeros", [(0.0, -0.0), (-0.0, 0.0)])
def test_scenes_that_differ_in_the_sign_of_a_zero_are_not_taken_for_each_other(zeros):
    body, own = {"mass": 1.0, "inertia": [1.0, 2.0, 2.5]}, "[0.1*atan2(0.0, c), 0, 0]"
    for zero in zeros:
        tables = scene(body, {}, loads={"torque_b": own}, constants={"c": {"value": zero}})
        expected = 0.5 * math.atan2(0.0, zero)
        assert rbfmu.simulate(rbfmu.Scene.from_dict(tables)).omega_b[-1, 0] == pytest.approx(expected, rel=1e-9)
