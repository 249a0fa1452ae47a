"""What a result writes and draws: streamed, with units, and lines of angles without strokes."""

import csv
import tracemalloc
from pathlib import Path
from typing import Any

import fmpy.util
import numpy as np
import pytest
from matplotlib.figure import Figure

from rbfmu import plot as charts
from rbfmu.result import CHUNK, Result
from rbfmu_kernels.quantities import OUTPUT

WIDTHS = {"quaternion": 4, "kinetic_energy": 0}


def result_of(n: int, names: tuple[str, ...] = tuple(OUTPUT)) -> Result:
    random = np.random.default_rng(1)
    shapes = {name: (n, WIDTHS.get(name, 3)) if WIDTHS.get(name, 3) else (n,) for name in names}
    return Result(0.01 * np.arange(n), {name: random.normal(size=shape) for name, shape in shapes.items()})


@pytest.mark.parametrize("n", [1, CHUNK - 1, CHUNK, CHUNK + 1, 2 * CHUNK + 3])
def test_a_csv_has_every_row_in_full(n: int, tmp_path: Path) -> None:
    result = result_of(n)
    result.save(tmp_path / "it.csv")
    columns = result.columns()
    rows = [",".join(repr(float(c[i])) for c in columns.values()) for i in range(n)]
    expected = "\n".join([",".join(f'"{name}"' for name in columns), *rows]) + "\n"
    assert (tmp_path / "it.csv").read_text() == expected


@pytest.mark.parametrize("name", ["it.csv", "it.npz", "it.png"])
def test_a_full_disk_is_said_with_the_file_s_name(name: str, tmp_path: Path, limited: Any) -> None:
    result, path = result_of(2, ("quaternion",)), tmp_path / name
    limited(100)
    with pytest.raises(OSError, match=rf"File too large: '{path}'"):
        charts.plot_result(result, path) if path.suffix == ".png" else result.save(path)


@pytest.mark.thorough
def test_a_csv_is_written_piece_by_piece(tmp_path: Path) -> None:
    """However long: some 100 bytes a number of one piece, where the whole text took 2 kB a row."""
    result = result_of(30 * CHUNK)
    tracemalloc.start()
    result.save(tmp_path / "it.csv")
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 100 * CHUNK * len(result.columns())


def test_units_stand_in_a_file_beside_the_csv_and_fmpy_reads_the_csv(tmp_path: Path) -> None:
    result = result_of(5)
    result.save(tmp_path / "it.csv")
    with (tmp_path / "it.units.csv").open(newline="") as file:
        rows = list(csv.reader(file))
    assert rows[0] == ["name", "unit", "meaning"]
    assert [row[0] for row in rows[1:]] == list(result.columns())
    units = {row[0]: row[1] for row in rows[1:]}
    some = {"time": "s", "position[3]": "m", "quaternion[4]": "1", "omega_b[1]": "rad/s", "kinetic_energy": "J"}
    assert {name: units[name] for name in some} == some
    read = fmpy.util.read_csv(str(tmp_path / "it.csv"))
    assert list(read.dtype.names) == list(result.columns())
    assert (read["quaternion[4]"] == result.quaternion[:, 3]).all()


def test_a_result_knows_its_units() -> None:
    assert result_of(2, ("omega_b", "kinetic_energy")).units == {"time": "s", "omega_b": "rad/s", "kinetic_energy": "J"}


def test_a_line_of_angles_has_a_gap_where_it_loses_a_turn() -> None:
    time, angles = np.arange(6.0), np.array([3.0, 3.1, -3.1, -3.0, 3.0, 2.0])
    t, y = charts.broken(time, angles, 2.0 * np.pi)
    assert np.isnan(y).nonzero()[0].tolist() == [2, 5]
    assert y[~np.isnan(y)].tolist() == angles.tolist()
    assert t[~np.isnan(y)].tolist() == time.tolist()
    assert charts.broken(time, angles, np.inf)[1].tolist() == angles.tolist()


def test_a_plot_names_units_and_draws_no_stroke(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    drawn: list[Figure] = []
    save = Figure.savefig
    monkeypatch.setattr(Figure, "savefig", lambda self, *a, **k: (drawn.append(self), save(self, *a, **k)))
    n = 200
    yaw = np.angle(np.exp(1j * np.linspace(0.0, 20.0, n)))
    result = result_of(n)
    result.quantities["rpy"] = np.stack([0.0 * yaw, 0.0 * yaw, yaw], axis=1)
    charts.plot_result(result, tmp_path / "it.png")
    panels = drawn[0].axes
    for quantity, axes in zip(OUTPUT.values(), panels, strict=True):
        unit = quantity.unit.replace("m2", "m²").replace("s2", "s²")
        assert axes.get_ylabel() == quantity.label + (f" ({unit})" if unit != "1" else "")
    assert panels[-1].get_xlabel() == "time (s)"
    lines = panels[list(OUTPUT).index("rpy")].lines
    with np.errstate(invalid="ignore"):
        steps = [np.nanmax(np.abs(np.diff(line.get_ydata()))) for line in lines]
    assert max(steps) < np.pi


@pytest.mark.parametrize(("quantities", "said"), [
    ({"foo": [0.0, 1.0]}, "quantity 'foo': expected some of position, "),
    ({"omega_b": [[0.0], [1.0]]}, r"omega_b has the shape \(2, 1\): expected \(2, 3\)"),
])  # fmt: skip
def test_a_result_is_made_of_quantities_alone(quantities: dict, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        Result([0.0, 0.1], quantities)
    assert Result([0.0, 0.1], {"omega_b": [[0, 0, 1]] * 2}).plot().axes
