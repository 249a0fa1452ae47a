"""`linearize` against differences of the textbook's equations in 50 digits, and against the simulation."""

import math
import warnings

import numpy as np
import pytest

import rbfmu
from rbfmu_kernels.quantities import OUTPUT
from tests.support.paths import SCENES
from tests.support.references.formulas_by_eval import BITS_120, Motion, V, cross, dot, transposed, turned

EPS = 2.0**-52
BY, NUMBER, *_ = BITS_120
STEP, ZERO = NUMBER("1e-16"), V([NUMBER(0)] * 3)
"""Of the differences: their error is its square, relative."""
TRIAXIAL = [[1.0, 0.1, -0.05], [0.1, 2.0, 0.2], [-0.05, 0.2, 2.5]]
START = {"attitude": {"euler": "ZYX", "angles_deg": [25, -40, 70]}, "omega_b": [0.7, -0.4, 1.1]}
PORTS = ["force_a", "force_b", "torque_a", "torque_b"]
LOADS = {
    "gravity_a": [0.3, -0.2, -9.81], "torque_a": [0.2, -0.1, 0.3], "torque_b": [0.1, 0.4, -0.2],
    "damping_b": [0.02, 0.5, 0.03],
}  # fmt: skip
FREE = {
    "body": {"mass": 2.0, "inertia": TRIAXIAL, "r_oc_b": [0.3, -0.2, 0.1]},
    "initial": START | {"position": [1.0, 2.0, 3.0], "velocity": [0.4, -0.5, 0.6]},
    "loads": LOADS | {"force_a": [1.0, 2.0, -1.0], "force_b": [0.5, -0.7, 0.2]},
    "inputs": {"ports": PORTS},
}
PIVOT = {
    "body": FREE["body"] | {"pivot": True}, "initial": START, "loads": LOADS,
    "inputs": {"ports": ["torque_a", "torque_b"]},
}  # fmt: skip
UNLOADED = {"body": {"mass": 2.0, "inertia": TRIAXIAL}, "inputs": {"ports": PORTS}, "loads": {"gravity_a": [0, 0, 0]}}
RATES = {"inputs": {"ports": ["omega_b"]}, "initial": {"attitude": START["attitude"]}}
CASES = {"free": FREE, "pivot": PIVOT, "unloaded": UNLOADED, "rates": RATES}
HELD = {
    "force_a": [0.1, -0.2, 0.3], "force_b": [0.4, 0.5, -0.6], "torque_a": [-0.7, 0.8, 0.9],
    "torque_b": [0.15, -0.25, 0.35], "omega_b": [0.3, -0.6, 0.2],
}  # fmt: skip


class Textbook:
    """Rates of errors by equations of motion that share nothing with this package, and outputs."""

    def __init__(self, scene, held):
        self.scene, tables, ports = scene, scene.to_dict(), scene.inputs.ports
        self.held = {port: V(map(NUMBER, held.get(port, ZERO))) for port in ports}
        loads = {"gravity_a": ZERO, "damping_b": ZERO} | tables.get("loads", {})
        loads |= {name: f"{loads[name]}" + f" + {name}" * (name in ports) for name in PORTS if scene.body}
        body = tables.get("body", {"mass": 1.0, "inertia": np.eye(3).tolist(), "r_oc_b": ZERO})
        initial = {"omega_b": ZERO} | tables["initial"]
        self.motion = Motion({"body": body, "initial": initial, "loads": loads, "constants": {}, "tables": {}})

    def __call__(self, states, x):
        """Return rates of the errors, and outputs, one after the other, at errors and changes of inputs x."""
        motion, y, changes = self.motion, self.motion.y, iter(zip(x[::3], x[1::3], x[2::3], strict=True))
        error = dict.fromkeys(("r_c", "v_c", "omega_b"), ZERO) | {name: V(next(changes)) for name in states}
        ports = {port: value + V(next(changes)) for port, value in self.held.items()}
        eps, half = V(y[1:4]), error["rotvec_b"] / 2
        q = [y[0] - dot(eps, half), *(eps + half * y[0] + cross(eps, half))]  # of a turn whose square is nothing
        before = V(y[4:7]) if self.scene.body else self.held["omega_b"]
        omega = before + error["omega_b"] if self.scene.body else ports["omega_b"]
        now = [*q, *omega, *(V(y[7:10]) + error["r_c"]), *(V(y[10:13]) + error["v_c"])]
        motion.names |= ports
        rates, (position, velocity, R) = motion.rates(0, now), motion.place(now)
        alpha, v_c, a_c, r = V(rates[4:7]), V(rates[7:10]), V(rates[10:13]), motion.arm
        relative = omega - transposed(R) @ (turned(y[:4]) @ before)
        acceleration = a_c - R @ (cross(alpha, r) + cross(omega, cross(omega, r)))
        energy = dot(omega, motion.M @ omega) / 2
        found = {
            "position": position, "velocity": velocity, "acceleration": velocity if motion.pivot else acceleration,
            "quaternion": q, "omega_b": omega, "omega_a": R @ omega, "alpha_b": alpha,
            "rpy": [BY.atan2(R[3, 2], R[3, 3]), -BY.asin(R[3, 1]), BY.atan2(R[2, 1], R[1, 1])],
            "angular_momentum_a": R @ (motion.M @ omega), "kinetic_energy": [energy + motion.m * dot(v_c, v_c) / 2],
        }  # fmt: skip
        of_states = {"r_c": v_c, "v_c": a_c, "rotvec_b": relative, "omega_b": alpha}
        rows = [*(of_states[name] for name in states), *(found[name] for name in self.scene.outputs.quantities)]
        return [number for row in rows for number in row]


