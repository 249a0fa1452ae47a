"""Measured motion as a fit reads it: tables, results of rbfmu's own, gaps, and what is no data."""

import os

import numpy as np
import pytest

import rbfmu
from rbfmu.identification.measured import QUATERNION, read_measured, residuals
from rbfmu.identification.noise import scatter
from rbfmu.result import quaternion_lengths


def csv_of(tmp_path, text):
    (tmp_path / "data.csv").write_text(text)
    return tmp_path / "data.csv"


W = "time,omega_b[1],omega_b[2],omega_b[3]\n"
SCENE = rbfmu.Scene(
    body={"mass": 1.0, "inertia": [1.0, 1.5, 2.0]}, initial={"omega_b": [0.1, 0.2, 0.3]}, run={"stop": 4.0, "step": 0.5}
)


@pytest.mark.parametrize(("text", "said"), [
    ("", "column 'time' is missing"),
    ("time,time\n1,2\n", "each column once"),
    (W, "expected at least two finite times"),
    (W + "0,1,2,3\n", "at least two finite times"),
    (W + "0,1,2,3\n0,1,2,3\n", "that increase"),
    (W + "1,1,2,3\n0,1,2,3\n", "that increase"),
    (W + ",1,2,3\n0,1,2,3\n", "finite times"),
    (W + "-1,1,2,3\n0,1,2,3\n", r"time = -1\.0 in row 1: expected at least run\.start"),
    (W + "0,1,2\n1,1,2,3\n", "row 1 has 3 cells: expected 4"),
    (W + "0,1,x,3\n1,1,2,3\n", r'omega_b\[2\] = "x" in row 1: expected a number'),
    (W + "0,1,inf,3\n1,1,2,3\n", "omega_b = inf in row 1: expected finite numbers"),
    (W + "0,,,\n1,,,\n", "expected at least one measured output"),
    ("time,omega_b[1]\n0,1\n1,1\n", r"omega_b\[2\] is missing"),
    ("time,speed,omega_b[1]\n0,x,y\n1,1,1\n",
     r"'speed': .*\n.*omega_b\[2\] is missing.*\n.*omega_b\[1\] = \"y\" in row 1: [^\n]*\Z"),
    ("time,speed\n0,1\n1,1\n", "'speed': expected outputs among position"),
    ("time,quaternion[1],quaternion[2],quaternion[3],quaternion[4]\n0,2,0,0,0\n1,1,0,0,0\n", "has length 2"),
    (W + "0,nan,2,3\nnan,1,2,3\n", "time = nan in row 2, after 0.0: expected finite times"),
    (W + "0,1,2,3\n1,1,2,3\n1,1,2,3\n", "time = 1.0 in row 3, after 1.0: expected finite times"),
    ("time;omega_b[1]\n0;1\n1;1\n", "column 'time' is missing"),
    (W + "0,1,2,3\n1,1,,\n", "data: 4 numbers: expected at least 7, more than"),
])  # fmt: skip
def test_bad_tables_are_refused_by_one_message(tmp_path, text, said):
    with pytest.raises(ValueError, match=said):
        rbfmu.fit(SCENE, csv_of(tmp_path, text), ["body.inertia", "initial.omega_b"])


def test_derivatives_of_what_is_left_of_an_attitude_hold_for_large_turns():
    rng, step = np.random.default_rng(5), 1e-6
    run, data = (rbfmu.normalize(rng.normal(size=(9, 4))) for _ in range(2))
    slopes = rng.normal(size=(9, 3, 2))
    left, found = residuals(QUATERNION, run, data, slopes)
    assert np.max(np.linalg.norm(left, axis=1)) > 1.5
    np.testing.assert_array_equal(residuals(QUATERNION, run, -data, slopes)[0], left)  # the same attitudes
    for n in range(2):
        turns = (rbfmu.quaternion_from_rotvec(h * slopes[:, :, n]) for h in (step, -step))
        ahead, behind = (residuals(QUATERNION, rbfmu.compose_quaternions(run, q), data, slopes)[0] for q in turns)
        np.testing.assert_allclose(found[:, :, n], (ahead - behind) / (2.0 * step), atol=1e-8)


