"""Files of an FMU that are only shown: picture, page and licences, and those with terminals and groups of variables.

They do not change what an FMU computes, and its identity does not depend on them. FMI 3.0 defines terminals; FMI 2.0.4
allows them too. libcosim connects groups of variables by an OspModelDescription (OSP-IS 1.0.1). It looks for this file
beside the FMU or the system file, not inside the FMU, from which users can extract it.
"""

import importlib.metadata
import math
import re
import tomllib
from collections.abc import Iterable
from html import escape
from itertools import product
from pathlib import Path
from string import Template
from typing import Any
from xml.etree.ElementTree import Element, SubElement

import numpy as np

import rbfmu
from rbfmu.types import Array
from rbfmu.viewer import Shape, shape_of
from rbfmu_fmu.description import AXES, Description, Variable, blocks
from rbfmu_fmu.model_description import STATUS, FmiVersion, fmi_name, without_blanks, xml_bytes
from rbfmu_fmu.native.platforms import FMI_HEADERS
from rbfmu_kernels.compile.tiered import evaluated
from rbfmu_kernels.rotations.matrix import matrix_from_quaternion

LICENSES = "documentation/licenses"
PYTHONFMU = "- the library of pythonfmu and its Python modules: MIT licence, pythonfmu.txt\n"
HEADS = ("name", "unit", "meaning", "components", "start")
"""The headings of the page's tables."""


def presentation_files(
    d: Description, version: FmiVersion, needs_python: bool, with_terminals: bool = False
) -> dict[str, bytes]:
    """Return the files by their paths in the FMU.

    needs_python: whether it is of the pythonfmu kind; with_terminals: list terminals in FMI 2.0 too. FMI 2.0.4 allows
    that file, but FMI Library 3 and FMU Container fail when an FMU of FMI 2.0 has it.
    """
    files = {version.icon: picture(d.scene), **licenses(needs_python)}
    files["documentation/index.html"] = page(d, version, needs_python).encode()
    if with_terminals or version.name != "2.0":
        files["terminalsAndIcons/terminalsAndIcons.xml"] = xml_bytes(terminals(d, version.has_arrays))
    if version.name == "2.0":  # libcosim imports only this version
        files[osp_place(d)] = xml_bytes(osp_description(d))
    if needs_python:
        files["documentation/externalDependencies.txt"] = _template("external_dependencies.txt").template.encode()
    return files


def _template(name: str) -> Template:
    return Template(Path(__file__).with_name(name).read_text("utf-8"))


def page(d: Description, version: FmiVersion, needs_python: bool) -> str:
    """Return the HTML page about an FMU; it also says how inputs can change within a step."""
    scene, plan = d.scene, d.plan
    run, pivot = scene.run, scene.body is not None and scene.body.pivot
    texts = {"name": scene.name, "icon": version.icon, "status": STATUS["description"], "version": rbfmu.__version__}
    texts |= {"model": plan.model, "states": str(plan.states), "method": plan.method, "error": f"{plan.error:.1e}"}
    texts |= {key: f"{getattr(run, key):g}" for key in ("accuracy", "start", "stop", "step")}
    unless = f", unless the importer {version.course_of_inputs}" if d.interpolates_inputs and not needs_python else ""
    held = (
        f"<p>Inputs are held over a communication step{unless}. What is lost by holding an input that changes "
        "meanwhile comes on top, and is first order in the communication step.</p>\n"
    )
    made = {
        "about": "".join(f"<p>{escape(text)}</p>\n" for text in (scene.about.description, _authorship(scene)) if text),
        "reasons": "".join(f"<li>{escape(reason)}</li>\n" for reason in plan.reasons),
        "tables": "".join(_table(d, causality) for causality in ("input", "output", "parameter")),
        "pivot": " The body's origin o is a pivot, fixed in space." if pivot else "",
        "inputs": held if d.inputs else "",
        "formulas": _formulas(scene),
    }
    return _template("page.html").substitute({key: escape(text) for key, text in texts.items()} | made)


def _formulas(scene: rbfmu.Scene) -> str:
    """Return a table of the scene's formulas, or the sentence that no load depends on the position."""
    if not scene.loads.formulas:
        return "<p>No load depends on the position.</p>\n"
    loads = scene.loads
    beside = {n: str(list(getattr(loads, n))) for n, size in loads.sizes.items() if size and n in loads.made}
    named = {"loads": {**loads.formulas, **beside}, "formulas": scene.formulas}  # a potential adds to a constant force
    named["rates of states"] = {name: row.rate for name, row in scene.states.items()}
    rows = [(escape(of), escape(n), f"<code>{escape(text)}</code>") for of in named for n, text in named[of].items()]
    return _html_table(("formulas of", "name", "text"), rows)


