"""`rbfmu chart` on scenes with formulas: what peers get is translated from the graph, and follows the same motion."""

from pathlib import Path

import numpy as np
import pytest

import rbfmu
from rbfmu.formulas.graph import Graph, numbers_of
from rbfmu.formulas.source import function_of
from rbfmu.studies.chart import cases, measure, solvers
from rbfmu.studies.chart.measure import why_not
from rbfmu.studies.chart.simulators import MUJOCO
from rbfmu.studies.chart.solvers import HEYOKA, SCIPY, heyoka_functions
from tests.library.formulas.test_series import CASES, POINTS, graph_of, truth
from tests.support.paths import ROOT

GALLERY = ROOT / "examples" / "scenes" / "formulas"
SPRING = {
    "body": {"mass": 2.0, "inertia": [0.3, 0.4, 0.5], "r_oc_b": [0.1, 0.0, -0.2]},
    "initial": {"omega_b": [0.3, -0.2, 0.5], "position": [0.5, 0.0, 0.0], "velocity": [0.0, 1.0, 0.0]},
    "constants": {"k": 3.0, "n": 0.7},
    "loads": {"force_a": "-k*position + [u[1], 0, pull]", "torque_b": "-0.2*omega_b + [0, cos(n*t), 0]"},
    "states": {"u": {"start": [0.3, 0.2, 0.1], "rate": "to_b([sin(t), 0, 0]) - u"}},
    "inputs": {"ports": [{"name": "pull", "start": 0.25}]},
    "outputs": {"quantities": ["position", "rpy"], "far": {"value": "norm(position) + t"}},
    "run": {"start": 3.0, "stop": 5.0, "step": 0.1, "accuracy": 1e-9},
}
"""A time that does not begin at 0, a state and an input of its own, and an output that reads the time."""


def case_of(name: str) -> cases.Case:
    return cases.case_of(rbfmu.load_scene(GALLERY / f"{name}.toml"))


# What is translated


def by_text(graph: Graph, y: object, t: float) -> float:
    names: dict = {}
    exec(function_of("put", graph, [y], {"t": "(t + 0.25)", "y": "y[0]", "c": "0.7"}), names)
    f = np.zeros(1)
    names["put"](t - 0.25, f, np.zeros(1))
    return float(f[0])


def by_heyoka(graph: Graph, y: object, t: float) -> float:
    heyoka = pytest.importorskip("heyoka")
    leaves = {"t": heyoka.time + 0.25, "y": heyoka.make_vars("y"), "c": 0.7}
    (found,) = numbers_of(graph, [y], leaves, heyoka_functions(heyoka))
    compiled = heyoka.cfunc([heyoka.expression(found)], [leaves["y"]])
    return float(compiled([0.0], time=t - 0.25)[0])


@pytest.mark.parametrize("translated", [by_text, by_heyoka])
@pytest.mark.parametrize("name", CASES)
def test_each_operation_is_the_same_function_for_others(name: str, translated: object) -> None:
    text, function = CASES[name]
    graph, y = graph_of(text)
    has_sides = any(graph.operations[i].kind == "side" for i in graph.reached([y]))
    rel = 65 * 2.0**-53 if name == "large whole power" else 1e-15  # round-off of its factor counts 65 times
    for t in POINTS:
        if has_sides and translated is by_heyoka:
            with pytest.raises(TypeError):
                translated(graph, y, t)
        else:
            assert translated(graph, y, t) == pytest.approx(float(truth(function, t, 0)[0]), rel=rel, abs=1e-15)


# Who follows the motion


def installed(name: str) -> object:
    found = next((m for m in measure.peers() if m.name == name), None)
    if found is None:
        pytest.skip(f"{name} is not installed")
    return found


@pytest.mark.parametrize("name", ["SciPy DOP853", "SciPy odeint", "numbalsoda DOP853", "heyoka.py"])
def test_peers_follow_the_motion_of_formulas_in_their_own_ways(name: str) -> None:
    case = cases.case_of(rbfmu.Scene.from_dict(SPRING, "spring"))
    assert len(case.states) == 16
    assert {"position", "quaternion", "far", "states.u"} == {*case.names}
    method = installed(name)
    assert case.error(method.run(case, 1e-11).found) < 1e-8
    assert case.error(method.run(case, 1e-3).found) > 1e-8  # it is theirs, not the true motion


def test_a_constant_that_nothing_reads_has_no_place_and_needs_none() -> None:
    """2026-12-01: charts of such a scene, as of one whose formula was removed, ended in KeyError: 'constants.c'."""
    free = {"gravity_a": [0, 0, 0], "torque_b": [0.1, 0, 0.2]}
    scene = {"body": SPRING["body"], "constants": {"c": 0.4}, "loads": free, "outputs": {"quantities": ["omega_b"]}}
    case = cases.case_of(rbfmu.Scene.from_dict(scene | {"run": {"stop": 1.0, "step": 0.5}}, "spring"))
    assert case.error(installed("SciPy DOP853").run(case, 1e-11).found) < 1e-8


@pytest.mark.thorough
@pytest.mark.parametrize("name", [pytest.param("drone", marks=pytest.mark.thorough), "projectile"])
def test_solvers_follow_corners_and_tables_too(name: str) -> None:
    case = case_of(name)
    assert solvers._no_corners(case)
    assert case.error(SCIPY[-1].run(case, 1e-10).found) < 1e-4


# What is charted


def test_only_those_compete_that_take_formulas(monkeypatch: pytest.MonkeyPatch) -> None:
    drone, satellite = case_of("drone"), case_of("gravity_gradient")
    assert "corners or tables" in why_not(HEYOKA, drone)
    assert not why_not(HEYOKA, satellite)
    assert why_not(MUJOCO[-1], satellite) == "takes no formulas"
    assert why_not(SCIPY[3], satellite) == "formulas are compiled"
    monkeypatch.setattr(measure, "peers", lambda: [*SCIPY, HEYOKA, *MUJOCO])
    competing = measure.contestants(satellite)
    assert {method.family for method in competing} == {"Taylor", "peer", "planned"}
    assert "MuJoCo RK4" not in [method.name for method in competing]


def test_what_is_not_integrated_leaves_peers_nothing_to_do() -> None:
    tables = {
        "body": SPRING["body"], "outputs": {"quantities": [], "wave": "sin(t)"}, "run": {"stop": 1.0, "step": 0.1},
    }  # fmt: skip
    case = cases.case_of(rbfmu.Scene.from_dict(tables, "wave"))
    assert why_not(SCIPY[-1], case) == "nothing is to be integrated"


@pytest.mark.slow
def test_a_scene_with_formulas_has_its_chart(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    only = ("SciPy odeint", "Taylor, order 12", "rbfmu, as planned")
    monkeypatch.setattr(measure, "QUICK", measure.Extent(60.0, 2, 2e-4, True, only))
    found = rbfmu.chart(rbfmu.Scene.from_dict(SPRING, "spring"), quick=True)
    assert {row.kind for row in found.rows} == {"rbfmu's plan", "Taylor series", "SciPy odeint"}
    assert found.plan.error <= found.accuracy
    assert found.model == "formulas"
    assert all(file.stat().st_size > 0 for file in found.save(tmp_path))
