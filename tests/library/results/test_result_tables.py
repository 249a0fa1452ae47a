"""What notebooks and other libraries get of scenes, plans and results."""

from html.parser import HTMLParser
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest

import rbfmu
from rbfmu.result import Result
from rbfmu.scene.scene import About, Body, Initial, Inputs, Loads, Outputs, Run, Scene
from rbfmu_kernels.quantities import OUTPUT
from tests.support.paths import SCENES

NAMES = {
    "About": About,
    "Scene": Scene,
    "Body": Body,
    "Initial": Initial,
    "Inputs": Inputs,
    "Loads": Loads,
    "Outputs": Outputs,
    "Run": Run,
}


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
    random = np.random.default_rng(1)
    shapes = {row.name: (5, row.size) if row.size > 1 else (5,) for row in OUTPUT.values()}
    return Result(0.5 * np.arange(5), {name: random.normal(size=shape) for name, shape in shapes.items()})


@pytest.mark.parametrize("path", sorted(SCENES.glob("*.toml")), ids=lambda path: path.stem)
def test_a_scene_s_repr_is_short_and_makes_the_scene_again(path: Path) -> None:
    scene = rbfmu.load_scene(path)
    assert eval(repr(scene), NAMES) == scene
    assert "Loads()" not in repr(scene)
    assert len(repr(scene)) < 600


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


def test_a_plot_is_a_figure_that_a_notebook_shows(result: Result, tmp_path: Path) -> None:
    figure = result.plot(title="it")
    assert len(figure.axes) == len(result.quantities)
    assert figure.axes[0].lines[1].get_ydata() == pytest.approx(result.position[:, 1])
    (tmp_path / "shown.png").write_bytes(figure._repr_png_())
    result.plot(tmp_path / "saved.png")
    for name in ("shown.png", "saved.png"):
        assert matplotlib.image.imread(tmp_path / name).std() > 0.0
