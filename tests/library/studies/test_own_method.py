"""A reader's own method, from a file: as theory says of Heun's, as Python, on the chart, and with messages."""

import math
from itertools import islice
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

import rbfmu
from rbfmu.studies import one_step, reference_methods
from rbfmu.studies.chart.methods import step_counts
from rbfmu.studies.one_step import method_of_file
from rbfmu.studies.stability import CURVE, method_laws, motions
from rbfmu.studies.stability.method_laws import largest_stable, order, own_laws
from rbfmu_kernels.mechanics.equations_of_motion import NO_LOADS
from tests.support.command_line import call
from tests.support.paths import ROOT

HEUN = ROOT / "examples" / "own_method.py"
FREE = {
    "body": {"mass": 1.0, "inertia": [1.0, 2.0, 3.0]}, "initial": {"omega_b": [0.1, 1.0, 0.1]},
    "outputs": {"quantities": ["quaternion"]}, "run": {"stop": 2.0, "step": 1.0, "accuracy": 1e-4},
}  # fmt: skip


@pytest.fixture
def heun():
    return method_of_file(HEUN)


@pytest.mark.thorough
def test_heuns_method_has_its_order_and_its_limits(heun):
    assert order(heun) == pytest.approx(2.0, abs=0.1)
    assert largest_stable(lambda x: method_laws.decay_factor(heun, x)) == pytest.approx(2.0, abs=1e-9)
    x = 0.4
    assert method_laws.growth(heun, x) == pytest.approx(abs(1 + 0.5j * x - x**2 / 8), rel=1e-15)


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["RK4, quaternion", "RK4, matrix", "Moser-Veselov, order 10"])
def test_the_order_is_that_of_fine_steps(name):
    """2026-11-27: RK4 had the order 4.54, between the first two steps with small errors."""
    method = reference_methods.ALL_INTEGRATORS[name]
    assert order(method) == pytest.approx(method.order, abs=0.07)


@pytest.mark.thorough
def test_code_that_numba_does_not_compile_gives_the_same_and_says_so(heun, tmp_path):
    path = tmp_path / "slow.py"
    lists = "def step(q, w, h, b, f): return [{*()} or list(part) for part in fast(q, w, h, b, f)]"
    path.write_text(f"{HEUN.read_text()}\nfast = step\n{lists}\n")
    slow = method_of_file(path)
    assert slow.name == "slow (as Python)"
    start, body = motions.TUMBLING.start, motions.TUMBLING.body
    assert slow.run(start, 0.1, 5, body, NO_LOADS).omega_b == pytest.approx(heun.run(start, 0.1, 5, body, NO_LOADS)[3])


def test_an_object_that_is_called_as_a_function_runs_as_python(tmp_path):
    """2026-11-28: the command ended with Numba's traceback."""
    path = tmp_path / "thing.py"
    path.write_text("class Rest:\n    def __call__(self, q, w, h, b, f): return q, w\nstep = Rest()\n")
    assert method_of_file(path).name == "thing (as Python)"


def test_steps_that_take_no_time_come_to_an_end():
    """2026-11-28: of a method that does nothing "OverflowError: int too big to convert" was told, at h = 2.7e-20 s."""
    case: Any = SimpleNamespace(interval=1.0, rate=1.0)
    assert 1e-13 < [*islice(step_counts(case, True), 100)][-1] < 1e-11


@pytest.mark.thorough
def test_curves_stand_beside_those_of_the_laws(heun):
    studies = [method_laws.gimbal_passage(True), method_laws.energy_drift(True)]
    found = own_laws(heun, studies)
    assert {f.law for f in found.findings} >= {4, 5, 6, 8, 14}
    assert all(f.holds and math.isfinite(f.measured) for f in found.findings)
    for study in studies:
        assert len(study.columns[CURVE]) == len(next(iter(study.columns.values())))


@pytest.mark.thorough
def test_it_competes_on_a_chart_that_asks_for_attitude_or_rates_alone():
    rows = rbfmu.chart(rbfmu.Scene.from_dict(FREE), quick=True, method=HEUN).rows
    assert min(row.error for row in rows if row.kind == "your method" and row.method == "own_method") < 1e-4


FAULTY = {
    "x = 1": "expected a function step(q, omega, h, body, loads)",
    "def step(q, omega): return q, omega": "expected a function step",
    "def step(q, omega, h, body, loads): return q": "got (1.0, 0.0, 0.0, 0.0)",
    "def step(q, omega, h, body, loads): return q, [0, 0, float('nan')]": "4 and 3 finite numbers",
    "def step(q, omega, h, body, loads): return momega": "NameError: name 'momega' is not defined",
    "def step(q, omega, h, body, loads: return q": "SyntaxError",
    None: "No such file",
}


@pytest.mark.parametrize("text", FAULTY)
def test_a_bad_file_is_refused_with_what_was_expected(text, tmp_path: Path):
    path = tmp_path / "bad.py"
    if text is not None:
        path.write_text(text)
    with pytest.raises(ValueError, match=r"bad\.py") as refused:
        method_of_file(path)
    assert FAULTY[text] in str(refused.value)


def test_what_a_step_raises_later_is_told_with_the_methods_name():
    """2026-11-27: the command ended with a traceback, or with the words of the error alone."""

    def steps(y, h, n, body, loads):
        raise RuntimeError("no convergence")

    start, body = motions.TUMBLING.start, motions.TUMBLING.body
    with pytest.raises(ValueError, match=r"implicit, a step of 0\.5 s: RuntimeError: no convergence"):
        one_step._Own("implicit", steps, 0, math.nan).run(start, 0.5, 1, body, NO_LOADS)


def test_a_command_refuses_a_bad_file_before_it_writes(tmp_path: Path):
    done = call("stability", "--quick", "--method", tmp_path / "absent.py", "-o", tmp_path / "found")
    assert done.exit_code == 2
    assert "absent.py" in done.stderr
    assert "does not exist" in done.stderr
    assert not (tmp_path / "found").exists()
