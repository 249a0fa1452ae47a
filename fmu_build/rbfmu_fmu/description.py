"""The description of an FMU for any version of FMI: its variables, and what the C layer and the slave must know.

A variable's name, unit, bounds and meaning come from its row of `rbfmu_kernels.quantities`. This module adds what tools
show besides (names of components, usual sizes), and decides what has a value reference.
"""

import math
import re
import unicodedata
from collections.abc import Iterator, Mapping
from itertools import groupby
from keyword import iskeyword
from typing import NamedTuple

from rbfmu import Plan, Scene
from rbfmu.models.question import Question
from rbfmu.planning.select import with_all_outputs
from rbfmu.runs.plan import filled_buffer
from rbfmu.types import Buffer
from rbfmu_kernels import buffer, quantities
from rbfmu_kernels.compile.tiered import tiered
from rbfmu_kernels.quantities import BY_NAME, FORCES, OUTPUT, PORTS, TORQUES, Output, Parameter, Quantity, own_output

AXES = ("x", "y", "z")
_EULER_PARAMETERS = ("scalar part", "vector part x", "vector part y", "vector part z")
_INERTIA = {"inertia": 3}
"""How many of a block's first numbers determine its usual size, if not all."""
_AS_IT_IS = ("identifier", "counts", "start_buffer", "outputs_end", "start_place")
"""The fields of a description that a slave gets unchanged."""
_OF_XML = ("follows", "begins_with")
"""The fields of a variable that only modelDescription.xml needs, so that a slave does not get them."""


class Variable(NamedTuple):
    """One Real variable: its name, its block in the model's buffer, its component, and its place (offset) there.

    meaning: that of its block; nominal: its usual size, if one is known; pinned: whether the plan holds only for the
    start value; rates: the places of its time derivatives, from the first order on, which an importer may set for an
    input and read for an output. For an output, follows has the blocks of the inputs that change it at once, and the
    time if its formula contains that; begins_with has those of the inputs and parameters it depends on at the start.
    """

    name: str
    block: str
    component: str
    unit: str
    meaning: str
    offset: int
    causality: str
    start: float | None
    minimum: float | None
    maximum: float | None
    nominal: float | None
    pinned: bool
    rates: tuple[int, ...]
    follows: frozenset[str]
    begins_with: frozenset[str]


class Count(NamedTuple):
    """An Integer output besides `status`: how often an event has happened; offset: its place in the model's buffer."""

    name: str
    offset: int
    meaning: str


class Description(NamedTuple):
    """A scene's FMU: all that a slave or a C layer must know about the model, without its equations.

    identifier: a valid name in C and Python; counts: the counts of events, whose value references follow that of
    `status`; start_place: the place of the start time in the buffer, or -1 for a model without time.
    """

    scene: Scene
    plan: Plan
    identifier: str
    variables: tuple[Variable, ...]
    counts: tuple[Count, ...]
    start_buffer: tuple[float, ...]
    outputs_end: int
    """The place after the last of the model's outputs in its buffer."""
    start_place: int

    @property
    def inputs(self) -> tuple[Variable, ...]:
        """Return the inputs, in their order."""
        return tuple(v for v in self.variables if v.causality == "input")

    @property
    def outputs(self) -> tuple[Variable, ...]:
        """Return the Real outputs, in their order, so without `status`."""
        return tuple(v for v in self.variables if v.causality == "output")

    @property
    def interpolates_inputs(self) -> bool:
        """Return whether there are inputs, and an importer can set derivatives for each of them."""
        return bool(self.inputs) and all(v.rates for v in self.inputs)

    @property
    def output_rates(self) -> bool:
        """Return whether every output has a derivative."""
        return all(v.rates for v in self.outputs)

    def to_dict(self) -> dict[str, object]:
        """Return a dict for JSON with what a slave needs, and the messages about parameters that a model refuses."""
        known = {"name": self.scene.name, "model": self.plan.kernels.name, "about": self.scene.about.table()}
        known |= {name: getattr(self.scene.run, name) for name in ("start", "stop", "step", "accuracy", "last_time")}
        known |= {name: getattr(self, name) for name in _AS_IT_IS}
        variables = [{k: x for k, x in v._asdict().items() if k not in _OF_XML} for v in self.variables]
        return known | {"variables": variables, "faults": buffer.FAULTS, "changed": buffer.CHANGED}


