"""The page that plays a motion: a drawing that viser records, and over it a panel with title, values and colours."""

import base64
import json
import re
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import cached_property
from html import escape
from importlib.resources import files
from itertools import pairwise

import numpy as np
import rich
from viser import FrameHandle, LineSegmentsHandle, SceneApi, ViserServer

from rbfmu.arrays import rotate
from rbfmu.types import Array
from rbfmu.viewer import Motion, longest

# Positions in the drawing, where the unit of length is the radius of the body as it is drawn


LONGEST = 8.0
"""The reach of a path, in radii of the body, up to which body and path are drawn to the same scale."""
AXIS_B, AXIS_A, LONGEST_ARROW = 1.6, 2.1, {"h": 2.6, "ω": 2.0}
"""The lengths of the axes of b, of those of a, and of the longest angular momentum and rate."""
LETTER = 0.25
"""The room for letters beyond the tips of axes and arrows."""
STILL = 0.05
"""The length (rad) up to which the way of an axis' tip is too short for a trace."""
STROBE = 1.0
"""The angle between pictures (rad) from which on a spin looks wrong."""


class Geometry:
    """The positions and directions in the drawing of a motion."""

    def __init__(self, motion: Motion) -> None:
        self.motion, shape = motion, motion.shape
        self.paths = np.vstack([motion.position, *(ghost.position for ghost in motion.ghosts)])
        """All positions of o (n, 3), m, including those of the ghosts."""
        self.reach = float(np.linalg.norm(np.ptp(self.paths, axis=0))) / 2.0
        """Half the diagonal of the box around all paths of o (m)."""
        self.body_radius = shape.radius + float(np.linalg.norm(shape.centre))
        """The radius of the body about o (m)."""
        self.enlarged = max(1.0, self.reach / (LONGEST * self.body_radius))
        """The factor by which the body is drawn too large compared with the paths."""
        self.unit = self.body_radius * self.enlarged
        """The length in m along a path that has the length 1 in the drawing."""
        begin = motion.position[0]
        self.origin_a = begin if np.linalg.norm(begin) > 2.0 * self.reach + 4.0 * self.unit else np.zeros(3)
        """Where the axes of a are drawn (m): at its origin, or at the start of the path if that is far away."""
        points = np.vstack([self.paths, self.origin_a[None]])
        self.middle = (points.min(axis=0) + points.max(axis=0)) / 2.0
        """The middle of all that is drawn (m)."""
        self.path, self.ghost_paths = self.place(motion.position), [self.place(g.position) for g in motion.ghosts]
        """The path of o in the drawing (n, 3), and that of each ghost."""
        lever = rotate(motion.quaternion, np.array(shape.centre) / self.body_radius)
        self.base = self.path if motion.pivot else self.path + lever
        """Where arrows begin (n, 3): at the centre of mass, or at o if that is a pivot."""
        self.toward = _toward(np.array(motion.up), self.path[-1] - self.path[0])
        """The direction from the middle to the viewer."""
        right = np.cross(motion.up, self.toward)
        right /= np.linalg.norm(right)
        self.screen = np.stack([right, np.cross(self.toward, right), self.toward])
        """The directions to the right, upwards and to the viewer, as rows."""

    def place(self, points: Array) -> Array:
        """Return points in a (..., 3), m, as points in the drawing."""
        return np.asarray((points - self.middle) / self.unit)

    @cached_property
    def points(self) -> Array:
        """Return the outermost points of the drawing (n, 3): those of bodies, and the tips of axes and arrows."""
        arrows = [self.base + vectors for vectors in self.arrows.values()]
        tips = [self.path + AXIS_B * self._tips(k) for k in range(3)]
        paths = self.place(self.paths)
        bodies = [paths + sign * side for sign in (-1.0, 1.0) for side in self.screen[:2]]
        return np.vstack([self.place(self.origin_a) + AXIS_A * np.eye(3), *tips, *arrows, *bodies])

    def camera(self, field_of_view: float) -> tuple[Array, Array]:
        """Return (point looked at, camera position), with which all that is drawn just fits, including letters.

        field_of_view: the angle of view, rad.
        """
        seen = self.points @ self.screen.T
        middle = (seen.min(axis=0) + seen.max(axis=0)) / 2.0
        aside = np.max(np.abs(seen - middle)[:, :2], axis=1) + LETTER
        distance = float(np.max(aside / np.tan(field_of_view / 2.0) + seen[:, 2] - middle[2]))
        return middle @ self.screen, (middle + np.array([0.0, 0.0, distance])) @ self.screen

    @cached_property
    def arrows(self) -> dict[str, Array]:
        """Return the arrows (n, 3) of angular momentum and rate by their names, as far as these are known."""
        known = {"h": self.motion.angular_momentum, "ω": self.motion.rate}
        return {name: v * (LONGEST_ARROW[name] / (longest(v) or 1.0)) for name, v in known.items() if v is not None}

    @cached_property
    def traced(self) -> int | None:
        """Return the axis (0, 1 or 2) of b whose tip leaves a trace, or None.

        It is the one that moves least, but more than `STILL`. There is none if the spin looks wrong (`STROBE`).
        """
        ways = [float(np.sum(np.linalg.norm(np.diff(self._tips(k), axis=0), axis=1))) for k in range(3)]
        moved = [k for k in range(3) if ways[k] > STILL]
        return min(moved, key=lambda k: (ways[k], -k)) if moved and self.motion.largest_turn < STROBE else None

    @cached_property
    def trace(self) -> Array:
        """Return the path of the traced axis' tip in the drawing (n, 3)."""
        return self.path + AXIS_B * self._tips(self.traced or 0)

    def _tips(self, axis: int) -> Array:
        return np.asarray(rotate(self.motion.quaternion, np.eye(3)[axis]))


