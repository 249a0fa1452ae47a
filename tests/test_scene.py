"""The scene file: defaults, every way to write a value, round trips, and one clear message for each fault."""

import datetime
import json
import math
import pickle
import subprocess
import sys

import numpy as np
import pytest
from bad_scenes import BAD_SCENES, BEAM, GOOD, TURNED_BEAM, text
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from rbfmu.body import Body
from rbfmu.scene import PARAMETERS, PORTS, QUANTITIES, Initial, Loads, Run, Scene, SceneError, load_scene
from rbfmu_kernels.euler_angles import NAMES

EPS = np.finfo(float).eps
SMALLEST = {"body": {"mass": 2.0, "inertia": [1.0, 2.0, 2.5]}}
DEFAULTS = {
    "name": "scene",
    "body": {
        "mass": 2.0,
        "inertia": [[1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 2.5]],
        "r_oc_b": [0.0, 0.0, 0.0],
        "pivot": False,
    },
    "initial": {
        "position": [0.0, 0.0, 0.0],
        "velocity": [0.0, 0.0, 0.0],
        "attitude": {"quaternion": [1.0, 0.0, 0.0, 0.0]},
        "omega_b": [0.0, 0.0, 0.0],
    },
    "loads": {
        "gravity_a": [0.0, 0.0, -9.81],
        "force_a": [0.0, 0.0, 0.0],
        "force_b": [0.0, 0.0, 0.0],
        "torque_a": [0.0, 0.0, 0.0],
        "torque_b": [0.0, 0.0, 0.0],
        "damping_b": [0.0, 0.0, 0.0],
    },
    "inputs": {"ports": [], "parameters": []},
    "outputs": {
        "quantities": [
            *("position", "velocity", "acceleration", "quaternion", "rpy", "omega_b", "omega_a", "alpha_b"),
            *("angular_momentum_a", "kinetic_energy"),
        ]
    },
    "run": {"start": 0.0, "stop": 10.0, "step": 0.01, "accuracy": 1e-6},
}
"""What the smallest scene means: every key of the file with its default."""


def scene(**changes):
    return Scene.from_dict(SMALLEST | changes)


def faults_of(**changes):
    with pytest.raises(SceneError) as caught:
        scene(**changes)
    return caught.value.faults


# --- What a scene means


def test_the_smallest_scene_has_the_defaults():
    assert scene().to_dict() == DEFAULTS


def test_the_written_defaults_are_the_scene_again():
    assert Scene.from_dict(DEFAULTS) == scene()


def test_a_file_gives_its_name_to_a_scene_without_one(tmp_path):
    path = tmp_path / "tumbling_brick.toml"
    path.write_text(text({}))
    assert load_scene(path).name == "tumbling_brick"
    path.write_text(text({}, head='name = "another"'))
    assert load_scene(str(path)).name == "another"


def test_a_byte_order_mark_and_windows_lines_do_no_harm(tmp_path):
    path = tmp_path / "scene.toml"
    path.write_bytes(b"\xef\xbb\xbf" + text({}).replace("\n", "\r\n").encode())
    assert load_scene(path).body.mass == 2.0


def test_integers_are_numbers():
    assert repr(scene(body={"mass": 2, "inertia": [1, 2, 2.5]}).body) == repr(scene().body)


def test_numpy_arrays_are_numbers_in_python():
    body = Body(mass=np.float64(2), inertia=np.diag([1, 2, 2.5]), r_oc_b=np.zeros(3))
    assert repr(body) == repr(scene().body)
    assert Body(mass=np.int64(2), inertia=[np.float32(1.0), 2, np.array(2.5)]).inertia == scene().body.inertia


def test_a_scene_made_in_python_equals_one_from_tables():
    made = Scene(body=Body(mass=2.0, inertia=[1, 2, 2.5]), run=Run(stop=3), loads={"force_a": (1, 2, 3)})
    assert made == scene(run={"stop": 3.0}, loads={"force_a": [1, 2, 3]})
    assert hash(made) == hash(pickle.loads(pickle.dumps(made)))


def test_a_scene_cannot_be_changed():
    with pytest.raises(ValueError, match="frozen"):
        scene().run.stop = 3.0


