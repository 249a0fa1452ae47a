"""The command line as a user types it: what it prints, writes and returns."""

import csv
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import fmpy
import numpy as np
import pytest
from numba import config

import rbfmu
import rbfmu_fmu
from rbfmu_fmu.native.platforms import PLATFORMS
from tests.support.command_line import call, refused
from tests.support.covering import some_of
from tests.support.scenes.bad_scenes import BAD_SCENES, BadScene

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


@pytest.fixture
def short(tmp_path: Path) -> Path:
    path = tmp_path / "short.toml"
    path.write_text(SHORT)
    return path


@pytest.mark.parametrize(
    "command",
    ["", "demo", "keys", "new", "plan", "run", "sensitivity", "fit", "build", "verify", "view", "chart", "stability",
     "ensemble"],
)  # fmt: skip
def test_help_everywhere(command: str) -> None:
    result = call(*filter(None, [command]), "--help")
    assert result.exit_code == 0
    assert "Usage:" in result.output


@pytest.mark.parametrize(("command", "default"), [("run", "planned"), ("run", "hold"), ("build", "2")])
def test_help_says_what_is_chosen_by_default(command: str, default: str) -> None:
    assert f"[default: {default}]" in " ".join(call(command, "--help").output.split())


@pytest.mark.parametrize("command", ["run", "build"])
@pytest.mark.parametrize("bad", some_of(BAD_SCENES, 40), ids=lambda bad: bad.name)  # `test_bad_scenes` reads all
def test_bad_scene_is_one_message_and_status_2(command: str, bad: BadScene, tmp_path: Path) -> None:
    path = tmp_path / "bad.toml"
    path.write_bytes(bad.content)
    assert bad.fragment in refused(command, path, "-o", tmp_path / ("out.csv" if command == "run" else "out.fmu"))
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


@pytest.mark.parametrize("command", [["keys"], ["plan", "it.toml"], ["--help"]])  # Rich writes the first
def test_a_reader_that_leaves_early_is_no_error(command: list[str], tmp_path: Path) -> None:
    """As `rbfmu verify FILE.fmu | head` does; status 1 would say that a check failed."""
    (tmp_path / "it.toml").write_text('[inputs]\nports = ["omega_b"]\n')
    rbfmu_ = [sys.executable, "-m", "rbfmu", *command]
    with subprocess.Popen(rbfmu_, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=tmp_path) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.close()
        assert process.stderr.read() == ""
    assert process.returncode == 141


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs a device that is always full")
@pytest.mark.parametrize("command", [["run", "--help"], ["--help"]])
def test_a_full_disk_under_stdout_is_one_message(command: list[str]) -> None:
    """2026-11-30: status 120 with an exception that was ignored, and a traceback in place of help."""
    command = [sys.executable, "-m", "rbfmu", *command]
    environment = os.environ | {"PYTHONUNBUFFERED": ""}  # else nothing is left to write at the end
    with open("/dev/full", "w") as full:
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False, env=environment)
    assert (done.returncode, done.stderr) == (2, "Error: standard output or a file: No space left on device\n")


def test_plan_says_why_and_speaks_json(short: Path) -> None:
    text = call("plan", short).output
    assert "rotation: no torque" in text
    assert re.search(r"\n\d+ states and \d+ FMU variables, against 13 and \d+ of the full model\n", text)
    chosen = json.loads(call("plan", short, "--json").output)
    assert {"model", "method", "substep", "states", "reasons"} <= set(chosen)
    assert chosen["model"] == "torque-free body"
    assert chosen["substep"] is None


