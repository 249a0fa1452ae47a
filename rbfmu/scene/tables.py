"""The tables of a scene, except its body, its ensemble and its own names."""

import math
from collections.abc import Iterator, Mapping
from typing import Annotated, Any, ClassVar

import numpy as np

import rbfmu_kernels as kernels
from rbfmu.scene import own as named, section as rules
from rbfmu.scene.body import ZERO
from rbfmu_kernels.compile.tiered import evaluated
from rbfmu_kernels.quantities import IN_BUFFER_ORDER, LOADS, OUTPUT, PORTS
from rbfmu_kernels.rotations import euler_angles
from rbfmu_kernels.types import Array, Matrix, Quaternion, Vec3

PARAMETERS = tuple(row.name for row in IN_BUFFER_ORDER)
QUANTITIES = tuple(OUTPUT)
MAX_STEPS = 1e8
"""The largest number of communication steps of a run; their results take about 20 GB."""


# The attitude at the start, in any representation

UNIT_TOLERANCE = 1e-6
"""The largest deviation of a quaternion's length from 1, or of R R^T from the identity; seven digits suffice."""
LARGEST_ANGLE = 1e9
"""A float resolves a larger angle no finer than 1e-7, so a larger angle must be a mistake."""
NORMALIZED = 8 * 2.0**-52
"""A quaternion whose |q|^2 differs from 1 by no more than this is already normalised, and no bit of it changes."""


def unit_quaternion(q: Quaternion) -> Quaternion:
    """Return the quaternion, normalized. Raises ValueError if its norm is not 1 within UNIT_TOLERANCE."""
    length = math.hypot(*q)
    if length == 0.0:
        raise ValueError("a unit quaternion, not zero")
    if not abs(length - 1.0) <= UNIT_TOLERANCE:
        raise ValueError(f"a unit quaternion to {UNIT_TOLERANCE:g}, not one of length {length:.9g}")
    return normalized(q)


def normalized(q: Quaternion) -> Quaternion:
    """Return q / |q|; a unit quaternion to round-off is unchanged, so that writing and reading it changes no bit."""
    square = q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]
    return q if abs(square - 1.0) <= NORMALIZED else evaluated(kernels.normalize, q)


def rotation_matrix(R: Matrix) -> Matrix:
    """Return the rows of R_ab. Raises ValueError unless R is orthogonal within UNIT_TOLERANCE and right-handed."""
    with np.errstate(all="ignore"):
        error = float(np.max(np.abs(np.array(R) @ np.array(R).T - np.eye(3))))
    if not error <= UNIT_TOLERANCE:
        raise ValueError(f"a rotation matrix: R R^T is off the identity by {error:.2g}, above {UNIT_TOLERANCE:g}")
    if np.linalg.det(np.array(R)) < 0.0:
        raise ValueError("a rotation matrix: the determinant is -1, a reflection")
    return R


def _angles(unit: str, meaning: str) -> rules.Numbers:
    return rules.Numbers((3,), unit, " from -1e9 to 1e9", lambda angle: abs(angle) <= LARGEST_ANGLE).means(meaning)


_EULER = rules.one_word(tuple(euler_angles.NAMES), 'an Euler sequence such as "ZYX" or "xyz"').means(
    'Euler sequence such as "ZYX" (intrinsic) or "xyz" (extrinsic), with angles_deg or angles'
)
_QUATERNION = rules.Numbers((4,), bound=": eta, eps_1, eps_2, eps_3", then=unit_quaternion)
_MATRIX = rules.Numbers((3, 3), then=rotation_matrix)
_IN_ORDER = "Euler angles in the sequence's order"


