"""The scene: body, initial state, loads, inputs, outputs and run, given in a TOML file or in Python, and checked."""

import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import cached_property, wraps
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, ClassVar, Concatenate, ParamSpec, Self, TypeVar

from rbfmu.notebook import table
from rbfmu.scene import own as named
from rbfmu.scene.attitude import Attitude
from rbfmu.scene.body import ZERO, Body
from rbfmu.scene.changes import as_tables, with_changes
from rbfmu.scene.consistency import default_quantities, doubts_before, faults_between, warn
from rbfmu.scene.ensemble import Ensemble, as_written, faults_of_own, faults_with, without_idle_shape
from rbfmu.scene.own import Constant, Event, Named, Port, Shown, State, Table

from rbfmu.scene.section import (  # isort: skip
    POSITIVE, Numbers, Rule, SceneError, Section, as_lists, as_toml, checked, fault, line, names, numbers, one_of,
)  # fmt: skip
from rbfmu.scene.toml_file import read_file, with_description
from rbfmu_kernels import quantities
from rbfmu_kernels.types import Quaternion, Vec3

__all__ = ["PARAMETERS", "PORTS", "QUANTITIES", "About", "Body", "Initial", "Inputs", "Loads", "Outputs", "Run",
           "Scene", "SceneError", "load_scene"]  # fmt: skip

PORTS = quantities.PORTS
PARAMETERS = tuple(row.name for row in quantities.IN_BUFFER_ORDER)
QUANTITIES = tuple(quantities.OUTPUT)
MAX_STEPS = 1e8
"""The largest number of communication steps of a run; their results take some 20 GB."""
NOTHING: Mapping[str, Any] = Named()
_IDENTITY = (1.0, 0.0, 0.0, 0.0)
_DEGREES = Numbers((3,), "deg/s")
_NAME = line("1 to 200 printable characters without / and \\", 200, unwanted="/\\")
_PORTS = names(PORTS).means(
    "loads that another unit supplies, added to the known ones; omega_b alone (prescribed rates); inputs of one's own "
    "that formulas read, { name, size, unit, start }"
)
_KNOWN = names(PARAMETERS)
_PARAMETERS = Rule(_KNOWN.words, lambda value: tuple(value) if isinstance(value, list | tuple) else None, _KNOWN.choice)
_ACCURACY = Numbers((), "", " in (0, 1]", lambda x: 0.0 < x <= 1.0).means(
    "largest error over the run: attitude in rad, rates relative to their largest, position and velocity relative to "
    "theirs, at least 1 m and 1 m/s"
)
_TEXT = line("at most 1000 printable characters", 1000)


class Initial(Section):
    """The initial state; `quaternion` comes from the table `attitude`."""

    _path: ClassVar[str] = "initial"
    _spellings: ClassVar[Mapping[str, tuple[str, ...]]] = {
        "quaternion": ("attitude",),
        "omega_b": ("omega_b", "omega_b_deg"),
    }
    _other_keys: ClassVar[Mapping[str, tuple[str, str]]] = {
        "attitude": ("", "a table: initial attitude of the body (b) in space (a)"),
        "omega_b_deg": ("deg/s", "in place of omega_b"),
    }

    position: Annotated[Vec3, numbers("position_0")] = ZERO
    velocity: Annotated[Vec3, numbers("velocity_0")] = ZERO
    quaternion: Annotated[Quaternion, numbers("quaternion_0")] = _IDENTITY
    omega_b: Annotated[Vec3, numbers("omega_b_0")] = ZERO

    def _resolved(self, data: dict[str, Any], faults: list[str]) -> dict[str, Any]:
        if "attitude" in data:
            attitude: Attitude | None = checked(Attitude, data.pop("attitude"), "", faults)
            data |= {"quaternion": attitude.q_ab()} if attitude else {}
        given = one_of(Initial, data, ("omega_b", "omega_b_deg"), faults)
        degrees = data.pop("omega_b_deg", None)
        if given == "omega_b_deg":
            rates: Vec3 | None = checked(_DEGREES, degrees, "initial.omega_b_deg", faults)
            data |= {"omega_b": tuple(map(math.radians, rates))} if rates else {}
            vars(self)["rates_said"] = "initial.omega_b_deg", degrees
        return data

    @cached_property
    def rates_said(self) -> tuple[str, object]:
        """Return the key and the value by which the initial rates were given."""
        return "initial.omega_b", self.omega_b

    def _shown(self) -> dict[str, Any]:
        return dict(("attitude", {k: x}) if k == "quaternion" else (k, x) for k, x in self._set().items())

    def table(self) -> dict[str, Any]:
        """Return the table as a file has it."""
        found = super().table()
        return found | {"attitude": {"quaternion": found.pop("quaternion")}}


