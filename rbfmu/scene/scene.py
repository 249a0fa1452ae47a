"""The scene: its tables together, from a file or from Python; contradictions between them, and doubts.

Doubts are values that look like a slip, such as a wrong unit or too long a communication step; they give warnings.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import wraps
from pathlib import Path
from typing import Annotated, Any, Concatenate, ParamSpec, Self, TypeVar

import numpy as np

from rbfmu.exceptions import SceneWarning, path_of, warn_caller
from rbfmu.notebook import table
from rbfmu.scene import own as named, toml_file
from rbfmu.scene.body import ZERO, Body, principal_axes
from rbfmu.scene.ensemble import Ensemble, as_written, faults_with, without_idle_shape
from rbfmu.scene.section import Apart, SceneError, Section, as_lists, as_toml, checked, fault, line, names
from rbfmu.scene.tables import PARAMETERS, QUANTITIES, About, Initial, Inputs, Loads, Outputs, Run
from rbfmu.types import Array
from rbfmu_kernels.quantities import ANGLE, FORCES, LOADS, OUTPUTS, PORTS, TORQUES, Parameter

__all__ = ["PARAMETERS", "PORTS", "QUANTITIES", "About", "Body", "Initial", "Inputs", "Loads", "Outputs", "Run",
           "Scene", "SceneError", "load_scene"]  # fmt: skip

_NAME = line("1 to 200 printable characters without / and \\", 200, unwanted="/\\")


class Scene(Section):
    """One rigid body and what is known about its run; immutable. An invalid scene raises SceneError with all faults."""

    name: Annotated[str, _NAME.means("title, and the FMU's name; by default the file's")] = "scene"
    body: Body | None = None
    initial: Initial = Initial()
    loads: Loads = Loads()
    inputs: Inputs = Inputs()
    outputs: Outputs = Outputs()
    run: Run = Run()
    about: About = About()
    ensemble: Ensemble | None = None
    constants: Annotated[Mapping[str, named.Constant], named.CONSTANTS] = named.NOTHING
    formulas: Annotated[Mapping[str, str], named.FORMULAS] = named.NOTHING
    states: Annotated[Mapping[str, named.State], named.STATES] = named.NOTHING
    tables: Annotated[Mapping[str, named.Table], named.TABLES] = named.NOTHING
    events: Annotated[Mapping[str, named.Event], named.EVENTS] = named.NOTHING

    @property
    def has_formulas(self) -> bool:
        """Return whether loads, states, outputs or events are given as formulas, or numbers for formulas can change.

        Such numbers are the scene's own ports and listed constants, for which no other model has places.
        """
        listed = self.constants.keys() & {*self.inputs.parameters}
        return bool(self.loads.formulas or self.states or self.outputs.own or self.events or self.inputs.own or listed)

    @property
    def own_texts(self) -> tuple[object, ...]:
        """Return the texts from which kernels of formulas are generated, and the constant loads added to formulas."""
        rates = {name: row.rate for name, row in self.states.items()}
        events = {name: (row.when, row.direction) for name, row in self.events.items()}
        own = {name: row.value for name, row in self.outputs.own.items()}
        added = [getattr(self.loads, name) for name in sorted(self.loads.made - {"potential"})]
        return self.loads.formulas, added, self.formulas, self.tables, rates, events, own

    @property
    def own_parameters(self) -> dict[str, Parameter]:
        """Return the scene's own parameters, constants and starts of states, by the keys that set them."""
        return named.parameters(vars(self))

    def _apart(self, data: Mapping[str, object], faults: list[str]) -> Apart:
        return {**data, "ensemble": as_written(data.get("ensemble"), data, faults)}, {}

    def _faults_together(self) -> Iterator[str]:
        good = vars(self)
        if "outputs" in good and "quantities" not in self.outputs._given:
            good["outputs"] = self.outputs._with(quantities=default_quantities(good.get("body"), good.get("inputs")))
        yield from faults_between(good)
        if {"inputs", "constants", "states"} <= good.keys():
            known = (*PARAMETERS, *(row.name for row in self.own_parameters.values()))
            faults: list[str] = []
            checked(names(known).read, self.inputs.parameters, "inputs.parameters", faults)
            yield from faults
        if good.get("ensemble") is not None:
            yield from faults_with(good["ensemble"], good)
            good["ensemble"] = without_idle_shape(good["ensemble"], good.get("body"))
        if {"inputs", "constants", "formulas", "states", "tables"} <= good.keys():  # formulas read their names
            unread = "outputs" not in good
            good |= {name: getattr(type(self), name) for name in self._rules.keys() - good.keys()}
            if self.has_formulas or self.formulas or self.tables or (self.constants and self.body):
                from rbfmu.formulas.check import faults_of_texts  # only if needed, as it loads slowly

                yield from faults_of_texts(self._with_ones(), unread)

    def _with_ones(self) -> Self:
        """Return the scene with ones as numbers: many scenes with the same texts, names and sizes have it in common."""
        ones = {"mass": 1.0, "inertia": (), "r_oc_b": ZERO}
        loads = {name: (1.0 if any(x) else 0.0,) for name, x in self.loads._values().items() if name != "formulas"}
        return self._with(
            **{name: getattr(type(self), name) for name in ("name", "initial", "run", "about")},
            body=self.body and self.body._with(**ones),
            loads=self.loads._with(**loads),
            constants=_ones(self.constants, "value"),
            states=_ones(self.states, "start"),
        )

    @classmethod
    def from_dict(cls, data: Mapping[str, Any], source: str = "scene") -> Self:
        """Return the scene of nested tables as in a file; `source` names it in messages, and is its default name.

        Raises SceneError with all faults.
        """
        with faults_of(source):
            if not isinstance(data, Mapping):
                raise SceneError(fault("scene", data, f"tables {', '.join(SECTIONS)}"))
            return cls.read({"name": Path(source).stem or "scene"} | dict(data))

    def rows(self) -> Iterator[tuple[str, str, str, str]]:
        """Yield key, value, unit and meaning of all values that differ from the defaults."""
        for key in SECTIONS:
            section = getattr(self, key)
            for name, value in section._non_defaults().items() if section is not None else ():
                rule = section._rules[name]
                yield f"{key}.{name}", as_toml(value), getattr(rule, "unit", ""), rule.meaning

    def _repr_html_(self) -> str:
        return table(self.name, ("key", "value", "unit", "meaning"), self.rows())

    def replace(self, changes: Mapping[str, Any] = {}, /, **tables: Any) -> Self:
        """Return a checked scene with other values: `replace({"run.stop": 5.0})` or `replace(run={"stop": 5.0})`.

        The other keys of a table stay, except those of `ensemble.vary`, also where one is given with dots. A section
        (`rbfmu.Body(...)`) replaces the whole table; None removes a table, or an own name (`"states.s"`). A new key
        removes the one that it excludes (omega_b_deg removes omega_b, shape removes inertia). Outputs that were not
        requested by name follow from the new motion. A shape was converted to its inertia when the scene was made, so a
        new mass alone does not change the inertia. Raises SceneError.
        """
        if not isinstance(changes, Mapping):
            raise SceneError(fault("changes", changes, "a mapping from keys to their values"), self.name)
        new = self._values()
        for name, value in _merge(_merge({}, changes), tables).items():
            table = as_lists(new.get(name))
            if name == "outputs" and "quantities" not in self.outputs._given:
                del table["quantities"]
            elif name == "outputs" and isinstance(value, Mapping):
                table["quantities"] = [q for q in table["quantities"] if value.get(q, q) is not None]
            if name == "ensemble" and table and isinstance(value, Mapping) and (table | value)["design"] == "grid":
                del table["runs"]  # it is the number of the grid's points
            new[name] = _with_changes(table, value, SECTIONS.get(name))
        return type(self).from_dict({name: table for name, table in new.items() if table is not None}, self.name)

    def to_dict(self) -> dict[str, Any]:
        """Return nested tables from which `from_dict` makes an equal scene; vectors are lists."""
        omitted = {"about"} if self.about == About() else set()
        return {name: table for name, table in self.table().items() if table != {} and name not in omitted}