def test_a_matrix_symmetric_to_round_off_is_stored_symmetric():
    M = scene(body={"mass": 1, "inertia": [[2, 0.1, 0], [0.1 + 1e-14, 2, 0], [0, 0, 3]]}).body.M_c
    assert M[0][1] == M[1][0]
    assert math.isclose(M[0][1], 0.1, rel_tol=1e-13)


@pytest.mark.parametrize(
    ("shape", "moments"),
    [
        ({"kind": "box", "sides": [1, 2, 3]}, [13 / 12, 10 / 12, 5 / 12]),
        ({"kind": "beam", "length": 6}, [0, 3, 3]),
        ({"kind": "cylinder", "radius": 2, "length": 6}, [4, 4, 2]),
        ({"kind": "sphere", "radius": 5}, [10, 10, 10]),
        ({"kind": "ellipsoid", "semiaxes": [1, 2, 3]}, [13 / 5, 10 / 5, 5 / 5]),
    ],
)
def test_a_shape_is_its_inertia(shape, moments):
    made = Body(mass=2, shape=shape)
    np.testing.assert_allclose(made.M_c, 2 * np.diag(moments), rtol=3 * EPS)
    assert made == Body(mass=2, inertia=made.M_c)


def test_the_inertia_about_a_pivot_is_about_o():
    held = Body(mass=2, inertia=[1, 2, 2.5], r_oc_b=[0, 0, 3], pivot=True)
    assert held.M == held.M_o == ((19.0, 0.0, 0.0), (0.0, 20.0, 0.0), (0.0, 0.0, 2.5))
    assert held.M_c == Body(mass=2, inertia=[1, 2, 2.5], r_oc_b=[0, 0, 3]).M


@pytest.mark.parametrize("sequence", NAMES)
def test_euler_angles_are_those_of_scipy(sequence):
    table = {"euler": sequence, "angles_deg": [170, -80, 35]}
    q = scene(initial={"attitude": table}).initial.quaternion
    expected = Rotation.from_euler(sequence, table["angles_deg"], degrees=True).as_quat(scalar_first=True)
    assert 1 - abs(np.dot(q, expected)) < 4 * EPS
    radians = {"euler": sequence, "angles": [math.radians(x) for x in table["angles_deg"]]}
    assert scene(initial={"attitude": radians}).initial.quaternion == q


def test_rotation_vectors_and_matrices_are_those_of_scipy():
    for u in ([0.3, -2.0, 1.0], [0, 0, 0], [1e-9, 0, 0], [0, math.pi, 0], [0, 0, -20.0]):
        rotation = Rotation.from_rotvec(u)
        for table in ({"rotvec": u}, {"matrix": rotation.as_matrix().tolist()}):
            q = Initial(attitude=table).quaternion
            assert 1 - abs(np.dot(q, rotation.as_quat(scalar_first=True))) < 8 * EPS


@pytest.mark.parametrize("key", ["quaternion", "matrix"])
def test_seven_typed_digits_are_enough_for_an_attitude(key):
    rotation = Rotation.from_rotvec([0.3, -2.0, 1.0])
    exact = rotation.as_matrix() if key == "matrix" else rotation.as_quat(scalar_first=True)
    q = Initial(attitude={key: np.round(exact, 7).tolist()}).quaternion
    assert abs(math.hypot(*q) - 1) <= 2 * EPS
    assert Rotation.from_quat(q, scalar_first=True).approx_equal(rotation, atol=1e-6)


def test_degrees_per_second_are_turned_into_radians():
    assert Initial(omega_b_deg=[180, 90, -45]).omega_b == (math.pi, math.pi / 2, -math.pi / 4)


def test_quantities_default_to_what_moves():
    held = scene(body=SMALLEST["body"] | {"pivot": True})
    assert held.outputs.quantities == QUANTITIES[3:]
    assert Scene.from_dict({"inputs": {"ports": ["omega_b"]}}).outputs.quantities == ("quaternion", "rpy", "omega_a")


def test_prescribed_rates_need_no_body():
    rates = Scene.from_dict({"inputs": {"ports": ["omega_b"], "parameters": ["quaternion_0"]}})
    assert rates.body is None
    assert Scene.from_dict(rates.to_dict()) == rates


# --- Round trips


