"""Motions to look at in 3D: of a scene, which is simulated at the instants of the pictures, or of a result.

Shown are the body, in the shape that the scene gives or as the box with the same mass and inertia; its motion; and
ghosts, which are members of the scene's ensemble, beside the scene's own motion. `page` draws them.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from html import escape
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from rbfmu.arrays import angle_between, quaternion_from_euler, rotate
from rbfmu.extras import needed
from rbfmu.on_disk import write_whole
from rbfmu.result import FORMATS, Result, quaternion_lengths, refuse_disorder, refuse_gaps
from rbfmu.runs.inputs import input_tables
from rbfmu.runs.plan import Plan
from rbfmu.scene import section
from rbfmu.scene.scene import QUANTITIES, Scene, default_quantities, doubts_of, faults_of, load_scene, warn
from rbfmu.simulation import run_of, simulate
from rbfmu.types import Array
from rbfmu_kernels import Quaternion, Vec3, principal_axes, quaternion_from_matrix
from rbfmu_kernels.compile.tiered import evaluated
from rbfmu_kernels.mechanics.inertia import INERTIA_TOLERANCE

# The shape


THINNEST = 0.1
"""The shortest side that is drawn, as a part of the longest, so that rods and sheets are visible."""
ORIGIN: Vec3 = (0.0, 0.0, 0.0)
UNTURNED: Quaternion = (1.0, 0.0, 0.0, 0.0)


class Shape(NamedTuple):
    """The shape in which a body is drawn: its sides along its axes p (m), its centre in b (m), and q_bp.

    kind: box, cylinder (about z) or ellipsoid; text: what the page says about it.
    """

    kind: str
    sides: Vec3
    text: str
    centre: Vec3 = ORIGIN
    q_bp: Quaternion = UNTURNED

    @property
    def radius(self) -> float:
        """Return half the diagonal of the box with these sides, m."""
        return float(np.linalg.norm(self.sides)) / 2.0


PLAIN = Shape("box", (3.0, 2.0, 1.0), "the inertia is not known: any body")

DRAWN: Mapping[str, tuple[str, Callable[[Any], Any]]] = {
    "box": ("box", lambda shape: shape["sides"]),
    "beam": ("box", lambda shape: (shape["length"], 0.0, 0.0)),
    "cylinder": ("cylinder", lambda shape: (2.0 * shape["radius"], 2.0 * shape["radius"], shape["length"])),
    "sphere": ("ellipsoid", lambda shape: (2.0 * shape["radius"],) * 3),
    "ellipsoid": ("ellipsoid", lambda shape: [2.0 * semiaxis for semiaxis in shape["semiaxes"]]),
}
"""The kind of shape that is drawn, and a function for its sides, by the kind in a scene's table `body.shape`."""


def shape_of(scene: Scene | None, as_box: bool = False) -> Shape:
    """Return the shape to draw for a scene; as_box: as the equivalent box, even if the scene gives a shape."""
    if scene is None or scene.body is None:
        return PLAIN
    if (given := scene.body.given_shape) and not as_box:
        (kind, sides_of), what, q_bp = DRAWN[given["kind"]], given["kind"], UNTURNED
        sides = sides_of(given)
    else:
        M = np.array(scene.body.inertia)
        M[np.abs(M) <= INERTIA_TOLERANCE * np.trace(M)] = 0.0  # by round-off, equal moments would have any axes
        moments, axes = evaluated(principal_axes, M.tolist())
        kind, what, q_bp = "box", "box with the body's mass and inertia", evaluated(quaternion_from_matrix, axes)
        sides = equivalent_box(scene.body.mass, moments)
    x, y, z = (float(max(side, THINNEST * max(sides))) for side in sides)
    return Shape(kind, (x, y, z), f"{what}, {' × '.join(f'{side:.3g}' for side in sides)} m", scene.body.r_oc_b, q_bp)


def equivalent_box(mass: float, moments: Vec3 | Array) -> Vec3:
    """Return the sides (m) along the principal axes of the homogeneous box with this mass and these moments (kg m2)."""
    squares = 6.0 * (np.sum(moments) - 2.0 * np.asarray(moments)) / mass
    x, y, z = np.sqrt(np.maximum(squares, 0.0)).tolist()
    return x, y, z


