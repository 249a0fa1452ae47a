"""What hangs on each number, and numbers from data, as a user types it."""

from pathlib import Path

import numpy as np
import pytest

import rbfmu
from rbfmu.cli_output import print_fit
from tests.support.command_line import call, refused

SCENE = """
[body]
mass = 2.0
inertia = [1.0, 2.0, 2.5]
[initial]
omega_b = [0.3, 1.0, 0.2]   # guessed
[loads]
torque_b = [0.1, 0.0, 0.05]
[outputs]
quantities = ["omega_b"]
[run]
stop = 4.0
step = 0.1
"""


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    path = tmp_path / "scene.toml"
    path.write_text(SCENE)
    return path


def test_sensitivity_prints_saves_and_draws(scene: Path, tmp_path: Path) -> None:
    files = (tmp_path / "s.npz", tmp_path / "s.png")
    result = call("sensitivity", scene, "--by", "initial.omega_b", "body.inertia", "-o", files[0], "--plot", files[1])
    assert result.exit_code == 0, result.output
    lines = result.output.splitlines()
    assert lines[0].split() == ["1", "%", "of", "omega_b"]
    assert [line.split()[0] for line in lines[1:3]] == ["initial.omega_b", "body.inertia"]
    found = rbfmu.sensitivity(scene, ["initial.omega_b", "body.inertia"])
    assert float(lines[2].split()[1]) == pytest.approx(found.changes("omega_b")["body.inertia"].max(), rel=1e-2)
    assert all(file.stat().st_size for file in files)


def test_sensitivity_says_by_how_much_what_is_zero_changes(scene: Path) -> None:
    """2026-11-28: a wheel's momentum of 0 was changed by 0.01 N m s, under the title "1 % of", without a word."""
    result = call("sensitivity", scene, "--by", "loads.torque_a", "initial.attitude", "body.inertia")
    assert result.exit_code == 0, result.output
    assert result.output.splitlines()[4:] == ["loads.torque_a is zero: changed by 0.01, not by 1 %"]


def test_fit_prints_and_writes_the_scene(scene: Path, tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    truth = rbfmu.load_scene(scene).replace({"initial.omega_b": [0.35, 0.9, 0.25]})
    run = rbfmu.simulate(truth)
    rbfmu.Result(run.time, {"omega_b": run.omega_b + 0.01 * rng.normal(size=run.omega_b.shape)}).save(
        tmp_path / "d.csv"
    )
    fitted = tmp_path / "fitted.toml"
    result = call("fit", scene, tmp_path / "d.csv", "--free", "initial.omega_b", "-o", fitted, "--sigma", "0.01")
    assert result.exit_code == 0, result.output
    assert "residuals look like noise" in result.output
    assert "# guessed" not in fitted.read_text()  # the number is no guess any more
    assert rbfmu.load_scene(fitted).initial.omega_b == pytest.approx(truth.initial.omega_b, abs=0.01)


def test_what_the_data_do_not_tell_has_no_number(scene: Path, capsys: pytest.CaptureFixture[str]) -> None:
    values, errors, sigma = np.array([np.nan, 1.5]), np.array([np.inf, 0.25]), {"quaternion": 0.01, "omega_b": 0.002}
    names, said = ("body.mass", "initial.omega_b[1]"), ("body.mass: nothing in these data tells it",)
    print_fit(rbfmu.Fit(rbfmu.load_scene(scene), names, values, errors, np.eye(2), said, {}, sigma, ("doubt",), None))
    assert capsys.readouterr().out.splitlines() == [
        "number              value      standard error",
        "body.mass            not told",
        "initial.omega_b[1]   1.5       0.25",
        "noise: attitude 0.01, omega_b 0.002",
        *said, "doubt",
    ]  # fmt: skip


@pytest.mark.parametrize(("left", "said"), [
    (np.sin(np.arange(50.0) / 9.0), "residuals follow each other, but are within the scene's accuracy"),
    (np.random.default_rng(6).normal(size=50), "residuals look like noise"),
    (np.random.default_rng(6).normal(size=16), "rows are too few to tell whether residuals are noise"),
])  # fmt: skip
def test_residuals_that_are_not_doubted_are_not_said_to_be_noise_unless_they_are(
    left: np.ndarray, said: str, scene: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    of = {"omega_b": 1e-7 * left[:, None]}
    values = np.array([1.5]), np.array([0.25]), np.eye(1)
    print_fit(rbfmu.Fit(rbfmu.load_scene(scene), ("body.mass",), *values, (), of, {"omega_b": 1e-7}, (), None))
    assert capsys.readouterr().out.splitlines()[-1] == said


def test_a_model_that_is_wrong_is_status_1(scene: Path, tmp_path: Path) -> None:
    run = rbfmu.simulate(rbfmu.load_scene(scene).replace({"loads.torque_b": [0.0, 0.5, 0.0]}))
    run.save(tmp_path / "d.csv")
    result = call("fit", scene, tmp_path / "d.csv", "--free", "initial.omega_b", "--sigma", "0.01")
    assert result.exit_code == 1
    assert "times the noise that was given" in result.output


@pytest.mark.parametrize(("arguments", "said"), [
    (["sensitivity"], "Missing option '--by'"),
    (["sensitivity", "--by", "body.colour"], "by = 'body.colour': expected one of initial.attitude"),
    (["sensitivity", "--by", "body.mass", "-o", "s.txt"], "ends in .csv or .npz"),
    (["fit", "none.csv", "--free", "body.mass"], "none.csv"),
    (["fit", "bad.csv", "--free", "body.mass"], 'Error: bad.csv: omega_b[1] = "x" in row 1: expected a number'),
    (["fit", "none.csv"], "Missing option '--free'"),
])  # fmt: skip
def test_what_cannot_be_done_is_one_message_and_status_2(
    arguments: list[str], said: str, scene: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    command, *rest = arguments
    monkeypatch.chdir(tmp_path)
    Path("bad.csv").write_text("time,omega_b[1],omega_b[2],omega_b[3]\n0,x,0,0\n", encoding="utf-8")
    message = refused(command, scene, *rest)
    assert said in " ".join(message.split())
