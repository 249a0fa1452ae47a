"""Co-simulation units (FMI 2.0) of rigid-body scenes: `build` and `verify`."""

from pathlib import Path

from rbfmu.planning import plan
from rbfmu.scene import Scene
from rbfmu_fmu.python_fmu import build_python_fmu
from rbfmu_fmu.verification import Verification, VerificationError, verify

__all__ = ["Verification", "VerificationError", "build", "verify"]


def build(scene: Scene, path: str | Path, kind: str = "python") -> Path:
    """Build a scene's FMU at `path` and return it; kind: "python" (pythonfmu; the importer's process needs Python)."""
    if kind != "python":
        raise ValueError(f'kind = {kind!r}: expected "python"')
    return build_python_fmu(scene, plan(scene), Path(path))
