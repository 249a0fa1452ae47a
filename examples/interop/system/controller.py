"""A PD controller of attitude as an FMU, made by pythonfmu from this file alone."""

import ctypes

from pythonfmu import Fmi2Causality, Fmi2Slave, Real

ctypes.pythonapi.Py_IncRef(ctypes.py_object(globals()))  # pythonfmu 0.7.0 releases it at every instantiation

STIFFNESS, DAMPING = 0.4, 1.2
"""N m per unit of eps, N m s/rad."""


def control(q_ab: list[float], omega_b: list[float]) -> list[float]:
    """Torque against the rotation vector's direction, by the shorter way, and against the rates."""
    stiffness = STIFFNESS if q_ab[0] >= 0.0 else -STIFFNESS
    return [-stiffness * eps - DAMPING * omega for eps, omega in zip(q_ab[1:], omega_b, strict=True)]


class Controller(Fmi2Slave):
    """Takes what it sees at the start of a step; its torque stands from the end of that step."""

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.quaternion, self.omega_b, self.torque_b = [1.0, 0.0, 0.0, 0.0], [0.0] * 3, [0.0] * 3
        for name, causality in (("quaternion", "input"), ("omega_b", "input"), ("torque_b", "output")):
            for k in range(len(getattr(self, name))):
                self._register(name, k, Fmi2Causality[causality])

    def _register(self, name: str, k: int, causality: Fmi2Causality) -> None:
        values = getattr(self, name)
        variable = Real(f"{name}[{k + 1}]", causality=causality, getter=lambda: values[k],
                        setter=lambda value: values.__setitem__(k, value))  # fmt: skip
        self.register_variable(variable, nested=False)

    def do_step(self, current_time: float, step_size: float) -> bool:
        """Apply the law once."""
        self.torque_b[:] = control(self.quaternion, self.omega_b)
        return True