def numbers(low=-1e3, high=1e3):
    return st.floats(low, high)


def vectors(low=-1e3, high=1e3):
    return st.lists(numbers(low, high), min_size=3, max_size=3)


@st.composite
def bodies(draw):
    size = numbers(1e-2, 1e2)
    kind = draw(st.sampled_from(["moments", "matrix", "box", "cylinder", "sphere", "ellipsoid"]))
    body = {"mass": draw(numbers(1e-6, 1e3)), "r_oc_b": draw(vectors(-10, 10)), "pivot": draw(st.booleans())}
    if kind in ("box", "ellipsoid"):
        sides = draw(st.lists(size, min_size=3, max_size=3))
        return body | {"shape": {"kind": kind, "sides" if kind == "box" else "semiaxes": sides}}
    if kind in ("cylinder", "sphere"):
        lengths = {"radius": draw(size), "length": draw(size)}
        return body | {
            "shape": {"kind": kind} | {k: x for k, x in lengths.items() if kind == "cylinder" or k == "radius"}
        }
    x, y, z = draw(numbers(1e-3, 1)), draw(numbers(1e-3, 1)), draw(numbers(1e-3, 1))
    moments = [y + z, z + x, x + y]
    R = Rotation.from_rotvec(draw(vectors(-4, 4))).as_matrix()
    return body | {"inertia": moments if kind == "moments" else (R @ np.diag(moments) @ R.T).tolist()}


@st.composite
def attitudes(draw):
    way = draw(st.sampled_from(["euler", "euler_deg", "quaternion", "rotvec", "matrix"]))
    vector = draw(vectors(-7, 7))
    rotation = Rotation.from_rotvec(vector)
    if way.startswith("euler"):
        return {"euler": draw(st.sampled_from(NAMES)), "angles_deg" if way == "euler_deg" else "angles": vector}
    return {
        "quaternion": {"quaternion": rotation.as_quat(scalar_first=True).tolist()},
        "rotvec": {"rotvec": vector},
        "matrix": {"matrix": rotation.as_matrix().tolist()},
    }[way]


@st.composite
def scene_tables(draw):
    """Valid scenes in all their variety, but for slender beams, as nested tables."""
    some = lambda names, least=0: st.lists(st.sampled_from(names), unique=True, min_size=least)  # noqa: E731
    body = draw(bodies())
    ports = draw(some(PORTS[:4]))
    parameters = draw(some([p for p in PARAMETERS if p not in ports and not (body["pivot"] and p == "velocity_0")]))
    initial = {"position": draw(vectors()), "attitude": draw(attitudes())}
    initial[draw(st.sampled_from(["omega_b", "omega_b_deg"]))] = draw(vectors())
    if not body["pivot"]:
        initial["velocity"] = draw(vectors())
    start, span = draw(numbers()), draw(numbers(1e-3, 1e3))
    loads = {key: draw(vectors()) for key in ("gravity_a", "force_a", "force_b", "torque_a", "torque_b")}
    tables = {
        "name": draw(st.text(st.characters(categories=["L", "N"]), min_size=1, max_size=20)),
        "body": body,
        "initial": initial,
        "loads": loads | {"damping_b": draw(vectors(0, 1e3))},
        "inputs": {"ports": ports, "parameters": parameters},
        "outputs": {"quantities": draw(some(QUANTITIES, least=1))},
        "run": {"start": start, "stop": start + span, "step": span / 7, "accuracy": draw(numbers(1e-15, 1))},
    }
    kept = {key: value for key, value in tables.items() if key == "body" or draw(st.integers(0, 4))}
    return kept


@settings(deadline=None, max_examples=150)
@given(scene_tables())
def test_a_scene_survives_json_to_the_bit(tables):
    made = Scene.from_dict(tables)
    again = Scene.from_dict(json.loads(json.dumps(made.to_dict())), source=made.name)
    assert again == made
    assert repr(again) == repr(made)  # the sign of zero as well
    assert again.to_dict() == made.to_dict()


KEYS = sorted({"x", "angles", "angles_deg", "kind", "sides", "radius", "shape"} | set().union(DEFAULTS, *GOOD.values()))
ANYTHING = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=9) | st.sampled_from([*NAMES, "box"]),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.sampled_from(KEYS), inner, max_size=4),
    max_leaves=12,
)


