"""Wrong arguments of functions that people call: one error that names the argument, its value and what was expected."""

import re
from pathlib import Path

import numpy as np
import pytest

import rbfmu

SCENE = rbfmu.Scene(
    body={"mass": 1.0, "inertia": [1.0, 2.0, 2.5]}, initial={"omega_b": [0.1, 0.2, 0.3]},
    outputs={"quantities": ["quaternion", "omega_b"]}, run={"stop": 1.0, "step": 0.1},
    ensemble={"runs": 4, "vary": {"body.mass": {"normal": [1.0, 0.01]}}},
)  # fmt: skip
RESULT = rbfmu.simulate(SCENE)
NO_PLAN = "planned = {}: expected a rbfmu.Plan"
WRONG = [
    (lambda: rbfmu.simulate(SCENE, planned="x"), TypeError, NO_PLAN.format('"x"')),
    (lambda: rbfmu.simulate(SCENE, planned={}), TypeError, NO_PLAN.format("{}")),
    (lambda: rbfmu.simulate(SCENE, progress=True), TypeError, "progress = true: expected a function"),
    (lambda: rbfmu.simulate(SCENE, interpolate="x"), rbfmu.SceneError,
     "interpolate = \"x\": expected 'hold' or 'linear'"),
    (lambda: rbfmu.compiled_step(SCENE, 3), TypeError, NO_PLAN.format("3")),
    (lambda: rbfmu.run_ensemble(SCENE, planned="x"), TypeError, NO_PLAN.format('"x"')),
    (lambda: rbfmu.sensitivity(SCENE, ["body.inertia"], planned="x"), TypeError, NO_PLAN.format('"x"')),
    (lambda: rbfmu.sensitivity(SCENE, by=[3]), ValueError, "by = 3: expected one of initial.attitude, "),
    (lambda: rbfmu.sensitivity(SCENE, by=3), ValueError, "by = 3: expected one of initial.attitude, "),
    (lambda: rbfmu.sensitivity(SCENE, by=["body.mass", "body.mass"]), ValueError,
     "by: expected each number once, not body.mass, body.mass"),
    (lambda: rbfmu.sensitivity(SCENE, "body.mass", covariance="x"), ValueError, "covariance: expected a matrix (1, 1)"),
    (lambda: rbfmu.sensitivity(SCENE, "body.mass", covariance={}), ValueError, "covariance: expected a matrix (1, 1)"),
    (lambda: rbfmu.sensitivity(SCENE, "body.mass", covariance=np.ma.masked_array([[1.0]], mask=True)), ValueError,
     "covariance: expected a matrix (1, 1) for body.mass, which must have no mask"),
    (lambda: rbfmu.sensitivity(SCENE, "body.mass", covariance=[[1.0 + 1.0j]]), ValueError,
     "covariance: expected a matrix (1, 1) for body.mass, which must be real numbers, got [[(1+1j)]]"),
    (lambda: rbfmu.fit(SCENE, RESULT, free=[3]), ValueError, "free = 3: expected one of initial.attitude, "),
    (lambda: rbfmu.fit(SCENE, RESULT, free=[["x"]]), ValueError, "free = ['x']: expected one of initial.attitude, "),
    (lambda: rbfmu.linearize(SCENE, "x"), ValueError, "t = 'x': expected a time from run.start = 0.0 to run.stop"),
    (lambda: rbfmu.linearize(SCENE, True), ValueError, "t = True: expected a time from run.start = 0.0 to run.stop"),
    (lambda: rbfmu.Simulator(3), TypeError, "Simulator: scene = 3: expected a rbfmu.Scene or the path of a scene file"),
    (lambda: rbfmu.Simulator(SCENE).restore("x"), TypeError, 'state = "x": expected the bytes that `save` returned'),
    (lambda: rbfmu.Result.of_rows([3]), ValueError, "rows[0]: expected time and the same quantities in each"),
    (lambda: rbfmu.Result.of_rows([{}]), ValueError, "rows[0]: expected time and the same quantities in each"),
    (lambda: rbfmu.Result.of_rows([{"time": 0, "rpy": [1, 2, 3]}, {"time": 1, "rpy": [1]}]), ValueError,
     "rpy must be a"),
    (lambda: rbfmu.Result.of_rows([{"time": 0.0, "rpy": [0] * 3}, {"time": 1.0, "omega_b": [0] * 3}]), ValueError,
     "rows[1]: expected time and the same quantities in each"),
    (lambda: rbfmu.Result.of_rows([{"time": 0.0}, {"x": 1}]), ValueError, "rows[1]: expected time and the same"),
    (lambda: RESULT.until("x"), ValueError, "stop = 'x': expected a time from 0.0 s on"),
    (lambda: RESULT.until(-1.0), ValueError, "stop = -1.0: expected a time from 0.0 s on"),
    (lambda: RESULT.until(np.nan), ValueError, "stop = nan: expected a time from 0.0 s on"),
    (lambda: rbfmu.run_ensemble(SCENE, 4), TypeError, "store = 4: expected a path"),
    (lambda: rbfmu.load_scene(4), TypeError, "path = 4: expected a path"),
    (lambda: RESULT.save(4), TypeError, "path = 4: expected a path"),
    (lambda: RESULT.plot(4), TypeError, "path = 4: expected a path"),
    (lambda: rbfmu.Result.load(None), TypeError, "path = None: expected a path"),
    (lambda: rbfmu.EnsembleResult.load(RESULT), TypeError, "path = Result("),
    (lambda: rbfmu.Simulator(SCENE).step(True), TypeError, "h = true: expected a number (s)"),
    (lambda: rbfmu.Result([0.0], [[0.0] * 3]), TypeError, "Result: [[0.0, 0.0, 0.0]]: expected a mapping from"),
    (lambda: rbfmu.Result([0.0], {}, events=3), TypeError, "Result: 3: expected a mapping from names to arrays"),
    (lambda: SCENE.replace({"outputs.quantities": ["omega_b", np.ones(3)]}), rbfmu.SceneError,
     "outputs.quantities = [\"omega_b\", [1.0, 1.0, 1.0]]: expected a list of distinct names"),
    (lambda: SCENE.replace(loads=3), rbfmu.SceneError, "torque_b, damping_b, potential"),
    (lambda: SCENE.replace(3), rbfmu.SceneError, "scene: changes = 3: expected a mapping from keys to their values"),
]  # fmt: skip


