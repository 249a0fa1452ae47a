"""Plans of scene files are kept on disk: the same words and numbers, sooner, and never for another scene."""

import os
import subprocess
import sys

import pytest
from click.testing import CliRunner

from rbfmu import kept_plans
from rbfmu.cli import main
from tests.support.paths import ROOT

SCENE = ROOT / "examples" / "scenes" / "t_handle.toml"
LOOK = "import sys; from rbfmu.cli import main; main({}, standalone_mode=False); print('numba' in sys.modules)"


@pytest.fixture
def scene(tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "kept"))
    path = tmp_path / "scene.toml"
    path.write_bytes(SCENE.read_bytes())
    return path


def said(*arguments):
    result = CliRunner().invoke(main, [str(a) for a in arguments])
    assert result.exit_code == 0, result.output
    return result.output


def kept(path):
    return sorted((path.parent / "kept" / "rbfmu_plans").glob("*"))


@pytest.mark.parametrize("options", [(), ("--json",), ("--model", "full"), ("--accuracy", "1e-4")])
def test_a_plan_is_said_again_in_the_same_words(scene, options):
    first = said("plan", scene, *options)
    assert len(kept(scene)) == 1
    assert said("plan", scene, *options) == first
    assert len(kept(scene)) == 1


def test_a_kept_plan_needs_no_compiler(scene):
    said("plan", scene)
    command = [sys.executable, "-c", LOOK.format(["plan", str(scene)])]
    done = subprocess.run(command, env=os.environ, capture_output=True, text=True, check=True, cwd=ROOT)
    assert done.stdout.splitlines()[-1] == "False"


def test_a_run_by_a_kept_plan_gives_the_same_bits(scene, tmp_path):
    files = [tmp_path / name for name in ("first.csv", "second.csv")]
    for file in files:
        said("run", scene, "-o", file)
    assert len(kept(scene)) == 1
    assert files[0].read_bytes() == files[1].read_bytes()


def test_another_scene_option_or_source_is_another_plan(scene, monkeypatch):
    said("plan", scene)
    said("plan", scene, "--accuracy", "1e-5")
    scene.write_text(scene.read_text() + "\n# another\n")
    said("plan", scene)
    monkeypatch.setattr(kept_plans, "_stamp", lambda: b"other sources")
    said("plan", scene)
    assert len(kept(scene)) == 4


@pytest.mark.parametrize("content", [b"", b"{", b"[1]", b"\xff\xfe", b"null", b"{}", b'a line\n{"doubts": []}'])
def test_what_cannot_be_read_is_planned_anew(scene, content):
    first = said("plan", scene)
    written = kept(scene)[0].read_bytes()
    kept(scene)[0].write_bytes(content)
    assert said("plan", scene) == first
    assert kept(scene)[0].read_bytes() == written


def test_a_plan_that_was_edited_is_planned_anew(scene):
    first = said("plan", scene, "--json")
    path = kept(scene)[0]
    written = path.read_text()
    path.write_text(written.replace('"cost": ', '"cost": 1'))
    assert path.read_text() != written
    assert said("plan", scene, "--json") == first
    assert path.read_text() == written


def test_a_plan_in_the_place_of_another_is_planned_anew(scene):
    first, other = said("plan", scene, "--json"), said("plan", scene, "--json", "--model", "full")
    one, two = kept(scene)
    texts = one.read_text(), two.read_text()
    one.write_text(texts[1])
    two.write_text(texts[0])
    assert [said("plan", scene, "--json"), said("plan", scene, "--json", "--model", "full")] == [first, other]
    assert first != other


def test_where_nothing_can_be_written_it_is_planned_each_time(scene):
    (scene.parent / "kept").write_text("a file, no folder")
    assert said("plan", scene) == said("plan", scene)


def test_a_doubt_is_said_each_time(scene):
    scene.write_text("[body]\nmass = 50.0\ninertia = [1e4, 2e4, 2.5e4]  # kg cm2\n[run]\nstop = 1.0\nstep = 0.1\n")
    results = [CliRunner().invoke(main, ["plan", str(scene)]) for _ in range(2)]
    assert results[0].stderr.count("Warning") == 1
    assert results[1].stderr == results[0].stderr
    assert len(kept(scene)) == 1


def test_the_oldest_go(scene, monkeypatch):
    monkeypatch.setattr(kept_plans, "MOST", 2)
    for accuracy in ("1e-3", "1e-4", "1e-5"):
        said("plan", scene, "--accuracy", accuracy)
    assert len(kept(scene)) == 2
