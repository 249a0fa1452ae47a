"""A scene's formulas as a model: kernels generated from their graph, bound to places of a buffer."""

import hashlib
import json
import linecache
import sys
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from functools import cache, cached_property, lru_cache
from types import ModuleType
from typing import Any

import numpy as np

from rbfmu.formulas.check import Texts, blocks_of, given_to
from rbfmu.formulas.graph import SYMBOLIC, Symbol, gradient, numbers_of, side
from rbfmu.formulas.motion import CONSTANT, STATE, Given, by_element, closure, groups_of
from rbfmu.formulas.program import WIDTH, Program
from rbfmu.formulas.source import SERIES, module_of, source_of, source_of_lanes, source_over
from rbfmu.models.model_buffer import BLOCKS, BodyAtStart, size_of_block
from rbfmu.scene.own import DIRECTIONS
from rbfmu.scene.scene import Scene, SceneError
from rbfmu_kernels import buffer
from rbfmu_kernels.body import driven, memory, shell
from rbfmu_kernels.compile.code_cache import GENERATED
from rbfmu_kernels.models import formula_events, formula_models, formulas as templates, model_named
from rbfmu_kernels.quantities import OUTPUT, Output, active_flags, elements, own_output

EVENT = "when."
"""Prefix of an event's name: together they name the block with the value that it watches."""
_ENDS = ("", "_rate", "_rate_2")
"""Endings of the names of an input's blocks: of its value and its derivatives."""
_STARTS = {"q": ("quaternion_0",), "omega": ("omega_b_0",), "r_c": ("position_0",), "v_c": ("velocity_0",), "t": ()}
"""The parameters that are the states' first values; a centre of mass beside o needs attitude and rate as well."""
_OF_BODY = {"M": {"inertia"}, "M_inverse": {"inertia"}, "arm": {"r_oc_b"}, "inverse_mass": {"mass"}}
"""The parameters from which `initialize` sets blocks."""
_READ = {"q": "quaternion", "omega": "omega_b", "r_c": "position", "v_c": "velocity"}
"""The quantities for which models keep these states."""
_FIRST_OUTPUT = next(iter(memory.OUTPUTS))
_MADE: dict[str, shell.Model] = {}
"""The last models by `FormulaModel.key`, so that no process compiles one twice."""
MOST_MADE = 256  # of 1 MB each, or 35 if this process compiled it: a loop that changes texts makes one a turn


