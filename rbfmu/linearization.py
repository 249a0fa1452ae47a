"""The rigid body near a state of its motion: x' = A x + B u, y = C x + D u, exact by the kernels themselves."""

import math
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rbfmu.exceptions import SceneWarning
from rbfmu.formulas.graph import gradient, numbers_of
from rbfmu.formulas.motion import STATE, by_element
from rbfmu.planning.select import with_all_outputs
from rbfmu.runs.plan import Plan, start_run
from rbfmu.scene.scene import Scene, of_scene_or_path
from rbfmu.simulation import Simulator
from rbfmu_kernels.body.memory import body_of, loads_of, motion_of
from rbfmu_kernels.body.outputs import outputs
from rbfmu_kernels.buffer_access import quaternion_at
from rbfmu_kernels.compile.tiered import evaluated, interpreted
from rbfmu_kernels.mechanics.equations_of_motion import state_rates
from rbfmu_kernels.quantities import BY_NAME, OUTPUT, TRANSLATION, elements, indices, needing
from rbfmu_kernels.rotations.euler_angles import ZYX, euler_from_quaternion, euler_rate_b
from rbfmu_kernels.rotations.quaternion import compose_quaternions, rotate
from rbfmu_kernels.rotations.vec3 import cross, skew, subtract
from rbfmu_kernels.types import Quaternion

Array = NDArray[np.float64]


class Dual:
    """A number, and its derivatives with respect to some variables; what is added and multiplied has them as well."""

    __slots__ = ("gradient", "value")

    def __init__(self, value: float, gradient: Array) -> None:
        self.value, self.gradient = value, gradient

    def __add__(self, other: Any) -> "Dual":
        if isinstance(other, Dual):
            return Dual(self.value + other.value, self.gradient + other.gradient)
        return Dual(self.value + other, self.gradient)

    __radd__ = __add__

    def __neg__(self) -> "Dual":
        return Dual(-self.value, -self.gradient)

    def __sub__(self, other: Any) -> "Dual":
        return self.__add__(-other)

    def __rsub__(self, other: Any) -> "Dual":
        return self.__neg__().__add__(other)

    def __mul__(self, other: Any) -> "Dual":
        if isinstance(other, Dual):
            return Dual(self.value * other.value, self.value * other.gradient + other.value * self.gradient)
        return Dual(self.value * other, other * self.gradient)

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> "Dual":
        if isinstance(other, Dual):
            return self * other.__rtruediv__(1.0)
        return Dual(self.value / other, self.gradient / other)

    def __rtruediv__(self, other: float) -> "Dual":
        quotient = other / self.value
        return Dual(quotient, self.gradient * (-quotient / self.value))

    def __gt__(self, other: Any) -> bool:
        return self.value > (other.value if isinstance(other, Dual) else other)

    def __lt__(self, other: Any) -> bool:
        return self.value < (other.value if isinstance(other, Dual) else other)

    def __eq__(self, other: object) -> bool:
        """Return whether it is that number and stays so: what a kernel leaves out as zero must not begin to change."""
        return self.value == other and not self.gradient.any()

    __hash__ = None  # type: ignore[assignment]


def variables(values: Sequence[float], first: int, count: int) -> list[Any]:
    """Return numbers that are variables themselves, from number `first` of `count` on."""
    return [Dual(float(x), np.eye(1, count, first + k)[0]) for k, x in enumerate(values)]


def jacobian(numbers: Sequence[Any], count: int) -> Array:
    """Return the derivatives of numbers, a row each; those of a plain number are zero."""
    return np.array([x.gradient if isinstance(x, Dual) else np.zeros(count) for x in numbers]).reshape(-1, count)


FREE = ("r_c", "v_c", "rotvec_b", "omega_b")
"""Errors of a body's state, three numbers each: the last two where no output shows the path, the third alone of rates
that are prescribed."""


