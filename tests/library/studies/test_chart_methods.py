"""`rbfmu chart`: its methods and peers compute the motions that it says, as errors against references tell."""

import json
import re
import subprocess
import sys
import tomllib
from dataclasses import replace
from itertools import islice
from unittest.mock import MagicMock, Mock

import mpmath as mp
import numpy as np
import pytest

from rbfmu import quaternion_from_euler, rotate
from rbfmu.models.registry import CLOSED_FORMS
from rbfmu.studies.chart import measure, methods, simulators, solvers
from rbfmu.studies.chart.cases import CASES, CHECKPOINTS, DRIFTS, REFERENCES, WHOLE, few_and_many
from rbfmu.studies.chart.methods import NotFeasibleError
from rbfmu_kernels.mechanics.equations_of_motion import State, state_rates
from tests.support.chart_points import true_states
from tests.support.covering import some_of
from tests.support.paths import ROOT
from tests.support.references import free_rotation_mp, reference_mp

OWN = {method.name: method for method in (*methods.own_methods(), methods.planned())}


def test_steps_divide_the_checkpoints_intervals() -> None:
    for case in CASES.values():
        counts = [case.interval / h for h in islice(methods.step_counts(case, False), 12)]
        assert counts == pytest.approx([round(n) for n in counts], rel=1e-12)
        assert counts == sorted(set(counts))


@pytest.mark.thorough
@pytest.mark.skipif(sys.platform != "linux", reason="limits of processor time are set as on Linux")
def test_a_short_run_takes_time_also_under_a_limit_of_processor_time() -> None:
    code = """
import resource
resource.setrlimit(resource.RLIMIT_CPU, (1000, 1000))
from rbfmu.studies.chart.methods import timer
print(min(timer(lambda k: sum(range(1000)))(1) for _ in range(100)) > 0.0)
"""
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout == "True\n"


@pytest.mark.thorough
@pytest.mark.parametrize("key", ["a", "b", "g"])
def test_exact_motion_is_exact(key: str) -> None:
    assert CASES[key].error(OWN["torque-free body"].run(CASES[key], 5).found) < 1e-15


@pytest.mark.thorough
def test_many_outputs_are_of_the_same_motion() -> None:
    for case in few_and_many():
        assert case.interval * case.outputs == pytest.approx(case.span)
        assert len(range(case.outputs)[case.checkpoints]) == CHECKPOINTS
        assert range(case.outputs)[case.checkpoints][-1] == case.outputs - 1
    many = CASES["c"].with_many_outputs()
    assert many.outputs == 1000
    for name in ("RK4, quaternion", "splitting, order 4"):
        method = OWN[name]
        few = CASES["c"].error(method.run(CASES["c"], 0.005).found)
        assert many.error(method.run(many, 0.005).found) == few  # the same steps


@pytest.mark.thorough
@pytest.mark.parametrize("name", some_of(["Taylor, order 12", "DOP853, error control"], 1))
@pytest.mark.parametrize("key", ["d", "e", "f"])
def test_substeps_meet_their_tolerance(key: str, name: str) -> None:
    assert CASES[key].error(OWN[name].run(CASES[key], 1e-12).found) < 1e-12 * 60  # steps


# Peers


def _solvers() -> list[methods.Method]:
    return [*solvers.SCIPY, *solvers.NUMBALSODA, solvers.HEYOKA]


@pytest.mark.thorough
@pytest.mark.parametrize("method", _solvers(), ids=lambda method: method.name)
def test_solvers_have_the_same_equations_at_few_and_at_many_outputs(method: methods.Method) -> None:
    for name in ("numbalsoda", "heyoka"):
        if method.name.startswith(name):
            pytest.importorskip(name)
    for key in ("c'", "e", "f"):
        for case in few_and_many([key]):
            assert case.error(method.run(case, 1e-8).found) < 1e-5


