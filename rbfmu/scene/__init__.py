"""A scene: a body, its initial state, its loads and the requested outputs, read from TOML and checked."""

from rbfmu.scene.scene import Body, Scene, SceneError, load_scene

__all__ = ["Body", "Scene", "SceneError", "load_scene"]
