"""A motion to look at: of a scene, which is simulated at the instants of its pictures, or of a result.

Ghosts are members of a scene's ensemble, shown beside the scene's own motion.
"""

import math
import warnings
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cached_property
from html import escape
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from rbfmu.ensembles.chunks import Work, run_chunk
from rbfmu.ensembles.members import ensemble_of
from rbfmu.ensembles.planning import plan_ensemble
from rbfmu.ensembles.variables import ALL
from rbfmu.exceptions import SceneWarning, named
from rbfmu.extras import needed
from rbfmu.result import FORMATS, Result
from rbfmu.scene.scene import QUANTITIES, Scene, default_quantities, faults_of, load_scene
from rbfmu.scene.toml_file import read_file
from rbfmu.simulation import plan, simulate
from rbfmu.viewer.motion import UP, Ghost, Shown, shape_of


class Motion(Shown):
    """A motion with the page that plays it."""

    def __repr__(self) -> str:
        return f"Motion({self.title}: {len(self.result.time)} pictures, played in {self.played:.3g} s)"

    @cached_property
    def page(self) -> str:
        """Return the page of HTML that plays the motion."""
        from rbfmu.viewer.page import motion_page

        return motion_page(self)

    def _repr_html_(self) -> str:
        return f'<iframe srcdoc="{escape(self.page)}" width="100%" height="620" style="border:none"></iframe>'


MOST_GHOSTS = 50
Written = dict[str, Any] | None
"""The table `body.shape` of a scene's file, where it has one."""


def ghosts_of(scene: Scene, count: int) -> tuple[Ghost, ...]:
    """Return the first members of the scene's ensemble at its communication points, without those that failed."""
    moving = [name for name in ("position", "quaternion") if name in scene.outputs.quantities]
    shown = scene.replace({"outputs.quantities": moving, "ensemble.keep": [ALL]})
    work = Work(shown, plan_ensemble(shown), count)
    chunk = run_chunk(work, 0)
    motion = work.columns.split(chunk.rows)
    positions = motion.get("position", np.zeros((*chunk.rows.shape[:2], 3)))
    return tuple(Ghost(motion["quaternion"][i], positions[i]) for i in range(count) if i not in chunk.failed)


FPS = 30.0
"""Pictures a second."""
REAL_TIME = (4.0, 60.0)
"""Spans (s) that are shown as they pass; others take `PLAYED` s."""
PLAYED = 20.0
MAX_PICTURES = 3000
MAX_TURN = 0.25
"""The largest angle (rad) from one picture to the next, 25 pictures a turn; a faster spin is played slower."""
FEWEST = 5.0
"""Pictures a second, where no more instants are known."""


class Pictures(NamedTuple):
    """How many pictures, and how long they are played (s)."""

    number: int
    played: float


def pictures(span: float, largest_rate: float, rows: float = math.inf) -> Pictures:
    """Return the pictures of a span (s) in which the body turns at most this fast (rad/s); rows: instants known."""
    played = span if REAL_TIME[0] <= span <= REAL_TIME[1] else PLAYED
    smooth = min(max(FPS * played, largest_rate * span / MAX_TURN), MAX_PICTURES - 1.0)
    return Pictures(int(min(math.ceil(smooth) + 1, rows)), min(smooth / FPS, rows / FEWEST))


NEEDED = ("quaternion", "omega_a", "angular_momentum_a")
NOT_DRIVEN: Mapping[str, Any] = {}


