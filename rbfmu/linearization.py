"""The rigid body near a state of its motion: x' = A x + B u, y = C x + D u, exact by the kernels themselves."""

import math
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from rbfmu.exceptions import SceneWarning
from rbfmu.formulas.dual import Dual, jacobian, variables
from rbfmu.formulas.graph import Graph, Number, Symbol, gradient, numbers_of
from rbfmu.formulas.motion import STATE, by_element
from rbfmu.planning.select import with_all_outputs
from rbfmu.runs.inputs import size_of
from rbfmu.runs.plan import Plan, start_run
from rbfmu.scene.scene import Body, Scene, of_scene_or_path
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
from rbfmu_kernels.types import Quaternion, Vec3

FREE = ("r_c", "v_c", "rotvec_b", "omega_b")
"""Errors of a body's state, three numbers each: the last two where no output shows the path."""
Ports = dict[str, Any]
"""Inputs by port: numbers, as a user gives them."""


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
    point = _of_formulas(scene, t, ports) if scene.has_formulas else _of_loads(_at(scene, t, ports), ports)
    n, rates, shown = len(point.names), jacobian(point.rates, point.count), dict[str, Array]()
    for name in scene.outputs.names:
        shown[name] = jacobian(point.roll_pitch_yaw() if name == "rpy" else point.shown[name], point.count)
    inputs_of = [e for name in scene.inputs.ports for e in elements(name, size_of(scene, name))]
    outputs_of = [e for name, rows in shown.items() for e in elements(name, len(rows))]
    C = np.vstack([*shown.values()])
    return Linearization(
        rates[:, :n], rates[:, n:], C[:, :n], C[:, n:], point.names, tuple(inputs_of), tuple(outputs_of), t
    )


def _simulator_at(scene: Scene, t: float, ports: Ports) -> Simulator:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SceneWarning)  # of quantities that nobody asked for; the scene's own are told
        simulator = Simulator(scene)
    if t > scene.run.start:
        simulator.step(t - scene.run.start, **ports)
    else:
        simulator.hold(**ports)
    return simulator


def _at(scene: Scene, t: float, ports: Ports) -> Scene:
    """Return the scene that begins where this one is at time t."""
    wanted = ("quaternion",) if scene.body is None else ("position", "velocity", "quaternion", "omega_b")
    simulator = _simulator_at(scene.replace({"outputs.quantities": wanted}), t, ports)
    initial = {name: getattr(simulator, name).tolist() for name in wanted}
    if scene.body is not None and scene.body.pivot:
        del initial["position"], initial["velocity"]
    attitude = {"attitude": {"quaternion": initial.pop("quaternion")}}
    return scene.replace({f"initial.{name}": value for name, value in (initial | attitude).items()})


Numbers = Sequence[float | Dual]
"""What kernels give that ran as plain Python; they take dual numbers for floats."""


class _Point:
    """A state and inputs as variables: errors first, then inputs. names: of the errors, that of the attitude too.

    rates: of the errors; shown: the numbers of quantities other than rpy, by name.
    """

    rates: Numbers
    shown: Mapping[str, Numbers]

    def __init__(self, names: Iterable[str], q0: Quaternion, inputs: Sequence[float]) -> None:
        self.names, self.q0 = tuple(names), q0
        self.count = len(self.names) + len(inputs)
        self.turned = tuple(variables((0.0, 0.0, 0.0), self.names.index("rotvec_b[1]"), self.count))
        self.q_ab = interpreted(compose_quaternions)(q0, (1.0, *(0.5 * u for u in self.turned)))
        self.inputs = variables(inputs, len(self.names), self.count)

    def turning(self, omega_0: Vec3, omega: Vec3) -> Numbers:
        """Return the rate of rotvec_b to first order: omega - omega_0 - omega_0 x rotvec_b."""
        less, carried = interpreted(subtract), interpreted(cross)(omega_0, self.turned)
        return less(less(omega, omega_0), carried)

    def roll_pitch_yaw(self) -> Numbers:
        """Return what an error of the attitude makes of rpy; raise ValueError at its pole, as `euler_rate_b` warns."""
        angles = evaluated(euler_from_quaternion, ZYX, self.q0)
        yaw, pitch, roll = interpreted(euler_rate_b)(ZYX, angles, self.turned)
        if not np.all(np.abs(jacobian((roll, pitch, yaw), self.count)) < 0.25 / np.finfo(float).eps):
            raise ValueError("rpy has no derivative at pitch 90 deg: expected outputs without rpy")
        return [roll, pitch, yaw]


def _names(*blocks: str) -> list[str]:
    return [element for name in blocks for element in elements(name, 3)]


def _of_loads(scene: Scene, ports: Ports) -> _Point:
    """Return the start of a scene without formulas."""
    inputs = [x for name in scene.inputs.ports for x in ports.get(name, (0.0, 0.0, 0.0))]
    return _prescribed(scene, inputs) if scene.body is None else _loaded(scene, scene.body, inputs)


