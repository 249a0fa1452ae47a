"""What a scene must not be: one clear message for each fault, all of them at once."""

import datetime
import math
import pickle

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.spatial.transform import Rotation

from rbfmu.scene.body import Body
from rbfmu.scene.scene import Loads, Scene, SceneError, load_scene
from rbfmu_kernels.rotations.euler_angles import NAMES
from tests.support.scenes.bad_scenes import BAD_SCENES, BEAM, GOOD, TURNED_BEAM, text
from tests.support.scenes.scene_tables import DEFAULTS, scene, scene_tables, vectors

EPS = np.finfo(float).eps
KEYS = sorted({"x", "angles", "angles_deg", "kind", "sides", "radius", "shape"} | set().union(DEFAULTS, *GOOD.values()))
ANYTHING = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=9) | st.sampled_from([*NAMES, "box"]),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.sampled_from(KEYS), inner, max_size=4),
    max_leaves=12,
)


@pytest.mark.thorough
@settings(deadline=None, max_examples=100)
@given(tables=st.dictionaries(st.sampled_from(sorted(DEFAULTS)), ANYTHING), good=scene_tables())
def test_any_tables_are_a_scene_or_a_scene_error(tables, good):
    try:
        Scene.from_dict(good | tables)
    except SceneError as error:
        check_message(error, "scene")


def check_message(error, source):
    """One line for each fault: file, key, value, and what was expected; no jargon. A formula with its caret follows."""
    lines = [line for line in str(error).split("\n") if not line.startswith("    ")]
    assert len(lines) == len(error.faults) == len(set(lines))
    for line in lines:
        assert line.startswith(f"{source}: ")
        assert any(word in line for word in ("expected ", "unknown key", "not TOML"))
        assert not any(word in line for word in ("pydantic", "http", "Traceback", "ValueError", "object at", "<class"))
        assert len(line) < len(source) + 330


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


def test_wrong_formulas_are_reported_with_all_else():
    """What does not parse always; a name that nothing has where the tables with names are sound."""
    faults = faults_of(
        body={"mass": -1, "inertia": [1, 2, 2]}, loads={"torque_b": ["foo(", "0", "0"], "forc_b": "t"},
        constants={"k": "a"}, run={"stopp": 1},
    )  # fmt: skip
    keys = ["body.mass", "constants.k.value", "loads.forc_b", "loads.torque_b", "run.stopp"]
    assert sorted(fault.split(" = ")[0].split(":")[0] for fault in faults) == keys
    faults = faults_of(
        body={"mass": -1, "inertia": [1, 2, 2]}, loads={"torque_b": "[0, 0, foo]", "force_b": "[bar(2), 0, 0]"},
        formulas={"a": "b + c", "b": "foo", "c": "2*d", "d": "c"}, states={"u": {"start": 1.0, "rate": "omega_b"}},
        outputs={"x": "a", "y": "t - ", "z": "kinetic_energy"}, events={"v": "2", "w": "d"}, run={"stopp": 1},
    )  # fmt: skip
    keys = ["body.mass", "events.v.when", "formulas.b", "formulas.c", "loads.force_b", "loads.torque_b"]
    keys += ["outputs.y.value", "run.stopp", "states.u.rate"]
    assert sorted(fault.split(" = ")[0].split(":")[0] for fault in faults) == keys


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
    assert faults_of(loads={"wrench": 1})[0].endswith("torque_b, damping_b, potential")
    assert faults_of(loads={"potential": 3})[0].startswith("loads.potential = 3: expected a formula")
    assert faults_of(inputs={"ports": ["torqe_b"]}) == [
        'inputs.ports = ["torqe_b"]: expected torque_b in place of "torqe_b", '
        "or another out of force_a, force_b, torque_a, torque_b, omega_b"
    ]
    assert faults_of(run={"stop": datetime.date(1979, 5, 27)}) == ["run.stop = 1979-05-27: expected a number (s)"]
    assert faults_of(initial={"attitude": {"rotvec": "x" * 1000}})[0].count("x") < 80


