"""The scene file: defaults, every way to write a value, round trips, other values by `Scene.replace`."""

import inspect
import json
import math
import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from scipy.spatial.transform import Rotation

from rbfmu.scene.body import Body
from rbfmu.scene.scene import QUANTITIES, Initial, Run, Scene, SceneError, load_scene
from rbfmu.scene.section import Section
from rbfmu_kernels.rotations.euler_angles import NAMES
from tests.support.paths import SCENES
from tests.support.scenes.bad_scenes import text
from tests.support.scenes.scene_tables import DEFAULTS, SMALLEST, scene, scene_tables

EPS = np.finfo(float).eps


def test_the_smallest_scene_has_the_defaults_and_is_the_scene_that_is_written_out():
    assert scene().to_dict() == DEFAULTS
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


def test_integers_and_numpy_arrays_are_numbers():
    numpy = Body(mass=np.float64(2), inertia=np.diag([1, 2, 2.5]), r_oc_b=np.zeros(3))
    assert repr(numpy) == repr(scene().body) == repr(scene(body={"mass": 2, "inertia": [1, 2, 2.5]}).body)
    assert Body(mass=np.int64(2), inertia=[np.float32(1.0), 2, np.array(2.5)]).inertia == scene().body.inertia


def test_a_scene_made_in_python_equals_one_from_tables():
    made = Scene(body=Body(mass=2.0, inertia=[1, 2, 2.5]), run=Run(stop=3), loads={"force_a": (1, 2, 3)})
    assert made == scene(run={"stop": 3.0}, loads={"force_a": [1, 2, 3]})
    assert hash(made) == hash(pickle.loads(pickle.dumps(made)))


@pytest.mark.parametrize("path", [*SCENES.rglob("*.toml"), SCENES.parent / "b_dot.toml"], ids=lambda path: path.stem)
def test_what_a_scene_prints_makes_it_again(path):
    """Also where loads, ports and outputs are formulas."""
    made = load_scene(path)
    known = {kind.__name__: kind for kind in every_section(Section)}
    assert eval(repr(made), known) == made
    assert "Loads()" not in repr(made)
    assert len(repr(made)) < 600 or made.has_formulas


def every_section(kind):
    yield kind
    for one in kind.__subclasses__():
        yield from every_section(one)


def test_the_order_of_names_of_ones_own_counts():
    """As that of quantities does; scenes that are equal have one hash."""
    x, y = {"x": "t"}, {"y": "2*t"}
    made, same, turned = (scene(outputs={"quantities": ["omega_b"], **own}) for own in (x | y, x | y, y | x))
    assert made == same
    assert hash(made) == hash(same)
    assert made.outputs.names != turned.outputs.names
    assert made != turned
    assert made.outputs != turned.outputs


def test_a_scene_cannot_be_changed():
    with pytest.raises(ValueError, match="frozen"):
        scene().run.stop = 3.0


def test_a_matrix_symmetric_to_round_off_is_stored_symmetric():
    M = scene(body={"mass": 1, "inertia": [[2, 0.1, 0], [0.1 + 1e-14, 2, 0], [0, 0, 3]]}).body.M_c
    assert M[0][1] == M[1][0] == 0.5 * (0.1 + (0.1 + 1e-14))


@pytest.mark.parametrize(("shape", "moments"), [
    ({"kind": "box", "sides": [1, 2, 3]}, [13 / 12, 10 / 12, 5 / 12]),
    ({"kind": "beam", "length": 6}, [0, 3, 3]),
    ({"kind": "cylinder", "radius": 2, "length": 6}, [4, 4, 2]),
    ({"kind": "sphere", "radius": 5}, [10, 10, 10]),
    ({"kind": "ellipsoid", "semiaxes": [1, 2, 3]}, [13 / 5, 10 / 5, 5 / 5]),
])  # fmt: skip
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


def test_a_quaternion_is_normalised_once():
    """What was normalised is unit to round-off, and normalising it again could change its last bits."""
    for q in np.random.default_rng(1).normal(size=(300, 4)):
        once = Initial(attitude={"quaternion": np.round(q / np.linalg.norm(q), 9).tolist()}).quaternion
        assert Initial(attitude={"quaternion": once}).quaternion == once


@pytest.mark.thorough
@settings(deadline=None, max_examples=150)
@given(scene_tables())
def test_a_scene_survives_json_to_the_bit(tables):
    made = Scene.from_dict(tables)
    again = Scene.from_dict(json.loads(json.dumps(made.to_dict())), source=made.name)
    assert again == made
    assert repr(again) == repr(made)  # the sign of zero as well
    assert again.to_dict() == made.to_dict()