def _prescribed(scene: Scene, inputs: Sequence[float]) -> _Point:
    """Return an attitude under prescribed rates."""
    point = _Point(_names("rotvec_b"), scene.initial.quaternion, inputs)
    (x, y, z), omega = inputs, tuple(point.inputs)
    point.rates = point.turning((x, y, z), omega)
    point.shown = {"quaternion": point.q_ab, "omega_a": interpreted(rotate)(point.q_ab, omega)}
    return point


def _loaded(scene: Scene, body: Body, inputs: Sequence[float]) -> _Point:
    """Return a body under loads: a buffer of its model, with variables in the places of state and inputs."""
    moves = not body.pivot and bool(needing(TRANSLATION) & set(scene.outputs.quantities))
    states = FREE if moves else FREE[2:]
    point = _Point(_names(*states), scene.initial.quaternion, inputs)
    asked = [n for n in scene.outputs.quantities if n != "rpy"] or ["omega_b"]
    full = Plan("body under loads, by series", "", 3 * len(states), order=12)
    blocks, z = full.kernels.BLOCKS, start_run(scene.replace({"outputs.quantities": asked}), full).tolist()
    omega_0 = tuple(z[blocks["omega"]])
    z[blocks["q"]] = point.q_ab
    for k, name in enumerate(states):
        if name != "rotvec_b":
            block = blocks["omega" if name == "omega_b" else name]
            z[block] = variables(z[block], 3 * k, point.count)
    for k, port in enumerate(scene.inputs.ports):
        z[blocks[port]] = point.inputs[3 * k : 3 * k + 3]
    interpreted(outputs)(z)
    motion = interpreted(motion_of)(z)
    rates = interpreted(state_rates)(motion, interpreted(body_of)(z), interpreted(loads_of)(z))
    of_centre = [*rates.r_c, *rates.v_c] if moves else []
    point.rates = [*of_centre, *point.turning(omega_0, motion.omega_b), *rates.omega_b]
    point.shown = {name: z[blocks[name]] for name in asked}
    return point


def _of_formulas(scene: Scene, t: float, ports: Ports) -> _Point:
    """Return a body with formulas at a time: derivatives on their graph, by its leaves, whose numbers errors change."""
    from rbfmu.models.formulas import equations_of  # what has none starts sooner

    simulator, seen = _simulator_at(with_all_outputs(scene), t, ports), equations_of(scene)
    z, blocks, formulas = simulator.buffer(), simulator.plan.kernels.BLOCKS, simulator.plan.formulas
    assert formulas is not None
    held = by_element({name: z[block] for name, block in blocks.items()})
    known = {element: float(x) for element, x in held} | {"t": t}
    sizes, all_rates, graph = formulas.given.ports, formulas.all_rates, formulas.motion.graph
    moved = [name for name in _names("r_c", "v_c") if name in seen.rates]
    own = [name for name in all_rates if name.startswith(STATE) and name in seen.rates]
    inputs = [e for name in scene.inputs.ports for e in elements(name, sizes[name])]
    names = [*moved, *_names("rotvec_b", "omega_b"), *(name.removeprefix(STATE) for name in own)]
    point = _Point(names, interpreted(quaternion_at)(z, blocks["q"].start), [known[e] for e in inputs])
    omega_0 = tuple(z[blocks["omega"]].tolist())
    omega = variables(omega_0, len(moved) + 3, point.count)
    leaves = [*moved, *elements("q", 4), *elements("omega", 3), *own, *inputs]
    of = [graph.leaf("input" if name in inputs else "state", name) for name in leaves]
    before = variables([0.0] * len(moved), 0, point.count)
    of_own = variables([0.0] * len(own), len(moved) + 6, point.count)
    by_error = jacobian([*before, *point.q_ab, *omega, *of_own, *point.inputs], point.count)
    made = partial(_made_of, scene.name, graph, of, known, by_error)
    in_space, turned_by = (
        made([all_rates[name] for name in names]) for names in (moved, (*elements("omega", 3), *own))
    )
    point.rates = [*in_space, *point.turning(omega_0, tuple(omega)), *turned_by]
    point.shown = {name: made(np.ravel(formulas.shown[name])) for name in scene.outputs.names if name != "rpy"}
    return point


def _made_of(
    name: str, graph: Graph, leaves: list[Symbol], known: dict[str, float], by_error: Array, numbers: Iterable[Number]
) -> list[Dual]:
    """Return what errors make of numbers of the graph by its leaves; their values are not asked for."""
    rows = [gradient(x, leaves) for x in numbers]
    try:
        found = numbers_of(graph, [x for row in rows for x in row], known)
    except (ArithmeticError, ValueError):
        found = [math.nan]
    if not np.isfinite(found).all():
        raise ValueError(f"{name}: a formula has no finite derivative at t = {known['t']!r} s")
    return [Dual(math.nan, row) for row in np.reshape(found, (len(rows), len(leaves))) @ by_error]