@pytest.mark.parametrize("method", simulators.MUJOCO, ids=lambda method: method.name)
def test_mujoco_has_the_same_equations_at_few_and_at_many_outputs(method: methods.Method) -> None:
    pytest.importorskip("mujoco")
    assert "MuJoCo implicitfast" in [method.name for method in simulators.MUJOCO]
    for case in few_and_many(["d", "f"]):
        found = case.error(method.run(case, 0.0005).found)
        assert found < 0.06  # first order: 0.05 at this step


def test_absent_peers_are_named_and_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(measure.Peer, "installed", "")
    assert measure.peers() == []
    lines = measure.absent()
    assert len(lines) == len(measure.PEERS)
    assert 'heyoka.py: not installed (pip install "rbfmu[bench]")' in lines


def test_the_extras_that_are_named_install_their_peers() -> None:
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    for peer in measure.PEERS.values():
        assert any(re.fullmatch(rf"{peer.package}([>=].*)?", wanted) for wanted in extras[peer.extra])


def test_a_peer_that_does_not_load_is_not_feasible() -> None:
    with pytest.raises(NotFeasibleError, match="does not load"):
        methods.module("rbfmu.no_such_module")


@pytest.mark.thorough
def test_a_closed_form_under_torque_competes() -> None:
    """Damping about one axis."""
    closed = OWN["one axis"]
    suited = {key: [s.key for s in CLOSED_FORMS if not OWN[s.key].why_not(case)] for key, case in CASES.items()}
    free, none = {key: ["torque-free body"] for key in "abg"}, {key: [] for key in ("c", "c'", "d", "f")}
    assert suited == free | none | {"e": ["one axis"]}
    run = closed.run(CASES["e"], *closed.settings(CASES["e"], False))
    assert CASES["e"].error(run.found) < 1e-13


def test_methods_for_free_bodies_compete_where_no_load_makes_a_torque() -> None:
    assert [key for key, case in CASES.items() if case.turns_freely] == ["a", "b", "g"]
    assert [key for key, case in CASES.items() if case.top] == ["c"]


# References and errors


DIGITS = mp.mpf(10) ** -37
"""Of 40 in the file; body rates grow to 50."""
EPS = 2.0**-52
MOTIONS = json.loads(REFERENCES.read_text())["motions"]


def _largest_difference(a, b):
    with mp.workdps(60):
        return max(abs(mp.mpf(x) - mp.mpf(y)) for u, v in zip(a, b, strict=True) for x, y in zip(u, v, strict=True))


@pytest.mark.parametrize("key", CASES)
def test_references_are_of_these_scenes(key: str) -> None:
    assert MOTIONS[key]["scene"] == CASES[key].scene.to_dict()


@pytest.mark.parametrize("key", ["a", "b", "g"])
def test_torque_free_references_are_the_closed_form(key: str) -> None:
    case, stored = CASES[key], MOTIONS[key]
    for i in (0, CHECKPOINTS - 1):
        q, omega = free_rotation_mp.closed_form(
            case.moments, case.start.q_ab, case.start.omega_b, case.interval * (i + 1)
        )
        with mp.workdps(60):
            sign = mp.sign(sum(x * mp.mpf(y) for x, y in zip(q, stored["quaternion"][i], strict=True)))
            q = [sign * x for x in q]
        assert _largest_difference([q], [stored["quaternion"][i]]) < DIGITS
        assert _largest_difference([omega], [stored["omega_b"][i]]) < DIGITS


@pytest.mark.parametrize("key", some_of(["c'", "d", "e", "f"], 2))
def test_forced_references_agree_with_another_formulation(key: str) -> None:
    case, stored = CASES[key], MOTIONS[key]
    times = tuple(case.interval * (i + 1) for i in range(1 if key == "c'" else CHECKPOINTS))
    for i, point in enumerate(reference_mp.motion(case.scene, times)):
        with mp.workdps(60):
            e, x, y, z = map(mp.mpf, stored["quaternion"][i])
            bottom = [2 * (x * z - e * y), 2 * (y * z + e * x), e * e - x * x - y * y + z * z]
        assert _largest_difference([bottom], [point.R_ab[2]]) < DIGITS
        assert _largest_difference([point.omega_b], [stored["omega_b"][i]]) < DIGITS


