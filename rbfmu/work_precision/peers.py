"""Other people's simulators and solvers on the same cases, where they are installed; each is imported at its turn."""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cache
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from itertools import islice
from time import perf_counter
from typing import Any

import numpy as np
from numba import njit

import rbfmu
from rbfmu.work_precision.cases import CHECKPOINTS, Case
from rbfmu.work_precision.methods import Method, NotFeasibleError, Run, step_counts, timed, tolerances
from rbfmu_kernels.body_memory import body_of, loads_of
from rbfmu_kernels.dynamics import State, state_rates


def _package(name: str) -> str | None:
    """The version of an installed package."""
    try:
        return version(name)
    except PackageNotFoundError:
        return None


def _module(name: str) -> Any:
    try:
        return import_module(name)
    except ImportError as error:
        raise NotFeasibleError(f"{name} is installed but does not load: {error}") from None


def _tuples(r: Any, v: Any, q: Any, omega: Any) -> State:
    return tuple(tuple(map(float, x)) for x in (r, v, q, omega))  # type: ignore[return-value]


def _text(numbers: Iterable[float]) -> str:
    return " ".join(map(repr, numbers))


# SciPy


@njit(error_model="numpy")  # type: ignore[untyped-decorator]
def _rates(y: Any, z: Any) -> Any:
    """d/dt of (q, omega) or (q, omega, r_c, v_c) for the body of a unit's buffer z."""
    r, v = ((y[7], y[8], y[9]), (y[10], y[11], y[12])) if len(y) > 7 else ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    dr, dv, dq, dw = state_rates((r, v, (y[0], y[1], y[2], y[3]), (y[4], y[5], y[6])), body_of(z), loads_of(z))
    f = np.empty(len(y))
    f[0], f[1], f[2], f[3] = dq
    f[4], f[5], f[6] = dw
    if len(y) > 7:
        f[7], f[8], f[9] = dr
        f[10], f[11], f[12] = dv
    return f


def _numpy_rates(case: Case) -> Callable[[float, Any], Any]:
    """The same as people write it."""
    lightness, M, M_inverse, arm, damping, _ = (np.array(x) for x in case.body)
    gravity_a, force_a, force_b, torque_a, torque_b = (np.array(x) for x in case.loads)

    def rates(t: float, y: Any) -> Any:
        e, u, w = y[0], y[1:4], y[4:7]
        skew = np.array([[0.0, -u[2], u[1]], [u[2], 0.0, -u[0]], [-u[1], u[0], 0.0]])
        R = np.eye(3) + 2.0 * (e * skew + skew @ skew)
        torque = np.cross(arm, force_b + R.T @ force_a) + torque_b + R.T @ torque_a - damping * w - np.cross(w, M @ w)
        f = [-0.5 * u @ w, *(0.5 * (e * w + np.cross(u, w))), *(M_inverse @ torque)]
        return f if len(y) == 7 else [*f, *y[10:13], *(gravity_a + lightness * (force_a + R @ force_b))]

    return rates


class SciPy:
    """`scipy.integrate.solve_ivp`, its right-hand sides compiled with Numba, or in NumPy."""

    family, setting = "peer", "rtol = atol"

    def __init__(self, method: str, compiled: bool = True) -> None:
        self.method, self.compiled = method, compiled
        self.name = f"SciPy {method}" if compiled else f"SciPy {method}, f in NumPy"

    def suits(self, case: Case) -> bool:
        """All but a million turns, which take too long."""
        return not case.long

    def settings(self, case: Case, quick: bool) -> Iterator[float]:
        """Tolerances."""
        return tolerances(-2, -13, quick)

    def run(self, case: Case, value: float) -> Run:
        """At a tolerance; the position too where it has no closed form."""
        solve = _module("scipy.integrate").solve_ivp
        r, v, q, omega = case.start
        y = np.array((*q, *omega, *r, *v) if case.turning_force else (*q, *omega))
        times = np.arange(1, CHECKPOINTS + 1) * case.interval
        z = case.buffer
        rates = (lambda t, y: _rates(y, z)) if self.compiled else _numpy_rates(case)

        def once() -> Any:
            return solve(rates, (0.0, case.span), y, self.method, times, rtol=value, atol=value)

        first = once()
        if not first.success:
            raise NotFeasibleError(first.message)

        def state(x: Any) -> State:
            return _tuples(x[7:10], x[10:13], x[:4], x[4:7]) if len(x) > 7 else _tuples(r, v, x[:4], x[4:7])

        found = [state(x) for x in first.y.T]
        return Run(lambda: found, timed(lambda k: [once() for _ in range(k)]), float(first.nfev))


