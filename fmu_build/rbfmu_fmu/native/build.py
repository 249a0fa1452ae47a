"""Builds the native FMU of a scene: the model's object code behind a layer of C, one library for each platform."""

from collections.abc import Sequence
from pathlib import Path

from rbfmu.runs.plan import Plan
from rbfmu.scene.scene import Scene
from rbfmu_fmu.archive import guid_of, scene_inside, write_archive, xml_bytes
from rbfmu_fmu.description import Description, describe
from rbfmu_fmu.fmi2_xml import FMI2
from rbfmu_fmu.fmi3_xml import FMI3, FMI3_SCALARS
from rbfmu_fmu.fmi_version import UNSET, FmiVersion
from rbfmu_fmu.native.headers import headers
from rbfmu_fmu.native.linking import ANY_VERSION, FLAGS, HEADERS, linked, source, universal
from rbfmu_fmu.native.object_code import object_files
from rbfmu_fmu.native.platforms import Platform, platforms_named
from rbfmu_fmu.presentation.files import shown_files

VERSIONS = {(2, False): FMI2, (3, False): FMI3, (3, True): FMI3_SCALARS}
"""What native FMUs are built for: by the version of FMI, and by whether scalars are asked for in place of arrays."""


def version_of(fmi: int, scalars: bool) -> FmiVersion:
    """Return a version of FMI, with arrays as variables or without. Raises ValueError where there is none."""
    if fmi not in (2, 3):
        raise ValueError(f"fmi = {fmi!r}: expected 2 or 3")
    if (fmi, scalars) not in VERSIONS:
        raise ValueError("scalars = True: expected fmi = 3 with it, as FMI 2 has no arrays")
    return VERSIONS[fmi, scalars]


def build_native_fmu(
    scene: Scene,
    plan: Plan,
    path: Path,
    platforms: Sequence[str] = (),
    version: FmiVersion = FMI2,
    terminals: bool = False,
) -> Path:
    """Write the FMU: the same bytes for the same scene; a file that stands at `path` is replaced when done.

    platforms: names from `platforms.PLATFORMS`, or "all"; none: this one; terminals: list them in FMI 2.0 as well.
    """
    chosen = platforms_named(platforms)
    description = describe(scene, plan)
    objects = {p: object_files(plan.kernels, p) for p in chosen}
    contents = {"resources/scene.json": scene_inside(scene, plan)}
    xml = version.model_description(description, UNSET, version.capabilities(description))
    guid = guid_of(contents | _identity(description, version, objects), xml)
    xml.set(version.identity, guid)
    contents["modelDescription.xml"] = xml_bytes(xml)
    for folder in sorted({version.folders[p.name] for p in chosen}):
        members = [p for p in chosen if version.folders[p.name] == folder]
        libraries = [
            linked(c_sources(version), objects[p], p, description.identifier, headers(description, version, guid))
            for p in members
        ]
        for place in (folder, *_second_folders(version, members, chosen)):
            contents[f"binaries/{place}/{description.identifier}{members[0].suffix}"] = universal(libraries)
    shown = shown_files(scene, plan, description, version, needs_python=False, with_terminals=terminals)
    write_archive(contents | shown, path)
    return path


def _second_folders(version: FmiVersion, members: Sequence[Platform], chosen: Sequence[Platform]) -> list[str]:
    """Return further folders of a library that serves `members`: such as no platform of the FMU has for its own."""
    second = {version.second_folders[p.name] for p in members if p.name in version.second_folders}
    return sorted(second - {version.folders[p.name] for p in chosen})


def c_sources(version: FmiVersion) -> tuple[str, ...]:
    """Return the C sources in `native/` of an FMU of a version of FMI."""
    return (version.signatures, *ANY_VERSION)


def _identity(d: Description, version: FmiVersion, objects: dict[Platform, dict[str, bytes]]) -> dict[str, bytes]:
    """Return what makes the libraries what they are, except for their guid."""
    parts = {name: source(name) for name in (*c_sources(version), *HEADERS)}
    parts |= {name: text.encode() for name, text in headers(d, version, "").items()}
    parts |= {"flags": " ".join(FLAGS).encode()}
    return parts | {f"{p.name}/{name}": code for p, files in objects.items() for name, code in files.items()}
