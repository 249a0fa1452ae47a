"""Generated C headers: the rules of calls, and for a scene its numbers, its names, and derivatives at the start."""

import json
from collections.abc import Collection, Iterable, Mapping, Sequence
from itertools import accumulate, chain
from pathlib import Path
from string import Template

import numpy as np

from rbfmu import Scene
from rbfmu.formulas import source
from rbfmu.formulas.graph import LEAVES, Graph, Number, arctangent, changes_of, square_root
from rbfmu.formulas.motion import CHANGE, MADE, STATE, Start, rotation_of
from rbfmu.models import formulas, model_buffer
from rbfmu_fmu.description import Description, Variable
from rbfmu_fmu.model_description import FmiVersion
from rbfmu_fmu.python import slave_access
from rbfmu_fmu.python.call_rules import CALLS, LOG_CATEGORIES, PHASES, SET_REFUSAL, SETTABLE
from rbfmu_kernels.buffer import CHANGED, FAULTS, OK, PAST_STOP, STEP_REJECTED
from rbfmu_kernels.quantities import elements

MAX_DERIVATIVE_ORDER = 2
"""The highest order of time derivatives for which the table of the C layer has room."""


def headers(d: Description, version: FmiVersion, guid: str = "") -> dict[str, str]:
    """Return the generated C headers by file name."""
    return {"call_rules.h": call_rules(), "scene.h": scene_header(d, version, guid), "slopes.h": slopes_header(d)}


def _fill_template(name: str, parts: Mapping[str, object]) -> str:
    """Return a header made from its template, which is beside this file, and the parts to fill in."""
    return Template(Path(__file__).with_name(f"{name}.txt").read_text(encoding="ascii")).substitute(parts)


def call_rules() -> str:
    """Return the rules in call_rules.py as C source."""
    rules = (f"[{name.upper()}] = {{{_bits(rule.phases)}, {_c(rule.refusal)}}}," for name, rule in CALLS.items())
    settable = (f"[{name.upper()}] = {{{_c(name)}, {_bits(phases)}}}," for name, phases in SETTABLE.items())
    return _fill_template("call_rules.h", {
        "phases": _row([*PHASES, "PHASES"]), "phase_names": _row(map(_c, PHASES.values())),
        "calls": _row(map(str.upper, CALLS)), "causalities": _row(map(str.upper, SETTABLE)),
        "rules": _table(rules), "settable": _table(settable), "set_refusal": _c(SET_REFUSAL),
    })  # fmt: skip


def _table(rows: Iterable[str]) -> str:
    return "\n    ".join(["{", *rows]) + "\n}"


def scene_header(d: Description, version: FmiVersion, guid: str) -> str:
    """Return the scene's numbers and names as C source."""
    inputs, parameters = (sum(v.causality == c for v in d.variables) for c in ("input", "parameter"))
    # the Reals of each value reference; the time is one more Real
    elements = [variable.elements for variable in version.references(d)] + [(len(d.variables),)] * version.has_time
    run, unknown, sizes = d.scene.run, max(FAULTS) + 1, [*map(len, elements)]
    faults = FAULTS | {unknown: ("", "initialisation failed")}
    texts = {"guid": guid, "identity": _IDENTITIES[version.identity], "real": version.real, "integer": version.integer}
    texts |= {"held": slave_access.HELD, "to_vary": slave_access.TO_VARY, "changed": CHANGED}
    return _fill_template("scene.h", {name: _c(text) for name, text in texts.items()} | {
        "categories": _row([*map(_c, LOG_CATEGORIES), "NULL"]), "unknown": unknown, "start_place": d.start_place,
        "start_time": run.start.hex(), "last_time": run.last_time.hex(), "accuracy": run.accuracy.hex(),
        "output_derivatives": "#define OUTPUT_DERIVATIVES" if d.output_rates else "/* no output has a derivative */",
        "ok": OK, "rejected": STEP_REJECTED, "past_stop": PAST_STOP, "start": _row(x.hex() for x in d.start_buffer),
        "size": len(d.start_buffer), "reals": len(d.variables), "changes": d.outputs_end,
        "first_parameter": inputs, "first_output": inputs + parameters, "has_time": int(version.has_time),
        "time_reference": "REFERENCES - 1" if version.has_time else "REFERENCES + 1 /* there is none */",
        "one_element": "#define ONE_ELEMENT_EACH" if {*sizes} == {1} else "/* there are arrays */",
        "references": len(elements), "status_reference": version.status_reference(d), "counts": len(d.counts),
        "count_offsets": _row([*(count.offset for count in d.counts), 0]),
        "count_names": _row([*(_c(count.name) for count in d.counts), 0]),
        "elements": _row(chain.from_iterable(elements)), "first_element": _row(accumulate(sizes, initial=0)),
        "offsets": _table(f"{v.offset}, /* {v.name} */" for v in d.variables), "max_order": MAX_DERIVATIVE_ORDER,
        "derivatives": _table(f"{_row(_rates(v))}, /* {v.name} */" for v in d.variables),
        "variables": _table(f"{_row((_c(v.name), _c(v.block), int(v.pinned)))}," for v in d.variables),
        "faults": _table(f"[{code}] = {_row(map(_c, said))}," for code, said in faults.items()),
    })  # fmt: skip


