"""`rbfmu chart`: its methods and peers compute the motions that it says."""

import re
import tomllib
from itertools import islice

import pytest

from rbfmu.studies.work_precision import (
    heyoka_peer,
    library_methods,
    methods,
    peers,
    simulators,
    solvers,
)  # fmt: skip
from rbfmu.studies.work_precision.cases import CASES, CHECKPOINTS
from rbfmu.studies.work_precision.collection import (
    few_and_many,
)  # fmt: skip
from rbfmu.studies.work_precision.methods import NotFeasibleError
from tests.support.covering import some_of
from tests.support.paths import ROOT

OWN = {method.name: method for method in library_methods.library_methods()}


def test_steps_divide_the_checkpoints_intervals() -> None:
    for case in CASES.values():
        counts = [case.interval / h for h in islice(methods.step_counts(case, False), 12)]
        assert counts == pytest.approx([round(n) for n in counts], rel=1e-12)
        assert counts == sorted(set(counts))


@pytest.mark.parametrize("key", ["a", "b", "g"])
def test_exact_motion_is_exact(key: str) -> None:
    assert CASES[key].errors(OWN["exact"].run(CASES[key], 5).states())["attitude"] < 1e-15


def test_many_outputs_are_of_the_same_motion() -> None:
    for case in few_and_many(CASES):
        assert case.interval * case.outputs == pytest.approx(case.span)
        assert len(range(case.outputs)[case.checkpoints]) == CHECKPOINTS
        assert range(case.outputs)[case.checkpoints][-1] == case.outputs - 1
    many = CASES["c"].with_many_outputs()
    assert many.outputs == 1000
    for name in ("RK4, quaternion", "splitting, order 4"):
        method = {m.name: m for m in (*library_methods.library_methods(), *methods.reference_integrators())}[name]
        few = CASES["c"].errors(method.run(CASES["c"], 0.005).states())
        assert many.errors(method.run(many, 0.005).states()) == few  # the same steps


@pytest.mark.thorough
def test_a_plan_gives_the_same_motion_at_many_outputs() -> None:
    for key in ("a", "d"):
        many = CASES[key].with_many_outputs()
        assert many.errors(OWN["rbfmu, as planned"].run(many, 1e-6).states())["attitude"] <= 1e-6


@pytest.mark.parametrize("name", some_of(["Taylor, order 12", "DOP853, error control"], 1))
@pytest.mark.parametrize("key", ["d", "e", "f"])
def test_substeps_meet_their_tolerance(key: str, name: str) -> None:
    found = CASES[key].errors(OWN[name].run(CASES[key], 1e-12).states())
    assert max(found["attitude"], found["position"]) < 1e-12 * 60  # steps


@pytest.mark.parametrize("accuracy", [1e-3, 1e-6, 1e-9])
def test_plans_keep_their_promise(accuracy: float) -> None:
    for key in ("c", "c'", "d", "f"):
        found = CASES[key].errors(OWN["rbfmu, as planned"].run(CASES[key], accuracy).states())
        assert max(found["attitude"], found["position"]) <= accuracy


# Peers


def _solvers() -> list[methods.Method]:
    return [*solvers.scipy_methods(), *solvers.numbalsoda_methods(), heyoka_peer.Heyoka()]


@pytest.mark.parametrize("method", _solvers(), ids=lambda method: method.name)
def test_solvers_have_the_same_equations_at_few_and_at_many_outputs(method: methods.Method) -> None:
    for name in ("numbalsoda", "heyoka"):
        if method.name.startswith(name):
            pytest.importorskip(name)
    for key in ("c'", "e", "f"):
        for case in few_and_many([key]):
            found = case.errors(method.run(case, 1e-8).states())
            assert max(found["attitude"], found["position"]) < 1e-5


@pytest.mark.parametrize("integrator", peers.MUJOCO_INTEGRATORS)
def test_mujoco_has_the_same_equations_at_few_and_at_many_outputs(integrator: str) -> None:
    pytest.importorskip("mujoco")
    assert "implicitfast" in peers.MUJOCO_INTEGRATORS
    for case in few_and_many(["d", "f"]):
        found = case.errors(simulators.MuJoCo(integrator).run(case, 0.0005).states())
        assert found["attitude"] < 0.06  # first order: 0.05 at this step


def test_absent_peers_are_named_and_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(peers, "_package", lambda name: None)
    monkeypatch.setattr(peers, "peers", peers.peers.__wrapped__)
    assert peers.peers()[0] == ()
    lines = peers.absent()
    assert len(lines) == len(peers._PEERS)
    assert 'heyoka.py: not installed (pip install "rbfmu[bench]")' in lines


def test_the_extras_that_are_named_install_their_peers() -> None:
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    for package, extra, _ in peers._PEERS.values():
        assert any(re.fullmatch(rf"{package}([>=].*)?", wanted) for wanted in extras[extra])


def test_a_peer_that_does_not_load_is_not_feasible() -> None:
    with pytest.raises(NotFeasibleError, match="does not load"):
        methods.module("rbfmu.no_such_module")


def test_a_closed_form_under_torque_competes() -> None:
    """Damping about one axis."""
    closed = OWN["closed form"]
    assert [key for key, case in CASES.items() if closed.suits(case)] == ["e"]
    run = closed.run(CASES["e"], *closed.settings(CASES["e"], False))
    assert CASES["e"].errors(run.states())["attitude"] < 1e-13
