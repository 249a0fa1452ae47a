"""What drives the ports of an ensemble's members: tables of inputs, and a compiled controller with noise."""

import hashlib
import pickle
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from numbers import Integral
from types import CodeType, FunctionType, MethodType, ModuleType
from typing import Any

import numpy as np
from numba import NumbaError, njit

from rbfmu.ensembles import draws, loops, members, variables
from rbfmu.models.model_buffer import places_of
from rbfmu.runs.inputs import HOLD, InputTable, InputTables, drive_of, input_tables, size_of
from rbfmu.runs.plan import Plan, start_run
from rbfmu.scene.scene import Scene, SceneError
from rbfmu.types import Array, Indices
from rbfmu_kernels.body.members import Driving
from rbfmu_kernels.body.shell import Model
from rbfmu_kernels.compile.decorator import kernel
from rbfmu_kernels.quantities import elements
from rbfmu_kernels.types import python_function

STREAM = "controller"
"""The name of the random stream of the noise; no varying number has this name."""
VERSIONED = ("cmath", "math", "numba", "numpy", "rbfmu", "rbfmu_kernels", "scipy")
"""Packages whose functions a digest knows by their names alone."""


@dataclass(frozen=True)
class Controller:
    """A function that sets the ports of each member at each communication point: f(t, outputs, state, inputs, noise).

    function: compiled by `@njit`, or one that Numba can compile. t: the time, s. outputs: the numbers of the scene's
    quantities, then of its own outputs, in the scene's order. state: the member's own numbers, which the function may
    change; they begin with the values given here. inputs: the present numbers of the scene's ports, in the scene's
    order; what the function writes there is held until the next point. noise: independent numbers of the standard
    normal distribution, new at each point; the `noise` given here is how many. Raises ValueError for wrong arguments.
    """

    function: Callable[..., None]
    state: Sequence[float] = ()
    noise: int = 0

    def __post_init__(self) -> None:
        if not callable(self.function):
            raise ValueError(f"controller = {self.function!r}: expected a function {EXPECTED}")
        try:
            start = np.array(self.state, dtype=np.float64)
        except (TypeError, ValueError):
            start = np.array(np.nan)
        if start.ndim != 1 or not np.isfinite(start).all():
            raise ValueError(f"controller: state = {self.state!r}: expected finite numbers in one row")
        if not isinstance(self.noise, Integral) or isinstance(self.noise, bool) or self.noise < 0:
            raise ValueError(f"controller: noise = {self.noise!r}: expected how many numbers it takes at a time")
        if not hasattr(self.function, "py_func"):
            object.__setattr__(self, "function", njit(boundscheck=True)(self.function))
        object.__setattr__(self, "state", tuple(start.tolist()))

    def noise_of(self, seed: int, number: int, steps: int) -> Array:
        """Return the noise (steps, n) of a member, a row for each communication step; it depends on seed and number."""
        stream = np.random.Philox(key=draws.key_of(seed, STREAM), counter=np.array([0, number, 0, 0], dtype=np.uint64))
        return np.random.Generator(stream).standard_normal((steps, self.noise))

    def compiled(self) -> Callable[..., None]:
        """Return the function, compiled for `loops.run_members`. Raises an error of Numba if it cannot be compiled."""
        if hasattr(self.function, "compile"):  # not where the JIT is disabled
            self.function.compile(loops.CONTROLLED)
        return self.function


@kernel(inline=False)  # its code is kept on disk: compiling it took half a second of each process
def _leave(t: float, outputs: Any, state: Any, inputs: Any, noise: Any) -> None:
    """Leave inputs as they are."""


NONE = Controller(_leave)
EXPECTED = "f(t, outputs, state, inputs, noise) that writes to inputs and returns nothing"