@settings(deadline=None, max_examples=300)
@given(tables=st.dictionaries(st.sampled_from(sorted(DEFAULTS)), ANYTHING), good=scene_tables())
def test_any_tables_are_a_scene_or_a_scene_error(tables, good):
    try:
        Scene.from_dict(good | tables)
    except SceneError as error:
        check_message(error, "scene")


# --- What is refused


def check_message(error, source):
    """One line for each fault: file, key, value, and what was expected; no jargon."""
    lines = str(error).split("\n")
    assert len(lines) == len(error.faults) == len(set(lines))
    for line in lines:
        assert line.startswith(f"{source}: ")
        assert any(word in line for word in ("expected ", "unknown key", "not TOML"))
        assert not any(word in line for word in ("pydantic", "http", "Traceback", "ValueError", "object at", "<class"))
        assert len(line) < len(source) + 330


def test_there_are_many_bad_scenes():
    assert len(BAD_SCENES) >= 300
    assert len({bad.name for bad in BAD_SCENES}) == len(BAD_SCENES)


def test_the_scene_that_bad_ones_are_made_from_is_good(tmp_path):
    path = tmp_path / "good.toml"
    path.write_text(text({}))
    assert load_scene(path).to_dict()["body"]["mass"] == 2.0
    for body in (BEAM, TURNED_BEAM):
        path.write_text(text({}, {"body": body}))
        assert load_scene(path).body.axis_without_inertia is not None


@pytest.mark.parametrize("bad", BAD_SCENES, ids=lambda bad: bad.name)
def test_a_bad_scene_is_one_clear_message(bad, tmp_path):
    path = tmp_path / "bad.toml"
    path.write_bytes(bad.content)
    with pytest.raises(SceneError) as caught:
        load_scene(path)
    check_message(caught.value, str(path))
    assert bad.fragment in str(caught.value)


def test_what_is_no_file_is_a_scene_error(tmp_path):
    for path in (tmp_path, tmp_path / "missing.toml", tmp_path / "null\0.toml", "missing"):
        with pytest.raises(SceneError) as caught:
            load_scene(path)
        assert len(caught.value.faults) == 1
        assert str(caught.value).startswith(f"{path}: ")


def test_all_faults_are_reported_at_once():
    faults = faults_of(
        name="",
        body={"mass": -1, "inertia": [1, 2, 4], "pivto": True},
        initial={
            "position": [1, 2],
            "attitude": {"euler": "ZYX", "angles": [1, 2], "x": 1},
            "omega_b": 1,
            "omega_b_deg": 1,
        },
        loads={"gravity_a": 9.81},
        inputs={"ports": ["torque_c"]},
        outputs={"quantities": []},
        run={"stop": "1", "step": 0},
        mass=1,
    )
    keys = [
        *("mass", "body.pivto", "body.mass", "body.inertia", "initial.attitude.x", "initial.attitude.angles"),
        *("initial.omega_b_deg", "initial.position", "initial.omega_b", "loads.gravity_a", "inputs.ports"),
        *("outputs.quantities", "run.stop", "run.step", "name"),
    ]
    assert sorted(fault.split(" = ")[0] for fault in faults) == sorted(keys)


def test_sections_are_compared_though_others_are_bad():
    faults = faults_of(body={"mass": 1, "shape": {"kind": "beam", "length": 1}}, initial={"omega_b": [1, 0, 0]}, run=1)
    assert [fault.split(" = ")[0] for fault in faults] == ["run", "initial.omega_b"]


def test_messages_read_well():
    assert faults_of(body={"mass": -1, "inertia": [1, 1, 1]}) == ["body.mass = -1: expected a number > 0 (kg)"]
    assert faults_of(loads={"force_a": [1, math.nan, 0]}) == [
        "loads.force_a = [1, nan, 0]: expected 3 finite numbers (N)"
    ]
    assert faults_of(run={"step": True}) == ["run.step = true: expected a number > 0 (s)"]
    assert faults_of(lods={}) == ["lods = {}: unknown key; did you mean loads?"]
    assert faults_of(run={"gravity_a": [0, 0, 0]})[0].endswith("unknown key; did you mean loads.gravity_a?")
    assert faults_of(inputs={"ports": ["torqe_b"]}) == [
        'inputs.ports = ["torqe_b"]: expected torque_b in place of "torqe_b"'
    ]
    assert faults_of(run={"stop": datetime.date(1979, 5, 27)}) == ["run.stop = 1979-05-27: expected a number (s)"]
    assert faults_of(initial={"attitude": {"rotvec": "x" * 1000}})[0].count("x") < 80