class Attitude(rules.Section, path="initial.attitude"):
    """The table `initial.attitude`: the attitude in exactly one representation."""

    euler: Annotated[str | None, _EULER] = None
    angles_deg: Annotated[Vec3 | None, _angles("deg", _IN_ORDER)] = None
    angles: Annotated[Vec3 | None, _angles("rad", _IN_ORDER)] = None
    quaternion: Annotated[Quaternion | None, _QUATERNION.means("Euler parameters q_ab, scalar first")] = None
    rotvec: Annotated[Vec3 | None, _angles("rad", "rotation vector: axis times angle")] = None
    matrix: Annotated[Matrix | None, _MATRIX.means("rotation matrix R_ab, by rows")] = None

    def _apart(self, data: Mapping[str, object], faults: list[str]) -> rules.Apart:
        given, known = set(data) - {"angles_deg", "angles"}, set(data) <= self._keys.keys()
        ways = "euler (with angles_deg or angles), quaternion, rotvec or matrix"
        if len(given) != 1 and known:
            faults.append(rules.fault(self._path, data, f"exactly one of {ways}"))
        elif given == {"euler"} and len(data) != 2:
            faults.append(rules.fault(self._path, data, "euler with either angles_deg or angles"))
        elif len(given) == 1 and given != {"euler"} and len(data) != 1:
            faults.append(rules.fault(self._path, data, f"{given.pop()} alone; angles belong to euler"))
        return data, {}

    def q_ab(self) -> Quaternion:
        """Return q_ab."""
        if self.euler is not None:
            x, y, z = self.angles or map(math.radians, self.angles_deg or ())
            return normalized(evaluated(kernels.quaternion_from_euler, euler_angles.sequence(self.euler), (x, y, z)))
        if self.rotvec is not None:
            return normalized(evaluated(kernels.quaternion_from_rotvec, self.rotvec))
        if self.matrix is not None:
            return normalized(evaluated(kernels.quaternion_from_matrix, self.matrix))
        assert self.quaternion is not None
        return self.quaternion


# Other tables

_DEGREES = rules.Numbers((3,), "deg/s", then=lambda rates: tuple(map(math.radians, rates))).means("omega_b in deg/s")
_ATTITUDE = rules.Rule("a table", lambda value: Attitude.read(value).q_ab()).means(
    "a table: initial attitude of the body (b) in space (a)"
)
_PORTS = rules.names(PORTS).means(
    "loads that another unit supplies, added to the known ones; omega_b alone: prescribed rates; your own inputs, "
    "read by formulas: { name, size, unit, start }"
)
_KNOWN = rules.names(PARAMETERS)
_PARAMETERS = rules.Rule(_KNOWN.words, rules.texts, _KNOWN.choice).means(
    "FMU parameters that an importer may change, so that the plan holds for every value; also your constants, and "
    "NAME_0 for the start of a state"
)
_ACCURACY = rules.Numbers((), "", " in (0, 1]", lambda x: 0.0 < x <= 1.0).means(
    "largest error over the run: attitude in rad, rates relative to their largest, position and velocity relative to "
    "theirs, at least 1 m and 1 m/s"
)
_TEXT = rules.line("at most 1000 printable characters", 1000)


class Initial(rules.Section, path="initial"):
    """The initial state; `quaternion` comes from the table `attitude`."""

    _hidden: ClassVar = ("quaternion",)
    _instead: ClassVar = {"attitude": ("quaternion", _ATTITUDE), "omega_b_deg": ("omega_b", _DEGREES)}

    position: Annotated[Vec3, rules.numbers("position_0")] = ZERO
    velocity: Annotated[Vec3, rules.numbers("velocity_0")] = ZERO
    quaternion: Annotated[Quaternion, rules.numbers("quaternion_0")] = (1.0, 0.0, 0.0, 0.0)
    omega_b: Annotated[Vec3, rules.numbers("omega_b_0")] = ZERO

    @property
    def rates_said(self) -> tuple[str, object]:
        """Return the key and the value by which the initial rates were given."""
        key, value = self._given.get("omega_b", ("omega_b", None))
        return f"initial.{key}", self.omega_b if value is None else value

    def _contradictions(self) -> Iterator[str]:
        """Yield a fault if the square of the rate, which energies contain, overflows."""
        if not math.isfinite(sum(x * x for x in self.omega_b)):
            key, rates = self.rates_said
            unit = "deg/s" if key.endswith("_deg") else "rad/s"
            yield rules.fault(key, rates, f"3 numbers whose squares have a finite sum ({unit})")

    def _by_key(self, fields: dict[str, Any]) -> dict[str, Any]:
        q = fields.pop("quaternion", None)
        return fields | ({"attitude": {"quaternion": q}} if q else {})