@pytest.mark.parametrize(("call", "error", "said"), WRONG, ids=[str(k) for k in range(len(WRONG))])
def test_a_wrong_argument_is_named(call, error, said):
    with pytest.raises(error, match=re.escape(said)):
        call()


SEEN = [
    (lambda: rbfmu.view(3), TypeError, "source = 3: expected a rbfmu.Scene, a rbfmu.Result, or the path"),
    (lambda: rbfmu.view(None), TypeError, "source = None: expected a rbfmu.Scene, a rbfmu.Result, or the path"),
    (lambda: rbfmu.view(SCENE, 3), TypeError, "path = 3: expected the path of a page to write, or None"),
    (lambda: rbfmu.view(RESULT, scene=3), TypeError, "scene = 3: expected a rbfmu.Scene or the path of a scene file"),
    (lambda: rbfmu.view(RESULT, stop="x"), ValueError, "stop = 'x': expected a time from 0.0 s on"),
    (lambda: rbfmu.view(SCENE, stop="x"), rbfmu.SceneError,
     "scene with stop 'x': run.stop = \"x\": expected a number (s)"),
    (lambda: rbfmu.view(SCENE, interpolate="x"), rbfmu.SceneError, "interpolate = \"x\": expected 'hold' or 'linear'"),
]  # fmt: skip


@pytest.mark.parametrize(("call", "error", "said"), SEEN, ids=[str(k) for k in range(len(SEEN))])
def test_a_wrong_argument_of_a_view_is_named(call, error, said):
    pytest.importorskip("viser")
    with pytest.raises(error, match=re.escape(said)):
        call()


def test_times_may_be_numbers_of_numpy():
    assert len(RESULT.until(np.float32(0.5)).time) == len(RESULT.until(np.int64(1)).time) - 5
    assert rbfmu.linearize(SCENE, np.float64(0.5)).time == 0.5


def test_inputs_stand_by_place_and_by_name():
    driven = SCENE.replace({"inputs.ports": ["torque_b"], "ensemble": None})
    given = {"torque_b": ([0.0, 1.0], [[0.1, 0.0, 0.0], [0.2, 0.0, 0.0]])}
    by_place = rbfmu.simulate(driven, given, "linear")
    by_name = rbfmu.simulate(driven, inputs=given, interpolate="linear")
    np.testing.assert_array_equal(by_place.omega_b, by_name.omega_b)
    assert by_place.omega_b[-1, 0] > 0.2  # 0.1 and the integral of the torque, 0.15


def test_a_protected_file_is_not_replaced(tmp_path, monkeypatch):
    """A folder lets any of its files be replaced, as that takes a rename alone."""
    (path := tmp_path / "it.csv").write_text("precious")
    monkeypatch.setattr("os.access", lambda place, mode: Path(place) != path)  # root may write whatever its mode is
    with pytest.raises(PermissionError, match=str(path)):
        RESULT.save(path)
    assert path.read_text() == "precious"
    assert [*tmp_path.iterdir()] == [path]
