"""What tools show of a variable besides its value: the kind of quantity, the name of its component, its usual size."""

import math
from collections.abc import Mapping

from rbfmu.models.model_buffer import Buffer, Model
from rbfmu.scene.scene import Scene
from rbfmu_kernels.buffer import OK
from rbfmu_kernels.compile.tiered import tiered
from rbfmu_kernels.quantities import BY_NAME, FORCES, OUTPUT, RELATIVE, TORQUES, Output, Quantity

QUANTITIES = {
    "s": "Time",
    "kg": "Mass",
    "kg m2": "MomentOfInertia",
    "m": "Length",
    "m/s": "Velocity",
    "m/s2": "Acceleration",
    "rad": "Angle",
    "rad/s": "AngularVelocity",
    "rad/s2": "AngularAcceleration",
    "N": "Force",
    "N m": "Torque",
    "N m s/rad": "RotationalDampingConstant",
    "kg m2/s": "AngularMomentum",
    "J": "Energy",
}
"""The quantity that a unit measures, by Modelica's names (Modelica.Units.SI); the unit 1 measures none."""

AXES = ("x", "y", "z")
_EULER_PARAMETERS = ("scalar part", "vector part x", "vector part y", "vector part z")
_INERTIA = {"inertia": 3}
"""Numbers of a block that say its size, where that is not all."""


def components(row: Quantity) -> tuple[str, ...]:
    """Return a word for each number of a quantity: an axis, an angle, a pair of axes; empty for a single number."""
    if row.elements:
        return tuple("".join(AXES[int(k) - 1] for k in pair.split(",")) for pair in row.elements)
    if row.size == 3 and isinstance(row, Output):
        return row.components
    return {1: ("",), 3: AXES, 4: _EULER_PARAMETERS}[row.size]


def meaning(block: str, component: str) -> str:
    """Return the description of a variable."""
    return f"{BY_NAME[block].meaning}: {component}" if component else BY_NAME[block].meaning


def input_sizes(scene: Scene) -> dict[str, float]:
    """Return by port what moves the body well: 1 m/s2 by a force, 1 rad/s2 by a torque; 1 rad/s of prescribed rates."""
    sizes = {"omega_b": 1.0}
    if scene.body is not None:
        moment = max(scene.body.M_c[i][i] for i in range(3))
        sizes |= dict.fromkeys(FORCES, scene.body.mass) | dict.fromkeys(TORQUES, moment)
    return sizes


def nominal_sizes(scene: Scene, kernels: Model, filled: Buffer) -> Mapping[str, float]:
    """Return usual sizes by block, to one digit: of inputs as above, of others at the start; none that is zero there.

    Outputs whose terms cancel, and unit quaternions and angles, have none.
    """
    z = filled.copy()
    sizes: dict[str, float] = {}
    if int(tiered(kernels.initialize)(z)) == OK:
        for name, place in kernels.BLOCKS.items():
            row = BY_NAME.get(name.removeprefix("constant_"))
            if row is not None and (name not in OUTPUT or _has_size(OUTPUT[name])):
                size = math.hypot(*z[place][: _INERTIA.get(name)].tolist())
                sizes[name.removeprefix("constant_")] = max(size, getattr(row, "floor", 0.0))
    sizes |= {port: input_sizes(scene)[port] for port in scene.inputs.ports}
    return {name: float(f"{size:.0e}") for name, size in sizes.items() if 0.0 < size < math.inf}


def _has_size(row: Output) -> bool:
    return row.error == RELATIVE and not row.judged_by and (not row.cancels or row.conserved)
