"""What an FMU has only to be shown: picture, page, licences, terminals and groups of variables, by place in it.

None of it changes what an FMU computes, and its identity does not rest on it.
"""

import importlib.metadata
import re
from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path

import rbfmu
from rbfmu import Plan, Scene
from rbfmu_fmu.archive import xml_bytes
from rbfmu_fmu.description import Description, Variable, blocks, scalars
from rbfmu_fmu.fmi_version import FmiVersion
from rbfmu_fmu.model_description import STATUS_MEANING, unit_and_limits
from rbfmu_fmu.native.linking import FMI_HEADERS
from rbfmu_fmu.picture import picture
from rbfmu_fmu.variable_groups import osp_description, osp_place, terminals
from rbfmu_kernels.quantities import BY_NAME

EXTERNAL = """This FMU runs Python in the importer's process.

It needs CPython 3.11 or later as a shared library in that process. An importer that is itself a Python program has it.
Others on Linux need LD_PRELOAD=libpython3.x.so. The code of the model is compiled for the platform on which the FMU was
built; on others it needs the Python packages numba and numpy.
"""
"""documentation/externalDependencies.txt of the pythonfmu kind."""

FRAMES = """Frame a is inertial, frame b is fixed in the body. The body's origin is o; its centre of mass is at r_oc_b
from o. The picture has the axes of b at o, and a circle at the centre of mass. A name that ends in _a or _b says in
which frame a vector is decomposed. The quaternion q_ab (Euler parameters, scalar first) turns coordinates in b to
coordinates in a, v_a = R(q_ab) v_b. Roll, pitch and yaw make the same rotation, R_ab = R_z(yaw) R_y(pitch) R_x(roll).
Units are SI; angles are in radians, and have degrees as a display unit."""

STYLE = """body { font: 15px/1.45 sans-serif; max-width: 52em; margin: 2em auto; padding: 0 1em; }
table { border-collapse: collapse; } th, td { text-align: left; vertical-align: top; padding: 0.15em 0.8em 0.15em 0; }
th { border-bottom: 1px solid #888; } img { float: right; } code { font-size: 95%; }"""

LICENSES = "documentation/licenses"
LICENSE_ENTRY = """This FMU contains

- code of rbfmu, compiled or as it is: MIT licence, rbfmu.txt
- names and types of functions from the headers of the FMI standard: 2-clause BSD licence, fmi.txt
{pythonfmu}
The numbers in it are those of a scene, whose author may have terms of their own: see the attribute license in
modelDescription.xml.
"""
PYTHONFMU = "- the library of pythonfmu and its Python modules: MIT licence, pythonfmu.txt\n"


def presentation_files(
    scene: Scene, plan: Plan, d: Description, version: FmiVersion, needs_python: bool, with_terminals: bool = False
) -> dict[str, bytes]:
    """Return the files; needs_python: of the pythonfmu kind; with_terminals: list them in FMI 2.0 as well.

    FMI 2.0.4 allows the file, but FMI Library 3 and FMU Container fail at it in an FMU of FMI 2.0.
    """
    course = version.course_of_inputs if d.interpolates_inputs and not needs_python else ""
    has_arrays = version.references is not scalars
    files = {
        version.icon: picture(scene),
        "documentation/index.html": page(scene, plan, d, version.icon, course).encode(),
        **licenses(needs_python),
    }
    if with_terminals or version.name != "2.0":
        files["terminalsAndIcons/terminalsAndIcons.xml"] = xml_bytes(terminals(d, has_arrays))
    if version.name == "2.0":  # the one that libcosim imports
        files[osp_place(d)] = xml_bytes(osp_description(d))
    if needs_python:
        files["documentation/externalDependencies.txt"] = EXTERNAL.encode()
    return files


def page(scene: Scene, plan: Plan, d: Description, icon: str, course: str = "") -> str:
    """Return the page; icon: the place of the FMU's picture; course: how inputs change within a step, if they can."""
    said = [f"<p>{escape(text)}</p>" for text in (d.about["description"], _by_whom(d)) if text]
    parts = [
        f'<h1>{escape(d.name)}</h1>\n<img src="../{icon}" alt="the body and its axes">', *said,
        "<h2>Model</h2>", *_model(scene, plan),
        "<h2>Frames</h2>", f"<p>{escape(FRAMES)}</p>",
        "<h2>Variables</h2>", *_variables(d),
        "<h2>Accuracy</h2>", *_accuracy(scene, plan, d, course),
        f'<p>Made by rbfmu {rbfmu.__version__}. <a href="licenses/license.txt">Licences</a>.</p>',
    ]  # fmt: skip
    head = f'<meta charset="utf-8">\n<title>{escape(d.name)}</title>\n<style>\n{STYLE}\n</style>'
    return (
        f'<!DOCTYPE html>\n<html lang="en">\n<head>\n{head}\n</head>\n<body>\n{chr(10).join(parts)}\n</body>\n</html>\n'
    )


