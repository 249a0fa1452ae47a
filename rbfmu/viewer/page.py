"""The page that plays a motion: a drawing recorded by viser, and a panel over it with title, values and colours."""

import base64
import json
import re
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from html import escape
from importlib.resources import files
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import rich
import viser

from rbfmu.types import Array
from rbfmu.viewer import geometry as lengths
from rbfmu.viewer.geometry import AXIS_A, AXIS_B, STROBE, Geometry
from rbfmu.viewer.motion import Motion

BODY, MOMENTUM, RATE, TRACE, FIXED = (130, 165, 205), (213, 94, 0), (0, 130, 95), (190, 90, 150), (120, 120, 120)
CHUNKS = 200
"""Pieces of the trace, each of which appears when the tip has passed."""
TAIL = 60.0
"""The length of the trace that stays, in sizes of the body."""
FIELD_OF_VIEW = 0.7
LETTERS = ("x", "y", "z")
SEEN = {MOMENTUM: "#dca640", RATE: "#15a092", TRACE: "#c95fa6"}
"""What colours look like in the drawing's light."""


def motion_page(motion: Motion) -> str:
    """Return the page that plays a motion."""
    geometry = Geometry(motion)
    panel = files("rbfmu.viewer").joinpath("panel.html").read_text(encoding="utf-8")
    data = json.dumps(_data(geometry)).replace("<", "\\u003c")
    filled = {"TITLE": escape(motion.title), "LEGEND": _legend(geometry), "DATA": data}
    panel = re.sub(r"\$([A-Z]+)", lambda found: filled[found[1]], panel)
    titled = f"<title>{filled['TITLE']}</title>"
    page = re.sub("<title>.*?</title>", lambda _: titled, record_page(geometry), count=1)
    before, end, after = page.rpartition("</body>")
    return f"{before}{panel}{end}{after}"


def _data(geometry: Geometry) -> dict[str, Any]:
    result = geometry.motion.result
    passed = result.time - result.time[0]
    played = passed * (geometry.motion.played / float(passed[-1]))
    quantities = [
        {key: getattr(result.rows[name], key) for key in ("name", "unit", "meaning", "components")}
        | {"values": _as_base64(values)}
        for name, values in result.quantities.items()
    ]
    return {"time": _as_base64(result.time), "played": _as_base64(played), "quantities": quantities}


def _as_base64(values: Any) -> str:
    return base64.b64encode(np.ascontiguousarray(values, dtype="<f8").tobytes()).decode("ascii")


def _legend(geometry: Geometry) -> str:
    motion = geometry.motion
    rows = [("axes", "thin axes: a, fixed in space; thick axes: b, fixed in the body; x red, y green, z blue")]
    if motion.angular_momentum is not None:
        point = "o" if motion.pivot else "the centre of mass"
        rows.append((SEEN[MOMENTUM], f"h: angular momentum about {point}, {_longest(motion.angular_momentum)} kg m²/s"))
    if motion.rate is not None:
        rows.append((SEEN[RATE], f"ω: angular velocity of b in a, {_longest(motion.rate)} rad/s"))
    if geometry.traced is not None:
        rows.append((SEEN[TRACE], f"trace: tip of the body's axis {LETTERS[geometry.traced]}_b"))
    rows += [("", note) for note in _notes(geometry)]
    return "".join(f'<li><i style="background:{color}"></i>{escape(text)}</li>' for color, text in rows)


def _notes(geometry: Geometry) -> list[str]:
    motion, span = geometry.motion, float(geometry.motion.result.time[-1] - geometry.motion.result.time[0])
    notes = [f"body: {motion.shape.text}"]
    if motion.ghosts:
        notes.append(f"pale bodies: {len(motion.ghosts)} runs of the ensemble")
    if geometry.enlarged > 1.0:
        notes.append(f"the body is drawn {geometry.enlarged:.3g} times too large beside its path")
    if np.any(geometry.origin_a):
        notes.append("the axes of a stand where the path begins")
    notes.append(_pace(span / motion.played))
    if motion.largest_turn > STROBE:
        turn = f"it turns by up to {np.degrees(motion.largest_turn):.0f}° between pictures"
        notes.append(f"{turn}, so its spin is not seen as it is: show a shorter time")
    return [*notes, *motion.notes]


