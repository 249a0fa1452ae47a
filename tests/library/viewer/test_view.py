"""A motion as its page shows it: opened in a browser, and read back from what viser has recorded."""

import base64
import math
import re
from pathlib import Path

import msgspec
import numpy as np
import pytest
import zstandard

import rbfmu
from rbfmu.ensembles.members import draw, member
from rbfmu.viewer import MAX_PICTURES, PLAIN, Motion, shape_of
from rbfmu.viewer.page import Geometry
from tests.support.browser import browser, open_page
from tests.support.command_line import call
from tests.support.paths import SCENES

THROWN = {
    "name": "thrown <brick>", "body": {"mass": 2.0, "inertia": [0.01, 0.02, 0.025]},
    "initial": {"velocity": [1.0, 0.5, 2.0], "omega_b": [0.5, 3.0, 0.1]}, "run": {"stop": 0.6, "step": 0.01},
}  # fmt: skip


@pytest.fixture(scope="module")
def thrown(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Motion]:
    path = tmp_path_factory.mktemp("view") / "motion.html"
    return path, rbfmu.view(rbfmu.Scene.from_dict(THROWN), path)


def recorded(page: Path) -> list[tuple[float, dict]]:
    """Return the messages of a page with their times."""
    packed = re.search(r'__VISER_EMBED_DATA__="([^"]*)"', page.read_text(encoding="utf-8"))[1]
    data = zstandard.ZstdDecompressor().decompressobj().decompress(base64.b64decode(packed)[8:])
    length = int.from_bytes(data[:8], "little")
    return msgspec.msgpack.decode(data[8 : 8 + length])["messages"]


@pytest.mark.slow
@pytest.mark.skipif(not browser(), reason="no headless browser on PATH")
def test_the_page_moves_in_a_browser_without_network(thrown: tuple[Path, Motion]) -> None:
    path, motion = thrown
    with open_page(path) as page:
        pictures = []
        for part in (0.2, 0.8, 0.2):
            page.seek(part)
            pictures.append(page.picture())
            k = int(np.argmin(np.abs(motion.result.time - page.time)))
            for name in ("position", "quaternion", "omega_b", "kinetic_energy"):
                shown = motion.result.quantities[name][k]
                np.testing.assert_allclose(page.values(name), np.atleast_1d(shown), rtol=2e-4, atol=1e-12)
        same, other = (float(np.mean(np.abs(pictures[0] - pictures[k]))) for k in (2, 1))
        assert other > 0.01
        assert other > 5.0 * same
        before = page.time
        page.page.keyboard.press("Space")
        page.wait_until_time_is_not(before)
        assert page.page.title() == "thrown <brick>"
        assert page.fetched == [path.as_uri()]
        assert page.complaints == []


@pytest.mark.thorough
def test_the_body_has_the_attitude_and_place_of_each_picture(thrown: tuple[Path, Motion]) -> None:
    path, motion = thrown
    pose = [(time, message) for time, message in recorded(path) if message.get("name") == "/b"]
    played = (motion.result.time - motion.result.time[0]) * motion.played / 0.6
    turned = [(time, message["wxyz"]) for time, message in pose if message["type"] == "SetOrientationMessage"]
    for time, wxyz in turned:
        q = motion.result.quaternion[np.argmin(np.abs(played - time))]
        np.testing.assert_allclose(np.abs(np.dot(wxyz, q)), 1.0, rtol=1e-12)
    assert len(turned) >= len(played) - 1
    places = np.array([message["position"] for _, message in pose if message["type"] == "SetPositionMessage"])
    steps = np.diff(motion.result.position, axis=0)
    drawn = np.diff(places, axis=0)[-len(steps) :]
    np.testing.assert_allclose(drawn * (steps[-1] @ steps[-1]) / (drawn[-1] @ steps[-1]), steps, rtol=1e-6, atol=1e-9)


