"""modelDescription.xml for any version of FMI; the differences between versions are in a table with a row for each.

Attributes have a fixed order, so that the same scene gives the same bytes. A version's C functions are in the file that
its row names.
"""

import tomllib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement, indent, tostring

import rbfmu
from rbfmu_fmu.description import Count, Description, FmiVariable, Variable, arrays, scalars
from rbfmu_fmu.python import call_rules, slave_access
from rbfmu_kernels.quantities import TIME, UNITS, Unit


@dataclass(frozen=True)
class FmiVersion:
    """One version of FMI, a table of `fmi_versions.toml`; `VERSIONS` lists all."""

    name: str
    """The attribute fmiVersion of modelDescription.xml."""
    identity: str
    """The attribute of modelDescription.xml that identifies an FMU."""
    signatures: str
    """The C source of the version's functions, in `native/`."""
    folders: dict[str, str]
    """The folder of `binaries` for each of `native.platforms.PLATFORMS`."""
    second_folders: dict[str, str]
    """Another folder for a platform, in which some importers look; used if no other platform of the FMU has it."""
    icon: str
    """The place of an FMU's picture."""
    abilities: dict[str, str]
    """What FMUs of either kind can do, as attributes of the element CoSimulation."""
    native_abilities: dict[str, str]
    """The additional abilities of native FMUs."""
    python_abilities: dict[str, str]
    """The additional abilities of FMUs of the pythonfmu kind, if the version has that kind."""
    with_input_rates: dict[str, str]
    """The further abilities of native FMUs all of whose inputs may change within a step."""
    has_arrays: bool
    """Whether a quantity is one variable; without arrays each of its numbers is one."""
    real: str
    """The version's name for the type of floating-point variables."""
    integer: str
    """The version's name for the type of `status`."""
    has_time: bool
    """Whether the time is a variable; it then comes after the variables of `references`."""
    course_of_inputs: str
    """How an importer sets inputs that change within a step, in words."""
    nested: bool
    """True for FMI 2: a variable's element contains another for its type, and the model structure has lists that count
    variables from 1. False for FMI 3: the element has the name of the type, and value references are used."""

    def references(self, d: Description) -> list[FmiVariable]:
        """Return the variables in the order of their value references."""
        return arrays(d) if self.has_arrays else scalars(d)

    def abilities_of(self, d: Description) -> dict[str, str]:
        """Return the abilities of a native FMU besides those of both kinds, as attributes of CoSimulation."""
        abilities = self.native_abilities | (self.with_input_rates if d.interpolates_inputs else {})
        return abilities | ({"maxOutputDerivativeOrder": "1"} if d.output_rates else {})

    def status_reference(self, d: Description) -> int:
        """Return the value reference of the integer output `status`, which follows those of all Reals."""
        return len(self.references(d)) + self.has_time

    def counts(self, d: Description) -> list[tuple[int, Count]]:
        """Return (value reference, count) for the counts of events; these references are the last."""
        return [*enumerate(d.counts, self.status_reference(d) + 1)]


_ROWS = tomllib.loads(Path(__file__).with_name("fmi_versions.toml").read_text(encoding="utf-8"))
VERSIONS = {(int(fmi), False): FmiVersion(**row) for fmi, row in _ROWS.items()}
VERSIONS |= {(fmi, True): replace(v, has_arrays=False) for (fmi, _), v in VERSIONS.items() if v.has_arrays}
"""The versions for which FMUs are built, by (version of FMI, whether it is without the arrays that it allows)."""
FMI2, FMI3 = VERSIONS[2, False], VERSIONS[3, False]


def version_of(fmi: int, scalars: bool) -> FmiVersion:
    """Return a version of FMI; scalars: without arrays, though it has them. Raises ValueError if there is none."""
    if not isinstance(fmi, int) or fmi not in (2, 3):
        raise ValueError(f"fmi = {fmi!r}: expected 2 or 3")
    if (fmi, scalars) not in VERSIONS:
        expected = "True or False" if fmi == 3 else "fmi = 3 with it, as FMI 2 has no arrays"
        raise ValueError(f"scalars = {scalars!r}: expected {expected}")
    return VERSIONS[fmi, scalars]


# --- the file