def motion_of_scene(
    scene: Scene,
    written: Written = None,
    progress: Callable[[float], object] | None = None,
    ghosts: int = 0,
    driven: Mapping[str, Any] = NOT_DRIVEN,
) -> Motion:
    """Simulate a scene, and show it; written: its file's `body.shape`; driven: inputs, and how to interpolate them.

    Under inputs it is shown as its communication step lets, with ports at zero at the instants of the pictures.
    ghosts: how many members of its ensemble are shown beside it. Raises SceneError, and ValueError for too many ghosts.
    """
    if not 0 <= ghosts <= MOST_GHOSTS:
        raise ValueError(f"ghosts = {ghosts}: expected a number from 0 to {MOST_GHOSTS}")
    ghosts = min(ghosts, ensemble_of(scene).runs) if ghosts else 0
    possible = default_quantities(scene.body, scene.inputs)
    shown = {*scene.outputs.quantities, *(name for name in NEEDED if name in possible)}
    wanted = scene.replace({"outputs.quantities": tuple(name for name in QUANTITIES if name in shown)})
    if driven:
        return motion_of_result(simulate(wanted, **driven), scene.name, scene, written)
    span = scene.run.stop - scene.run.start
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SceneWarning)  # of steps that are not those of the pictures
        chosen = plan(wanted, progress=progress)
        result = simulate(wanted.replace({"run.step": span / (pictures(span, 0.0).number - 1)}), planned=chosen)
    coarse = _motion(scene.name, result, scene, written)
    fine = pictures(span, coarse.largest_rate)
    wanted = wanted.replace({"run.step": span / (fine.number - 1)})
    notes = ("inputs are zero",) if scene.inputs.ports else ()
    members = ghosts_of(wanted, ghosts) if ghosts else ()
    return replace(coarse, result=simulate(wanted, planned=chosen), played=fine.played, notes=notes, ghosts=members)


def motion_of_result(result: Result, title: str, scene: Scene | None = None, written: Written = None) -> Motion:
    """Return the motion of a result; scene: whose body it is. Raises ValueError where the result has no attitude."""
    whole = _motion(title, result, scene, written)
    if len(whole.quaternion) < 2:
        raise ValueError(f"time: expected at least two points in time in the result, which has {len(result.time)}")
    shown = pictures(float(result.time[-1] - result.time[0]), whole.largest_rate, len(result.time))
    rows = np.linspace(0.0, len(result.time) - 1.0, shown.number).round().astype(int)
    thinned = {name: values[rows] for name, values in result.quantities.items()}
    return replace(whole, result=Result(result.time[rows], thinned, result.rows), played=shown.played)


def _motion(title: str, result: Result, scene: Scene | None, written: Written) -> Motion:
    pivot = scene is not None and scene.body is not None and scene.body.pivot
    gravity = np.array(scene.loads.gravity_a if scene else (0.0, 0.0, 0.0))
    up = -gravity / np.linalg.norm(gravity) if gravity.any() else np.array(UP)
    return Motion(title, result, shape_of(scene, written), pivot=pivot, up=tuple(up.tolist()))


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
    """Return a motion that a notebook plays in 3D; with a path, write the page that plays it in any browser as well.

    source: a scene, a result, or a file of either (.toml, .csv, .npz, .aem); scene: whose body a result moves, else a
    plain body is drawn; stop: the end of what is shown, s, if it is not the run's; inputs, interpolate: what drives a
    scene's ports, as for `simulate`; progress: is told which part of planning is done; ghosts: how many runs of the
    scene's ensemble, up to 50, are shown as pale bodies beside its own motion. Raises SceneError, SimulationError,
    ModuleNotFoundError without viser, and ValueError where a result has no attitude.
    """
    needed("viser", "view")
    driven = {} if inputs is None else {"inputs": inputs, "interpolate": interpolate}
    title = "motion"
    if isinstance(source, str | Path) and Path(source).suffix in FORMATS:
        title, source = Path(source).stem, Result.load(source)
    if ghosts and (isinstance(source, Result) or driven):
        raise ValueError(f"ghosts = {ghosts}: expected a scene with them, and no inputs")
    if isinstance(source, Result):
        if driven:
            raise ValueError("inputs: expected a scene with them, as a result is shown as it is")
        motion = motion_of_result(source.until(stop), title, *_scene_and_shape(scene))
    else:
        loaded, shape = _scene_and_shape(source)
        with faults_of(str(source) if stop is None else f"{source} with stop {stop!r}"):
            shown = loaded if stop is None else loaded.replace(run={"stop": stop})
            motion = motion_of_scene(shown, shape, progress, ghosts, driven)
    if path is not None:
        page = motion.page
        with named(path):
            Path(path).write_text(page, encoding="utf-8")
    return motion


def _scene_and_shape(scene: Scene | str | Path | None) -> tuple[Any, Written]:
    """Return a scene, and the shape that its file gives to the body."""
    if scene is None or isinstance(scene, Scene):
        return scene, None
    return load_scene(scene), read_file(Path(scene))[0].get("body", {}).get("shape")