class Loads(rules.Section, path="loads"):
    """The known loads; those given as formulas are in `formulas`, and zero here."""

    _hidden: ClassVar = ("formulas",)
    _texts: ClassVar = ("potential",)

    gravity_a: Annotated[Vec3, rules.numbers("gravity_a")] = (0.0, 0.0, -9.81)
    force_a: Annotated[Vec3, rules.numbers("force_a")] = ZERO
    force_b: Annotated[Vec3, rules.numbers("force_b")] = ZERO
    torque_a: Annotated[Vec3, rules.numbers("torque_a")] = ZERO
    torque_b: Annotated[Vec3, rules.numbers("torque_b")] = ZERO
    damping_b: Annotated[Vec3, rules.numbers("damping_b")] = ZERO
    formulas: Annotated[Mapping[str, str], named.LOAD_FORMULAS] = named.NOTHING

    @property
    def sizes(self) -> dict[str, float]:
        """Return the Euclidean norm of each load, by name, in the load's unit."""
        return {row.name: math.hypot(*rules.flattened(getattr(self, row.name))) for row in LOADS}

    @property
    def made(self) -> frozenset[str]:
        """Return the names of the loads that formulas set; a potential sets a force and a torque."""
        return frozenset((*self.formulas, *(("force_a", "torque_b") if "potential" in self.formulas else ())))

    def _apart(self, data: Mapping[str, object], faults: list[str]) -> rules.Apart:
        given = {name: data[name] for name in named.LOADS if name in data}
        texts = {name: x for name, x in given.items() if name == "potential" or named.has_text(x)}  # wrong ones as well
        wrong = {name: data[name] for name in ("gravity_a", "damping_b") if named.has_text(data.get(name))}
        expected = f"3 numbers, as formulas make {', '.join(named.LOADS)} alone"
        faults += [rules.fault(f"{self._path}.{name}", text, expected) for name, text in wrong.items()]
        left = {name: value for name, value in data.items() if name not in (*texts, *wrong)}
        return left, {"formulas": texts} if texts else {}


class Inputs(rules.Section, path="inputs"):
    """The inputs that other FMUs supply, and the parameters that an importer may change."""

    _hidden: ClassVar = ("own",)

    ports: Annotated[tuple[str, ...], _PORTS] = ()
    parameters: Annotated[tuple[str, ...], _PARAMETERS] = ()
    own: Annotated[Mapping[str, named.Port], named.PORTS] = named.NOTHING

    def _apart(self, data: Mapping[str, object], faults: list[str]) -> rules.Apart:
        ports = data.get("ports")
        if not isinstance(ports, list | tuple) or not (rows := [x for x in ports if isinstance(x, Mapping)]):
            return data, {}
        paths = [f"inputs.ports.{x}" if isinstance(x := row.get("name"), str) else "inputs.ports" for row in rows]
        read = (rules.checked(named.Port.read, *row, faults) for row in zip(rows, paths, strict=True))
        own = [port for port in read if port]
        if any(port.name == "omega_b" for port in own):  # it is the name of the port that prescribes rates
            faults.append("inputs.ports.omega_b: expected another name: omega_b means something else here")
        found = named.Named({port.name: port for port in own})
        if twice := [port.name for port in own if port is not found[port.name]]:
            faults.append(f"inputs.ports: expected each name once, not twice {twice[0]}")
        vars(self)["_listed"] = [x.get("name") if isinstance(x, Mapping) else x for x in ports]
        return {**data, "ports": [x for x in ports if not isinstance(x, Mapping)]}, {"own": found}

    @property
    def at_start(self) -> str:
        """Return the inputs' values before anything drives them, in words."""
        return "inputs at their start" if any(any(port.start) for port in self.own.values()) else "inputs at zero"

    def _contradictions(self) -> tuple[()]:
        """Insert the scene's own ports in `ports`, in the order of the file, which a controller uses."""
        if listed := vars(self).pop("_listed", []):
            vars(self)["ports"] = tuple(sorted((*self.ports, *self.own), key=listed.index))
        return ()

    def _arguments(self) -> dict[str, object]:
        return {name: tuple(rows) for name, rows in self.table().items() if rows}

    def table(self) -> dict[str, Any]:
        """Return the table as in a file."""
        own = {row["name"]: row for row in rules.as_lists(self.own).values()}
        return {"ports": [own.get(name, name) for name in self.ports], "parameters": list(self.parameters)}


class Outputs(rules.Section, path="outputs"):
    """The requested output quantities, and the scene's own outputs, which are always shown."""

    _hidden: ClassVar = ("own",)
    _texts: ClassVar = ("NAME = a formula",)
    quantities: Annotated[tuple[str, ...], rules.names(QUANTITIES).means("what is shown")] = QUANTITIES
    own: Annotated[Mapping[str, named.Shown], named.OUTPUTS] = named.NOTHING

    def _apart(self, data: Mapping[str, object], faults: list[str]) -> rules.Apart:
        """Separate own outputs, which are tables or texts, and energies that are asked for, from the keys."""
        shown = {name: x for name, x in data.items() if isinstance(x, Mapping | str) and name not in self._keys}
        left = {name: x for name, x in data.items() if name not in shown}
        if isinstance(given := data.get("quantities"), list | tuple):
            asked = [rules.plain(name) for name in given]
            energies = [name for name in named.ENERGIES if name in asked]
            shown |= {name: {"value": name, "unit": "J", "about": named.ENERGIES[name]} for name in energies}
            own = [name for name in asked if isinstance(name, str) and name in shown]
            rules.checked(rules.names(tuple(shown)).read, own, "outputs.quantities", faults)
            left["quantities"] = [name for name in asked if name not in own]
        return left, {"own": shown} if shown else {}

    def _contradictions(self) -> Iterator[str]:
        if not self.names:
            yield rules.fault("outputs.quantities", self.quantities, f"{self._rules['quantities'].words}, at least one")

    @property
    def names(self) -> tuple[str, ...]:
        """Return the names of all outputs."""
        return (*self.quantities, *self.own)

    def table(self) -> dict[str, Any]:
        """Return the table as in a file."""
        return super().table() | {"quantities": [*self.names]}


