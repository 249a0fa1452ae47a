"""A body's motion under inputs that change in pieces, to some 18 digits, by a form that the kernels do not use."""

from scipy.spatial.transform import Rotation

from tests.support.references.formulas_by_eval import Motion

BY_DEGREE = "", " * t", " * (t**2 / 2)"


def true_motion(body, initial, pieces):
    """Quaternion, body rate, position and velocity of o after each piece.

    pieces: (length, inputs), of which each is (value, first, second derivative) at the piece's begin, by its port.
    Gravity is (0, 0, -1).
    """
    q_0 = Rotation.from_rotvec(initial["attitude"]["rotvec"]).as_quat(scalar_first=True).tolist()
    tables = {"body": body, "initial": initial | {"attitude": {"quaternion": q_0}}, "constants": {}, "tables": {}}
    states, found = None, []
    for length, inputs in pieces:
        loads = {port: polynomial(parts) for port, parts in inputs.items()}
        motion = Motion(tables | {"loads": {"gravity_a": [0.0, 0.0, -1.0], "damping_b": [0.0] * 3} | loads})
        motion.y = states or motion.y
        (states,) = motion.states_at(0.0, [motion.number(float(length))])
        position, velocity, _ = motion.place(states)
        found.append([list(map(float, part)) for part in (states[:4], states[4:7], position, velocity)])
    return found


def polynomial(parts):
    """The text of an input whose value and derivatives at t = 0 are given."""
    return " + ".join(f"{list(map(float, part))}{power}" for part, power in zip(parts, BY_DEGREE, strict=True))
