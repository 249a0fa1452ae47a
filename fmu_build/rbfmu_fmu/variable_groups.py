"""Groups of variables that belong and connect together, in files beside the model description.

Terminals are FMI 3.0's, and FMI 2.0.4 has them as well. An OspModelDescription is that by which libcosim connects
groups (OSP-IS 1.0.1); it looks for it beside the FMU or the system file, not in the FMU, which has it to be taken out.
"""

import re
from xml.etree.ElementTree import Element, SubElement

from rbfmu_fmu.description import AXES, Description, Variable, blocks
from rbfmu_fmu.model_description import unit_and_limits
from rbfmu_kernels.quantities import PORTS

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
    known, groups = blocks(d, "input", "output"), []
    for name, (meaning, members) in GROUPS.items():
        if found := {block: known[block] for block in members if block in known}:
            groups.append(_terminal(name, meaning, found, arrays))
    if groups:
        SubElement(root, "Terminals").extend(groups)
    return root


def _terminal(name: str, meaning: str, found: dict[str, list[Variable]], arrays: bool) -> Element:
    terminal = Element("Terminal", name=name, matchingRule="bus", description=meaning)
    for block, variables in found.items():
        inner = SubElement(terminal, "Terminal", name=block, matchingRule="plug")
        members = {"value": block} if arrays else _members(variables)
        for member, variable in members.items():
            SubElement(inner, "TerminalMemberVariable", variableName=variable, memberName=member, variableKind="signal")
    return terminal


def _members(variables: list[Variable]) -> dict[str, str]:
    """Return the variables of a block by the names that they have in a terminal."""
    names = QUATERNION if len(variables) == 4 else [v.component or "value" for v in variables]
    return {name: v.name for name, v in zip(names, variables, strict=True)}


def osp_place(d: Description) -> str:
    """Return where it lies in an FMU; its name is the one that libcosim looks for, where every system takes it."""
    prefix = f"{d.name}_" if re.fullmatch(r"[A-Za-z0-9_ .-]+", d.name) else ""
    return f"{OSP_FOLDER}/{prefix}OspModelDescription.xml"


def osp_description(d: Description) -> Element:
    """Return it, with the groups of all inputs and outputs. A group that is part of a port does not stand alone."""
    root = Element("OspModelDescription", xmlns=OSP_NAMESPACE, version="1.0")
    groups, known = SubElement(root, "VariableGroups"), blocks(d, "input", "output")
    ports = {name: port for name, port in MECHANICAL_PORTS.items() if _is_port(known, port[1], port[2])}
    parts = {block for _, *both in ports.values() for block in both}
    groups.extend(_osp_group(block, known[block]) for block in KINDS if block in known and block not in parts)
    for name, (kind, load, rate) in ports.items():
        SubElement(groups, kind, name=name).extend((_osp_group(load, known[load]), _osp_group(rate, known[rate])))
    return root


def _is_port(known: dict[str, list[Variable]], load: str, rate: str) -> bool:
    return load in known and rate in known and known[rate][0].causality == "output"


def _osp_group(block: str, variables: list[Variable]) -> Element:
    group = Element(KINDS[block], name=block)
    for v, axis in zip(variables, AXES if len(variables) == 3 else [None] * len(variables), strict=True):
        named = {"axis": axis} if axis else {}
        SubElement(group, "Variable", {"ref": v.name, "unit": unit_and_limits(v)["unit"], **named})
    return group
