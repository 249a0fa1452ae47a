"""Simulators by others, measured on the same cases if they are installed; each is imported when it runs."""

import math
from collections.abc import Iterable, Iterator
from functools import partial
from itertools import islice
from time import thread_time
from typing import Any

import numpy as np

from rbfmu import arrays
from rbfmu.studies.chart.cases import Case
from rbfmu.studies.chart.methods import Method, NotFeasibleError, Run, module, step_counts, timer, tolerances
from rbfmu.types import Array
from rbfmu_kernels.types import Matrix


def _text(numbers: Iterable[float]) -> str:
    return " ".join(map(repr, numbers))


# MuJoCo


def _inertia(M: Matrix) -> str:
    """Return MuJoCo's attribute for an inertia matrix about the centre of mass."""
    mixed = (M[0][1], M[0][2], M[1][2])
    kind = "fullinertia" if any(mixed) else "diaginertia"
    return f'{kind}="{_text((M[0][0], M[1][1], M[2][2], *(mixed if any(mixed) else ())))}"'


def mujoco(integrator: str) -> Method:
    """Return a method of MuJoCo: one free body, or one on a ball joint if it has a pivot or damping, stepped in C.

    Steps of more than 1 rad are left out, since MuJoCo warns of them.
    """

    def settings(case: Case, quick: bool) -> Iterator[float]:
        return (h for h in step_counts(case, quick) if h * case.rate <= 1.0)

    return Method(f"MuJoCo {integrator}", "peer", "step (s)", settings, partial(_run_of_mujoco, integrator))


def _run_of_mujoco(integrator: str, case: Case, h: float) -> Run:
    program = module("mujoco")
    program.set_mju_user_warning(lambda text: None)  # else it writes a log to the working folder
    body, loads, initial = case.question.body, case.scene.loads, case.scene.initial
    ball = body.pivot or any(loads.damping_b)
    if len(set(loads.damping_b)) > 1:
        raise NotFeasibleError("a ball joint's damping is the same about all axes")
    if any(body.r_oc_b) and any(loads.force_a):
        raise NotFeasibleError("a force fixed in space acts at the centre of mass")
    joint = f'<joint type="ball" damping="{loads.damping_b[0]}"/>' if ball else '<freejoint align="false"/>'
    text = f"""<mujoco><option timestep="{h!r}" integrator="{integrator}" gravity="{_text(loads.gravity_a)}">
<flag contact="disable" constraint="disable"/></option>
<worldbody><body name="body">{joint}
<inertial pos="{_text(body.r_oc_b)}" mass="{body.mass!r}" {_inertia(body.M_c)}/><site name="o"/></body></worldbody>
<actuator><motor site="o" gear="{_text((*loads.force_b, *loads.torque_b))}"/></actuator></mujoco>"""
    try:
        model = program.MjModel.from_xml_string(text)
    except ValueError as error:
        raise NotFeasibleError(str(error)) from None
    data, n = program.MjData(model), round(case.interval / h)

    def begin() -> None:
        program.mj_resetData(model, data)
        data.qpos[:] = (*(() if ball else initial.position), *initial.quaternion)
        data.qvel[:] = (*(() if ball else initial.velocity), *initial.omega_b)
        data.ctrl[:] = 1.0
        data.xfrc_applied[-1] = (*loads.force_a, *loads.torque_a)

    def state() -> Array:
        q, omega = np.array(data.qpos[-4:]), np.array(data.qvel[-3:])
        if ball:
            return np.hstack((q, omega))
        r = data.qpos[:3] + arrays.rotate(q, np.array(body.r_oc_b))
        v = data.qvel[:3] + arrays.rotate(q, np.cross(omega, body.r_oc_b))
        return np.hstack((q, omega, r, v))

    begin()
    found = [(program.mj_step(model, data, n * some), state())[1] for some in case.outputs_between]
    out = np.zeros((case.outputs, len(data.qpos)))

    def repeat(k: int) -> None:
        step, qpos = program.mj_step, data.qpos
        for _ in range(k):
            begin()
            for row in out:
                step(model, data, n)
                row[:] = qpos

    return Run(case.at_checkpoints(found), timer(repeat), float((4 if integrator == "RK4" else 1) * case.outputs * n))