SECTIONS: Mapping[str, type[Section]] = {name: rule for name, rule in Scene._rules.items() if isinstance(rule, type)}


def _ones(rows: Mapping[str, named.Entry], field: str) -> named.Named[named.Entry]:
    """Return constants or states with ones for their numbers."""
    return named.Named({name: row._with(**{field: (1.0,) * len(row.numbers)}) for name, row in rows.items()})


def _with_changes(table: Any, value: Any, section: type[Section] | None) -> Any:
    """Return the table with the new keys, and without the keys that these exclude."""
    if not isinstance(value, Mapping) or not isinstance(table, Mapping):
        return value
    keys = section._keys if section else {}  # others are own names, whose unit and meaning stay
    fields = {keys[key][0] for key in value if key in keys}
    kept = {key: x for key, x in table.items() if keys.get(key, (key,))[0] not in fields}
    changed = kept | {key: item if key in keys else _changed_row(kept.get(key), item) for key, item in value.items()}
    return {key: item for key, item in changed.items() if item is not None or key in keys or key not in table}


def _changed_row(row: Any, item: Any) -> Any:
    """Return a new row of a constant, an output, a state or an event, in which the other keys stay."""
    if not isinstance(row, Mapping) or item is None:
        return item
    return {**row, **(item if isinstance(item, Mapping) else {next(iter(row)): item})}


