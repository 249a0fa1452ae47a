"""Builds the FMU of a scene, of either kind."""

from collections.abc import Sequence
from pathlib import Path

from rbfmu.planning.select import plan
from rbfmu.scene.argument import of_scene_or_path
from rbfmu.scene.scene import Scene
from rbfmu_fmu.native.build import build_native_fmu, version_of
from rbfmu_fmu.python.build import build_python_fmu


@of_scene_or_path
def build(
    scene: Scene,
    path: str | Path,
    kind: str = "python",
    platforms: Sequence[str] = (),
    full: bool = False,
    fmi: int = 2,
    scalars: bool = False,
    terminals: bool = False,
) -> Path:
    """Build the FMU of a scene, or of a scene file by its path, at `path` and return it.

    kind: "python" or "pythonfmu" (the importer's process needs Python) or "native" (it needs nothing); platforms: of a
    native FMU, names from `rbfmu_fmu.native.platforms.PLATFORMS` or "all"; none: this one; full: with all degrees of
    freedom; fmi: 2, or 3 of a native FMU; scalars: of FMI 3, no arrays; terminals: list terminals
    in FMI 2 as well, at which some importers fail.
    """
    version = version_of(fmi, scalars)
    if kind not in ("python", "pythonfmu", "native"):
        raise ValueError(f'kind = {kind!r}: expected "python" or "native"')
    if kind == "native":
        return build_native_fmu(scene, plan(scene, full), Path(path), platforms, version, terminals)
    if fmi != 2:
        raise ValueError(f'fmi = {fmi}: expected kind = "native" with it, as pythonfmu makes FMUs of FMI 2')
    return build_python_fmu(scene, plan(scene, full), Path(path), terminals)