# The motion


UP: Vec3 = (0.0, 0.0, 1.0)


def longest(vectors: Array) -> float:
    """Return the largest length of vectors (n, 3)."""
    return float(np.max(np.linalg.norm(vectors, axis=1)))


class Ghost(NamedTuple):
    """A member's motion: its attitude q_ab (n, 4), and the position of o in a (n, 3), m."""

    quaternion: Array
    position: Array


@dataclass(frozen=True, repr=False)
class Motion:
    """A motion at the instants of its pictures, with the page that plays it.

    played: how long it is played, s; up: the direction against gravity in a, or z without gravity.
    """

    title: str
    result: Result
    shape: Shape
    played: float = 0.0
    pivot: bool = False
    up: Vec3 = UP
    notes: tuple[str, ...] = ()
    ghosts: tuple[Ghost, ...] = ()

    def __repr__(self) -> str:
        return f"Motion({self.title}: {len(self.result.time)} pictures, played in {self.played:.3g} s)"

    @cached_property
    def quaternion(self) -> Array:
        """Return q_ab (n, 4). Raises ValueError if the result has no attitude."""
        known = self.result.quantities
        if "quaternion" in known:
            return known["quaternion"]
        if "rpy" in known:
            return np.asarray(quaternion_from_euler("xyz", known["rpy"]))
        shown = ", ".join(known) or "none"
        raise ValueError(f"quaternion or rpy: expected one of them in the result, which has {shown}")

    @cached_property
    def position(self) -> Array:
        """Return the position of o in a (n, 3), m; zero if the result does not have it."""
        return self.result.quantities.get("position", np.zeros((len(self.result.time), 3)))

    @property
    def angular_momentum(self) -> Array | None:
        """Return the angular momentum in a (n, 3), kg m2/s; None if it is not known."""
        return self.result.quantities.get("angular_momentum_a")

    @property
    def rate(self) -> Array | None:
        """Return omega_ab_a (n, 3), rad/s; None if it is not known."""
        known = self.result.quantities
        if "omega_a" in known or "omega_b" not in known:
            return known.get("omega_a")
        return np.asarray(rotate(self.quaternion, known["omega_b"]))

    @property
    def largest_rate(self) -> float:
        """Return the largest |omega|, rad/s; 0 if it is not known."""
        return 0.0 if self.rate is None else longest(self.rate)

    @cached_property
    def largest_turn(self) -> float:
        """Return the largest angle in rad by which the body turns from one picture to the next.

        Two attitudes do not show whole turns between them; the rate does, if it is known.
        """
        turned = float(np.max(angle_between(self.quaternion[:-1], self.quaternion[1:])))
        if self.rate is None:
            return turned
        return max(turned, longest(self.rate[:-1] * np.diff(self.result.time)[:, None]))

    @cached_property
    def page(self) -> str:
        """Return the page of HTML that plays the motion."""
        from rbfmu.viewer.page import motion_page

        return motion_page(self)

    def _repr_html_(self) -> str:
        return f'<iframe srcdoc="{escape(self.page)}" width="100%" height="620" style="border:none"></iframe>'


# Motions from scenes and results


MOST_GHOSTS = 50


def ghosts_of(scene: Scene, count: int) -> tuple[Ghost, ...]:
    """Return the motions of the ensemble's first `count` members at communication points, without failed ones."""
    from rbfmu.ensembles import chunks, planning, variables  # neither other motions nor an FMU's picture need these

    moving = [name for name in ("position", "quaternion") if name in scene.outputs.quantities]
    shown = scene.replace({"outputs.quantities": moving, "ensemble.keep": [variables.ALL]})
    chunk = chunks.run_chunk(chunks.Work(shown, planning.plan_ensemble(shown), count), 0)
    attitudes = chunk.arrays["quaternion"]
    positions = chunk.arrays.get("position", np.zeros((*attitudes.shape[:2], 3)))
    return tuple(Ghost(attitudes[i], positions[i]) for i in range(count) if i not in chunk.failed)


