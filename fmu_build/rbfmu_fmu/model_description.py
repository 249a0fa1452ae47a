"""Writes modelDescription.xml of a description, for any version of FMI, and files beside it that group its variables.

Attributes stand in a fixed order, so that the same scene gives the same bytes. Terminals are FMI 3.0's, and FMI 2.0.4
has them as well. An OspModelDescription is that by which libcosim connects groups (OSP-IS 1.0.1); it looks for it
beside the FMU or the system file, not in the FMU, which has it to be taken out.
"""

import re
from collections.abc import Iterable, Iterator
from xml.etree.ElementTree import Element, SubElement, indent, tostring

import rbfmu
from rbfmu_fmu.description import AXES, Description, Variable, blocks
from rbfmu_fmu.fmi_version import FmiVersion
from rbfmu_fmu.python.call_rules import LOG_CATEGORIES
from rbfmu_fmu.python.slave_access import TO_VARY
from rbfmu_kernels.quantities import PORTS, TIME, UNITS, Unit

LICENSE = "MIT; see documentation/licenses"
"""The terms of the code in an FMU, which a scene's own stand beside."""
_KINDS = {"input": ("continuous", ""), "parameter": ("fixed", "exact"), "output": ("continuous", "calculated")}
"""By causality: variability and initial."""
STATUS_MEANING = (
    "0: fine; 1: the last step was refused or missed the accuracy; 2: past the stop time, accuracy not promised"
)
STATUS = {"name": "status", "causality": "output", "variability": "discrete", "initial": "calculated"}
STATUS |= {"description": STATUS_MEANING}
STATUS_RANGE = {"min": "0", "max": "2"}
UNSET = "{}"
"""Stands for an FMU's identity while that identity is being made."""


def model_description(version: FmiVersion, d: Description, co_simulation: dict[str, str]) -> Element:
    """Return modelDescription.xml, without identity; `co_simulation` has attributes in which kinds of FMU differ."""
    about = {"generationTool": f"rbfmu {rbfmu.__version__}", "description": "One rigid body", "license": LICENSE}
    about |= _said(**d.about)
    root = Element("fmiModelDescription", {
        "fmiVersion": version.name, "modelName": d.scene.name, version.identity: UNSET, **about,
        "variableNamingConvention": "structured",
    })  # fmt: skip
    SubElement(root, "CoSimulation", {
        "modelIdentifier": d.identifier, "canHandleVariableCommunicationStepSize": "true", **version.abilities,
        **co_simulation,
    })  # fmt: skip
    root.append(_unit_definitions(_units(d) | ({TIME.unit} if version.has_time else set())))
    root.extend(_type_definitions(version, d))
    categories = (Element("Category", name=name, description=says) for name, says in LOG_CATEGORIES.items())
    SubElement(root, "LogCategories").extend(categories)
    run = {"startTime": "start", "stopTime": "stop", "tolerance": "accuracy", "stepSize": "step"}
    SubElement(root, "DefaultExperiment", {name: repr(getattr(d.scene.run, key)) for name, key in run.items()})
    SubElement(root, "ModelVariables").extend(_variables(version, d))
    root.append(_model_structure(version, d))
    return root


def _said(**attributes: str) -> dict[str, str]:
    """Return attributes in their order, without those of which nothing is said."""
    return {name: text for name, text in attributes.items() if text}


def _element(version: FmiVersion, outer: str, kind: str, said: dict[str, str], typed: dict[str, str]) -> Element:
    """Return what is said of a thing and of its type: FMI 2 has an element in another for it, FMI 3 one of the kind."""
    if not version.nested:
        return Element(kind, said | typed)
    element = Element(outer, said)
    SubElement(element, kind, typed)
    return element


def _type_definitions(version: FmiVersion, d: Description) -> list[Element]:
    """Return the declared types in one element, or none where no variable has a type."""
    definitions, kind = Element("TypeDefinitions"), version.real if version.nested else f"{version.real}Type"
    for unit in sorted(_units(d), key=_fmi_name):
        if name := _unit(unit).quantity:
            definitions.append(_element(version, "SimpleType", kind, {}, _of_unit(unit)))
            definitions[-1].set("name", name)
    return [definitions] if len(definitions) else []