class Loads(Section):
    """The known loads; those that are formulas stand in `formulas`, and are zero here."""

    _path: ClassVar[str] = "loads"
    _spellings: ClassVar[Mapping[str, tuple[str, ...]]] = {"formulas": ()}

    gravity_a: Annotated[Vec3, numbers("gravity_a")] = (0.0, 0.0, -9.81)
    force_a: Annotated[Vec3, numbers("force_a")] = ZERO
    force_b: Annotated[Vec3, numbers("force_b")] = ZERO
    torque_a: Annotated[Vec3, numbers("torque_a")] = ZERO
    torque_b: Annotated[Vec3, numbers("torque_b")] = ZERO
    damping_b: Annotated[Vec3, numbers("damping_b")] = ZERO
    formulas: Annotated[Mapping[str, str], named.LOAD_FORMULAS] = NOTHING

    def _apart(self, data: Mapping[str, Any], faults: list[str]) -> tuple[Mapping[str, Any], dict[str, Any]]:
        texts = {name: value for name, value in data.items() if named.is_formula(name, value)}
        return {name: value for name, value in data.items() if name not in texts}, {"formulas": texts} if texts else {}

    def _shown(self) -> dict[str, Any]:
        return {name: x for name, x in self._set().items() if name != "formulas"} | dict(self.formulas)

    def table(self) -> dict[str, Any]:
        """Return the table as a file has it."""
        found = super().table()
        formulas: dict[str, Any] = found.pop("formulas")
        return found | formulas


class Inputs(Section):
    """The inputs that other FMUs supply, and the parameters that an importer may change."""

    _path: ClassVar[str] = "inputs"
    _spellings: ClassVar[Mapping[str, tuple[str, ...]]] = {"own": ()}

    ports: Annotated[tuple[str, ...], _PORTS] = ()
    parameters: Annotated[
        tuple[str, ...],
        _PARAMETERS.means("FMU parameters that an importer will change, so that the plan holds for every value"),
    ] = ()
    own: Annotated[Mapping[str, Port], named.PORTS] = NOTHING

    def _apart(self, data: Mapping[str, Any], faults: list[str]) -> tuple[Mapping[str, Any], dict[str, Any]]:
        ports = data.get("ports")
        if not isinstance(ports, list | tuple) or not (rows := [x for x in ports if isinstance(x, Mapping)]):
            return data, {}
        own = [one for row in rows if (one := checked(named.Port, row, "inputs.ports", faults))]
        found = Named({one.name: one for one in own})
        if twice := [one.name for one in own if one is not found[one.name]]:
            faults.append(f"inputs.ports: expected each name once, not twice {twice[0]}")
        return {**data, "ports": [x for x in ports if not isinstance(x, Mapping)]}, {"own": found}

    def _faults_together(self) -> Iterator[str]:
        """Let the ports have those of one's own among them."""
        if "ports" in vars(self):
            vars(self)["ports"] += tuple(self.own)
        yield from ()

    def table(self) -> dict[str, Any]:
        """Return the table as a file has it."""
        found = super().table()
        own: dict[str, Any] = found.pop("own")
        return found | {"ports": [*(name for name in self.ports if name not in own), *own.values()]}


class Outputs(Section):
    """The requested output quantities, and those of one's own, which are always shown."""

    _path: ClassVar[str] = "outputs"

    _spellings: ClassVar[Mapping[str, tuple[str, ...]]] = {"own": ()}

    quantities: Annotated[tuple[str, ...], names(QUANTITIES).means("what someone will look at")] = QUANTITIES
    own: Annotated[Mapping[str, Shown], named.OUTPUTS] = NOTHING

    def _apart(self, data: Mapping[str, Any], faults: list[str]) -> tuple[Mapping[str, Any], dict[str, Any]]:
        """Return whatever is a table or a text as an output of one's own, and energies that are asked for."""
        shown = {name: x for name, x in data.items() if isinstance(x, Mapping | str) and name not in self._keys}
        left = {name: x for name, x in data.items() if name not in shown}
        if isinstance(asked := data.get("quantities"), list | tuple):
            energies = [name for name in named.ENERGIES if name in asked]
            shown |= {name: {"value": name, "unit": "J", "about": named.ENERGIES[name]} for name in energies}
            left["quantities"] = [name for name in asked if not isinstance(name, str) or name not in shown]
        return left, {"own": shown} if shown else {}

    def _contradictions(self) -> Iterator[str]:
        if not self.names:
            yield fault("outputs.quantities", self.quantities, f"{self._rules['quantities'].words}, at least one")

    @property
    def names(self) -> tuple[str, ...]:
        """Return the names of all that is shown."""
        return (*self.quantities, *self.own)

    def table(self) -> dict[str, Any]:
        """Return the table as a file has it."""
        shown: dict[str, Any] = as_lists(self.own)
        return {"quantities": [*self.quantities, *shown]} | shown


