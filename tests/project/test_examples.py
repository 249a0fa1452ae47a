"""Every example and the notebook run as a user runs them, and show what they say."""

import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import nbformat
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from examples.figures import record
from examples.renew_notebook import CHAPTERS, NOTEBOOK, executed
from tests.support.compilers import needs_compiler
from tests.support.paths import ROOT

EXAMPLES = ROOT / "examples"
NUMBERED = sorted(p.name for p in EXAMPLES.glob("[0-9]*.py"))


def printed(name: str, folder: Path = EXAMPLES, *arguments: str) -> str:
    command = [sys.executable, EXAMPLES / name, *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=1200, cwd=folder)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_every_example_is_tested() -> None:
    here = {"01_kernels.py", "02_brick.py", "03_slender_beam.py", "04_controlled.py", "08_lqr.py", "09_detumbling.py",
            "10_slew.py", "11_covariance.py"}  # fmt: skip
    in_test_interop = {"05_system.py", "06_joined_satellites.py", "07_groups.py"}
    assert here | in_test_interop == set(NUMBERED)


@pytest.mark.thorough
def test_kernels_in_three_ways() -> None:
    text = printed("01_kernels.py")
    assert "[0. 1. 0.]" in text.replace("-0.", "0.")
    change = float(re.search(r"change of a length: (\S+)", text)[1])  # type: ignore[index]
    assert change < 1e-15


@pytest.mark.thorough
def test_brick_agrees_with_nasa() -> None:
    text = printed("02_brick.py")
    assert "  rotation: no torque, moments " in text
    assert float(re.search(r"largest difference: (\S+) deg/s", text)[1]) < 1e-9  # type: ignore[index]


@pytest.mark.thorough
def test_beam_has_the_analytic_period() -> None:
    found = re.search(r"relative difference: (\S+) \(theory for this swing: (\S+)\)", printed("03_slender_beam.py"))
    assert found
    # Interpolated crossings of six periods of 1.6 s with steps of 0.01 s: some 1e-8.
    assert float(found[1]) == pytest.approx(float(found[2]), abs=3e-8)


@pytest.mark.thorough
def test_controller_brings_the_satellite_home() -> None:
    text = printed("04_controlled.py")
    angles = [float(a) for a in re.findall(r": +(\S+) deg", text)]
    start = np.degrees(Rotation.from_euler("ZYX", [60, -30, 45], degrees=True).magnitude())
    assert start > angles[0] > angles[1] > angles[-1]
    assert angles[-1] < 0.01
    assert text.endswith("largest difference to the FMU: 0.0\n")


@pytest.mark.thorough
def test_an_lqr_holds_a_satellite_as_the_linear_system_promises() -> None:
    text = printed("08_lqr.py")
    small, large = (list(map(float, found)) for found in re.findall(r"deg: (\S+) deg after 10 s, (\S+) deg", text))
    assert 0.0 < small[1] < 1e-9  # 24 e-folds from 1 deg: 4e-11
    assert small[0] < 0.3
    assert small[0] < large[0] < 60.0
    assert large[1] < 1e-6
    stays, promised = map(float, re.search(r"stays (\S+) deg off, (\S+) deg by", text).groups())  # type: ignore[union-attr]
    assert stays == pytest.approx(promised, abs=1e-5)
    assert stays > 0.01


@pytest.mark.slow
def test_a_slew_of_least_torque_ends_where_it_should_in_python_and_in_an_importer(tmp_path) -> None:
    text = printed("10_slew.py", tmp_path)
    (_, _), (least, off), (of_fmu, off_in_fmu) = (
        tuple(map(float, found)) for found in re.findall(r": +(\S+) N2 m2 s, (\S+) deg off", text)
    )
    one_axis = float(re.search(r"about one axis: (\S+)", text)[1])  # type: ignore[index]
    assert least < one_axis
    assert of_fmu == pytest.approx(least, rel=1e-6)
    assert max(off, off_in_fmu) < 1e-6


