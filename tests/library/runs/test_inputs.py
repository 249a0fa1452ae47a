"""Runs that are driven by inputs: against 20-digit motions, their order in the table's spacing, and what is refused."""

import math
import warnings
from itertools import product

import numpy as np
import pytest

import rbfmu
from rbfmu.models.registry import LOADED_TAYLOR
from rbfmu.runs.inputs import drive_of, input_tables
from tests.support.scenes.model_cases import MOVING, OFFSET

PORTS = ("force_a", "force_b", "torque_a", "torque_b")
TIMES = np.array([0.0, 0.375, 0.8, 1.5])
"""One row lies at a communication point of STEP, one inside a step."""
STEP, STOP, ACCURACY = 0.375, 1.5, 1e-9
VALUES = {port: np.random.default_rng(k).normal(scale=0.5, size=(len(TIMES), 3)) for k, port in enumerate(PORTS)}


def scene(**more):
    tables = {
        "body": OFFSET, "initial": MOVING, "loads": {"gravity_a": [0.0, 0.0, -1.0]}, "inputs": {"ports": list(PORTS)},
        "run": {"stop": STOP, "step": STEP, "accuracy": ACCURACY},
    }  # fmt: skip
    return rbfmu.Scene.from_dict(tables | more)


def at_rest(port, *shown, **tables):
    body, outputs = {"mass": 2.0, "inertia": [1.0, 2.0, 3.0]}, {"quantities": list(shown)}
    return scene(body=body, initial={}, inputs={"ports": [port]}, outputs=outputs, **tables)


@pytest.mark.parametrize(("interpolate", "order"), [("hold", 1), ("linear", 2)])
def test_a_sampled_torque_is_followed_in_the_order_of_its_interpolation(interpolate, order):
    """torque_b = sin t about a principal axis: omega = 1 - cos t, turned by t - sin t."""
    about_x = at_rest("torque_b", "quaternion", "omega_b", run={"stop": 2.0, "step": 0.5, "accuracy": 1e-10})
    errors = []
    for n in (20, 40):
        t = 2.0 * np.linspace(0.0, 1.0, n + 1) ** 1.5  # few at communication points, no two as far apart
        torque = np.column_stack([np.sin(t), 0.0 * t, 0.0 * t])
        found = rbfmu.simulate(about_x, inputs={"torque_b": (t, torque)}, interpolate=interpolate)
        errors.append(abs(2.0 * math.atan2(found.quaternion[-1, 1], found.quaternion[-1, 0]) - (2.0 - math.sin(2.0))))
    assert math.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.05)
    assert errors[1] < (0.05 if order == 1 else 1e-3)


def test_a_model_without_input_derivatives_sees_the_mean_of_each_step_and_the_last_value_at_its_end():
    """force_a = t on a body that does not turn: velocity t^2 / 2 exactly, acceleration t / mass at the points."""
    falling = at_rest("force_a", "position", "velocity", "acceleration", loads={"gravity_a": [0, 0, 0]},
                      run={"stop": 1.0, "step": 0.125, "accuracy": 1e-2})  # fmt: skip
    ramp = {"force_a": ([0.0, 1.0], [[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]])}
    found = rbfmu.simulate(falling, inputs=ramp, interpolate="linear")
    np.testing.assert_allclose(found.velocity[:, 2], found.time**2 / 4, atol=1e-15)
    np.testing.assert_allclose(found.acceleration[:, 2], found.time / 2, atol=1e-15)
    error = np.abs(found.position[:, 2] - found.time**3 / 12)
    assert 1e-4 < error.max() < 1e-2  # second order in the step: the mean of a step is too much at its begin
    assert rbfmu.plan(falling, inputs=ramp, interpolate="linear").error == pytest.approx(error.max(), rel=1e-6)


