"""One-step methods in common use, with which the charts and stability laws compare; they are no part of the product.

Each integrates the right-hand sides of `rbfmu_kernels.mechanics.equations_of_motion` with its tuples `State`, `Body`
and `Loads`, but may represent the attitude in another form. `OneStepMethod.start` converts a state to that form,
`steps` advances it by any number of steps (so that drift accumulates as it does for users), and `state_of` converts it
back, with a unit quaternion.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from numba import njit

from rbfmu.studies.reference_methods import attitude_forms as _forms
from rbfmu.studies.reference_methods import one_step as _one
from rbfmu.studies.reference_methods.moser_veselov import moser_veselov
from rbfmu_kernels.mechanics.equations_of_motion import Body, Loads, State

Steps = Callable[[Any, float, int, Body, Loads], Any]
"""A function `steps(y, h, n, body, loads)` that takes n steps of size h; all numbers except n are floats."""


@dataclass(frozen=True)
class OneStepMethod:
    """A one-step method, its order, and its evaluations of the right-hand side per step (0 if their number varies)."""

    name: str
    steps: Steps
    order: int
    evaluations: int
    start: Callable[[State], Any] = field(default=_forms.as_it_is)
    state_of: Callable[[Any], State] = field(default=_forms.with_unit_quaternion)

    def run(self, state: State, h: float, n: int, body: Body, loads: Loads) -> State:
        """Return the state after n steps of h."""
        return self.state_of(self.steps(self.start(state), h, n, body, loads))


def compiled_loop(step: Callable[[Any, float, Body, Loads], Any]) -> Steps:
    """Return a loop of n steps of a one-step kernel, compiled at the first call."""

    @njit(error_model="numpy", nogil=True)  # type: ignore[untyped-decorator]
    def loop(y: Any, h: float, n: int, body: Body, loads: Loads) -> Any:
        for _ in range(n):
            y = step(y, h, body, loads)
        return y

    return loop  # type: ignore[no-any-return]


_MATRIX, _ANGLES = (_forms.with_matrix, _forms.from_matrix), (_forms.with_angles, _forms.from_angles)
_ALL = (
    OneStepMethod("explicit Euler", compiled_loop(_one.explicit_euler_step), 1, 1),
    OneStepMethod("semi-implicit Euler", compiled_loop(_one.semi_implicit_euler_step), 1, 1),
    OneStepMethod("implicit midpoint", compiled_loop(_one.implicit_midpoint_step), 2, 0),
    OneStepMethod("RK4, quaternion", compiled_loop(_one.rk4_step), 4, 4),
    OneStepMethod("RK4, quaternion not normalised", compiled_loop(_one.rk4_not_normalised_step), 4, 4),
    OneStepMethod("RK4, matrix", compiled_loop(_one.rk4_matrix_step), 4, 4, *_MATRIX),
    OneStepMethod("RK4, Euler angles", compiled_loop(_one.rk4_angles_step), 4, 4, *_ANGLES),
    OneStepMethod("RKMK4", compiled_loop(_one.rkmk4_step), 4, 4),
    OneStepMethod("CF4", compiled_loop(_one.cf4_step), 4, 4),
)
_FREE = (
    OneStepMethod("Moser-Veselov", moser_veselov(2), 2, 0),
    OneStepMethod("Moser-Veselov, order 10", moser_veselov(10), 10, 0),
)
REFERENCE_INTEGRATORS = {integrator.name: integrator for integrator in _ALL}
"""The methods for any body and any loads, by name."""
TORQUE_FREE_INTEGRATORS = {integrator.name: integrator for integrator in _FREE}
"""The methods for bodies in principal axes without loads or damping, by name."""