# Basilisk


CONTROLLED = ("RKF78",)
"""The integrators of Basilisk with error control."""


def basilisk(integrator: str) -> Method:
    """Return a method of Basilisk: a spacecraft hub with a constant torque; times are whole nanoseconds.

    It is set up for motions without a pivot, damping, or forces away from the centre of mass. The one with a million
    turns is left out, as it takes too long.
    """

    def settings(case: Case, quick: bool) -> Iterator[float]:
        if integrator in CONTROLLED:
            return tolerances(-6, -13, quick)  # steps end at each radian, so larger tolerances are as accurate
        whole = (n for n in range(1, 10**6) if round(case.interval * 1e9) % n == 0)
        steps = (case.interval / n for n in whole if case.interval / n * case.rate <= 4.0)
        return islice(steps, 0, None, 3 if quick else 1)

    setting, run = "tolerance" if integrator in CONTROLLED else "step (s)", partial(_run_of_basilisk, integrator)
    return Method(f"Basilisk {integrator}", "peer", setting, settings, run, only=("a", "b", "d"))


def _run_of_basilisk(integrator: str, case: Case, value: float) -> Run:
    """Return a run in steps of `value` s, or with error control in tasks of 1 rad, which keep the MRPs regular."""
    controlled = integrator in CONTROLLED
    n = math.ceil(case.interval * max(1.0, case.rate)) if controlled else round(case.interval / value)
    n = n if round(case.interval * 1e9) % n == 0 else math.ceil(case.interval) * 4
    nanoseconds = round(case.interval * 1e9) // n

    def execute() -> tuple[float, Any]:
        simulation, recorder = _basilisk(integrator, case, value, nanoseconds)
        simulation.InitializeSimulation()
        simulation.ConfigureStopTime(case.outputs * n * nanoseconds)
        start = thread_time()
        simulation.ExecuteSimulation()
        return thread_time() - start, recorder

    _, recorder = execute()
    q_ab, omega = arrays.quaternion_from_mrp(np.array(recorder.sigma_BN)), np.array(recorder.omega_BN_B)
    rows = range(n, case.outputs * n + 1, n)[case.checkpoints]
    found = case.at_checkpoints(np.hstack((q_ab, omega))[[*rows]])
    return Run(found, lambda k: sum(execute()[0] for _ in range(k)), math.nan if controlled else 4.0 * case.outputs * n)


def _basilisk(integrator: str, case: Case, value: float, nanoseconds: int) -> tuple[Any, Any]:
    """Return (simulation, recorder) for one run; a new one is made each time, as a restart gives a warning."""
    base = module("Basilisk.utilities.SimulationBaseClass")
    craft, forces = module("Basilisk.simulation.spacecraft"), module("Basilisk.simulation.extForceTorque")
    integrators = module("Basilisk.simulation.svIntegrators")
    simulation = base.SimBaseClass()
    simulation.CreateNewProcess("process").addTask(simulation.CreateNewTask("task", nanoseconds))
    hub = craft.Spacecraft()
    initial, moments = case.scene.initial, case.moments
    hub.hub.mHub = case.question.body.mass
    hub.hub.IHubPntBc_B = [[moments[i] if i == j else 0.0 for j in range(3)] for i in range(3)]
    e, *x = initial.quaternion
    hub.hub.sigma_BNInit = [[a / (1.0 + e)] for a in x]
    hub.hub.omega_BN_BInit = [[w] for w in initial.omega_b]
    stepper = getattr(integrators, f"svIntegrator{integrator}")(hub)
    if integrator in CONTROLLED:
        stepper.relTol = stepper.absTol = value
    hub.setIntegrator(stepper)
    simulation.AddModelToTask("task", hub)
    torque = forces.ExtForceTorque()
    torque.extTorquePntB_B = [[t] for t in case.scene.loads.torque_b]
    hub.addDynamicEffector(torque)
    simulation.AddModelToTask("task", torque)
    recorder = hub.scStateOutMsg.recorder(nanoseconds)
    simulation.AddModelToTask("task", recorder)
    simulation.kept = (stepper, torque, hub)
    return simulation, recorder


