"""ARCHITECTURE.md names what there is."""

import re

import pytest
from fmus import ROOT

TEXT = (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8")
ROOTS = [ROOT, ROOT / "kernels/rbfmu_kernels", ROOT / "rbfmu", ROOT / "fmu_build/rbfmu_fmu"]
ELSEWHERE = {"lint-imports", "verify", "mass", "torque_b", "known_torque_b", "step", "initialize", "outputs", "@kernel"}
"""Commands, blocks of a buffer, entry functions."""


def exists(name):
    """A folder, a file, a module, some modules, or a function or class in a module."""
    module, _, member = name.partition(".")
    for root in ROOTS:
        if list(root.glob(name)) or list(root.glob(f"{name}.py")):
            return True
        if (source := root / f"{module}.py").is_file() and re.search(
            rf"\b{member.split('.')[0]}\b", source.read_text()
        ):
            return True
    return False


@pytest.mark.parametrize("name", sorted(set(re.findall(r"`([^`\s]+)`", TEXT)) - ELSEWHERE))
def test_what_is_named_exists(name):
    assert exists(name), name


def test_every_folder_of_the_kernels_is_named():
    folders = {path.parent.name for path in (ROOT / "kernels/rbfmu_kernels").glob("*/__init__.py")}
    assert all(f"`{folder}/`" in TEXT for folder in folders)
