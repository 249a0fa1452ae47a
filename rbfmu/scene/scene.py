"""The scene: body, initial state, loads, inputs, outputs and run, given in a TOML file or in Python, and checked."""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import wraps
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
from rbfmu.scene.section import Numbers, SceneError, Section, as_toml, fault, line, names, numbers, one_of, positive
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
_PARAMETERS = names(PARAMETERS).means(
    "FMU parameters that an importer will change, so that the plan holds for every value"
)
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

    @classmethod
    def _resolved(cls, data: dict[str, Any], faults: list[str]) -> dict[str, Any]:
        if "attitude" in data:
            try:
                data["quaternion"] = Attitude.read(data.pop("attitude")).q_ab()
            except SceneError as error:
                faults += error.faults
        given = one_of(cls, data, ("omega_b", "omega_b_deg"), faults)
        degrees = data.pop("omega_b_deg", None)
        if given == "omega_b_deg":
            try:
                data["omega_b"] = tuple(map(math.radians, _DEGREES(degrees)))
            except ValueError as error:
                faults.append(fault("initial.omega_b_deg", degrees, str(error)))
        return data

    def __repr_args__(self) -> Iterable[tuple[str | None, Any]]:
        """Return what makes the section again."""
        for name, value in self._set().items():
            yield ("attitude", {name: value}) if name == "quaternion" else (name, value)


class Loads(Section):
    """The known loads; those that are formulas stand in `Scene.load_formulas`, and are zero here."""

    _path: ClassVar[str] = "loads"

    gravity_a: Annotated[Vec3, numbers("gravity_a")] = (0.0, 0.0, -9.81)
    force_a: Annotated[Vec3, numbers("force_a")] = ZERO
    force_b: Annotated[Vec3, numbers("force_b")] = ZERO
    torque_a: Annotated[Vec3, numbers("torque_a")] = ZERO
    torque_b: Annotated[Vec3, numbers("torque_b")] = ZERO
    damping_b: Annotated[Vec3, numbers("damping_b")] = ZERO


class Inputs(Section):
    """The inputs that other FMUs supply, and the parameters that an importer may change."""

    _path: ClassVar[str] = "inputs"

    _spellings: ClassVar[Mapping[str, tuple[str, ...]]] = {"own": ()}

    ports: Annotated[tuple[str, ...], _PORTS] = ()
    parameters: Annotated[tuple[str, ...], _PARAMETERS] = ()
    own: Annotated[Mapping[str, Port], named.PORTS] = NOTHING

    @classmethod
    def read(cls, value: Any) -> Self:
        """Return the section of a table, of whose ports those that are tables are inputs of one's own."""
        ports = value.get("ports") if isinstance(value, Mapping) else None
        if not isinstance(ports, list | tuple) or not any(isinstance(x, Mapping) for x in ports):
            return super().read(value)
        try:
            own = [named.port(x) for x in ports if isinstance(x, Mapping)]
        except ValueError as error:
            raise SceneError(f"inputs.ports: expected {error}") from None
        found = super().read({**value, "ports": [x for x in ports if not isinstance(x, Mapping)]})
        rows = Named({one.name: one for one in own})
        if twice := [one.name for one in own if one is not rows[one.name]]:
            raise SceneError(f"inputs.ports: expected each name once, not twice {twice[0]}")
        return found.model_copy(update={"ports": (*found.ports, *rows), "own": rows})

    def as_written(self) -> dict[str, Any]:
        """Return the table as a file has it."""
        known = [name for name in self.ports if name not in self.own]
        ports = [*known, *named.as_written(self.own).values()]
        return {"ports": ports, "parameters": list(self.parameters)}


class Outputs(Section):
    """The requested output quantities, and those of one's own, which are always shown."""

    _path: ClassVar[str] = "outputs"

    quantities: Annotated[tuple[str, ...], names(QUANTITIES).means("what someone will look at")] = QUANTITIES
    own: Annotated[Mapping[str, Shown], named.OUTPUTS] = NOTHING

    @classmethod
    def read(cls, value: Any) -> Self:
        """Return the section of a table, in which whatever is a table or a text is an output of one's own."""
        if not isinstance(value, Mapping):
            return super().read(value)
        keys = cls._keys()
        shown = {name: item for name, item in value.items() if isinstance(item, Mapping | str) and name not in keys}
        found = {name: item for name, item in value.items() if name not in shown}
        asked = value.get("quantities")
        energies = [name for name in named.ENERGIES if isinstance(asked, list | tuple) and name in asked]
        shown |= {name: {"value": name, "unit": "J", "about": named.ENERGIES[name]} for name in energies}
        if shown:
            found["own"] = {**found.get("own", {}), **shown}
            if isinstance(asked := found.get("quantities"), list | tuple):
                found["quantities"] = [name for name in asked if not isinstance(name, str) or name not in shown]
        return super().read(found)

    def _contradictions(self) -> Iterator[str]:
        if not self.names:
            yield fault("outputs.quantities", self.quantities, f"{self._rule('quantities').words}, at least one")

    @property
    def names(self) -> tuple[str, ...]:
        """Return the names of all that is shown."""
        return (*self.quantities, *self.own)

    def as_written(self) -> dict[str, Any]:
        """Return the table as a file has it."""
        shown = named.as_written(self.own)
        return {"quantities": [*self.quantities, *shown]} | shown


