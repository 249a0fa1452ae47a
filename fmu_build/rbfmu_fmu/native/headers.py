"""The C headers that are generated: the rules of calls, and the numbers and names of one scene."""

import json
from collections.abc import Iterable
from itertools import accumulate

from rbfmu_fmu.description import Description
from rbfmu_fmu.fmi_version import FmiVersion
from rbfmu_fmu.native.slopes import slopes_header
from rbfmu_fmu.python.call_rules import CALLS, LOG_CATEGORIES, PHASES, SET_REFUSAL, SETTABLE
from rbfmu_fmu.python.slave_access import HELD, TO_VARY
from rbfmu_kernels.buffer import CHANGED, FAULTS, OK, PAST_STOP, STEP_REJECTED

MAX_DERIVATIVE_ORDER = 2
"""The highest order of a derivative with respect to time that the C layer's table has room for."""


def headers(d: Description, version: FmiVersion, guid: str = "") -> dict[str, str]:
    """Return C sources by file name."""
    return {"call_rules.h": call_rules(), "scene.h": scene_header(d, version, guid), "slopes.h": slopes_header(d)}


def call_rules() -> str:
    """Return C source of call_rules.py."""
    about = "The rules of FMI calls, made from call_rules.py. A set of phases has a bit for each."
    return _header("CALL_RULES_H", about, [
        f"typedef enum {_row([*PHASES, 'PHASES'])} Phase;",
        f"typedef enum {_row(map(str.upper, CALLS))} Call;",
        f"typedef enum {_row(map(str.upper, SETTABLE))} Causality;",
        f"static const char *const PHASE_NAMES[] = {_row(map(_c, PHASES.values()))};",
        *_table("static const struct { unsigned phases; const char *refusal; } RULES[]",
                (f"[{name.upper()}] = {{{_bits(rule.phases)}, {_c(rule.refusal)}}}," for name, rule in CALLS.items())),
        f"#define SET_REFUSAL {_c(SET_REFUSAL)}",
        *_table("static const struct { const char *name; unsigned settable_in; } CAUSALITIES[]",
                (f"[{name.upper()}] = {{{_c(name)}, {_bits(phases)}}}," for name, phases in SETTABLE.items())),
    ])  # fmt: skip


def _header(name: str, about: str, lines: Iterable[str]) -> str:
    return "\n".join([f"/* {about} */", f"#ifndef {name}", f"#define {name}", *lines, "#endif", ""])


def _table(declaration: str, rows: Iterable[str]) -> list[str]:
    return [f"{declaration} = {{", *(f"    {row}" for row in rows), "};"]


def scene_header(d: Description, version: FmiVersion, guid: str) -> str:
    """Return C source of the scene's numbers and names."""
    inputs, parameters = (sum(v.causality == c for v in d.variables) for c in ("input", "parameter"))
    return _header("SCENE_H", "The numbers and names of one scene; places are those in the model's buffer.", [
        f"#define GUID {_c(guid)}",
        f"#define IDENTITY {_c(_IDENTITIES[version.identity])}",
        f"#define REAL {_c(version.real)}",
        f"#define INTEGER {_c(version.integer)}",
        f"#define CATEGORIES {_row([*map(_c, LOG_CATEGORIES), 'NULL'])}",
        f"#define START_TIME {d.scene.run.start.hex()}",
        f"#define LAST_TIME {d.last_time.hex()}",
        f"enum {{ START_PLACE = {d.start_place} }}; /* of the start time in the buffer, if it is there */",
        f"#define ACCURACY {d.scene.run.accuracy.hex()}",
        "#define OUTPUT_DERIVATIVES" if d.output_rates else "/* no output has a derivative */",
        f"enum {{ STEP_OK = {OK}, STEP_REJECTED = {STEP_REJECTED}, PAST_STOP = {PAST_STOP} }}; /* of `status` */",
        f"enum {{ SIZE = {len(d.start_buffer)}, REALS = {len(d.variables)}, CHANGES = {d.outputs_end} }};",
        f"enum {{ FIRST_PARAMETER = {inputs}, FIRST_OUTPUT = {inputs + parameters} }};",
        *_references(d, version),
        f"static const double START[SIZE] = {_row(x.hex() for x in d.start_buffer)};",
        *_variables(d),
        *_refusals(),
    ])  # fmt: skip


