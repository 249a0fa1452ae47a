"""Builds the pythonfmu FMU of a scene: slave, kernels and their object code in one reproducible archive."""

import hashlib
import importlib.resources
import json
import os
import re
import sys
import tempfile
import uuid
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from xml.etree.ElementTree import indent, tostring

from pythonfmu.builder import FmuBuilder

import rbfmu_kernels
from rbfmu.models import Plan
from rbfmu.scene import Scene
from rbfmu_fmu.description import Description, describe, model_description
from rbfmu_fmu.object_code import object_code, platform_name

SCRIPT = '''"""Entry of the FMU: pythonfmu instantiates the class below."""
import ctypes

# pythonfmu 0.7.0 releases this module's dict, which it does not own, at every instantiation.
ctypes.pythonapi.Py_IncRef(ctypes.py_object(globals()))
from {package} import ACCESS
from {package}.slave import Slave


class {identifier}(Slave):
    access = ACCESS
'''

PACKAGE = '''"""A rigid body's unit: slave, kernels, object code. The name holds a hash of all: FMUs do not mix."""
import os

from .slave_access import Access

ACCESS = Access(os.path.dirname(__file__), "{identity}")
'''

CAPABILITIES = {"needsExecutionTool": "true", "canInterpolateInputs": "false"}
CAPABILITIES |= {"canNotUseMemoryManagementFunctions": "true"}
LEFT_OUT = re.compile(r"modelDescription\.xml|resources/pythonfmu/(deploy|csvbuilder|__main__)\.py")
"""Of what pythonfmu packs: its description (replaced; with a random guid and the date), and what no FMU uses."""


def build_python_fmu(scene: Scene, plan: Plan, path: Path) -> Path:
    """Write the FMU: the same bytes for the same scene; a file that stands at `path` is replaced when done."""
    description = describe(scene, plan)
    files = _package_files(plan, description)
    identity = _hash(files | {"templates": (SCRIPT + PACKAGE).encode()})
    with tempfile.TemporaryDirectory(prefix="rbfmu_") as folder:
        script = _write_sources(Path(folder), files, description, identity)
        with _imports_undone():
            raw = FmuBuilder.build_FMU(
                script, dest=Path(folder) / "out", project_files=[Path(folder) / _package(identity)]
            )
        with zipfile.ZipFile(raw) as archive:
            contents = {n: archive.read(n) for n in archive.namelist() if not LEFT_OUT.fullmatch(n)}
    contents["resources/scene.json"] = _json(
        {"scene": scene.to_dict(), "plan": plan.to_dict(), "kernels": kernel_hash()}
    )
    xml = model_description(description, "{}", CAPABILITIES)
    xml.set("guid", f"{{{uuid.UUID(_hash(contents | {'': tostring(xml)})[:32])}}}")
    indent(xml)
    contents["modelDescription.xml"] = b'<?xml version="1.0" encoding="UTF-8"?>\n' + tostring(xml, "utf-8") + b"\n"
    _write_archive(contents, path)
    return path


def kernel_sources() -> dict[str, bytes]:
    """The modules of `rbfmu_kernels` by file name."""
    folder = importlib.resources.files(rbfmu_kernels)
    return {f.name: f.read_bytes() for f in folder.iterdir() if f.name.endswith(".py") and f.name != "__init__.py"}


def kernel_hash() -> str:
    """Identifies the kernels that an FMU was made from."""
    return _hash(kernel_sources())


def _package_files(plan: Plan, description: Description) -> dict[str, bytes]:
    folder = importlib.resources.files("rbfmu_fmu")
    files = {name: folder.joinpath(name).read_bytes() for name in ("slave.py", "slave_access.py")}
    name, code = f"unit-{platform_name()}.o", object_code(plan.unit)
    known = description.to_dict() | {"object_code": {name: zlib.crc32(code)}}
    return kernel_sources() | files | {name: code, "description.json": _json(known)}


def _package(identity: str) -> str:
    return f"rbfmu_{identity[:12]}"


def _write_sources(folder: Path, files: dict[str, bytes], description: Description, identity: str) -> Path:
    package = folder / _package(identity)
    package.mkdir()
    for name, content in files.items():
        (package / name).write_bytes(content)
    (package / "__init__.py").write_text(PACKAGE.format(identity=identity[:12]))
    script = folder / f"{description.identifier}_{identity[:12]}.py"
    script.write_text(SCRIPT.format(package=package.name, identifier=description.identifier))
    return script


@contextmanager
def _imports_undone() -> Iterator[None]:
    """FmuBuilder imports the script: forget it, or a later instance in this process meets modules without files."""
    path, before, no_bytecode = list(sys.path), set(sys.modules), sys.dont_write_bytecode
    sys.dont_write_bytecode = True
    try:
        yield
    finally:
        sys.path[:], sys.dont_write_bytecode = path, no_bytecode
        for name in set(sys.modules) - before:
            if re.search(r"(^|\.)rbfmu_[0-9a-f]{12}|_[0-9a-f]{12}$", name):
                del sys.modules[name]


def _json(data: object) -> bytes:
    return json.dumps(data, indent=1, sort_keys=True, allow_nan=False).encode()


def _hash(files: dict[str, bytes]) -> str:
    digest = hashlib.sha256()
    for name in sorted(files):
        digest.update(f"{name}\0{len(files[name])}\0".encode() + files[name])
    return digest.hexdigest()


def _write_archive(contents: dict[str, bytes], path: Path) -> None:
    """Sorted, without times, and put in place only when whole."""
    handle, temporary = tempfile.mkstemp(prefix=path.name, suffix=".part", dir=path.parent)
    try:
        with os.fdopen(handle, "wb") as file, zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
            for name in sorted(contents, key=lambda n: (n != "modelDescription.xml", n)):
                entry = zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0))
                entry.compress_type, entry.external_attr = zipfile.ZIP_DEFLATED, 0o644 << 16
                archive.writestr(entry, contents[name])
        os.chmod(temporary, 0o644)
        os.replace(temporary, path)
    except BaseException:
        os.unlink(temporary)
        raise
