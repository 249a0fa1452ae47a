"""The quantities that a scene may ask for: unit and meaning of each."""

from typing import NamedTuple


class Quantity(NamedTuple):
    """Unit (of numbers without one: 1) and meaning."""

    unit: str
    meaning: str


QUANTITIES = {
    "position": Quantity("m", "position of o, inertial axes"),
    "velocity": Quantity("m/s", "velocity of o, inertial axes"),
    "acceleration": Quantity("m/s2", "acceleration of o, inertial axes"),
    "quaternion": Quantity("1", "Euler parameters q_ab, scalar first"),
    "rpy": Quantity("rad", "roll, pitch, yaw: R_ab = R_z(yaw) R_y(pitch) R_x(roll)"),
    "omega_b": Quantity("rad/s", "angular velocity omega_ab, body axes"),
    "omega_a": Quantity("rad/s", "angular velocity omega_ab, inertial axes"),
    "alpha_b": Quantity("rad/s2", "angular acceleration, body axes"),
    "angular_momentum_a": Quantity(
        "kg m2/s", "angular momentum about the centre of mass (with a pivot: about o), inertial axes"
    ),
    "kinetic_energy": Quantity("J", "kinetic energy"),
}
TIME = Quantity("s", "time")
