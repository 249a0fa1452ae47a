"""A scene: a body, its initial state, its loads and the requested outputs, read from TOML and checked."""

from rbfmu.scene.body import Body
from rbfmu.scene.scene import Scene, load_scene
from rbfmu.scene.section import SceneError

__all__ = ["Body", "Scene", "SceneError", "load_scene"]
