"""The scene: a body, its start, its loads, inputs, outputs and run, from a TOML file or in Python, checked."""

import math
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self

from rbfmu._scene_attitude import read_attitude
from rbfmu._scene_checks import default_quantities, faults_between
from rbfmu._scene_fields import Name, Names, Numbers, SceneError, fault, positive
from rbfmu._scene_section import Section, one_of
from rbfmu.body import ZERO, Body
from rbfmu_kernels.shapes import Quaternion, Vec3

__all__ = ["PARAMETERS", "PORTS", "QUANTITIES", "Body", "Initial", "Inputs", "Loads", "Outputs", "Run", "Scene",
           "SceneError", "load_scene"]  # fmt: skip

PORTS = ("force_a", "force_b", "torque_a", "torque_b", "omega_b")
PARAMETERS = (
    *("mass", "inertia", "r_oc_b", "gravity_a", "damping_b", "force_a", "force_b", "torque_a", "torque_b"),
    *("position_0", "velocity_0", "quaternion_0", "omega_b_0"),
)
QUANTITIES = (
    *("position", "velocity", "acceleration", "quaternion", "rpy", "omega_b", "omega_a", "alpha_b"),
    *("angular_momentum_a", "kinetic_energy"),
)
MOST_STEPS = 1e8
"""Communication steps of a run: their results take some 20 GB."""
LARGEST_FILE = 1_000_000
"""Bytes; a scene is some hundred."""
_IDENTITY = (1.0, 0.0, 0.0, 0.0)


class Initial(Section):
    """The state at the start.

    position, velocity: of the body's origin o, in a, m and m/s; quaternion: q_ab, unit, from the table `attitude`;
    omega_b: rad/s (or `omega_b_deg`, deg/s).
    """

    _path: ClassVar[str] = "initial"
    _spellings: ClassVar[Mapping[str, tuple[str, ...]]] = {
        "quaternion": ("attitude",),
        "omega_b": ("omega_b", "omega_b_deg"),
    }

    position: Annotated[Vec3, Numbers((3,), "m")] = ZERO
    velocity: Annotated[Vec3, Numbers((3,), "m/s")] = ZERO
    quaternion: Annotated[Quaternion, Numbers((4,), "")] = _IDENTITY
    omega_b: Annotated[Vec3, Numbers((3,), "rad/s")] = ZERO

    @classmethod
    def _resolved(cls, data: dict[str, Any], faults: list[str]) -> dict[str, Any]:
        if "attitude" in data:
            try:
                data["quaternion"] = read_attitude(data.pop("attitude"))
            except SceneError as error:
                faults += error.faults
        given = one_of(cls, data, ("omega_b", "omega_b_deg"), faults)
        degrees = data.pop("omega_b_deg", None)
        if given == "omega_b_deg":
            try:
                data["omega_b"] = tuple(map(math.radians, Numbers((3,), "deg/s")(degrees)))
            except ValueError as error:
                faults.append(fault("initial.omega_b_deg", degrees, str(error)))
        return data


class Loads(Section):
    """Known loads: gravity_a m/s2; forces at o, N; torques about o, N m; the torque -damping_b * omega_b, N m s/rad."""

    _path: ClassVar[str] = "loads"

    gravity_a: Annotated[Vec3, Numbers((3,), "m/s2")] = (0.0, 0.0, -9.81)
    force_a: Annotated[Vec3, Numbers((3,), "N")] = ZERO
    force_b: Annotated[Vec3, Numbers((3,), "N")] = ZERO
    torque_a: Annotated[Vec3, Numbers((3,), "N m")] = ZERO
    torque_b: Annotated[Vec3, Numbers((3,), "N m")] = ZERO
    damping_b: Annotated[Vec3, Numbers((3,), "N m s/rad", " >= 0", lambda x: x >= 0.0)] = ZERO


class Inputs(Section):
    """What others supply: ports, added to the known loads (or the rates), and parameters that they will change."""

    _path: ClassVar[str] = "inputs"

    ports: Annotated[tuple[str, ...], Names(PORTS)] = ()
    parameters: Annotated[tuple[str, ...], Names(PARAMETERS)] = ()


class Outputs(Section):
    """The quantities that someone will look at."""

    _path: ClassVar[str] = "outputs"

    quantities: Annotated[tuple[str, ...], Names(QUANTITIES, least=1)] = QUANTITIES