def _toward(up: Array, way: Array) -> Array:
    """Return the direction from which the motion is seen: across the way of o, and a little from above."""
    side = np.eye(3)[int(np.argmin(np.abs(up)))]
    across = np.cross(up, way)
    if np.linalg.norm(across) > 1.0:
        side = -across
    side = side - up * (up @ side)
    side /= np.linalg.norm(side)
    direction = 0.85 * side + 0.35 * np.cross(up, side) + 0.4 * up
    return np.asarray(direction / np.linalg.norm(direction))


# The page


Color = tuple[int, int, int]
BODY, TRACE, FIXED = (130, 165, 205), (190, 90, 150), (120, 120, 120)
ARROW = {"h": (213, 94, 0), "ω": (0, 130, 95)}
CHUNKS = 200
"""The number of pieces of the trace; each appears after the tip has passed it."""
TAIL = 60.0
"""The length of the trace that remains visible, in radii of the body."""
FIELD_OF_VIEW = 0.7
LETTERS = ("x", "y", "z")
SEEN = {"h": "#dca640", "ω": "#15a092", "trace": "#c95fa6"}
"""Colours for the legend: how these arrows and the trace look in the light of the drawing."""


def motion_page(motion: Motion) -> str:
    """Return the HTML page that plays a motion, with its panel."""
    geometry = Geometry(motion)
    panel = files("rbfmu.viewer").joinpath("panel.html").read_text(encoding="utf-8")
    data = json.dumps(_data(geometry)).replace("<", "\\u003c")
    filled = {"TITLE": escape(motion.title), "LEGEND": _legend(geometry), "DATA": data}
    panel = re.sub(r"\$([A-Z]+)", lambda found: filled[found[1]], panel)
    page = re.sub("(?<=<title>).*?(?=</title>)", lambda _: filled["TITLE"], record_page(geometry), count=1)
    before, end, after = page.rpartition("</body>")
    return f"{before}{panel}{end}{after}"


def _data(geometry: Geometry) -> dict[str, object]:
    result = geometry.motion.result
    passed = result.time - result.time[0]
    played = passed * (geometry.motion.played / float(passed[-1]))
    quantities = [
        {key: getattr(result.rows[name], key) for key in ("name", "unit", "meaning", "components")}
        | {"values": _as_base64(values)}
        for name, values in result.quantities.items()
    ]
    return {"time": _as_base64(result.time), "played": _as_base64(played), "quantities": quantities}


def _as_base64(values: Array) -> str:
    return base64.b64encode(np.ascontiguousarray(values, dtype="<f8").tobytes()).decode("ascii")