def blocks(d: Description, *causalities: str) -> dict[str, list[Variable]]:
    """Return the variables of these causalities by block, in their order."""
    of_these = (v for v in d.variables if v.causality in causalities)
    return {block: [*members] for block, members in groupby(of_these, lambda v: v.block)}


def describe(scene: Scene, plan: Plan) -> Description:
    """Return the description of the FMU of a scene with its plan."""
    plan = plan.of_scene(scene)
    kernels, z = plan.kernels, filled_buffer(scene, plan)
    sizes, shown = nominal_sizes(scene, plan, z), _blocks(scene, plan)
    outputs = [place for name, place in kernels.BLOCKS.items() if name in OUTPUT]
    counts = tuple(
        Count(f"{name}_count", kernels.BLOCKS["events.counts"].start + e,
              f"how often {event.about or event.when} came to zero, {event.direction}")
        for e, (name, event) in enumerate(scene.events.items())
    )  # fmt: skip
    variables = tuple(v for block in shown for v in _variables(block, plan, z, sizes))
    end = max(place.stop for place in (*outputs, *(block.place for block in shown)))
    start_place = kernels.BLOCKS["series.start_time"].start if plan.formulas else -1
    return Description(scene, plan, identifier(scene.name), variables, counts, tuple(z.tolist()), end, start_place)


def _without_effect(scene: Scene, plan: Plan) -> dict[str, frozenset[str]]:
    """Return, by output, the ports that do not act on it at once with this body, although they do with others.

    By Newton-Euler about o, m (a_o + alpha x r_c + omega x (omega x r_c)) = F and the torque about c is T_o - r_c x F:
    the two are coupled by r_c alone. If r_c is zero and cannot be set, forces do not turn the body, and torques do not
    accelerate o; a pivot does not move. Importers find algebraic loops by these lists; this avoids loops that do not
    exist.
    """
    body = scene.body
    if body is None:
        return {}
    if body.pivot:
        return {"alpha_b": FORCES, "acceleration": FORCES | TORQUES}
    fixed = "r_oc_b" in plan.pinned or "r_oc_b" not in _needed_parameters(scene, plan)
    return {"alpha_b": FORCES, "acceleration": TORQUES} if fixed and not any(body.r_oc_b) else {}


def _needed_parameters(scene: Scene, plan: Plan) -> set[str]:
    if plan.formulas:
        return plan.formulas.parameters | set(scene.inputs.parameters)
    return plan.spec.needed_parameters(Question(scene))


def sizes(scene: Scene, plan: Plan) -> tuple[int, tuple[int, int]]:
    """Return (number of the FMU's variables, (states, variables) of the full model with all outputs).

    With formulas, the second pair is (states of the whole body, 0).
    """
    states = 7 if scene.body is not None and scene.body.pivot else 13
    described = describe(scene, plan)
    count = len(described.variables) + len(described.counts) + 1
    if scene.body is None:
        return count, (plan.states, count)
    if scene.has_formulas:
        return count, (states, 0)
    full = Plan("body under loads, by series", "", states, order=12)
    return count, (states, len(describe(with_all_outputs(scene), full).variables) + 1)


def identifier(name: str) -> str:
    """Return an identifier for C and Python, made from a scene's name; accents are removed from its letters.

    It has at most 200 characters, as libraries have it as file name, and one sign of a name may become many letters.
    """
    plain = "".join(c for c in unicodedata.normalize("NFKD", name) if not unicodedata.combining(c))
    text = re.sub(r"\W", "_", plain, flags=re.ASCII)[:200]
    return f"_{text}" if not text or text[0].isdigit() or iskeyword(text) else text


