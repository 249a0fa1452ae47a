"""The modelDescription.xml of FMI 2.0."""

from xml.etree.ElementTree import Element, SubElement

from rbfmu_fmu.description import Description, Variable
from rbfmu_kernels.quantities import BY_NAME, OUTPUT, UNITS

LOG_CATEGORIES = ("logStatusWarning", "logStatusDiscard", "logStatusError", "logStatusFatal", "logAll")


def model_description(d: Description, guid: str, co_simulation: dict[str, str]) -> Element:
    """Return modelDescription.xml; `co_simulation` holds the attributes in which kinds of FMU differ."""
    root = Element("fmiModelDescription", {
        "fmiVersion": "2.0", "modelName": d.name, "guid": guid, "generationTool": "rbfmu",
        "description": "One rigid body", "variableNamingConvention": "structured",
    })  # fmt: skip
    SubElement(root, "CoSimulation", {
        "modelIdentifier": d.identifier, "canHandleVariableCommunicationStepSize": "true",
        "canGetAndSetFMUstate": "true", "canSerializeFMUstate": "true",
        "canBeInstantiatedOnlyOncePerProcess": "false", **co_simulation,
    })  # fmt: skip
    definitions = SubElement(root, "UnitDefinitions")
    for name in sorted({BY_NAME[v.block].unit for v in d.variables}):
        definitions.append(_unit(name))
    categories = SubElement(root, "LogCategories")
    for category in LOG_CATEGORIES:
        SubElement(categories, "Category", name=category)
    SubElement(root, "DefaultExperiment", startTime=repr(d.start), stopTime=repr(d.stop), stepSize=repr(d.step))
    variables = SubElement(root, "ModelVariables")
    for reference, v in enumerate(d.variables):
        variables.append(_scalar_variable(v, reference))
    status = {"name": "status", "valueReference": str(d.status_reference), "causality": "output"}
    text = "0: fine; 1: the last step was refused or missed the accuracy; 2: past the stop time, accuracy not promised"
    status |= {"variability": "discrete", "initial": "calculated", "description": text}
    SubElement(SubElement(variables, "ScalarVariable", status), "Integer", min="0", max="2")
    root.append(_model_structure(d))
    return root


def _unit(name: str) -> Element:
    """Return a unit with FMI's exponents of the base units, and the units in which a tool may show it."""
    element, unit = Element("Unit", name=_fmi_name(name)), UNITS[name]
    SubElement(element, "BaseUnit", {base: str(exponent) for base, exponent in unit.exponents.items()})
    for display, factor in unit.display:
        SubElement(element, "DisplayUnit", name=display, factor=repr(factor))
    return element


def _fmi_name(unit: str) -> str:
    return unit.replace(" ", ".")


def _scalar_variable(v: Variable, reference: int) -> Element:
    variability, initial = {
        "input": ("continuous", None),
        "parameter": ("fixed", "exact"),
        "output": ("continuous", "calculated"),
    }[v.causality]
    attributes = {"name": v.name, "valueReference": str(reference), "causality": v.causality}
    attributes |= {"variability": variability, "description": BY_NAME[v.block].meaning}
    if initial:
        attributes["initial"] = initial
    element = Element("ScalarVariable", attributes)
    unit = BY_NAME[v.block].unit
    real = {"unit": _fmi_name(unit)}
    if UNITS[unit].display:
        real["displayUnit"] = UNITS[unit].display[0][0]
    for key, value in (("min", v.minimum), ("max", v.maximum), ("start", v.start)):
        if value is not None:
            real[key] = repr(value)
    SubElement(element, "Real", real)
    return element


def _model_structure(d: Description) -> Element:
    """Return outputs with what they depend on: without, an importer sees algebraic loops that are not there."""
    structure = Element("ModelStructure")
    outputs, unknowns = SubElement(structure, "Outputs"), SubElement(structure, "InitialUnknowns")
    for index, v in enumerate(d.variables, start=1):
        if v.causality == "output":
            row = OUTPUT[v.block]
            on = [k for k, u in enumerate(d.variables, 1) if u.causality == "input" and u.block in row.feedthrough]
            SubElement(outputs, "Unknown", index=str(index), dependencies=" ".join(map(str, on)))
            first = {*row.initially, *row.feedthrough}
            on = [k for k, u in enumerate(d.variables, 1) if u.causality != "output" and u.block in first]
            SubElement(unknowns, "Unknown", index=str(index), dependencies=" ".join(map(str, on)))
    for element in (outputs, unknowns):
        SubElement(element, "Unknown", index=str(d.status_reference + 1), dependencies="")
    return structure
