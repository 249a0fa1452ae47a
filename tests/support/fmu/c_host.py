"""A host that is not Python runs a pythonfmu FMU: the program of fmu_host.c."""

import os
import subprocess
import sys
import sysconfig
from functools import cache
from importlib.util import find_spec
from pathlib import Path

import pytest

from tests.support.compilers import c_compiler
from tests.support.fmu.fmus import opened
from tests.support.paths import C_SOURCES


def shared_python():
    """A shared library of this Python, which a host that is not Python preloads; (library, its home)."""
    name = sysconfig.get_config_var("INSTSONAME") or "libpython.so"
    places = [sysconfig.get_config_var("LIBDIR"), "/usr/lib/x86_64-linux-gnu", "/usr/lib/aarch64-linux-gnu"]
    found = [Path(p) / name for p in places if p and (Path(p) / name).suffix != ".a" and (Path(p) / name).is_file()]
    if not found:
        pytest.skip(f"no shared {name} in {places}")
    return found[0], sys.base_prefix if str(found[0]).startswith(sys.base_prefix) else "/usr"


@cache
def c_host(folder):
    compiler = c_compiler() or pytest.skip("no C compiler")
    subprocess.run([compiler, "-O2", "-o", folder / "host", C_SOURCES / "fmu_host.c", "-ldl"], check=True)
    return folder / "host"


def run_c_host(folder, name, steps, repeats, **environment):
    """(rows by life, ns per step) from a process without Python: two loads of the library, a reset in each."""
    library, home = shared_python()
    fmu = opened(name)
    inputs, outputs = (fmu.by_causality[c] for c in ("input", "output"))
    assert [fmu.references[n] for n in inputs] == list(range(len(inputs)))
    shared_object = next((fmu.folder / "binaries" / "linux64").glob("*.so"))
    command = [c_host(folder), shared_object, fmu.guid, (fmu.folder / "resources").as_uri(), steps, 0.01]
    command += [len(inputs), fmu.references[outputs[0]], len(outputs), repeats]
    packages = os.pathsep.join({str(Path(find_spec(name).origin).parents[1]) for name in ("numba", "numpy")})
    environment = {"LD_PRELOAD": str(library), "PYTHONHOME": home, "PYTHONPATH": packages} | environment
    environment["NUMBA_CACHE_DIR"] = str(folder)
    done = subprocess.run(
        list(map(str, command)), env=os.environ | environment, capture_output=True, text=True, timeout=1200
    )
    assert done.returncode == 0, done.stderr
    assert not done.stderr
    rows = [[float.fromhex(number) for number in line.split()] for line in done.stdout.splitlines() if "x" in line]
    times = [float(line) for line in done.stdout.splitlines() if "x" not in line]
    return [rows[k : k + steps] for k in range(0, len(rows), steps)], min(times)


def rows_for_c_host(name, steps):
    instance, rows = opened(name).started(), []
    for k in range(steps):
        instance.set({n: 0.125 * ((k + i) % 8 - 4) for i, n in enumerate(opened(name).by_causality["input"])})
        rows += instance.steps(1, first=k)
    return rows
