"""The OspModelDescription of an FMU, by which libcosim connects groups of variables (OSP-IS 1.0.1).

libcosim looks for it beside the FMU or the system file, not in the FMU, which has it to be taken out.
"""

import re
from xml.etree.ElementTree import Element, SubElement

from rbfmu_fmu.description import Description, Variable, blocks
from rbfmu_fmu.variable_words import AXES
from rbfmu_fmu.xml_parts import unit_and_limits

NAMESPACE = "https://open-simulation-platform.com/OspModelDescription/1.0.1"
FOLDER = "extra/com.open-simulation-platform"

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


def osp_place(d: Description) -> str:
    """Return where it lies in an FMU; its name is the one that libcosim looks for, where every system takes it."""
    prefix = f"{d.name}_" if re.fullmatch(r"[A-Za-z0-9_ .-]+", d.name) else ""
    return f"{FOLDER}/{prefix}OspModelDescription.xml"


def osp_description(d: Description) -> Element:
    """Return it, with the groups of all inputs and outputs. A group that is part of a port does not stand alone."""
    root = Element("OspModelDescription", xmlns=NAMESPACE, version="1.0")
    groups, known = SubElement(root, "VariableGroups"), blocks(d, "input", "output")
    ports = {name: port for name, port in MECHANICAL_PORTS.items() if _is_port(known, port[1], port[2])}
    parts = {block for _, *both in ports.values() for block in both}
    groups.extend(_group(block, known[block]) for block in KINDS if block in known and block not in parts)
    for name, (kind, load, rate) in ports.items():
        SubElement(groups, kind, name=name).extend((_group(load, known[load]), _group(rate, known[rate])))
    return root


def _is_port(known: dict[str, list[Variable]], load: str, rate: str) -> bool:
    return load in known and rate in known and known[rate][0].causality == "output"


def _group(block: str, variables: list[Variable]) -> Element:
    group = Element(KINDS[block], name=block)
    for v, axis in zip(variables, AXES if len(variables) == 3 else [None] * len(variables), strict=True):
        named = {"axis": axis} if axis else {}
        SubElement(group, "Variable", {"ref": v.name, "unit": unit_and_limits(v)["unit"], **named})
    return group