def _by_whom(d: Description) -> str:
    words = {"author": "author", "version": "version", "license": "licence"}
    return "; ".join(f"{word}: {d.about[key]}" for key, word in words.items() if d.about[key])


def _model(scene: Scene, plan: Plan) -> list[str]:
    """Return model and method, what was left out and why, and what is not modelled at all."""
    reasons = "".join(f"<li>{escape(reason)}</li>\n" for reason in plan.reasons)
    pivot = " The body's origin o is a pivot, fixed in space." if scene.body is not None and scene.body.pivot else ""
    return [
        f"<p>One rigid body: {escape(plan.model)}, {plan.states} states; method: {escape(plan.method)}.{pivot}</p>",
        f"<p>Why this model, and what was left out because nothing asked for depends on it:</p>\n<ul>\n{reasons}</ul>",
        "<p>There are no joints, no contacts and no flexible parts, and no load depends on the position.</p>",
    ]


def _accuracy(scene: Scene, plan: Plan, d: Description, course: str) -> list[str]:
    run = scene.run
    lines = [
        f"<p>The accuracy asked is {run.accuracy:g} from t = {run.start:g} s to {run.stop:g} s: the largest error of "
        "the attitude in rad, of rates relative to their largest, of positions and velocities relative to theirs, at "
        f"least 1 m and 1 m/s. Expected is {plan.error:.1e}. Substeps inside the FMU keep it, whatever the "
        f"communication step is; the scene has {run.step:g} s.</p>"
    ]
    if d.inputs:
        unless = f", unless the importer {course}" if course else ""
        lines.append(
            f"<p>Inputs are held over a communication step{unless}. What is lost by holding an input that changes "
            "meanwhile comes on top, and is first order in the communication step.</p>"
        )
    return [*lines, f"<p>The output <code>status</code> says how it went: {escape(STATUS_MEANING)}.</p>"]


def _variables(d: Description) -> list[str]:
    """Return a table for each causality, with a row a block."""
    tables = []
    for causality in ("input", "output", "parameter"):
        if found := blocks(d, causality):
            tables.append(_table(causality, map(_row, found.values())))
    return tables


def _table(causality: str, rows: Iterable[Sequence[str]]) -> str:
    heads = ("name", "unit", "meaning", "components", "start")
    lines = [f"<tr>{''.join(f'<{tag}>{escape(cell)}</{tag}>' for cell in row)}</tr>"
             for tag, row in (("th", heads), *(("td", row) for row in rows))]  # fmt: skip
    return f"<h3>{causality.capitalize()}s</h3>\n<table>\n{chr(10).join(lines)}\n</table>"


def _row(variables: list[Variable]) -> tuple[str, ...]:
    first = variables[0]
    components = ", ".join(f"{v.name.removeprefix(v.block)} {v.component}" for v in variables if v.component)
    start = ", ".join(repr(v.start) for v in variables if v.start is not None)
    held = " (cannot be changed)" if first.pinned else ""
    return first.block, unit_and_limits(first)["unit"], BY_NAME[first.block].meaning + held, components, start


def licenses(with_pythonfmu: bool) -> dict[str, bytes]:
    """Return the notices by their place in an FMU; with_pythonfmu: of the kind that contains pythonfmu."""
    texts = {"license.txt": LICENSE_ENTRY.format(pythonfmu=PYTHONFMU if with_pythonfmu else "")}
    texts |= {"rbfmu.txt": _own(), "fmi.txt": _of_headers()}
    texts |= {"pythonfmu.txt": _of_package("pythonfmu")} if with_pythonfmu else {}
    return {f"{LICENSES}/{name}": text.encode() for name, text in texts.items()}


def _own() -> str:
    """Return the licence of rbfmu, which lies in the package or, of a clone, above it."""
    package = Path(rbfmu.__file__).parent
    return next(path for path in (package / "LICENSE", package.parent / "LICENSE") if path.exists()).read_text("utf-8")


def _of_package(name: str) -> str:
    files = importlib.metadata.files(name) or []
    return next(file for file in files if re.fullmatch(r"LICEN[CS]E(\.\w+)?", file.name)).read_text("utf-8")


def _of_headers() -> str:
    """Return the copyright and the terms that stand in the headers of FMI, as FMPy ships them."""
    text = (FMI_HEADERS / "fmi2Functions.h").read_text("utf-8")
    notice = re.search(r"Copyright.*?(?=\*/)", text, re.DOTALL)
    assert notice, text[:3000]
    return "\n".join(line.strip() for line in notice[0].splitlines()).strip("- \n") + "\n"