_IDENTITIES = {"guid": "guid", "instantiationToken": "instantiation token"}
"""The name of an FMU's identity in messages, by its attribute."""


def _rates(variable: Variable) -> list[object]:
    """Return the places of a variable's derivatives, MAX_DERIVATIVE_ORDER of them, for the C layer's table."""
    return [*variable.rates, *["NOT_PROVIDED"] * MAX_DERIVATIVE_ORDER][:MAX_DERIVATIVE_ORDER]


def _bits(phases: Iterable[int]) -> str:
    """Return a set of phases as a C expression of bits."""
    return " | ".join(f"1 << {[*PHASES][k]}" for k in phases) or "0"


def _row(items: Iterable[object]) -> str:
    return f"{{{', '.join(map(str, items))}}}"


def _c(text: str) -> str:
    """Return a C string literal for a text, which must be plain ASCII."""
    assert text.isascii(), text
    return json.dumps(text)


# --- derivatives of outputs with respect to parameters in Initialization Mode

Outputs = Mapping[str, Sequence[Number]]
_IN_C = {kind: text.replace("math.", "") for kind, text in source.VALUES.items()} | {
    "sin": "sin({})", "cos": "cos({})", "exp": "exp({})", "log": "log({})", "power": "pow({}, {})",
    "logistic": "1.0 / (1.0 + exp(-1.0 * {0}))",
    "select": "{0} > 0.0 ? {1} : {2}",
}  # fmt: skip


def slopes_header(d: Description) -> str:
    """Return C source of `add_changes`, which adds to the changes of outputs those that changed parameters cause.

    Parameters change outputs at the start, directly and through the initial state, by the same amount for a closed form
    as for a series. So the derivatives are taken from the graph of the motion, by forward accumulation, for any plan.
    """
    blocks, parameters = d.plan.kernels.BLOCKS, {v.offset for v in d.variables if v.causality == "parameter"}
    sizes = {name: model_buffer.size_of_block(block) for name, block in blocks.items() if block.start in parameters}
    set_by = [element for name, size in sizes.items() for element in elements(name, size)]
    start, shown = (_prescribed if d.scene.body is None else _of_body)(set_by, d.scene)
    outputs = [v for v in d.outputs if v.block in shown]  # without the times of events, which the motion does not have
    own = {name: f"{STATE}{name}" for name in d.scene.states}  # own states may have a name of the body's blocks, as q
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
    lines = [*(f"const double {line};" for line in lines), *added]
    lines += [f"(void){name};" for name in ("z", "change", *by.values())]
    return _fill_template("slopes.h", {"lines": "\n".join(f"    {line}" for line in lines)})


def _moved_by(d: Description, names: Collection[str]) -> str:
    """Return the C expression for how much those parameters change on which an output depends."""
    of_these = (v for v in d.variables if v.causality == "parameter" and v.block in names)
    return " + ".join(f"fabs(change[{v.offset}])" for v in of_these) or "0.0"


def _leaves_in_c(graph: Graph, blocks: Mapping[str, slice]) -> dict[str, str]:
    """Return the C expressions of the graph's leaves by name; the time is missing if the model has none."""
    found = {}
    for name in (str(operation.value) for operation in graph.operations if operation.kind in LEAVES):
        block, _, index = name.removeprefix(CHANGE).partition("[")
        block = "time" if block == "t" else block
        if place := blocks.get(block, blocks.get(f"series.{block}")):
            array = "change" if name.startswith(CHANGE) else "z"
            found[name] = f"{array}[{place.start + (int(index[:-1]) - 1 if index else 0)}]"
    return found


def _prescribed(set_by: Iterable[str], _: Scene) -> tuple[Start, Outputs]:
    start = Start(Graph(), set_by)
    q, omega = (np.array(start.leaves(*of), object) for of in (("quaternion", 4, "state"), ("omega_b", 3, "input")))
    start.normalize(q.tolist())
    R = rotation_of(q)
    return start, {"quaternion": q.tolist(), "rpy": _roll_pitch_yaw(R), "omega_a": (R @ omega).tolist()}


def _of_body(set_by: Iterable[str], scene: Scene) -> tuple[Start, Outputs]:
    texts = formulas.texts_of(scene, {*MADE, *set_by})
    motion, own = texts.motion, texts.motion.given.states
    start = Start(motion.graph, set_by)
    start.normalize(motion.q)
    start.begin(motion)
    shown = {**motion.outputs(texts.rates), **texts.own, "rpy": _roll_pitch_yaw(motion.R)}
    shown |= {name: start.leaves(f"{STATE}{name}", size, "state") for name, size in own.items()}
    return start, {name: [*np.ravel(value)] for name, value in shown.items()}


def _roll_pitch_yaw(R: Sequence[Sequence[Number]]) -> list[Number]:
    """Return roll, pitch and yaw of R = R_z(yaw) R_y(pitch) R_x(roll); at the pole they have no derivative."""
    level = square_root(R[0][0] * R[0][0] + R[1][0] * R[1][0])
    return [arctangent(R[2][1], R[2][2]), arctangent(-1.0 * R[2][0], level), arctangent(R[1][0], R[0][0])]
