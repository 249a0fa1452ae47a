"""A run that a table of inputs drives, as a user types it."""

import json
from pathlib import Path

import numpy as np
import pytest

import rbfmu
from tests.support.command_line import call, refused


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    path = tmp_path / "driven.toml"
    path.write_text("""
[body]
mass = 2.0
inertia = [1.0, 2.0, 2.5]
[initial]
omega_b = [0.3, 1.0, 0.2]
[inputs]
ports = ["torque_b"]
[run]
stop = 1.0
step = 0.1
""")
    return path


@pytest.mark.parametrize("interpolate", ["hold", "linear"])
def test_a_run_is_driven_by_a_file(interpolate: str, scene: Path, tmp_path: Path) -> None:
    table = tmp_path / "u.csv"
    table.write_text("time,torque_b[1],torque_b[2],torque_b[3]\n0,0,0,0\n0.25,1,0,2\n1,0,-1,0\n")
    options = ("--inputs", table, "--interpolate", interpolate)
    result = call("run", scene, "-o", tmp_path / "out.npz", *options)
    assert result.exit_code == 0, result.output
    assert "with the inputs given, accuracy asked 1e-06" in result.output
    driven = rbfmu.simulate(scene, inputs=table, interpolate=interpolate)
    np.testing.assert_array_equal(np.load(tmp_path / "out.npz")["omega_b"], driven.omega_b)
    assert np.any(driven.omega_b != rbfmu.simulate(scene).omega_b)
    planned = call("plan", scene, "--json", *options)
    assert json.loads(planned.output)["error"] == rbfmu.plan(scene, inputs=table, interpolate=interpolate).error


@pytest.mark.thorough
def test_times_by_a_unix_clock_are_printed_so_that_they_differ(scene: Path) -> None:
    """They were printed with 6 or 9 digits: an event in the middle of the run as at 1.7e+09, as was its end."""
    with scene.open("a") as file:
        file.write('start = 1700000000.0\n[events]\nhalf = { when = "t - 1700000000.5" }\n')
    scene.write_text(scene.read_text().replace("stop = 1.0", "stop = 1700000000.9"))
    output = call("run", scene).output
    assert "t = 1700000000.9 s" in output
    assert "half   1      1700000000.5\n" in output
    with scene.open("a") as file:
        file.write('[loads]\ntorque_b = "[0, 0, sqrt(1700000000.25 - t)]"\n')
    assert "expected one before t = 1700000000.25 s" in refused("run", scene)


def test_a_course_between_rows_of_no_table_is_refused(scene: Path) -> None:
    assert call("view", scene, "--interpolate", "linear").exit_code == 2
    for idle in (["--json"], ["--inputs", "none.csv"], ["--model", "full"]):
        assert f"--code: expected no {' '.join(idle[:1])}" in call("plan", scene, "--code", *idle).stderr
    assert "--interpolate linear: expected --inputs" in refused("plan", scene, "--interpolate", "linear")


def test_a_wrong_file_of_inputs_is_one_message_and_status_2(scene: Path, tmp_path: Path) -> None:
    table = tmp_path / "u.csv"
    table.write_text("time,torque_b[1],torque_b[2],torque_b[3]\n0,0,nan,0\n1,0,-1,0\n")
    said = refused("run", scene, "-o", tmp_path / "out.npz", "--inputs", table)
    assert 'u.csv: torque_b[2] = "nan" in row 1: expected a finite number' in said
    assert not (tmp_path / "out.npz").exists()


def test_inputs_are_not_written_over(scene: Path, tmp_path: Path) -> None:
    table = tmp_path / "u.csv"
    table.write_text(text := "time,torque_b[1],torque_b[2],torque_b[3]\n0,0,0,0\n1,0,-1,0\n")
    for command in (("run", scene), ("sensitivity", scene, "--by", "initial.omega_b")):
        assert "expected another file than that of --inputs" in refused(*command, "--inputs", table, "-o", table)
        assert table.read_text() == text