def _pace(factor: float) -> str:
    if abs(factor - 1.0) < 0.01:
        return "played in real time"
    return f"{factor:.3g} times as fast as it is" if factor > 1.0 else f"slowed down {1.0 / factor:.3g} times"


def _longest(vectors: Any) -> str:
    return f"longest {float(np.max(np.linalg.norm(vectors, axis=1))):.3g}"


def record_page(geometry: Geometry) -> str:
    """Return the page that plays the motion."""
    with _server() as server:
        _look(server, geometry)
        parts: list[Any] = [_body(server, geometry), _Trace(server, geometry), *_arrows(server, geometry)]
        parts += _ghosts(server, geometry)
        recording = server.get_scene_serializer()
        pauses = np.diff(geometry.motion.result.time)
        pauses *= geometry.motion.played / pauses.sum()
        for k in range(len(geometry.path)):
            for part in parts:
                part.show(k)
            recording.insert_sleep(float(pauses[k]) if k < len(pauses) else 1.0 / 30.0)
        return str(recording.as_html())


@contextmanager
def _server() -> Iterator[viser.ViserServer]:
    """Run viser's server on this machine alone; it says nothing."""
    console = rich.get_console()
    with ExitStack() as stack:
        stack.callback(setattr, console, "quiet", console.quiet)
        console.quiet = True
        server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
        stack.callback(server.stop)
        yield server


def _look(server: viser.ViserServer, geometry: Geometry) -> None:
    target, place = geometry.camera(FIELD_OF_VIEW)
    distance = float(np.linalg.norm(place - target))
    server.scene.set_up_direction(geometry.motion.up)
    camera = server.initial_camera
    camera.look_at, camera.position, camera.up = target, place, np.array(geometry.motion.up)
    camera.fov, camera.near, camera.far = FIELD_OF_VIEW, distance / 100.0, distance * 100.0
    _axes(server, "/a", AXIS_A, 0.012, "a", geometry.place(geometry.origin_a))


def _axes(server: viser.ViserServer, name: str, length: float, radius: float, frame: str, position: Any) -> Any:
    axes = server.scene.add_frame(name, axes_length=length, axes_radius=radius, origin_radius=0.0, position=position)
    for letter, place in zip(LETTERS, np.eye(3) * 1.07 * length, strict=True):
        server.scene.add_label(f"{name}/{letter}", f"{letter}_{frame}", position=place, anchor="center-center")
    return axes


class _Moving(NamedTuple):
    """A frame with what is drawn in it, and where it comes to: q_ab (n, 4), o (n, 3) in the drawing."""

    frame: Any
    quaternion: Array
    path: Array

    def show(self, k: int) -> None:
        self.frame.wxyz, self.frame.position = self.quaternion[k], self.path[k]


def _body(server: viser.ViserServer, geometry: Geometry) -> _Moving:
    """Draw the body and the axes of b, which move with it."""
    shape, scene = geometry.motion.shape, server.scene
    axes = _axes(server, "/b", AXIS_B, 0.03, "b", geometry.path[0])
    _add_shape(scene, "/b/body", geometry, 0.85)
    if any(shape.centre):
        centre = np.array(shape.centre) / geometry.body_radius  # thicker than an axis, which may lie in it
        scene.add_cylinder("/b/stem", radius=0.06, height=float(np.linalg.norm(centre)), color=FIXED,
                           wxyz=_turn_of_z(centre), position=centre / 2.0)  # fmt: skip
    return _Moving(axes, geometry.motion.quaternion, geometry.path)


def _turn_of_z(way: Array) -> Array:
    """Return the unit quaternion of a turn that takes z to the direction of a vector."""
    x, y, z = way / np.linalg.norm(way)
    half = np.array([1.0 + z, -y, x, 0.0])
    return half / np.linalg.norm(half) if z > -1.0 + 1e-9 else np.array([0.0, 1.0, 0.0, 0.0])


