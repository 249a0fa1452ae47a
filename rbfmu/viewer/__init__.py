"""A motion to look at: one page of HTML that plays it in 3D, in any browser and without network."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from rbfmu.exceptions import named
from rbfmu.extras import needed
from rbfmu.result import FORMATS, Result
from rbfmu.scene.scene import Scene, faults_of, load_scene
from rbfmu.scene.toml_file import read_file
from rbfmu.viewer.motion import Motion, motion_of_result, motion_of_scene


def view(
    source: Scene | Result | str | Path,
    path: str | Path | None = None,
    *,
    scene: Scene | str | Path | None = None,
    stop: float | None = None,
    inputs: Any = None,
    interpolate: str = "hold",
    progress: Callable[[float], Any] | None = None,
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
    motion = _motion(source, scene, stop, driven, progress, ghosts)
    if path is not None:
        page = motion.page
        with named(path):
            Path(path).write_text(page, encoding="utf-8")
    return motion


def _motion(source: Any, scene: Any, stop: float | None, driven: dict[str, Any], progress: Any, ghosts: int) -> Motion:
    is_file = isinstance(source, str | Path) and Path(source).suffix in FORMATS
    result = Result.load(source) if is_file else source
    is_result = isinstance(result, Result)
    if ghosts and (is_result or driven):
        raise ValueError(f"ghosts = {ghosts}: expected a scene with them, and no inputs")
    if is_result:
        if driven:
            raise ValueError("inputs: expected a scene with them, as a result is shown as it is")
        title = Path(source).stem if is_file else "motion"
        return motion_of_result(result.until(stop), title, *_scene_and_shape(scene))
    loaded, shape = _scene_and_shape(source)
    with faults_of(str(source) if stop is None else f"{source} with stop {stop!r}"):
        shown = loaded if stop is None else loaded.replace(run={"stop": stop})
        return motion_of_scene(shown, shape, progress, ghosts, driven)


def _scene_and_shape(scene: Scene | str | Path | None) -> tuple[Any, dict[str, Any] | None]:
    """Return a scene, and the shape that its file gives to the body."""
    if scene is None or isinstance(scene, Scene):
        return scene, None
    return load_scene(scene), read_file(Path(scene))[0].get("body", {}).get("shape")