@pytest.mark.parametrize("command", ["plan", "run", "build"])
@pytest.mark.parametrize(("options", "said"), [
    (["--accuracy", "2"], "with --accuracy 2.0: run.accuracy = 2.0: expected a number in (0, 1]"),
    (["--accuracy", "nan"], "with --accuracy nan: run.accuracy = nan: expected a finite number in (0, 1]"),
    (["--stop", "-1"], "with --stop -1.0: run.stop = -1.0: expected a time after run.start = 0.0 (s)"),
    (["--stop", "0.05"], "with --stop 0.05: run.step = 0.1: expected at most stop - start = 0.05 (s)"),
    (["--step", "0", "--stop", "9"], "with --step 0.0 and --stop 9.0: run.step = 0.0: expected a number > 0 (s)"),
    (["--accuracy", "1e-16"], "with --accuracy 1e-16: run.accuracy = 1e-16: expected at least"),
])  # fmt: skip
def test_a_bad_option_is_one_message_that_names_file_and_option(
    command: str, options: list[str], said: str, short: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(short.parent)
    message = refused(command, short, *options)
    assert message.startswith(f"Error: {short} {said}")
    assert [p.name for p in short.parent.iterdir()] == ["short.toml"]


def test_an_accuracy_of_the_file_that_cannot_be_met_names_the_file(short: Path) -> None:
    short.write_text(SHORT + "accuracy = 1e-16\n")
    said = f"{short}: run.accuracy = 1e-16: expected at least"
    for command in ("plan", "run", "build"):
        assert call(command, short).stderr.startswith(f"Error: {said}")
    for function in (rbfmu.plan, rbfmu.simulate, lambda path: rbfmu_fmu.build(path, short.parent / "it.fmu")):
        for path in (short, str(short)):
            with pytest.raises(rbfmu.SceneError) as caught:
                function(path)
            assert str(caught.value).startswith(said)


@pytest.mark.thorough
def test_options_take_the_place_of_the_file_s_keys(short: Path, tmp_path: Path) -> None:
    options = ["--stop", "3", "--step", "0.5", "--accuracy", "1e-3"]
    assert call("run", short, "-o", tmp_path / "it.csv", *options).exit_code == 0
    assert np.loadtxt(tmp_path / "it.csv", delimiter=",", skiprows=1)[:, 0].tolist() == np.arange(0, 3.5, 0.5).tolist()
    assert "a step of 0.5 s" in call("plan", short, *options).output
    assert call("build", short, "-o", tmp_path / "it.fmu", *options).exit_code == 0
    model = fmpy.read_model_description(str(tmp_path / "it.fmu"))
    assert (float(model.defaultExperiment.stopTime), float(model.defaultExperiment.stepSize)) == (3.0, 0.5)
    assert "accuracy asked 0.001" in call("verify", tmp_path / "it.fmu").output


@pytest.mark.thorough
def test_python_takes_a_scene_or_its_file(short: Path) -> None:
    scene = rbfmu.load_scene(short)
    assert rbfmu.plan(str(short)) == rbfmu.plan(scene) == rbfmu.plan(scene=short)
    assert np.array_equal(rbfmu.simulate(short).quaternion, rbfmu.simulate(scene).quaternion)
    built = [rbfmu_fmu.build(s, short.parent / f"{k}.fmu").read_bytes() for k, s in enumerate((scene, short))]
    assert built[0] == built[1]
    with pytest.raises(TypeError, match=r"simulate: scene = 3: expected a rbfmu.Scene or the path of a scene file"):
        rbfmu.simulate(3)  # type: ignore[arg-type]


def test_the_end_is_printed_with_units(short: Path) -> None:
    output, run = call("run", short).output, rbfmu.simulate(short)
    lines = [line.split() for line in output.splitlines()]
    assert ["at", "the", "end", "unit", "t", "=", "1", "s"] in lines
    units = {line[0]: line[1:-3] for line in lines if line and line[0] in ("position", "omega_b", "alpha_b")}
    assert units == {"position": ["m"], "omega_b": ["rad/s"], "alpha_b": ["rad/s2"]}
    head, *rows = output[output.index("at the end") :].splitlines()
    for row, (name, values) in zip(rows, run.quantities.items(), strict=True):  # each column begins at one place
        assert row.startswith(f"{name} ")
        assert row[head.index("unit") :].startswith(run.units[name])
        numbers = [float(x) for x in row[head.index("t =") :].split()]
        np.testing.assert_allclose(numbers, values[-1:].ravel(), rtol=1e-7, atol=1e-12)


@pytest.mark.thorough
def test_a_run_says_what_it_wrote(short: Path, tmp_path: Path) -> None:
    csv, png = tmp_path / "it.csv", tmp_path / "it.png"
    found = call("run", short, "-o", csv, "--plot", png).output
    assert found.splitlines()[-1] == f"written: {csv}, {tmp_path / 'it.units.csv'}, {png}"
    assert "written" not in call("run", short).output
    with short.open("a", encoding="utf-8") as scene:
        scene.write('\n[events]\nhalf = { when = "t - 0.5" }\n')
    found = call("run", short, "-o", csv).output
    assert (
        found.splitlines()[-1]
        == f"written: {', '.join(str(csv.with_suffix(x)) for x in ('.csv', '.units.csv', '.events.csv'))}"
    )
    assert csv.with_suffix(".events.csv").exists()


def test_what_held_inputs_cost_is_said_where_a_loop_can_be_closed(short: Path) -> None:
    def said(command: str, quantities: str) -> bool:
        ports = f'\n[inputs]\nports = ["torque_b"]\n[outputs]\nquantities = ["{quantities}"]\n'
        short.write_text(f"{plain}{ports}")
        return "inputs are held" in call(command, short).output

    plain = short.read_text().partition("[outputs]")[0]
    assert said("plan", "omega_b")
    assert not said("run", "omega_b")  # its inputs are known
    assert not said("plan", "velocity")  # a torque about the centre of mass does nothing to it
    assert not said("plan", "kinetic_energy")


def test_a_run_says_its_model_and_the_error_to_expect(short: Path) -> None:
    planned = rbfmu.plan(short)
    head = call("run", short).output.partition("at the end")[0].splitlines()
    expected = f"expected: error {planned.error:.1e}, accuracy asked 1e-06"
    assert head == [f"{planned.model}: {planned.method}", expected, *planned.reasons]


@pytest.mark.parametrize(("inputs", "which"), [
    ('ports = ["torque_b"]', " with inputs at zero"),
    ('parameters = ["omega_b_0"]', " with the scene's parameters"),
    ('ports = ["torque_b"]\nparameters = ["omega_b_0"]', " with inputs at zero and the scene's parameters"),
])  # fmt: skip
def test_an_expected_error_says_of_which_run_it_is(short: Path, inputs: str, which: str) -> None:
    """Another unit may supply other inputs, of which the pilot run knows nothing."""
    short.write_text(f"{short.read_text()}\n[inputs]\n{inputs}\n")
    said = f"expected: error {rbfmu.plan(short).error:.1e}{which}, "
    assert call("plan", short).output.splitlines()[1].startswith(f"{said}about ")
    assert f"{said}accuracy asked 1e-06\n" in call("run", short).output


@pytest.mark.thorough
@pytest.mark.skipif(not hasattr(config, "CACHE_LOCATOR_CLASSES"), reason="this Numba finds another folder")
def test_where_nothing_can_be_kept_one_line_says_what_to_do(short: Path, tmp_path: Path) -> None:
    environment = os.environ | {
        "NUMBA_CACHE_DIR": str(short / "no folder"), "NUMBA_CACHE_LOCATOR_CLASSES": "UserProvidedCacheLocator",
    }  # fmt: skip
    short.write_text('[inputs]\nports = ["omega_b"]\n')
    command = [sys.executable, "-m", "rbfmu", "plan", short]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    assert done.returncode == 0
    (line,) = done.stderr.splitlines()
    assert "set NUMBA_CACHE_DIR to a folder that can be written" in line
    kept = subprocess.run(command, capture_output=True, text=True, check=False)
    assert kept.stderr == ""


@pytest.mark.parametrize(
    ("names", "slow"),
    [("win64", "win64"), ("linux64,win64,darwin64", "darwin64, win64"), ("linux64", ""), ("", "")],
)
def test_what_may_take_minutes_is_said_beforehand(
    names: str, slow: str, short: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    said: list[str] = []

    def build_nothing(*args: object, **kwargs: object) -> str:
        said.append("building")
        return "it.fmu"

    monkeypatch.setattr("rbfmu_fmu.build", build_nothing)
    monkeypatch.setattr("rbfmu_fmu.native.platforms.this_platform", lambda: PLATFORMS["linux64"])
    monkeypatch.setattr("rbfmu_fmu.native.platforms.compiler", lambda p: ["ziglang"])
    monkeypatch.setattr("click.echo", lambda text, err=False: said.append(str(text) if err else "printed"))
    assert call("build", short, "--native", "--platform", names, "-o", tmp_path / "it.fmu").exit_code == 0
    why = "the first time takes minutes, as ziglang builds the platform's C library"
    assert said == [f"Note: compiling for {slow}: {why}"] * bool(slow) + ["building", "printed"]


@pytest.mark.thorough
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


@pytest.mark.thorough
def test_verify_says_how_far_the_full_model_is(short: Path, tmp_path: Path) -> None:
    call("build", short, "-o", tmp_path / "it.fmu")
    text = call("verify", tmp_path / "it.fmu").output
    found = re.search(r"planned and full model differ by (\S+), accuracy asked 1e-06", text)
    assert found
    assert 0.0 < float(found[1]) <= 1e-6


@pytest.mark.thorough
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
    assert "Error" in refused("run", short, option, tmp_path / name)


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


@pytest.mark.thorough
@pytest.mark.parametrize(("name", "file", "identifier"), [
    ("Kreisel größer: é 陀螺-2.1?", "Kreisel_größer__é_陀螺-2.1_.fmu", "Kreisel_gro_er__e____2_1_"),
    pytest.param("陀螺-2.1", "陀螺-2.1.fmu", "___2_1", marks=pytest.mark.thorough),
    pytest.param("été", "été.fmu", "ete", marks=pytest.mark.thorough),
    pytest.param("a: b?", "a__b_.fmu", "a__b_", marks=pytest.mark.thorough),
])  # fmt: skip
def test_an_fmu_s_name_keeps_letters(
    name: str, file: str, identifier: str, short: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """FMI allows any text as the model's name, and C identifiers as that of its library."""
    monkeypatch.chdir(short.parent)
    short.write_text(f'name = "{name}"\n{SHORT}')
    assert call("build", short, "--native").output.strip() == file
    model = fmpy.read_model_description(file)
    assert (model.modelName, model.coSimulation.modelIdentifier) == (name, identifier)
    assert call("verify", file).exit_code == 0


@pytest.mark.parametrize("content", [None, b"", b"not a zip", b"PK\x05\x06" + bytes(18)])
def test_verify_refuses_what_is_no_fmu(content: bytes | None, tmp_path: Path) -> None:
    path = tmp_path / "bad.fmu"
    if content is not None:
        path.write_bytes(content)
    assert "bad.fmu" in refused("verify", path)


@pytest.mark.parametrize("command", [["demo"], ["verify", "short.fmu"]])
def test_a_temporary_folder_that_crashes_pythonfmu_is_refused(
    command: list[str], short: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(short.parent)
    call("build", short)
    monkeypatch.setattr("tempfile.tempdir", str(short.parent / "a+b"))
    assert "TMPDIR" in refused(*command)


@pytest.mark.skipif(os.name != "posix", reason="elsewhere no folder goes in which a process works")
def test_what_keeps_the_demonstration_from_building_its_fmu_is_one_message(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """2026-11-30: it was a traceback, as with NUMBA_DISABLE_JIT=1."""

    def full(folder: Path, console: object) -> bool:
        raise rbfmu_fmu.BuildError("cannot be linked")

    monkeypatch.setattr("rbfmu_fmu.demo.run_demo", full)
    assert "cannot be linked" in refused("demo", "-o", tmp_path)


def test_a_working_folder_that_is_gone_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """2026-11-29: a library that asked for it at import was told of as "standard output or a file"."""
    folder = tmp_path / "gone"
    folder.mkdir()
    monkeypatch.chdir(folder)
    folder.rmdir()
    monkeypatch.setattr("rbfmu.scene.scene.load_scene", os.path.abspath)
    said = refused("run", "scene.toml")
    assert said.startswith("Error: the working folder, which is gone: ")


def test_a_run_that_memory_does_not_hold_is_refused_in_a_line(short: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """2026-11-29: a run of 1e8 steps, the most that a scene may ask for, ended in a traceback."""
    monkeypatch.setattr("rbfmu.runs.steps.Steps.course", lambda *_: np.empty((10**8, 10**8)))
    said = refused("run", short)
    assert re.fullmatch(r"Error: memory: Unable to allocate .*: expected a longer run\.step, .*\n", said)
