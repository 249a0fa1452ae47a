"""The body that is drawn, how many pictures there are, and where things stand in them."""

import base64
from contextlib import suppress
from dataclasses import replace
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

import rbfmu
from rbfmu import viewer
from rbfmu.ensembles import chunks
from rbfmu.viewer import PLAIN, Motion, Shape, ghosts_of, motion_of_scene, page, shape_of
from rbfmu.viewer.page import LONGEST, Geometry, _notes
from rbfmu_kernels.quantities import own_output

MASS, SIDES = 3.0, (0.3, 0.2, 0.5)


def scene(**tables: dict) -> rbfmu.Scene:
    body = {"mass": MASS, "inertia": rbfmu.box_inertia(MASS, np.array(SIDES)).tolist()}
    return rbfmu.Scene.from_dict({"body": body, "run": {"stop": 2.0}} | tables)


def test_a_box_is_found_again_from_its_inertia() -> None:
    moments = np.diag(rbfmu.box_inertia(MASS, np.array(SIDES)))
    assert viewer.equivalent_box(MASS, moments) == pytest.approx(SIDES, rel=1e-14)


def test_a_box_in_any_axes_is_drawn_along_its_own() -> None:
    R_bp = rbfmu.matrix_from_euler("ZYX", np.array([0.4, -0.7, 1.1]))
    inertia = rbfmu.rotate_inertia(R_bp, rbfmu.box_inertia(MASS, np.array(SIDES)))
    inertia = (inertia + inertia.T) / 2.0
    shape = shape_of(scene(body={"mass": MASS, "inertia": inertia.tolist()}))
    drawn = rbfmu.rotate_inertia(
        rbfmu.matrix_from_quaternion(np.array(shape.q_bp)), rbfmu.box_inertia(MASS, np.array(shape.sides))
    )
    np.testing.assert_allclose(drawn, inertia, rtol=1e-12, atol=1e-15)
    assert sorted(shape.sides) == pytest.approx(sorted(SIDES), rel=1e-12)


