"""Scenes with formulas against SciPy's DOP853 on right-hand sides written by hand, and what they promise besides."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

import rbfmu
from rbfmu.planning.formula_reference import formula_motion
from rbfmu.runs.motion import attitude_error
from rbfmu.runs.plan import start_run
from rbfmu_kernels.compile.tiered import interpreted
from tests.support.command_line import call
from tests.support.covering import some_of

B = {"mass": 2.0, "inertia": [[1.0, 0.1, 0.05], [0.1, 1.2, 0.02], [0.05, 0.02, 1.5]], "r_oc_b": [0.1, -0.2, 0.3]}
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


def matrix(q):
    w, x, y, z = q / np.linalg.norm(q)
    return np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                     [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                     [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]])  # fmt: skip


def by_scipy(tables, loads, times, own_rates=None, own=(), ports=lambda t: {}, whole=False):
    """Quaternion, omega_b, position and own states at times: nothing of this package.

    whole: whether right-hand sides take all, with the quaternion after the own states.
    """
    body, initial, pivot = tables["body"], tables["initial"], tables["body"].get("pivot", False)
    m, rc, g = body["mass"], np.array(body["r_oc_b"]), np.array(tables["loads"]["gravity_a"])
    M = np.array(body["inertia"]) + (m * (rc @ rc * np.eye(3) - np.outer(rc, rc)) if pivot else 0.0)
    damping, inverse = np.array(tables["loads"].get("damping_b", [0.0] * 3)), np.linalg.inv(M)
    q0, w0 = np.array(initial["attitude"]["quaternion"]), np.array(initial["omega_b"])
    R0, o = matrix(q0), np.array(initial.get("position", [0.0] * 3))

    def rates(t, y):
        q, w, r_c, v_c, own = y[:4], y[4:7], y[7:10], y[10:13], y[13:]
        R = matrix(q)
        p, v = (o, np.zeros(3)) if pivot else (r_c - R @ rc, v_c - R @ np.cross(w, rc))
        acting = {"force_a": np.zeros(3), "force_b": np.zeros(3), "torque_a": np.zeros(3), "torque_b": np.zeros(3)}
        acting |= loads(t, R, w, p, v, [*own, *q] if whole else own)
        torque = acting["torque_b"] + R.T @ acting["torque_a"] - damping * w + ports(t).get("torque_b", 0.0)
        force = acting["force_b"] + R.T @ acting["force_a"]
        torque = torque + (np.cross(rc, R.T @ (m * g)) if pivot else np.cross(-rc, force))
        path = [np.zeros(3), np.zeros(3)] if pivot else [v_c, g + R @ force / m]
        turn = 0.5 * np.array([-q[1:] @ w, *(q[0] * w + np.cross(q[1:], w))])
        more = [] if not own_rates else own_rates(t, R, w, p, v, [*own, *q]) if whole else own_rates(t, own)
        return np.concatenate([turn, inverse @ (torque - np.cross(w, M @ w)), *path, more])

    start = [q0, w0, o + R0 @ rc, np.array(initial.get("velocity", [0.0] * 3)) + R0 @ np.cross(w0, rc), own]
    found = solve_ivp(rates, (times[0], times[-1]), np.concatenate(start), "DOP853", times, rtol=1e-13, atol=1e-14).y.T
    q = found[:, :4] / np.linalg.norm(found[:, :4], axis=1)[:, None]
    return {"quaternion": q, "omega_b": found[:, 4:7], "own": found[:, 13:],
            "position": np.array([r - matrix(a) @ rc for a, r in zip(q, found[:, 7:10], strict=True)])}  # fmt: skip


def worst(result, truth, names):
    """The largest error, as an accuracy counts it."""
    found = [0.0]
    for name in names:
        if name == "quaternion":
            found.append(attitude_error(result.quaternion, truth[name]).max())
        else:
            size = max(np.linalg.norm(truth[name], axis=1).max(), 1.0 if name == "position" else 0.0)
            found.append(np.linalg.norm(getattr(result, name) - truth[name], axis=1).max() / size)
    return max(found)


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
    truth = formula_motion(other, np.diff(result.time).tolist(), 100_000)
    assert worst(result, truth, one.outputs.quantities) <= 1.5 * one.run.accuracy


def test_bits_do_not_hang_on_compilation():
    one = rbfmu.Scene.from_dict(CASES["spring, thrust and a lag"][0])
    planned = rbfmu.plan(one)
    step, z = rbfmu.compiled_step(one, planned)
    other = z.copy()
    for _ in range(30):
        assert step(z, 0.05) == 0
        assert interpreted(planned.kernels.step)(other, 0.05) == 0
        np.testing.assert_array_equal(z, other)


def test_a_simulator_shows_saves_and_restores():
    one = rbfmu.Scene.from_dict(CASES["spring, thrust and a lag"][0])
    simulator = rbfmu.Simulator(one)
    for _ in range(7):
        simulator.step()
    saved, rows = simulator.save(), []
    for _ in range(2):
        simulator.restore(saved)
        for _ in range(9):
            simulator.step()
        rows.append((simulator.lag, *simulator.position))
    assert rows[0] == rows[1]
    assert rows[0][0] == rbfmu.simulate(one).lag[16]
    with pytest.raises(AttributeError, match="height"):
        simulator.height  # noqa: B018


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


def test_inputs_change_within_a_step_and_add_to_formulas():
    tables, loads = CASES["quadratic damping"]
    one = rbfmu.Scene.from_dict(tables | {"inputs": {"ports": ["torque_b"]}})
    given = ([0.0, 5.0], [[0.5, 0.0, 0.1], [-0.5, 0.3, 0.1]])
    for interpolate in ("linear", "hold"):
        result = rbfmu.simulate(one, inputs={"torque_b": given}, interpolate=interpolate)
        slope = np.subtract(*given[1][::-1]) / 5.0 * (interpolate == "linear")
        port = lambda t: {"torque_b": np.array(given[1][0]) + t * slope}  # noqa: B023, E731
        truth = by_scipy(tables, loads, result.time, ports=port)
        assert worst(result, truth, ("omega_b",)) <= 1e-9


def test_energy_stays_as_accurate_as_asked():
    tables = CASES["spring by its potential"][0]
    one = rbfmu.Scene.from_dict(tables | {"outputs": {"quantities": ["total_energy", "potential_energy", "position"]}})
    result = rbfmu.simulate(one)
    assert np.ptp(result.total_energy) <= one.run.accuracy * np.abs(result.total_energy).max()
    assert np.ptp(result.potential_energy) > 1.0
    assert result.units["total_energy"] == "J"


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


def test_time_may_begin_at_any_date():
    """Clocks resolve 2e-7 s there, which is what formulas of t can know."""
    one = rbfmu.Scene.from_dict(CASES["gravity gradient"][0])
    late = one.replace({"run.start": 1.7e9, "run.stop": 1.7e9 + 5.0, "run.accuracy": 1e-6})
    shifted = one.replace({"formulas.u_b": "to_b([cos(n*(t - 1.7e9)), sin(n*(t - 1.7e9)), 0])"})
    assert shifted.formulas["u_b"] != one.formulas["u_b"]
    late = late.replace({"formulas.u_b": shifted.formulas["u_b"]})
    found, expected = rbfmu.simulate(late), rbfmu.simulate(one)
    np.testing.assert_allclose(found.omega_b, expected.omega_b, rtol=0.0, atol=2e-6)


@pytest.mark.parametrize(("changes", "said"), [
    ({"loads.torque_b": "3*n*cross(u_c, u_b)"}, r"loads\.torque_b: expected one of .* in place of u_c\n.*\n +\^"),
    ({"loads.torque_b": "n"}, r"loads\.torque_b: expected a vector of 3 numbers"),
    ({"loads.force_a": 3.0}, r"loads\.force_a = 3\.0"),
    ({"formulas": {"u_b": "v", "v": "2*u_b"}}, r"formulas\.u_b: .* without a circle, not u_b -> v -> u_b"),
    ({"constants": {"n": 1.0, "mass": 1.0}}, r"constants\.mass: expected another name"),
    ({"constants": {"n": "x"}}, r"constants = .*: expected n to be value to be a number, or 3 numbers"),
    ({"constants": {"a-b": 1.0}}, r"names of letters, digits and _"),
    ({"states": {"h": {"start": 1.0}}}, r"states = .*: expected h to be a table with rate as well"),
    ({"states": {"h": {"start": 1.0, "rate": "u_b"}}}, r"states\.h: expected a scalar"),
    ({"tables": {"c": {"x": [0, 0], "y": [1, 2]}}}, r"tables = .*: expected c to be x that increases"),
    ({"outputs.tilt": "R_ab"}, r"outputs\.tilt: expected a scalar or a vector"),
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
    singular = scene(loads={"force_a": "-position/norm(position)**3"}, initial=A, quantities=("position",))
    singular["body"] = B | {"r_oc_b": [0.0, 0.0, 0.0]}
    with pytest.raises(rbfmu.SceneError, match=r"before t = 0 s, where loads\.force_a is not finite"):
        rbfmu.plan(rbfmu.Scene.from_dict(singular))


def test_a_body_that_starts_at_rest_and_one_that_turns_back_have_drag():
    """Where norm(v) is zero its root has no series: it begins there, or touches zero as the body turns back."""
    drag = lambda t, R, w, p, v, own: {"force_a": -0.5 * np.linalg.norm(v) * v}  # noqa: E731
    for velocity in ([0.0, 0.0, 0.0], [0.0, 0.0, 9.0]):
        initial = MOVING | {"velocity": velocity, "omega_b": [0.0, 0.0, 0.0]}
        tables = scene(initial=initial, gravity=(0.0, 0.0, -9.81), loads={"force_a": "-0.5*norm(velocity)*velocity"},
                       quantities=("position",), accuracy=1e-10)  # fmt: skip
        result = rbfmu.simulate(rbfmu.Scene.from_dict(tables))
        assert worst(result, by_scipy(tables, drag, result.time), ("position",)) <= 1e-10


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


def test_what_does_not_know_formulas_says_so():
    one = rbfmu.Scene.from_dict(CASES["gravity gradient"][0])
    with pytest.raises(rbfmu.SceneError, match="expected a scene without formulas"):
        rbfmu.chart(one)


def test_own_outputs_stand_without_quantities_and_rows_keep_their_neighbours():
    tables = CASES["gravity gradient"][0]
    tables = tables | {"outputs": {"turned": {"value": "omega_b[1]", "unit": "rad/s"}}}
    tables = tables | {"constants": tables["constants"] | {"spare": 2.0}}
    one = rbfmu.Scene.from_dict(tables)
    assert one.outputs.names[-1] == "turned"
    assert "omega_b" in one.outputs.quantities
    other = one.replace({"constants.n": 0.4, "run.stop": 3.0})
    assert other.constants["n"] == ((0.4,), "rad/s", "")
    assert other.constants["spare"] == one.constants["spare"]
    assert other.outputs.names[-1] == "turned"


def test_constants_and_starts_are_parameters_where_they_are_listed():
    tables = CASES["spring, thrust and a lag"][0] | {"inputs": {"parameters": ["k", "u_0"]}}
    one = rbfmu.Scene.from_dict(tables)
    assert rbfmu.Scene.from_dict(one.to_dict()) == one
    planned = rbfmu.plan(one)
    assert {"k", "u_0"}.isdisjoint(planned.pinned)
    assert {"c", "mass"} <= {*planned.pinned}
    with pytest.raises(rbfmu.SceneError, match="parameters"):
        rbfmu.Scene.from_dict(tables | {"inputs": {"parameters": ["kk"]}})
    simulator = rbfmu.Simulator(one, k=6.0, u_0=0.3)
    simulator.step()
    other = rbfmu.simulate(one.replace({"constants.k": 6.0, "states.u": 0.3}), planned=planned)
    np.testing.assert_array_equal(simulator.position, other.position[1])
    with pytest.raises(rbfmu.SceneError, match=r"list 'c' in inputs\.parameters"):
        rbfmu.Simulator(one, c=6.0)


def test_the_text_of_the_kernels_can_be_printed(tmp_path):
    (tmp_path / "scene.toml").write_text(
        '[body]\nmass = 1.0\ninertia = [1.0, 2.0, 3.0]\n[loads]\ntorque_b = "-0.1*omega_b"\n'
    )
    printed = call("plan", tmp_path / "scene.toml", "--code").stdout
    compile(printed, "formulas", "exec")
    assert "def further(z: Buffer, w: int, k: int)" in printed


def test_names_of_ones_own_are_not_mistaken_for_those_of_a_body():
    names = {"constants": {"M": 2.0, "arm": 0.5}, "states": {"q": {"start": 0.1, "rate": "-M*q"},
             "omega": {"start": [0.1, 0.2, 0.3], "rate": "-arm*omega"}}}  # fmt: skip
    loads = {"torque_b": "[M*q, arm*q, 0] - omega"}
    plain = {"constants": {"a": 2.0, "b": 0.5}, "states": {"x": {"start": 0.1, "rate": "-a*x"},
             "y": {"start": [0.1, 0.2, 0.3], "rate": "-b*y"}}}  # fmt: skip
    one = rbfmu.simulate(rbfmu.Scene.from_dict(scene(loads=loads, outputs={"shown": "q"}, **names)))
    loads = {"torque_b": "[a*x, b*x, 0] - y"}
    other = rbfmu.simulate(rbfmu.Scene.from_dict(scene(loads=loads, outputs={"shown": "x"}, **plain)))
    np.testing.assert_array_equal(one.omega_b, other.omega_b)
    np.testing.assert_array_equal(one.shown, other.shown)
    np.testing.assert_allclose(one.shown, 0.1 * np.exp(-2.0 * one.time), rtol=0, atol=1e-10)
    with pytest.raises(rbfmu.SceneError, match="another name"):
        rbfmu.Scene.from_dict(scene(loads={"torque_b": "-omega_b"}, outputs={"arm": "t"}))


def test_ports_of_ones_own_enter_formulas():
    ports = ["torque_b", {"name": "wheel", "unit": "N m", "start": [0.01, 0, 0]}, {"name": "u", "size": 1}]
    loads = {"torque_b": "-wheel - cross(omega_b, h) + [0, 0, u]"}
    states = {"h": {"start": [0, 0, 0], "rate": "wheel"}}
    driven = scene(inputs={"ports": ports}, loads=loads, states=states, outputs={"shown": "h"})
    one = rbfmu.Scene.from_dict(driven)
    assert rbfmu.Scene.from_dict(one.to_dict()) == one
    planned = rbfmu.plan(one)
    t = np.linspace(0.0, 5.0, 101)
    given = {"wheel": np.outer(t, [0.1, 0.2, -0.1]), "u": 0.3 * t}
    found = rbfmu.simulate(one, planned=planned, inputs=given, interpolate="linear")
    loads = {"torque_b": loads["torque_b"].replace("wheel", "w").replace("[0, 0, u]", "[0, 0, 0.3*t]")}
    states = {"h": {"start": [0, 0, 0], "rate": "w"}}
    formulas = {"w": "t*[0.1, 0.2, -0.1]"}
    same = rbfmu.simulate(rbfmu.Scene.from_dict(scene(loads=loads, states=states, formulas=formulas)))
    np.testing.assert_allclose(found.omega_b, same.omega_b, rtol=0, atol=1e-8)
    held = rbfmu.simulate(one, planned=planned)
    np.testing.assert_allclose(held.shown[-1], [0.05, 0.0, 0.0], rtol=1e-13, atol=1e-15)
    simulator = rbfmu.Simulator(one)
    simulator.step(u=0.3, wheel=[0.1, 0.0, 0.0])
    before = simulator.save()
    for wrong in ({"u": [1.0, 2.0]}, {"u": math.nan}, {"wheel": 1.0}, {"v": 1.0}):
        with pytest.raises(ValueError, match=next(iter(wrong))):
            simulator.step(**{"torque_b": [0.5, 0.0, 0.0], **wrong})
    assert simulator.save() == before


@pytest.mark.parametrize(("port", "said"), [
    ({"size": 3}, "a table with name as well"), ({"name": "u", "size": 2}, "1 or 3"),
    ({"name": "u", "size": 1, "start": [1, 2, 3]}, "as many numbers"), ({"name": "t"}, "another name"),
    ({"name": "mass"}, "another name"), ({"name": "h"}, "another name"), ({"name": "2u"}, "letters, digits"),
])  # fmt: skip
def test_wrong_ports_are_refused(port, said):
    with pytest.raises(rbfmu.SceneError, match=said):
        rbfmu.Scene.from_dict(scene(inputs={"ports": [port]}, loads={"torque_b": "-omega_b"}))


def test_many_series_in_a_step_are_not_taken_for_creeping():
    one = rbfmu.Scene.from_dict(scene(loads={"torque_b": "-0.5*norm(omega_b)*omega_b"}))
    planned = rbfmu.plan(one)
    patient = planned.formulas.text.replace("PLACES = {", "PLACES = {'MOST_CREPT': 1, ", 1)
    names = {"__name__": "patient"}
    exec(patient, names)
    z = start_run(one, replace(planned, tolerance=1e-13, order=8))
    assert interpreted(names["MODEL"].step)(z, 5.0) == 0
    assert z[planned.kernels.BLOCKS["substeps"]] > 10.0