class Run(Section):
    """The run: from start to stop in communication steps."""

    _path: ClassVar[str] = "run"

    start: Annotated[float, Numbers((), "s").means("time at the start")] = 0.0
    stop: Annotated[float, Numbers((), "s").means("time at the end")] = 10.0
    step: Annotated[float, Numbers((), "s", *POSITIVE).means("communication step")] = 0.01
    accuracy: Annotated[float, _ACCURACY] = 1e-6

    def _contradictions(self) -> Iterator[str]:
        span, resolution = self.stop - self.start, 4.0 * max(math.ulp(self.start), math.ulp(self.stop))
        if not self.stop > self.start:
            yield fault("run.stop", self.stop, f"a time after run.start = {self.start!r} (s)")
        elif not math.isfinite(span):
            yield fault("run.stop", self.stop, "a span from run.start that is a number (s)")
        elif self.step > span:
            yield fault("run.step", self.step, f"at most stop - start = {span!r} (s)")
        elif span > MAX_STEPS * self.step:
            yield fault("run.step", self.step, f"at least {span / MAX_STEPS:.2g}: a run has at most 1e8 steps")
        elif self.step < resolution:
            yield fault("run.step", self.step, f"at least {resolution:.2g}, what the clock resolves there (s)")


class About(Section):
    """What tools show of a scene's FMU."""

    _path: ClassVar[str] = "about"

    description: Annotated[str, _TEXT.means("what it is; by default the first paragraph of the file's comment")] = ""
    author: Annotated[str, _TEXT.means("who made the scene")] = ""
    version: Annotated[str, _TEXT.means("version of the scene")] = ""
    license: Annotated[str, _TEXT.means("terms under which the scene may be used")] = ""


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
    constants: Annotated[Mapping[str, Constant], named.CONSTANTS] = NOTHING
    formulas: Annotated[Mapping[str, str], named.FORMULAS] = NOTHING
    states: Annotated[Mapping[str, State], named.STATES] = NOTHING
    tables: Annotated[Mapping[str, Table], named.TABLES] = NOTHING
    events: Annotated[Mapping[str, Event], named.EVENTS] = NOTHING

    @property
    def load_formulas(self) -> Mapping[str, str]:
        """Return the loads that are formulas, by name."""
        return self.loads.formulas

    @property
    def has_formulas(self) -> bool:
        """Return whether loads, states, outputs or events are given as formulas."""
        return bool(self.load_formulas or self.states or self.outputs.own or self.events)

    @property
    def _own_tables(self) -> dict[str, Mapping[str, Constant | State]]:
        return {"constants": self.constants, "states": self.states}

    @property
    def own_parameters(self) -> dict[str, quantities.Parameter]:
        """Return the parameters of one's own, constants and starts of states, by the keys that set them."""
        return named.parameters(self._own_tables)

    def _contradictions(self) -> Iterator[str]:
        if self.ensemble is not None:
            yield from faults_of_own(self.ensemble, self._own_tables)
        if self.has_formulas or self.formulas or self.tables:
            from rbfmu.formulas.check import faults_of_texts  # what has none starts sooner

            yield from faults_of_texts(self._worded())

    def _resolved(self, data: dict[str, Any], faults: list[str]) -> dict[str, Any]:
        return data | {"ensemble": as_written(data.get("ensemble"), data, faults)}

    def _faults_together(self) -> Iterator[str]:
        good = vars(self)
        if "outputs" in good and "quantities" not in self.outputs._given:
            quantities = default_quantities(good.get("body"), good.get("inputs"))
            good["outputs"] = self.outputs._with(quantities=quantities)
        yield from faults_between(good)
        if {"inputs", *self._own_tables} <= good.keys():
            known = (*PARAMETERS, *(row.name for row in self.own_parameters.values()))
            faults: list[str] = []
            checked(names(known), self.inputs.parameters, "inputs.parameters", faults)
            yield from faults
        if good.get("ensemble") is not None:
            yield from faults_with(good["ensemble"], good)
            good["ensemble"] = without_idle_shape(good["ensemble"], good.get("body"))

    def _worded(self) -> Self:
        """Return the scene with the same texts, names and sizes and other numbers, so that many have this one."""
        ones = {"mass": 1.0, "inertia": (), "r_oc_b": ZERO}
        loads = {name: (1.0 if any(x) else 0.0,) for name, x in self.loads._values().items() if name != "formulas"}
        return self._with(
            **{name: getattr(type(self), name) for name in ("name", "initial", "run", "about")},
            body=self.body and self.body._with(**ones),
            loads=self.loads._with(**loads),
            constants=Named({name: one._with(value=(1.0,) * len(one.value)) for name, one in self.constants.items()}),
            states=Named({name: one._with(start=(1.0,) * len(one.start)) for name, one in self.states.items()}),
        )

    @classmethod
    def from_dict(cls, data: Mapping[str, Any], source: str = "scene") -> Self:
        """Return the scene of nested tables as in a file; `source` names it in messages and by default."""
        try:
            if not isinstance(data, Mapping):
                raise SceneError(fault("scene", data, f"tables {', '.join(SECTIONS)}"))
            return cls.read({"name": Path(source).stem or "scene"} | dict(data))
        except SceneError as error:
            raise SceneError(error.faults, source) from None

    def rows(self) -> Iterator[tuple[str, str, str, str]]:
        """Return key, value, unit and meaning of what is not as by default."""
        for key in SECTIONS:
            section = getattr(self, key)
            for name, value in section._set().items() if section is not None else ():
                rule = section._rules[name]
                yield f"{key}.{name}", as_toml(value), rule.unit, rule.meaning

    def _repr_html_(self) -> str:
        return table(self.name, ("key", "value", "unit", "meaning"), self.rows())

    def replace(self, changes: Mapping[str, Any] = MappingProxyType({}), /, **tables: Any) -> Self:
        """Return a checked scene with other values: `replace({"run.stop": 5.0})` or `replace(run={"stop": 5.0})`.

        The other keys of a table stay; a section (`Run(...)`) or None replaces the whole table. A new key removes the
        one that it excludes (omega_b_deg removes omega_b, shape removes inertia). Outputs that were not requested by
        name follow from the new motion. A shape was turned into its inertia when the scene was made, so a new mass
        alone does not change the inertia. Raises SceneError.
        """
        new = self._values()
        for name, value in as_tables({**changes, **tables}).items():
            table = as_lists(new.get(name))
            if name == "outputs" and "quantities" not in self.outputs._given:
                del table["quantities"]
            new[name] = with_changes(table, value, SECTIONS.get(name))
        return type(self).from_dict(new, self.name)

    def to_dict(self) -> dict[str, Any]:
        """Return nested tables from which `from_dict` makes an equal scene; vectors are lists."""
        untold = {"about"} if self.about == About() else set()
        return {name: table for name, table in self.table().items() if table != {} and name not in untold}


