"""One row for each parameter, load, initial value and output, from which all else about them follows.

The layout of the models' buffers, the keys, units and checks of a scene, the variables of an FMU with their bounds and
dependencies, the labels of plots and what planning must know of a quantity are made from these rows. A new quantity is
a new row, and the kernels that compute with it. This module needs neither Numba nor NumPy.
"""

import math
from collections.abc import Collection
from typing import NamedTuple

Bounds = tuple[tuple[float | None, float | None], ...]
ANY: Bounds = ((None, None),)
"""Bounds are given once for all elements, or for each of them; None sets no bound."""
NOT_NEGATIVE: Bounds = ((0.0, None),)
_UNIT_INTERVAL: Bounds = ((-1.0 - 2.0**-50, 1.0 + 2.0**-50),)
"""A normalised quaternion's component may pass 1 by round-off."""
_TURN: Bounds = ((-math.pi, math.pi), (-math.pi / 2, math.pi / 2), (-math.pi, math.pi))
_MATRIX: Bounds = NOT_NEGATIVE * 3 + ANY * 3


class Unit(NamedTuple):
    """What a unit measures, its exponents of the SI base units, and units in which tools may show a number.

    quantity: Modelica's name for it (Modelica.Units.SI), empty for the unit 1; display: (name, factor), usual one
    first.
    """

    quantity: str
    exponents: dict[str, int]
    display: tuple[tuple[str, float], ...] = ()


DEGREES = 180.0 / math.pi
UNITS: dict[str, Unit] = {
    "1": Unit("", {}),
    "s": Unit("Time", {"s": 1}),
    "kg": Unit("Mass", {"kg": 1}),
    "kg m2": Unit("MomentOfInertia", {"kg": 1, "m": 2}),
    "m": Unit("Length", {"m": 1}),
    "m/s": Unit("Velocity", {"m": 1, "s": -1}),
    "m/s2": Unit("Acceleration", {"m": 1, "s": -2}),
    "rad": Unit("Angle", {"rad": 1}, (("deg", DEGREES),)),
    "rad/s": Unit("AngularVelocity", {"rad": 1, "s": -1}, (("deg/s", DEGREES), ("rpm", 30.0 / math.pi))),
    "rad/s2": Unit("AngularAcceleration", {"rad": 1, "s": -2}, (("deg/s2", DEGREES),)),
    "N": Unit("Force", {"kg": 1, "m": 1, "s": -2}),
    "N m": Unit("Torque", {"kg": 1, "m": 2, "s": -2}),
    "N m s/rad": Unit("RotationalDampingConstant", {"kg": 1, "m": 2, "s": -1, "rad": -1}),
    "kg m2/s": Unit("AngularMomentum", {"kg": 1, "m": 2, "s": -1}),
    "J": Unit("Energy", {"kg": 1, "m": 2, "s": -2}),
}


class Parameter(NamedTuple):
    """A constant of the body, or its state at the start.

    positive: zero is refused; grows: positions, velocities, accelerations and energy grow with it; elements: names of
    its numbers, if they are not counted from 1; own_block: the name of its block in a buffer, if it is another one.
    """

    name: str
    size: int
    unit: str
    meaning: str
    bounds: Bounds = ANY
    positive: bool = False
    grows: bool = False
    elements: tuple[str, ...] = ()
    own_block: str = ""

    @property
    def block(self) -> str:
        """Return the name of its block in a buffer."""
        return self.own_block or self.name


WEIGHT, FORCE, TORQUE = "weight", "force", "torque"
"""Kinds of load: a force at the centre of mass, a force at the body's origin, or a torque."""


class Load(NamedTuple):
    """A load: a parameter, and an input too if it is a port.

    frame: a (fixed in space) or b (fixed in the body); dissipates: it takes energy from the motion, and is no input;
    in_closed_forms: models with a closed form know it; those are not used for a body on which any other load acts.
    """

    name: str
    unit: str
    meaning: str
    frame: str
    kind: str
    port: bool = True
    dissipates: bool = False
    in_closed_forms: bool = False
    size: int = 3
    bounds: Bounds = ANY
    elements: tuple[str, ...] = ()

    @property
    def grows(self) -> bool:
        """Return whether positions, velocities, accelerations and energy grow with it."""
        return self.kind in (WEIGHT, FORCE)

    @property
    def block(self) -> str:
        """Return the name of its constant part in a buffer; a port's own name is that of the input."""
        return f"constant_{self.name}" if self.port else self.name