# MuJoCo

_MUJOCO = """<mujoco><option timestep="{h!r}" integrator="{integrator}" gravity="{gravity}">
<flag contact="disable" constraint="disable"/></option>
<worldbody><body>{joint}<inertial pos="{at}" mass="{mass!r}" diaginertia="{moments}"/>
<site name="o"/></body></worldbody>
<actuator><motor site="o" gear="{load}"/></actuator></mujoco>"""


class MuJoCo:
    """A single free body, or one on a ball joint, stepped in C."""

    family, setting = "peer", "step (s)"

    def __init__(self, integrator: str) -> None:
        self.integrator, self.name = integrator, f"MuJoCo {integrator}"

    def suits(self, case: Case) -> bool:
        """All but a million turns, which take too long."""
        return not case.long

    def settings(self, case: Case, quick: bool) -> Iterator[float]:
        """Step sizes, none of those that it warns of."""
        return (h for h in step_counts(case, quick) if h * case.rate <= 1.0)

    def run(self, case: Case, value: float) -> Run:
        """Steps of `value`."""
        mujoco = _module("mujoco")
        mujoco.set_mju_user_warning(lambda text: None)  # else it writes a log to the working folder
        body, loads, initial = case.scene.body, case.scene.loads, case.scene.initial
        assert body is not None
        ball = body.pivot or any(loads.damping_b)
        if len(set(loads.damping_b)) > 1:
            raise NotFeasibleError("a ball joint's damping is the same about all axes")
        model = mujoco.MjModel.from_xml_string(
            _MUJOCO.format(
                h=value,
                integrator=self.integrator,
                gravity=_text(loads.gravity_a),
                joint=f'<joint type="ball" damping="{loads.damping_b[0]}"/>' if ball else '<freejoint align="false"/>',
                at=_text(body.r_oc_b),
                mass=body.mass,
                moments=_text(body.M_c[k][k] for k in range(3)),
                load=_text((*loads.force_b, *loads.torque_b)),
            )
        )
        data, n = mujoco.MjData(model), round(case.interval / value)

        def begin() -> None:
            mujoco.mj_resetData(model, data)
            data.qpos[:] = (*(() if ball else initial.position), *initial.quaternion)
            data.qvel[:] = (*(() if ball else initial.velocity), *initial.omega_b)
            data.ctrl[:] = 1.0

        def state() -> State:
            q, omega = np.array(data.qpos[-4:]), np.array(data.qvel[-3:])
            if ball:
                return _tuples(case.start[0], case.start[1], q, omega)
            r = data.qpos[:3] + rbfmu.rotate(q, np.array(body.r_oc_b))
            return _tuples(r, np.zeros(3), q, omega)

        def states() -> list[State]:
            begin()
            return [(mujoco.mj_step(model, data, n), state())[1] for _ in range(CHECKPOINTS)]

        def repeat(k: int) -> None:
            for _ in range(k):
                begin()
                mujoco.mj_step(model, data, CHECKPOINTS * n)

        return Run(states, timed(repeat), float((4 if self.integrator == "RK4" else 1) * CHECKPOINTS * n))


# Basilisk


