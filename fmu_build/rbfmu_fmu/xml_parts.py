"""What the modelDescription.xml of every version of FMI has in common: units, log categories, limits, dependencies."""

from xml.etree.ElementTree import Element, SubElement

from rbfmu_fmu.description import Description, Variable
from rbfmu_kernels.quantities import BY_NAME, OUTPUT, UNITS

LOG_CATEGORIES = ("logStatusWarning", "logStatusDiscard", "logStatusError", "logStatusFatal", "logAll")
STATUS_MEANING = (
    "0: fine; 1: the last step was refused or missed the accuracy; 2: past the stop time, accuracy not promised"
)


def unit_definitions(d: Description) -> Element:
    """Return the units of all variables."""
    definitions = Element("UnitDefinitions")
    for name in sorted({BY_NAME[v.block].unit for v in d.variables}):
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
    for category in LOG_CATEGORIES:
        SubElement(categories, "Category", name=category)
    return categories


def default_experiment(d: Description) -> Element:
    """Return the times of the scene's run."""
    return Element("DefaultExperiment", startTime=repr(d.start), stopTime=repr(d.stop), stepSize=repr(d.step))


def unit_and_limits(v: Variable) -> dict[str, str]:
    """Return the attributes unit, displayUnit, min, max and start, as far as a variable has them."""
    unit = BY_NAME[v.block].unit
    attributes = {"unit": _fmi_name(unit)}
    if UNITS[unit].display:
        attributes["displayUnit"] = UNITS[unit].display[0][0]
    for key, value in (("min", v.minimum), ("max", v.maximum), ("start", v.start)):
        if value is not None:
            attributes[key] = repr(value)
    return attributes


def depends_on(d: Description, output: Variable) -> list[int]:
    """Return the inputs, by their number among the variables, that an output follows at once."""
    feedthrough = OUTPUT[output.block].feedthrough
    return [k for k, v in enumerate(d.variables) if v.causality == "input" and v.block in feedthrough]


def depends_initially_on(d: Description, output: Variable) -> list[int]:
    """Return the inputs and parameters, by their number, that an output depends on at the start."""
    row = OUTPUT[output.block]
    first = {*row.initially, *row.feedthrough}
    return [k for k, v in enumerate(d.variables) if v.causality != "output" and v.block in first]
