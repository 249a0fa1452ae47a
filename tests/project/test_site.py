"""The site: each public name has an entry, examples and tours run, and every link leads somewhere."""

import inspect
import os
import subprocess
import sys
from html import unescape
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest

import rbfmu
import rbfmu_fmu
import rbfmu_kernels
from examples.site import examples_of, reference
from rbfmu.cli import main
from rbfmu.scene.keys import scene_keys
from tests.support.paths import ROOT

REFERENCE = "examples/site/reference"
DRAWN = "rbfmu.rotate", "rbfmu.Scene", "rbfmu.Simulator", "rbfmu_kernels.add_scaled", "rbfmu_fmu.build"


class Page(HTMLParser):
    """Collect ids, and addresses that links and pictures have."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.ids: set[str] = set()
        self.addresses: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.ids |= {value for name, value in attrs if name == "id" and value}
        self.addresses |= {value for name, value in attrs if name in ("href", "src") and value}


def test_every_array_function_has_values_for_an_example() -> None:
    for name in rbfmu.__all__:
        if inspect.isfunction(getattr(rbfmu, name)):
            assert name in examples_of.code_of(name) or name in examples_of.SAME


def test_docstrings_are_told_as_markdown() -> None:
    text = "Return |v| of v_b.\n\nMore.\nShapes: v (3) -> (); axes.\nUnits: m.  Frames: b.\n"
    text += "Error <= 2 eps |v|.  Source: E&G 6.7.\n"
    told = reference.prose(text)
    assert r"Return \|v\| of v\_b." in told
    assert [line for line in told.splitlines() if line.startswith("**")] == [
        r"**Shapes**: v (3) -\> (); axes. ",
        "**Units**: m. ",
        "**Frames**: b. ",
        r"**Error** \<= 2 eps \|v\|. ",
        "**Source**: E&G 6.7.",
    ]
    assert "\n\n**scene**: one. " in reference.prose("Run.\n\n    scene: one. progress: wraps.\n")


@pytest.mark.thorough
def test_the_site_is_built_has_every_name_and_no_link_is_broken(tmp_path: Path) -> None:
    built = tmp_path / "site"
    command = (sys.executable, "-m", "sphinx", "-q", "-W", "-c", "examples/site", "-d", tmp_path / "trees", ".", built)
    done = subprocess.run(command, cwd=ROOT, env=os.environ | {"MPLBACKEND": "agg"}, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    pages = {path: Page(path.read_text(encoding="utf-8")) for path in built.rglob("*.html")}
    broken = [
        f"{path.relative_to(built)}: {address}"
        for path, page in pages.items()
        for address in page.addresses
        if not leads_somewhere(path, address, pages)
    ]
    assert not broken
    ids = set().union(*(page.ids for page in pages.values()))
    assert set(DRAWN) <= names() <= ids
    assert {f"rbfmu-{name}" for name in main.commands} <= ids
    keys, commands = (
        unescape((built / REFERENCE / name).read_text("utf-8")) for name in ("keys.html", "commands.html")
    )
    assert not [key.name for key in scene_keys() if key.name.rpartition(".")[2] not in keys]
    assert '"ZYX"' in keys
    assert "3 needs --native." in commands
    assert (built / "index.html").read_bytes() == (built / "README.html").read_bytes()


def names() -> set[str]:
    kernels = {f"rbfmu_kernels.{name}" for name in rbfmu_kernels.__all__ if name not in rbfmu.__all__}
    plain = {name: getattr(rbfmu_kernels, name.partition(".")[2]) for name in kernels}
    routines = {name for name, value in plain.items() if inspect.isroutine(getattr(value, "py_func", value))}
    return {f"rbfmu.{name}" for name in rbfmu.__all__} | {f"rbfmu_fmu.{name}" for name in rbfmu_fmu.__all__} | routines


def leads_somewhere(page: Path, address: str, pages: dict[Path, Page]) -> bool:
    parts = urlsplit(address)
    if parts.scheme or parts.netloc:
        return True
    file = (page.parent / unquote(parts.path)).resolve() if parts.path else page
    return file.exists() and (not parts.fragment or file not in pages or parts.fragment in pages[file].ids)
