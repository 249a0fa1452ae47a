"""Building the FMU of a scene, of either kind: its content, its identity, and its file.

The pythonfmu kind has slave, kernels and object code in a Python package. The native kind has the model's object code
under a layer of C, in one library for each platform.
"""

import hashlib
import io
import json
import uuid
import zipfile
import zlib
from collections.abc import Sequence
from importlib.metadata import distribution
from pathlib import Path
from xml.etree.ElementTree import Element, tostring

import rbfmu_kernels
from rbfmu import Plan, Scene, exceptions, on_disk
from rbfmu.planning.select import plan
from rbfmu.runs.plan import checked_plan, start_run
from rbfmu.scene.scene import of_scene_or_path
from rbfmu_fmu.description import Description, describe
from rbfmu_fmu.model_description import FmiVersion, model_description, version_of, xml_bytes
from rbfmu_fmu.native import headers, object_code, platforms as native
from rbfmu_fmu.presentation import presentation_files
from rbfmu_fmu.python.slave_access import CODE, LIBRARY, OBJECT

PYTHON = Path(__file__).parent / "python"
"""The folder with all that is bundled into a pythonfmu FMU besides the kernels."""
SCRIPT, PACKAGE = ((PYTHON / name).read_text(encoding="utf-8") for name in ("entry.txt", "package.txt"))
"""The templates of the FMU's script, which pythonfmu loads, and of `__init__.py` of the package with all else."""

NAME_OF_SCRIPT = "resources/slavemodule.txt"
"""The file with the name of the script that pythonfmu's library loads; without it, the library ends the process."""

PYTHONFMU = Path(str(distribution("pythonfmu").locate_file("pythonfmu")))
"""The installed package; `import pythonfmu` may find that of an FMU in this process, which has no libraries."""
UNUSED = ("deploy.py", "csvbuilder.py", "__main__.py")
"""Modules of pythonfmu that no FMU uses."""


@of_scene_or_path
def build(
    scene: Scene,
    path: str | Path,
    kind: str = "python",
    platforms: str | Sequence[str] = (),
    full: bool = False,
    fmi: int = 2,
    scalars: bool = False,
    terminals: bool = False,
    *,
    planned: Plan | None = None,
) -> Path:
    """Build the FMU of a scene, or of a scene file by its path, write it to `path`, and return `path`.

    The same scene gives the same bytes. A file at `path` is replaced at the end.

    kind: "python" or "pythonfmu" (the importer's process needs Python), or "native" (it needs nothing); platforms: for
    a native FMU, names from `rbfmu_fmu.native.platforms.PLATFORMS` or "all" (none: this platform); full: with all
    degrees of freedom; fmi: 2, or 3 for a native FMU; scalars: no arrays in FMI 3; terminals: list terminals in FMI 2
    as well, at which some importers fail; planned: a plan of the scene, so that none is made.
    Raises ValueError for wrong arguments, SceneError if there is no plan or the plan's model refuses the scene, and
    BuildError.
    """
    version, path, is_native = version_of(fmi, scalars), exceptions.path_of(path), kind == "native"
    if kind not in ("python", "pythonfmu", "native"):
        raise ValueError(f'kind = {kind!r}: expected "pythonfmu" or "native"')
    if platforms and not is_native:
        raise ValueError(f'platforms = {platforms!r}: expected kind = "native" with them')
    if fmi != 2 and not is_native:
        raise ValueError(f'fmi = {fmi}: expected kind = "native" with it, as pythonfmu makes FMUs of FMI 2')
    d = describe(scene, checked_plan(planned, stepped=True) or plan(scene, full))
    start_run(scene, d.plan)  # a plan of another scene may have a model that refuses this one
    contents = _native_contents(d, platforms, version) if is_native else _python_contents(d, version)
    shown = presentation_files(d, version, needs_python=not is_native, with_terminals=terminals)
    return write_archive(contents | shown, path)


def _identify(version: FmiVersion, d: Description, abilities: dict[str, str], parts: dict[str, bytes]) -> Element:
    """Return modelDescription.xml with the FMU's identity, a hash of its parts and of the rest of the description.

    It is not a random number, so that the same scene gives the same file. An FMU of another scene has another identity,
    and so refuses a saved state, which would fill its buffer with wrong numbers.
    """
    xml = model_description(version, d, abilities)
    xml.set(version.identity, f"{{{uuid.UUID(hash_of(parts | {'': tostring(xml)})[:32])}}}")
    return xml


# --- the native kind


def _native_contents(d: Description, platforms: str | Sequence[str], version: FmiVersion) -> dict[str, bytes]:
    chosen = native.platforms_named(platforms)
    objects = {p: object_code.object_files(d.plan.kernels, p) for p in chosen}
    contents, generated = {"resources/scene.json": scene_inside(d)}, headers.headers(d, version)
    parts = contents | {name: native.source(name) for name in (*c_sources(version), *native.HEADERS)}
    parts |= {name: text.encode() for name, text in generated.items()} | {"flags": " ".join(native.FLAGS).encode()}
    parts |= {f"{p.name}/{name}": code for p, files in objects.items() for name, code in files.items()}
    xml = _identify(version, d, version.abilities_of(d), parts)
    contents["modelDescription.xml"] = xml_bytes(xml)
    generated["scene.h"] = headers.scene_header(d, version, xml.attrib[version.identity])
    folders = {version.folders[p.name] for p in chosen}
    for folder in sorted(folders):
        members = [p for p in chosen if version.folders[p.name] == folder]
        libraries = [native.link(c_sources(version), objects[p], p, d.identifier, generated) for p in members]
        second = {version.second_folders.get(p.name, folder) for p in members}
        for place in {folder} | (second - folders):  # a second folder only if it is not the first of another platform
            contents[f"binaries/{place}/{d.identifier}{members[0].suffix}"] = native.universal(libraries)
    return contents


