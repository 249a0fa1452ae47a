"""The linear system x' = A x + B u, y = C x + D u near a state of a motion, by exact derivatives on the graph."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from numbers import Real
from typing import Any

import numpy as np

from rbfmu.formulas.graph import Number, changes_of, numbers_or_nan
from rbfmu.formulas.motion import AXES, STATE, by_element
from rbfmu.planning.select import plan, with_all_outputs
from rbfmu.runs.inputs import size_of
from rbfmu.scene.scene import Scene, of_scene_or_path
from rbfmu.simulation import Simulator, simulator_of
from rbfmu.types import Array
from rbfmu_kernels import ZYX, Quaternion, cross, euler_from_quaternion, euler_rate_b, quaternion_rate_b, rotate
from rbfmu_kernels.compile.tiered import evaluated
from rbfmu_kernels.quantities import TRANSLATION, elements, needing

TURN = elements("rotvec_b", 3)


@dataclass(frozen=True, eq=False, repr=False)
class Linearization:
    """The result of `linearize`: A (n, n), B (n, m), C (p, n), D (p, m), to which it also unpacks; SI units.

    states: the errors' names, see `linearize`; inputs, outputs: the FMU's names of the variables; time: s.
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
        of = {"states": self.states, "inputs": self.inputs, "outputs": self.outputs}
        known = {what: dict.fromkeys(name.partition("[")[0] for name in names) for what, names in of.items()}
        named = "; ".join(f"{what} {', '.join(names) or 'none'}" for what, names in known.items())
        return f"Linearization(t = {self.time:g} s: {shapes}; {named})"

    def __iter__(self) -> Iterator[Array]:
        return iter((self.A, self.B, self.C, self.D))


@of_scene_or_path
def linearize(scene: Scene, /, t: float | None = None, **ports: Any) -> Linearization:
    """Return the linear system of small errors about a scene's motion at time t (s), by default its start.

    Errors, in this order: r_c and v_c of the centre of mass, in a (m, m/s; only if an output shows them); rotvec_b, the
    rotation vector u in b (rad) of the attitude's error, q_ab = q_ab(t) exp(u/2); omega_b (rad/s). With prescribed
    rates there is only rotvec_b; a scene with formulas also has its own states, after these. The errors' rates are
    those along the motion: a body that turns carries u with it.

    ports: inputs at t by name, held from the start to t; by default as at the start. Outputs are the scene's. The
    matrices are derivatives of the kernels' own equations, and of the scene's formulas, to round-off. At a corner they
    are those of one side: for max(u, 0) at u = 0 of the side above, for max(0, u) of the side below. The state at t is
    as accurate as the scene asks.
    Raises SceneError, SimulationError; ValueError for a time outside the run, a wrong input, rpy at pitch 90 deg, or a
    formula without a finite derivative.
    """
    run = scene.run
    t = run.start if t is None else t
    if not isinstance(t, Real) or isinstance(t, bool) or not run.start <= t <= run.stop:
        raise ValueError(f"t = {t!r}: expected a time from run.start = {run.start!r} to run.stop = {run.stop!r} (s)")
    t = float(t)
    simulator = _simulator_at(scene, t, ports)
    z, q = simulator.buffer(), tuple(simulator.quaternion.tolist())
    known = dict(by_element({name: z[block] for name, block in simulator.plan.kernels.BLOCKS.items()})) | {"t": t}
    inputs = [e for name in scene.inputs.ports for e in elements(name, size_of(scene, name))]
    errors, rates, shown = (_of_prescribed_rates if scene.body is None else _of_body)(scene, q, known, inputs)
    if "rpy" in scene.outputs.names:
        shown["rpy"] = _roll_pitch_yaw(q) @ np.eye(rates.shape[1])[_turn(errors)]
    n, C = len(errors), np.vstack([shown[name] for name in scene.outputs.names])
    outputs = [e for name in scene.outputs.names for e in elements(name, len(shown[name]))]
    matrices = rates[:, :n], rates[:, n:], C[:, :n], C[:, n:]
    return Linearization(*matrices, tuple(errors), tuple(inputs), tuple(outputs), t)


def _simulator_at(scene: Scene, t: float, ports: Mapping[str, Any]) -> Simulator:
    """Return a simulator at time t that has all states on which derivatives depend: a formula may read any state.

    Events are left out: they do not change the motion, and may be more than one step can list.
    """
    scene = scene.replace({"events": None})
    state = ["quaternion"] if scene.body is None else ["position", "velocity", "quaternion", "omega_b"]
    shown = with_all_outputs(scene) if scene.has_formulas else scene.replace({"outputs.quantities": state})
    simulator = simulator_of(shown, plan(shown))
    if t > scene.run.start:
        simulator.step(t - scene.run.start, **ports)
    else:
        simulator.hold(**ports)
    return simulator