def test_python_gets_the_same_messages():
    with pytest.raises(SceneError) as caught:
        Body(mass="heavy", inertia=[1, 2, 4], radius=1)
    assert len(caught.value.faults) == 3
    assert "body.mass" in str(caught.value)
    for call in (lambda: Loads(gravity_a=9.81), lambda: Scene(), lambda: Scene(body=3), lambda: Scene.from_dict([])):
        with pytest.raises(SceneError):
            call()
    assert str(pickle.loads(pickle.dumps(caught.value))) == str(caught.value)


@pytest.mark.parametrize(
    "changes",
    [
        {"initial": {"omega_b": [0, 1, 2]}},
        {"loads": {"torque_b": [0, 1, 2]}},
        {"loads": {"damping_b": [1, 2, 3]}},
        {"loads": {"force_a": [1, 2, 3], "force_b": [1, 2, 3]}, "inputs": {"ports": ["force_a", "force_b"]}},
        {"body": {"r_oc_b": [3, 0, 0]}, "loads": {"force_a": [1, 2, 3]}, "inputs": {"ports": ["force_a"]}},
        {"body": {"r_oc_b": [1, 1, 0]}, "loads": {"force_b": [1, 2, 0]}},
        {"body": {"r_oc_b": [1, 0, 0], "pivot": True}, "loads": {"force_a": [1, 2, 3], "torque_b": [0, 1, 0]}},
        {
            "body": {"r_oc_b": [1, 1, 0], "pivot": True},
            "inputs": {"ports": ["torque_a"]},
            "initial": {"omega_b": [1, 2, 3]},
        },
        {"inputs": {"ports": ["omega_b"]}},
    ],
)
def test_a_beam_may_do_what_does_not_turn_it_about_its_axis(changes):
    body = {"mass": 1, "shape": {"kind": "beam", "length": 2}} | changes.get("body", {})
    assert Scene.from_dict(changes | {"body": body}).body is not None


@settings(deadline=None)
@given(turn=vectors(-4, 4), rate=vectors(-10, 10))
def test_a_turned_beam_is_a_beam(turn, rate):
    R = Rotation.from_rotvec(turn).as_matrix()
    M = R @ np.diag([0, 3.0, 3.0]) @ R.T
    across = R @ np.array([0, rate[1], rate[2]])
    body = {"mass": 1, "inertia": M.tolist()}
    made = Scene.from_dict({"body": body, "initial": {"omega_b": across.tolist()}})
    assert abs(made.body.axis_without_inertia @ R[:, 0]) > 1 - 8 * EPS
    with pytest.raises(SceneError, match=r"no rate about \("):
        Scene.from_dict(
            {"body": body, "initial": {"omega_b": (across + 1e-9 * (1 + 10 * abs(rate[1])) * R[:, 0]).tolist()}}
        )


def test_a_point_mass_is_a_pendulum_on_a_pivot_only():
    assert Body(mass=1, inertia=[0, 0, 0], r_oc_b=[1, 0, 0], pivot=True).axis_without_inertia == (1.0, 0.0, 0.0)
    for body in ({"r_oc_b": [1, 0, 0]}, {"pivot": True}):
        with pytest.raises(SceneError, match="at most one zero moment"):
            Body(mass=1, inertia=[0, 0, 0], **body)


def test_round_off_in_the_inertia_is_no_fault():
    for M in ([[1, 0, 0], [0, 1, 5e-13], [0, 0, 1]], [-5e-13, 1, 1], [1, 2, 3 + 1e-12]):
        assert Body(mass=1, inertia=M)


def test_importing_the_package_does_not_import_pydantic():
    code = "import sys, rbfmu; assert 'pydantic' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True, cwd="/", env={"PYTHONPATH": ":".join(sys.path)})