@dataclass(frozen=True, eq=False, repr=False)
class Linearization:
    """What `linearize` gives: A (n, n), B (n, m), C (p, n), D (p, m), as which it also unpacks; SI units.

    states: the errors' names, see `linearize`; inputs, outputs: variables, by the FMU's names; time: s.
    """

    A: Array
    B: Array
    C: Array
    D: Array
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    time: float

    def __repr__(self) -> str:
        n, m, p = len(self.states), len(self.inputs), len(self.outputs)
        shapes = f"A {(n, n)}, B {(n, m)}, C {(p, n)}, D {(p, m)}"
        named = "; ".join(
            f"{what} {', '.join(dict.fromkeys(name.partition('[')[0] for name in names)) or 'none'}"
            for what, names in (("states", self.states), ("inputs", self.inputs), ("outputs", self.outputs))
        )
        return f"Linearization(t = {self.time:g} s: {shapes}; {named})"

    def __iter__(self) -> Iterator[Array]:
        return iter((self.A, self.B, self.C, self.D))


@of_scene_or_path
def linearize(scene: Scene, /, t: float | None = None, **ports: Any) -> Linearization:
    """Return the linear system of small errors about a scene's motion at time t (s), by default its start.

    Errors, in this order: r_c and v_c, of the centre of mass in a (m, m/s; where an output shows them); rotvec_b, the
    rotation vector u in b (rad) of the attitude's error, q_ab = q_ab(t) exp(u/2); omega_b (rad/s). Of prescribed rates,
    rotvec_b alone; of a scene with formulas the states of its own besides, after these. Their rates are those along the
    motion: a body that turns carries u with it.

    ports: inputs at t by name, held from the start to t; as at first without. Outputs are the scene's. The matrices are
    derivatives of the kernels' own formulas, and of the scene's, to round-off; at a corner they are those of the side
    where the motion is. The state at t is as accurate as the scene asks.
    Raises SceneError, SimulationError, ValueError for a time outside the run, a wrong input, rpy at pitch 90 deg, or a
    formula without a finite derivative.
    """
    run = scene.run
    t = run.start if t is None else float(t)
    if not run.start <= t <= run.stop:
        raise ValueError(f"t = {t!r}: expected a time from run.start = {run.start!r} to run.stop = {run.stop!r} (s)")
    if scene.has_formulas:
        return _of_formulas(scene, t, ports)
    now = _at(scene, t, ports)
    inputs = [x for name in scene.inputs.ports for x in ports.get(name, (0.0, 0.0, 0.0))]
    point = _Prescribed(now, inputs) if scene.body is None else _Loaded(now, inputs)
    names = tuple(f"{name}[{k}]" for name in point.states for k in (1, 2, 3))
    n, rates = len(names), jacobian(point.rates(), point.count)
    shown = np.vstack([jacobian(point.output(name), point.count) for name in scene.outputs.quantities])
    inputs_of = tuple(f"{name}{index}" for name in scene.inputs.ports for index in indices(BY_NAME[name]))
    outputs_of = tuple(f"{name}{index}" for name in scene.outputs.quantities for index in indices(OUTPUT[name]))
    return Linearization(rates[:, :n], rates[:, n:], shown[:, :n], shown[:, n:], names, inputs_of, outputs_of, t)


def _simulator_at(scene: Scene, t: float, ports: dict[str, Any]) -> Simulator:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SceneWarning)  # of quantities that nobody asked for; the scene's own are told
        simulator = Simulator(scene)
    if t > scene.run.start:
        simulator.step(t - scene.run.start, **ports)
    else:
        simulator.hold(**ports)
    return simulator


def _at(scene: Scene, t: float, ports: dict[str, Any]) -> Scene:
    """Return the scene that begins where this one is at time t."""
    wanted = ("quaternion",) if scene.body is None else ("position", "velocity", "quaternion", "omega_b")
    simulator = _simulator_at(scene.replace({"outputs.quantities": wanted}), t, ports)
    initial = {name: getattr(simulator, name).tolist() for name in wanted}
    if scene.body is not None and scene.body.pivot:
        del initial["position"], initial["velocity"]
    attitude = {"attitude": {"quaternion": initial.pop("quaternion")}}
    return scene.replace({f"initial.{name}": value for name, value in (initial | attitude).items()})


