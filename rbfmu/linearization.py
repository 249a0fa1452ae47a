"""The rigid body near a state of its motion: x' = A x + B u, y = C x + D u, exact by the kernels themselves."""

import math
import warnings
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rbfmu.exceptions import SceneWarning
from rbfmu.formulas.dual import Dual, jacobian, variables
from rbfmu.formulas.graph import gradient, numbers_of
from rbfmu.formulas.motion import STATE, by_element
from rbfmu.planning.select import with_all_outputs
from rbfmu.runs.inputs import size_of
from rbfmu.runs.plan import Plan, start_run
from rbfmu.scene.scene import Scene, of_scene_or_path
from rbfmu.simulation import Simulator
from rbfmu.types import Array
from rbfmu_kernels.body.memory import body_of, loads_of, motion_of
from rbfmu_kernels.body.outputs import outputs
from rbfmu_kernels.buffer_access import quaternion_at
from rbfmu_kernels.compile.tiered import evaluated, interpreted
from rbfmu_kernels.mechanics.equations_of_motion import state_rates
from rbfmu_kernels.quantities import TRANSLATION, elements, needing
from rbfmu_kernels.rotations.euler_angles import ZYX, euler_from_quaternion, euler_rate_b
from rbfmu_kernels.rotations.quaternion import compose_quaternions, rotate
from rbfmu_kernels.rotations.vec3 import cross, subtract
from rbfmu_kernels.types import Quaternion

FREE = ("r_c", "v_c", "rotvec_b", "omega_b")
"""Errors of a body's state, three numbers each: the last two where no output shows the path."""


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
    point = _OfFormulas(scene, t, ports) if scene.has_formulas else _of_loads(_at(scene, t, ports), ports)
    n, rates = len(point.names), jacobian(point.rates(), point.count)
    shown = {name: jacobian(point.output(name), point.count) for name in scene.outputs.names}
    inputs_of = [e for name in scene.inputs.ports for e in elements(name, size_of(scene, name))]
    outputs_of = [e for name, rows in shown.items() for e in elements(name, len(rows))]
    C = np.vstack([*shown.values()])
    return Linearization(
        rates[:, :n], rates[:, n:], C[:, :n], C[:, n:], point.names, tuple(inputs_of), tuple(outputs_of), t
    )


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


class _Point:
    """A state and inputs as variables: errors first, then inputs. names: of the errors, that of the attitude too."""

    def __init__(self, names: Sequence[str], q0: Quaternion, inputs: Sequence[float]) -> None:
        self.names, self.q0, self.count = tuple(names), q0, len(names) + len(inputs)
        self.turned = variables((0.0, 0.0, 0.0), self.names.index("rotvec_b[1]"), self.count)
        half = [0.5 * u for u in self.turned]
        self.q_ab = interpreted(compose_quaternions)(q0, (1.0, *half))
        self.inputs = variables(inputs, len(names), self.count)

    def rates(self) -> list[Any]:
        """Return the rates of the errors."""
        raise NotImplementedError

    def output(self, name: str) -> Any:
        """Return a quantity's numbers."""
        return self.roll_pitch_yaw() if name == "rpy" else self.shown(name)

    def shown(self, name: str) -> Any:
        """Return the numbers of a quantity other than rpy."""
        raise NotImplementedError

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


def _of_loads(scene: Scene, ports: dict[str, Any]) -> _Point:
    """Return the start of a scene without formulas."""
    inputs = [x for name in scene.inputs.ports for x in ports.get(name, (0.0, 0.0, 0.0))]
    return _Prescribed(scene, inputs) if scene.body is None else _Loaded(scene, inputs)


def _names(blocks: Iterable[str]) -> list[str]:
    return [element for name in blocks for element in elements(name, 3)]


class _Prescribed(_Point):
    """An attitude under prescribed rates."""

    def __init__(self, scene: Scene, inputs: list[float]) -> None:
        super().__init__(_names(["rotvec_b"]), scene.initial.quaternion, inputs)
        self.rates_now = tuple(inputs)

    def rates(self) -> list[Any]:
        return self.turning(self.rates_now, tuple(self.inputs))

    def shown(self, name: str) -> Any:
        return self.q_ab if name == "quaternion" else interpreted(rotate)(self.q_ab, tuple(self.inputs))