class FormulaModel:
    """The model of formulas: `model` runs it, `source` is its generated text, `program` its series."""

    def __init__(self, texts: Texts) -> None:
        """texts: a scene's formulas on a graph, without faults, as returned by `texts_of`."""
        scene, motion = texts.scene, texts.motion
        self.scene: Scene = scene
        self.given, self.texts, self.motion = motion.given, texts, motion
        self.events = {name: (texts.events[name], DIRECTIONS[row.direction]) for name, row in scene.events.items()}
        whens = {f"{EVENT}{name}": np.array(when, object) for name, (when, _) in self.events.items()}
        loads, states, own = texts.loads, texts.states, texts.own  # without faults, none is None
        tables = {"loads": texts.loads_by_key, "states": states, "outputs": own, "events": texts.events}
        self.by_key = {f"{table}.{name}": value for table, rows in tables.items() for name, value in rows.items()}
        self.all_rates = texts.rates
        known = {**motion.outputs(self.all_rates), **own}
        names = (*dict.fromkeys(OUTPUT[name].judged_by or name for name in scene.outputs.quantities), *own)
        self.shown = {name: known[name] for name in names} | whens
        self.own_outputs = {name: int(np.size(value)) for name, value in own.items()}
        read = {name.partition("[")[0] for name in self._states_of(self._numbers(*self.shown))}
        self.own_states = {name: np.size(x) for name, x in states.items() if f"{STATE}{name}" in read}
        for name, size in self.own_states.items():  # own states are judged, and shown by FMUs
            leaves = [motion.graph.leaf("state", element) for element in elements(f"{STATE}{name}", size)]
            self.shown[f"{STATE}{name}"] = np.array(leaves, object)
        # without states the time is used as one: Numba has no type for an empty tuple
        self.groups = groups_of(self._states_of(self._numbers(*self.shown)) or ["t"])
        self.rates = {name: self.all_rates[name] for group in self.groups for name in group.states}
        integrated = {*self.rates}  # no output depends on a load that needs other states
        seen = {n: x for n, x in loads.items() if integrated.issuperset(self._states_of(np.ravel(x)))}
        put = {f"constant_{name}": value for name, value in seen.items()} | dict(own) | whens
        self._sides = [motion.graph.index_of(side(when)) for when, _ in self.events.values()]
        watched = [Symbol(motion.graph, i) for i in self._sides]
        self.program = Program(motion.graph, self.rates, dict(by_element(put)), watched)

    def _states_of(self, numbers: Iterable[Any]) -> list[str]:
        """Return the names of the states' numbers on which `numbers` depend."""
        return closure(self.all_rates, [*numbers], self.motion.graph)

    def serves(self, scene: Scene) -> bool:
        """Return whether the kernels are valid for a scene: it has the same texts, and zeros where they have zeros."""
        given = given_of(scene)
        numbers = dict(by_element(given.numbers))
        if scene.own_texts != self.scene.own_texts or given.sizes != self.given.sizes:
            return False
        asked = {OUTPUT[name].judged_by or name for name in scene.outputs.quantities}
        return asked <= self.shown.keys() and not any(numbers[place] for place in self.motion.zeros)

    @property
    def own_rows(self) -> dict[str, Output]:
        """Return the rows of the scene's own outputs by name, each with its formula in its meaning."""
        own = self.scene.outputs.own.items()
        meanings = {name: " = ".join(filter(None, (row.about, row.value))) for name, row in own}
        return {name: own_output(name, self.own_outputs[name], row.unit, meanings[name]) for name, row in own}

    def keys_of(self, operation: int) -> list[str]:
        """Return the keys of the formulas that contain an operation."""
        found = {key: map(self.motion.graph.symbol_of, np.ravel(value)) for key, value in self.by_key.items()}
        return [key for key, numbers in found.items() if operation in self.motion.graph.reached(numbers)]

    # Dependencies, by both branches of conditions

    @cached_property
    def parameters(self) -> set[str]:
        """Return the names of the parameters on which rates, outputs and starts depend."""
        return self._parameters([*self.rates.values(), *self._numbers(*self.shown)], [*self.rates])

    def follows(self, name: str) -> set[str]:
        """Return the names of the inputs on which an output depends directly (feedthrough)."""
        return {str(value).partition("[")[0] for value in self._leaves("input", self._numbers(name))}

    def follows_time(self, name: str) -> bool:
        """Return whether an output depends directly on the time."""
        return "t" in self._leaves("state", self._numbers(name))

    def begins_with(self, name: str) -> set[str]:
        """Return the names of the parameters on which an output at the start, or its derivatives, depend."""
        whole = self.without_zeros
        numbers = whole._numbers(name)
        found = whole._parameters(numbers, whole._leaves("state", numbers))
        return found & {*self.parameters, *self.scene.inputs.parameters}

    @cached_property
    def without_zeros(self) -> "FormulaModel":
        """Return the model in which no parameter is assumed to stay zero."""
        return FormulaModel(texts_of(self.scene, blocks_of(self.parameters)))

    def _numbers(self, *names: str) -> list[Any]:
        return [x for name in names for x in np.ravel(self.shown[name])]

    def _leaves(self, kind: str, numbers: Iterable[Any]) -> list[str]:
        return [str(x.value) for x in self.motion.graph.reached_of([kind], numbers)]

    def _parameters(self, numbers: Iterable[Any], states: Iterable[str]) -> set[str]:
        places = {value.partition("[")[0] for value in self._leaves("place", numbers)}
        kept = {name.partition("[")[0] for name in states}
        found = {name for state in kept for name in _STARTS.get(state, (f"{state.removeprefix(STATE)}_0",))}
        beside = any(self.given.numbers["r_oc_b"]) or "r_oc_b" in self.given.symbolic
        if kept & {"r_c", "v_c"} and beside:
            found |= {"r_oc_b", "quaternion_0"} | ({"omega_b_0"} if "v_c" in kept else set())
        for place in places:
            found |= _OF_BODY.get(place, {place.removeprefix("constant_").removeprefix(CONSTANT)})
        about_pivot = self.given.pivot and beside and places & {"M", "M_inverse"}
        return found | ({"mass", "r_oc_b"} if about_pivot else set())

    @cached_property
    def _changes(self) -> dict[int, dict[int, Any]]:
        """Return the derivatives of shown numbers by inputs with feedthrough: number's place -> input's place."""
        inputs = sorted(set(self._leaves("input", self._numbers(*self.shown))))
        leaves = [self.motion.graph.leaf("input", name) for name in inputs]
        found: dict[int, dict[int, Any]] = {}
        for element, x in by_element({name: value for name, value in self.shown.items() if self.follows(name)}):
            slopes = zip(inputs, gradient(x, leaves), strict=True)
            found[self.place(element)] = {self.place(name): dx for name, dx in slopes if dx != 0.0}
        return found

    @cached_property
    def blocks(self) -> buffer.Layout:
        """Return the places of the buffer's blocks."""
        given = self.given
        own = {
            "order": 1, "series.start_time": 1, "series.longest": 1, "series.time": 2,
            **{f"{n}{end}": given.ports[n] for end in _ENDS for n in given.ports if n not in memory.INPUTS},
            **{f"{CONSTANT}{n}": s for n, s in given.constants.items()},
            **{f"{STATE}{n}_0": s for n, s in given.states.items()},
            **{f"{STATE}{n}": s for n, s in given.states.items()}, "series.resting": 2 * len(self.program.touching),
            **templates.SERIES, **dict.fromkeys(templates.CORNERS, len(self.program.sides)),
            "series.sizes": len(self.groups), "series.held_inputs": max(sum(given.ports.values()), 1),
            **self.own_outputs, **{f"{EVENT}{n}": 1 for n in self.events}, **self.more_blocks,
            **(dict.fromkeys(formula_events.EVENTS, len(self.events)) | {"events.listed": 1} if self.events else {}),
        }  # fmt: skip
        _, before = buffer.places(driven.DRIVEN | own)
        work = self.program.start + self.program.row * (max(templates.ORDERS) + 1)
        own |= {"pad_3": -before % 8, "series.work": work, "series.last": WIDTH}
        beside = sum(given.ports.values()) + len(self.rates) + len(self.program.sides)
        own |= {"series.spare": 2 * self.program.row + beside}
        own |= {"events.list": 3 * formula_events.MOST_LISTED} if self.events else {}
        return buffer.places(driven.DRIVEN | own | {"series.kept": before - memory.STATE_START})

    @property
    def more_blocks(self) -> dict[str, int]:
        """Return the sizes of further blocks of the buffer."""
        return {}

    def place(self, element: str, end: str = "") -> int:
        """Return the place in the buffer of an element of a block; end: the ending of the block's name, of _ENDS."""
        name, _, index = element.partition("[")
        name = "time" if name == "t" else f"{name}{end}"
        blocks = self.blocks.blocks
        block = name if name in blocks else f"series.{name}"
        return int(blocks[block].start) + (int(index[:-1]) - 1 if index else 0)

    @cached_property
    def source(self) -> str:
        """Return the text of the generated kernels."""
        return source_of(self.program, self.place, self._changes)

    @cached_property
    def text(self) -> str:
        """Return the text of the module that makes the model, MODEL: a user can print it, and an FMU contains it."""
        return self._module_text(f"FORMULAS_{self.key}")

    @cached_property
    def key(self) -> str:
        """Return a hash of the model's text, by which compiled code is kept."""
        return hashlib.sha256(self._module_text("").encode()).hexdigest()[:16]

    def _module_text(self, name: str) -> str:
        return module_of(self.source, name, self.blocks, self._places, self._base)

    @cached_property
    def plain_loads(self) -> dict[str, list[Any]] | None:
        """Return the scene's loads of numbers that the formulas of loads are equal to, by name; None if they are not.

        These are constant loads, and a torque in b from which each rate times a constant may be subtracted: damping.
        """
        graph, rates, found = self.motion.graph, elements("omega", 3), dict[str, list[Any]]()
        loads = {name: [*np.ravel(value)] for name, value in self.texts.loads.items()}
        places = self._leaves("place", [x for numbers in loads.values() for x in numbers])
        at_rest = {name: graph.leaf("place", name) for name in places} | dict.fromkeys(rates, 0.0)
        for name, numbers in loads.items():
            slopes = [gradient(x, [graph.leaf("state", rate) for rate in rates]) for x in numbers]
            across = [row[k] for i, row in enumerate(slopes) for k in range(3) if k != i]
            along = [slopes[k][k] for k in range(3)]
            read = {*self._leaves("state", numbers), *self._leaves("input", numbers)}
            sides = [i for i in graph.reached(numbers) if graph.operations[i].kind == "side" and graph.varies[i]]
            derived = {name.partition("[")[0] for name in self._leaves("place", numbers)} & {*_OF_BODY}
            if sides or derived or not read <= {*rates} or any(across):
                return None
            if not all(x.is_constant for x in along if isinstance(x, Symbol)):
                return None
            if any(along):
                if name != "torque_b" or any(self.given.numbers["damping_b"]) or "damping_b" in self.given.symbolic:
                    return None
                found["damping_b"] = [-1.0 * x for x in along]
            found[name] = numbers_of(graph, numbers, at_rest, SYMBOLIC)
        return found

    @property
    def read_by_loads(self) -> set[str]:
        """Return the names of the parameters that formulas of loads read."""
        return self._parameters([x for value in self.texts.loads.values() for x in np.ravel(value)], [])

    @property
    def quantities_read(self) -> set[str]:
        """Return the names of the quantities of the motion that own outputs read."""
        read = self._leaves("state", self._numbers(*self.own_outputs))
        return {_READ[name] for name in (element.partition("[")[0] for element in read) if name in _READ}

    @property
    def _places(self) -> dict[str, Any]:
        """Return the values of the templates' globals."""
        blocks, groups, program = self.blocks.blocks, self.groups, self.program
        ends = np.cumsum([len(group.states) for group in groups]).tolist()
        own = [f"{STATE}{n}" for n in self.given.states]
        known = sorted(blocks, key=lambda name: name.startswith("series."))  # last, to win by name
        where = {name.removeprefix("series."): blocks[name].start for name in known}
        ports = [element for name, size in self.given.ports.items() for element in elements(name, size)]
        inputs = [tuple(self.place(element, end) for element in ports) for end in _ENDS]
        numbers = (
            *("order", "tolerance", "span", "time", "longest", "sizes", "stands", "reach", "since", "begun"),
            *("rest", "crept", "tried", "resting", "sides", "on", "flips", "kept", "last", "spare", "work"),
        )
        return {name.upper(): where[name] for name in numbers} | {
            "STATES": tuple(map(self.place, self.rates)),
            "FIRSTS": (0, *ends)[: len(ends)], "ENDS": tuple(ends), "LEASTS": tuple(g.least for g in groups),
            "RELATIVE": tuple(g.relative for g in groups), "ATTITUDE": int("q[1]" in self.rates),
            "INPUTS": inputs[0] or (0,), "RATES": inputs[1] or (0,), "RATES_2": inputs[2] or (0,),
            "NUMBER_OF_INPUTS": len(inputs[0]), "HELD": where["held_inputs"], "STARTS": where["start_time"],
            "OF_EVENT": self._event_of_side, "NUMBER_OF_SIDES": len(program.sides),
            "WATCHED": where["work"] + program.start + len(self.rates),
            "NUMBER_TOUCHING": len(program.touching), "NUMBER_RISING": len(program.rising), "NEXT": where["next_on"],
            "MEMORY": memory.STATE_START, "MEMORY_SIZE": size_of_block(blocks["series.kept"]),
            "ROWS": where["work"] + program.start, "ROW": program.row,
            **self._event_places,
            "OWN": where[own[0]] if own else 0, "OWN_STARTS": where[f"{own[0]}_0"] if own else 0,
            "OWN_SIZE": sum(self.given.states.values()),
        }  # fmt: skip

    _base = ""

    @property
    def _event_of_side(self) -> tuple[int, ...]:
        """Return for each side the event that watches it, or -1 if it is a corner of a rate or of a watched formula."""
        corners = {*self.motion.graph.reached([*self.rates.values(), *(when for when, _ in self.events.values())])}
        return tuple(-1 if i in corners else self._sides.index(i) for i in self.program.sides) or (-1,)

    @property
    def _event_places(self) -> dict[str, Any]:
        if not self.events:
            return {}
        known = (*formula_events.EVENTS, "events.listed", "events.list")
        places = {name.removeprefix("events.").upper(): self.blocks.blocks[name].start for name in known}
        sides = tuple(self.program.sides.index(i) for i in self._sides)
        directions = tuple(direction for _, direction in self.events.values())
        return places | {"NUMBER_OF_EVENTS": len(sides), "EVENT_SIDES": sides, "DIRECTIONS": directions}

    @property
    def model(self) -> shell.Model:
        """Return the kernels; their text is registered for tracebacks."""
        if not (known := _MADE.get(self.key)):
            made = _module_of(self.key, self.text)
            base = vars(made).pop("MODEL")  # which compiled code would keep, as Numba keeps its module's names for good
            known = replace(base, lanes=None if self._base else cache(lambda: self._lanes(made, base)))
            _MADE[self.key] = known
            for key in [*_MADE][:-MOST_MADE]:  # kernels are freed when no one uses them
                _MADE.pop(key, None)
                sys.modules.pop(f"{__name__}.formulas_{key}", None)
                linecache.cache.pop(f"{GENERATED}{key}>", None)
        return known

    def _lanes(self, made: Any, model: shell.Model) -> shell.Lanes:
        """Return the kernels that run many bodies side by side; made: the model's module."""
        text, row = source_of_lanes(self.program, self.place)
        constant = f"LANES_{hashlib.sha256((self.key + text).encode()).hexdigest()[:16]}"
        kernels = vars(_module_of(constant, text))
        wide = {f"wide_{name}": kernels[name] for name in SERIES} | {"WIDE_ROW": row}
        return formula_models.make_lanes(model, made.PLACES | made.KERNELS, constant, wide)