class Basilisk:
    """A spacecraft hub with a constant torque."""

    family = "peer"

    def __init__(self, integrator: str) -> None:
        self.integrator, self.name = integrator, f"Basilisk {integrator}"
        self.controlled = integrator == "RKF78"
        self.setting = "tolerance" if self.controlled else "step (s)"

    def suits(self, case: Case) -> bool:
        """No pivot, no damping, no force off the centre; a million turns take too long."""
        return case.key in ("a", "b", "d")

    def settings(self, case: Case, quick: bool) -> Iterator[float]:
        """Tolerances or step sizes; time is in whole nanoseconds."""
        if self.controlled:
            return tolerances(-6, -13, quick)  # a radian a step is as accurate as larger ones
        whole = (n for n in range(1, 10**6) if round(case.interval * 1e9) % n == 0)
        steps = (case.interval / n for n in whole if case.interval / n * case.rate <= 4.0)
        return islice(steps, 0, None, 3 if quick else 1)

    def run(self, case: Case, value: float) -> Run:
        """Steps of `value`, or error control within tasks of a radian, after which it keeps its parameters regular."""
        n = math.ceil(case.interval * max(1.0, case.rate)) if self.controlled else round(case.interval / value)
        n = n if round(case.interval * 1e9) % n == 0 else math.ceil(case.interval) * 4
        recorder: Any = None

        def execute() -> float:
            nonlocal recorder
            nanoseconds = round(case.interval * 1e9) // n
            simulation, recorder = self._simulation(case, value, nanoseconds)
            simulation.InitializeSimulation()
            simulation.ConfigureStopTime(CHECKPOINTS * n * nanoseconds)
            start = perf_counter()
            simulation.ExecuteSimulation()
            return perf_counter() - start

        def states() -> list[State]:
            execute()
            sigma, omega = np.array(recorder.sigma_BN), np.array(recorder.omega_BN_B)
            rows = range(n, CHECKPOINTS * n + 1, n)
            return [_tuples(case.start[0], case.start[1], _quaternion_from_mrp(sigma[i]), omega[i]) for i in rows]

        evaluations = math.nan if self.controlled else 4.0 * CHECKPOINTS * n
        return Run(states, lambda k: sum(execute() for _ in range(k)), evaluations)

    def _simulation(self, case: Case, value: float, nanoseconds: int) -> tuple[Any, Any]:
        """One for each run: a second start of the same one warns."""
        base = _module("Basilisk.utilities.SimulationBaseClass")
        craft, forces = (
            _module("Basilisk.simulation.spacecraft"),
            _module("Basilisk.simulation.extForceTorque"),
        )
        integrators = _module("Basilisk.simulation.svIntegrators")
        simulation = base.SimBaseClass()
        simulation.CreateNewProcess("process").addTask(simulation.CreateNewTask("task", nanoseconds))
        hub = craft.Spacecraft()
        initial, moments, body = case.scene.initial, case.moments, case.scene.body
        assert body is not None
        hub.hub.mHub = body.mass
        hub.hub.IHubPntBc_B = [[moments[i] if i == j else 0.0 for j in range(3)] for i in range(3)]
        e, *x = initial.quaternion
        hub.hub.sigma_BNInit = [[a / (1.0 + e)] for a in x]
        hub.hub.omega_BN_BInit = [[w] for w in initial.omega_b]
        integrator = getattr(integrators, f"svIntegrator{self.integrator}")(hub)
        if self.controlled:
            integrator.relTol = integrator.absTol = value
        hub.setIntegrator(integrator)
        simulation.AddModelToTask("task", hub)
        torque = forces.ExtForceTorque()
        torque.extTorquePntB_B = [[t] for t in case.scene.loads.torque_b]
        hub.addDynamicEffector(torque)
        simulation.AddModelToTask("task", torque)
        recorder = hub.scStateOutMsg.recorder(nanoseconds)
        simulation.AddModelToTask("task", recorder)
        simulation.kept = (integrator, torque, hub)
        return simulation, recorder


def _quaternion_from_mrp(sigma: Any) -> Any:
    square = float(sigma @ sigma)
    return np.array((1.0 - square, *(2.0 * sigma))) / (1.0 + square)


# Drake