def _merge(tables: Mapping[str, Any], changes: Mapping[str, Any], dotted: bool = True) -> dict[str, Any]:
    """Return tables with changes, whose dotted keys mean nested tables; dots in keys of a nested table stay in them."""
    found = dict(tables)
    for key, value in changes.items():
        first, _, rest = str(key).partition(".") if dotted else (str(key), "", "")
        value, known = {rest: value} if rest else value, found.get(first)
        inside = known if isinstance(known, dict) else {}
        found[first] = _merge(inside, value, bool(rest)) if isinstance(value, Mapping) else value
    return found


def load_scene(path: str | Path) -> Scene:
    """Read a scene file (TOML). Raises SceneError with all faults, TypeError if `path` is no path."""
    path = path_of(path)
    return Scene.from_dict(toml_file.with_description(*toml_file.read_file(path), path.name), source=str(path))


# Contradictions between tables that are each valid by themselves

PRESCRIBED = tuple(row.name for row in OUTPUTS if row.kinematic)
"""Quantities that follow from prescribed rates."""
NEGLIGIBLE = 1e-12
"""The largest relative size of a part of a vector that counts as round-off, as in the kernels."""


def default_quantities(body: Body | None, inputs: Inputs | None) -> tuple[str, ...]:
    """Return the default outputs: all quantities of this motion."""
    if inputs is not None and "omega_b" in inputs.ports:
        return PRESCRIBED
    return tuple(row.name for row in OUTPUTS if not (body is not None and body.pivot and row.of_origin))


def faults_between(good: Mapping[str, Any]) -> Iterator[str]:
    """Yield all contradictions between those sections that are valid by themselves; a missing body is None."""
    inputs, body, initial, loads = (good.get(name) for name in ("inputs", "body", "initial", "loads"))
    if inputs is not None:
        prescribed = "omega_b" in inputs.ports
        if "body" in good and body is None and not prescribed:
            yield 'body is missing: expected a table [body] with mass and inertia (or shape), or ports = ["omega_b"]'
        for name in inputs.parameters:
            if name in inputs.ports:
                yield fault("inputs.parameters", inputs.parameters, f"no {name}: it is an input, by inputs.ports")
            elif loads is not None and name in loads.made:
                yield fault("inputs.parameters", inputs.parameters, f"in place of {name} {named.OF_NUMBERS}")
        if prescribed:
            yield from _faults_of_prescribed_rates(good)
            return
    if body is not None and body.pivot:
        if initial is not None and any(initial.velocity):
            yield fault("initial.velocity", initial.velocity, "zero: the pivot holds o (m/s)")
        if inputs is not None and "velocity_0" in inputs.parameters:
            yield fault("inputs.parameters", inputs.parameters, "no velocity_0: the pivot holds o")
    if body is not None and (axis := body.axis_without_inertia) is not None:
        yield from _faults_of_beam(body, np.array(axis), good)