def test_the_trace_follows_its_tip_letters_stand_beyond_arrows_and_all_is_between_near_and_far(
    thrown: tuple[Path, Motion],
) -> None:
    path, motion = thrown
    drawn, messages, time = Geometry(motion), recorded(path), motion.result.time
    played = (time - time[0]) * motion.played / (time[-1] - time[0])
    in_the_panel = re.search(r'"played": "([^"]*)"', path.read_text(encoding="utf-8"))[1]
    np.testing.assert_allclose(np.frombuffer(base64.b64decode(in_the_panel)), played, atol=1e-9)
    shown = {int(m["name"][7:]): at for at, m in messages if m.get("visible") and m["name"].startswith("/trace/")}
    ends = [*sorted(shown)[1:], len(time) - 1]
    np.testing.assert_allclose([at for _, at in sorted(shown.items())], played[ends], atol=1e-9)
    for name, arrows in drawn.arrows.items():
        of_it = [m for _, m in messages if m.get("name") == f"/{name}_label" and "position" in m]
        longer = arrows * (1.0 + 0.2 / np.linalg.norm(arrows, axis=1))[:, None]
        np.testing.assert_allclose([m["position"] for m in of_it], drawn.base + longer, atol=1e-6)
    of_kind = {m["type"]: m for _, m in messages}
    deep = (np.array(of_kind["SetCameraPositionMessage"]["position"]) - drawn.points) @ drawn.toward
    assert of_kind["SetCameraNearMessage"]["near"] < np.min(deep)
    assert np.max(deep) < of_kind["SetCameraFarMessage"]["far"]


@pytest.mark.thorough
def test_the_size_of_a_page_is_bounded(tmp_path: Path) -> None:
    """All quantities at as many pictures as there may be: some 2 MB."""
    scene = rbfmu.Scene.from_dict(THROWN | {"initial": {"omega_b": [500.0, 3.0, 0.1]}, "run": {"stop": 10.0}})
    motion = rbfmu.view(scene, tmp_path / "motion.html")
    assert len(motion.result.time) == MAX_PICTURES
    assert (tmp_path / "motion.html").stat().st_size < 4e6
    text = (tmp_path / "motion.html").read_text(encoding="utf-8")
    assert re.search(r"up to \d+° between pictures", text)


@pytest.mark.parametrize(("inertia", "said"), [([0.01, 0.02, 0.025], 0), ([100.0, 200.0, 250.0], 1)])
def test_the_doubts_of_a_body_are_told_and_none_of_the_pictures(inertia: list[float], said: int, recwarn) -> None:
    """Of a fast spin it was said that run.step = 0.33, which nobody had given, has too many turns."""
    spun = {"body": {"mass": 2.0, "inertia": inertia}, "initial": {"omega_b": [0.0, 0.0, 100.0]}}
    rbfmu.view(rbfmu.Scene.from_dict(THROWN | spun | {"run": {"stop": 1000.0, "step": 0.01}}))
    assert ["radius of gyration" in str(warning.message) for warning in recwarn] == [True] * said


def test_a_page_names_frames_units_and_scales(thrown: tuple[Path, Motion]) -> None:
    text = thrown[0].read_text(encoding="utf-8")
    rate = f"longest {np.max(np.linalg.norm(thrown[1].result.omega_b, axis=1)):.3g} rad/s"
    momentum = np.max(np.linalg.norm(thrown[1].result.angular_momentum_a, axis=1))
    about = f"h: angular momentum about the centre of mass, longest {momentum:.3g} kg m²/s"
    for part in ("<h1>thrown &lt;brick&gt;</h1>", "fixed in space", "fixed in the body", rate, about, "kg m2/s"):
        assert part in text
    assert "box with the body&#x27;s mass and inertia" in text
    assert "inputs at" not in text  # there are none


def test_a_scene_is_drawn_with_its_shape_from_a_file_or_not() -> None:
    path = SCENES / "flywheel.toml"
    shapes = [rbfmu.view(source).shape for source in (path, rbfmu.load_scene(path))]
    assert [shape.kind for shape in shapes] == ["cylinder"] * 2


def test_a_result_is_shown_with_or_without_its_body(tmp_path: Path) -> None:
    scene = rbfmu.Scene.from_dict(THROWN)
    rbfmu.simulate(scene).save(tmp_path / "it.npz")
    plain = rbfmu.view(tmp_path / "it.npz", tmp_path / "plain.html")
    assert "the inertia is not known" in (tmp_path / "plain.html").read_text(encoding="utf-8")
    assert (plain.title, plain.shape) == ("it", PLAIN)
    own = rbfmu.view(tmp_path / "it.npz", tmp_path / "own.html", scene=scene, stop=0.305)
    assert own.shape == shape_of(scene)
    assert own.result.time[-1] == pytest.approx(0.3)
    with pytest.raises(ValueError, match="scene: expected a result with it"):
        rbfmu.view(scene, scene=scene)


