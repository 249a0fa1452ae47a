"""What a result writes and draws: streamed, with units, and lines of angles without strokes."""

import csv
import os
import tracemalloc
import zipfile
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import fmpy.util
import matplotlib.image
import numpy as np
import pytest
from matplotlib.figure import Figure

import rbfmu
from rbfmu import plot as charts
from rbfmu.result import CHUNK, Result, read_npz, write_npz
from rbfmu.scene.scene import Scene
from rbfmu_kernels.quantities import OUTPUT, own_output
from tests.support.full_disk import full_disk
from tests.support.paths import SCENES
from tests.support.scenes.balls import ball


def result_of(n: int, names: tuple[str, ...] = tuple(OUTPUT)) -> Result:
    random = np.random.default_rng(1)
    shapes = {name: (n, OUTPUT[name].size) if OUTPUT[name].size > 1 else (n,) for name in names}
    return Result(0.5 * np.arange(n), {name: random.normal(size=shape) for name, shape in shapes.items()})


@pytest.mark.parametrize("n", [1, CHUNK - 1, CHUNK, CHUNK + 1, 2 * CHUNK + 3])
def test_a_csv_has_every_row_in_full(n: int, tmp_path: Path) -> None:
    result = result_of(n)
    result.save(tmp_path / "it.csv")
    columns = result.columns()
    rows = [",".join(repr(float(c[i])) for c in columns.values()) for i in range(n)]
    expected = "\n".join([",".join(f'"{name}"' for name in columns), *rows]) + "\n"
    assert (tmp_path / "it.csv").read_text() == expected


def write(result: Result, path: Path) -> None:
    charts.plot_result(result, path) if path.suffix == ".png" else result.save(path)


@pytest.mark.parametrize("name", ["it.csv", "it.npz", "it.aem", "it.png"])
def test_a_result_that_stands_there_is_not_lost_on_a_full_disk(name: str, tmp_path: Path) -> None:
    """It was emptied before that was seen. Its mode stays, a new file has the usual one, and no part of one is left."""
    path, result = tmp_path / name, result_of(2, ("quaternion",))
    result.quantities["quaternion"] = rbfmu.normalize(result.quaternion)  # an AEM has no others
    write(result, path)
    (tmp_path / "usual").touch()
    assert path.stat().st_mode == (tmp_path / "usual").stat().st_mode
    path.chmod(0o640)
    before, files = path.read_bytes(), len([*tmp_path.iterdir()])
    with full_disk(100), pytest.raises(OSError, match=rf"File too large: '{path}'"):
        write(result, path)
    assert path.read_bytes() == before
    assert len([*tmp_path.iterdir()]) == files
    write(result, path)
    assert path.stat().st_mode & 0o777 == 0o640


def test_a_file_of_another_user_stays_theirs_where_that_is_allowed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """2026-11-30: what root wrote anew, as in a container, its owner could no longer read."""
    path, given, allowed = tmp_path / "it.npz", list[tuple[int, int]](), [True]

    def chown(part: Path, user: int, group: int) -> None:
        given.append((user, group))
        if not allowed.pop():
            raise PermissionError

    monkeypatch.setattr(os, "chown", chown)
    write(result_of(2), path)
    write(result_of(2), path)
    assert given == [(path.stat().st_uid, path.stat().st_gid)]
    allowed[:] = [False]
    write(result_of(3), path)
    assert len(rbfmu.Result.load(path).time) == 3


def test_the_events_of_an_earlier_run_go_and_what_is_no_such_file_stays(tmp_path: Path) -> None:
    """They stood beside the CSV of a run that has none, as if they were its own."""
    result, events = result_of(2), tmp_path / "it.events.csv"
    with_events = Result(result.time, result.quantities, None, {"late": [0.75], "contact": [0.5]}, {"late": [0.25]})
    with_events.save(tmp_path / "it.csv")
    lines = events.read_text().splitlines()
    assert lines == ["time,name,kind", "0.25,late,touch", "0.5,contact,event", "0.75,late,event"]
    result.save(tmp_path / "it.csv")
    assert not events.exists()
    events.write_text("mine\n")
    result.save(tmp_path / "it.csv")
    assert events.read_text() == "mine\n"


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


@pytest.mark.thorough
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


def test_a_result_without_rows_is_shown_and_cut_and_no_ephemeris(tmp_path: Path) -> None:
    """Each was a bare IndexError."""
    empty = Result([], {"quaternion": np.zeros((0, 4))})
    assert "<td>quaternion</td><td>1</td>" in empty._repr_html_()
    assert len(empty.until(1.0).time) == len(empty.until(-1.0).time) == 0
    assert len(empty.plot().axes) == 1
    with pytest.raises(ValueError, match=r"it\.aem': expected at least one point in time"):
        empty.save(tmp_path / "it.aem")
    with pytest.raises(ValueError, match="stop = nan"):
        empty.until(np.nan)