def differences(scene, ports, states):
    """Return (rates, outputs) of central differences, a column for each error and input."""
    book, count = Textbook(scene, ports), 3 * len(states) + 3 * len(scene.inputs.ports)
    columns = []
    for k in range(count):
        ahead, behind = (book(states, [h if j == k else NUMBER(0) for j in range(count)]) for h in (STEP, -STEP))
        columns.append([float((a - b) / (2 * STEP)) for a, b in zip(ahead, behind, strict=True)])
    table = np.array(columns).T
    return table[: 3 * len(states)], table[3 * len(states) :]


@pytest.mark.parametrize("held", [{}, HELD], ids=["inputs zero", "inputs held"])
@pytest.mark.parametrize("name", CASES)
def test_it_is_the_derivative_of_the_textbook_s_equations(name, held):
    scene = rbfmu.Scene.from_dict(CASES[name])
    ports = {port: value for port, value in held.items() if port in scene.inputs.ports}
    found = rbfmu.linearize(scene, **ports)
    rates, outputs = differences(scene, ports, tuple(dict.fromkeys(s.partition("[")[0] for s in found.states)))
    for ours, theirs in ((np.hstack([found.A, found.B]), rates), (np.hstack([found.C, found.D]), outputs)):
        largest = np.maximum(np.max(np.abs(theirs), axis=1, keepdims=True), 1e-3)
        assert np.max(np.abs(ours - theirs) / largest) < 40.0 * EPS  # some twenty operations a number
    assert found.outputs == tuple(
        f"{q}[{k + 1}]" if OUTPUT[q].size > 1 else q for q in scene.outputs.quantities for k in range(OUTPUT[q].size)
    )
    assert found.inputs == tuple(f"{port}[{k}]" for port in scene.inputs.ports for k in (1, 2, 3))


def test_at_a_later_time_it_is_that_of_the_state_there():
    scene = rbfmu.Scene.from_dict(FREE | {"run": {"start": 1.0, "stop": 3.0, "accuracy": 1e-10}})
    ports = {"torque_b": HELD["torque_b"]}
    later = rbfmu.Simulator(scene)
    later.step(1.5, **ports)
    initial = {"position": later.position, "velocity": later.velocity, "omega_b": later.omega_b}
    initial = {k: v.tolist() for k, v in initial.items()} | {"attitude": {"quaternion": later.quaternion.tolist()}}
    there = rbfmu.Scene.from_dict(FREE | {"initial": initial})
    found = rbfmu.linearize(scene, 2.5, **ports)
    for ours, theirs in zip(found, rbfmu.linearize(there, **ports), strict=True):
        assert np.max(np.abs(ours - theirs)) < 1e-8
    assert found.time == 2.5
    assert rbfmu.linearize(scene, 3.0).time == 3.0  # where the run ends


def test_a_path_that_no_output_shows_is_left_out():
    scene = rbfmu.Scene.from_dict(FREE | {"outputs": {"quantities": ["quaternion", "acceleration"]}})
    found = rbfmu.linearize(scene)
    assert found.states == tuple(f"{name}[{k}]" for name in ("rotvec_b", "omega_b") for k in (1, 2, 3))
    assert found.A.shape == (6, 6)
    assert rbfmu.linearize(rbfmu.Scene.from_dict(FREE)).A.shape == (12, 12)


def test_a_scene_file_will_do():
    A, B, C, D = rbfmu.linearize(SCENES / "controlled_satellite.toml")
    assert (A.shape, B.shape, C.shape, D.shape) == ((6, 6), (6, 3), (10, 6), (10, 3))
    assert np.array_equal(B[3:], np.diag(1.0 / np.array([1.0, 2.0, 3.0])))


