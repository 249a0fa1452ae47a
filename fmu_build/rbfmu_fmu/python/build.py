"""Builds the pythonfmu FMU of a scene: slave, kernels and object code in one reproducible archive."""

import importlib.resources
import tempfile
import zipfile
import zlib
from pathlib import Path

from pythonfmu.builder import FmuBuilder

from rbfmu.runs.plan import Plan
from rbfmu.scene.scene import Scene
from rbfmu_fmu.archive import guid_of, hash_of, json_bytes, kernel_sources, scene_inside, write_archive, xml_bytes
from rbfmu_fmu.description import Description, describe
from rbfmu_fmu.fmi2_xml import FMI2
from rbfmu_fmu.fmi_version import UNSET
from rbfmu_fmu.native.linking import EXPORTS, NoLinkerError, linked
from rbfmu_fmu.native.object_code import object_files
from rbfmu_fmu.native.platforms import this_platform
from rbfmu_fmu.presentation.files import shown_files
from rbfmu_fmu.python.pythonfmu_traps import LEFT_OUT, builder_imports_undone
from rbfmu_fmu.python.slave_access import CODE, LIBRARY, OBJECT

SCRIPT = '''"""Entry of the FMU: pythonfmu instantiates the class below."""
from {package}.pythonfmu_traps import keep_script

keep_script(globals())
from {package} import ACCESS
from {package}.slave import Slave as Fmi2Slave


class {identifier}(Fmi2Slave):
    access = ACCESS
'''

PACKAGE = '''"""A rigid body's model. The package's name holds a hash of everything in it, so that FMUs do not mix."""
import os

from .slave_access import Access

ACCESS = Access(os.path.dirname(__file__), "{identity}")
'''

SHIPPED = ("slave.py", "slave_access.py", "call_rules.py", "pythonfmu_traps.py")
"""The modules of an FMU beside the kernels."""

CAPABILITIES = {
    "needsExecutionTool": "false", "canInterpolateInputs": "false", "canNotUseMemoryManagementFunctions": "true",
}  # fmt: skip


def build_python_fmu(scene: Scene, plan: Plan, path: Path, terminals: bool = False) -> Path:
    """Write the FMU: the same bytes for the same scene; a file that stands at `path` is replaced when done."""
    description = describe(scene, plan)
    files = _package_files(plan, description)
    identity = hash_of(files | {"templates": (SCRIPT + PACKAGE).encode()})
    with tempfile.TemporaryDirectory(prefix="rbfmu_") as folder:
        script = _write_sources(Path(folder), files, description, identity)
        with builder_imports_undone():
            raw = FmuBuilder.build_FMU(
                script, dest=Path(folder) / "out", project_files=[Path(folder) / _package(identity)]
            )
        with zipfile.ZipFile(raw) as archive:
            contents = {n: archive.read(n) for n in archive.namelist() if not LEFT_OUT.fullmatch(n)}
    contents["resources/scene.json"] = scene_inside(scene, plan)
    xml = FMI2.model_description(description, UNSET, CAPABILITIES)
    xml.set(FMI2.identity, guid_of(contents, xml))
    contents |= shown_files(scene, plan, description, FMI2, needs_python=True, with_terminals=terminals)
    write_archive(contents | {"modelDescription.xml": xml_bytes(xml)}, path)
    return path


def _package_files(plan: Plan, description: Description) -> dict[str, bytes]:
    folder = importlib.resources.files("rbfmu_fmu.python")
    files = {name: folder.joinpath(name).read_bytes() for name in SHIPPED}
    name, code = _shipped_code(plan)
    known = description.to_dict() | {"shipped_code": {name: zlib.crc32(code)}}
    return kernel_sources() | files | {name: code, "description.json": json_bytes(known)}


def _shipped_code(plan: Plan) -> tuple[str, bytes]:
    """Return (name, content) of a shared library for this platform or, without a C compiler, of an object file."""
    platform = this_platform()
    objects = object_files(plan.kernels, platform)
    try:
        return CODE + LIBRARY, linked(EXPORTS, objects, platform, "model")
    except NoLinkerError:
        return CODE + OBJECT, objects["model.o"]


def _package(identity: str) -> str:
    return f"rbfmu_{identity[:12]}"


def _write_sources(folder: Path, files: dict[str, bytes], description: Description, identity: str) -> Path:
    package = folder / _package(identity)
    package.mkdir()
    for name, content in files.items():
        (package / name).parent.mkdir(parents=True, exist_ok=True)
        (package / name).write_bytes(content)
    (package / "__init__.py").write_text(PACKAGE.format(identity=identity[:12]))
    script = folder / f"{description.identifier}_{identity[:12]}.py"
    script.write_text(SCRIPT.format(package=package.name, identifier=description.identifier))
    return script