class Run(rules.Section, path="run"):
    """The run: from start to stop in communication steps."""

    start: Annotated[float, rules.Numbers((), "s").means("time at the start")] = 0.0
    stop: Annotated[float, rules.Numbers((), "s").means("time at the end")] = 10.0
    step: Annotated[float, rules.Numbers((), "s", *rules.POSITIVE).means("communication step")] = 0.01
    accuracy: Annotated[float, _ACCURACY] = 1e-6

    def _contradictions(self) -> Iterator[str]:
        span, resolution = self.stop - self.start, 4.0 * max(math.ulp(self.start), math.ulp(self.stop))
        if not self.stop > self.start:
            yield rules.fault("run.stop", self.stop, f"a time after run.start = {self.start!r} (s)")
        elif not math.isfinite(span):
            yield rules.fault("run.stop", self.stop, "a span from run.start that is a number (s)")
        elif self.step > span + self._round_off(self.stop):
            yield rules.fault("run.step", self.step, f"at most stop - start = {span!r} (s)")
        elif span > MAX_STEPS * self.step:
            yield rules.fault("run.step", self.step, f"at least {span / MAX_STEPS:.2g}: a run has at most 1e8 steps")
        elif self.step < resolution:
            yield rules.fault("run.step", self.step, f"at least {resolution:.2g}, what the clock resolves there (s)")

    # Communication points

    @property
    def count(self) -> int:
        """Return the number of communication steps."""
        return max(math.ceil((self.stop - self.start - self._round_off(self.stop)) / self.step), 1)

    def grid(self) -> Array:
        """Return the communication points (count + 1,): start, start + step, ... stop, the last one within round-off.

        They have the same bits as the points of FMPy, except at times as large as a Unix clock's, where FMPy ends a run
        within 1e-9 of the time itself.
        """
        points: Array = self.start + np.arange(self.count + 1, dtype=np.float64) * self.step
        points[-1] = self.end
        return points

    @property
    def end(self) -> float:
        """Return the last communication point, s."""
        point = self.start + self.count * self.step
        return point if abs(point - self.stop) <= self._round_off(self.stop) else self.stop

    def thinned_steps(self, most: int) -> list[float]:
        """Return the lengths of the steps, s; if there are more than `most`, several steps are combined into one."""
        grid = self.grid()
        stride = math.ceil(self.count / most)
        return list(np.diff(grid if stride == 1 else np.append(grid[:-1:stride], grid[-1])).tolist())

    @property
    def last_time(self) -> float:
        """Return stop plus an importer's round-off, at most a tenth of a step: later times are past the stop."""
        return self.stop + min(1e-9 * max(self.step, abs(self.stop)), 0.1 * self.step)

    def steps_until(self, time: float) -> int:
        """Return how many steps end at or before a time, which may be too small by an importer's round-off."""
        slack = min(self._round_off(time), 0.1 * self.step)
        return math.floor(min((time - self.start + slack) / self.step, 2.0**62))

    def text_of(self, time: float, digits: int = 6) -> str:
        """Return a time of the run, s, with so many digits; with more if it starts late, as by a Unix clock."""
        late = max(abs(self.start), abs(self.stop)) / (self.stop - self.start)
        return f"{time:.{min(digits + math.ceil(math.log10(late)), 16)}g}"

    def _round_off(self, time: float) -> float:
        """Return the round-off, s, of a sum of steps up to a time, and of times of this size."""
        return 1e-9 * (time - self.start) + math.ulp(self.start) + math.ulp(time)


class About(rules.Section, path="about"):
    """The texts that tools show about a scene's FMU."""

    description: Annotated[str, _TEXT.means("what it is; by default the first paragraph of the file's comment")] = ""
    author: Annotated[str, _TEXT.means("who made the scene")] = ""
    version: Annotated[str, _TEXT.means("version of the scene")] = ""
    license: Annotated[str, _TEXT.means("terms under which the scene may be used")] = ""