_IDENTITIES = {"guid": "guid", "instantiationToken": "instantiation token"}
"""What identifies an FMU, in words."""


def _references(d: Description, version: FmiVersion) -> list[str]:
    """Return the Reals that each value reference stands for, one after another; TIME is in place of a Real."""
    elements = [one.elements for one in version.references(d)]
    if version.has_time:
        elements.append((len(d.variables),))
    first = [0, *accumulate(map(len, elements))]
    time = "REFERENCES - 1" if version.has_time else "REFERENCES + 1 /* there is none */"
    single = "#define ONE_ELEMENT_EACH" if all(len(one) == 1 for one in elements) else "/* there are arrays */"
    return [
        single,
        f"enum {{ TIME = REALS, REFERENCES = {len(elements)}, STATUS_REFERENCE = {version.status_reference(d)} }};",
        f"enum {{ HAS_TIME = {int(version.has_time)}, TIME_REFERENCE = {time}, COUNTS = {len(d.counts)} }};",
        f"static const short COUNT_OFFSETS[COUNTS + 1] = {_row([*(count.offset for count in d.counts), 0])};",
        f"static const char *const COUNT_NAMES[COUNTS + 1] = {_row([*(_c(count.name) for count in d.counts), '0'])};",
        f"static const unsigned short ELEMENTS[] = {_row(k for places in elements for k in places)};",
        f"static const unsigned short FIRST_ELEMENT[] = {_row(first)};",
    ]


def _variables(d: Description) -> list[str]:
    """Return three tables of the Real variables: their places, those of their derivatives, their names."""
    missing = ["NOT_PROVIDED"] * MAX_DERIVATIVE_ORDER
    rates = [(_row([*v.rates, *missing][:MAX_DERIVATIVE_ORDER]), v.name) for v in d.variables]
    said = (f"{_row((_c(v.name), _c(v.block), int(v.pinned)))}," for v in d.variables)
    return [
        *_table("static const short OFFSETS[REALS]", (f"{v.offset}, /* {v.name} */" for v in d.variables)),
        f"enum {{ MAX_DERIVATIVE_ORDER = {MAX_DERIVATIVE_ORDER}, NOT_PROVIDED = -1 }};",
        *_table(
            "static const short DERIVATIVES[REALS][MAX_DERIVATIVE_ORDER]",
            (f"{row}, /* {name} */" for row, name in rates),
        ),
        *_table("static const struct { const char *name, *block; int pinned; } VARIABLES[REALS]", said),
    ]


def _refusals() -> list[str]:
    """Return what is said of parameters that cannot be served."""
    unknown = max(FAULTS) + 1
    faults = FAULTS | {unknown: ("", "initialisation failed")}
    return [
        f"#define PINNED {_c(HELD)}",
        f"#define TO_VARY {_c(TO_VARY)}",
        f"#define CHANGED {_c(CHANGED)} /* as a fault's block: all parameters that were changed */",
        f"enum {{ NO_FAULT = 0, UNKNOWN_FAULT = {unknown} }};",
        "typedef struct { const char *block, *expected; } Fault;",
        *_table("static const Fault FAULTS[]", (f"[{code}] = {_row(map(_c, x))}," for code, x in faults.items())),
    ]


def _bits(phases: Iterable[int]) -> str:
    """Return a set of phases as C."""
    names = list(PHASES)
    return " | ".join(f"1 << {names[k]}" for k in phases) or "0"


def _row(items: Iterable[object]) -> str:
    return f"{{{', '.join(map(str, items))}}}"


def _c(text: str) -> str:
    """Return a C string of plain ASCII."""
    assert text.isascii(), text
    return json.dumps(text)
