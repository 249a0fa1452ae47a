"""What a command does so as to start and end soon."""

import atexit
import gc
import subprocess
import sys

import rbfmu.__main__


def test_a_command_seldom_looks_for_garbage_and_leaves_it_at_the_end(monkeypatch):
    """What it imports and compiles lives until its end: looking through that takes a quarter of a short command."""
    thresholds, at_end = [], []
    monkeypatch.setattr("rbfmu.cli.main", lambda prog_name: None)
    monkeypatch.setattr(gc, "set_threshold", thresholds.append)
    monkeypatch.setattr(atexit, "register", at_end.append)
    rbfmu.__main__.main()
    assert thresholds == [rbfmu.__main__.YOUNG]
    assert gc.freeze in at_end


def test_free_rotation_is_loaded_when_it_is_used():
    """Its modules take as long as those of all other array functions."""
    code = """
import sys, rbfmu_kernels as k, rbfmu.arrays

print([m for m in sys.modules if m.startswith("rbfmu_kernels.exact")])
print("free_rotation" in rbfmu.arrays.__all__, rbfmu.arrays.free_rotation.__name__)
print(callable(k.free_rotation_at), k.free_rotation.__name__)
for module in (k, rbfmu.arrays):
    print(hasattr(module, "no_such_function"))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split("\n")[:5] == ["[]", "True free_rotation", "True free_rotation", "False", "False"]