def c_sources(version: FmiVersion) -> tuple[str, ...]:
    """Return the names of the C sources in `native/` for a version of FMI."""
    return (version.signatures, *native.ANY_VERSION)


# --- the pythonfmu kind


def _python_contents(d: Description, version: FmiVersion) -> dict[str, bytes]:
    files = _package_files(d)
    identity = hash_of(files | {"templates": (SCRIPT + PACKAGE).encode()})[:12]
    package, script = f"rbfmu_{identity}", f"entry_{identity}"  # a scene's name may not be a module's name
    files["__init__.py"] = PACKAGE.format(identity=identity).encode()
    contents = {f"resources/{package}/{name}": content for name, content in files.items()}
    contents[f"resources/{script}.py"] = SCRIPT.format(package=package).encode()
    contents |= {NAME_OF_SCRIPT: script.encode(), "resources/scene.json": scene_inside(d)}
    contents |= _parts_of_pythonfmu(d.identifier)
    return contents | {"modelDescription.xml": xml_bytes(_identify(version, d, version.python_abilities, contents))}


def _parts_of_pythonfmu(identifier: str) -> dict[str, bytes]:
    """Return pythonfmu's modules and libraries by their paths in an FMU.

    pythonfmu's own builder is not used, because it makes an instance of the slave to ask for its variables.
    """
    libraries = PYTHONFMU / "resources" / "binaries"
    modules = {f"resources/pythonfmu/{file.name}": file for file in PYTHONFMU.glob("*.py") if file.name not in UNUSED}
    compiled = (file for file in libraries.glob("*/*") if file.suffix in (".so", ".dll", ".dylib"))
    files = modules | {f"binaries/{file.parent.name}/{identifier}{file.suffix}": file for file in compiled}
    return {place: file.read_bytes() for place, file in files.items()}


def _package_files(d: Description) -> dict[str, bytes]:
    files = {path.name: path.read_bytes() for path in PYTHON.glob("[!_]*.py")}
    name, code = _shipped_code(d.plan)
    known = d.to_dict() | {"shipped_code": {name: zlib.crc32(code)}}
    if d.plan.formulas:  # this text imports the kernels by the name of their package, which in an FMU is another
        files["formulas.py"] = d.plan.formulas.text.replace(f"from {rbfmu_kernels.__name__}.", "from .").encode()
    return kernel_sources() | files | {name: code, "description.json": json_bytes(known)}


def _shipped_code(plan: Plan) -> tuple[str, bytes]:
    """Return (name, content) of a shared library for this platform, or of an object file if there is no C compiler."""
    platform = native.this_platform()
    objects = object_code.object_files(plan.kernels, platform)
    try:
        return CODE + LIBRARY, native.link(["exports.c"], objects, platform, "model")
    except native.NoLinkerError:
        return CODE + OBJECT, objects["model.o"]


# --- the content of an FMU, and its file


def kernel_sources() -> dict[str, bytes]:
    """Return the modules of `rbfmu_kernels` by their paths in it, without `__init__.py`, as an FMU has another."""
    folder = Path(rbfmu_kernels.__file__).parent
    sources = {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*.py")}
    del sources["__init__.py"]
    return sources


def kernel_hash() -> str:
    """Return a hash of the installed kernels, which an FMU stores to identify those it was made from."""
    return hash_of(kernel_sources())


def scene_inside(d: Description) -> bytes:
    """Return the content of resources/scene.json, which `verify` reads in an FMU."""
    data = {"kernels": kernel_hash(), "plan": d.plan.to_dict(), "scene": d.scene.to_dict()}
    return json_bytes(data, sort_keys=False)  # outputs of your own keep the order of the scene


def json_bytes(data: object, sort_keys: bool = True) -> bytes:
    """Return data as JSON; raise ValueError for numbers that are not finite, which JSON does not have."""
    return json.dumps(data, indent=1, sort_keys=sort_keys, allow_nan=False).encode()


def hash_of(files: dict[str, bytes]) -> str:
    """Return the SHA-256 of the names and contents of files, as hexadecimal digits."""
    digest = hashlib.sha256()
    for name in sorted(files):
        digest.update(f"{name}\0{len(files[name])}\0".encode() + files[name])
    return digest.hexdigest()


def write_archive(contents: dict[str, bytes], path: Path) -> Path:
    """Write a zip archive, sorted and without times; a file at `path` is replaced when all is written."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        for name in sorted(contents, key=lambda n: (n != "modelDescription.xml", n)):
            entry = zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0))
            entry.compress_type, entry.external_attr = zipfile.ZIP_DEFLATED, 0o644 << 16
            archive.writestr(entry, contents[name], compresslevel=9)
    on_disk.write_whole(path, file.getvalue())
    return path
