"""An FMU's file: one zip archive, the same bytes for the same contents, put in place only when whole."""

import hashlib
import json
import os
import tempfile
import uuid
import zipfile
from pathlib import Path
from xml.etree.ElementTree import Element, indent, tostring

import rbfmu_kernels
from rbfmu import Plan, Scene


def kernel_sources() -> dict[str, bytes]:
    """Return the modules of `rbfmu_kernels` by their path in it, without `__init__.py`: an FMU has another."""
    folder = Path(rbfmu_kernels.__file__).parent
    sources = {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*.py")}
    del sources["__init__.py"]
    return sources


def kernel_hash() -> str:
    """Return a hash that identifies the kernels that an FMU was made from."""
    return hash_of(kernel_sources())


def scene_inside(scene: Scene, plan: Plan) -> bytes:
    """Return what `verify` reads in an FMU: resources/scene.json."""
    return json_bytes({"scene": scene.to_dict(), "plan": plan.to_dict(), "kernels": kernel_hash()})


def json_bytes(data: object) -> bytes:
    """Return JSON, sorted and without what JSON does not know."""
    return json.dumps(data, indent=1, sort_keys=True, allow_nan=False).encode()


def hash_of(files: dict[str, bytes]) -> str:
    """Return the SHA-256 of names and contents."""
    digest = hashlib.sha256()
    for name in sorted(files):
        digest.update(f"{name}\0{len(files[name])}\0".encode() + files[name])
    return digest.hexdigest()


def guid_of(contents: dict[str, bytes], xml: Element) -> str:
    """Return a guid made from an FMU's contents and its description, whose own guid must not be set yet."""
    return f"{{{uuid.UUID(hash_of(contents | {'': tostring(xml)})[:32])}}}"


def xml_bytes(xml: Element) -> bytes:
    """Return XML as the bytes of a file."""
    indent(xml)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{tostring(xml, "unicode")}\n'.encode()


def write_archive(contents: dict[str, bytes], path: Path) -> None:
    """Write files sorted and without times; a file that stands at `path` is replaced when all is written."""
    handle, temporary = tempfile.mkstemp(prefix=path.name, suffix=".part", dir=path.parent)
    try:
        with os.fdopen(handle, "wb") as file, zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
            for name in sorted(contents, key=lambda n: (n != "modelDescription.xml", n)):
                entry = zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0))
                entry.compress_type, entry.external_attr = zipfile.ZIP_DEFLATED, 0o644 << 16
                archive.writestr(entry, contents[name], compresslevel=9)
        os.chmod(temporary, 0o644)
        os.replace(temporary, path)
    except BaseException as error:
        os.unlink(temporary)
        if isinstance(error, OSError):
            error.filename = str(path)  # else a full disk names no file
        raise
