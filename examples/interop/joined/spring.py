"""A spring with a damper between points of two bodies, as an FMU made by pythonfmu from this file alone."""

import ctypes
import math

from pythonfmu import Fmi2Causality, Fmi2Slave, Real

ctypes.pythonapi.Py_IncRef(ctypes.py_object(globals()))  # pythonfmu 0.7.0 releases it at every instantiation

STIFFNESS, DAMPING, LENGTH = 2.0, 4.0, 1.0
"""N/m, N s/m, and m at rest."""
ARM_B = (0.0, 0.0, 0.5)
"""From each body's centre of mass to the point that the spring is fastened to, m; the second body's is opposite."""
STATE = {"position": 3, "velocity": 3, "quaternion": 4, "omega_b": 3}
LOADS = {"force_a": 3, "torque_b": 3}


def cross(u, v):
    """Return u x v."""
    return [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]


def rotate(q, v):
    """Return R v for Euler parameters q, or R^T v for those of the inverse."""
    eta, eps = q[0], q[1:]
    turned = cross(eps, v)
    return [a + 2.0 * (eta * b + c) for a, b, c in zip(v, turned, cross(eps, turned), strict=True)]


def spring(first, second):
    """Return the loads (force_a, torque_b) of both bodies from their states, dicts by name."""
    ends = [_end(first, ARM_B), _end(second, [-x for x in ARM_B])]
    apart, closing = ([b - a for a, b in zip(*pair, strict=True)] for pair in zip(*ends, strict=True))
    length = math.sqrt(sum(x * x for x in apart))
    along = [x / length for x in apart]
    pull = STIFFNESS * (length - LENGTH) + DAMPING * sum(a * v for a, v in zip(along, closing, strict=True))
    force = [pull * x for x in along]
    return [_loads(first, ARM_B, force), _loads(second, [-x for x in ARM_B], [-x for x in force])]


def _end(body, arm_b):
    """Return position and velocity of the point."""
    arm = rotate(body["quaternion"], arm_b)
    turning = rotate(body["quaternion"], cross(body["omega_b"], arm_b))
    position = [r + a for r, a in zip(body["position"], arm, strict=True)]
    return position, [v + u for v, u in zip(body["velocity"], turning, strict=True)]


def _loads(body, arm_b, force_a):
    q = body["quaternion"]
    return {"force_a": force_a, "torque_b": cross(arm_b, rotate([q[0], -q[1], -q[2], -q[3]], force_a))}


class Spring(Fmi2Slave):
    """Takes what it sees at the start of a step; its loads stand from the end of that step."""

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.bodies = [{name: [float(name == "quaternion" and k == 0) for k in range(n)] for name, n in STATE.items()}
                       for _ in range(2)]  # fmt: skip
        self.loads = [{name: [0.0] * n for name, n in LOADS.items()} for _ in range(2)]
        for values, causality in ((self.bodies, "input"), (self.loads, "output")):
            for which, body in enumerate(values, 1):
                for name, numbers in body.items():
                    for k in range(len(numbers)):
                        self._register(f"{name}_{which}[{k + 1}]", numbers, k, Fmi2Causality[causality])

    def _register(self, name, numbers, k, causality):
        variable = Real(name, causality=causality, getter=lambda: numbers[k],
                        setter=lambda value: numbers.__setitem__(k, value))  # fmt: skip
        self.register_variable(variable, nested=False)

    def do_step(self, current_time, step_size):
        """Apply the law once."""
        for loads, found in zip(self.loads, spring(*self.bodies), strict=True):
            for name, numbers in found.items():
                loads[name][:] = numbers
        return True