SECTIONS: Mapping[str, type[Section]] = {
    name: section for name, section in Scene._rules.items() if isinstance(section, type)
}


def load_scene(path: str | Path) -> Scene:
    """Read a scene file (TOML). Raises SceneError with all that is wrong with it."""
    path = Path(path)
    return Scene.from_dict(with_description(*read_file(path), path.name), source=str(path))


P = ParamSpec("P")
R = TypeVar("R")


@contextmanager
def faults_of(source: str) -> Iterator[None]:
    """Name this source in each SceneError that is raised inside."""
    try:
        yield
    except SceneError as error:
        raise SceneError(error.faults, source) from None


def of_scene_or_path(function: Callable[Concatenate[Scene, P], R]) -> Callable[Concatenate[Scene | str | Path, P], R]:
    """Make a function of a scene accept the path of a scene file as well; it raises TypeError for anything else."""

    @wraps(function)
    def call(scene: Scene | str | Path, *args: P.args, **kwargs: P.kwargs) -> R:
        if isinstance(scene, Scene):
            warn(scene, doubts_before(scene))
            return function(scene, *args, **kwargs)
        if not isinstance(scene, str | Path):
            name = f"{function.__name__}: scene = {scene!r}"
            raise TypeError(f"{name:.120}: expected a rbfmu.Scene or the path of a scene file")
        with faults_of(str(scene)):
            loaded = load_scene(scene)
            warn(loaded, doubts_before(loaded))
            return function(loaded, *args, **kwargs)

    return call  # type: ignore[return-value]  # scene may also be a keyword
