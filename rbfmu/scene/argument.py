"""Let functions of a scene take the path of a scene file as well, name it in errors, and warn of likely mistakes."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from pathlib import Path
from typing import Concatenate, ParamSpec, TypeVar

from rbfmu.scene.plausibility import doubts_before, warn
from rbfmu.scene.scene import Scene, SceneError, load_scene

P = ParamSpec("P")
R = TypeVar("R")


@contextmanager
def faults_of(source: str) -> Iterator[None]:
    """Name this source in each SceneError that is raised inside."""
    try:
        yield
    except SceneError as error:
        raise SceneError(error.faults, source) from None


def of_scene_or_path(function: Callable[Concatenate[Scene, P], R]) -> Callable[Concatenate[Scene | str | Path, P], R]:
    """Make a function of a scene accept the path of a scene file as well; it raises TypeError for anything else."""

    @wraps(function)
    def call(scene: Scene | str | Path, *args: P.args, **kwargs: P.kwargs) -> R:
        if isinstance(scene, Scene):
            warn(scene, doubts_before(scene))
            return function(scene, *args, **kwargs)
        if not isinstance(scene, str | Path):
            name = f"{function.__name__}: scene = {scene!r}"
            raise TypeError(f"{name:.120}: expected a rbfmu.Scene or the path of a scene file")
        with faults_of(str(scene)):
            loaded = load_scene(scene)
            warn(loaded, doubts_before(loaded))
            return function(loaded, *args, **kwargs)

    return call  # type: ignore[return-value]  # scene may also be a keyword