def _faults_of_prescribed_rates(good: Mapping[str, Any]) -> Iterator[str]:
    inputs, outputs, initial, loads = good["inputs"], good.get("outputs"), good.get("initial"), good.get("loads")
    if len(inputs.ports) > 1:
        yield fault("inputs.ports", inputs.ports, "omega_b alone: it prescribes the rates, so loads have no effect")
    why = "the port omega_b prescribes the rates, and nothing else is modelled"
    if good.get("body") is not None:
        yield f"a table [body] is given: expected none, as {why}"
    if set(inputs.parameters) - {"quaternion_0", "omega_b"}:
        yield fault("inputs.parameters", inputs.parameters, f"quaternion_0 at most: {why}")
    if outputs is not None and set(outputs.quantities) - set(PRESCRIBED):
        yield fault("outputs.quantities", outputs.quantities, f"names out of {', '.join(PRESCRIBED)}: {why}")
    if initial is not None and any(initial.omega_b):
        key, rates = initial.rates_said
        yield fault(key, rates, "zero, or no such key: the port omega_b prescribes the rates")
    for name in sorted({row.name for row in LOADS} - {"gravity_a"}) if loads is not None else ():
        if any(getattr(loads, name)):
            yield fault(f"loads.{name}", getattr(loads, name), f"zero, or no such key: {why}")


def _faults_of_beam(body: Body, axis: Array, good: Mapping[str, Any]) -> Iterator[str]:
    """Yield the faults of a body without inertia about `axis`: a torque about that axis makes the rate unbounded."""
    initial, loads, inputs = (good.get(key) for key in ("initial", "loads", "inputs"))
    about = f"about ({', '.join(f'{x + 0.0:.4g}' for x in axis)}), where inertia is zero to {NEGLIGIBLE:g} of its trace"
    # A force at o has the moment -r x F about the centre of mass of a free body, and no moment about a pivot.
    lever = np.zeros(3) if body.pivot else -np.cross(body.r_oc_b, axis)
    levered = not _is_round_off(lever, np.array(body.r_oc_b))
    if initial is not None and not _is_round_off(axis @ np.array(initial.omega_b), np.array(initial.omega_b)):
        key, rates = initial.rates_said
        yield fault(key, rates, f"no rate {about} ({'deg/s' if key.endswith('_deg') else 'rad/s'})")
    if loads is not None:
        yield from _faults_of_loads(loads, axis, lever, levered, about)
    if inputs is not None:
        for port in inputs.ports:
            if port in TORQUES or levered:
                yield fault("inputs.ports", inputs.ports, f"no {port}: it can act {about}")


def _faults_of_loads(loads: Loads, axis: Array, lever: Array, levered: bool, about: str) -> Iterator[str]:
    if not _is_round_off(axis @ np.array(loads.torque_b), np.array(loads.torque_b)):
        yield fault("loads.torque_b", loads.torque_b, f"no torque {about} (N m)")
    if any(loads.torque_a):
        yield fault("loads.torque_a", loads.torque_a, f"zero, or torque_b: this one can come to act {about} (N m)")
    if levered and not _is_round_off(lever @ np.array(loads.force_b), np.array(loads.force_b) * np.linalg.norm(lever)):
        yield fault("loads.force_b", loads.force_b, f"a force at o without moment {about} (N)")
    if levered and any(loads.force_a):
        yield fault("loads.force_a", loads.force_a, f"zero, or force_b: this one can come to act {about} (N)")
    for load in (row for row in LOADS if row.dissipates):
        coefficients = getattr(loads, load.name)
        damped = np.array(coefficients) * axis
        if not _is_round_off(np.cross(damped, axis), damped):
            yield fault(f"loads.{load.name}", coefficients, f"one that makes no torque {about} ({load.unit})")


def _is_round_off(part: Array, whole: Array) -> bool:
    """Return whether a part of a vector is round-off."""
    return bool(np.linalg.norm(part) <= NEGLIGIBLE * np.linalg.norm(whole))


# Doubts: values that look like a slip

THINNEST = 0.05
"""The least plausible ratio of mass (kg) to the cube of the least radius of gyration (m3).

For a solid ball the ratio is 17 times its density, so this is a 400th of air. The least radius is used, as other radii
of beams and cables are long. Large solar sails have 0.02 to 5, frames in space 50, hulls of ships, asteroids and
planets 1e4. With an inertia in kg cm2 in place of kg m2 it is 1e6 times less: for a compact satellite 0.02.
"""
SMALLEST = 1e-4
"""The smallest plausible radius of gyration, in m."""
PERIODIC = tuple(row.name for row in OUTPUTS if row.error == ANGLE or row.unit == "rad")
"""Quantities that do not show whole turns between two points."""