class Drake:
    """A multibody plant of one free body, or of one on a ball joint."""

    family, setting = "peer", "target accuracy"

    def __init__(self, scheme: str, label: str) -> None:
        self.scheme, self.name = scheme, f"Drake {label}"

    def suits(self, case: Case) -> bool:
        """No load that turns with the body (it would be a Python callback); a million turns take too long.

        RK5 does not end on ball joints: it walks into the singularity of their Euler angles.
        """
        return case.key in ("a", "b") or (case.key in ("c", "c'", "e") and self.scheme == "runge_kutta3")

    def settings(self, case: Case, quick: bool) -> Iterator[float]:
        """Accuracies."""
        return tolerances(-2, -13, quick)

    def run(self, case: Case, value: float) -> Run:
        """At a target accuracy."""
        analysis = _module("pydrake.systems.analysis")
        plant, body, ball = self._plant(case)
        initial = case.scene.initial

        def simulator() -> Any:
            made = analysis.Simulator(plant)
            integrator = analysis.ResetIntegratorFromFlags(made, self.scheme, case.interval)
            integrator.set_target_accuracy(value)
            context = made.get_mutable_context()
            omega_a = rbfmu.rotate(np.array(initial.quaternion), np.array(initial.omega_b))
            if ball is None:
                plant.SetPositions(context, (*initial.quaternion, *initial.position))
                plant.SetVelocities(context, (*omega_a, *initial.velocity))
            else:
                yaw, pitch, roll = rbfmu.euler_from_quaternion("ZYX", np.array(initial.quaternion))
                ball.set_angles(context, (roll, pitch, yaw))
                ball.set_angular_velocity(
                    context, rbfmu.rotate(np.array(initial.quaternion), np.array(initial.omega_b))
                )
            made.Initialize()
            return made

        def states() -> list[State]:
            made, found = simulator(), []
            for k in range(1, CHECKPOINTS + 1):
                try:
                    made.AdvanceTo(k * case.interval)
                except RuntimeError as error:  # the joint's pitch came (near) to 90 degrees
                    raise NotFeasibleError(str(error)) from None
                context = made.get_context()
                R = plant.EvalBodyPoseInWorld(context, body).rotation()
                omega = R.matrix().T @ plant.EvalBodySpatialVelocityInWorld(context, body).rotational()
                found.append(_tuples(case.start[0], case.start[1], rbfmu.quaternion_from_matrix(R.matrix()), omega))
            evaluations.append(made.get_integrator().get_num_derivative_evaluations())
            return found

        def seconds(k: int) -> float:
            total = 0.0
            for _ in range(k):
                made = simulator()
                start = perf_counter()
                made.AdvanceTo(case.span)
                total += perf_counter() - start
            return total

        evaluations: list[int] = []
        found = states()
        return Run(lambda: found, seconds, float(evaluations[0]))

    def _plant(self, case: Case) -> tuple[Any, Any, Any]:
        multibody, tree = _module("pydrake.multibody.plant"), _module("pydrake.multibody.tree")
        scene_body, loads = case.scene.body, case.scene.loads
        assert scene_body is not None
        plant = multibody.MultibodyPlant(time_step=0.0)
        M, r, mass = scene_body.M_o, scene_body.r_oc_b, scene_body.mass
        inertia = tree.UnitInertia(*(M[k][k] / mass for k in range(3)))
        body = plant.AddRigidBody("body", tree.SpatialInertia(mass, r, inertia))
        ball = None
        if scene_body.pivot or any(loads.damping_b):
            ball = plant.AddJoint(
                tree.BallRpyJoint("ball", plant.world_frame(), body.body_frame(), damping=loads.damping_b[0])
            )
        plant.mutable_gravity_field().set_gravity_vector(loads.gravity_a)
        plant.Finalize()
        return plant, body, ball


_PEERS: dict[str, tuple[str, Callable[[], Sequence[Method]]]] = {
    "SciPy": ("scipy", lambda: [*map(SciPy, ("DOP853", "RK45", "LSODA")), SciPy("LSODA", compiled=False)]),
    "MuJoCo": ("mujoco", lambda: [MuJoCo(m) for m in ("Euler", "implicit", "RK4")]),
    "Basilisk": ("bsk", lambda: [Basilisk(m) for m in ("RK4", "RKF78")]),
    "Drake": ("drake", lambda: [Drake("runge_kutta3", "RK3"), Drake("runge_kutta5", "RK5")]),
}


@cache
def peers() -> tuple[tuple[Method, ...], dict[str, str]]:
    """The installed peers' methods; versions by peer, or that it is not installed."""
    found: list[Method] = []
    versions = {}
    for name, (package, methods) in _PEERS.items():
        installed = _package(package)
        versions[name] = installed or "not installed"
        found += methods() if installed else []
    return tuple(found), versions