def test_where_a_models_error_under_the_inputs_is_too_large_a_larger_one_is_planned():
    falling = at_rest("force_a", "position", run={"stop": 1.0, "step": 0.125, "accuracy": 1e-9})
    ramp = {"force_a": ([0.0, 1.0], [[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]])}
    smallest, driven = rbfmu.plan(falling), rbfmu.plan(falling, inputs=ramp, interpolate="linear")
    assert smallest.model != driven.model == LOADED_TAYLOR.key
    assert driven.error < 1e-9
    assert any("planned for any inputs, misses" in line for line in driven.reasons)
    found = rbfmu.simulate(falling, inputs=ramp, interpolate="linear")
    np.testing.assert_allclose(found.position[:, 2], -0.5 * found.time**2 + found.time**3 / 12, atol=1e-9)


def test_a_model_that_leaves_the_rotation_out_is_driven_by_a_torque_as_well():
    falling = at_rest("torque_a", "position", run={"stop": 1.0, "step": 0.25})
    torque = {"torque_a": ([0.0, 1.0], [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])}
    planned = rbfmu.plan(falling, inputs=torque)
    found = rbfmu.simulate(falling, inputs=torque)
    assert planned.model == "no rotation"
    np.testing.assert_allclose(found.position[:, 2], -0.5 * found.time**2, atol=1e-15)


def test_a_row_a_step_is_held_over_it_and_ports_that_are_not_named_are_zero():
    t, rows = TIMES[:1] + STEP * np.arange(4), np.random.default_rng(5).normal(size=(4, 3))
    one = rbfmu.simulate(scene(), inputs={"torque_b": rows})
    other = rbfmu.simulate(scene(), inputs={"torque_b": (t, rows), "force_a": (t, 0.0 * rows)})
    for name, values in one.quantities.items():
        np.testing.assert_array_equal(values, other.quantities[name], err_msg=name)


def pieces_with(times, run, *others):
    """How many pieces a run has under a table with rows at these times, and maybe others."""
    one = scene(inputs={"ports": list(PORTS)}, run=run)
    tables = {port: (at, np.zeros((len(at), 3))) for port, at in zip(PORTS, (times, *others), strict=False)}
    return len(drive_of(one, input_tables(one, tables), "hold").lengths)


def test_a_row_is_at_a_communication_point_or_at_another_within_a_billionth_of_a_step():
    run = {"stop": 4.0, "step": 1.0}
    assert pieces_with([0.0, 1.0 + 5e-10, 2.0 - 5e-10, 3.0, 4.0], run) == 4
    assert pieces_with([0.0, 1.0 + 1e-8, 2.0 - 1e-8, 3.0, 4.0], run) == 6
    assert pieces_with([0.0, 0.25, 3.0, 4.0], run, [0.0, 0.25 + 5e-10, 3.0, 4.0]) == 5
    assert pieces_with([0.0, 0.25, 3.0, 4.0], run, [0.0, 0.25 + 1e-8, 3.0, 4.0]) == 6
    coarse = {"start": 1e15, "stop": 1e15 + 2.0, "step": 0.5}  # where times are an eighth of a second apart
    assert pieces_with([1e15, 1e15 + 0.625, 1e15 + 1.5, 1e15 + 2.0], coarse) == 5


def test_a_scalar_s_numbers_may_stand_in_a_row_or_in_a_column():
    one = scene(inputs={"ports": [{"name": "u", "size": 1}]})
    for given in ([1.0, 2.0, 3.0, 4.0], [[1.0], [2.0], [3.0], [4.0]]):
        for table in (given, ([0.0, 0.5, 1.0, 1.25], given)):
            assert input_tables(one, {"u": table})["u"].values.tolist() == [[1.0], [2.0], [3.0], [4.0]]


@pytest.mark.parametrize("rows", [4, 5])
def test_an_array_has_a_row_a_step_or_a_row_a_point(rows):
    one = scene()
    assert len(input_tables(one, {"force_a": np.zeros((rows, 3))})["force_a"].times) == rows
    if rows == 4:
        with pytest.raises(rbfmu.SceneError, match=r"shape \(4, 3\): .* 5 rows, one a communication point, of 3 numb"):
            input_tables(one, {"force_a": np.zeros((4, 3))}, "linear")


