"""One-step methods, and how a user's own is loaded from a file: compiled by Numba, or else run as Python."""

import inspect
import math
import runpy
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from numba import NumbaError, njit

from rbfmu.exceptions import path_of
from rbfmu_kernels.compile.decorator import kernel, named
from rbfmu_kernels.mechanics.equations_of_motion import NO_LOADS, Body, Loads, State
from rbfmu_kernels.rotations.quaternion import normalize

F = TypeVar("F", bound=Callable[..., object])
compiled: Callable[[F], F] = njit(error_model="numpy", nogil=True)
"""Compile a function of states of any form: a method's step, or a loop of steps."""
kept: Callable[[Any], Any] = kernel(inline=False)
"""Compile in the same way, and keep the code on disk."""


Form = Any
"""A state, or its rates, in a method's own form: a tuple. Numba compiles once for each of its types."""


def convert(kind: Callable[..., Form], attitude: Callable[[Any], object]) -> Callable[[Form], Form]:
    """Return a function that converts a state to another kind, and its attitude by the function `attitude`."""
    return lambda state: kind(state[0], state[1], attitude(state[2]), state[3])


_with_unit_quaternion = convert(State, normalize)


Steps = Callable[[Form, float, int, Body, Loads], Form]
"""A function `steps(y, h, n, body, loads)` that takes n steps of size h; all numbers except n are floats."""


@dataclass(frozen=True)
class OneStepMethod:
    """A one-step method.

    order: 0 if it is not known; evaluations: of the right-hand side per step, 0 if their number varies, NaN if it is
    not known; start, state_of: convert a `State` to the method's own form and back; compiler: what compiled `steps`.
    """

    name: str
    steps: Steps
    order: int
    evaluations: float
    start: Callable[[State], Form] = lambda state: state
    state_of: Callable[[Form], State] = _with_unit_quaternion
    compiler: Callable[[Any], Any] = kept

    def run(self, state: State, h: float, n: int, body: Body, loads: Loads) -> State:
        """Return the state after n steps of h."""
        return self.state_of(self.path(state, h, [n], body, loads)[0])

    def path(self, state: State, h: float, counts: Iterable[int], body: Body, loads: Loads = NO_LOADS) -> list[Form]:
        """Return the states, in the method's own form, after the first count of steps of h s, after the second, ..."""
        y = self.start(state)
        return [y := self.steps(y, h, n, body, loads) for n in counts]


def _step(y: Form, h: float, body: Body, loads: Loads) -> Form:
    raise NotImplementedError


def _loop(y: Form, h: float, n: int, body: Body, loads: Loads) -> Form:
    for _ in range(n):
        y = _step(y, h, body, loads)
    return y


def compiled_loop(name: str, step: Callable[[Form, float, Body, Loads], Form], compiler: Any = kept) -> Steps:
    """Return a loop of n steps of a one-step kernel, compiled at the first call."""
    return compiler(named(_loop, f"steps of {name}", _step=step))  # type: ignore[no-any-return]


def of_step(name: str, step: Callable[..., Form], order: int, evaluations: float, *forms: Any) -> OneStepMethod:
    """Return the method of a one-step kernel; forms: `start` and `state_of`, where its states have another form."""
    return OneStepMethod(name, compiled_loop(name, step), order, evaluations, *forms)


# A user's own method


class _Own(OneStepMethod):
    """A method from a user's file; any exception of its step becomes a ValueError that names the method."""

    def path(self, state: State, h: float, counts: Iterable[int], body: Body, loads: Loads = NO_LOADS) -> list[Form]:
        try:
            return super().path(state, h, counts, body, loads)
        except Exception as error:
            raise ValueError(f"{self.name}, a step of {h:g} s: {type(error).__name__}: {error}") from error


EXPECTED = "expected a function step(q, omega, h, body, loads) that returns (q, omega): 4 and 3 finite numbers"
_I = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
_TRIAL = (1.0, 0.0, 0.0, 0.0), (0.3, 1.0, 0.2)


def method_of_file(path: str | Path) -> OneStepMethod:
    """Return the method whose `step` is in a user's file, with the file's name. Raises ValueError if it has none."""
    path = path_of(path)
    try:
        step = runpy.run_path(str(path)).get("step")
        step = getattr(step, "py_func", step)  # compiled as all others are
        if not callable(step) or len(inspect.signature(step).parameters) != 5:
            raise ValueError(f"{EXPECTED}, got {'none' if step is None else step}")
        _check(step(*_TRIAL, 0.01, Body(1.0, _I, _I, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 1.0), NO_LOADS))
    except Exception as error:  # a user's file may raise anything
        kind = "" if type(error) is ValueError else f"{type(error).__name__}: "
        raise ValueError(f"{path}: {kind}{error}") from error
    try:
        name, loop = path.stem, compiled_loop(path.stem, _step_of(compiled(step)), compiled)
        loop(State((0.0,) * 3, (0.0,) * 3, *_TRIAL), 0.01, 1, Body(1.0, _I, _I, (0.0,) * 3, (0.0,) * 3, 1.0), NO_LOADS)
    except (NumbaError, TypeError):  # TypeError: an object that can be called, but is no function
        name, loop = f"{path.stem} (as Python)", _interpreted(step)
    return _Own(name, loop, 0, math.nan, compiler=compiled)


def _check(found: Any) -> None:
    try:
        q, omega = ([float(x) for x in part] for part in found)
        well = (len(q), len(omega)) == (4, 3) and all(map(math.isfinite, q + omega))
    except (TypeError, ValueError):
        well = False
    if not well:
        raise ValueError(f"{EXPECTED}, got {found!r}")


def _step_of(step: Any) -> Any:
    """Return a step of whole states from one that returns (q, omega), arrays or tuples; the centre of mass stays."""

    @compiled
    def step_of_state(state: State, h: float, body: Body, loads: Loads) -> State:
        q, w = step(state.q_ab, state.omega_b, h, body, loads)
        attitude = (float(q[0]), float(q[1]), float(q[2]), float(q[3]))
        return State(state.r_c, state.v_c, attitude, (float(w[0]), float(w[1]), float(w[2])))

    return step_of_state


def _interpreted(step: Callable[..., Any]) -> Steps:
    def loop(state: State, h: float, n: int, body: Body, loads: Loads) -> State:
        q: Any = state.q_ab
        omega: Any = state.omega_b
        try:
            for _ in range(n):
                q, omega = (tuple(map(float, part)) for part in step(q, omega, h, body, loads))
        except ArithmeticError:  # compiled code gives NaN instead
            q, omega = (math.nan,) * 4, (math.nan,) * 3
        return State(state.r_c, state.v_c, q, omega)

    return loop
