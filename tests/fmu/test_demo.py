"""The demonstration passes, says what the README says, and leaves its files; and it can fail."""

import io
import itertools
import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.image import imread
from rich.console import Console

import rbfmu
from rbfmu_fmu import demo
from tests.support.command_line import call
from tests.support.paths import SHARED


def test_demo_passes_and_leaves_a_picture(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text, ticks = io.StringIO(), itertools.count()
    monkeypatch.setattr(demo, "perf_counter", lambda: next(ticks))  # a second a look
    assert demo.run_demo(tmp_path / "out", Console(file=text, width=100))
    assert ("the same bits in all three ways" in text.getvalue()) == (demo.ROUND_OFF == 0.0)
    assert "DIFFER" not in text.getvalue()
    names = {p.name for p in (tmp_path / "out").iterdir()}
    assert names == {"tumbling_brick.png", "tumbling_brick.fmu", "kernels.csv", "kernels.units.csv", "fmpy_command.csv"}
    picture = imread(tmp_path / "out" / "tumbling_brick.png")
    assert picture.min() < picture.max()  # something is drawn
    steps = len((tmp_path / "out" / "kernels.csv").read_text().splitlines()) - 2
    costs = re.findall(r"│ +([\d.e+]+)(?: \(with .*\))? +│$", text.getvalue(), re.MULTILINE)
    assert [1e-6 * steps * float(cost) for cost in costs] == pytest.approx([1.0, 1.0, 1.0], rel=1e-2)


@pytest.mark.thorough
def test_demo_fails_where_nasa_disagrees(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    wrong = {s: tuple((t, p + 2e-9, *rest) for t, p, *rest in rows) for s, rows in demo.NASA.items()}
    monkeypatch.setattr(demo, "NASA", wrong)
    assert not demo.run_demo(tmp_path, Console(file=io.StringIO()))


@pytest.mark.parametrize(("passes", "status"), [(True, 0), (False, 1)])
def test_command_fails_where_the_demonstration_does(passes: bool, status: int, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr(demo, "run_demo", lambda folder, console: passes)
    assert call("demo", "--output", tmp_path / "out").exit_code == status


@pytest.mark.parametrize(("compiled", "name"), [(False, "kernels, plain Python"), (True, "compiled kernels")])
def test_the_kernels_time_says_whether_it_is_that_of_compiled_code(
    compiled: bool, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = rbfmu.load_scene(demo.scene_file("tumbling_brick.toml")).replace(run={"stop": 1.0})
    monkeypatch.setattr(demo, "tiered", lambda kernel: SimpleNamespace(is_compiled=compiled))
    _, way = demo._by_kernels(scene, rbfmu.plan(scene))
    assert way.name == name


@pytest.mark.parametrize("simulation", ["01", "04"])
def test_brick_is_where_nasa_has_it(simulation: str) -> None:
    result = rbfmu.simulate(rbfmu.load_scene(demo.scene_file("tumbling_brick.toml")))
    found = demo.errors_against_nasa(simulation, result.time, result.quaternion, result.omega_b)
    assert len(found) == 7
    assert max(rate for _, rate, _ in found) < 4e-10  # deg/s: NASA's printed digits
    assert max(attitude for _, _, attitude in found) < 6e-5  # deg: the drift in longitude of NASA's brick


def test_quoted_figures_are_those_of_the_data() -> None:
    data = SHARED / "nasa_tumbling_brick.csv"
    if not data.exists():
        pytest.skip("NASA's data are not here")
    table = np.genfromtxt(data, delimiter=",", names=True)
    for simulation, rows in demo.NASA.items():
        columns = [table[f"sim{simulation}_{c}"] for c in ("p", "q", "r", "yaw", "pitch", "roll")]
        for row in rows:
            k = int(np.argmin(np.abs(table["time_s"] - row[0])))
            assert tuple(c[k] for c in columns) == row[1:]
