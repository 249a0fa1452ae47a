"""Scenes: a body, its start, its loads, what is asked for; read from TOML and checked."""

from rbfmu.scene.body import Body
from rbfmu.scene.fields import SceneError
from rbfmu.scene.scene import Scene, load_scene

__all__ = ["Body", "Scene", "SceneError", "load_scene"]