def test_an_accuracy_may_be_as_bad_as_one():
    assert Run(accuracy=1).accuracy == 1.0


def test_loads_are_the_same_in_any_order():
    """Those that are formulas were written in the order of all loads, and so read back as another scene."""
    loads = {"torque_b": "[t, 0, 0]", "force_a": "[0, t, 0]"}
    one, other = (scene(loads=dict(rows)) for rows in ([*loads.items()], [*loads.items()][::-1]))
    assert one == other == Scene.from_dict(one.to_dict())


# Scene.replace


SCENE = scene(initial={"omega_b": [0.1, 0.2, 0.3], "position": [1, 2, 3]}, run={"stop": 3.0})


def test_dotted_keys_and_tables_say_the_same() -> None:
    expected = scene(initial={"omega_b": [0.1, 0.2, 0.3], "position": [1, 2, 3]}, run={"stop": 5.0, "step": 0.5})
    assert SCENE.replace({"run.stop": 5, "run.step": 0.5}) == expected
    assert SCENE.replace(run={"stop": 5, "step": 0.5}) == expected
    assert SCENE.replace({"run.step": 0.5}, run={"stop": 5}) == expected
    assert SCENE.replace(run=Run(stop=5, step=0.5)) == expected
    assert SCENE.run.stop == 3.0
    assert SCENE.replace() == SCENE
    assert SCENE.replace({"name": "other"}).name == "other"


def test_what_stands_in_place_of_a_key_removes_it() -> None:
    assert SCENE.replace({"initial.omega_b_deg": [180, 0, 0]}).initial.omega_b == (math.pi, 0.0, 0.0)
    turned = SCENE.replace({"initial.attitude.euler": "ZYX", "initial.attitude.angles": [math.pi, 0, 0]})
    assert turned.initial.quaternion[3] == pytest.approx(1.0)
    assert turned.initial.position == (1.0, 2.0, 3.0)
    ball = SCENE.replace({"body.shape.kind": "sphere", "body.shape.radius": 1.0})
    assert ball.body == Body(mass=2.0, shape={"kind": "sphere", "radius": 1.0})


def test_none_takes_a_table_away() -> None:
    """`events = None` was refused, and there was no other way to be rid of an event."""
    watched = SCENE.replace({"events.over": "omega_b[1]", "loads.torque_b": [1, 2, 3], "run.stop": 3.0})
    plain = watched.replace(events=None, loads=None, run=None)
    assert (plain.events, plain.loads, plain.run) == ({}, Scene(body=SCENE.body).loads, Run())
    assert plain.replace({"events.over": "omega_b[1]"}).events == watched.events


def test_quantities_that_nobody_asked_for_by_name_follow_from_the_motion() -> None:
    """A complaint about them would be about a key that nobody wrote."""
    still = SCENE.replace({"initial.omega_b": [0, 0, 0]})
    assert still.replace(body=None, inputs={"ports": ["omega_b"]}).outputs.quantities == (
        "quaternion",
        "rpy",
        "omega_a",
    )
    assert "position" not in SCENE.replace({"body.pivot": True}).outputs.quantities
    asked = SCENE.replace({"outputs.quantities": ["position"]})
    assert asked.replace({"body.pivot": True}).outputs.quantities == ("position",)


@pytest.mark.parametrize(("changes", "message"), [
    ({"run.stop": -5}, "run.stop = -5.0: expected a time after run.start"),
    ({"run.accuracy": math.nan}, "run.accuracy = nan: expected a finite number"),
    ({"run.stpo": 5}, "run.stpo = 5: unknown key; did you mean stop?"),
    ({"rn.stop": 5}, "rn = { stop = 5 }: unknown key; did you mean run?"),
    ({"run": 5}, "run = 5: expected a table"),
    ({"run.stop.x": 5}, "run.stop = { x = 5 }: expected a number"),
    ({"body": None}, "body is missing"),
    ({"initial": {"omega_b": [1, 0, 0], "omega_b_deg": [1, 0, 0]}}, "not both"),
    ({"body.mass": -1}, "body.mass = -1: expected a number > 0"),
])  # fmt: skip
def test_a_bad_change_is_a_scene_error(changes: dict[str, object], message: str) -> None:
    with pytest.raises(SceneError) as caught:
        SCENE.replace(changes)
    assert message in str(caught.value)
    assert str(caught.value).startswith("scene: ")


def test_help_of_a_table_shows_its_keys_and_what_they_are_by_default():
    shown = str(inspect.signature(Body))
    assert shown == "(*, mass, inertia, shape=Ellipsis, r_oc_b=(0.0, 0.0, 0.0), pivot=False)"