def _legend(geometry: Geometry) -> str:
    motion = geometry.motion
    rows = [("axes", "thin axes: a, fixed in space; thick axes: b, fixed in the body; x red, y green, z blue")]
    if (h := motion.angular_momentum) is not None:
        point = "o" if motion.pivot else "the centre of mass"
        rows.append((SEEN["h"], f"h: angular momentum about {point}, longest {longest(h):.3g} kg m²/s"))
    if (rate := motion.rate) is not None:
        rows.append((SEEN["ω"], f"ω: angular velocity of b in a, longest {longest(rate):.3g} rad/s"))
    if geometry.traced is not None:
        rows.append((SEEN["trace"], f"trace: tip of the body's axis {LETTERS[geometry.traced]}_b"))
    rows += [("", note) for note in _notes(geometry)]
    return "".join(f'<li><i style="background:{color}"></i>{escape(text)}</li>' for color, text in rows)


def _notes(geometry: Geometry) -> list[str]:
    motion, span = geometry.motion, float(geometry.motion.result.time[-1] - geometry.motion.result.time[0])
    turn = f"it turns by up to {np.degrees(motion.largest_turn):.0f}° between pictures"
    notes = {
        f"body: {motion.shape.text}": True,
        f"pale bodies: {len(motion.ghosts)} runs of the ensemble": motion.ghosts,
        f"the body is drawn {geometry.enlarged:.3g} times too large beside its path": geometry.enlarged > 1.0,
        "the axes of a stand where the path begins": np.any(geometry.origin_a),
        _pace(span / motion.played): True,
        f"{turn}, so its spin is not seen as it is: show a shorter time": motion.largest_turn > STROBE,
    }
    return [*(note for note, holds in notes.items() if holds), *motion.notes]


def _pace(factor: float) -> str:
    if abs(factor - 1.0) < 0.01:
        return "played in real time"
    return f"{factor:.3g} times as fast as it is" if factor > 1.0 else f"slowed down {1.0 / factor:.3g} times"


def record_page(geometry: Geometry) -> str:
    """Return the HTML page of viser that plays the motion, without a panel."""
    with _server() as server:
        _look(server, geometry)
        scene, motion = server.scene, geometry.motion
        parts = [_body(scene, geometry), _trace(scene, geometry), *_ghosts(scene, geometry)]
        parts += [_arrow(scene, name, vectors, geometry.base) for name, vectors in geometry.arrows.items()]
        recording = server.get_scene_serializer()
        pauses = np.diff(motion.result.time)
        pauses *= motion.played / pauses.sum()
        for k, pause in enumerate([*pauses.tolist(), 1.0 / 30.0]):
            for show in parts:
                show(k)
            recording.insert_sleep(pause)
        return str(recording.as_html())


@contextmanager
def _server() -> Iterator[ViserServer]:
    """Run viser's server, which only this machine can reach, without its messages."""
    console = rich.get_console()
    with ExitStack() as stack:
        stack.callback(setattr, console, "quiet", console.quiet)
        console.quiet = True
        server = ViserServer(host="127.0.0.1", port=0, verbose=False)
        stack.callback(server.stop)
        yield server


def _look(server: ViserServer, geometry: Geometry) -> None:
    target, place = geometry.camera(FIELD_OF_VIEW)
    distance = float(np.linalg.norm(place - target))
    server.scene.set_up_direction(geometry.motion.up)
    camera = server.initial_camera
    camera.look_at, camera.position, camera.up = target, place, np.array(geometry.motion.up)
    camera.fov, camera.near, camera.far = FIELD_OF_VIEW, distance / 100.0, distance * 100.0
    _axes(server.scene, "/a", AXIS_A, 0.012, "a", geometry.place(geometry.origin_a))


Show = Callable[[int], None]
"""A function that moves a part of the drawing to its place in picture k."""


def _axes(scene: SceneApi, name: str, length: float, radius: float, frame: str, position: Array) -> FrameHandle:
    axes = scene.add_frame(name, axes_length=length, axes_radius=radius, origin_radius=0.0, position=position)
    for letter, place in zip(LETTERS, np.eye(3) * 1.07 * length, strict=True):
        scene.add_label(f"{name}/{letter}", f"{letter}_{frame}", position=place, anchor="center-center")
    return axes


def _moving(frame: FrameHandle, quaternion: Array, path: Array) -> Show:
    """Return what moves a frame and all that is drawn in it; quaternion: q_ab (n, 4); path: o in the drawing (n, 3)."""

    def show(k: int) -> None:
        frame.wxyz, frame.position = quaternion[k], path[k]

    return show