@pytest.mark.thorough
def test_a_covariance_that_is_carried_along_is_that_of_many_bodies(tmp_path) -> None:
    rows = re.findall(r"^ +(\d+) +(\S+) +(\S+)$", printed("11_covariance.py", tmp_path, "4000"), re.MULTILINE)
    assert len(rows) == 6
    for time, carried, drawn in rows:
        assert float(carried) == pytest.approx(float(drawn), rel=0.04 if int(time) < 60 else 0.1)


@pytest.mark.slow
def test_coils_brake_releases_until_a_leftover_magnet_turns_them_with_the_field(tmp_path) -> None:
    text = printed("09_detumbling.py", tmp_path, "400")
    assert text.startswith("400 runs, 0 failed\n")
    rates = re.search(r"median (\S+) deg/s, 99 % below (\S+) deg/s", text)
    # Over the equator, where the run ends, a dipole's field turns at three times the orbital rate of 0.063 deg/s.
    assert 0.189 < float(rates[1]) < float(rates[2]) < 0.6  # type: ignore[index]
    assert re.search(r"with constants.left_b\[\d\]: 0\.[2-9]\d\n", text)
    assert (tmp_path / "releases.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.slow
@needs_compiler
def test_held_inputs_are_of_first_order_half_a_step_earlier_of_second_and_with_slopes_exact() -> None:
    found = re.findall(r"(\S+) deg (?:held|from|with)", printed("benchmarks/held_inputs.py"))
    (held, earlier, given), (held_in_half, earlier_in_half, _) = np.reshape([float(x) for x in found], (2, 3))
    assert held / held_in_half == pytest.approx(2.0, rel=0.05)
    assert earlier / earlier_in_half == pytest.approx(4.0, rel=0.1)
    assert given < 1e-6


def test_what_the_examples_write_is_no_picture_of_the_repository() -> None:
    page = (EXAMPLES / "README.md").read_text(encoding="utf-8")
    example = (EXAMPLES / "09_detumbling.py").read_text(encoding="utf-8")
    written = re.findall(r" --plot (\S+)", page) + re.findall(r'Path\("(\S+)"\)', example)
    assert len(written) == 2
    assert not {f"{name}.png" for name in record.PICTURES}.intersection(written)


# The notebook


OWN = ("text/html", "<table><caption>")
"""What is ours among the outputs; others' tables look different in each of their versions."""


def outputs(notebook: Any) -> list[Any]:
    return [output for cell in notebook.cells if cell.cell_type == "code" for output in cell.outputs]


def own_tables(notebook: Any) -> list[str]:
    texts = [output.get("data", {}).get(OWN[0], "") for output in outputs(notebook)]
    return [text for text in texts if text.startswith(OWN[1])]


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::ResourceWarning")
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # of sockets that Jupyter leaves
def test_the_notebook_runs_and_shows_what_is_stored(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RBFMU_QUIET", "1")
    stored, fresh = nbformat.read(NOTEBOOK, 4), executed(NOTEBOOK, tmp_path)
    assert own_tables(fresh) == own_tables(stored), "renew by: python -m examples.renew_notebook"
    assert len(own_tables(fresh)) == 3
    kinds = {kind for output in outputs(fresh) for kind in output.get("data", {})}
    assert {"image/png", "application/vnd.jupyter.widget-view+json"} <= kinds, "a plot and a bar of progress"
    assert not [output for output in outputs(fresh) if output.output_type in ("error", "stream")]
    assert (tmp_path / "motion.html").stat().st_size > 500_000


@pytest.mark.thorough
@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::ResourceWarning")
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("chapter", CHAPTERS, ids=lambda path: path.stem)
def test_a_chapter_of_the_lecture_runs_and_its_assertions_hold(
    chapter: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MPLBACKEND", "agg")  # as where no screen is: pictures are shown all the same
    fresh, stored = outputs(executed(chapter, tmp_path)), outputs(nbformat.read(chapter, 4))
    kinds = [output.output_type for output in fresh]
    assert kinds == [output.output_type for output in stored], "renew by: python -m examples.renew_notebook"
    assert set(kinds) <= {"execute_result", "display_data"}


def test_there_is_a_notebook_a_chapter() -> None:
    assert [path.stem for path in CHAPTERS] == ["1_rotations", "2_kinematics", "3_newton_euler", "4_top"]