def _variables(version: FmiVersion, d: Description) -> Iterator[Element]:
    """Yield all variables in the order of their value references."""
    named = version.references(d)
    updated = _said(intermediateUpdate="true" if d.interpolates_inputs and not version.nested else "")
    for reference, one in enumerate(named):
        members = [d.variables[k] for k in one.elements]
        first = members[0]
        variability, initial = _KINDS[first.causality]
        words = "" if len(one.dimensions) == 2 else ", ".join(v.component for v in members)
        about_it = f"{first.meaning}: {words}" if words else first.meaning
        if first.pinned:
            about_it += f"; cannot be changed here: {TO_VARY % first.block}"
        said = {"name": one.name, "valueReference": str(reference), "causality": first.causality}
        said |= _said(variability=variability, description=about_it, initial=initial)
        said |= updated if first.causality != "parameter" else {}
        typed = _said(declaredType=_unit(first.unit).quantity) | _limits_of_all(members)
        element = _element(version, "ScalarVariable", version.real, said, typed)
        element.extend(Element("Dimension", start=str(size)) for size in one.dimensions)
        yield element
    if version.has_time:
        time = {"name": TIME.name, "valueReference": str(len(named)), "causality": "independent"}
        time |= {"variability": "continuous", "unit": TIME.unit, "description": TIME.meaning}
        yield Element(version.real, time)
    counts = [(r, {"name": one.name, "description": one.meaning}, {"min": "0"}) for r, one in version.counted(d)]
    for reference, differs, limits in [(version.status_reference(d), {}, STATUS_RANGE), *counts]:
        element = _element(version, "ScalarVariable", version.integer, STATUS | updated | differs, limits)
        element.set("valueReference", str(reference))
        yield element


def _limits_of_all(members: list[Variable]) -> dict[str, str]:
    """Return unit, bounds, size and start, as far as there are any; bounds hold for every element alike."""
    first = members[0]
    lows, highs = ([getattr(v, key) for v in members] for key in ("minimum", "maximum"))
    limits = {"min": None if None in lows else min(lows), "max": None if None in highs else max(highs)}
    limits["nominal"] = first.nominal
    said = _of_unit(first.unit) | {key: repr(x) for key, x in limits.items() if x is not None}
    return said | ({"start": " ".join(repr(v.start) for v in members)} if first.start is not None else {})


def _model_structure(version: FmiVersion, d: Description) -> Element:
    """Return outputs with what they depend on."""
    structure, named = Element("ModelStructure"), version.references(d)
    holder = {k: reference for reference, one in enumerate(named) for k in one.elements}
    key, first = ("index", 1) if version.nested else ("valueReference", 0)
    for name, depends in (("Output", depends_on), ("InitialUnknown", depends_initially_on)):
        known: dict[int, Iterable[int]] = {
            reference: {holder[k] for k in depends(d, d.variables[one.elements[0]])}
            for reference, one in enumerate(named)
            if d.variables[one.elements[0]].causality == "output"
        }
        known |= dict.fromkeys((version.status_reference(d), *(reference for reference, _ in version.counted(d))), ())
        unknowns = SubElement(structure, f"{name}s") if version.nested else structure
        for reference, others in known.items():
            listed = " ".join(str(k + first) for k in sorted(others))
            kind = "Unknown" if version.nested else name
            SubElement(unknowns, kind, {key: str(reference + first), "dependencies": listed})
    return structure


def _units(d: Description) -> set[str]:
    return {v.unit for v in d.variables}


def _unit(name: str) -> Unit:
    """Return what is known of a unit: of one that a scene names itself, nothing but its name."""
    return UNITS.get(name, Unit("", {}))


def _unit_definitions(names: set[str]) -> Element:
    """Return units with FMI's exponents of the base units, and the units in which a tool may show them."""
    definitions = Element("UnitDefinitions")
    for name in sorted(names):
        element, unit = SubElement(definitions, "Unit", name=_fmi_name(name)), _unit(name)
        if name in UNITS:
            SubElement(element, "BaseUnit", {base: str(exponent) for base, exponent in unit.exponents.items()})
        for display, factor in unit.display:
            SubElement(element, "DisplayUnit", name=display, factor=repr(factor))
    return definitions


def _of_unit(name: str) -> dict[str, str]:
    """Return the attributes quantity, unit and displayUnit, as far as there are any."""
    unit = _unit(name)
    display = unit.display[0][0] if unit.display else ""
    return _said(quantity=unit.quantity, unit=_fmi_name(name), displayUnit=display)


def _fmi_name(unit: str) -> str:
    return unit.replace(" ", ".")


def unit_of(v: Variable) -> str:
    """Return a variable's unit, by its name in FMI."""
    return _fmi_name(v.unit)


def depends_on(d: Description, output: Variable) -> list[int]:
    """Return the inputs, by their number among the variables, that an output follows at once."""
    return [k for k, v in enumerate(d.variables) if v.causality == "input" and v.block in output.follows]


def depends_initially_on(d: Description, output: Variable) -> list[int]:
    """Return the inputs and parameters, by their number, that an output depends on at the start."""
    return [k for k, v in enumerate(d.variables) if v.causality != "output" and v.block in output.begins_with]


