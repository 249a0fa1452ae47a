"""What the modelDescription.xml of every version of FMI has in common: units, log categories, limits, dependencies."""

from xml.etree.ElementTree import Element, SubElement

import rbfmu
from rbfmu_fmu.description import Description, Variable
from rbfmu_fmu.python.call_rules import LOG_CATEGORIES
from rbfmu_fmu.python.slave_access import TO_VARY
from rbfmu_fmu.variable_words import QUANTITIES
from rbfmu_kernels.quantities import BY_NAME, OUTPUT, UNITS

LICENSE = "MIT; see documentation/licenses"
"""The terms of the code in an FMU, which a scene's own stand beside."""
_KINDS = {"input": ("continuous", None), "parameter": ("fixed", "exact"), "output": ("continuous", "calculated")}
"""By causality: variability and initial."""
STATUS_MEANING = (
    "0: fine; 1: the last step was refused or missed the accuracy; 2: past the stop time, accuracy not promised"
)
STATUS = {"name": "status", "causality": "output", "variability": "discrete", "initial": "calculated"}
STATUS |= {"description": STATUS_MEANING}
STATUS_RANGE = {"min": "0", "max": "2"}


def about(d: Description) -> dict[str, str]:
    """Return the attributes that say what the FMU is, and by whom, as far as they are known."""
    said = {"generationTool": f"rbfmu {rbfmu.__version__}", "description": "One rigid body", "license": LICENSE}
    return said | {key: text for key, text in d.about.items() if text}


def declared_types(d: Description) -> dict[str, dict[str, str]]:
    """Return the types of the variables by name: quantity, unit and the unit in which it is usually shown."""
    units = {BY_NAME[v.block].unit for v in d.variables}
    return {QUANTITIES[unit]: _of_unit(unit) for unit in sorted(units, key=_fmi_name) if unit in QUANTITIES}


def declared_type(v: Variable) -> str | None:
    """Return the name of a variable's type, if it has one."""
    return QUANTITIES.get(BY_NAME[v.block].unit)


def _of_unit(unit: str) -> dict[str, str]:
    """Return the attributes quantity, unit and displayUnit, as far as there are any."""
    attributes = {"quantity": QUANTITIES[unit]} if unit in QUANTITIES else {}
    attributes["unit"] = _fmi_name(unit)
    if UNITS[unit].display:
        attributes["displayUnit"] = UNITS[unit].display[0][0]
    return attributes


def unit_definitions(d: Description, *more: str) -> Element:
    """Return the units of all variables, and more."""
    definitions = Element("UnitDefinitions")
    for name in sorted({*more, *(BY_NAME[v.block].unit for v in d.variables)}):
        definitions.append(_unit(name))
    return definitions


def _unit(name: str) -> Element:
    """Return a unit with FMI's exponents of the base units, and the units in which a tool may show it."""
    element, unit = Element("Unit", name=_fmi_name(name)), UNITS[name]
    SubElement(element, "BaseUnit", {base: str(exponent) for base, exponent in unit.exponents.items()})
    for display, factor in unit.display:
        SubElement(element, "DisplayUnit", name=display, factor=repr(factor))
    return element


def _fmi_name(unit: str) -> str:
    return unit.replace(" ", ".")


def log_categories() -> Element:
    """Return the categories of messages."""
    categories = Element("LogCategories")
    for category, says in LOG_CATEGORIES.items():
        SubElement(categories, "Category", name=category, description=says)
    return categories


def default_experiment(d: Description) -> Element:
    """Return the times and the accuracy of the scene's run."""
    times = {"startTime": d.start, "stopTime": d.stop, "tolerance": d.accuracy, "stepSize": d.step}
    return Element("DefaultExperiment", {name: repr(value) for name, value in times.items()})


def attributes_of(v: Variable, name: str, reference: int, description: str) -> dict[str, str]:
    """Return what a variable of any version is said to be; of a parameter that cannot be set, also that."""
    variability, initial = _KINDS[v.causality]
    if v.pinned:
        description = f"{description}; cannot be changed here: {TO_VARY % v.block}"
    said = {"name": name, "valueReference": str(reference), "causality": v.causality, "variability": variability}
    return said | {"description": description} | ({"initial": initial} if initial else {})


def unit_and_limits(v: Variable) -> dict[str, str]:
    """Return the attributes quantity, unit, displayUnit, min, max, nominal and start, as far as a variable has them."""
    attributes = _of_unit(BY_NAME[v.block].unit)
    for key, value in (("min", v.minimum), ("max", v.maximum), ("nominal", v.nominal), ("start", v.start)):
        if value is not None:
            attributes[key] = repr(value)
    return attributes


def depends_on(d: Description, output: Variable) -> list[int]:
    """Return the inputs, by their number among the variables, that an output follows at once."""
    feedthrough = _feedthrough(d, output)
    return [k for k, v in enumerate(d.variables) if v.causality == "input" and v.block in feedthrough]


def depends_initially_on(d: Description, output: Variable) -> list[int]:
    """Return the inputs and parameters, by their number, that an output depends on at the start."""
    first = {*OUTPUT[output.block].initially, *_feedthrough(d, output)}
    return [k for k, v in enumerate(d.variables) if v.causality != "output" and v.block in first]


def _feedthrough(d: Description, output: Variable) -> set[str]:
    """Return the inputs, by their blocks, that an output follows at once in this body."""
    return {*OUTPUT[output.block].feedthrough}.difference(d.without_effect.get(output.block, ()))