@pytest.mark.parametrize("key", CASES)
def test_the_truth_has_no_error_and_keeps_what_it_keeps(key: str) -> None:
    motion = CASES[key].at_checkpoints(true_states(key))
    assert CASES[key].error(motion) < 2 * EPS  # its rounding
    drifts = CASES[key].drifts(motion)
    assert drifts.keys() == {f"{name.replace(' ', '_')}_drift" for name in DRIFTS if name in CASES[key].keeps}
    assert max(drifts.values(), default=0.0) < 1e-14


# Peers' motions, where the peers are not installed: what they are given


@pytest.mark.parametrize(("key", "asked", "states"), [
    *((key, "omega_b", WHOLE[4:7]) for key in "ae"),
    *((key, "quaternion", WHOLE[:7]) for key in "ace"),
    ("a", "position", WHOLE[7:]),
    ("f", "position", WHOLE),
])  # fmt: skip
def test_heyoka_is_given_the_kernels_equations_of_motion(key: str, asked: str, states, monkeypatch) -> None:
    case = replace(CASES[key], scene=CASES[key].scene.replace({"outputs.quantities": [asked]}))
    q, w, r, v = case.start.q_ab, (0.3, -0.2, 0.5), (1.0, 2.0, 3.0), (-1.0, 0.5, 0.25)
    at = dict(zip(WHOLE, (*q, *w, *r, *v), strict=True))
    heyoka = Mock(make_vars=lambda name: at[states[int(name[1:])]], time=0.0, expression=float)
    monkeypatch.setattr(solvers, "module", lambda name: heyoka)
    rates = state_rates(State(r, v, q, w), case.body, case.loads)
    expected = dict(zip(WHOLE, (*rates.q_ab, *rates.omega_b, *rates.r_c, *rates.v_c), strict=True))
    found = solvers.equations(case)
    assert case.states == states
    assert [variable for variable, _ in found] == [at[name] for name in states]
    assert [rate for _, rate in found] == pytest.approx([expected[name] for name in states], rel=1e-14, abs=1e-14)


@pytest.mark.parametrize("on_a_joint", [False, True])
def test_drake_starts_where_the_scene_does(on_a_joint: bool, monkeypatch) -> None:
    case, plant, joint = CASES["a"], MagicMock(), MagicMock()
    initial = case.scene.initial
    monkeypatch.setattr(simulators, "module", MagicMock())
    monkeypatch.setattr(simulators, "_plant", lambda of: (plant, "body", joint if on_a_joint else None))
    plant.EvalBodyPoseInWorld().rotation().matrix.return_value = np.eye(3)
    plant.EvalBodySpatialVelocityInWorld().rotational.return_value = np.zeros(3)
    simulators.DRAKE[0].run(case, 1e-6)
    omega_a = rotate(np.array(initial.quaternion), np.array(initial.omega_b))
    if on_a_joint:
        (_, (roll, pitch, yaw)), (_, rates) = joint.set_angles.call_args.args, joint.set_angular_velocity.call_args.args
        turned = quaternion_from_euler("ZYX", np.array((yaw, pitch, roll)))
        assert abs(turned @ np.array(initial.quaternion)) == pytest.approx(1.0, rel=1e-14)
        assert rates == pytest.approx(omega_a)
        assert not plant.SetPositions.called
    else:
        assert plant.SetPositions.call_args.args[1] == (*initial.quaternion, *initial.position)
        assert plant.SetVelocities.call_args.args[1] == pytest.approx((*omega_a, *initial.velocity))
