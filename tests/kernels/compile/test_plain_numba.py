"""Numba's internals are imported in one place; where one is missing or behaves otherwise, plain Numba serves."""

import ast
import os
import subprocess
import sys
import types
from pathlib import Path

import numpy as np
import pytest
from numba import config

from rbfmu_kernels.compile import numba_private
from tests.support.paths import ROOT

pytestmark = pytest.mark.skipif(bool(config.DISABLE_JIT), reason="needs the compiler")

PRODUCT = [p for folder in ("rbfmu", "kernels", "fmu_build") for p in sorted((ROOT / folder).rglob("*.py"))]
PUBLIC = {"numba", "numba.extending", "llvmlite", "llvmlite.binding", "llvmlite.ir"}
HOME = Path(numba_private.__file__)


def imported(path):
    """Names of modules that are imported anywhere in a module, or reached as members of another."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and not node.level:
            yield node.module or ""
            yield from (f"{node.module}.{alias.name}" for alias in node.names if alias.name in ("core", "np"))
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.attr in ("core", "np"):
            yield f"{node.value.id}.{node.attr}"


def test_no_other_module_imports_numba_s_internals():
    for path in PRODUCT:
        of_numba = {name for name in imported(path) if name.split(".")[0] in ("numba", "llvmlite")}
        assert of_numba <= PUBLIC, path


def test_numba_s_internals_are_imported_by_the_table_alone():
    assert "numba.core" in HOME.read_text(encoding="utf-8")
    others = [p for p in PRODUCT if p != HOME and "numba.core" in p.read_text(encoding="utf-8")]
    assert others == []


def test_all_internals_are_here_and_serve():
    from rbfmu_kernels import quaternion_from_axis_angle
    from rbfmu_kernels.compile.compiler import internals_serve
    from rbfmu_kernels.compile.gufunc import Item, gufuncs

    assert numba_private.MISSING == ""
    assert internals_serve()
    assert isinstance(gufuncs(Item(quaternion_from_axis_angle))[0], np.ufunc)  # no plain loop


@pytest.mark.parametrize("row", numba_private.INTERNALS)
def test_a_missing_row_is_named(row, monkeypatch):
    module, _, path = row.partition(":")
    name, _, member = path.partition(".")
    stub = types.ModuleType(module)
    vars(stub).update(vars(sys.modules[module]))
    if member:
        others = (r.split(".")[-1] for r in numba_private.INTERNALS if r.startswith(f"{module}:{name}."))
        setattr(stub, name, types.SimpleNamespace(**dict.fromkeys(set(others) - {member})))
    else:
        delattr(stub, name)
    monkeypatch.setitem(sys.modules, module, stub)
    monkeypatch.setattr(numba_private, "_found", {})
    assert numba_private._look_up() == row


def run(without, folder, **environment):
    path = folder / "results.npz"
    command = [sys.executable, "-m", "tests.support.plain_numba", without, str(path)]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, env=os.environ | environment)
    assert done.returncode == 0, done.stderr
    with np.load(path) as found:
        return {name: found[name] for name in found.files}


@pytest.fixture(scope="module")
def with_internals(tmp_path_factory):
    return run("all", tmp_path_factory.mktemp("all"))


@pytest.mark.thorough
def test_without_an_internal_all_bits_are_the_same(with_internals, tmp_path):
    found = run("numba.core.typed_passes:AnnotateTypes", tmp_path)
    assert found.keys() == with_internals.keys()
    assert "full turns" in str(found["said"])
    assert "v_b must have trailing shape" in str(found["refused"])
    assert [name for name in found if found[name].tobytes() != with_internals[name].tobytes()] == []


@pytest.mark.thorough
def test_where_internals_behave_otherwise_numba_s_own_compiler_makes_the_same_bits(with_internals, tmp_path):
    """The folder of compiled code is a new one: what is stored was made by internals that serve."""
    found = run("broken", tmp_path, NUMBA_CACHE_DIR=str(tmp_path))
    assert [name for name in found if found[name].tobytes() != with_internals[name].tobytes()] == []
    assert found