def test_the_part_up_to_a_time_counts_sums_of_steps_for_what_they_sum_up_to():
    """2026-12-01: the row at 3*0.1 = 0.30000000000000004 was left out."""
    found = Result(np.arange(6) * 0.1, {"kinetic_energy": np.arange(6.0)}, None, {"e": [3 * 0.1]}).until(0.3)
    assert found.time.tolist() == [0.0, 0.1, 0.2, 0.1 * 3]
    assert found.events["e"].tolist() == [0.1 * 3]


def test_the_part_up_to_a_time_has_what_happens_at_that_time_and_is_read_and_written_again(tmp_path: Path) -> None:
    energy, touches = {"kinetic_energy": [1.0, 2.0, 3.0]}, {"e, f": [0.25, 0.5, 0.6]}
    found = Result([0.0, 0.5, 1.0], energy, None, {"e, f": [0.5, 0.75]}, touches).until(0.5)
    assert (found.time.tolist(), found.kinetic_energy.tolist()) == ([0.0, 0.5], [1.0, 2.0])
    for ending in (".npz", ".csv", ".npz", ".csv"):
        assert (found.events["e, f"].tolist(), found.touches["e, f"].tolist()) == ([0.5], [0.25, 0.5])
        found.save(tmp_path / f"it{ending}")
        found = Result.load(tmp_path / f"it{ending}")


@pytest.mark.thorough
def test_dollars_of_titles_and_units_are_no_mathematics(tmp_path: Path) -> None:
    """Two of them ended in a traceback of Matplotlib's, or were left out."""
    result_of(3, ("omega_b",)).plot(tmp_path / "it.svg", "a $_{x$")
    assert "a $_{x$" in (tmp_path / "it.svg").read_text()
    rbfmu.simulate(ball(outputs={"cost": {"value": "t", "unit": "$_{$"}})).plot(tmp_path / "own.svg")
    assert "cost ($_{$)" in (tmp_path / "own.svg").read_text()