@pytest.mark.parametrize(("start", "stop", "step", "beyond"), [
    (0.0, 1.0, 1.0, 1.0 + 2e-9), (0.1, 0.3, 0.2, 0.2 + 2e-9), (-0.3, 0.1, 0.4, 0.4 + 2e-9),
    (0.35, 2.37, 2.02, 2.02 + 5e-9), (0.0, 1e8 / 1024, 1.0 / 1024, math.nextafter(1.0 / 1024, 0.0)),
    (1e9, 1e9 + 1.0, 4.0 * math.ulp(1e9), math.nextafter(4.0 * math.ulp(1e9), 0.0)),
])  # fmt: skip
def test_a_step_may_be_what_is_said_to_be_its_limit(start, stop, step, beyond):
    """One step (to round-off), the most steps, and the least that the clock resolves."""
    run = {"start": start, "stop": stop, "step": step}
    assert scene(run=run).run.step == step
    assert len(faults_of(run=run | {"step": beyond})) == 1


def test_keys_are_named_as_they_are_written():
    assert [fault.split(" ")[0] for fault in faults_of(outputs={"größe": 1, "two\nlines": 1})] == [
        'outputs."größe"', r'outputs."two\nlines"',
    ]  # fmt: skip


def test_python_gets_the_same_messages():
    with pytest.raises(SceneError) as caught:
        Body(mass="heavy", inertia=[1, 2, 4], radius=1)
    assert len(caught.value.faults) == 3
    assert "body.mass" in str(caught.value)
    for call in (lambda: Loads(gravity_a=9.81), lambda: Scene(), lambda: Scene(body=3), lambda: Scene.from_dict([])):
        with pytest.raises(SceneError):
            call()
    assert str(pickle.loads(pickle.dumps(caught.value))) == str(caught.value)


def faults_of(**changes):
    with pytest.raises(SceneError) as caught:
        scene(**changes)
    return caught.value.faults


@pytest.mark.parametrize("changes", [
    {"initial": {"omega_b": [0, 1, 2]}},
    {"loads": {"torque_b": [0, 1, 2]}},
    {"loads": {"damping_b": [1, 2, 3]}},
    {"loads": {"force_a": [1, 2, 3], "force_b": [1, 2, 3]}, "inputs": {"ports": ["force_a", "force_b"]}},
    {"body": {"r_oc_b": [3, 0, 0]}, "loads": {"force_a": [1, 2, 3]}, "inputs": {"ports": ["force_a"]}},
    {"body": {"r_oc_b": [1, 1, 0]}, "loads": {"force_b": [1, 2, 0]}},
    {"body": {"r_oc_b": [1, 0, 0], "pivot": True}, "loads": {"force_a": [1, 2, 3], "torque_b": [0, 1, 0]}},
    {"body": {"r_oc_b": [1, 1e-8, 0], "pivot": True}, "loads": {"force_a": [1, 2, 3]},
     "inputs": {"ports": ["force_b"]}},
    {"body": {"r_oc_b": [1, 1, 0], "pivot": True}, "inputs": {"ports": ["torque_a"]},
     "initial": {"omega_b": [1, 2, 3]}},
])  # fmt: skip
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


@pytest.mark.parametrize(("line", "said"), [
    ("mass = 50.0 kg", "expected mass = 50.0 without a unit"), ("mass = 5e1kg", "expected mass = 5e1 without a unit"),
    ("inertia = [1, 2, 3] kg m2  # big", "expected inertia = [1, 2, 3] without a unit"), ("mass = 5,0", "(at line 3"),
])  # fmt: skip
def test_a_line_that_is_no_toml_is_shown_and_units_are_told_of(tmp_path, line, said):
    (tmp_path / "it.toml").write_text(f"# it\n[body]\n{line}\n")
    with pytest.raises(SceneError) as caught:
        load_scene(tmp_path / "it.toml")
    assert f': "{line}"' in str(caught.value)
    assert said in str(caught.value)