def _add_shape(scene: Any, name: str, geometry: Geometry, opacity: float) -> None:
    """Draw the body's shape in the frame that the name begins with."""
    shape = geometry.motion.shape
    sides = np.array(shape.sides) / geometry.body_radius
    place: dict[str, Any] = {"wxyz": shape.q_bp, "position": np.array(shape.centre) / geometry.body_radius}
    place |= {"color": BODY, "opacity": opacity}
    if shape.kind == "box":
        scene.add_box(name, dimensions=sides, **place)
    elif shape.kind == "cylinder":
        scene.add_cylinder(name, radius=sides[0] / 2.0, height=sides[2], flat_shading=True, **place)
    else:
        scene.add_icosphere(name, radius=0.5, scale=tuple(sides), flat_shading=True, **place)


def _ghosts(server: viser.ViserServer, geometry: Geometry) -> Iterator[_Moving]:
    """Draw members of the ensemble: pale bodies."""
    paths = geometry.ghost_paths
    for number, (ghost, path) in enumerate(zip(geometry.motion.ghosts, paths, strict=True)):
        frame = server.scene.add_frame(f"/ghost_{number}", show_axes=False)
        _add_shape(server.scene, f"/ghost_{number}/body", geometry, max(0.1, min(0.3, 3.0 / len(paths))))
        yield _Moving(frame, ghost.quaternion, path)


class _Arrow:
    """A vector of a, drawn from the body; hidden where it is zero."""

    def __init__(self, server: viser.ViserServer, name: str, color: Any, vectors: Array, base: Array) -> None:
        self.ends, self.lengths = np.stack([base, base + vectors], axis=1), np.linalg.norm(vectors, axis=1)
        size = {"shaft_radius": 0.035, "head_radius": 0.09, "head_length": 0.25}
        self.arrow = server.scene.add_arrows(f"/{name}", self.ends[:1], color, **size)
        self.label = server.scene.add_label(f"/{name}_label", name, anchor="center-center")

    def show(self, k: int) -> None:
        seen = bool(self.lengths[k] > 0.02)
        _set_visible(self.arrow, seen)
        _set_visible(self.label, seen)
        if seen:
            base, tip = self.ends[k]
            self.arrow.points = self.ends[k : k + 1]
            self.label.position = tip + 0.2 * (tip - base) / self.lengths[k]


def _arrows(server: viser.ViserServer, geometry: Geometry) -> Iterator[_Arrow]:
    h, omega = geometry.motion.angular_momentum, geometry.motion.rate
    if h is not None:
        yield _Arrow(server, "h", MOMENTUM, geometry.arrows(h, lengths.MOMENTUM), geometry.base)
    if omega is not None:
        yield _Arrow(server, "ω", RATE, geometry.arrows(omega, lengths.RATE), geometry.base)


class _Trace:
    """The path of o, and the way of an axis' tip, which appears in pieces and goes again when it is long."""

    def __init__(self, server: viser.ViserServer, geometry: Geometry) -> None:
        self.pieces: list[tuple[int, float, Any]] = []
        if np.ptp(geometry.path, axis=0).any():
            _line(server, "/path", geometry.path, FIXED)
        tip = geometry.trace
        if geometry.traced is None:
            return
        self.way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(tip, axis=0), axis=1))])
        borders = np.unique(np.linspace(0, len(tip) - 1, CHUNKS + 1).round().astype(int))
        for first, last in pairwise(borders):
            piece = _line(server, f"/trace/{first}", tip[first : last + 1], TRACE, visible=False)
            self.pieces.append((int(last), float(self.way[last]), piece))

    def show(self, k: int) -> None:
        for last, way, piece in self.pieces:
            _set_visible(piece, bool(last <= k and self.way[k] - way < TAIL))


def _set_visible(part: Any, visible: bool) -> None:
    """Record it only where it changes: each setting is a message in the page."""
    if part.visible != visible:
        part.visible = visible


def _line(server: viser.ViserServer, name: str, points: Array, color: Any, visible: bool = True) -> Any:
    ends = np.stack([points[:-1], points[1:]], axis=1)
    return server.scene.add_line_segments(name, ends, color, thickness=0.02, visible=visible)
