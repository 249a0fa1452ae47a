"""What plans say of inputs that are held over a communication step, and of the remedy, held against simulations."""

import re

import numpy as np
import pytest

from rbfmu import Scene, plan
from rbfmu.runs.plan import filled_buffer, initialize
from rbfmu_kernels.buffer import OK

STEP, MASS, MOMENT = 0.1, 2.0, 1.0
BODY = {"mass": MASS, "inertia": [MOMENT, 2.0, 2.5]}
NUMBER = r"([0-9.e+-]+)"


def scene_of(ports, outputs, body=BODY, step=STEP, **initial):
    tables = {"body": body, "initial": initial, "loads": {"gravity_a": [0.0, 0.0, 0.0]}}
    tables |= {"inputs": {"ports": ports}, "outputs": {"quantities": outputs}}
    return Scene.from_dict(tables | {"run": {"stop": 60.0, "step": step, "accuracy": 1e-9}})


def path(**initial):
    return scene_of(["force_a"], ["position", "velocity"], **initial)


class Running:
    """A planned unit, its variables by name."""

    def __init__(self, scene):
        planned = plan(scene)
        self.unit, self.h, self.model = planned.kernels, scene.run.step, planned.model
        self.said = "\n".join(planned.reasons)
        self.z = filled_buffer(scene, planned)
        initialize(scene, self.unit, self.z)

    def __getitem__(self, name):
        return self.z[self.unit.BLOCKS[name]]

    def step(self, **inputs):
        for name, value in inputs.items():
            self[name][0] = value
        assert self.unit.step(self.z, self.h) == OK

    def number(self, pattern):
        found = re.search(pattern.replace("#", NUMBER), self.said)
        assert found, self.said
        return float(found[1])


def growth(energies):
    """Of the energy in a step: the slope of its logarithm."""
    return np.expm1(np.polyfit(np.arange(len(energies)), np.log(energies), 1)[0])


def test_two_bodies_joined_by_a_spring_gain_energy_as_said():
    one, other = Running(path(velocity=[1.0, 0.0, 0.0])), Running(path(position=[1.0, 0.0, 0.0]))
    assert one.model == "no rotation"  # a closed form, exact for held inputs
    k, energies = 20.0, []
    for _ in range(600):
        pull = k * (other["position"][0] - one["position"][0] - 1.0)
        one.step(force_a=pull)
        other.step(force_a=-pull)
        stretch, speed = (other[n][0] - one[n][0] for n in ("position", "velocity"))
        energies.append(0.5 * k * (stretch - 1.0) ** 2 + 0.25 * MASS * speed**2)
    gain = 2.0 * k * one.number("gains # k of its energy each step")  # twice: of the two, half a mass swings
    assert gain == pytest.approx(2.0 * k * STEP**2 / (2.0 * MASS))
    assert growth(energies) == pytest.approx(gain, rel=0.1)
    assert energies[-1] > 1e12 * energies[0]


@pytest.mark.parametrize(("share", "grows"), [(0.9, True), (1.1, False)])
def test_a_damper_beside_a_spring_makes_up_from_where_it_is_said(share, grows):
    body, k = Running(path(velocity=[1.0, 0.0, 0.0])), 20.0
    enough = share * k * body.number("damper of # k N s/m")
    energies = []
    for _ in range(400):
        body.step(force_a=-k * body["position"][0] - enough * body["velocity"][0])
        energies.append(0.5 * k * body["position"][0] ** 2 + 0.5 * MASS * body["velocity"][0] ** 2)
    assert (growth(energies) > 0.0) == grows


@pytest.mark.parametrize(("port", "output", "unit"), [("force_a", "velocity", "N s/m"), ("torque_b", "omega_b", "N m")])
@pytest.mark.parametrize(("share", "grows"), [(1.02, True), (0.98, False)])
def test_a_damper_is_unstable_beyond_what_is_said(port, output, unit, share, grows):
    start = {"velocity": [1.0, 0.0, 0.0], "omega_b": [1.0, 0.0, 0.0]}
    body = Running(scene_of([port], [output], **start))
    damper = share * body.number(f"a damper beyond # {unit}")
    for _ in range(200):
        body.step(**{port: -damper * body[output][0]})
    assert (abs(body[output][0]) > 1.0) == grows