@pytest.mark.thorough
def test_a_run_s_own_result_serves_as_data(tmp_path):
    """It was refused, as it has the attitude twice; the quaternion counts, and angles where that has a gap.

    As a Dataset of xarray's, whose time is a coordinate, it ended in a KeyError; a DataFrame was refused.
    """
    scene = SCENE.replace({"outputs.quantities": ["quaternion", "rpy"]})
    run, guess = rbfmu.simulate(scene), scene.replace({"initial.omega_b": [0.0, 0.25, 0.3]})
    run.save(tmp_path / "run.csv")
    gaps = {"time": run.time, "quaternion": run.quaternion.copy(), "rpy": run.rpy.copy()}
    gaps["quaternion"][4:, 0], gaps["rpy"][:4] = np.nan, 0.1
    table = run.to_dataframe()
    for data in (run, tmp_path / "run.csv", run.to_xarray(), table, table.reset_index(), gaps):
        one = rbfmu.fit(guess, data, ["initial.omega_b"])
        assert one.values == pytest.approx([0.1, 0.2, 0.3], abs=1e-8)
        assert one.measured.count == 27


def test_a_dataframe_with_faults_is_refused_as_a_file_is():
    table = rbfmu.simulate(SCENE).to_dataframe()[["omega_b[1]", "omega_b[3]"]]
    with pytest.raises(ValueError, match=r"data: omega_b\[2\] is missing"):
        rbfmu.fit(SCENE, table, ["initial.omega_b"])
    with pytest.raises(ValueError, match="data: expected a file, a Result, a DataFrame, or a mapping"):
        rbfmu.fit(SCENE, table.iloc[:0, :0].reset_index(drop=True), ["initial.omega_b"])


def test_what_an_importer_writes_of_an_fmu_is_data(tmp_path):
    """FMPy writes all outputs: `status` was refused, and so were counts and times of events, and states."""
    wheel = {"start": [0, 0, 0], "rate": "omega_b"}
    scene = SCENE.replace({"states.wheel": wheel, "loads.torque_b": "-0.01*wheel", "events.slow": "omega_b[1]"})
    others = "slow_time,wheel[1],wheel[2],wheel[3],status,slow_count"
    rows = "".join(f"{t},0.1,0.2,0.3,0,0,0,0,0,0\n" for t in range(3))
    path = csv_of(tmp_path, f"{W[:-1]},{others}\n{rows}")
    assert rbfmu.fit(scene, path, ["initial.omega_b"]).measured.values.keys() == {"omega_b"}


def test_arrays_of_a_file_are_data_with_own_outputs_and_gaps(tmp_path):
    """Outputs of one's own were left out of an .npz, and gaps refused; a CSV has both."""
    outputs = {"quantities": ["kinetic_energy"], "spin": "norm(omega_b)"}
    scene = SCENE.replace({"events.slow": "omega_b[1]"}, outputs=outputs)
    rbfmu.simulate(scene).save(tmp_path / "run.npz")
    guess = scene.replace({"initial.omega_b": [0.1, 0.2, 0.2]})
    assert rbfmu.fit(guess, tmp_path / "run.npz", ["initial.omega_b[3]"]).measured.count == 18
    np.savez(tmp_path / "gap.npz", time=[0.0, 1.0, 2.0], spin=[0.1, np.nan, 0.1], other=[[1.0]])
    assert rbfmu.fit(guess, tmp_path / "gap.npz", ["initial.omega_b[3]"]).measured.count == 2
    arrays = csv_of(tmp_path, "time,omega_b\n0,0.1 0.2 0.3\n1,\n2,0.1 nan 0.3\n")
    assert read_measured(guess, arrays).count == 5
    assert read_measured(guess, {"time": [0.0, 1.0], "quaternion": np.eye(4)[:2]}).count == 6  # the turns of two