def file_name(name: str) -> str:
    """Return the file name of a scene's FMU; letters and digits of any script are kept."""
    return re.sub(r"[^\w.-]", "_", name) + ".fmu"


class _Block(NamedTuple):
    row: Quantity
    place: slice
    causality: str
    follows: frozenset[str] = frozenset()
    begins_with: frozenset[str] = frozenset()


def _blocks(scene: Scene, plan: Plan) -> list[_Block]:
    """Return the blocks that are variables of the scene's FMU: inputs, parameters and outputs."""
    places, ports, needed = plan.kernels.BLOCKS, scene.inputs.ports, _needed_parameters(scene, plan)
    found = [_Block(BY_NAME[n], places[n], "input") for n in PORTS if n in ports]
    for name, port in scene.inputs.own.items():
        own = Parameter(name, port.size, port.unit or "1", port.about or "input")
        found.append(_Block(own, places[name], "input"))
    known = [row for row in quantities.IN_BUFFER_ORDER if row.name not in ports]  # a port's known load is no parameter
    parameters = (row for row in (*known, *scene.own_parameters.values()) if row.name in needed)
    found += [_Block(row, places[row.block], "parameter") for row in parameters]
    found += [_output(row, scene, plan) for row in _output_rows(scene, plan)]
    for e, (name, event) in enumerate(scene.events.items()):
        first = places["events.times"].start + e
        last = own_output(f"{name}_time", 1, "s", f"last time of {event.about or event.when}")  # first the start time
        found.append(_Block(last, slice(first, first + 1), "output"))  # no input changes it at once
    return found


def _output_rows(scene: Scene, plan: Plan) -> Iterator[Output]:
    yield from (row for name, row in OUTPUT.items() if name in scene.outputs.quantities)
    if plan.formulas:
        for name, size in plan.formulas.own_states.items():
            state = scene.states[name]
            yield own_output(name, size, state.unit, state.about or f"state with the rate {state.rate}")
        yield from plan.formulas.own_rows.values()


def _output(row: Output, scene: Scene, plan: Plan) -> _Block:
    """Return an output with what it depends on; without this, importers assume algebraic loops that do not exist."""
    name = row.name
    if plan.formulas:
        name = f"states.{name}" if name in plan.formulas.own_states else name
        judged = row.judged_by or name
        follows, first = plan.formulas.follows(judged), plan.formulas.begins_with(judged)
        follows |= {quantities.TIME.name} if plan.formulas.follows_time(judged) else set()
    else:
        nothing = _without_effect(scene, plan).get(name, frozenset())
        follows, first = {*OUTPUT[name].feedthrough} - nothing, {*OUTPUT[name].initially} - nothing
    return _Block(row, plan.kernels.BLOCKS[name], "output", frozenset(follows), frozenset(follows | first))


def _variables(block: _Block, plan: Plan, z: Buffer, sizes: Mapping[str, float]) -> list[Variable]:
    row, place, causality, follows, begins_with = block
    name, bounds = row.name, row.bounds if len(row.bounds) == row.size else row.bounds * row.size
    rates = _rate_blocks(plan, name, causality)
    return [
        Variable(
            name=f"{name}{index}", block=name, component=component, unit=row.unit, meaning=row.meaning,
            offset=place.start + i, causality=causality,
            start=None if causality == "output" else float(z[place.start + i]),
            minimum=bounds[i][0], maximum=bounds[i][1], nominal=sizes.get(name),
            pinned=causality == "parameter" and name in plan.pinned,
            rates=tuple(block.start + i for block in rates), follows=follows, begins_with=begins_with,
        )
        for i, (index, component) in enumerate(zip(quantities.indices(row), components(row), strict=True))
    ]  # fmt: skip


def _rate_blocks(plan: Plan, name: str, causality: str) -> list[slice]:
    """Return the blocks of an input's derivatives, which `step` uses, or of an output's, which `output_rates` fills.

    `output_rates` takes loads as constant and knows no formulas, so with formulas outputs have no derivatives.
    """
    places, of_output = plan.kernels.BLOCKS, () if plan.formulas else (f"d_{name}",)
    names = {"input": (f"{name}_rate", f"{name}_rate_2"), "output": of_output, "parameter": ()}[causality]
    return [places[n] for n in names if n in places]