@pytest.mark.parametrize("keep", [("position",), ("omega_b",)])
def test_a_result_without_attitude_is_refused(keep: tuple[str, ...], tmp_path: Path) -> None:
    scene = rbfmu.Scene.from_dict(THROWN | {"outputs": {"quantities": keep}})
    rbfmu.simulate(scene).save(tmp_path / "it.csv")
    done = call("view", tmp_path / "it.csv", "-o", tmp_path / "it.html")
    assert done.exit_code == 2
    assert f"quaternion or rpy: expected one of them in the result, which has {keep[0]}" in done.stderr
    assert not (tmp_path / "it.html").exists()


@pytest.mark.parametrize(("changed", "said"), [
    ({"quaternion": 0.0}, "quaternion in row 2 has length 0: expected 1"),
    ({"quaternion": math.nan}, "quaternion = nan in row 2: expected numbers"),
    ({"position": math.inf}, "position = inf in row 2: expected numbers"),
])  # fmt: skip
def test_what_is_no_motion_is_refused(changed: dict[str, float], said: str) -> None:
    """It stood in the page without a word."""
    rows = {"quaternion": np.tile([1.0, 0.0, 0.0, 0.0], (3, 1)), "position": np.zeros((3, 3))}
    for name, value in changed.items():
        rows[name][1] = value
    with pytest.raises(ValueError, match=said):
        rbfmu.view(rbfmu.Result([0.0, 1.0, 2.0], rows))


@pytest.mark.parametrize("times", [[0.0, 0.0, 0.0], [0.0, 2.0, 1.0]])
def test_times_of_a_result_that_do_not_increase_are_refused(times: list[float]) -> None:
    """2026-12-01: a view of them ended with "float division by zero", or with a message of viser."""
    result = rbfmu.Result(times, {"quaternion": np.tile([1.0, 0.0, 0.0, 0.0], (3, 1))})
    with pytest.raises(ValueError, match=r"^time = .* in row .: expected times that increase"):
        rbfmu.view(result)


def test_inputs_drive_what_is_shown(tmp_path: Path) -> None:
    """A torque of 0.4 N m about 0.2 kg m2 for 1 s, from rest: 2 rad/s."""
    driven = {"body": {"mass": 2.0, "inertia": [0.1, 0.2, 0.2]}, "inputs": {"ports": ["torque_b"]}}
    scene = rbfmu.Scene.from_dict(driven | {"run": {"stop": 1.0, "step": 0.1}})
    table = {"torque_b": (np.array([0.0]), np.array([[0.0, 0.0, 0.4]]))}
    motion = rbfmu.view(scene, tmp_path / "it.html", inputs=table)
    np.testing.assert_allclose(motion.rate[-1], [0.0, 0.0, 2.0], atol=1e-6)
    motion.result.save(tmp_path / "it.npz")
    with pytest.raises(ValueError, match="inputs: expected a scene with them"):
        rbfmu.view(tmp_path / "it.npz", tmp_path / "it.html", inputs=table)


def test_a_page_says_where_inputs_are_that_nothing_drives() -> None:
    ports = [{"name": "u", "size": 1, "unit": "N m", "start": 0.1}]
    scene = rbfmu.Scene.from_dict(TUMBLING | {"inputs": {"ports": ports}, "loads": {"torque_b": "[u, 0, 0]"}})
    assert rbfmu.view(scene).notes == ("inputs at their start",)
    assert rbfmu.view(scene.replace({"inputs.ports": [{**ports[0], "start": 0.0}]})).notes == ("inputs at zero",)


@pytest.mark.thorough
def test_outputs_of_ones_own_are_in_the_panel(tmp_path: Path) -> None:
    scene = rbfmu.Scene.from_dict(THROWN | {"outputs": {"spin": {"value": "norm(omega_b)", "unit": "rad/s"}}})
    shown = rbfmu.view(scene, tmp_path / "it.html").page
    again = rbfmu.view(rbfmu.simulate(scene)).page
    assert all('"name": "spin", "unit": "rad/s"' in page for page in (shown, again))