@dataclass(frozen=True)
class Control:
    """What drives all members. inputs: tables for all, or a function of a member's number that returns its tables.

    interpolate: between the times of the tables, "hold" or "linear". parts: the number of equal steps into which each
    communication step is cut.
    """

    inputs: InputTables | Callable[[int], Any]
    controller: Controller | None
    interpolate: str = HOLD
    parts: int = 1

    @property
    def identity(self) -> dict[str, str | None]:
        """Return digests of inputs and controller, on which the members' bits depend."""
        controller = self.controller
        parts = (controller.function, controller.state, controller.noise) if controller else None
        given = digest((self.inputs, self.interpolate)) if self.inputs else None
        return {"inputs": given, "controller": digest(parts) if parts else None}

    def numbers(self, scene: Scene) -> int:
        """Return how many input and noise numbers each member has of its own for a communication step."""
        tables = sum(size_of(scene, port) for port in scene.inputs.ports) if callable(self.inputs) else 0
        return tables + (self.controller.noise if self.controller else 0)

    def tables_of(self, scene: Scene, number: int, *, told: bool = True) -> InputTables:
        """Return a member's tables; told: without doubts. Raises SceneError that names the member if they are wrong."""
        if not callable(self.inputs):
            return self.inputs
        try:
            return input_tables(scene, self.inputs(number), self.interpolate, told=told)
        except SceneError as error:
            raise SceneError(error.faults, f"{scene.name}, member {number}") from None


NOTHING = Control({}, None)
"""The control of members that nothing drives."""


def control_of(scene: Scene, plan: Plan, inputs: Any, controller: Any, interpolate: str = HOLD) -> Control:
    """Return the control of an ensemble, NOTHING if nothing drives it.

    Raises SceneError and ValueError for wrong inputs or a controller that cannot run.
    """
    tables = inputs if callable(inputs) else input_tables(scene, inputs, interpolate)
    if inputs is None and controller is None:
        return NOTHING
    if interpolate != HOLD and not all(f"{port}_rate" in plan.kernels.BLOCKS for port in scene.inputs.ports):
        why = f"as the model {plan.model!r} takes no input derivatives"
        raise SceneError(f"interpolate = {interpolate!r}: expected {HOLD!r}, {why}", scene.name)
    given = controller if controller is None or isinstance(controller, Controller) else Controller(controller)
    found = Control(tables, given, interpolate)
    found.tables_of(scene, 0, told=False)  # one member's doubts stand for all
    if given is not None:
        _try_out(scene, plan, given)
    return found


def _try_out(scene: Scene, plan: Plan, controller: Controller) -> None:
    """Call a controller once in plain Python, where a wrong index is an error, and compile it. Raises SceneError."""
    blocks, z = plan.kernels.BLOCKS, start_run(scene, plan)
    outputs, inputs = z[variables.columns_of(scene).places(blocks)], z[_places(scene, blocks)]
    noise, state = controller.noise_of(members.ensemble_of(scene).seed, 0, 1)[0], np.array(controller.state)
    sizes = f"{len(outputs)} outputs, {len(state)} of state, {len(inputs)} inputs and {len(noise)} of noise"
    if not scene.inputs.ports:
        raise SceneError("a controller is given: expected none, as the scene has no ports", scene.name)
    try:
        with np.errstate(all="ignore"):
            given = python_function(controller.function)(scene.run.start, outputs, state, inputs, noise)
        if given is not None:
            raise TypeError(f"it returned {given!r}")
        controller.compiled()
    except (ArithmeticError, IndexError, NumbaError, TypeError, ValueError) as error:
        raise _controller_error(scene, error, f", of {sizes}") from error


@contextmanager
def errors_named(scene: Scene, control: Control) -> Iterator[None]:
    """Turn an error that the controller raises while members run into a SceneError that names the controller."""
    try:
        yield
    except (ArithmeticError, IndexError, ValueError) as error:
        if control.controller is None:
            raise
        raise _controller_error(scene, error) from None


def _controller_error(scene: Scene, error: Exception, sizes: str = "") -> SceneError:
    message = f"controller: {type(error).__name__}: {str(error).strip()}: expected {EXPECTED}{sizes}"
    return SceneError(message, scene.name)


def _places(scene: Scene, blocks: dict[str, slice], ending: str = "") -> Indices:
    return places_of(blocks, [f"{port}{ending}" for port in scene.inputs.ports])