def warn(scene: Scene, doubts: Iterable[str]) -> None:
    """Issue a SceneWarning for each doubt."""
    for doubt in doubts:
        warn_caller(f"{scene.name}: {doubt}", SceneWarning)


def doubts_before(scene: Scene) -> Iterator[str]:
    """Yield the doubts that a scene raises: those of its body, or more than one turn per step."""
    if scene.body is not None:
        yield from doubts_of(scene.body)
        if scene.body.pivot:
            yield from _doubts_of_pivot(scene)
    yield from _doubts_of_turns(scene, math.hypot(*scene.initial.omega_b), "at the start")


def doubts_after(scene: Scene, motion: Mapping[str, Array]) -> Iterator[str]:
    """Yield the doubts that only the results of a run raise; motion: the results by quantity."""
    found = next((motion[row.name] for row in OUTPUTS if row.unit == "rad/s" and row.name in motion), None)
    if found is not None and not any(_doubts_of_turns(scene, math.hypot(*scene.initial.omega_b), "")):
        yield from _doubts_of_turns(scene, float(np.max(np.linalg.norm(found, axis=1))), "at the fastest")


def doubts_of(body: Body) -> Iterator[str]:
    """Yield the doubt that a body raises: an implausible radius of gyration."""
    moments, _ = principal_axes(body.M_c)
    least, radius = (math.sqrt(max(moment, 0.0) / body.mass) for moment in (moments[0], moments[2]))
    largest = math.cbrt(body.mass / THINNEST)
    if least > largest:
        wrong = f"is at least {least:.3g} m, beyond {largest:.3g} m, where {body.mass:g} kg are thinner than air"
    elif 0.0 < radius < SMALLEST:
        wrong = f"is {radius:.3g} m, below {1e3 * SMALLEST:g} mm"
    else:
        return
    yield f"the body's radius of gyration {wrong}; mass in kg, inertia in kg m2?"


def _doubts_of_pivot(scene: Scene) -> Iterator[str]:
    """Yield a doubt if forces act at o and o is the pivot."""
    loads = (name for name in sorted(FORCES) if name in scene.loads.formulas or any(getattr(scene.loads, name)))
    ports = (f"the port {name}" for name in scene.inputs.ports if name in FORCES)
    forces = [*(f"loads.{name}" for name in loads), *ports]
    if forces:
        held = "no effect, as the pivot holds o, where it acts; at r from there it is a torque, cross(r, force)"
        yield f"{' and '.join(forces)}: {held}"


def _doubts_of_turns(scene: Scene, rate: float, when: str) -> Iterator[str]:
    turns = rate * scene.run.step / (2.0 * math.pi) if scene.run.count > 1 else 0.0  # one step shows its ends
    if turns > 1.0 and (shown := [name for name in scene.outputs.quantities if name in PERIODIC]):
        lost = f"{turns:.3g} turns per communication step {when}, which {' and '.join(shown)} cannot show"
        yield f"run.step = {scene.run.step!r}: {lost}; a turn takes {scene.run.step / turns:.3g} s"


P = ParamSpec("P")
R = TypeVar("R")


@contextmanager
def faults_of(source: str) -> Iterator[None]:
    """Name a source in each SceneError that is raised inside."""
    try:
        yield
    except SceneError as error:
        raise SceneError(error.faults, source) from None


def of_scene_or_path(
    function: Callable[Concatenate[Scene, P], R], name: str = ""
) -> Callable[Concatenate[Scene | str | Path, P], R]:
    """Make a function of a scene accept the path of a scene file as well; it raises TypeError for anything else.

    name: in the error's message, if not the function's own.
    """

    @wraps(function)
    def call(scene: Scene | str | Path, *args: P.args, **kwargs: P.kwargs) -> R:
        if isinstance(scene, str | Path):
            with faults_of(str(scene)):
                return call(load_scene(scene), *args, **kwargs)
        if not isinstance(scene, Scene):
            message = f"{name or function.__name__}: scene = {scene!r}"
            raise TypeError(f"{message:.120}: expected a rbfmu.Scene or the path of a scene file")
        warn(scene, doubts_before(scene))
        return function(scene, *args, **kwargs)

    return call  # type: ignore[return-value]  # scene may also be a keyword
