"""The C headers that are generated: the rules of calls; of a scene numbers, names, and derivatives at the start."""

import json
from collections.abc import Collection, Iterable, Mapping, Sequence
from itertools import accumulate

import numpy as np

from rbfmu import Scene
from rbfmu.formulas import source
from rbfmu.formulas.graph import LEAVES, Graph, Number, arctangent, changes_of, square_root
from rbfmu.formulas.motion import CHANGE, MADE, STATE, Start, rotation_of
from rbfmu.models import formulas, model_buffer
from rbfmu_fmu.description import Description
from rbfmu_fmu.model_description import FmiVersion
from rbfmu_fmu.python import slave_access
from rbfmu_fmu.python.call_rules import CALLS, LOG_CATEGORIES, PHASES, SET_REFUSAL, SETTABLE
from rbfmu_kernels.buffer import CHANGED, FAULTS, OK, PAST_STOP, STEP_REJECTED
from rbfmu_kernels.quantities import elements

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
    rates = (f"{_row([*v.rates, *missing][:MAX_DERIVATIVE_ORDER])}, /* {v.name} */" for v in d.variables)
    said = (f"{_row((_c(v.name), _c(v.block), int(v.pinned)))}," for v in d.variables)
    return [
        *_table("static const short OFFSETS[REALS]", (f"{v.offset}, /* {v.name} */" for v in d.variables)),
        f"enum {{ MAX_DERIVATIVE_ORDER = {MAX_DERIVATIVE_ORDER}, NOT_PROVIDED = -1 }};",
        *_table("static const short DERIVATIVES[REALS][MAX_DERIVATIVE_ORDER]", rates),
        *_table("static const struct { const char *name, *block; int pinned; } VARIABLES[REALS]", said),
    ]


def _refusals() -> list[str]:
    """Return what is said of parameters that cannot be served."""
    unknown = max(FAULTS) + 1
    faults = FAULTS | {unknown: ("", "initialisation failed")}
    return [
        f"#define PINNED {_c(slave_access.HELD)}",
        f"#define TO_VARY {_c(slave_access.TO_VARY)}",
        f"#define CHANGED {_c(CHANGED)} /* as a fault's block: all parameters that were changed */",
        f"enum {{ NO_FAULT = 0, UNKNOWN_FAULT = {unknown} }};",
        "typedef struct { const char *block, *expected; } Fault;",
        *_table("static const Fault FAULTS[]", (f"[{code}] = {_row(map(_c, x))}," for code, x in faults.items())),
    ]


def _bits(phases: Iterable[int]) -> str:
    """Return a set of phases as C."""
    return " | ".join(f"1 << {[*PHASES][k]}" for k in phases) or "0"


def _row(items: Iterable[object]) -> str:
    return f"{{{', '.join(map(str, items))}}}"


def _c(text: str) -> str:
    """Return a C string of plain ASCII."""
    assert text.isascii(), text
    return json.dumps(text)


# --- derivatives of outputs by parameters in Initialization Mode

Shown = Mapping[str, Sequence[Number]]
_IN_C = {kind: text.replace("math.", "") for kind, text in source.VALUES.items()} | {
    "sin": "sin({})", "cos": "cos({})", "exp": "exp({})", "log": "log({})", "power": "pow({}, {})",
    "logistic": "1.0 / (1.0 + exp(-1.0 * {0}))",
    "select": "{0} > 0.0 ? {1} : {2}",
}  # fmt: skip