def test_roll_pitch_and_yaw_are_the_attitude_where_no_quaternion_is():
    rpy, quaternion = np.array([0.4, -0.7, 1.1]), [[0.0, 1.0, 0.0, 0.0], [np.nan, 1.0, 0.0, 0.0]]
    found = read_measured(SCENE, {"time": [0.0, 1.0], "rpy": [rpy, rpy], "quaternion": quaternion})
    turned = rbfmu.quaternion_from_euler("ZYX", rpy[::-1])
    np.testing.assert_allclose(found.values["quaternion"], [quaternion[0], turned], rtol=1e-15)


@pytest.mark.skipif(not os.path.exists("/dev/fd"), reason="needs pipes that have paths")
def test_inputs_of_a_fit_are_read_once(tmp_path):
    """They were read at each try: a pipe was empty then."""
    scene = SCENE.replace({"inputs.ports": ["torque_b"]})
    table = csv_of(tmp_path, "time,torque_b[1],torque_b[2],torque_b[3]\n0,0.1,0,0\n2,0,0.2,0\n")
    run, guess = rbfmu.simulate(scene, inputs=table), scene.replace({"initial.omega_b": [0.0, 0.25, 0.3]})
    reading, writing = os.pipe()
    os.write(writing, table.read_bytes())
    os.close(writing)
    one = rbfmu.fit(guess, run, ["initial.omega_b"], inputs=f"/dev/fd/{reading}")
    os.close(reading)
    assert one.values == pytest.approx([0.1, 0.2, 0.3], abs=1e-8)


def test_the_covariance_of_few_data_is_huber_s():
    """Of ten residuals two beyond 1: psi' is 1 of eight and 0 of two, and K is 1 + n/10 0.16/0.64 (Huber, ch. 7)."""
    f = np.array([0.5, -0.5, 0.5, -0.5, 0.5, -0.5, 0.5, -0.5, 3.0, -4.0])
    squares = 8 * 0.25 + 2 * 1.0  # psi is f, and no more than 1
    assert scatter(f, "huber", 4, True) == pytest.approx((1.0 + 0.4 * 0.25) ** 2 * squares / 6 / 0.8**2)


@pytest.mark.parametrize(("loss", "rho"), [
    ("linear", lambda z: z),
    ("soft_l1", lambda z: 2.0 * (np.sqrt(1.0 + z) - 1.0)),
    ("huber", lambda z: np.where(z <= 1.0, z, 2.0 * np.sqrt(z) - 1.0)),
    ("cauchy", np.log1p),
])  # fmt: skip
def test_the_covariance_of_each_loss_is_that_of_its_function_of_residuals(loss, rho):
    """psi is the derivative of rho(f^2)/2, as SciPy states it, and psi' that of psi: here by differences."""
    f, h = np.random.default_rng(9).normal(size=40) * 2.0, 1e-3
    low, middle, high = (0.5 * rho((f + x) ** 2) for x in (-h, 0.0, h))
    psi, follows = (high - low) / (2.0 * h), (high - 2.0 * middle + low) / h**2
    few = 1.0 + 3 / 40 * np.var(follows) / np.mean(follows) ** 2
    expected = few**2 * np.sum(psi**2) / 37 / np.mean(follows) ** 2
    assert scatter(f, loss, 3, False) == pytest.approx(expected, rel=1e-4)


def test_quaternions_a_tenth_off_a_unit_are_refused_and_gaps_have_no_length() -> None:
    rows = np.array([[1.05, 0.0, 0.0, 0.0], [np.nan] * 4, [0.0, 0.85, 0.0, 0.0]])
    assert quaternion_lengths(rows[:2]) == pytest.approx([1.05, np.nan], nan_ok=True)
    with pytest.raises(ValueError, match=r"quaternion in row 3 has length 0\.85: expected 1, scalar first"):
        quaternion_lengths(rows)