def test_round_off_in_equal_moments_does_not_turn_what_is_drawn() -> None:
    inertia = [[1.0, 3e-17, 0.0], [3e-17, 1.0, -2e-17], [0.0, -2e-17, 2.0]]
    assert shape_of(scene(body={"mass": MASS, "inertia": inertia})).q_bp == (1.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize(("written", "kind", "sides"), [
    ({"kind": "box", "sides": [1, 2, 3]}, "box", (1, 2, 3)),
    ({"kind": "beam", "length": 2.0}, "box", (2, 2 * viewer.THINNEST, 2 * viewer.THINNEST)),
    ({"kind": "cylinder", "radius": 0.5, "length": 3}, "cylinder", (1, 1, 3)),
    ({"kind": "sphere", "radius": 0.5}, "ellipsoid", (1, 1, 1)),
    ({"kind": "ellipsoid", "semiaxes": [1, 2, 3]}, "ellipsoid", (2, 4, 6)),
])  # fmt: skip
def test_a_shape_of_a_scene_is_drawn_as_it_is(written: dict, kind: str, sides: tuple[float, ...]) -> None:
    shape = shape_of(scene(body={"mass": MASS, "shape": written, "r_oc_b": [0.1, 0.0, 0.0]}))
    assert (shape.kind, shape.sides, shape.centre) == (kind, sides, (0.1, 0.0, 0.0))
    assert shape.text.startswith(written["kind"])


STILL = rbfmu.Result([0.0, 1.0], {"quaternion": [[1.0, 0.0, 0.0, 0.0]] * 2})


@pytest.mark.parametrize("kind", ["box", "cylinder", "ellipsoid"])
def test_what_is_drawn_is_as_large_as_its_shape(kind: str) -> None:
    shape, scene = Shape(kind, (2.0, 2.0, 3.0), "", (0.1, 0.0, 0.0)), Mock()
    page._add_shape(scene, "/b/body", drawn := Geometry(Motion("", STILL, shape)), 0.5)
    (call,) = scene.method_calls
    given = call.kwargs
    across = {
        "box": lambda: given["dimensions"],
        "cylinder": lambda: [2.0 * given["radius"], 2.0 * given["radius"], given["height"]],
        "ellipsoid": lambda: 2.0 * given["radius"] * np.array(given["scale"]),
    }[kind]()
    np.testing.assert_allclose(across, np.array(shape.sides) / drawn.body_radius)
    np.testing.assert_allclose(given["position"], np.array(shape.centre) / drawn.body_radius)
    assert drawn.body_radius == pytest.approx(np.sqrt(17.0) / 2.0 + 0.1)


def test_roll_pitch_and_yaw_are_an_attitude() -> None:
    rpy = np.array([[0.4, -0.7, 1.1], [0.1, 0.2, 0.3]])
    found = Motion("", rbfmu.Result([0.0, 1.0], {"rpy": rpy}), PLAIN).quaternion
    np.testing.assert_allclose(found, rbfmu.quaternion_from_euler("ZYX", rpy[:, ::-1]), atol=1e-15)


def test_the_pace_is_said() -> None:
    said = [page._pace(factor) for factor in (0.05, 1.0, 3.0)]
    assert said == ["slowed down 20 times", "played in real time", "3 times as fast as it is"]


@pytest.mark.parametrize(
    ("span", "rate", "number", "played"),
    [
        (10.0, 0.0, 301, 10.0),  # in real time
        (3600.0, 0.0, 601, 20.0),
        (0.1, 0.0, 601, 20.0),
        (10.0, 20.0, 801, 800 / viewer.FPS),  # slowed down
        (10.0, 1e6, viewer.MAX_PICTURES, (viewer.MAX_PICTURES - 1) / viewer.FPS),
    ],
)
def test_pictures_are_as_many_as_the_eye_needs(span: float, rate: float, number: int, played: float) -> None:
    assert viewer.pictures(60.0, 0.0, rows=11) == (11, 2.2)  # few rows are not shown for minutes
    found = viewer.pictures(span, rate)
    assert found.number == number
    assert found.played == pytest.approx(played)
    assert found.number == viewer.MAX_PICTURES or rate * span / (found.number - 1) <= viewer.MAX_TURN


def test_arrows_and_trace_are_those_of_the_motion() -> None:
    motion = motion_of_scene(scene(initial={"omega_b": [0.3, 2.0, 0.2]}, loads={"gravity_a": [0, 0, 0]}))
    drawn = Geometry(motion)
    for name, vectors in (("h", motion.angular_momentum), ("ω", motion.rate)):
        arrows = drawn.arrows[name]
        sizes = np.linalg.norm(arrows, axis=1)
        assert sizes.max() == pytest.approx(page.LONGEST_ARROW[name])
        np.testing.assert_allclose(arrows * np.linalg.norm(vectors, axis=1)[:, None], vectors * sizes[:, None])
    assert drawn.traced == 1
    assert not any("too large" in note or "where the path begins" in note for note in _notes(drawn))
    R_ab = rbfmu.matrix_from_quaternion(motion.quaternion)
    np.testing.assert_allclose(drawn.trace, drawn.path + page.AXIS_B * R_ab[:, :, 1], atol=1e-14)


def spun(angles: np.ndarray, **further: Any) -> Motion:
    """Return a motion of a body that has turned about x by these angles at 7 s, 8 s and so on."""
    half = np.array(angles)[:, None] / 2.0
    quantities = {"quaternion": np.cos(half) * [1.0, 0.0, 0.0, 0.0] + np.sin(half) * [0.0, 1.0, 0.0, 0.0], **further}
    return Motion("", rbfmu.Result(7.0 + np.arange(len(half)), quantities), PLAIN, played=20.0)


def test_the_begin_of_a_long_trace_goes_again() -> None:
    lines: list[Mock] = []

    def add(_: str, ends: np.ndarray, *__: Any, visible: bool, **___: Any) -> Mock:
        lines.append(Mock(ends=ends, visible=visible))
        return lines[-1]

    drawn = Geometry(spun(np.arange(0.0, 60.0, 0.2)))
    show = page._trace(Mock(add_line_segments=add), drawn)
    for k in (150, 299):
        show(k)
        seen = np.concatenate([line.ends for line in lines if line.visible])
        way = np.linalg.norm(seen[:, 1] - seen[:, 0], axis=1).sum()
        assert way == pytest.approx(min(page.AXIS_B * 0.2 * k, page.TAIL), abs=1.0)
        np.testing.assert_allclose(seen[-1, 1], drawn.trace[k], atol=0.7)


def test_a_spin_that_is_not_seen_as_it_is_has_no_trace() -> None:
    drawn = [Geometry(spun(np.arange(10.0) * turn)) for turn in (0.9, 1.1)]
    assert [one.traced for one in drawn] == [2, None]
    assert ["63° between pictures, so its spin is not seen" in " ".join(_notes(one)) for one in drawn] == [
        False,
        True,
    ]


def test_whole_turns_between_pictures_are_not_taken_for_rest() -> None:
    """2,999 steps between pictures, each of 1.0005 turns: attitudes alone show a body that creeps."""
    rate = 2.0 * np.pi * 2999.0 / 10.0 * 1.0005
    body, outputs = {"mass": 1.0, "inertia": [1.0, 1.0, 1.5]}, {"quantities": ["quaternion"]}
    run = {"stop": 10.0, "step": 1e-3}
    motion = motion_of_scene(rbfmu.Scene(body=body, initial={"omega_b": [0, 0, rate]}, outputs=outputs, run=run))
    assert motion.largest_turn == pytest.approx(2.0 * np.pi * 1.0005, rel=1e-9)
    assert "360° between pictures, so its spin is not seen" in " ".join(_notes(Geometry(motion)))


def test_arrows_begin_at_the_centre_or_at_a_pivot() -> None:
    shape = Shape("box", (2.0, 2.0, 3.0), "", (0.5, 0.0, 0.0))
    for pivot, lever in ((False, 0.5), (True, 0.0)):
        drawn = Geometry(Motion("", STILL, shape, pivot=pivot))
        np.testing.assert_allclose(drawn.base - drawn.path, [[lever / drawn.body_radius, 0.0, 0.0]] * 2)


def test_the_axes_of_a_stand_at_its_origin_or_where_a_path_far_off_begins() -> None:
    for far, moved in ((3.9, False), (4.1, True)):
        place = np.array([far * PLAIN.radius, 0.0, 0.0])
        drawn = Geometry(spun(np.zeros(2), position=[place] * 2))
        np.testing.assert_array_equal(drawn.origin_a, moved * place)
        assert ("the axes of a stand where the path begins" in _notes(drawn)) is moved


def test_the_panel_has_the_time_of_a_run_that_begins_late_and_no_text_that_ends_its_script(monkeypatch) -> None:
    monkeypatch.setattr("rbfmu.viewer.page.record_page", lambda _: "<title></title><body></body>")
    motion, own = spun(np.arange(3.0)), {"spin": own_output("spin", 1, "1", "</script>")}
    quantities = motion.result.quantities | {"spin": np.zeros(3)}
    text = page.motion_page(replace(motion, result=rbfmu.Result(motion.result.time, quantities, own)))
    assert text.count("</script>") == 2
    data = page._data(Geometry(motion))
    time, played = (np.frombuffer(base64.b64decode(str(data[name]))) for name in ("time", "played"))
    assert (time.tolist(), played.tolist()) == ([7.0, 8.0, 9.0], [0.0, 10.0, 20.0])


def test_the_server_of_a_drawing_is_stopped(monkeypatch) -> None:
    monkeypatch.setattr("rbfmu.viewer.page.ViserServer", Mock())
    with suppress(KeyError), page._server() as server:
        assert not server.stop.called
        raise KeyError
    server.stop.assert_called_once_with()


FIELD = 0.7


def part_of_the_view(drawn: Geometry, points: np.ndarray) -> float:
    """How far from its middle to its border, across or upwards, the outermost of these points is seen."""
    target, place = drawn.camera(FIELD)
    right, above, toward = drawn.screen
    np.testing.assert_allclose((place - target) / np.linalg.norm(place - target), toward, atol=1e-12)
    deep = (place - points) @ toward
    aside = np.abs(np.stack([(points - target) @ right, (points - target) @ above]))
    return float(np.max(aside / deep)) / np.tan(FIELD / 2.0)


def test_the_stem_of_a_top_is_turned_to_its_centre() -> None:
    for way in ([0.0, 0.0, 2.0], [0.3, -0.4, 1.2], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]):
        turned = rbfmu.rotate(page._turn_of_z(np.array(way)), [0.0, 0.0, 1.0])
        np.testing.assert_allclose(turned, np.array(way) / np.linalg.norm(way), atol=1e-15)