def slopes_header(d: Description) -> str:
    """Return C source of `add_changes`, which adds to the changes of outputs what those of parameters make of them.

    What a parameter changes of the state at the start, and with it and by itself of the outputs, is the same for a
    closed form as for a series: it comes of the graph of the motion, by forward accumulation, whatever the plan chose.
    """
    blocks, parameters = d.plan.kernels.BLOCKS, {v.offset for v in d.variables if v.causality == "parameter"}
    sizes = {name: model_buffer.size_of_block(block) for name, block in blocks.items() if block.start in parameters}
    set_by = [element for name, size in sizes.items() for element in elements(name, size)]
    start, shown = (_prescribed if d.scene.body is None else _of_body)(set_by, d.scene)
    outputs = [v for v in d.outputs if v.block in shown]  # the last time of an event is none of the motion's
    own = {name: f"{STATE}{name}" for name in d.scene.states}  # which may be called as a block of the body's, such as q
    places = [v.offset - blocks[own.get(v.block, v.block)].start for v in outputs]
    changes = changes_of([shown[v.block][i] for v, i in zip(outputs, places, strict=True)], start.changes)
    lines, found = source.lines_of(start.graph, changes, _leaves_in_c(start.graph, blocks), _IN_C)
    by = {names: f"by_{i}" for i, names in enumerate(dict.fromkeys(v.begins_with for v in outputs))}
    lines += [f"{by[names]} = {_moved_by(d, names)}" for names in by]
    added = [
        f"change[{v.offset}] += moved({by[v.begins_with]}, {x});"
        for v, x in zip(outputs, found, strict=True)
        if x != 0.0
    ]
    return "\n".join([
        "/* How outputs change at once with parameters at the start, made from the graph of the motion. */",
        "#include <math.h>",
        "/* What an output does not depend on does not change it, also where its formula has no derivative. */",
        "static inline double moved(double by, double x) { return by != 0.0 ? x : 0.0; }",
        "static void add_changes(const double *z, double *change) {",
        *(f"    const double {line};" for line in lines), *(f"    {line}" for line in added),
        *(f"    (void){one};" for one in ("z", "change", *by.values())), "}", "",
    ])  # fmt: skip


def _moved_by(d: Description, names: Collection[str]) -> str:
    """Return how much parameters change on which an output depends, as C."""
    of_these = (v for v in d.variables if v.causality == "parameter" and v.block in names)
    return " + ".join(f"fabs(change[{v.offset}])" for v in of_these) or "0.0"


def _leaves_in_c(graph: Graph, blocks: Mapping[str, slice]) -> dict[str, str]:
    """Return the leaves of a graph as C; a model that reads no time has none."""
    found = {}
    for name in (str(one.value) for one in graph.operations if one.kind in LEAVES):
        block, _, index = name.removeprefix(CHANGE).partition("[")
        block = "time" if block == "t" else block
        if place := blocks.get(block, blocks.get(f"series.{block}")):
            array = "change" if name.startswith(CHANGE) else "z"
            found[name] = f"{array}[{place.start + (int(index[:-1]) - 1 if index else 0)}]"
    return found


def _prescribed(set_by: Iterable[str], _: Scene) -> tuple[Start, Shown]:
    start = Start(Graph(), set_by)
    q, omega = (np.array(start.leaves(*of), object) for of in (("quaternion", 4, "state"), ("omega_b", 3, "input")))
    start.normalize(q.tolist())
    R = rotation_of(q)
    return start, {"quaternion": q.tolist(), "rpy": _roll_pitch_yaw(R), "omega_a": (R @ omega).tolist()}


def _of_body(set_by: Iterable[str], scene: Scene) -> tuple[Start, Shown]:
    texts = formulas.texts_of(scene, {*MADE, *set_by})
    motion, own = texts.motion, texts.motion.given.states
    start = Start(motion.graph, set_by)
    start.normalize(motion.q)
    start.begin(motion)
    shown = {**motion.outputs(texts.rates), **texts.own, "rpy": _roll_pitch_yaw(motion.R)}
    shown |= {name: start.leaves(f"{STATE}{name}", size, "state") for name, size in own.items()}
    return start, {name: [*np.ravel(value)] for name, value in shown.items()}


def _roll_pitch_yaw(R: Sequence[Sequence[Number]]) -> list[Number]:
    """Return the angles of R = R_z(yaw) R_y(pitch) R_x(roll) by its elements; at the pole they have no derivative."""
    level = square_root(R[0][0] * R[0][0] + R[1][0] * R[1][0])
    return [arctangent(R[2][1], R[2][2]), arctangent(-1.0 * R[2][0], level), arctangent(R[1][0], R[0][0])]
