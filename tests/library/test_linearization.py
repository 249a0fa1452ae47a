"""`linearize` against differences of the textbook's equations in 50 digits, and against the simulation."""

import math
import warnings

import mpmath
import numpy as np
import pytest
from mpmath import mp, mpf
from scipy.linalg import expm

import rbfmu
from rbfmu_kernels.quantities import OUTPUT
from tests.support.paths import SCENES

EPS = 2.0**-52
STEP = "1e-16"
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


def vec(x):
    return mpmath.matrix([mpf(float(v)) if not isinstance(v, mpf) else v for v in x])


def cross(a, b):
    return mpmath.matrix([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def skew(u):
    return mpmath.matrix([[0, -u[2], u[1]], [u[2], 0, -u[0]], [-u[1], u[0], 0]])


def rotation(q):
    """R = I + 2 eta eps^x + 2 eps^x eps^x of a unit quaternion."""
    S = skew(q[1:])
    return mpmath.eye(3) + 2 * q[0] * S + 2 * S * S


def product(p, q):
    e, d = mpmath.matrix(p[1:]), mpmath.matrix(q[1:])
    return [p[0] * q[0] - (e.T * d)[0], *(p[0] * d + q[0] * e + cross(e, d))]


def exponential(u):
    angle = mpmath.norm(u)
    return [mpmath.cos(angle / 2), *(u / 2 * mpmath.sincpi(angle / 2 / mp.pi))]


class Textbook:
    """Rates of the errors and outputs, by E&G's formulas; r is from o to the centre of mass."""

    def __init__(self, scene, ports):
        self.scene, body, initial = scene, scene.body, scene.initial
        self.ports = {name: vec(ports.get(name, [0, 0, 0])) for name in scene.inputs.ports}
        q = [mpf(x) for x in initial.quaternion]
        self.q = [x / mp.sqrt(sum(y * y for y in q)) for x in q]
        self.omega = vec(initial.omega_b) if body else self.ports["omega_b"]
        if body:
            self.r, self.m, self.pivot = vec(body.r_oc_b), mpf(body.mass), body.pivot
            self.M = mpmath.matrix([list(map(mpf, row)) for row in body.M_c])
            if self.pivot:
                self.M = self.M - self.m * skew(self.r) * skew(self.r)
            R = rotation(self.q)
            self.r_c = vec(initial.position) + R * self.r
            self.v_c = vec(initial.velocity) + R * cross(self.omega, self.r)

    def __call__(self, states, x):
        """Return (rates of the errors, outputs by name) at errors and changes of inputs x."""
        error = {name: x[3 * k : 3 * k + 3] for k, name in enumerate(states)}
        n = 3 * len(states)
        ports = {p: v + mpmath.matrix(x[n + 3 * k : n + 3 * k + 3]) for k, (p, v) in enumerate(self.ports.items())}
        q = product(self.q, exponential(mpmath.matrix(error["rotvec_b"])))
        R, R_0 = rotation(q), rotation(self.q)
        zero = [mpf(0)] * 3
        omega = self.omega + mpmath.matrix(error.get("omega_b", zero)) if self.scene.body else ports["omega_b"]
        relative = omega - R.T * R_0 * self.omega
        found = {"quaternion": q, "rpy": self.rpy(R), "omega_b": omega, "omega_a": R * omega}
        if not self.scene.body:
            return list(relative), found
        r_c, v_c = (a + mpmath.matrix(error.get(n, zero)) for a, n in ((self.r_c, "r_c"), (self.v_c, "v_c")))
        a_c, alpha = self.accelerations(R, omega, ports)
        found |= self.of_motion(R, omega, alpha, r_c, v_c, a_c)
        rates = {"r_c": v_c, "v_c": a_c, "rotvec_b": relative, "omega_b": alpha}
        return [x for name in states for x in rates[name]], found

    def accelerations(self, R, omega, ports):
        load = {n: vec(getattr(self.scene.loads, n)) + ports.get(n, vec([0, 0, 0])) for n in PORTS}
        gravity = vec(self.scene.loads.gravity_a)
        force = load["force_a"] + R * load["force_b"]
        about_c = cross(-self.r, R.T * force)
        if self.pivot:
            about_c = cross(self.r, R.T * (self.m * gravity))
        damping = mpmath.matrix([c * w for c, w in zip(self.scene.loads.damping_b, omega, strict=True)])
        torque = R.T * load["torque_a"] + load["torque_b"] + about_c - damping
        return gravity + force / self.m, mpmath.lu_solve(self.M, torque - cross(omega, self.M * omega))

    def of_motion(self, R, omega, alpha, r_c, v_c, a_c):
        still = mpmath.matrix(3, 1)
        relative = cross(alpha, self.r) + cross(omega, cross(omega, self.r))
        energy = (omega.T * self.M * omega)[0] / 2 + (0 if self.pivot else self.m * (v_c.T * v_c)[0] / 2)
        return {
            "position": vec(self.scene.initial.position) if self.pivot else r_c - R * self.r,
            "velocity": still if self.pivot else v_c - R * cross(omega, self.r),
            "acceleration": still if self.pivot else a_c - R * relative, "alpha_b": alpha,
            "angular_momentum_a": R * self.M * omega, "kinetic_energy": [energy],
        }  # fmt: skip

    @staticmethod
    def rpy(R):
        return [mp.atan2(R[2, 1], R[2, 2]), -mp.asin(R[2, 0]), mp.atan2(R[1, 0], R[0, 0])]


def differences(scene, ports, states):
    """Return (rates, outputs) of central differences, a column for each error and input."""
    mp.dps = 50
    book, h = Textbook(scene, ports), mpf(STEP)
    count = 3 * len(states) + 3 * len(scene.inputs.ports)

    def all_of(k, sign):
        rates, found = book(states, [sign * h if j == k else mpf(0) for j in range(count)])
        return [*rates, *(x for name in scene.outputs.quantities for x in found[name])]

    columns = [[(a - b) / (2 * h) for a, b in zip(all_of(k, 1), all_of(k, -1), strict=True)] for k in range(count)]
    table = np.array([[float(x) for x in column] for column in columns]).T
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


def test_small_disturbances_of_a_simulation_follow_it():
    """Over a short time, x(t) = exp(A t) x(0), for a body at rest, of which A is constant."""
    rest = {"body": {"mass": 2.0, "inertia": TRIAXIAL, "r_oc_b": [0.1, 0.0, -0.5], "pivot": True}}
    rest |= {"run": {"stop": 1.0, "step": 1.0, "accuracy": 1e-9}}
    scene = rbfmu.Scene.from_dict(rest | {"loads": {"gravity_a": [2.0 * -0.2, 0.0, 2.0], "damping_b": [0.5, 0.5, 0.5]}})
    A = rbfmu.linearize(scene).A
    size, axis = 1e-5, np.array([0.6, -0.48, 0.64])
    moved = scene.replace({"initial.attitude": {"rotvec": (size * axis).tolist()}})
    found = rbfmu.simulate(moved).omega_b[-1]
    expected = (expm(A) @ np.concatenate([size * axis, np.zeros(3)]))[3:]
    assert np.linalg.norm(found - expected) < 1e-4 * np.linalg.norm(expected)


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


def test_the_end_of_the_run_is_a_time_of_it():
    scene = rbfmu.Scene.from_dict(UNLOADED | {"run": {"stop": 0.5}})
    assert rbfmu.linearize(scene, 0.5).time == 0.5


def test_a_linear_system_says_what_it_is():
    body = {"body": {"mass": 1.0, "inertia": [1.0, 2.0, 3.0]}, "inputs": {"ports": ["torque_b"]}}
    found = rbfmu.linearize(rbfmu.Scene.from_dict(body | {"outputs": {"quantities": ["omega_b"]}}))
    shapes = "A (6, 6), B (6, 3), C (3, 6), D (3, 3)"
    assert (
        repr(found) == f"Linearization(t = 0 s: {shapes}; states rotvec_b, omega_b; inputs torque_b; outputs omega_b)"
    )


FREE_BODY = {
    "body": {"mass": 2.0, "inertia": [[1.0, 0.1, 0.05], [0.1, 1.2, 0.02], [0.05, 0.02, 1.5]],
        "r_oc_b": [0.1, -0.2, 0.3]},
    "initial": {"omega_b": [0.3, -0.5, 0.9], "velocity": [0.1, 0.2, 0.3],
        "attitude": {"quaternion": [0.8, 0, -0.6, 0]}},
    "inputs": {"ports": ["torque_b", "force_a"]},
    "run": {"stop": 3.0, "step": 0.1, "accuracy": 1e-11},
}  # fmt: skip


@pytest.mark.parametrize("pivot", [False, True])
def test_loads_as_formulas_have_the_same_matrices(pivot):
    tables = FREE_BODY | {"body": FREE_BODY["body"] | {"pivot": pivot}}
    if pivot:
        tables |= {"initial": {k: v for k, v in tables["initial"].items() if k != "velocity"}}
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


def test_a_formula_without_a_derivative_is_refused():
    tables = FREE_BODY | {
        "loads": {"torque_b": "-0.1*omega_b"},
        "outputs": {"size": "norm(velocity - [0.1, 0.2, 0.3])"},
    }
    with pytest.raises(ValueError, match="no finite derivative at t = 0"):
        rbfmu.linearize(rbfmu.Scene.from_dict(tables | {"body": {"mass": 2.0, "inertia": [1, 2, 2.5]}}))