TRANSLATION, PATH, ATTITUDE, RATE, LEVER_RATE, LOADS_NOW, BODY_AXES, SPHERE_RATE = NEEDS = (
    "position or velocity of the centre of mass",
    "path of a point: the attitude too, where it is beside the centre of mass or a force turns with the body",
    "attitude",
    "body rate",
    "body rate, where the point is beside the centre of mass",
    "loads of the same instant",
    "attitude, or vectors along the body's axes: the angular momentum in space alone does not tell them",
    "body rate: the angular momentum in space tells it of a sphere alone",
)
"""What an output may need of a model."""

RELATIVE, ANGLE = "relative", "angle"
"""How an error is measured: relative to the largest size in the run, or as the angle between two attitudes, rad."""


class Output(NamedTuple):
    """A quantity of the motion that a body shows.

    needs: what it needs of a model; initially: parameters on which it depends at the start; label, components: names in
    plots. kinematic: it follows from prescribed rates; port: it may itself be prescribed; of_origin: constant with a
    pivot; conserved: constant without torque; cancels: a sum of terms that may cancel. error: how error is measured;
    floor: the least size to which that is relative; judged_by: the output whose error counts in its place.
    """

    name: str
    size: int
    unit: str
    meaning: str
    label: str
    needs: tuple[str, ...]
    initially: tuple[str, ...]
    components: tuple[str, ...] = ("x", "y", "z")
    bounds: Bounds = ANY
    kinematic: bool = False
    port: bool = False
    of_origin: bool = False
    conserved: bool = False
    cancels: bool = False
    error: str = RELATIVE
    floor: float = 0.0
    judged_by: str = ""
    elements: tuple[str, ...] = ()

    @property
    def feedthrough(self) -> tuple[str, ...]:
        """Return the inputs whose change changes it at once."""
        return (*(_LOAD_PORTS if LOADS_NOW in self.needs else ()), *(_RATE_PORTS if RATE in self.needs else ()))


PARAMETERS = (
    Parameter("mass", 1, "kg", "mass", NOT_NEGATIVE, positive=True, grows=True),
    Parameter("inertia", 6, "kg m2", "inertia matrix about the centre of mass, body axes", _MATRIX,
              elements=("1,1", "2,2", "3,3", "1,2", "1,3", "2,3")),
    Parameter("r_oc_b", 3, "m", "from the origin o to the centre of mass, body axes"),
)  # fmt: skip

LOADS = (
    Load("gravity_a", "m/s2", "gravity, inertial axes", "a", WEIGHT, port=False, in_closed_forms=True),
    Load("force_a", "N", "force at o, inertial axes", "a", FORCE, in_closed_forms=True),
    Load("force_b", "N", "force at o, body axes", "b", FORCE, in_closed_forms=True),
    Load("torque_a", "N m", "torque about o, inertial axes", "a", TORQUE, in_closed_forms=True),
    Load("torque_b", "N m", "torque about o, body axes", "b", TORQUE, in_closed_forms=True),
    Load("damping_b", "N m s/rad", "damping: torque -damping_b * omega_b, body axes", "b", TORQUE, port=False,
         dissipates=True, in_closed_forms=True, bounds=NOT_NEGATIVE),
)  # fmt: skip

INITIAL_VALUES = (
    Parameter("position_0", 3, "m", "initial position of o, inertial axes", grows=True),
    Parameter("velocity_0", 3, "m/s", "initial velocity of o, inertial axes", grows=True),
    Parameter("quaternion_0", 4, "1", "initial Euler parameters q_ab, scalar first; normalised at initialisation"),
    Parameter("omega_b_0", 3, "rad/s", "initial angular velocity omega_ab, body axes"),
)

_LOAD_PORTS = tuple(load.name for load in LOADS if load.port)
_BODY = ("mass", "inertia", "r_oc_b")
_ROTATION = ("quaternion_0", "omega_b_0")
_NEWTON_EULER = (*_BODY, *_ROTATION, *(load.name for load in LOADS))