FPS = 30.0
"""Pictures a second."""
REAL_TIME = (4.0, 60.0)
"""Runs whose length (s) is between these two are played in real time; others are played in `PLAYED` s."""
PLAYED = 20.0
MAX_PICTURES = 3000
MAX_TURN = 0.25
"""The largest angle (rad) from one picture to the next, 25 pictures a turn; faster spins are played more slowly."""
FEWEST = 5.0
"""The least number of pictures a second; a motion with few known instants is played faster."""


class Pictures(NamedTuple):
    """The number of pictures, and how long they are played, s."""

    number: int
    played: float


def pictures(span: float, largest_rate: float, rows: float = math.inf) -> Pictures:
    """Return the pictures of a run of `span` s with at most this |omega|, rad/s; rows: the number of known instants."""
    played = span if REAL_TIME[0] <= span <= REAL_TIME[1] else PLAYED
    smooth = min(max(FPS * played, largest_rate * span / MAX_TURN), MAX_PICTURES - 1.0)
    return Pictures(int(min(math.ceil(smooth) + 1, rows)), min(smooth / FPS, rows / FEWEST))


NEEDED = ("quaternion", "omega_a", "angular_momentum_a")


def motion_of_scene(
    scene: Scene, progress: Callable[[float], object] | None = None, ghosts: int = 0,
    driven: Mapping[str, Any] | None = None,
) -> Motion:  # fmt: skip
    """Simulate a scene and return its motion.

    driven: inputs, and how to interpolate them. With inputs, pictures are taken from the scene's communication points.
    Without, ports keep their start values, and the pictures' instants are the communication points.
    ghosts: the number of members of its ensemble that are shown beside it. Raises SceneError, and ValueError for a
    wrong number of ghosts.
    """
    if not isinstance(ghosts, int) or isinstance(ghosts, bool) or not 0 <= ghosts <= MOST_GHOSTS:
        raise ValueError(section.fault("ghosts", ghosts, f"a whole number from 0 to {MOST_GHOSTS}"))
    if ghosts:
        from rbfmu.ensembles.members import ensemble_of

        ghosts = min(ghosts, ensemble_of(scene).runs)
    possible = default_quantities(scene.body, scene.inputs)
    shown = {*scene.outputs.quantities, *(name for name in NEEDED if name in possible)}
    wanted = scene.replace({"outputs.quantities": tuple(name for name in QUANTITIES if name in shown)})
    if driven:
        return motion_of_result(simulate(wanted, **driven), scene.name, scene)
    from rbfmu.planning.select import plan  # motions of results do not need it

    warn(scene, doubts_of(scene.body) if scene.body else ())  # doubts about its steps do not matter for pictures
    chosen = plan(wanted, progress=progress)
    wanted, result = _in_few_pictures(wanted, chosen)
    coarse = _motion(scene.name, result, scene)
    played = pictures(wanted.run.stop - wanted.run.start, coarse.largest_rate).played
    wanted = _at_pictures(wanted, coarse.largest_rate)
    notes = (scene.inputs.at_start,) if scene.inputs.ports else ()
    members = ghosts_of(wanted, ghosts) if ghosts else ()
    return replace(coarse, result=run_of(wanted, chosen), played=played, notes=notes, ghosts=members)


def _in_few_pictures(scene: Scene, chosen: Plan) -> tuple[Scene, Result]:
    """Return a scene, which now ends where an event ends its run, and its motion in the pictures of a body at rest."""
    result = run_of(_at_pictures(scene, 0.0), chosen)
    if not any(scene.events[name].stop and len(times) for name, times in result.events.items()):
        return scene, result
    _check_length(len(result.time))
    ended = _at_pictures(scene, 0.0, float(result.time[-1]))
    return ended, run_of(ended, chosen)


def _at_pictures(scene: Scene, largest_rate: float, stop: float | None = None) -> Scene:
    """Return a scene whose communication points are the instants of its pictures; stop: another end of its run, s."""
    stop = scene.run.stop if stop is None else stop
    span = stop - scene.run.start
    return scene.replace(run={"stop": stop, "step": span / (pictures(span, largest_rate).number - 1)})