def xml_bytes(xml: Element) -> bytes:
    """Return XML as the bytes of a file."""
    indent(xml)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{tostring(xml, "unicode")}\n'.encode()


# --- files that group variables which belong and connect together

GROUPS = {
    "loads": ("forces and torques that another unit supplies", tuple(name for name in PORTS if name != "omega_b")),
    "pose": ("position and attitude", ("position", "quaternion", "rpy")),
    "rates": ("velocity and angular velocity", ("velocity", "omega_b", "omega_a")),
    "accelerations": ("acceleration and angular acceleration", ("acceleration", "alpha_b")),
    "conserved": ("angular momentum and kinetic energy", ("angular_momentum_a", "kinetic_energy")),
}
"""By the name of a terminal: what it is, and the blocks that it has where an FMU has them."""
QUATERNION = ("eta", "epsilon_x", "epsilon_y", "epsilon_z")
TERMINALS_VERSION = "3.0"
"""The version of FMI that defines the file, also in an FMU of another version."""

OSP_NAMESPACE = "https://open-simulation-platform.com/OspModelDescription/1.0.1"
OSP_FOLDER = "extra/com.open-simulation-platform"

KINDS = {
    "quaternion": "Generic", "angular_momentum_a": "Generic", "kinetic_energy": "Generic",
    "force_a": "Force", "force_b": "Force", "torque_a": "Torque", "torque_b": "Torque",
    "velocity": "LinearVelocity", "omega_b": "AngularVelocity", "omega_a": "AngularVelocity",
    "position": "LinearDisplacement", "rpy": "AngularDisplacement",
    "acceleration": "LinearAcceleration", "alpha_b": "AngularAcceleration",
}  # fmt: skip
"""The element of each block, in the order that the schema has."""
MECHANICAL_PORTS = {
    "translation": ("LinearMechanicalPort", "force_a", "velocity"),
    "rotation": ("AngularMechanicalPort", "torque_b", "omega_b"),
    "rotation_a": ("AngularMechanicalPort", "torque_a", "omega_a"),
}
"""By name, two groups in the same axes of which one is put in and the other comes out; their product is a power."""


def terminals(d: Description, arrays: bool = False) -> Element:
    """Return terminalsAndIcons.xml; arrays: a variable is a whole block, not one of its numbers."""
    root = Element("fmiTerminalsAndIcons", fmiVersion=TERMINALS_VERSION)
    known, listed = blocks(d, "input", "output"), Element("Terminals")
    for name, (meaning, members) in GROUPS.items():
        terminal = Element("Terminal", name=name, matchingRule="bus", description=meaning)
        for block in (one for one in members if one in known):
            inner = SubElement(terminal, "Terminal", name=block, matchingRule="plug")
            names = {"value": block} if arrays else _members(known[block])
            for member, variable in names.items():
                said = {"variableName": variable, "memberName": member, "variableKind": "signal"}
                SubElement(inner, "TerminalMemberVariable", said)
        listed.extend([terminal] if len(terminal) else [])
    root.extend([listed] if len(listed) else [])
    return root


def _members(variables: list[Variable]) -> dict[str, str]:
    """Return the variables of a block by the names that they have in a terminal."""
    names = QUATERNION if len(variables) == 4 else [v.component or "value" for v in variables]
    return {name: v.name for name, v in zip(names, variables, strict=True)}


def osp_place(d: Description) -> str:
    """Return where it lies in an FMU; its name is the one that libcosim looks for, where every system takes it."""
    prefix = f"{d.scene.name}_" if re.fullmatch(r"[A-Za-z0-9_ .-]+", d.scene.name) else ""
    return f"{OSP_FOLDER}/{prefix}OspModelDescription.xml"


def osp_description(d: Description) -> Element:
    """Return it, with the groups of all inputs and outputs. A group that is part of a port does not stand alone."""
    root = Element("OspModelDescription", xmlns=OSP_NAMESPACE, version="1.0")
    groups, known = SubElement(root, "VariableGroups"), blocks(d, "input", "output")
    ports = {
        name: (kind, both)
        for name, (kind, *both) in MECHANICAL_PORTS.items()
        if known.keys() >= {*both} and known[both[1]][0].causality == "output"
    }
    parts = {block for _, both in ports.values() for block in both}
    groups.extend(_osp_group(block, known[block]) for block in KINDS if block in known and block not in parts)
    for name, (kind, both) in ports.items():
        SubElement(groups, kind, name=name).extend(_osp_group(block, known[block]) for block in both)
    return root


def _osp_group(block: str, variables: list[Variable]) -> Element:
    group = Element(KINDS[block], name=block)
    for k, v in enumerate(variables):
        axis = AXES[k] if len(variables) == 3 else ""
        SubElement(group, "Variable", _said(ref=v.name, unit=unit_of(v), axis=axis))
    return group
