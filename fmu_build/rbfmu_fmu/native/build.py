"""Builds the native FMU of a scene: the model's object code behind a layer of C, one library for each platform."""

from collections.abc import Sequence
from pathlib import Path

from rbfmu.runs.plan import Plan
from rbfmu.scene.scene import Scene
from rbfmu_fmu.archive import guid_of, scene_inside, write_archive, xml_bytes
from rbfmu_fmu.description import Description, describe
from rbfmu_fmu.fmi2_xml import model_description
from rbfmu_fmu.native.headers import headers
from rbfmu_fmu.native.linking import FLAGS, FMI2, HEADERS, linked, source, universal
from rbfmu_fmu.native.object_code import object_files
from rbfmu_fmu.native.platforms import Platform, platform_named, this_platform


def build_native_fmu(scene: Scene, plan: Plan, path: Path, platforms: Sequence[str] = ()) -> Path:
    """Write the FMU: the same bytes for the same scene; a file that stands at `path` is replaced when done.

    platforms: names from `platforms.PLATFORMS`; none: this one.
    """
    chosen = [platform_named(name) for name in sorted(set(platforms))] or [this_platform()]
    description = describe(scene, plan)
    objects = {p: object_files(plan.kernels, p) for p in chosen}
    contents = {"resources/scene.json": scene_inside(scene, plan)}
    xml = model_description(description, "{}", _capabilities(description))
    guid = guid_of(contents | _identity(description, objects), xml)
    xml.set("guid", guid)
    contents["modelDescription.xml"] = xml_bytes(xml)
    for folder in sorted({p.folder for p in chosen}):
        libraries = [
            linked(FMI2, objects[p], p, description.identifier, headers(description, guid))
            for p in chosen
            if p.folder == folder
        ]
        suffix = next(p.suffix for p in chosen if p.folder == folder)
        contents[f"binaries/{folder}/{description.identifier}{suffix}"] = universal(libraries)
    write_archive(contents, path)
    return path


def _capabilities(d: Description) -> dict[str, str]:
    said = {"needsExecutionTool": "false", "canNotUseMemoryManagementFunctions": "false"}
    said |= {"canInterpolateInputs": "true" if d.interpolates_inputs else "false"}
    return said | ({"maxOutputDerivativeOrder": "1"} if d.output_rates else {})


def _identity(d: Description, objects: dict[Platform, dict[str, bytes]]) -> dict[str, bytes]:
    """Return what makes the libraries what they are, except for their guid."""
    sources = {name: source(name) for name in (*FMI2, *HEADERS)}
    sources |= {name: text.encode() for name, text in headers(d, "").items()}
    sources |= {"flags": " ".join(FLAGS).encode()}
    return sources | {f"{p.name}/{name}": code for p, files in objects.items() for name, code in files.items()}