def driven_members(
    control: Control, scene: Scene, kernels: Model, numbers: Sequence[int]
) -> tuple[Callable[..., None], Driving]:
    """Return the compiled controller, and the inputs and noise of the members with these numbers.

    Raises SceneError if the table of one is wrong.
    """
    each = numbers if callable(control.inputs) else numbers[:1]
    start, ports = scene.run.grid()[:1], scene.inputs.ports
    none = {port: InputTable(start, np.full((1, size_of(scene, port)), np.nan)) for port in ports}
    tables = (none | control.tables_of(scene, number) for number in each)
    drives = [drive_of(scene, given, control.interpolate, control.parts) for given in tables]
    before = np.cumsum([0, *(len(drive.lengths) for drive in drives[:-1])])
    counts = np.array([first + drive.counts for first, drive in zip(before, drives, strict=True)])
    parts = ((drive.lengths, drive.values, drive.slopes, drive.at_row) for drive in drives)
    lengths, given, slopes, at_row = map(np.concatenate, zip(*parts, strict=True))
    slopes[np.isnan(given)] = 0.0  # of ports without a table
    if control.controller:  # where a row of another port cuts a step, a port keeps what the controller wrote
        at_row[counts[:, :-1]] = 1.0
        given[at_row == 0.0] = np.nan
    controller, time = control.controller or NONE, drives[0].time
    noise = np.empty((len(numbers), len(time) - 1, controller.noise))
    for i, number in enumerate(numbers if controller.noise else ()):
        noise[i] = controller.noise_of(members.ensemble_of(scene).seed, number, len(time) - 1)
    state, places = np.array(controller.state), _places(scene, kernels.BLOCKS)
    rates = _places(scene, kernels.BLOCKS, "_rate") if slopes.any() else np.empty(0, dtype=np.int64)
    return controller.compiled(), Driving(places, rates, time, lengths, counts, given, slopes, state, noise)


def wrong_input(scene: Scene, end: Sequence[int]) -> str:
    """Return the message for a member whose controller gave a number that is not finite; end: see `body.members`."""
    names = [name for port in scene.inputs.ports for name in elements(port, size_of(scene, port))]
    time = scene.run.grid()[end[1]]
    return f"{scene.name}: the controller gave {names[-1 - end[0]]} at t = {float(time)!r} s: expected a finite number"


def digest(value: Any) -> str:
    """Return a digest of numbers, or of a function: of its code, and recursively of all that the code names.

    Raises ValueError if a part cannot be pickled.
    """
    found = hashlib.blake2b(digest_size=8)
    try:
        for part in _parts(value, set()):
            found.update(part)
    except (AttributeError, TypeError, pickle.PicklingError) as error:
        expected = "numbers and functions, or what can be pickled, by which a store knows it"
        raise ValueError(f"what drives the ports: {error}: expected {expected}") from None
    return found.hexdigest()


def _parts(value: Any, seen: set[Any]) -> Iterator[bytes]:
    function = python_function(value)
    if isinstance(function, FunctionType):
        if function in seen:
            return
        seen.add(function)
        yield from _parts((function.__code__, function.__defaults__, function.__kwdefaults__), seen)
        for named in _named_values(_names_in(function.__code__), function.__globals__):
            yield from _parts(named, seen)
        for cell in function.__closure__ or ():
            yield from _parts(cell.cell_contents, seen)
    elif isinstance(value, partial):
        yield from _parts((value.func, value.args, value.keywords), seen)
    elif isinstance(value, MethodType):
        yield from _parts((value.__func__, value.__self__), seen)
    elif isinstance(value, CodeType):
        yield value.co_code
        yield from _parts((value.co_consts, value.co_names), seen)
    elif isinstance(value, dict | frozenset | list | set | tuple):
        parts = value.items() if isinstance(value, dict) else value
        for part in sorted(parts, key=repr) if isinstance(value, frozenset | set) else parts:
            yield from _parts(part, seen)
    else:
        yield value.__name__.encode() if isinstance(value, ModuleType) else pickle.dumps(value)


def _named_values(names: set[str], known: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Yield what code names, also inside the modules that it names, except those of VERSIONED packages."""
    for name in sorted(names & known.keys()):
        yield name, known[name]
        if isinstance(known[name], ModuleType) and known[name].__name__.partition(".")[0] not in VERSIONED:
            yield from _named_values(names - {name}, vars(known[name]))


def _names_in(code: CodeType) -> set[str]:
    return {*code.co_names}.union(*(_names_in(part) for part in code.co_consts if isinstance(part, CodeType)))
