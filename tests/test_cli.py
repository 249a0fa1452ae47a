"""The command line as a user types it: what it prints, writes and returns."""

import csv
import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from bad_scenes import BAD_SCENES, BadScene
from click.testing import CliRunner, Result

import rbfmu
from rbfmu.cli import main

SCENES = Path(__file__).resolve().parents[1] / "examples" / "scenes"
SHORT = """
[body]
mass = 2.0
inertia = [1.0, 2.0, 2.5]
[initial]
omega_b = [0.3, 1.0, 0.2]
[run]
stop = 1.0
step = 0.1
"""


def call(*arguments: object) -> Result:
    return CliRunner().invoke(main, [str(a) for a in arguments])


@pytest.fixture
def short(tmp_path: Path) -> Path:
    path = tmp_path / "short.toml"
    path.write_text(SHORT)
    return path


@pytest.mark.parametrize("command", ["", "demo", "plan", "run", "build", "verify", "chart", "stability"])
def test_help_everywhere(command: str) -> None:
    result = call(*filter(None, [command]), "--help")
    assert result.exit_code == 0
    assert "Usage:" in result.output


@pytest.mark.parametrize("command", ["run", "build"])
@pytest.mark.parametrize("bad", BAD_SCENES, ids=lambda bad: bad.name)
def test_bad_scene_is_one_message_and_status_2(command: str, bad: BadScene, tmp_path: Path) -> None:
    path = tmp_path / "bad.toml"
    path.write_bytes(bad.content)
    result = call(command, path, "-o", tmp_path / ("out.csv" if command == "run" else "out.fmu"))
    assert result.exit_code == 2
    assert bad.fragment in result.stderr
    assert "Traceback" not in result.output
    assert [p.name for p in tmp_path.iterdir()] == ["bad.toml"]


def test_all_faults_of_a_scene_are_reported_at_once(tmp_path: Path) -> None:
    path = tmp_path / "bad.toml"
    path.write_text("[body]\nmass = -1\ninertia = [1, 1, 3]\n[run]\nstep = 0\n")
    message = call("run", path).stderr
    assert all(key in message for key in ("body.mass", "body.inertia", "run.step"))


def test_no_traceback_from_a_real_process(tmp_path: Path) -> None:
    path = tmp_path / "empty.toml"
    path.touch()
    done = subprocess.run([sys.executable, "-m", "rbfmu", "run", path], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "body" in done.stderr
    assert "Traceback" not in done.stderr


def test_plan_says_why_and_speaks_json(short: Path) -> None:
    text = call("plan", short).output
    assert "rotation: no torque" in text
    assert "of the full model" in text
    chosen = json.loads(call("plan", short, "--json").output)
    assert {"model", "method", "substep", "states", "reasons"} <= set(chosen)
    assert chosen["model"] == "torque-free body"
    assert chosen["substep"] is None


def test_the_full_model_is_there_on_request(short: Path, tmp_path: Path) -> None:
    chosen = json.loads(call("plan", short, "--json", "--model", "full").output)
    assert (chosen["model"], chosen["states"]) == ("body under loads, by series", 13)
    rows = []
    for model in ("planned", "full"):
        path = tmp_path / f"{model}.csv"
        assert call("run", short, "-o", path, "--model", model).exit_code == 0
        rows.append(np.loadtxt(path, delimiter=",", skiprows=1))
    assert 0.0 < np.max(np.abs(rows[0] - rows[1])) <= 1e-5  # accuracy 1e-6, numbers up to some 10
    assert call("build", short, "-o", tmp_path / "full.fmu", "--model", "full").exit_code == 0


def test_verify_says_how_far_the_full_model_is(short: Path, tmp_path: Path) -> None:
    call("build", short, "-o", tmp_path / "it.fmu")
    text = call("verify", tmp_path / "it.fmu").output
    found = re.search(r"planned and full model differ by (\S+), accuracy asked 1e-06", text)
    assert found
    assert 0.0 < float(found[1]) <= 1e-6


def test_run_saves_every_digit_and_draws(short: Path, tmp_path: Path) -> None:
    result = call("run", short, "-o", tmp_path / "out.csv", "--plot", tmp_path / "out.png")
    assert result.exit_code == 0, result.output
    with (tmp_path / "out.csv").open(newline="") as file:
        rows = list(csv.reader(file))
    expected = rbfmu.simulate(rbfmu.load_scene(short)).columns()
    assert rows[0] == list(expected)
    assert np.array_equal(np.array(rows[1:], float), np.array(list(expected.values())).T)
    assert (tmp_path / "out.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("option", "name"), [("-o", "out.txt"), ("--plot", "out.csv"), ("-o", "no/such/folder.csv"), ("-o", ".")]
)
def test_a_target_that_cannot_be_written_is_refused_before_the_run(
    short: Path, tmp_path: Path, option: str, name: str
) -> None:
    result = call("run", short, option, tmp_path / name)
    assert result.exit_code == 2
    assert "Error" in result.stderr


def test_build_writes_an_fmu_that_verify_passes(short: Path, tmp_path: Path) -> None:
    assert call("build", short, "-o", tmp_path / "short.fmu").exit_code == 0
    result = call("verify", tmp_path / "short.fmu", "--seed", "7")
    assert result.exit_code == 0, result.output
    assert "10 of 10 steps done; inputs from seed 7" in result.output


def test_build_names_the_fmu_after_its_scene(short: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(short.parent)
    result = call("build", short)
    assert result.output.strip() == "short.fmu"
    assert Path("short.fmu").exists()


@pytest.mark.parametrize("content", [b"", b"not a zip", b"PK\x05\x06" + bytes(18)])
def test_verify_refuses_what_is_no_fmu(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "bad.fmu"
    path.write_bytes(content)
    result = call("verify", path)
    assert result.exit_code == 2
    assert "bad.fmu" in result.stderr
    assert "Traceback" not in result.output


def test_verify_of_a_missing_file_is_a_message() -> None:
    result = call("verify", "no_such.fmu")
    assert result.exit_code == 2
    assert "no_such.fmu" in result.stderr


def test_results_of_run_are_those_of_python(short: Path, tmp_path: Path) -> None:
    call("run", short, "-o", tmp_path / "out.npz")
    with np.load(tmp_path / "out.npz") as file:
        saved = dict(file)
    direct = rbfmu.simulate(rbfmu.load_scene(short))
    assert np.array_equal(saved["quaternion"], direct.quaternion)
    assert json.dumps(saved["time"].tolist()) == json.dumps(direct.time.tolist())


@pytest.mark.parametrize("command", [["demo"], ["verify", "short.fmu"]])
def test_a_temporary_folder_that_crashes_pythonfmu_is_refused(
    command: list[str], short: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(short.parent)
    call("build", short)
    monkeypatch.setattr("tempfile.tempdir", str(short.parent / "a+b"))
    result = call(*command)
    assert result.exit_code == 2
    assert "TMPDIR" in result.stderr