Derivatives = tuple[list[str], Array, dict[str, Array]]
"""The errors' names; the derivatives of their rates, and of quantities other than rpy: a row for each number, a column
for each error and then each input."""


def _turn(errors: Sequence[str]) -> slice:
    """Return the places of the attitude's error."""
    first = errors.index(TURN[0])
    return slice(first, first + 3)


def _by_axes(kernel: Callable[..., Any], *of: Any) -> Array:
    """Return the matrix of a kernel that is linear in its last argument, a vector."""
    return np.array([evaluated(kernel, *of, axis) for axis in AXES]).T


def _roll_pitch_yaw(q: Quaternion) -> Array:
    """Return the derivatives (3, 3) of rpy by the attitude's error. Raises ValueError at the pole."""
    yaw_pitch_roll = _by_axes(euler_rate_b, ZYX, evaluated(euler_from_quaternion, ZYX, q))
    if not np.all(np.abs(yaw_pitch_roll) < 0.25 / np.finfo(float).eps):
        raise ValueError("rpy has no derivative at pitch 90 deg: expected outputs without rpy")
    return yaw_pitch_roll[::-1]


def _of_prescribed_rates(scene: Scene, q: Quaternion, known: Mapping[str, float], inputs: Sequence[str]) -> Derivatives:
    """Return `Derivatives` for prescribed rates: the rate of rotvec_b is omega - omega_0 - omega_0 x rotvec_b."""
    carried, to_a = _by_axes(cross, [known[name] for name in inputs]), _by_axes(rotate, q)
    of_attitude = np.hstack([_by_axes(quaternion_rate_b, q), np.zeros((4, 3))])
    shown = {"quaternion": of_attitude, "omega_a": np.hstack([-to_a @ carried, to_a])}
    return TURN, np.hstack([-carried, np.eye(3)]), shown


def _of_body(scene: Scene, q: Quaternion, known: Mapping[str, float], inputs: Sequence[str]) -> Derivatives:
    """Return `Derivatives` for a body: derivatives on the graph of its equations by leaves, and of leaves by errors."""
    from rbfmu.models.formulas import equations_of  # prescribed rates do not need it

    equations = equations_of(scene)
    rates, graph = equations.all_rates, equations.motion.graph
    path = [*elements("r_c", 3), *elements("v_c", 3)]
    moves = not equations.given.pivot and bool(needing(TRANSLATION) & {*scene.outputs.quantities})
    moved = [name for name in path if (name in equations.rates if scene.has_formulas else moves)]
    own = [name for name in rates if name.startswith(STATE) and name in equations.rates]
    omega = elements("omega", 3)
    errors = [*moved, *TURN, *elements("omega_b", 3), *(name.removeprefix(STATE) for name in own)]
    leaves = [*moved, *elements("q", 4), *omega, *own, *inputs]
    of = [graph.leaf("input" if name in inputs else "state", name) for name in leaves]
    each, turn = np.eye(len(errors) + len(inputs)), _turn(errors)
    by_error = np.vstack([each[: turn.start], _by_axes(quaternion_rate_b, q) @ each[turn], each[turn.stop :]])

    def rows_of(what: str, numbers: Sequence[Number]) -> Array:
        """Return the derivatives of numbers of the graph by errors and inputs, a row for each number."""
        columns = [changes_of(numbers, {leaf: 1.0}) for leaf in of]
        found = numbers_or_nan(graph, [x for column in columns for x in column], known)
        if not np.isfinite(found).all():
            raise ValueError(f"{scene.name}: {what} has no finite derivative at t = {known['t']!r} s")
        return np.asarray(np.reshape(found, (len(of), -1)).T @ by_error)

    carried = _by_axes(cross, [known[name] for name in omega]) @ each[turn]
    turning = each[turn.stop : turn.stop + 3] - carried  # to first order: omega - omega_0 - omega_0 x rotvec_b
    in_space = rows_of("a force", [rates[name] for name in moved])
    turned_by = rows_of("a torque or the rate of a state", [rates[name] for name in (*omega, *own)])
    names = [name for name in scene.outputs.names if name != "rpy"]
    shown = {name: rows_of(f"output {name}", [*np.ravel(equations.shown[name])]) for name in names}
    return errors, np.vstack([in_space, turning, turned_by]), shown