def _html_table(heads: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    tagged = [("th", heads), *(("td", row) for row in rows)]
    lines = [f"<tr>{''.join(f'<{tag}>{cell}</{tag}>' for cell in row)}</tr>\n" for tag, row in tagged]
    return f"<table>\n{''.join(lines)}</table>\n"


def _authorship(scene: rbfmu.Scene) -> str:
    texts = {"author": scene.about.author, "version": scene.about.version, "licence": scene.about.license}
    return "; ".join(f"{word}: {text}" for word, text in texts.items() if text)


def _table(d: Description, causality: str) -> str:
    """Return a table with a row for each block; empty if there are none."""
    rows = [map(escape, _row(variables)) for variables in blocks(d, causality).values()]
    return f"<h3>{causality.capitalize()}s</h3>\n{_html_table(HEADS, rows)}" if rows else ""


def _row(variables: list[Variable]) -> tuple[str, ...]:
    first = variables[0]
    components = ", ".join(f"{v.name.removeprefix(v.block)} {v.component}" for v in variables if v.component)
    start = ", ".join(repr(v.start) for v in variables if v.start is not None)
    held = " (cannot be changed)" if first.pinned else ""
    return first.block, fmi_name(first.unit), first.meaning + held, components, start


def licenses(with_pythonfmu: bool) -> dict[str, bytes]:
    """Return the licences by their paths in an FMU; with_pythonfmu: for the kind that contains pythonfmu."""
    texts = {"license.txt": _template("licenses.txt").substitute(pythonfmu=PYTHONFMU if with_pythonfmu else "")}
    texts |= {"rbfmu.txt": _license_of_rbfmu(), "fmi.txt": _license_of_fmi()}
    if with_pythonfmu:
        files = importlib.metadata.files("pythonfmu") or []
        licence = next(file for file in files if re.fullmatch(r"LICEN[CS]E(\.\w+)?", file.name))
        texts["pythonfmu.txt"] = licence.read_text("utf-8")
    return {f"{LICENSES}/{name}": text.encode() for name, text in texts.items()}


def _license_of_rbfmu() -> str:
    """Return the licence of rbfmu, which is in the installed package, or in the folder above it in a clone."""
    package = Path(rbfmu.__file__).parent
    return next(path for path in (package / "LICENSE", package.parent / "LICENSE") if path.exists()).read_text("utf-8")


def _license_of_fmi() -> str:
    """Return the copyright and the licence in the headers of FMI, as FMPy ships them."""
    text = (FMI_HEADERS / "fmi2Functions.h").read_text("utf-8")
    notice = re.search(r"Copyright.*?(?=\*/)", text, re.DOTALL)
    assert notice, text[:3000]
    return "\n".join(line.strip() for line in notice[0].splitlines()).strip("- \n") + "\n"


# --- the picture

INCHES, DPI = 2.0, 100
AZIMUTH, ELEVATION = math.radians(30.0), math.radians(28.0)
"""The direction of view: from above, and from axis x turned towards y; z is upwards."""
RIGHT = (-math.sin(AZIMUTH), math.cos(AZIMUTH), 0.0)
EYE = (math.cos(ELEVATION) * math.cos(AZIMUTH), math.cos(ELEVATION) * math.sin(AZIMUTH), math.sin(ELEVATION))
VIEW: Array = np.array([RIGHT, np.cross(EYE, RIGHT), EYE])
"""The directions right, up and towards the eye, as rows, in b."""
COLOURS = {"x": "#c8372d", "y": "#2d8a3e", "z": "#2a5db0"}
SHADES = {"x": "#b9c4d6", "y": "#94a3bb", "z": "#dbe2ee"}
"""The colours of the faces that are perpendicular to each of the shape's axes."""
EDGE = "#4a5568"
AXIS = 0.8
"""The length of an axis beyond the box, in halves of its diagonal."""


def picture(scene: rbfmu.Scene) -> bytes:
    """Return a PNG of 200 by 200 points, the same bytes for the same scene and the same matplotlib."""
    from matplotlib.figure import Figure

    from rbfmu.plot import png_of

    figure = Figure(figsize=(INCHES, INCHES), dpi=DPI)
    axes = figure.add_axes((0.02, 0.02, 0.96, 0.96))
    axes.set_axis_off()
    axes.set_aspect("equal")
    shape = shape_of(scene, as_box=True)
    R_bp = np.array(evaluated(matrix_from_quaternion, shape.q_bp))
    _draw_box(axes, shape, R_bp)
    _draw_axes(axes, shape, R_bp)
    axes.margins(0.06)
    return png_of(figure, dpi=DPI, metadata={"Software": None})


def _draw_box(axes: Any, shape: Shape, R_bp: Array) -> None:
    """Draw the three visible faces of the box; none of them hides another."""
    for k, name in enumerate(SHADES):
        normal = R_bp[:, k] if R_bp[:, k] @ VIEW[2] > 0.0 else -R_bp[:, k]
        across = [R_bp[:, j] * shape.sides[j] / 2.0 for j in range(3) if j != k]
        middle = np.array(shape.centre) + normal * shape.sides[k] / 2.0
        corners = [middle + a * across[0] + b * across[1] for a, b in ((1, 1), (1, -1), (-1, -1), (-1, 1))]
        seen = (np.array(corners) @ VIEW.T)[:, :2]
        axes.fill(seen[:, 0], seen[:, 1], facecolor=SHADES[name], edgecolor=EDGE, linewidth=0.8, joinstyle="round")


def _draw_axes(axes: Any, shape: Shape, R_bp: Array) -> None:
    """Draw the axes of b, from o to beyond the box, and the centre of mass."""
    corners = [np.array(shape.centre) + R_bp @ (np.array(s) * shape.sides / 2.0) for s in product((-1, 1), repeat=3)]
    for k, name in enumerate(COLOURS):
        length = max(0.0, *(corner[k] for corner in corners)) + AXIS * shape.radius
        x, y, _ = VIEW[:, k] * length
        arrow = {"arrowstyle": "-|>", "color": COLOURS[name], "linewidth": 1.4, "shrinkA": 0, "shrinkB": 0}
        axes.annotate("", (x, y), (0.0, 0.0), arrowprops=arrow)
        axes.annotate(name, (1.08 * x, 1.08 * y), color=COLOURS[name], fontsize=9, ha="center", va="center")
        axes.plot([0.0, 1.12 * x], [0.0, 1.12 * y], alpha=0.0)  # invisible: the limits of the axes must include it
    x, y, _ = VIEW @ np.array(shape.centre)
    axes.plot([x], [y], marker="o", markersize=4.5, mfc="white", mec="black", mew=1.0)


# --- files with groups of variables that belong together and are connected together

_TABLES = tomllib.loads(Path(__file__).with_name("groups.toml").read_text(encoding="utf-8"))
GROUPS: dict[str, dict[str, Any]] = _TABLES["terminals"]
"""The terminals by name: the meaning of each, and its blocks, of which a terminal has those of the FMU."""
QUATERNION = ("eta", "epsilon_x", "epsilon_y", "epsilon_z")
TERMINALS_VERSION = "3.0"
"""The version of FMI that defines the file, also in an FMU of another version."""

OSP_NAMESPACE = "https://open-simulation-platform.com/OspModelDescription/1.0.1"
OSP_FOLDER = "extra/com.open-simulation-platform"

KINDS: dict[str, str] = _TABLES["kinds"]
"""The XML element for each block, in the order of the schema."""
MECHANICAL_PORTS: dict[str, list[str]] = _TABLES["ports"]
"""The ports by name: the XML element, an input and an output in the same axes, whose product is a power."""


def terminals(d: Description, arrays: bool = False) -> Element:
    """Return terminalsAndIcons.xml; arrays: whether a variable is a whole block, not one of its numbers."""
    root = Element("fmiTerminalsAndIcons", fmiVersion=TERMINALS_VERSION)
    known, listed = blocks(d, "input", "output"), Element("Terminals")
    for name, row in GROUPS.items():
        terminal = Element("Terminal", name=name, matchingRule="bus", description=row["meaning"])
        for block in (name for name in row["blocks"] if name in known):
            inner = SubElement(terminal, "Terminal", name=block, matchingRule="plug")
            names = {"value": block} if arrays else _members(known[block])
            for member, variable in names.items():
                attributes = {"variableName": variable, "memberName": member, "variableKind": "signal"}
                SubElement(inner, "TerminalMemberVariable", attributes)
        listed.extend([terminal] if len(terminal) else [])
    root.extend([listed] if len(listed) else [])
    return root


def _members(variables: list[Variable]) -> dict[str, str]:
    """Return the names of a block's variables by their names in a terminal."""
    names = QUATERNION if len(variables) == 4 else [v.component or "value" for v in variables]
    return {name: v.name for name, v in zip(names, variables, strict=True)}


def osp_place(d: Description) -> str:
    """Return the path of OspModelDescription.xml in an FMU, with the scene's name, for which libcosim looks.

    A scene's name that is no file name on some system is left out.
    """
    prefix = f"{d.scene.name}_" if re.fullmatch(r"[A-Za-z0-9_ .-]+", d.scene.name) else ""
    return f"{OSP_FOLDER}/{prefix}OspModelDescription.xml"


def osp_description(d: Description) -> Element:
    """Return OspModelDescription.xml, with groups of all inputs and outputs; groups in a port are listed only there."""
    root = Element("OspModelDescription", xmlns=OSP_NAMESPACE, version="1.0")
    groups, known = SubElement(root, "VariableGroups"), blocks(d, "input", "output")
    ports = {name: (kind, both) for name, (kind, *both) in MECHANICAL_PORTS.items() if known.keys() >= {*both}}
    parts = {block for _, both in ports.values() for block in both}
    groups.extend(_osp_group(block, known[block]) for block in KINDS if block in known and block not in parts)
    for name, (kind, both) in ports.items():
        SubElement(groups, kind, name=name).extend(_osp_group(block, known[block]) for block in both)
    return root


def _osp_group(block: str, variables: list[Variable]) -> Element:
    group = Element(KINDS[block], name=block)
    for k, v in enumerate(variables):
        axis = AXES[k] if len(variables) == 3 else ""
        SubElement(group, "Variable", without_blanks(ref=v.name, unit=fmi_name(v.unit), axis=axis))
    return group