LICENSE = "MIT; see documentation/licenses"
"""The licence of the code in an FMU, used if the scene does not give its own."""
_KINDS = {"input": ("continuous", ""), "parameter": ("fixed", "exact"), "output": ("continuous", "calculated")}
"""The attributes (variability, initial) by causality."""
STATUS = {"name": "status", "causality": "output", "variability": "discrete", "initial": "calculated"}
STATUS["description"] = (
    "0: fine; 1: the last step was refused or missed the accuracy; 2: past the stop time, accuracy not promised"
)
STATUS_RANGE = {"min": "0", "max": "2"}
UNSET = "{}"
"""The placeholder for an FMU's identity while that is computed."""


def model_description(version: FmiVersion, d: Description, co_simulation: dict[str, str]) -> Element:
    """Return modelDescription.xml without identity; co_simulation: the attributes in which kinds of FMU differ."""
    about = {"generationTool": f"rbfmu {rbfmu.__version__}", "description": "One rigid body", "license": LICENSE}
    about |= without_blanks(**d.scene.about.table())
    root = Element("fmiModelDescription", {
        "fmiVersion": version.name, "modelName": d.scene.name, version.identity: UNSET, **about,
        "variableNamingConvention": "structured",
    })  # fmt: skip
    SubElement(root, "CoSimulation", {
        "modelIdentifier": d.identifier, "canHandleVariableCommunicationStepSize": "true", **version.abilities,
        **co_simulation,
    })  # fmt: skip
    root.append(_unit_definitions(_units(d) | ({fmi_name(TIME.unit)} if version.has_time else set())))
    root.extend(_type_definitions(version, d))
    categories = (Element("Category", name=name, description=says) for name, says in call_rules.LOG_CATEGORIES.items())
    SubElement(root, "LogCategories").extend(categories)
    run = {"startTime": "start", "stopTime": "stop", "tolerance": "accuracy", "stepSize": "step"}
    SubElement(root, "DefaultExperiment", {name: repr(getattr(d.scene.run, key)) for name, key in run.items()})
    SubElement(root, "ModelVariables").extend(_variables(version, d))
    root.append(_model_structure(version, d))
    return root


def without_blanks(**attributes: str) -> dict[str, str]:
    """Return attributes in their order, without those whose text is empty."""
    return {name: text for name, text in attributes.items() if text}


def _element(version: FmiVersion, outer: str, kind: str, own: dict[str, str], of_type: dict[str, str]) -> Element:
    """Return an element with attributes of a thing and of its type: in FMI 2 two nested elements, in FMI 3 one."""
    if not version.nested:
        return Element(kind, own | of_type)
    element = Element(outer, own)
    SubElement(element, kind, of_type)
    return element


def _type_definitions(version: FmiVersion, d: Description) -> list[Element]:
    """Return the element of all declared types in a list, which is empty if no variable has one."""
    definitions, kind = Element("TypeDefinitions"), version.real if version.nested else f"{version.real}Type"
    for unit in sorted(_units(d)):
        if name := _unit(unit).quantity:
            definitions.append(_element(version, "SimpleType", kind, {}, _of_unit(unit)))
            definitions[-1].set("name", name)
    return [definitions] if len(definitions) else []


def _variables(version: FmiVersion, d: Description) -> Iterator[Element]:
    """Yield all variables in the order of their value references."""
    named = version.references(d)
    updated = without_blanks(intermediateUpdate="true" if d.interpolates_inputs and not version.nested else "")
    for reference, variable in enumerate(named):
        members = [d.variables[k] for k in variable.elements]
        first = members[0]
        variability, initial = _KINDS[first.causality]
        words = "" if len(variable.dimensions) == 2 else ", ".join(v.component for v in members)
        meaning = f"{first.meaning}: {words}" if words else first.meaning
        if first.pinned:
            meaning += f"; cannot be changed here: {slave_access.TO_VARY % first.block}"
        attributes = {"name": variable.name, "valueReference": str(reference), "causality": first.causality}
        attributes |= without_blanks(variability=variability, description=meaning, initial=initial)
        attributes |= updated if first.causality != "parameter" else {}
        type_attributes = without_blanks(declaredType=_unit(first.unit).quantity) | _limits_of_all(members)
        element = _element(version, "ScalarVariable", version.real, attributes, type_attributes)
        element.extend(Element("Dimension", start=str(size)) for size in variable.dimensions)
        yield element
    if version.has_time:
        time = {"name": TIME.name, "valueReference": str(len(named)), "causality": "independent"}
        time |= {"variability": "continuous", "unit": TIME.unit, "description": TIME.meaning}
        yield Element(version.real, time)
    counts = [(r, {"name": count.name, "description": count.meaning}, {"min": "0"}) for r, count in version.counts(d)]
    for reference, differs, limits in [(version.status_reference(d), {}, STATUS_RANGE), *counts]:
        element = _element(version, "ScalarVariable", version.integer, STATUS | updated | differs, limits)
        element.set("valueReference", str(reference))
        yield element