@pytest.mark.parametrize(
    ("start", "stop", "step"), [(1e5, 1e5 + 1.0, 1e-3), (1e6, 1e6 + 1.0, 1e-3), (0.0, 1000.0, 0.3333333333)]
)
def test_round_off_of_late_times_refuses_no_table_and_cuts_no_step(start, stop, step):
    run = {"start": start, "stop": stop, "step": step}
    one = scene(inputs={"ports": ["torque_b"]}, run=run)
    n = one.run.count
    cumulated = start + np.cumsum(np.r_[0.0, np.full(n - 1, step)])
    for given in (np.ones((n, 3)), (cumulated, np.ones((n, 3)))):
        tables = input_tables(one, {"torque_b": given})
        assert len(drive_of(one, tables, "hold").lengths) == n
    grid, rows = one.run.grid(), np.tile(np.arange(n + 1.0)[:, None], 3)
    for way, interpolate in product((-math.inf, math.inf), ("hold", "linear")):
        tables = input_tables(one, {"torque_b": (np.nextafter(grid, way), rows)}, interpolate)
        drive = drive_of(one, tables, interpolate)
        assert len(drive.lengths) == n
        np.testing.assert_allclose(drive.values, rows[:-1], atol=1e-6)
        assert drive.at_row.all()


def test_prescribed_rates_take_inputs_as_well():
    turning = rbfmu.Scene.from_dict({"inputs": {"ports": ["omega_b"]}, "run": {"stop": 2.0, "step": 0.25}})
    ramp = {"omega_b": ([0.0, 2.0], [[0.0, 0.0, 0.0], [0.0, 0.0, 2.0]])}
    found = rbfmu.simulate(turning, inputs=ramp, interpolate="linear")
    angle = 2.0 * np.arctan2(found.quaternion[:, 3], found.quaternion[:, 0])
    np.testing.assert_allclose(angle, found.time**2 / 2, atol=1e-14)


@pytest.mark.parametrize(
    ("at", "after"),
    [(5.0, math.nextafter(5.0, 6.0)), (5.2, math.nextafter(5.2, 6.0)), (5.2, 5.2), (math.nextafter(5.0, 4.0), 5.0)],
)
def test_two_rows_at_one_time_are_a_jump_of_linear_inputs(at, after):
    """omega = torque t / inertia from there on; a ramp up to the next point would lose half of a step."""
    pushed = at_rest("torque_b", "omega_b", run={"stop": 10.0, "step": 0.5})
    times, torque = [0.0, at, after, 10.0], np.zeros((4, 3))
    torque[2:] = [0.02, 0.0, 0.0]
    driven = {"inputs": {"torque_b": (times, torque)}, "interpolate": "linear"}
    found = rbfmu.simulate(pushed, planned=rbfmu.plan(pushed), **driven)
    np.testing.assert_allclose(found.omega_b[:, 0], 0.02 * np.maximum(found.time - at, 0.0), atol=1e-15)


def test_a_file_gives_the_same_as_its_numbers(tmp_path):
    t, rows = TIMES, VALUES["torque_b"]
    path = tmp_path / "inputs.csv"
    names = ("time", "torque_b[2]", "torque_b[1]", "torque_b[3]")
    lines = [",".join(map(repr, (s, u[1], u[0], u[2]))) for s, u in zip(t.tolist(), rows.tolist(), strict=True)]
    path.write_text(",".join(f'"{name}"' for name in names) + "\n" + "\n".join(lines) + "\n")
    found = input_tables(scene(), path)
    np.testing.assert_array_equal(found["torque_b"].times, t)
    np.testing.assert_array_equal(found["torque_b"].values, rows)
    lines = [f"{s!r},{u[0]!r} {u[1]!r} {u[2]!r}" for s, u in zip(t.tolist(), rows.tolist(), strict=True)]
    path.write_text("time,torque_b\n" + "\n".join(lines) + "\n")  # as FMPy has those of FMI 3.0
    np.testing.assert_array_equal(input_tables(scene(), path)["torque_b"].values, rows)


