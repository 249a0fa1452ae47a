"""ARCHITECTURE.md names what there is."""

import re
from collections import defaultdict
from functools import cache
from pathlib import Path

import pytest

from tests.support.paths import ROOT

TEXT = (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8")
ROOTS = [ROOT / part for part in ("kernels", "rbfmu", "fmu_build", "tests", "examples")]
ELSEWHERE = {
    "lint-imports",
    "advance",
    "verify",
    "mass",
    "torque_b",
    "constant_torque_b",
    "step",
    "initialize",
    "outputs",
    "@kernel",
}
"""Commands, blocks of a buffer, entry functions."""


def exists(name):
    """A folder, a file, a module, or a function or class in a module."""
    if (ROOT / name).exists() or found_as(name):
        return True
    module, *members = name.split(".")
    texts = [_text(path) for path in found_as(f"{module}.py")]
    return not members or any(_defines(text, *members) for text in texts)


def _defines(text, name, *members):
    """Whether a module's own line begins with a name, or defines several; members need only stand in it."""
    own = re.search(rf"^(?:class |def )?(?:\w+, )*{name}\b", text, re.MULTILINE)
    return bool(own) and all(re.search(rf"\b{member}\b", text) for member in members)


@cache
def paths_by_name():
    found = defaultdict(list)
    for root in ROOTS:
        for path in root.rglob("*"):
            found[path.name].append(path)
    return found


def found_as(name):
    return [path for path in paths_by_name().get(Path(name).name, []) if path.match(name)]


def _text(path):
    return path.read_text(encoding="utf-8") if path.is_file() else ""


def test_what_is_named_exists():
    names = set(re.findall(r"`([^`\s]+)`", TEXT)) - ELSEWHERE
    assert len(names) > 300
    assert [name for name in names if not exists(name)] == []


def test_every_folder_of_the_kernels_is_named():
    folders = {path.parent.name for path in (ROOT / "kernels/rbfmu_kernels").glob("*/__init__.py")}
    assert all(f"`{folder}/`" in TEXT for folder in folders)


GLOSSARY = [line.split(" | ") for line in (ROOT / "GLOSSARY.md").read_text(encoding="utf-8").splitlines()[6:]]


def test_the_glossary_is_alphabetic():
    words = [row[0].removeprefix("| ") for row in GLOSSARY]
    assert len(words) > 40
    assert words == sorted(words)


@pytest.mark.parametrize("name", sorted({name for row in GLOSSARY for name in re.findall(r"`([^`]+)`", row[2])}))
def test_places_in_the_glossary_exist(name):
    assert exists(name), name