def _limits_of_all(members: list[Variable]) -> dict[str, str]:
    """Return unit, bounds, nominal and start as far as there are any; bounds are the widest of all elements."""
    first = members[0]
    lows, highs = ([getattr(v, key) for v in members] for key in ("minimum", "maximum"))
    limits = {"min": None if None in lows else min(lows), "max": None if None in highs else max(highs)}
    limits["nominal"] = first.nominal
    attributes = _of_unit(first.unit) | {key: repr(x) for key, x in limits.items() if x is not None}
    return attributes | ({"start": " ".join(repr(v.start) for v in members)} if first.start is not None else {})


def _model_structure(version: FmiVersion, d: Description) -> Element:
    """Return the element ModelStructure: the outputs, with the variables on which they depend."""
    structure, named = Element("ModelStructure"), version.references(d)
    holder = {k: reference for reference, variable in enumerate(named) for k in variable.elements}
    outputs = {holder[k]: v for k, v in enumerate(d.variables) if v.causality == "output"}
    key, begin = ("index", 1) if version.nested else ("valueReference", 0)
    time = {len(named)} if version.has_time else set()
    for name, depends in (("Output", depends_on), ("InitialUnknown", depends_initially_on)):
        known: dict[int, Iterable[int]] = {
            r: {holder[k] for k in depends(d, output)} | (time if TIME.name in output.follows else set())
            for r, output in outputs.items()
        }
        known |= dict.fromkeys((version.status_reference(d), *(reference for reference, _ in version.counts(d))), ())
        unknowns = SubElement(structure, f"{name}s") if version.nested else structure
        for reference, others in known.items():
            listed = " ".join(str(k + begin) for k in sorted(others))
            kind = "Unknown" if version.nested else name
            SubElement(unknowns, kind, {key: str(reference + begin), "dependencies": listed})
    return structure


def _units(d: Description) -> set[str]:
    """Return the names of all units in FMI; a scene may write N m or N.m for the same unit."""
    return {fmi_name(v.unit) for v in d.variables}


def _unit(name: str) -> Unit:
    """Return what is known about a unit; a unit that only a scene names has nothing but its name."""
    return _KNOWN_UNITS.get(fmi_name(name), Unit("", {}))


def _unit_definitions(names: set[str]) -> Element:
    """Return the element of units, with their exponents of base units, and the units in which a tool may show them."""
    definitions = Element("UnitDefinitions")
    for name in sorted(names):
        element, unit = SubElement(definitions, "Unit", name=name), _unit(name)
        if name in _KNOWN_UNITS:
            SubElement(element, "BaseUnit", {base: str(exponent) for base, exponent in unit.exponents.items()})
        for display, factor in unit.display:
            SubElement(element, "DisplayUnit", name=display, factor=repr(factor))
    return definitions


def _of_unit(name: str) -> dict[str, str]:
    """Return the attributes quantity, unit and displayUnit of a unit, as far as it has them."""
    unit = _unit(name)
    display = unit.display[0][0] if unit.display else ""
    return without_blanks(quantity=unit.quantity, unit=fmi_name(name), displayUnit=display)


def fmi_name(unit: str) -> str:
    """Return the name of a unit in FMI."""
    return unit.replace(" ", ".")


_KNOWN_UNITS = {fmi_name(name): unit for name, unit in UNITS.items()}


def depends_on(d: Description, output: Variable) -> list[int]:
    """Return the inputs that change an output at once, as positions in `d.variables`."""
    return [k for k, v in enumerate(d.variables) if v.causality == "input" and v.block in output.follows]


def depends_initially_on(d: Description, output: Variable) -> list[int]:
    """Return the inputs and parameters on which an output depends at the start, as positions in `d.variables`."""
    return [k for k, v in enumerate(d.variables) if v.causality != "output" and v.block in output.begins_with]


def xml_bytes(xml: Element) -> bytes:
    """Return XML as the bytes of a file."""
    indent(xml)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{tostring(xml, "unicode")}\n'.encode()
