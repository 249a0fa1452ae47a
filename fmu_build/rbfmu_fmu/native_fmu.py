"""Builds the native FMU of a scene: the unit's object code behind one C layer, a library for each platform."""

import json
from collections.abc import Iterable, Sequence
from pathlib import Path

from rbfmu.models import Plan
from rbfmu.scene import Scene
from rbfmu_fmu.archive import guid_of, scene_inside, write_archive, xml_bytes
from rbfmu_fmu.description import LOG_CATEGORIES, Description, describe, model_description
from rbfmu_fmu.linking import FLAGS, UNIT, linked, source, universal
from rbfmu_fmu.object_code import object_files
from rbfmu_fmu.platforms import Platform, platform_named, this_platform
from rbfmu_fmu.slave_access import HELD, TO_VARY

LAYER = "fmi2.c"

MOST_RATES = 2
"""Order of derivatives that the C layer's table has room for."""


def build_native_fmu(scene: Scene, plan: Plan, path: Path, platforms: Sequence[str] = ()) -> Path:
    """Write the FMU: the same bytes for the same scene; a file that stands at `path` is replaced when done.

    platforms: names from `platforms.PLATFORMS`; none: this one.
    """
    chosen = [platform_named(name) for name in sorted(set(platforms))] or [this_platform()]
    description = describe(scene, plan)
    objects = {p: object_files(plan.unit, p) for p in chosen}
    contents = {"resources/scene.json": scene_inside(scene, plan)}
    xml = model_description(description, "{}", _capabilities(description))
    guid = guid_of(contents | _identity(description, objects), xml)
    xml.set("guid", guid)
    contents["modelDescription.xml"] = xml_bytes(xml)
    for folder in sorted({p.folder for p in chosen}):
        libraries = [
            linked(LAYER, objects[p], p, description.identifier, {"model.h": model_header(description, guid)})
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
    """What makes the libraries what they are, but for their guid."""
    sources = {name: source(name) for name in (LAYER, UNIT)}
    sources |= {"model.h": model_header(d, "").encode(), "flags": " ".join(FLAGS).encode()}
    return sources | {f"{p.name}/{name}": code for p, files in objects.items() for name, code in files.items()}


def model_header(d: Description, guid: str) -> str:
    """C source of the scene's numbers and names."""
    inputs, parameters = (sum(v.causality == c for v in d.variables) for c in ("input", "parameter"))
    faults = {0: ("", "initialisation failed")} | d.faults
    rates = [(*v.rates, *[-1] * (MOST_RATES - len(v.rates))) for v in d.variables]
    lines = [
        f"#define GUID {_c(guid)}",
        f"#define HELD {_c(HELD)}",
        f"#define TO_VARY {_c(TO_VARY)}",
        f"#define CHANGED {_c(d.changed)}",
        f"#define CATEGORIES {_row([*map(_c, LOG_CATEGORIES), 'NULL'])}",
        f"#define START_TIME {d.start.hex()}",
        f"#define LAST_TIME {d.last_time.hex()}",
        "#define OUTPUT_RATES" if d.output_rates else "",
        f"enum {{ SIZE = {len(d.start_buffer)}, REALS = {len(d.variables)}, MOST_RATES = {MOST_RATES} }};",
        f"enum {{ FIRST_PARAMETER = {inputs}, FIRST_OUTPUT = {inputs + parameters} }};",
        f"static const double START[SIZE] = {_row(x.hex() for x in d.start_buffer)};",
        f"static const short OFFSETS[REALS] = {_row(v.offset for v in d.variables)};",
        f"static const short RATES[REALS][MOST_RATES] = {_row(map(_row, rates))};",
        "static const struct { const char *name, *block; int held; } VARIABLES[REALS] = {",
        *[f"    {_row((_c(v.name), _c(v.block), int(v.held)))}," for v in d.variables],
        "};",
        "static const struct { const char *block, *expected; } FAULTS[] = {",
        *[f"    [{code}] = {_row(map(_c, texts))}," for code, texts in faults.items()],
        "};",
    ]
    return "\n".join(lines) + "\n"


def _row(items: Iterable[object]) -> str:
    return f"{{{', '.join(map(str, items))}}}"


def _c(text: str) -> str:
    """A C string of plain ASCII."""
    assert text.isascii(), text
    return json.dumps(text)