OUTPUTS = (
    Output("position", 3, "m", "position of o, inertial axes", "position of o",
           (TRANSLATION, PATH), ("position_0",), of_origin=True, floor=1.0),
    Output("velocity", 3, "m/s", "velocity of o, inertial axes", "velocity of o",
           (TRANSLATION, PATH, LEVER_RATE), ("velocity_0",), of_origin=True, floor=1.0),
    Output("acceleration", 3, "m/s2", "acceleration of o, inertial axes", "acceleration of o",
           (PATH, LEVER_RATE, LOADS_NOW), _NEWTON_EULER, of_origin=True, cancels=True),
    Output("quaternion", 4, "1", "Euler parameters q_ab, scalar first", "Euler parameters",
           (ATTITUDE, BODY_AXES), ("quaternion_0",), components=("η", "ε₁", "ε₂", "ε₃"), bounds=_UNIT_INTERVAL,
           kinematic=True, error=ANGLE),
    Output("rpy", 3, "rad", "roll, pitch, yaw: R_ab = R_z(yaw) R_y(pitch) R_x(roll)", "roll, pitch, yaw",
           (ATTITUDE, BODY_AXES), ("quaternion_0",), components=("roll", "pitch", "yaw"), bounds=_TURN,
           kinematic=True, judged_by="quaternion"),
    Output("omega_b", 3, "rad/s", "angular velocity omega_ab, body axes", "body rates",
           (RATE, BODY_AXES), ("omega_b_0",), port=True),
    Output("omega_a", 3, "rad/s", "angular velocity omega_ab, inertial axes", "rates, inertial axes",
           (ATTITUDE, RATE, SPHERE_RATE), ("omega_b_0", "quaternion_0"), kinematic=True),
    Output("alpha_b", 3, "rad/s2", "angular acceleration, body axes", "angular acceleration",
           (RATE, LOADS_NOW, BODY_AXES), _NEWTON_EULER, cancels=True),
    Output("angular_momentum_a", 3, "kg m2/s",
           "angular momentum about the centre of mass (with a pivot: about o), inertial axes", "angular momentum",
           (ATTITUDE, RATE), (*_BODY, *_ROTATION), conserved=True, cancels=True),
    Output("kinetic_energy", 1, "J", "kinetic energy", "kinetic energy",
           (TRANSLATION, PATH, RATE, SPHERE_RATE), (*_BODY, "velocity_0", *_ROTATION), components=("",),
           bounds=NOT_NEGATIVE, conserved=True, cancels=True),
)  # fmt: skip

FORCES, TORQUES, WEIGHTS = (
    frozenset(load.name for load in LOADS if load.kind == kind) for kind in (FORCE, TORQUE, WEIGHT)
)
NOT_IN_CLOSED_FORMS = frozenset(load.name for load in LOADS if not load.in_closed_forms)
BOUNDED = tuple(load for load in LOADS if load.bounds == NOT_NEGATIVE)
"""Loads that must not be negative."""
DISSIPATIVE = frozenset(load.name for load in LOADS if load.dissipates)
FIXED_IN_SPACE = frozenset(load.name for load in LOADS if load.frame == "a")
TIME = Parameter("time", 1, "s", "time")

Quantity = Parameter | Load | Output
BY_NAME: dict[str, Quantity] = {row.name: row for row in (*PARAMETERS, *LOADS, *INITIAL_VALUES, *OUTPUTS)}
"""Every quantity by its name in scenes and FMUs."""
OUTPUT: dict[str, Output] = {row.name: row for row in OUTPUTS}
IN_BUFFER_ORDER: tuple[Parameter | Load, ...] = (
    *PARAMETERS,
    *(load for load in LOADS if not load.port),
    *(load for load in LOADS if load.port),
    *INITIAL_VALUES,
)
"""Parameters, loads and initial values as they follow each other in a buffer and in messages."""
_RATE_PORTS = tuple(row.name for row in OUTPUTS if row.port)
PORTS = (*_LOAD_PORTS, *_RATE_PORTS)


def own_output(name: str, size: int, unit: str, meaning: str) -> Output:
    """Return the row of an output of your own."""
    components = ("x", "y", "z") if size > 1 else ("",)
    return Output(name, size, unit or "1", meaning or name, name, (), (), components=components)


def indices(row: Quantity) -> tuple[str, ...]:
    """Return what follows the name of each number of a quantity, by FMI's structured naming, such as [1]."""
    if row.size == 1:
        return ("",)
    return tuple(f"[{element}]" for element in row.elements or range(1, row.size + 1))


def elements(name: str, size: int) -> list[str]:
    """Return the names of a vector's numbers, counted from 1; a scalar's name is unchanged."""
    return [name] if size == 1 else [f"{name}[{i + 1}]" for i in range(size)]


def needing(*needs: str) -> frozenset[str]:
    """Return the names of the outputs with one of the needs."""
    return frozenset(row.name for row in OUTPUTS if set(needs) & set(row.needs))


_NEEDING = [needing(need) for need in NEEDS]


def active_flags(names: Collection[str]) -> list[float]:
    """Return the block `active` of a buffer that computes the named outputs: a flag for each output, then each need."""
    outputs = [float(row.name in names) for row in OUTPUTS]
    return outputs + [float(not known.isdisjoint(names)) for known in _NEEDING]
