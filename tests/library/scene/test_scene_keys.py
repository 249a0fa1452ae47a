"""`rbfmu keys` and `rbfmu new`: every key of a scene, from the fields that check it."""

import re
import shlex
import tomllib
from pathlib import Path

import pytest

import rbfmu
from rbfmu.scene.keys import REQUIRED, new_scene, scene_keys
from rbfmu.scene.scene import PARAMETERS, PORTS, QUANTITIES, Scene
from tests.support.command_line import call
from tests.support.full_disk import full_disk
from tests.support.scenes.bad_scenes import GOOD
from tests.support.scenes.scene_tables import DEFAULTS, SMALLEST

KEYS = {key.path: key for key in scene_keys()}
OPTIONAL = re.compile(r"^#(\w+) = ", re.MULTILINE)


def test_every_key_that_a_scene_takes_is_listed() -> None:
    attitude = {
        f"initial.attitude.{key}" for key in ("euler", "angles_deg", "angles", "quaternion", "rotvec", "matrix")
    }
    shape = {f"body.shape.{key}" for key in ("kind", "sides", "length", "radius", "semiaxes")}
    others = {"name", "body.shape", "initial.omega_b_deg"}
    written = {f"{table}.{key}" for table, keys in DEFAULTS.items() if table != "name" for key in keys}
    ensemble = {f"ensemble.{key}" for key in ("runs", "seed", "design", "keep", "vary")}
    ensemble |= {f"ensemble.correlation.{key}" for key in ("components", "matrix", "covariance")}
    about = {f"about.{key}" for key in ("description", "author", "version", "license")}
    own = {f"{table}.NAME" for table in ("constants", "tables", "formulas", "states", "events", "outputs")}
    own |= {"loads.potential"}
    assert set(KEYS) == attitude | shape | others | written | ensemble | about | own
    assert set(KEYS) >= {f"{table}.{key}" for table, keys in GOOD.items() for key in keys}


def test_every_key_has_a_meaning_and_numbers_with_a_unit_have_it() -> None:
    assert all(key.meaning for key in KEYS.values())
    units = {"body.mass": "kg", "body.inertia": "kg m2", "initial.velocity": "m/s", "initial.omega_b_deg": "deg/s"}
    units |= {
        "loads.damping_b": "N m s/rad", "run.step": "s", "body.shape.sides": "m", "initial.attitude.rotvec": "rad",
    }  # fmt: skip
    assert {path: KEYS[path].unit for path in units} == units


def test_the_defaults_listed_are_those_that_a_scene_has() -> None:
    tables: dict[str, dict[str, object]] = {}
    for key in KEYS.values():
        if key.default.startswith("all") or key.default in ("", REQUIRED) or key.name == "name":
            continue
        tables.setdefault(key.table, {})[key.name] = tomllib.loads(f"x = {key.default}")["x"]
    assert {path for path, key in KEYS.items() if key.default == REQUIRED} >= {"body.mass", "body.inertia"}
    body = SMALLEST["body"] | tables.pop("body")
    vary = {"vary": {"body.mass": {"normal": [2.0, 0.1]}}}
    made = Scene.from_dict({"body": body} | tables | {"ensemble": tables["ensemble"] | vary})
    assert made == Scene.from_dict(SMALLEST | {"ensemble": vary})


def test_keys_prints_them_all(monkeypatch: pytest.MonkeyPatch) -> None:
    result = call("keys")
    assert result.exit_code == 0
    assert all(f"[{key.table}]" in result.output for key in KEYS.values() if key.table)
    lines = [line.split() for line in result.output.splitlines()]
    assert ["step", "s", "0.01", "communication", "step"] in lines
    assert ["mass", "kg", "required", "mass"] in lines
    assert max(map(len, result.output.splitlines())) <= 80
    for name in (*PORTS, *PARAMETERS, *QUANTITIES):
        assert name in result.output
    monkeypatch.setenv("COLUMNS", "40")
    assert "…" not in call("keys").output  # what has no room goes on in the next line