@pytest.mark.parametrize(("inertia", "told"), [([1.0, 2.0, 2.5], []), ([1e4, 2e4, 2.5e4], ["radius of gyration"])])
def test_it_tells_the_doubts_of_the_scene_alone_and_once(inertia, told):
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        rbfmu.linearize(rbfmu.Scene.from_dict(FREE | {"body": {"mass": 50.0, "inertia": inertia}}))
    assert len(found) == len(told), [str(doubt.message) for doubt in found]
    for doubt, words in zip(found, told, strict=True):
        assert issubclass(doubt.category, rbfmu.SceneWarning)
        assert words in str(doubt.message)


def test_rpy_has_no_derivative_at_its_pole():
    up = {"attitude": {"euler": "ZYX", "angles_deg": [0, 90, 0]}}
    scene = rbfmu.Scene.from_dict(UNLOADED | {"initial": up})
    with pytest.raises(ValueError, match=r"rpy has no derivative at pitch 90 deg: expected outputs without rpy"):
        rbfmu.linearize(scene)
    assert rbfmu.linearize(scene.replace({"outputs.quantities": ["quaternion"]})).C.shape == (4, 6)


@pytest.mark.parametrize(("t", "ports", "message"), [
    (-1.0, {}, "t = -1.0: expected a time from run.start = 0.0 to run.stop"),
    (math.nan, {}, "t = nan"),
    (1e9, {}, "t = 1000000000.0"),
    (True, {}, "t = True"),
    (0.0, {"omega_b": [1, 2, 3]}, "input 'omega_b': expected one of force_a"),
    (0.0, {"torque_b": [1, 2]}, "torque_b = .*expected 3 finite numbers"),
    (1.0, {"torque_b": [1, 2, math.inf]}, "torque_b = .*expected 3 finite numbers"),
])  # fmt: skip
def test_what_is_wrong_is_refused(t, ports, message):
    with pytest.raises(ValueError, match=message):
        rbfmu.linearize(rbfmu.Scene.from_dict(FREE), t, **ports)


def test_a_linear_system_says_what_it_is():
    body = {"body": {"mass": 1.0, "inertia": [1.0, 2.0, 3.0]}, "inputs": {"ports": ["torque_b"]}}
    found = rbfmu.linearize(rbfmu.Scene.from_dict(body | {"outputs": {"quantities": ["omega_b"]}}))
    shapes = "A (6, 6), B (6, 3), C (3, 6), D (3, 3)"
    assert (
        repr(found) == f"Linearization(t = 0 s: {shapes}; states rotvec_b, omega_b; inputs torque_b; outputs omega_b)"
    )


FREE_BODY = {"body": FREE["body"], "initial": FREE["initial"] | {"position": [0.0, 0.0, 0.0]}}
FREE_BODY |= {"inputs": {"ports": ["torque_b", "force_a"]}, "run": {"stop": 3.0, "step": 0.1, "accuracy": 1e-11}}


@pytest.mark.parametrize("pivot", [False, True])
def test_loads_as_formulas_have_the_same_matrices(pivot):
    tables = FREE_BODY | {"body": FREE_BODY["body"] | {"pivot": pivot}}
    if pivot:
        tables |= {"initial": START}
    loads = {"torque_b": [0.1, 0.2, 0.3], "torque_a": [0.3, 0.1, -0.2], "damping_b": [0.1, 0.2, 0.3]}
    texts = loads | {"damping_b": [0, 0, 0], "torque_b": "[.1, .2, .3] - [.1*omega_b[1], .2*omega_b[2], .3*omega_b[3]]"}
    known, written = (
        rbfmu.linearize(rbfmu.Scene.from_dict(tables | {"loads": one}), 1.5, force_a=[0.1, 0.0, 0.2])
        for one in (loads, texts)
    )
    assert (known.states, known.inputs, known.outputs) == (written.states, written.inputs, written.outputs)
    for a, b in zip(known, written, strict=True):
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-9)