class Run(Section):
    """From start to stop in communication steps, s; accuracy: the largest error over the run, as a fraction."""

    _path: ClassVar[str] = "run"

    start: Annotated[float, Numbers((), "s")] = 0.0
    stop: Annotated[float, Numbers((), "s")] = 10.0
    step: Annotated[float, positive("s")] = 0.01
    accuracy: Annotated[float, Numbers((), "", " in (0, 1]", lambda x: 0.0 < x <= 1.0)] = 1e-6

    def _contradictions(self) -> Iterator[str]:
        resolution = 4.0 * max(math.ulp(self.start), math.ulp(self.stop))
        if not self.stop > self.start:
            yield fault("run.stop", self.stop, f"a time after run.start = {self.start!r} (s)")
        elif not math.isfinite(self.stop - self.start):
            yield fault("run.stop", self.stop, "a span from run.start that is a number (s)")
        elif self.step > self.stop - self.start:
            yield fault("run.step", self.step, f"at most stop - start = {self.stop - self.start!r} (s)")
        elif self.stop - self.start > MOST_STEPS * self.step:
            yield fault(
                "run.step",
                self.step,
                f"at least {(self.stop - self.start) / MOST_STEPS:.2g}: a run has at most 1e8 steps",
            )
        elif self.step < resolution:
            yield fault("run.step", self.step, f"at least {resolution:.2g}, what the clock resolves there (s)")


_SECTIONS: Mapping[str, type[Section]] = {
    "body": Body,
    "initial": Initial,
    "loads": Loads,
    "inputs": Inputs,
    "outputs": Outputs,
    "run": Run,
}


class Scene(Section):
    """One rigid body and all that is known about its run; immutable. A bad one is a SceneError with all faults."""

    name: Annotated[str, Name()] = "scene"
    body: Body | None = None
    initial: Initial = Initial()
    loads: Loads = Loads()
    inputs: Inputs = Inputs()
    outputs: Outputs = Outputs()
    run: Run = Run()

    @classmethod
    def _resolved(cls, data: dict[str, Any], faults: list[str]) -> dict[str, Any]:
        good: dict[str, Any] = {}
        for key, section in _SECTIONS.items():
            if key == "body" and data.get(key) is None:
                good[key] = data.pop(key, None)
                continue
            try:
                good[key] = section.read(data.pop(key, {}))
            except SceneError as error:
                faults += error.faults
        if "outputs" in good and "quantities" not in good["outputs"].model_fields_set:
            good["outputs"] = Outputs(quantities=default_quantities(good.get("body"), good.get("inputs"), QUANTITIES))
        faults += faults_between(good)
        return data | good

    @classmethod
    def from_dict(cls, data: Mapping[str, Any], source: str = "scene") -> Self:
        """From nested tables as in the file; source: what messages call it, and the name where none is given."""
        try:
            if not isinstance(data, Mapping):
                raise SceneError(fault("scene", data, f"tables {', '.join(_SECTIONS)}"))
            return cls.read({"name": Path(source).stem or "scene"} | dict(data))
        except SceneError as error:
            raise SceneError(error.faults, source) from None

    def to_dict(self) -> dict[str, Any]:
        """Nested tables of which `from_dict` makes an equal scene; lists, so that JSON keeps them as they are."""
        tables: dict[str, Any] = self.model_dump(mode="json", exclude_none=True)
        tables["initial"]["attitude"] = {"quaternion": tables["initial"].pop("quaternion")}
        return tables


def load_scene(path: str | Path) -> Scene:
    """Read a scene file (TOML). Raises SceneError with all that is wrong with it."""
    return Scene.from_dict(_tables(Path(path)), source=str(Path(path)))


def _tables(path: Path) -> dict[str, Any]:
    try:
        with path.open("rb") as file:
            content = file.read(LARGEST_FILE + 1)
        if len(content) > LARGEST_FILE:
            raise SceneError(f"larger than {LARGEST_FILE} bytes: expected a scene in TOML", str(path))
        return tomllib.loads(content.decode("utf-8-sig"))
    except OSError as error:
        raise SceneError(f"cannot be read ({error.strerror}): expected a scene file in TOML", str(path)) from None
    except UnicodeDecodeError:
        raise SceneError("not a text file in UTF-8: expected a scene in TOML", str(path)) from None
    except RecursionError:
        raise SceneError("nested too deeply: expected a scene in TOML", str(path)) from None
    except ValueError as error:
        if isinstance(error, SceneError):
            raise
        raise SceneError(f"not TOML: {error}", str(path)) from None