@pytest.mark.parametrize(("time", "quantities", "said"), [
    ([0.0, 0.1], {"foo": [0.0, 1.0]}, "quantity 'foo': expected some of position, "),
    ([0.0, 0.1], {"omega_b": [[0.0], [1.0]]}, r"omega_b has the shape \(2, 1\): expected \(2, 3\)"),
    (np.array([0, 1], "datetime64[s]"), {}, "time must be real numbers, got an array of datetime64"),
    (np.ma.masked_less([0.0, 1.0], 1.0), {}, "time must have no mask"),
    (0.0, {}, r"time has the shape \(\): expected \(n,\)"),
    ([[0.0, 1.0]], {}, r"time has the shape \(1, 2\): expected \(n,\)"),
])  # fmt: skip
def test_a_result_is_made_of_times_in_a_row_and_quantities_alone(time: Any, quantities: dict, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        Result(time, {"kinetic_energy": [0.0, 1.0]} | quantities)


GOOD = "time,omega_b[1],omega_b[2],omega_b[3]\n"


@pytest.mark.parametrize("ending", [".csv", ".npz"])
def test_what_is_saved_is_read_to_the_bit(ending: str, tmp_path: Path) -> None:
    saved = result_of(7)
    saved.save(str(tmp_path / f"it{ending}"))
    read = Result.load(tmp_path / f"it{ending}")
    np.testing.assert_array_equal(read.time, saved.time)
    assert list(read.quantities) == list(saved.quantities)
    for name, values in saved.quantities.items():
        np.testing.assert_array_equal(read.quantities[name], values)


@pytest.mark.parametrize("name", ["file", "allow_pickle", "args", "self"])
def test_an_output_may_have_the_name_of_an_argument_of_numpy(name: str, tmp_path: Path) -> None:
    """`np.savez` raised a TypeError for one, and left out the other without a word."""
    rbfmu.simulate(ball(outputs={name: "omega_b[1]"})).save(tmp_path / "it.npz")
    assert list(np.load(tmp_path / "it.npz")) == ["time", "omega_b", name]


def test_arrays_are_written_as_numpy_writes_them(tmp_path: Path) -> None:
    arrays = {"a": np.arange(6.0).reshape(3, 2).T, "b": np.array("text"), "c": np.zeros((0, 3))}
    np.savez(tmp_path / "it.npz", **arrays)  # type: ignore[arg-type]
    write_npz(tmp_path / "own.npz", arrays)
    assert (tmp_path / "own.npz").read_bytes() == (tmp_path / "it.npz").read_bytes()
    assert list(read_npz(tmp_path / "own.npz")) == [*arrays]


def test_columns_of_others_are_left_out(tmp_path: Path) -> None:
    (tmp_path / "fmu.csv").write_text('"status",x[1],x[3],' + GOOD + "0,0,0,0.0,1,2,3\n0,0,0,0.5,4,5,6\n")
    read = Result.load(tmp_path / "fmu.csv")
    assert list(read.quantities) == ["omega_b"]
    np.testing.assert_array_equal(read.omega_b, [[1, 2, 3], [4, 5, 6]])


def test_arrays_of_fmi_3_are_read_as_fmpy_writes_them(tmp_path: Path) -> None:
    """They were refused, as all of their numbers stand in one cell."""
    saved, path = result_of(7), tmp_path / "fmu.csv"
    names = [("time", "f8"), *((name, "f8", x.shape[1:]) for name, x in saved.quantities.items()), ("status", "i4")]
    rows = np.zeros(len(saved.time), np.dtype(names))
    for name, values in {"time": saved.time, **saved.quantities}.items():
        rows[name] = values
    fmpy.util.write_csv(path, rows)
    read = Result.load(path)
    assert list(read.quantities) == list(saved.quantities)
    for name, values in saved.quantities.items():
        np.testing.assert_allclose(read.quantities[name], values, rtol=1e-15)


def test_numbers_in_quotes_are_the_same_numbers(tmp_path: Path) -> None:
    text = GOOD + '"0", "1.5" ,2,3\n\n1,4,5,-6e-3\n'
    (tmp_path / "it.csv").write_text(text, encoding="utf-8-sig")  # with a mark of byte order, as spreadsheets write it
    read = Result.load(tmp_path / "it.csv")
    np.testing.assert_array_equal(read.time, [0.0, 1.0])
    np.testing.assert_array_equal(read.omega_b, [[1.5, 2.0, 3.0], [4.0, 5.0, -0.006]])


@pytest.mark.parametrize(("text", "message"), [
    ("a,b\n1,2\n", "'time' is missing"),
    ("time,omega_b[1],omega_b[3]\n0,1,2\n", r"omega_b\[2\] is missing"),
    (GOOD + "0,1,2,3\n0,1,2,3\n", r"time = 0.0 in row 2: expected times that increase"),
    (GOOD + "0,1,2,3\n1,1,nan,3\n", r"omega_b = nan in row 2: expected numbers"),
    (GOOD + "0,1,2,3\n1,1,2\n", "row 2 has 3 cells: expected 4"),
    (GOOD + "0,1,2,x\n", r'omega_b\[3\] = "x" in row 1: expected a number'),
    ("time,omega_b\n0,1 2 3\n1,5\n", r'omega_b\[1\] = "\[5\]" in row 2: expected a number'),
    ("time,omega_b\n0,1 2\n1,1 2\n", r"omega_b\[3\] is missing"),
    ("time,omega_b[1],omega_b\n0,1,1 2 3\n", r"'omega_b\[1\]' stands twice"),
    ("time,kinetic_energy\n0 1,5\n", 'time = "0 1" in row 1: expected a number'),
    (GOOD + "0,1 2,2,3\n", r'omega_b\[1\] = "1 2" in row 1: expected a number'),
])  # fmt: skip
def test_what_is_no_result_is_refused(text: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "it.csv").write_text(text)
    with pytest.raises(ValueError, match=message):
        Result.load(tmp_path / "it.csv")


def test_arrays_that_are_no_result_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "it.npz"
    np.savez(path, time=np.arange(3.0), omega_b=np.zeros((3, 2)))
    with pytest.raises(ValueError, match=r"omega_b has the shape \(3, 2\): expected \(3, 3\)"):
        Result.load(path)
    np.savez(path, time=np.arange(3.0), said=np.array("x" * 1000))
    with pytest.raises(ValueError, match=r"it\.npz: said must be real numbers, got an array of <U1000") as refused:
        Result.load(path)
    assert len(str(refused.value)) < 200 + len(str(path))
    for time in (np.array([0, 1], "datetime64[s]"), np.array([0.0, 1.0 + 1.0j])):  # of which parts were dropped
        np.savez(path, time=time, kinetic_energy=np.ones(2))
        with pytest.raises(ValueError, match=r"it\.npz: time must be real numbers, got an array of (datetime|complex)"):
            Result.load(path)
    np.savez(path, time=0.0)
    with pytest.raises(ValueError, match=r"it\.npz: time has the shape \(\): expected \(1,\)"):
        Result.load(path)
    np.savez(path, **{"time": np.arange(3.0), "resume/head": np.zeros(1)})
    with pytest.raises(ValueError, match=r"it\.npz: an ensemble's: .*; EnsembleResult\.load takes it"):
        Result.load(path)
    path.write_text("no arrays")
    with pytest.raises(ValueError, match=r"cannot be read as arrays of NumPy \(File is not a zip file\)"):
        Result.load(path)
    with zipfile.ZipFile(path, "w") as archive:
        header = f"{{'descr': '{'y' * 900}', 'fortran_order': False, 'shape': (3,)}}".ljust(1000).encode()
        archive.writestr("time.npy", b"\x93NUMPY\x01\x00" + (1000).to_bytes(2, "little") + header)
    with pytest.raises(ValueError, match="expected the result of a run") as refused:  # NumPy says all of the type
        Result.load(path)
    assert len(str(refused.value)) < 200 + len(str(path))
    with pytest.raises(ValueError, match=r"expected a name that ends in \.csv, \.npz or \.aem"):
        Result.load(tmp_path / "it.txt")
    with pytest.raises(FileNotFoundError):
        Result.load(tmp_path / "none.npz")


class Cells(HTMLParser):
    """The texts of a table's cells, and whether all that is opened is closed."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.texts: list[str] = []
        self.feed(html)
        assert not self.open

    def handle_starttag(self, tag: str, attrs: object) -> None:
        self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.texts.append(data)


@pytest.fixture(scope="module")
def result() -> Result:
    return result_of(5)


def test_a_scene_in_html_has_what_is_set_with_units() -> None:
    scene = Scene.from_dict({"name": "a<b", "body": {"mass": 2.0, "inertia": [1, 2, 3]}, "run": {"step": 0.5}})
    cells = Cells(scene._repr_html_()).texts
    assert cells[0] == "a<b"
    assert cells[cells.index("body.inertia") :][:3] == ["body.inertia", "[1.0, 2.0, 3.0]", "kg m2"]
    assert cells[cells.index("run.step") :][:3] == ["run.step", "0.5", "s"]
    assert not any("loads" in cell for cell in cells)


def test_a_plan_says_model_method_and_reasons() -> None:
    plan = rbfmu.plan(SCENES / "tumbling_brick.toml")
    assert repr(plan).startswith(f"Plan({plan.model}: {plan.method}; 7 states, error ")
    cells = Cells(plan._repr_html_()).texts
    assert {plan.model, plan.method, *plan.reasons} <= set(cells)


def test_a_result_in_html_has_its_ends_and_bounds(result: Result) -> None:
    cells = Cells(result._repr_html_()).texts
    assert "t = 2 s" in cells
    row = cells[cells.index("kinetic_energy") :][:6]
    energy = result.kinetic_energy
    assert row[1] == "J"
    assert [float(x) for x in row[2:]] == pytest.approx([energy[0], energy[-1], energy.min(), energy.max()], rel=1e-4)


def test_a_dataframe_has_a_column_for_each_variable_and_its_unit(result: Result) -> None:
    frame = result.to_dataframe()
    columns = result.columns()
    assert ["time", *frame.columns] == list(columns)
    np.testing.assert_array_equal(frame.index, result.time)
    np.testing.assert_array_equal(frame["omega_b[2]"], result.omega_b[:, 1])
    assert frame.attrs["units"]["omega_b"] == "rad/s"


def test_a_dataset_names_components_and_units(result: Result) -> None:
    data = result.to_xarray()
    assert list(data.data_vars) == list(result.quantities)
    np.testing.assert_array_equal(data.omega_b.sel(axis="y", time=1.0), result.omega_b[2, 1])
    np.testing.assert_array_equal(data.rpy.sel(angle="yaw"), result.rpy[:, 2])
    np.testing.assert_array_equal(data.quaternion.sel(parameter="η"), result.quaternion[:, 0])
    np.testing.assert_array_equal(data.kinetic_energy, result.kinetic_energy)
    assert data.omega_b.attrs["units"] == "rad/s"
    assert data.time.attrs["units"] == "s"
    own = Result([0.0], {"axis": [2.0], "omega_b": np.ones((1, 3))}, {"axis": own_output("axis", 1, "m", "")})
    assert own.to_xarray().axis.dims == ("time",)  # a name that a dimension has; xarray refused two of them


@pytest.mark.thorough
def test_a_plot_is_a_figure_that_a_notebook_shows(result: Result, tmp_path: Path) -> None:
    figure = result.plot(title="it")
    assert len(figure.axes) == len(result.quantities)
    assert figure.axes[0].lines[1].get_ydata() == pytest.approx(result.position[:, 1])
    (tmp_path / "shown.png").write_bytes(figure._repr_png_())
    result.plot(tmp_path / "saved.png")
    for name in ("shown.png", "saved.png"):
        assert matplotlib.image.imread(tmp_path / name).std() > 0.0
