"""FMI 3.0: its modelDescription.xml, and what else its FMUs have of their own."""

from collections.abc import Collection
from dataclasses import replace
from xml.etree.ElementTree import Element, SubElement

from rbfmu_fmu.description import Description, Variable
from rbfmu_fmu.fmi_version import FmiVersion
from rbfmu_fmu.value_references import Referenced, arrays, scalars
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
from rbfmu_kernels.quantities import TIME


def with_arrays(d: Description, token: str, co_simulation: dict[str, str]) -> Element:
    """Return modelDescription.xml with a variable for each quantity."""
    return _model_description(FMI3, d, token, co_simulation)


def with_scalars(d: Description, token: str, co_simulation: dict[str, str]) -> Element:
    """Return modelDescription.xml with a variable for each number."""
    return _model_description(FMI3_SCALARS, d, token, co_simulation)


def _model_description(version: FmiVersion, d: Description, token: str, co: dict[str, str]) -> Element:
    referenced = version.references(d)
    root = Element("fmiModelDescription", {
        "fmiVersion": "3.0", "modelName": d.name, "instantiationToken": token, **about(d),
        "variableNamingConvention": "structured",
    })  # fmt: skip
    SubElement(root, "CoSimulation", {
        "modelIdentifier": d.identifier, "canHandleVariableCommunicationStepSize": "true",
        "canGetAndSetFMUState": "true", "canSerializeFMUState": "true", **co,
    })  # fmt: skip
    root.extend((unit_definitions(d, TIME.unit), *_type_definitions(d), log_categories(), default_experiment(d)))
    variables = SubElement(root, "ModelVariables")
    for reference, one in enumerate(referenced):
        variables.append(_variable(d, one, reference))
    time = {"name": TIME.name, "valueReference": str(len(referenced)), "causality": "independent"}
    SubElement(
        variables, "Float64", time | {"variability": "continuous", "unit": TIME.unit, "description": TIME.meaning}
    )
    updated = {"intermediateUpdate": "true"} if d.interpolates_inputs else {}
    SubElement(variables, "Int32", STATUS | updated | STATUS_RANGE, valueReference=str(version.status_reference(d)))
    root.append(_model_structure(version, d))
    return root


def _type_definitions(d: Description) -> list[Element]:
    """Return the declared types in one element, or none where no variable has a type."""
    definitions = Element("TypeDefinitions")
    for name, attributes in declared_types(d).items():
        SubElement(definitions, "Float64Type", attributes, name=name)
    return [definitions] if len(definitions) else []


def _variable(d: Description, one: Referenced, reference: int) -> Element:
    first = d.variables[one.elements[0]]
    attributes = attributes_of(first, one.name, reference, _meaning(d, one))
    if d.interpolates_inputs and first.causality != "parameter":
        attributes["intermediateUpdate"] = "true"
    if name := declared_type(first):
        attributes["declaredType"] = name
    element = Element("Float64", attributes | _unit_and_limits([d.variables[k] for k in one.elements]))
    for size in one.dimensions:
        SubElement(element, "Dimension", start=str(size))
    return element


def _meaning(d: Description, one: Referenced) -> str:
    """Return what a number is or, of an array, what the quantity is and what its elements are."""
    members = [d.variables[k] for k in one.elements]
    words = "" if len(one.dimensions) == 2 else ", ".join(v.component for v in members)
    return meaning(members[0].block, words)


def _unit_and_limits(members: list[Variable]) -> dict[str, str]:
    """Return what all elements have in common, and their start values; bounds hold for every element alike."""
    lows, highs = [v.minimum for v in members], [v.maximum for v in members]
    low = None if None in lows else min(x for x in lows if x is not None)
    high = None if None in highs else max(x for x in highs if x is not None)
    attributes = unit_and_limits(replace(members[0], minimum=low, maximum=high))
    if members[0].start is not None:
        attributes["start"] = " ".join(repr(v.start) for v in members)
    return attributes


def _model_structure(version: FmiVersion, d: Description) -> Element:
    """Return outputs with what they depend on: without, an importer sees algebraic loops that are not there."""
    structure, referenced = Element("ModelStructure"), version.references(d)
    holder = {k: reference for reference, one in enumerate(referenced) for k in one.elements}
    for kind, depends in (("Output", depends_on), ("InitialUnknown", depends_initially_on)):
        for reference, one in enumerate(referenced):
            first = d.variables[one.elements[0]]
            if first.causality == "output":
                knowns = _listed({holder[k] for k in depends(d, first)})
                SubElement(structure, kind, valueReference=str(reference), dependencies=knowns)
        SubElement(structure, kind, valueReference=str(version.status_reference(d)), dependencies="")
    return structure


def _listed(references: Collection[int]) -> str:
    return " ".join(map(str, sorted(references)))


def capabilities(d: Description) -> dict[str, str]:
    """Return what an FMU can do, as attributes of the element CoSimulation."""
    said = {"providesDirectionalDerivatives": "true", "providesAdjointDerivatives": "true"}
    if d.interpolates_inputs:
        said |= {"providesIntermediateUpdate": "true", "mightReturnEarlyFromDoStep": "true"}
        said |= {"canReturnEarlyAfterIntermediateUpdate": "true"}
    return said | ({"maxOutputDerivativeOrder": "1"} if d.output_rates else {})


FOLDERS = {"linux64": "x86_64-linux", "win64": "x86_64-windows", "linux-aarch64": "aarch64-linux"}
FOLDERS |= {"darwin64": "x86_64-darwin", "darwin-aarch64": "aarch64-darwin"}

_OWN = "instantiationToken", "fmi3.c", FOLDERS, capabilities
_TYPES = "Float64", "Int32", True, "sets them in intermediate updates"
FMI3 = FmiVersion("3.0", with_arrays, *_OWN, arrays, *_TYPES)
FMI3_SCALARS = FmiVersion("3.0 with scalars", with_scalars, *_OWN, scalars, *_TYPES)
"""For importers that take no arrays."""