T = [0.0, 1.0, 2.0]
ZEROS = np.zeros((3, 3))
BAD = {
    "no port": ({"weight": (T, ZEROS)}, "inputs 'weight': expected one of the scene's ports, force_a"),
    "shape": ({"force_a": (T, np.zeros((3, 2)))}, r"shapes \(3,\) and \(3, 2\): expected times \(m,\) and values"),
    "rows": ({"force_a": np.zeros((7, 3))}, r"shape \(7, 3\): expected \(times, values\), or 4 rows, one a step"),
    "three numbers": ({"force_a": [1.0, 2.0, 3.0]}, r"shape \(3,\): expected \(times, values\), or 4 rows, one a step"),
    "text": ({"force_a": "abc"}, r"inputs 'force_a': values must be real numbers, got 'abc': expected \(times"),
    "function": ({"force_a": lambda t: ZEROS}, r"'force_a': a function: expected \(times, values\)"),
    "function of times": ({"force_a": (T, lambda t: ZEROS)}, r"'force_a': a function: expected \(times, values\)"),
    "ragged": ({"force_a": (T, [[0, 0, 0], [0, 0], [0]])}, r"'force_a': values must be a regular array .*: expected"),
    "dates": ({"force_a": (np.array([0, 1, 2], "datetime64[s]"), ZEROS)},
        "times must be real numbers, got an array of dat"),
    "mask": ({"force_a": (T, np.ma.masked_greater(ZEROS, 1.0))}, "'force_a': values must have no mask"),
    "complex": ({"force_a": (T, ZEROS + 1j)}, "'force_a': values must be real numbers, got an array of complex128"),
    "NaN": ({"force_a": (T, [[0, 0, 0], [0, math.nan, 0], [0, 0, 0]])}, r"force_a\[2\] = nan in row 2: expected a fin"),
    "NaN time": ({"force_a": ([0.0, math.nan, 2.0], ZEROS)}, "times of force_a = nan in row 2: expected a finite"),
    "order": ({"force_a": ([0.0, 2.0, 2.0], ZEROS)}, "times of force_a = 2.0 in row 3: expected a time after 2.0 s"),
    "begin": ({"force_a": ([0.1, 1.0, 2.0], ZEROS)}, "times of force_a = 0.1 in row 1: expected at most 0.0 s"),
    "kind": (3, 'inputs = "int": expected a mapping'),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_wrong_inputs_are_refused_in_one_message(name):
    inputs, message = BAD[name]
    with pytest.raises(rbfmu.SceneError, match=message):
        rbfmu.simulate(scene(), inputs=inputs)


def test_a_last_row_is_held_to_the_end_of_the_run_and_a_table_that_may_be_cut_short_is_told():
    times, forces = [0.0, 0.1, 0.2], np.arange(9.0).reshape(3, 3)
    with pytest.warns(rbfmu.SceneWarning, match=r"the last inputs of force_a are held for 1\.3 s, to the end"):
        found = rbfmu.simulate(scene(), inputs={"force_a": (times, forces)})
    whole = {"force_a": ([*times, STOP], forces[[0, 1, 2, 2]])}
    assert found.position.tobytes() == rbfmu.simulate(scene(), inputs=whole).position.tobytes()


@pytest.mark.parametrize(
    ("times", "is_doubted"), [([0.0], False), ([0.0, 0.7], True), ([0.0, 0.3, 0.6, 0.9, 1.2], False)]
)
def test_a_table_is_doubted_where_its_last_row_is_held_longer_than_the_one_before(times, is_doubted):
    """One row is constant; the last of equally spaced ones is held as long as the others, but for round-off."""
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        input_tables(scene(), {"force_a": (times, np.zeros((len(times), 3)))})
    assert [warning.category for warning in told] == [rbfmu.SceneWarning] * is_doubted


def test_ports_that_are_held_alike_are_doubted_together():
    with pytest.warns(rbfmu.SceneWarning, match=r"the last inputs of force_a, torque_b are held for 1\.3 s"):
        input_tables(scene(), {port: ([0.0, 0.1, 0.2], ZEROS) for port in ("force_a", "torque_b")})


def test_a_table_is_doubted_also_beside_one_that_was_read_before():
    """As a fit has them, which gives times to arrays with a row a step."""
    read = input_tables(scene(), {"torque_a": np.zeros((4, 3))})
    with pytest.warns(rbfmu.SceneWarning, match="the last inputs of force_a are held for"):
        input_tables(scene(), {**read, "force_a": ([0.0, 0.1, 0.2], ZEROS)})


def test_linear_inputs_must_reach_the_end_and_the_way_to_interpolate_must_be_known():
    with pytest.raises(rbfmu.SceneError, match=r"1\.4 in row 3, the last: expected at least 1\.5 s"):
        rbfmu.simulate(scene(), inputs={"force_a": ([0.0, 1.0, 1.4], ZEROS)}, interpolate="linear")
    with pytest.raises(rbfmu.SceneError, match='interpolate = "cubic": expected'):
        rbfmu.simulate(scene(), inputs={"force_a": (T, ZEROS)}, interpolate="cubic")


FILES = {
    "unknown": ("time,torque_x\n0,1\n", 'column "torque_x": expected one of time, force_a'),
    "missing": ("time,force_a[1],force_a[3]\n0,1,1\n",
        r"column 'force_a\[2\]' is missing: expected all of time, force"),
    "columns before cells": ("time,force_a[1],force_a[2],torque_x\n0,1,x,y\n1,2\n",
        r'column "torque_x": .*\n.*\'force_a\[3\]\' is missing: .*\n.*force_a\[2\] = "x" .*\n.*row 2 has 2 cells.*\Z'),
    "no time": ("force_a[1],force_a[2],force_a[3]\n1,1,1\n", "column 'time' is missing"),
    "twice": ("time,time,force_a[1],force_a[2],force_a[3]\n0,0,1,1,1\n", "column 'time' stands twice"),
    "NaN": ("time,force_a[1],force_a[2],force_a[3]\n0,1,1,1\n3,1,nan,1\n", r'force_a\[2\] = "nan" in row 2: expected'),
    "header": ("time,force_a[1],force_a[2],force_a[3]\n", "no rows: expected a header, and a row of numbers a time"),
    "bytes": (b"\xff\xfe\x00", "not a CSV file"),
    "order": ("time,force_a[1],force_a[2],force_a[3]\n0,1,1,1\n0,1,1,1\n", "time = 0.0 in row 2: expected a time aft"),
}  # fmt: skip


@pytest.mark.parametrize("name", FILES)
def test_wrong_files_are_refused_with_their_name_and_row(name, tmp_path):
    content, message = FILES[name]
    path = tmp_path / "wrong.csv"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(rbfmu.SceneError, match=message) as caught:
        rbfmu.simulate(scene(), inputs=path)
    assert str(path) in str(caught.value)


def test_inputs_under_which_a_load_has_no_value_are_refused_and_no_output_is_blamed():
    one = rbfmu.Scene(
        body={"mass": 1.0, "inertia": [1.0, 2.0, 2.5]}, loads={"torque_b": "[0, 0, sqrt(u)]"},
        inputs={"ports": [{"name": "u", "size": 1, "start": 1.0}]}, outputs={"spin": "norm(omega_b)"},
        run={"stop": 1.0, "step": 0.25},
    )  # fmt: skip
    with pytest.raises(rbfmu.SceneError, match=r"inputs: expected others from t = 0\.5 s on, where a formula is"):
        rbfmu.simulate(one, {"u": ([0.0, 0.5], [1.0, -1.0])})


def test_a_file_that_is_not_there_and_a_scene_without_ports_are_refused(tmp_path):
    with pytest.raises(rbfmu.SceneError, match=r"none\.csv: cannot be read \(No such file"):
        rbfmu.simulate(scene(), inputs=tmp_path / "none.csv")
    with pytest.raises(rbfmu.SceneError, match="inputs are given: expected none, as the scene has no ports"):
        rbfmu.simulate(scene(inputs={}), inputs={"force_a": (T, ZEROS)})


def test_a_table_is_read_with_warnings_as_they_are(tmp_path, monkeypatch):
    """What threads that read at once ignored together stayed ignored: from then on nothing that looks like a slip."""
    path, found, load = tmp_path / "inputs.csv", [], np.loadtxt
    path.write_text("time,torque_b[1],torque_b[2],torque_b[3]\n0,0,0,0\n2,0,0,1\n")
    monkeypatch.setattr(np, "loadtxt", lambda *lines, **how: found.append([*warnings.filters]) or load(*lines, **how))
    input_tables(scene(), path)
    assert found == [[*warnings.filters]]