def motion_of_result(result: Result, title: str, scene: Scene | None = None) -> Motion:
    """Return the motion of a result; scene: the one with its body.

    Raises ValueError for gaps, times that do not increase, or without attitude.
    """
    for name, values in {"time": result.time, **result.quantities}.items():
        refuse_gaps(name, values)
    refuse_disorder(result.time)
    quaternion_lengths(result.quantities.get("quaternion", np.empty((0, 4))))
    whole = _motion(title, result, scene)
    _check_length(len(whole.quaternion))
    shown = pictures(float(result.time[-1] - result.time[0]), whole.largest_rate, len(result.time))
    rows = np.linspace(0.0, len(result.time) - 1.0, shown.number).round().astype(int)
    thinned = {name: values[rows] for name, values in result.quantities.items()}
    return replace(whole, result=Result(result.time[rows], thinned, result.rows), played=shown.played)


def _check_length(count: int) -> None:
    if count < 2:
        raise ValueError(f"time: expected at least two points in time in the result, which has {count}")


def _motion(title: str, result: Result, scene: Scene | None) -> Motion:
    pivot = scene is not None and scene.body is not None and scene.body.pivot
    gravity = np.array(scene.loads.gravity_a if scene else ORIGIN)
    up = -gravity / np.linalg.norm(gravity) if gravity.any() else np.array(UP)
    return Motion(title, result, shape_of(scene), pivot=pivot, up=tuple(up.tolist()))


# --- what users call


def view(
    source: Scene | Result | str | Path,
    path: str | Path | None = None,
    *,
    scene: Scene | str | Path | None = None,
    stop: float | None = None,
    inputs: Any = None,
    interpolate: str = "hold",
    progress: Callable[[float], object] | None = None,
    ghosts: int = 0,
) -> Motion:
    """Return a motion that a notebook plays in 3D; if a path is given, write a page that plays it in any browser.

    source: a scene, a result, or a file of either (.toml, .csv, .npz, .aem); scene: the scene whose body a result
    moves (without it a plain body is drawn); stop: the end of the motion shown, s, by default that of the run; inputs,
    interpolate: what drives a scene's ports, as for `simulate`; progress: called with the part of planning that is
    done; ghosts: the number of runs of the scene's ensemble, up to 50, that are shown as pale bodies beside its own
    motion. Raises SceneError, SimulationError, ModuleNotFoundError without viser, and ValueError if a result has no
    attitude.
    """
    needed("viser", "view")
    title = "motion"
    if not isinstance(source, Scene | Result | str | Path):
        expected = "a rbfmu.Scene, a rbfmu.Result, or the path of a file of either"
        raise TypeError(section.fault("source", source, expected))
    if not isinstance(scene, Scene | str | Path | None):
        raise TypeError(section.fault("scene", scene, "a rbfmu.Scene or the path of a scene file"))
    if not isinstance(path, str | Path | None):
        raise TypeError(section.fault("path", path, "the path of a page to write, or None"))
    if isinstance(source, str | Path) and Path(source).suffix in FORMATS:
        title, source = Path(source).stem, Result.load(source)
    if ghosts and (isinstance(source, Result) or inputs is not None):
        raise ValueError(f"ghosts = {ghosts}: expected a scene with them, and no inputs")
    if isinstance(source, Result):
        if inputs is not None:
            raise ValueError("inputs: expected a scene with them, as a result is shown as it is")
        shown = source.until(stop)
        motion = motion_of_result(shown, title, load_scene(scene) if isinstance(scene, str | Path) else scene)
    else:
        if scene is not None:
            raise ValueError("scene: expected a result with it, as a scene moves its own body")
        loaded = source if isinstance(source, Scene) else load_scene(source)
        name = source.name if isinstance(source, Scene) else str(source)
        with faults_of(name if stop is None else f"{name} with stop {stop!r}"):
            played = loaded if stop is None else loaded.replace(run={"stop": stop})
            tables = input_tables(played, inputs, interpolate)  # read once; wrong inputs fail before planning
            driven = {"inputs": tables, "interpolate": interpolate} if tables else None
            motion = motion_of_scene(played, progress, ghosts, driven)
    if path is not None:
        write_whole(Path(path), motion.page.encode())
    return motion