def test_a_new_scene_runs_and_has_every_key(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    result = call("new", "first")
    assert result.exit_code == 0
    assert result.output == "first.toml (next: rbfmu run first.toml)\n"
    text = Path("first.toml").read_text(encoding="utf-8")
    assert text == new_scene("first")
    for key in KEYS.values():
        of_formulas = key.name in ("NAME", "potential")
        if key.table not in ("body.shape", "initial.attitude") and not key.path.startswith("ensemble") | of_formulas:
            assert re.search(rf"^#?{key.name} = ", text, re.MULTILINE), key
    assert call("run", "first.toml", "--stop", 0.1).exit_code == 0
    assert rbfmu.load_scene("first.toml").name == "first"


@pytest.mark.parametrize("name", OPTIONAL.findall(new_scene("any")))
def test_what_a_new_scene_comments_out_is_the_default_or_stands_in_place_of_another(name: str) -> None:
    given = {"shape": "inertia", "omega_b_deg": "omega_b"}.get(name, "nothing")
    lines = new_scene("any").replace(f"#{name} = ", f"{name} = ").splitlines()
    text = "\n".join(line for line in lines if not line.startswith(f"{given} = "))
    changed, scene = Scene.from_dict(tomllib.loads(text)), Scene.from_dict(tomllib.loads(new_scene("any")))
    assert (changed == scene) == (given == "nothing")


@pytest.mark.parametrize("name", ["two\nlines", "  ", "x" * 201, 'a"b', "größe", "no/such/folder", "a.toml", "."])
def test_a_new_scene_s_name_is_one_that_a_scene_may_have(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    result = call("new", name)
    files = list(tmp_path.iterdir())
    assert result.exit_code == (2 if name in ("two\nlines", "  ", "x" * 201, "no/such/folder", ".") else 0)
    assert [rbfmu.load_scene(f).name for f in files] == [name.removesuffix(".toml")] * (result.exit_code == 0)
    assert "Traceback" not in result.output


@pytest.mark.parametrize(("name", "shown"), [("-z", "./-z.toml"), ("a b", "'a b.toml'")])
def test_the_next_command_can_be_pasted(name: str, shown: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A name that begins as an option, and one that a shell takes apart."""
    monkeypatch.chdir(tmp_path)
    assert call("new", "--", name).output == f"{name}.toml (next: rbfmu run {shown})\n"
    assert rbfmu.load_scene(shlex.split(shown)[0]).name == name


def test_a_file_that_is_there_stays(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text("precious")
    result = call("new", path)
    assert result.exit_code == 2
    assert "mine.toml: exists already" in result.stderr
    assert path.read_text() == "precious"
    link, target = tmp_path / "link.toml", tmp_path / "elsewhere.toml"
    link.symlink_to(target)
    assert "link.toml: exists already" in call("new", link).stderr
    assert not target.exists()


def test_a_file_that_a_full_disk_cuts_short_is_not_left(tmp_path: Path) -> None:
    """2026-11-30: its name was taken then, by a file without a scene."""
    with full_disk(10):
        assert call("new", tmp_path / "mine.toml").exit_code == 2
    assert not [*tmp_path.iterdir()]
    assert call("new", tmp_path / "mine.toml").exit_code == 0


BODY = "[body]\nmass = 2.0\ninertia = [1.0, 2.0, 2.5]\n"


@pytest.mark.parametrize(("before", "description"), [
    ("# A brick\n#   that tumbles\n#\n# and more\n", "A brick that tumbles"),
    ("# my.toml\n# A brick\n", "A brick"),
    ("#\n# A brick\n\n# of the body\n", "A brick"),
    ("# bell \x7f rings\n".replace("\x7f", "\u200b"), "bell  rings"),
    ("# " + "x" * 2000 + "\n", "x" * 1000),
    ("# my.toml\n", ""),
    ("\n# of the body\n", ""),
    ("", ""),
])  # fmt: skip
def test_a_scene_s_description_is_its_file_s_first_paragraph(before: str, description: str, tmp_path: Path) -> None:
    path = tmp_path / "my.toml"
    path.write_text(before + BODY, encoding="utf-8")
    assert rbfmu.load_scene(path).about.description == description


def test_a_description_that_is_given_stays(tmp_path: Path) -> None:
    path = tmp_path / "my.toml"
    path.write_text("# A brick\n" + BODY + '[about]\ndescription = "Another"\nauthor = "Ann"\n')
    expected = {"description": "Another", "author": "Ann", "version": "", "license": ""}
    assert rbfmu.load_scene(path).about.table() == expected
