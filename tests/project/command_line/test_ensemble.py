"""`rbfmu ensemble`: what it prints, writes and refuses."""

import os
import re
from pathlib import Path

import pytest

from rbfmu import EnsembleResult
from tests.support.command_line import call, refused
from tests.support.ensembles.satellite import FILE


@pytest.mark.thorough
def test_it_prints_what_was_planned_what_failed_and_how_the_runs_end(tmp_path):
    found = call("ensemble", FILE, "-o", tmp_path / "store.npz", "--plot", tmp_path / "satellite.png", "--runs", 400)
    assert found.exit_code == 0, found.stderr
    result = EnsembleResult.load(tmp_path / "store.npz")
    assert found.stdout.startswith("body under loads, by series: Taylor series of order ")
    assert "\none plan for all 400 members; " in found.stdout
    assert f"400 runs, {len(result.failed)} of them failed, 0 drawn again\n" in found.stdout
    index, message = next(iter(result.failed.items()))
    assert f"run {index}: {message}\n" in found.stdout
    assert "damping_b" in message
    assert f"{result.final['kinetic_energy'][result.good].mean():.6g}"[:7] in found.stdout
    assert found.stdout.endswith(f"\nwritten: {tmp_path / 'store.npz'}, {tmp_path / 'satellite.png'}\n")
    assert (tmp_path / "satellite.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.thorough
def test_a_store_goes_on_and_grows(tmp_path):
    store = tmp_path / "store.zarr"
    assert call("ensemble", FILE, "-o", store).exit_code == 0
    said = refused("ensemble", FILE, "-o", store)
    assert said == f"Error: {store}: exists already, and stays as it is; --resume goes on with it\n"
    assert call("ensemble", FILE, "-o", store, "--resume", "--runs", 150).exit_code == 0
    assert EnsembleResult.load(store).runs == 150
    message = refused("ensemble", FILE, "-o", store, "--resume", "--runs", 150, "--stop", 3.0)
    assert "run.stop = 3.0: expected 2.0, with which the store was begun" in message


@pytest.mark.thorough
def test_a_damaged_store_is_one_message(tmp_path):
    store = tmp_path / "store.zarr"
    assert call("ensemble", FILE, "-o", store).exit_code == 0
    (store / "quaternion_mean" / "c" / "0" / "0").write_bytes(b"")
    found = call("ensemble", FILE, "-o", store, "--resume")
    assert (found.exit_code, type(found.exception)) == (2, SystemExit)
    assert f"Error: {store}: cannot be read (quaternion_mean: " in found.stderr


def test_advice_is_about_the_runs_that_are_asked_for(tmp_path):
    scene = tmp_path / "sobol.toml"
    scene.write_text(FILE.read_text().replace("[ensemble]", '[ensemble]\ndesign = "sobol"'))
    found = call("ensemble", scene, "--runs", 20)
    assert found.exit_code == 0, found.stderr
    assert "runs is a power of 2: 16 or 32 in place of 20\n" in found.stdout
    assert re.search(r"\n20 runs, \d of them failed, 0 drawn again\n", found.stdout)


def test_what_cannot_run_is_refused_before_anything_is_planned(tmp_path, monkeypatch):
    monkeypatch.delattr("rbfmu.ensembles.planning.Judge")
    (tmp_path / "store.npz").touch()
    said = refused("ensemble", FILE, "-o", tmp_path / "store.npz")
    assert "exists already" in said
    grid = tmp_path / "grid.toml"
    vary = '[ensemble]\ndesign = "grid"\n[ensemble.vary]\n"body.mass" = { uniform = [40.0, 60.0], points = 4 }\n'
    grid.write_text(FILE.read_text().partition("[ensemble]")[0] + vary)
    said = refused("ensemble", grid, "--runs", 5)
    assert "ensemble.runs = 5: expected no such key, or 4: the points of the grid" in said


@pytest.mark.parametrize(("arguments", "said"), [
    (["--resume"], "--resume: expected --output with the store to go on with"),
    (["--workers", 2, "--scheduler", "tcp://a:1"], "--workers: expected no --scheduler with it"),
    (["--workers", 0], "Invalid value for '--workers'"),
    (["--runs", 0], "Invalid value for '--runs'"),
    (["-o", "store.csv"], "expected a name that ends in .npz or .zarr"),
    (["-o", "no_folder/store.npz"], "there is no folder 'no_folder'"),
    (["--plot", "picture.gif"], "expected a name that ends in .png or .svg or .pdf"),
])  # fmt: skip
def test_bad_usage_is_one_message(arguments, said):
    assert said in refused("ensemble", FILE, *arguments)


def test_what_may_not_be_written_is_said_before_anything_runs(tmp_path, monkeypatch):
    target = tmp_path / "s.npz"
    target.write_bytes(b"precious")
    monkeypatch.setattr("os.access", lambda place, mode: mode != os.W_OK or Path(place) != target)  # root may write all
    assert refused("ensemble", FILE, "--resume", "-o", target) == f"Error: {target}: Permission denied\n"
    assert [*tmp_path.iterdir()] == [target]


def test_a_folder_that_takes_no_file_is_said_before_anything_runs(tmp_path, monkeypatch):
    monkeypatch.setattr("rbfmu.on_disk.token_hex", lambda size: "0" * 300)  # a longer name than folders take
    assert refused("ensemble", FILE, "-o", tmp_path / "s.npz") == f"Error: {tmp_path / 's.npz'}: File name too long\n"


def test_a_scene_without_ensemble_is_one_message(tmp_path):
    scene = tmp_path / "plain.toml"
    scene.write_text("[body]\nmass = 1.0\ninertia = [1, 2, 2.5]\n")
    said = refused("ensemble", scene)
    assert said.startswith(f"Error: {scene}: ensemble is missing: expected ")
    assert said.count("\n") == 1
