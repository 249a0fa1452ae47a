"""FMI 2.0: its modelDescription.xml, and what else its FMUs have of their own."""

from xml.etree.ElementTree import Element, SubElement

from rbfmu_fmu.description import Description, Variable
from rbfmu_fmu.fmi_version import FmiVersion
from rbfmu_fmu.value_references import scalars
from rbfmu_fmu.variable_words import meaning
from rbfmu_fmu.xml_parts import (
    STATUS,
    STATUS_RANGE,
    about,
    attributes_of,
    declared_type,
    declared_types,
    default_experiment,
    depends_initially_on,
    depends_on,
    log_categories,
    unit_and_limits,
    unit_definitions,
)


def model_description(d: Description, guid: str, co_simulation: dict[str, str]) -> Element:
    """Return modelDescription.xml; `co_simulation` holds the attributes in which kinds of FMU differ."""
    root = Element("fmiModelDescription", {
        "fmiVersion": "2.0", "modelName": d.name, "guid": guid, **about(d), "variableNamingConvention": "structured",
    })  # fmt: skip
    SubElement(root, "CoSimulation", {
        "modelIdentifier": d.identifier, "canHandleVariableCommunicationStepSize": "true",
        "canGetAndSetFMUstate": "true", "canSerializeFMUstate": "true",
        "canBeInstantiatedOnlyOncePerProcess": "false", **co_simulation,
    })  # fmt: skip
    root.extend((unit_definitions(d), *_type_definitions(d), log_categories(), default_experiment(d)))
    variables = SubElement(root, "ModelVariables")
    for reference, v in enumerate(d.variables):
        variables.append(_scalar_variable(v, reference))
    status = SubElement(variables, "ScalarVariable", STATUS, valueReference=str(FMI2.status_reference(d)))
    SubElement(status, "Integer", STATUS_RANGE)
    root.append(_model_structure(d))
    return root


def _type_definitions(d: Description) -> list[Element]:
    """Return the declared types in one element, or none where no variable has a type."""
    definitions = Element("TypeDefinitions")
    for name, attributes in declared_types(d).items():
        SubElement(SubElement(definitions, "SimpleType", name=name), "Real", attributes)
    return [definitions] if len(definitions) else []


def _scalar_variable(v: Variable, reference: int) -> Element:
    said = meaning(v.block, v.component)
    element = Element("ScalarVariable", attributes_of(v, v.name, reference, said))
    declared = {"declaredType": name} if (name := declared_type(v)) else {}
    SubElement(element, "Real", declared | unit_and_limits(v))
    return element


def _model_structure(d: Description) -> Element:
    """Return outputs with what they depend on: without, an importer sees algebraic loops that are not there."""
    structure = Element("ModelStructure")
    outputs, unknowns = SubElement(structure, "Outputs"), SubElement(structure, "InitialUnknowns")
    for index, v in enumerate(d.variables, start=1):
        if v.causality == "output":
            SubElement(outputs, "Unknown", index=str(index), dependencies=_indices(depends_on(d, v)))
            SubElement(unknowns, "Unknown", index=str(index), dependencies=_indices(depends_initially_on(d, v)))
    for element in (outputs, unknowns):
        SubElement(element, "Unknown", index=str(FMI2.status_reference(d) + 1), dependencies="")
    return structure


def _indices(numbers: list[int]) -> str:
    """Return places in the list of variables, which count from 1."""
    return " ".join(str(k + 1) for k in numbers)


FOLDERS = {"linux64": "linux64", "win64": "win64", "linux-aarch64": "aarch64-linux"}
FOLDERS |= {"darwin64": "darwin64", "darwin-aarch64": "darwin64"}
"""FMI 2.0 has one folder for macOS and none for Linux on aarch64: the first takes both processors in one file, the
second has the name that FMI 3.0 gave it, as FMI 2.0.5 says."""
SECOND_FOLDERS = {"linux-aarch64": "linux64"}
"""FMPy, for one, looks into this folder on any Linux."""


def capabilities(d: Description) -> dict[str, str]:
    """Return what a native FMU can do, as attributes of the element CoSimulation."""
    said = {"needsExecutionTool": "false", "canNotUseMemoryManagementFunctions": "false"}
    said |= {"canInterpolateInputs": "true" if d.interpolates_inputs else "false"}
    said |= {"providesDirectionalDerivative": "true"}
    return said | ({"maxOutputDerivativeOrder": "1"} if d.output_rates else {})


_OWN = "guid", "fmi2.c", FOLDERS, capabilities
_COURSE = "gives their derivatives with respect to time"
FMI2 = FmiVersion(
    "2.0", model_description, *_OWN, scalars, "Real", "Integer", False, _COURSE, SECOND_FOLDERS, "model.png"
)