class OverClosedForm(FormulaModel):
    """The model of own outputs over a closed form: they are functions of its motion and of the time."""

    def __init__(self, formulas: FormulaModel, base: str) -> None:
        # it is also valid for other values of parameters that are not listed, even of those that are zero here
        super().__init__(formulas.without_zeros.texts)
        self._base, self._closed_form = base, model_named(base)
        self.program = Program(self.motion.graph, {}, dict(by_element(self.texts.own)))

    @cached_property
    def blocks(self) -> buffer.Layout:
        """Return the places of the buffer's blocks: those of the closed form, constants, and own outputs."""
        known = {name: size_of_block(block) for name, block in self._closed_form.BLOCKS.items()}
        constants = {f"{CONSTANT}{n}": s for n, s in self.given.constants.items()}
        own = {"series.start_time": 1, "series.time": 2} | constants | self.own_outputs
        _, before = buffer.places(known | own)
        return buffer.places(known | own | {"series.kept": before - memory.BLOCKS[_FIRST_OUTPUT].start})

    @cached_property
    def source(self) -> str:
        """Return the text of the generated kernels."""
        loads = {n if n == "damping_b" else f"constant_{n}": x for n, x in (self.plain_loads or {}).items()}
        return source_over(self.program, self.place, self._changes, dict(by_element(loads)))

    @property
    def _places(self) -> dict[str, Any]:
        """Return the values of the templates' globals."""
        blocks = self.blocks.blocks
        places = {"TIME": "series.time", "STARTS": "series.start_time", "ACTIVE": "active", "KEPT": "series.kept"}
        return {name: blocks[block].start for name, block in places.items()} | {
            "MEMORY": blocks[_FIRST_OUTPUT].start, "MEMORY_SIZE": size_of_block(blocks["series.kept"]),
            "SHOWN": tuple(active_flags(self.quantities_read)),
        }  # fmt: skip


