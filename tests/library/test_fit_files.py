"""Scene files into which fitted numbers are written: of any spelling, and whole."""

import numpy as np
import pytest

import rbfmu
from rbfmu.identification.charts import chart_of
from tests.support.full_disk import full_disk


def test_a_file_that_could_not_be_read_again_is_not_written(tmp_path):
    file = tmp_path / "of_another.toml"
    file.write_text("[body]\nmas = 2.0\n")
    fitted = rbfmu.Scene(body={"mass": 2.0, "inertia": [1.0, 2.0, 2.5]})
    found = rbfmu.Fit(fitted, ("body.mass",), np.ones(1), np.ones(1), np.eye(1), (), {}, {}, (), None)
    with pytest.raises(rbfmu.SceneError, match=r"body\.mas"):
        found.save(tmp_path / "fitted.toml", file)
    assert [*tmp_path.iterdir()] == [file]


@pytest.mark.parametrize(("text", "key"), [
    ("body.mass = 2.0\nbody.inertia = [1.0, 2.0, 2.5]\n", "body.mass"),
    ('[body]\nmass = 2.0\n[run]\nstop = 2.0\n[body.shape]\nkind = "sphere"\nradius = 0.5\n', "body.inertia"),
    ('[body]\nmass = 2.0\nshape = { kind = "sphere", radius = 0.5 }\n', "body.mass"),
])  # fmt: skip
def test_any_spelling_of_a_table_may_be_written_over(tmp_path, text, key):
    """Keys with dots, and tables in parts, ended in a traceback; a shape gave another inertia beside a fitted mass."""
    file = tmp_path / "scene.toml"
    file.write_text(text)
    scene = rbfmu.load_scene(file)
    fitted = scene.replace({key: 2.2 if key == "body.mass" else [1.1, 2.1, 2.6]})
    names = [column.name for column in chart_of(scene, key).columns]
    n = len(names)
    found = rbfmu.Fit(fitted, tuple(names), np.ones(n), np.ones(n), np.eye(n), (), {}, {}, (), None)
    found.save(file, file)
    assert rbfmu.load_scene(file).body == fitted.body
    assert "# fitted; standard error 1" in file.read_text()


def test_a_scene_that_is_written_over_is_not_lost_on_a_full_disk(tmp_path):
    """It was emptied before that was seen; a link leads to it, and it keeps its mode."""
    file, link = tmp_path / "scene.toml", tmp_path / "link.toml"
    file.write_text(text := "body.mass = 2.0\nbody.inertia = [1.0, 2.0, 2.5]\n")
    file.chmod(0o600)
    link.symlink_to(file)
    found = rbfmu.Fit(rbfmu.load_scene(file), ("body.mass",), np.ones(1), np.ones(1), np.eye(1), (), {}, {}, (), None)
    with full_disk(10), pytest.raises(OSError, match=r"link\.toml"):
        found.save(link, link)
    assert file.read_text() == text
    assert len([*tmp_path.iterdir()]) == 2
    found.save(link, link)
    assert link.is_symlink()
    assert "# fitted" in file.read_text()
    assert file.stat().st_mode & 0o777 == 0o600