def test_a_long_path_makes_the_body_larger_and_all_is_in_view() -> None:
    thrown = scene(initial={"velocity": [30.0, 0.0, 9.81]}, outputs={"quantities": ["position"]})
    drawn = Geometry(motion_of_scene(thrown))
    reach = np.linalg.norm(np.ptp(drawn.motion.position, axis=0)) / 2.0
    assert drawn.enlarged == pytest.approx(reach / (LONGEST * drawn.body_radius))
    assert f"the body is drawn {drawn.enlarged:.3g} times too large beside its path" in _notes(drawn)
    assert np.linalg.norm(np.ptp(drawn.path, axis=0)) / 2.0 == pytest.approx(LONGEST)
    assert part_of_the_view(drawn, drawn.path) < 1.0
    assert part_of_the_view(drawn, drawn.points) == pytest.approx(0.93, abs=0.06)  # the rest is for letters
    assert abs(drawn.toward @ [1.0, 0.0, 0.0]) < 0.4  # from the side of the path
    assert drawn.screen[0] @ [1.0, 0.0, 0.0] > 0.9  # on which it goes to the right
    assert drawn.toward[2] > 0.0


def test_paths_of_ghosts_count_as_well() -> None:
    vary = {"initial.velocity": {"normal": [[5.0, 0.0, 0.0], [1.0, 1.0, 1.0]]}}
    still = scene(loads={"gravity_a": [0, 0, 0]}, run={"stop": 100.0, "step": 1.0}, ensemble={"runs": 3, "vary": vary})
    drawn = Geometry(motion_of_scene(still, ghosts=3))
    points = np.vstack([drawn.path, *drawn.ghost_paths])
    assert np.linalg.norm(np.ptp(points, axis=0)) / 2.0 == pytest.approx(LONGEST)
    assert part_of_the_view(drawn, points) < 1.0
    target, place = drawn.camera(FIELD)
    assert np.linalg.norm(place - target) < 2.0 * LONGEST / np.tan(FIELD / 2.0)  # so near that a body of size 1 is seen