def _of_formulas(scene: Scene, t: float, ports: dict[str, Any]) -> Linearization:
    """Return what `linearize` does, of a scene with formulas: derivatives on their graph, by its leaves."""
    from rbfmu.models.formulas import formulas_of  # what has none starts sooner

    simulator, small = _simulator_at(with_all_outputs(scene), t, ports), formulas_of(scene)
    formulas, z, blocks = simulator.plan.formulas, simulator.numbers, simulator.plan.kernels.BLOCKS
    assert formulas is not None
    assert small is not None
    kept = [name for name, _ in by_element({"r_c": [0] * 3, "v_c": [0] * 3}) if name in small.rates]
    own = [name for name in formulas.all_rates if name.startswith(STATE) and name in small.rates]
    inputs = [e for name in scene.inputs.ports for e in elements(name, formulas.given.ports[name])]
    q, omega = elements("q", 4), elements("omega", 3)
    leaves = [*kept, *q, *omega, *own, *inputs]
    before = len(kept)  # errors before that of the attitude, which has three for the four numbers of q
    count, point = len(leaves) - 1, interpreted(quaternion_at)(z, blocks["q"].start)
    turned = variables((0.0, 0.0, 0.0), before, count)
    by_error = np.zeros((len(leaves), count))
    half = (1.0, *(0.5 * u for u in turned))
    by_error[before : before + 4] = jacobian(interpreted(compose_quaternions)(point, half), count)
    others = [k for k in range(len(leaves)) if not before <= k < before + 4]
    by_error[others, [k if k < before else k - 1 for k in others]] = 1.0
    known = {element: float(x) for name, block in blocks.items() for element, x in by_element({name: z[block]})}
    known["t"] = t
    graph = formulas.motion.graph
    symbols = [graph.leaf("input" if name in inputs else "state", name) for name in leaves]

    def slopes(numbers: Sequence[Any]) -> Array:
        rows = [gradient(x, symbols) for x in numbers]
        try:
            found = numbers_of(graph, [x for row in rows for x in row], known)
        except (ArithmeticError, ValueError):
            found = [math.nan]
        if not np.isfinite(found).all():
            raise ValueError(f"{scene.name}: a formula has no finite derivative at t = {t!r} s")
        return np.reshape(found, (len(rows), len(leaves))) @ by_error

    spin = tuple(z[blocks["omega"]].tolist())
    turning = np.zeros((3, count))  # omega - omega_0 - omega_0 x rotvec_b
    turning[:, before + 3 : before + 6] = np.eye(3)
    turning[:, before : before + 3] = -np.array(interpreted(skew)(spin))
    rates = formulas.all_rates
    A = np.vstack([slopes([rates[n] for n in kept]), turning, slopes([rates[n] for n in (*omega, *own)])])
    shown = [_shown(formulas, name, slopes, point, by_error[before : before + 4]) for name in scene.outputs.names]
    n = count - len(inputs)
    own_names = [name.removeprefix(STATE) for name in own]
    states = (*kept, *elements("rotvec_b", 3), *elements("omega_b", 3), *own_names)
    outputs_of = [e for name, rows in zip(scene.outputs.names, shown, strict=True) for e in elements(name, len(rows))]
    C = np.vstack(shown)
    return Linearization(A[:, :n], A[:, n:], C[:, :n], C[:, n:], states, tuple(inputs), tuple(outputs_of), t)


def _shown(formulas: Any, name: str, slopes: Any, q: Quaternion, turns: Array) -> Array:
    """Return the derivatives of an output; of roll, pitch and yaw by way of the turn."""
    if name != "rpy":
        return slopes(np.ravel(formulas.shown[name]))  # type: ignore[no-any-return]
    angles = evaluated(euler_from_quaternion, ZYX, q)
    by_turn = [jacobian(interpreted(euler_rate_b)(ZYX, angles, tuple(variables((0.0,) * 3, 0, 3)))[::-1], 3)]
    if not np.all(np.abs(by_turn[0]) < 0.25 / np.finfo(float).eps):
        raise ValueError("rpy has no derivative at pitch 90 deg: expected outputs without rpy")
    place = np.flatnonzero(turns.any(axis=0))
    found = np.zeros((3, turns.shape[1]))
    found[:, place] = by_turn[0]
    return found