def _body(scene: SceneApi, geometry: Geometry) -> Show:
    """Draw the body and the axes of b; return what moves both."""
    centre = np.array(geometry.motion.shape.centre) / geometry.body_radius
    axes = _axes(scene, "/b", AXIS_B, 0.03, "b", geometry.path[0])
    _add_shape(scene, "/b/body", geometry, 0.85)
    if any(centre):  # a stem from o to the centre, thicker than the axes, which may lie inside it
        scene.add_cylinder("/b/stem", radius=0.06, height=float(np.linalg.norm(centre)), color=FIXED,
                           wxyz=_turn_of_z(centre), position=centre / 2.0)  # fmt: skip
    return _moving(axes, geometry.motion.quaternion, geometry.path)


def _turn_of_z(way: Array) -> Array:
    """Return a unit quaternion that turns the z axis into the direction of a vector."""
    x, y, z = way / np.linalg.norm(way)
    half = np.array([1.0 + z, -y, x, 0.0])
    return half / np.linalg.norm(half) if z > -1.0 + 1e-9 else np.array([0.0, 1.0, 0.0, 0.0])


def _add_shape(scene: SceneApi, name: str, geometry: Geometry, opacity: float) -> None:
    """Draw the body's shape in the frame that is the first part of its name."""
    shape = geometry.motion.shape
    sides, centre = np.array(shape.sides) / geometry.body_radius, np.array(shape.centre) / geometry.body_radius
    place = {"wxyz": shape.q_bp, "position": centre, "color": BODY, "opacity": opacity}
    if shape.kind == "box":
        scene.add_box(name, dimensions=sides, **place)
    elif shape.kind == "cylinder":
        scene.add_cylinder(name, radius=sides[0] / 2.0, height=sides[2], flat_shading=True, **place)
    else:
        scene.add_icosphere(name, radius=0.5, scale=tuple(sides), flat_shading=True, **place)


def _ghosts(scene: SceneApi, geometry: Geometry) -> Iterator[Show]:
    """Draw members of the ensemble as pale bodies; yield what moves each."""
    paths = geometry.ghost_paths
    for number, (ghost, path) in enumerate(zip(geometry.motion.ghosts, paths, strict=True)):
        frame = scene.add_frame(f"/ghost_{number}", show_axes=False)
        _add_shape(scene, f"/ghost_{number}/body", geometry, max(0.1, min(0.3, 3.0 / len(paths))))
        yield _moving(frame, ghost.quaternion, path)


def _arrow(scene: SceneApi, name: str, vectors: Array, base: Array) -> Show:
    """Draw a vector, given in a, as an arrow from the body; it is hidden while it is nearly zero."""
    ends, sizes = np.stack([base, base + vectors], axis=1), np.linalg.norm(vectors, axis=1)
    arrow = scene.add_arrows(f"/{name}", ends[:1], ARROW[name], shaft_radius=0.035, head_radius=0.09, head_length=0.25)
    label = scene.add_label(f"/{name}_label", name, anchor="center-center")

    def show(k: int) -> None:
        seen = bool(sizes[k] > 0.02)
        arrow.visible = label.visible = seen
        if seen:
            arrow.points = ends[k : k + 1]
            label.position = ends[k, 1] + 0.2 * (ends[k, 1] - ends[k, 0]) / sizes[k]

    return show


def _trace(scene: SceneApi, geometry: Geometry) -> Show:
    """Draw the path of o and the trace of an axis' tip; its pieces appear in turn, and vanish `TAIL` behind the tip."""
    if np.ptp(geometry.path, axis=0).any():
        _line(scene, "/path", geometry.path, FIXED)
    tip = geometry.trace
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(tip, axis=0), axis=1))])
    borders = np.unique(np.linspace(0, len(tip) - 1, CHUNKS + 1).round().astype(int)).tolist()
    of = pairwise(borders) if geometry.traced is not None else ()
    pieces = [(b, _line(scene, f"/trace/{a}", tip[a : b + 1], TRACE, visible=False)) for a, b in of]

    def show(k: int) -> None:
        for last, piece in pieces:
            piece.visible = bool(last <= k and way[k] - way[last] < TAIL)

    return show


def _line(scene: SceneApi, name: str, points: Array, color: Color, visible: bool = True) -> LineSegmentsHandle:
    ends = np.stack([points[:-1], points[1:]], axis=1)
    return scene.add_line_segments(name, ends, color, thickness=0.02, visible=visible)