class Run(Section):
    """The run: from start to stop in communication steps."""

    _path: ClassVar[str] = "run"

    start: Annotated[float, Numbers((), "s").means("time at the start")] = 0.0
    stop: Annotated[float, Numbers((), "s").means("time at the end")] = 10.0
    step: Annotated[float, positive("s").means("communication step")] = 0.01
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


_SECTIONS: tuple[type[Section], ...] = (Body, Initial, Loads, Inputs, Outputs, Run, About, Ensemble)
SECTIONS: Mapping[str, type[Section]] = {section._path: section for section in _SECTIONS}
OPTIONAL = ("body", "ensemble")
"""The tables that a scene may do without."""


class Scene(Section):
    """One rigid body and what is known about its run; immutable. An invalid scene raises SceneError with all faults."""

    _spellings: ClassVar[Mapping[str, tuple[str, ...]]] = {"load_formulas": ()}

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
    load_formulas: Annotated[Mapping[str, str], named.FORMULAS] = NOTHING

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

            yield from faults_of_texts(self)

    @classmethod
    def _resolved(cls, data: dict[str, Any], faults: list[str]) -> dict[str, Any]:
        good: dict[str, Any] = {}
        rates = _rates_as_written(data.get("initial"))
        if isinstance(loads := data.get("loads"), Mapping):
            data["loads"], data["load_formulas"] = named.apart(loads)
        data["ensemble"] = as_written(data.get("ensemble"), data, faults)
        data["inputs"], listed = named.listed_apart(data.get("inputs", {}), data)
        for key, section in SECTIONS.items():
            if key in OPTIONAL and data.get(key) is None:
                good[key] = data.pop(key, None)
                continue
            try:
                good[key] = section.read(data.pop(key, {}))
            except SceneError as error:
                faults += error.faults
        if listed and "inputs" in good:
            good["inputs"] = good["inputs"].model_copy(update={"parameters": (*good["inputs"].parameters, *listed)})
        if "outputs" in good and "quantities" not in good["outputs"].model_fields_set:
            default = default_quantities(good.get("body"), good.get("inputs"))
            own = good["outputs"].own
            good["outputs"] = Outputs.model_construct({"own"} if own else set(), quantities=default, own=own)
        faults += faults_between(good, rates)
        if good.get("ensemble") is not None:
            faults += faults_with(good["ensemble"], good)
            good["ensemble"] = without_idle_shape(good["ensemble"], good.get("body"))
        return data | good

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
                rule = type(section)._rule(name)
                yield f"{key}.{name}", as_toml(value), getattr(rule, "unit", ""), rule.meaning

    def _repr_html_(self) -> str:
        return table(self.name, ("key", "value", "unit", "meaning"), self.rows())

    def replace(self, changes: Mapping[str, Any] = MappingProxyType({}), /, **tables: Any) -> Self:
        """Return a checked scene with other values: `replace({"run.stop": 5.0})` or `replace(run={"stop": 5.0})`.

        The other keys of a table stay; a section (`Run(...)`) or None replaces the whole table. A new key removes the
        one that it excludes (omega_b_deg removes omega_b, shape removes inertia). Outputs that were not requested by
        name follow from the new motion. A shape was turned into its inertia when the scene was made, so a new mass
        alone does not change the inertia. Raises SceneError; pydantic's `model_copy(update=...)` checks nothing.
        """
        new = self.to_dict()
        if "quantities" not in self.outputs.model_fields_set:
            del new["outputs"]["quantities"]
        for name, value in as_tables({**changes, **tables}).items():
            new[name] = with_changes(new.get(name), value, SECTIONS.get(name))
        return type(self).from_dict(new, self.name)

    def to_dict(self) -> dict[str, Any]:
        """Return nested tables from which `from_dict` makes an equal scene; vectors are lists."""
        untold = {"about"} if self.about == About() else set()
        untold |= {name for name in ("constants", "formulas", "states", "tables", "events") if not getattr(self, name)}
        tables: dict[str, Any] = self.model_dump(mode="json", exclude_none=True, exclude=untold)
        tables["loads"] |= tables.pop("load_formulas")
        tables |= {"inputs": self.inputs.as_written(), "outputs": self.outputs.as_written()}
        own = {**self._own_tables, "tables": self.tables, "events": self.events}
        tables |= {name: named.as_written(rows) for name, rows in own.items() if rows}
        tables["initial"]["attitude"] = {"quaternion": tables["initial"].pop("quaternion")}
        return tables


def _rates_as_written(initial: Any) -> tuple[str, Any] | None:
    """Return the key and value of initial rates that are given in degrees, or None."""
    given = isinstance(initial, Mapping) and "omega_b_deg" in initial and "omega_b" not in initial
    return ("initial.omega_b_deg", initial["omega_b_deg"]) if given else None


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