def _module_of(name: str, text: str) -> ModuleType:
    """Return a module of generated text."""
    file = f"{GENERATED}{name}>"
    linecache.cache[file] = (len(text), None, text.splitlines(keepends=True), file)
    made = ModuleType(f"{__name__}.formulas_{name}")
    sys.modules[made.__name__] = made  # where kept code finds its module
    exec(compile(text, file, "exec"), vars(made))  # our own text, made of numbers and places only
    return made


def given_of(scene: Scene, varied: Iterable[str] = ()) -> Given:
    """Return the numbers that formulas can read; varied: see `given_to`. Raises SceneError if the body is refused."""
    start = BodyAtStart(scene)
    start.check()
    return given_to(scene, {name: start.z[block].tolist() for name, block in BLOCKS.items()}, varied)


def texts_of(scene: Scene, varied: Iterable[str] = ()) -> Texts:
    """Return a scene's formulas on a graph; varied: see `given_to`. Raises SceneError if the body or a text is bad."""
    texts = Texts(scene, given_of(scene, varied))
    if texts.faults:  # such as a division by a number of the scene that is zero
        raise SceneError(texts.faults, scene.name)
    return texts


@dataclass(frozen=True)
class _Tables:
    """A scene as a key of a cache: scenes whose tables have the same text count as equal."""

    text: str
    scene: Scene = field(compare=False)


@lru_cache(maxsize=16)
def _model_of_tables(tables: _Tables) -> FormulaModel:
    return FormulaModel(texts_of(tables.scene))


def equations_of(scene: Scene) -> FormulaModel:
    """Return the equations of a scene's motion, with formulas or without. Raises SceneError as `texts_of`."""
    tables = {key: table for key, table in scene.to_dict().items() if key not in ("name", "run", "about", "ensemble")}
    return _model_of_tables(_Tables(json.dumps([tables, scene.ensemble.parameters if scene.ensemble else ()]), scene))
