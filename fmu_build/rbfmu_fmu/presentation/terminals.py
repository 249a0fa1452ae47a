"""Terminals of FMI 3.0, which FMI 2.0.4 has as well: groups of variables that belong together and connect together."""

from xml.etree.ElementTree import Element, SubElement

from rbfmu_fmu.description import Description, Variable, blocks
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
FMI_VERSION = "3.0"
"""The version of FMI that defines the file, also in an FMU of another version."""


def terminals(d: Description, arrays: bool = False) -> Element:
    """Return terminalsAndIcons.xml; arrays: a variable is a whole block, not one of its numbers."""
    root = Element("fmiTerminalsAndIcons", fmiVersion=FMI_VERSION)
    known, groups = blocks(d, "input", "output"), []
    for name, (meaning, members) in GROUPS.items():
        if found := {block: known[block] for block in members if block in known}:
            groups.append(_group(name, meaning, found, arrays))
    if groups:
        SubElement(root, "Terminals").extend(groups)
    return root


def _group(name: str, meaning: str, found: dict[str, list[Variable]], arrays: bool) -> Element:
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