def test_members_that_failed_are_no_ghosts(monkeypatch: pytest.MonkeyPatch) -> None:
    vary = {"initial.velocity": {"normal": [[5.0, 0.0, 0.0], [1.0, 1.0, 1.0]]}}
    still, quantities = {"gravity_a": [0, 0, 0]}, ["position", "quaternion"]
    one = scene(loads=still, outputs={"quantities": quantities}, ensemble={"runs": 3, "vary": vary})
    every, run = ghosts_of(one, 3), chunks.run_chunk
    monkeypatch.setattr(chunks, "run_chunk", lambda *of: run(*of)._replace(failed={1: "it failed"}))
    np.testing.assert_array_equal([ghost.position for ghost in ghosts_of(one, 3)], [every[k].position for k in (0, 2)])


@pytest.mark.parametrize(("ghosts", "error", "said"), [
    *((n, ValueError, f"ghosts = {n}: expected a whole number from 0 to 50") for n in (-1, 51)),
    (1.5, ValueError, "ghosts = 1.5: expected a whole number"), (True, ValueError, "ghosts = true: expected a"),
    (3, rbfmu.SceneError, "ensemble is missing"),
])  # fmt: skip
def test_ghosts_are_refused_before_anything_is_planned(
    monkeypatch: pytest.MonkeyPatch, ghosts: Any, error: type[Exception], said: str
) -> None:
    monkeypatch.delattr("rbfmu.planning.select.plan")
    with pytest.raises(error, match=said):
        motion_of_scene(scene(), ghosts=ghosts)


def test_up_is_against_gravity() -> None:
    motion = motion_of_scene(scene(loads={"gravity_a": [0.0, 9.81, 0.0]}, outputs={"quantities": ["quaternion"]}))
    np.testing.assert_allclose(motion.up, [0.0, -1.0, 0.0])
    assert not motion.position.any()  # nobody asked for it