def test_states_inputs_and_outputs_of_ones_own_are_in_the_system():
    own = {
        "inputs": {"ports": [{"name": "wheel"}, {"name": "gain", "size": 1, "start": 2.0}]},
        "loads": {"gravity_a": [0, 0, 0], "torque_b": "-wheel - 0.1*h"},
        "states": {"h": {"start": [0.2, 0, 0], "rate": "gain*wheel - 0.3*h"}, "x": {"start": 0.5, "rate": "-x**2 + t"}},
        "outputs": {"quantities": ["omega_b"], "size": "dot(h, h) + x", "kept": "clip(x, 0, 0.1)"},
    }
    near = rbfmu.linearize(rbfmu.Scene.from_dict(FREE_BODY | own), 0.0, wheel=[0.1, 0.2, 0.3])
    assert near.states == (*tuple(f"{name}[{k}]" for name in ("rotvec_b", "omega_b", "h") for k in (1, 2, 3)), "x")
    assert near.inputs == ("wheel[1]", "wheel[2]", "wheel[3]", "gain")
    assert near.outputs == ("omega_b[1]", "omega_b[2]", "omega_b[3]", "size", "kept")
    inverse = np.linalg.inv(FREE_BODY["body"]["inertia"])
    np.testing.assert_allclose(near.A[3:6, 6:9], -0.1 * inverse, rtol=1e-13, atol=1e-16)
    np.testing.assert_allclose(near.B[3:6, :3], -inverse, rtol=1e-13, atol=1e-16)
    np.testing.assert_array_equal(near.A[6:9, 6:9], -0.3 * np.eye(3))
    np.testing.assert_array_equal(near.B[6:9, :3], 2.0 * np.eye(3))
    np.testing.assert_array_equal(near.B[6:9, 3], [0.1, 0.2, 0.3])
    assert near.A[9, 9] == -1.0
    np.testing.assert_allclose(near.C[3], [0, 0, 0, 0, 0, 0, 0.4, 0, 0, 1.0], rtol=1e-15)
    assert not near.C[4].any()  # it is at its limit


@pytest.mark.thorough
def test_events_on_the_way_are_none_of_its_business():
    """More than a step takes, 4,096, made it refuse a motion that a run follows."""
    scene = rbfmu.Scene.from_dict(FREE | {"loads": {"torque_b": "-0.1*omega_b"}})
    watched = rbfmu.Scene.from_dict(scene.to_dict() | {"events": {"often": "sin(3e4*t)"}})
    for found, expected in zip(rbfmu.linearize(watched, 0.5), rbfmu.linearize(scene, 0.5), strict=True):
        np.testing.assert_array_equal(found, expected)


def test_a_path_that_loads_read_is_in_the_system_though_no_output_shows_it():
    own = {"loads": {"torque_b": "[0, 0, -3*position[1]]"}, "outputs": {"quantities": ["omega_b"]}}
    body = {"body": {"mass": 2.0, "inertia": [1.0, 2.0, 2.5]}, "inputs": {}}
    near = rbfmu.linearize(rbfmu.Scene.from_dict(FREE_BODY | body | own))
    assert near.states[:2] == ("r_c[1]", "v_c[1]")
    assert near.A[near.states.index("omega_b[3]"), 0] == pytest.approx(-3.0 / 2.5)


@pytest.mark.parametrize(
    ("table", "name", "what"),
    [
        ("outputs", "size", "output size"),
        ("loads", "force_a", "a force"),
        ("loads", "torque_b", "a torque or the rate of a state"),
    ],
)
def test_a_formula_without_a_derivative_is_refused_by_its_name(table, name, what):
    formula = "norm(velocity - [0.4, -0.5, 0.6])"
    own = {table: {name: formula if table == "outputs" else f"[0, 0, {formula}]"}}
    body = {"body": {"mass": 2.0, "inertia": [1, 2, 2.5]}, "outputs": {"quantities": ["position"]}}
    body["run"] = FREE_BODY["run"] | {"accuracy": 1e-6}
    with pytest.raises(ValueError, match=f"{what} has no finite derivative at t = 0"):
        rbfmu.linearize(rbfmu.Scene.from_dict(FREE_BODY | body | own))


def test_what_a_formula_does_not_select_need_have_no_derivative():
    """2026-12-01: refused, as 0 times the derivative of a root of -1, or of a quotient by 0, was counted."""
    tables = FREE_BODY | {
        "body": {"mass": 2.0, "inertia": [1, 2, 2.5]}, "initial": {},
        "inputs": {"ports": [{"name": "u", "size": 1, "start": -1.0}]},
        "loads": {"torque_b": "[0, 0, where(u > 0, 5*sqrt(u) + sqrt(u)**3, 7*u)]"},
        "outputs": {"o": "where(norm(omega_b) > 0.1, omega_b[1]/norm(omega_b), 3*omega_b[1])"},
    }  # fmt: skip
    one = rbfmu.linearize(rbfmu.Scene.from_dict(tables))
    assert one.B[one.states.index("omega_b[3]"), 0] == pytest.approx(7.0 / 2.5, rel=EPS)
    np.testing.assert_array_equal(one.C[-1], 3.0 * (np.array(one.states) == "omega_b[1]"))
    four = rbfmu.linearize(rbfmu.Scene.from_dict(tables), u=4.0)
    assert four.B[four.states.index("omega_b[3]"), 0] == pytest.approx((5.0 / 4.0 + 3.0) / 2.5, rel=2 * EPS)