@pytest.mark.thorough
def test_the_command_says_what_it_wrote(tmp_path: Path) -> None:
    done = call("view", SCENES / "top_precessing.toml", "-o", tmp_path / "top.html", "--stop", "0.2")
    assert done.exit_code == 0, done.output
    assert re.fullmatch(r".*top\.html: \d\.\d MB, \d+ pictures, played in \d+ s\n", done.output)
    assert "cylinder, 0.06 × 0.06 × 0.01 m" in (tmp_path / "top.html").read_text(encoding="utf-8")


def test_no_file_is_overwritten_unasked_and_a_notebook_shows_the_motion(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("rbfmu.viewer.page.motion_page", lambda motion: f"<p>{motion.title}</p>")
    shown = rbfmu.view(rbfmu.Scene.from_dict(THROWN | {"outputs": {"quantities": ["quaternion"]}}))
    assert list(tmp_path.iterdir()) == []
    assert '<iframe srcdoc="&lt;p&gt;thrown &lt;brick&gt;&lt;/p&gt;"' in shown._repr_html_()
    (tmp_path / "motion.html").write_text("mine")
    done = call("view", SCENES / "fixed_camera.toml", "--stop", "0.2")
    assert done.exit_code == 2
    assert "motion.html: exists already, and stays as it is; -o motion.html writes over it" in done.stderr
    assert (tmp_path / "motion.html").read_text() == "mine"
    assert call("view", SCENES / "fixed_camera.toml", "--stop", "0.2", "-o", "motion.html").exit_code == 0
    assert (tmp_path / "motion.html").read_text() == "<p>fixed_camera</p>"


TUMBLING = {
    "body": {"mass": 2.0, "inertia": [1.0, 1.2, 1.4]},
    "initial": {"omega_b": [0.3, 0.2, 1.0], "velocity": [1.0, 0.0, 0.0]},
    "loads": {"gravity_a": [0.0, 0.0, 0.0]},
    "run": {"stop": 4.0, "step": 1.0},
    "ensemble": {"runs": 5, "vary": {"initial.omega_b": {"normal": [[0.3, 0.2, 1.0], [0.2, 0.2, 0.2]]}}},
}


def test_a_run_that_an_event_ends_early_has_as_many_pictures_as_one_that_stops_there() -> None:
    events = {"end": {"when": "t - 0.05", "stop": True}}
    scene = rbfmu.Scene.from_dict(TUMBLING | {"events": events, "run": {"stop": 20.0, "step": 1.0}})
    motion = rbfmu.view(scene)
    assert (len(motion.result.time), motion.result.time[-1], motion.played) == (601, pytest.approx(0.05), 20.0)
    at_once = scene.replace({"events": {"end": {"when": "t", "stop": True}}})
    with pytest.raises(ValueError, match="two points in time in the result, which has 1"):
        rbfmu.view(at_once)


@pytest.mark.thorough
def test_ghosts_are_runs_of_the_ensemble(tmp_path: Path) -> None:
    scene = rbfmu.Scene.from_dict(TUMBLING)
    motion = rbfmu.view(scene, tmp_path / "motion.html", ghosts=3)
    samples = draw(scene, 0, 5)
    for number in range(3):
        stepped = member(scene, samples, number).replace(run={"step": 4.0 / (len(motion.result.time) - 1)})
        single = rbfmu.simulate(stepped)
        np.testing.assert_allclose(motion.ghosts[number].quaternion, single.quaternion, atol=1e-6)
        np.testing.assert_allclose(motion.ghosts[number].position, single.position, atol=1e-6)
        pose = [m for _, m in recorded(tmp_path / "motion.html") if m.get("name") == f"/ghost_{number}"]
        turned = [m["wxyz"] for m in pose if m["type"] == "SetOrientationMessage"]
        np.testing.assert_allclose(turned[-1], motion.ghosts[number].quaternion[-1], atol=1e-12)
    assert "pale bodies: 3 runs of the ensemble" in (tmp_path / "motion.html").read_text(encoding="utf-8")
    assert len(rbfmu.view(scene, tmp_path / "motion.html", ghosts=9).ghosts) == 5


def test_ghosts_of_a_driven_scene_are_refused() -> None:
    with pytest.raises(ValueError, match="ghosts = 2: expected a scene with them, and no inputs"):
        rbfmu.view(rbfmu.Scene.from_dict(TUMBLING), ghosts=2, inputs={})