@pytest.mark.parametrize(
    ("port", "shown", "unit"), [("force_a", "position[1]", "N/m"), ("torque_a", "R_ab[1,2]", "N m/rad")]
)
def test_an_output_of_ones_own_closes_a_loop_as_well(port, shown, unit):
    tables = scene_of([port], ["quaternion"]).to_dict() | {"outputs": {"quantities": [], "own": shown}}
    said = plan(Scene.from_dict(tables)).reasons
    assert any(f"a spring of k {unit}" in reason for reason in said)


@pytest.mark.parametrize(("share", "grows"), [(1.02, True), (0.98, False)])
def test_a_feedback_on_prescribed_rates_is_unstable_beyond_what_is_said(share, grows):
    tables = {"initial": {"attitude": {"rotvec": [1e-3, 0.0, 0.0]}}, "inputs": {"ports": ["omega_b"]}}
    tables |= {"outputs": {"quantities": ["quaternion"]}, "run": {"stop": 10.0, "step": STEP}}
    body = Running(Scene.from_dict(tables))
    gain = share * body.number("gain is beyond # 1/s")
    for _ in range(100):
        body.step(omega_b=-2.0 * gain * body["quaternion"][1])
    assert (abs(body["quaternion"][1]) > 0.5e-3) == grows


def swung(step, derivatives):
    """Growth of a torsion spring's energy per second: its torque held, or with derivatives of first, second order."""
    body, k, energies = Running(scene_of(["torque_b"], ["quaternion", "omega_b"], step=step)), 4.0, []
    body["omega"][0] = body["omega_b"][0] = 1e-3
    for _ in range(round(120.0 / step)):
        angle, rate = 2.0 * np.arctan2(body["quaternion"][1], body["quaternion"][0]), body["omega_b"][0]
        energies.append(0.5 * k * angle**2 + 0.5 * MOMENT * rate**2)
        given = {"torque_b": -k * angle, "torque_b_rate": -k * rate, "torque_b_rate_2": k * k * angle / MOMENT}
        body.step(**dict(list(given.items())[: 1 + derivatives]))
    assert "remedy: input derivatives" in body.said
    return growth(energies) / step


def test_input_derivatives_raise_the_order():
    k, h = 4.0, 0.05
    held, first, second = (swung(h, order) for order in (0, 1, 2))
    a = k * h * h / MOMENT
    assert held == pytest.approx(0.5 * a / h, rel=0.05)
    assert first == pytest.approx(a * a / 12.0 / h, rel=0.05)
    assert second == pytest.approx(-a * a / 24.0 / h, rel=0.05)
    assert np.log2(swung(2.0 * h, 0) / held) == pytest.approx(1.0, abs=0.2)
    assert np.log2(swung(2.0 * h, 1) / first) == pytest.approx(3.0, abs=0.2)


SAID = "a loop closed through them is of first order"
MODELS = {
    "no rotation": (BODY, ["force_a"], ["position"], {}),
    "angular momentum": (BODY, ["torque_a"], ["angular_momentum_a"], {"omega_b": [0.3, 2.0, 0.1]}),
    "body under loads, by series": (BODY, ["torque_b"], ["quaternion"], {}),
}


@pytest.mark.parametrize("model", MODELS)
def test_every_model_with_ports_says_it(model):
    body, ports, outputs, initial = MODELS[model]
    running = Running(scene_of(ports, outputs, body, **initial))
    assert running.model == model
    assert SAID in running.said
    assert ("input derivatives" in running.said) == (model == "body under loads, by series")
    assert SAID not in "\n".join(plan(scene_of([], outputs, body, **initial)).reasons)