# Drake


def drake(scheme: str, label: str) -> Method:
    """Return a method of Drake: a multibody plant of one free body, or of one on a ball joint.

    It is set up for motions of few turns without loads that turn with the body, which need a Python callback. RK5 does
    not finish on ball joints, since it runs into the singularity of their Euler angles.
    """
    return Method(
        f"Drake {label}", "peer", "target accuracy", lambda case, quick: tolerances(-2, -13, quick),
        partial(_run_of_drake, scheme), only=("a", "b", "c", "c'", "e") if scheme == "runge_kutta3" else ("a", "b"),
    )  # fmt: skip


def _run_of_drake(scheme: str, case: Case, accuracy: float) -> Run:
    analysis = module("pydrake.systems.analysis")
    plant, body, ball = _plant(case)
    initial = case.scene.initial

    def simulator() -> Any:
        made = analysis.Simulator(plant)
        integrator = analysis.ResetIntegratorFromFlags(made, scheme, case.interval)
        integrator.set_target_accuracy(accuracy)
        context = made.get_mutable_context()
        omega_a = arrays.rotate(np.array(initial.quaternion), np.array(initial.omega_b))
        if ball is None:
            plant.SetPositions(context, (*initial.quaternion, *initial.position))
            plant.SetVelocities(context, (*omega_a, *initial.velocity))
        else:
            yaw, pitch, roll = arrays.euler_from_quaternion("ZYX", np.array(initial.quaternion))
            ball.set_angles(context, (roll, pitch, yaw))
            ball.set_angular_velocity(context, omega_a)
        made.Initialize()
        return made

    def seconds(k: int) -> float:
        total = 0.0
        for _ in range(k):
            made = simulator()
            start = thread_time()
            for i in range(1, case.outputs + 1):
                made.AdvanceTo(i * case.interval)
            total += thread_time() - start
        return total

    made, found = simulator(), []
    for t in case.times[1:][case.checkpoints]:
        try:
            made.AdvanceTo(t)
        except RuntimeError as error:  # the joint's pitch came close to 90 degrees
            raise NotFeasibleError(str(error)) from None
        context = made.get_context()
        R = plant.EvalBodyPoseInWorld(context, body).rotation()
        omega = R.matrix().T @ plant.EvalBodySpatialVelocityInWorld(context, body).rotational()
        found.append(np.hstack((arrays.quaternion_from_matrix(R.matrix()), omega)))
    return Run(case.at_checkpoints(found), seconds, float(made.get_integrator().get_num_derivative_evaluations()))


def _plant(case: Case) -> tuple[Any, Any, Any]:
    multibody, tree = module("pydrake.multibody.plant"), module("pydrake.multibody.tree")
    scene_body, loads = case.question.body, case.scene.loads
    plant = multibody.MultibodyPlant(time_step=0.0)
    M, r, mass = scene_body.M_o, scene_body.r_oc_b, scene_body.mass
    inertia = tree.UnitInertia(*(M[k][k] / mass for k in range(3)))
    body = plant.AddRigidBody("body", tree.SpatialInertia(mass, r, inertia))
    ball = None
    if scene_body.pivot or any(loads.damping_b):
        frames = plant.world_frame(), body.body_frame()
        ball = plant.AddJoint(tree.BallRpyJoint("ball", *frames, damping=loads.damping_b[0]))
    plant.mutable_gravity_field().set_gravity_vector(loads.gravity_a)
    plant.Finalize()
    return plant, body, ball


# The simulators


MUJOCO = tuple(map(mujoco, ("Euler", "implicit", "implicitfast", "RK4")))
BASILISK = tuple(map(basilisk, ("RK4", "RKF78")))
DRAKE = drake("runge_kutta3", "RK3"), drake("runge_kutta5", "RK5")