class _Point:
    """A state and inputs as variables: errors first, then inputs."""

    states: tuple[str, ...] = FREE

    def __init__(self, scene: Scene, inputs: list[float]) -> None:
        self.count = 3 * len(self.states) + len(inputs)
        self.q0 = scene.initial.quaternion
        self.turned = variables((0.0, 0.0, 0.0), 3 * self.states.index("rotvec_b"), self.count)
        half = [0.5 * u for u in self.turned]
        self.q_ab = interpreted(compose_quaternions)(self.q0, (1.0, *half))
        self.inputs = variables(inputs, 3 * len(self.states), self.count)

    def turning(self, omega_0: Any, omega: Any) -> list[Any]:
        """Return the rate of rotvec_b to first order: omega - omega_0 - omega_0 x rotvec_b."""
        less, carried = interpreted(subtract), interpreted(cross)(omega_0, tuple(self.turned))
        return [*less(less(omega, omega_0), carried)]

    def roll_pitch_yaw(self) -> list[Any]:
        """Return what an error of the attitude makes of rpy; raise ValueError at its pole, as `euler_rate_b` warns."""
        angles = evaluated(euler_from_quaternion, ZYX, self.q0)
        yaw, pitch, roll = interpreted(euler_rate_b)(ZYX, angles, tuple(self.turned))
        if not np.all(np.abs(jacobian((roll, pitch, yaw), self.count)) < 0.25 / np.finfo(float).eps):
            raise ValueError("rpy has no derivative at pitch 90 deg: expected outputs without rpy")
        return [roll, pitch, yaw]


class _Prescribed(_Point):
    """An attitude under prescribed rates."""

    states = ("rotvec_b",)

    def __init__(self, scene: Scene, inputs: list[float]) -> None:
        super().__init__(scene, inputs)
        self.rates_now = tuple(inputs)

    def rates(self) -> list[Any]:
        """Return the rates of the errors."""
        return self.turning(self.rates_now, tuple(self.inputs))

    def output(self, name: str) -> Any:
        """Return a quantity's numbers."""
        if name == "rpy":
            return self.roll_pitch_yaw()
        return self.q_ab if name == "quaternion" else interpreted(rotate)(self.q_ab, tuple(self.inputs))


class _Loaded(_Point):
    """A body under loads: a buffer of its model, with variables in the places of state and inputs."""

    def __init__(self, scene: Scene, inputs: list[float]) -> None:
        assert scene.body is not None
        moves = not scene.body.pivot and needing(TRANSLATION) & set(scene.outputs.quantities)
        self.states = FREE if moves else FREE[2:]
        super().__init__(scene, inputs)
        shown = scene.replace(
            {"outputs.quantities": [n for n in scene.outputs.quantities if n != "rpy"] or ["omega_b"]}
        )
        full = Plan("body under loads, by series", "", 3 * len(self.states), order=12)
        self.blocks = full.kernels.BLOCKS
        self.z: list[Any] = start_run(shown, full).tolist()
        self.omega_0 = tuple(self.z[self.blocks["omega"]])
        self.z[self.blocks["q"]] = self.q_ab
        for k, name in enumerate(self.states):
            if name != "rotvec_b":
                block = self.blocks["omega" if name == "omega_b" else name]
                self.z[block] = variables(self.z[block], 3 * k, self.count)
        for k, port in enumerate(scene.inputs.ports):
            self.z[self.blocks[port]] = self.inputs[3 * k : 3 * k + 3]
        interpreted(outputs)(self.z)

    def rates(self) -> list[Any]:
        """Return the rates of the errors."""
        z, motion = self.z, interpreted(motion_of)(self.z)
        rates = interpreted(state_rates)(motion, interpreted(body_of)(z), interpreted(loads_of)(z))
        of_centre = [] if "r_c" not in self.states else [*rates.r_c, *rates.v_c]
        return [*of_centre, *self.turning(self.omega_0, motion.omega_b), *rates.omega_b]

    def output(self, name: str) -> Any:
        """Return a quantity's numbers."""
        return self.roll_pitch_yaw() if name == "rpy" else self.z[self.blocks[name]]