def components(row: Quantity) -> tuple[str, ...]:
    """Return a word for each number of a quantity: an axis, an angle, a pair of axes; empty for a single number."""
    if row.elements:
        return tuple("".join(AXES[int(k) - 1] for k in pair.split(",")) for pair in row.elements)
    of_three: tuple[str, ...] = getattr(row, "components", AXES)  # an output may have its own words, such as roll
    return {1: ("",), 3: of_three, 4: _EULER_PARAMETERS}[row.size]


def input_sizes(scene: Scene) -> dict[str, float]:
    """Return for each port an input of usual size: a force for 1 m/s2, a torque for 1 rad/s2, rates of 1 rad/s.

    For ports of your own, about which nothing is known, it is 1.
    """
    sizes = {"omega_b": 1.0}
    if scene.body is not None:
        moment = max(scene.body.M_c[i][i] for i in range(3))
        sizes |= dict.fromkeys(FORCES, scene.body.mass) | dict.fromkeys(TORQUES, moment)
    return sizes | dict.fromkeys(scene.inputs.own, 1.0)


def nominal_sizes(scene: Scene, plan: Plan, filled: Buffer) -> Mapping[str, float]:
    """Return usual sizes by block, with one digit: for inputs those of `input_sizes`, for others those at the start.

    Importers scale tolerances by them (FMI 2.0.4, 2.2.7). One digit is enough for that, and hides round-off, so that
    the file stays the same. Quantities that are zero at the start, outputs whose terms cancel, unit quaternions and
    angles have no usual size.
    """
    kernels, z = plan.kernels, filled.copy()
    sizes: dict[str, float] = {}
    if int(tiered(kernels.initialize)(z)) == buffer.OK:
        sized = {n for n, row in OUTPUT.items() if row.error != quantities.ANGLE and not row.judged_by}
        sized -= {n for n, row in OUTPUT.items() if row.cancels and not row.conserved}
        for name, place in kernels.BLOCKS.items():
            row = BY_NAME.get(name.removeprefix("constant_"))
            if row is not None and (name not in OUTPUT or name in sized):
                size = math.hypot(*z[place][: _INERTIA.get(name)].tolist())
                sizes[name.removeprefix("constant_")] = max(size, getattr(row, "floor", 0.0))
    sizes |= {port: input_sizes(scene)[port] for port in scene.inputs.ports if port not in scene.inputs.own}
    return {name: float(f"{size:.0e}") for name, size in sizes.items() if 0.0 < size < math.inf}


class FmiVariable(NamedTuple):
    """A variable of the model description; its value reference is its position in the list of all.

    elements: the positions of its numbers in `Description.variables`, row by row; dimensions: empty for a scalar.
    """

    name: str
    elements: tuple[int, ...]
    dimensions: tuple[int, ...]


def scalars(d: Description) -> list[FmiVariable]:
    """Return a variable for each number."""
    return [FmiVariable(v.name, (k,), ()) for k, v in enumerate(d.variables)]


def arrays(d: Description) -> list[FmiVariable]:
    """Return a variable for each quantity; a symmetric matrix has all elements, also those below the diagonal."""
    found = blocks(d, "input", "parameter", "output")
    return [_array(name, d.variables.index(members[0]), len(members)) for name, members in found.items()]


def _array(name: str, first: int, size: int) -> FmiVariable:
    elements = BY_NAME[name].elements if name in BY_NAME else ()
    if not elements:
        return FmiVariable(name, tuple(range(first, first + size)), (size,) if size > 1 else ())
    place = {frozenset(element.split(",")): first + k for k, element in enumerate(elements)}
    rows = sorted({row for pair in place for row in pair})
    return FmiVariable(name, tuple(place[frozenset((i, j))] for i in rows for j in rows), (len(rows), len(rows)))