class _Loaded(_Point):
    """A body under loads: a buffer of its model, with variables in the places of state and inputs."""

    def __init__(self, scene: Scene, inputs: list[float]) -> None:
        assert scene.body is not None
        self.moves = not scene.body.pivot and bool(needing(TRANSLATION) & set(scene.outputs.quantities))
        states = FREE if self.moves else FREE[2:]
        super().__init__(_names(states), scene.initial.quaternion, inputs)
        asked = [n for n in scene.outputs.quantities if n != "rpy"] or ["omega_b"]
        full = Plan("body under loads, by series", "", 3 * len(states), order=12)
        self.blocks = full.kernels.BLOCKS
        self.z: list[Any] = start_run(scene.replace({"outputs.quantities": asked}), full).tolist()
        self.omega_0 = tuple(self.z[self.blocks["omega"]])
        self.z[self.blocks["q"]] = self.q_ab
        for k, name in enumerate(states):
            if name != "rotvec_b":
                block = self.blocks["omega" if name == "omega_b" else name]
                self.z[block] = variables(self.z[block], 3 * k, self.count)
        for k, port in enumerate(scene.inputs.ports):
            self.z[self.blocks[port]] = self.inputs[3 * k : 3 * k + 3]
        interpreted(outputs)(self.z)

    def rates(self) -> list[Any]:
        z, motion = self.z, interpreted(motion_of)(self.z)
        rates = interpreted(state_rates)(motion, interpreted(body_of)(z), interpreted(loads_of)(z))
        of_centre = [*rates.r_c, *rates.v_c] if self.moves else []
        return [*of_centre, *self.turning(self.omega_0, motion.omega_b), *rates.omega_b]

    def shown(self, name: str) -> Any:
        return self.z[self.blocks[name]]


class _OfFormulas(_Point):
    """A body with formulas at a time: derivatives on their graph, by its leaves, of which errors change the numbers."""

    def __init__(self, scene: Scene, t: float, ports: dict[str, Any]) -> None:
        from rbfmu.models.formulas import formulas_of  # what has none starts sooner

        simulator, shown = _simulator_at(with_all_outputs(scene), t, ports), formulas_of(scene)
        z, blocks = simulator.buffer(), simulator.plan.kernels.BLOCKS
        assert simulator.plan.formulas is not None
        assert shown is not None
        self.name, self.formulas = scene.name, simulator.plan.formulas
        held = by_element({name: z[block] for name, block in blocks.items()})
        self.known = {element: float(x) for element, x in held} | {"t": t}
        sizes, rates = self.formulas.given.ports, self.formulas.all_rates
        moved = [name for name in _names(["r_c", "v_c"]) if name in shown.rates]
        own = [name for name in rates if name.startswith(STATE) and name in shown.rates]
        inputs = [e for name in scene.inputs.ports for e in elements(name, sizes[name])]
        names = [*moved, *_names(["rotvec_b", "omega_b"]), *(name.removeprefix(STATE) for name in own)]
        super().__init__(names, interpreted(quaternion_at)(z, blocks["q"].start), [self.known[e] for e in inputs])
        self.omega_0 = tuple(z[blocks["omega"]].tolist())
        self.omega = variables(self.omega_0, len(moved) + 3, self.count)
        self.in_space = [rates[name] for name in moved]
        self.turned_by = [rates[name] for name in (*elements("omega", 3), *own)]
        graph = self.formulas.motion.graph
        leaves = [*moved, *elements("q", 4), *elements("omega", 3), *own, *inputs]
        self.leaves = [graph.leaf("input" if name in inputs else "state", name) for name in leaves]
        before = variables([0.0] * len(moved), 0, self.count)
        of_own = variables([0.0] * len(own), len(moved) + 6, self.count)
        self.by_error = jacobian([*before, *self.q_ab, *self.omega, *of_own, *self.inputs], self.count)

    def rates(self) -> list[Any]:
        turning = self.turning(self.omega_0, tuple(self.omega))
        return [*self._of(self.in_space), *turning, *self._of(self.turned_by)]

    def shown(self, name: str) -> Any:
        return self._of([*np.ravel(self.formulas.shown[name])])

    def _of(self, numbers: Sequence[Any]) -> list[Any]:
        """Return what errors make of numbers of the graph; their values are not asked for."""
        rows = [gradient(x, self.leaves) for x in numbers]
        try:
            found = numbers_of(self.formulas.motion.graph, [x for row in rows for x in row], self.known)
        except (ArithmeticError, ValueError):
            found = [math.nan]
        if not np.isfinite(found).all():
            raise ValueError(f"{self.name}: a formula has no finite derivative at t = {self.known['t']!r} s")
        slopes = np.reshape(found, (len(rows), len(self.leaves))) @ self.by_error
        return [Dual(math.nan, row) for row in slopes]
