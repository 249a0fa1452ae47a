"""FMUs of a few scenes, built and unzipped once per session; their kernels by hand; cases in processes of their own."""

import atexit
import importlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
import zipfile
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import rbfmu_fmu
from rbfmu.planning.select import plan
from rbfmu.runs.plan import filled_buffer, initialize
from rbfmu.scene.scene import Scene, load_scene
from rbfmu_fmu.description import describe
from tests.support.fmu.elsewhere import copy_modules
from tests.support.fmu.fmu_importer3 import imported
from tests.support.paths import SCENES, SHARED_BY_WORKERS

BRICK = SCENES / "tumbling_brick.toml"
TRIAXIAL = [[1.0, 0.1, -0.05], [0.1, 2.0, 0.2], [-0.05, 0.2, 2.5]]
ALL_PORTS = ["force_a", "force_b", "torque_a", "torque_b"]
BODY_AND_START = [
    "mass", "inertia", "r_oc_b", "gravity_a", "damping_b", "position_0", "velocity_0", "quaternion_0", "omega_b_0",
]  # fmt: skip
RUN = {"stop": 100.0, "step": 0.01, "accuracy": 1e-3}
TABLES = {
    # a torque-driven triaxial body with forces at an offset point
    "driven": {
        "body": {"mass": 2.0, "inertia": TRIAXIAL, "r_oc_b": [0.3, -0.2, 0.1]},
        "initial": {
            "position": [1.0, 2.0, 3.0],
            "velocity": [0.1, 0.2, 0.3],
            "attitude": {"euler": "ZYX", "angles_deg": [10, 20, 30]},
            "omega_b": [0.1, 0.2, 0.3],
        },
        "loads": {"gravity_a": [0.0, 0.0, -9.81], "torque_b": [0.0, 0.01, 0.0], "damping_b": [0.02, 0.01, 0.03]},
        "inputs": {"ports": ALL_PORTS, "parameters": BODY_AND_START},
        "run": RUN,
    },
    "two_ports": {
        "body": {"mass": 2.0, "inertia": TRIAXIAL},
        "inputs": {"ports": ["torque_b", "force_a"]},
        "run": RUN,
    },
    "torqued": {  # about its centre of mass: angular momentum is what the torque adds
        "body": {"mass": 2.0, "inertia": [1.0, 2.0, 2.5]},
        "inputs": {"ports": ["torque_a"]},
        "run": RUN | {"accuracy": 1e-9},
    },
    "prescribed": {"inputs": {"ports": ["omega_b"]}, "run": RUN},
    "pendulum": {
        "body": {"mass": 2.0, "inertia": [1.0, 1.2, 1.4], "r_oc_b": [0.1, 0.0, -0.5], "pivot": True},
        "loads": {"damping_b": [0.5, 0.5, 0.5]},
        "inputs": {"ports": ["torque_a"], "parameters": [n for n in BODY_AND_START if n[:3] not in ("pos", "vel")]},
        "run": RUN,
    },
    "default": {"body": {"mass": 2.0, "inertia": [1.0, 2.0, 2.5]}},
    # start values that .16g loses, a name that is a word of Python's
    "class": {
        "name": "class",
        "body": {"mass": 0.1 + 0.2, "inertia": [1 / 3, 2 / 3, 0.7 + 0.1], "r_oc_b": [0.1 * 3, 5e-324, -1.7e-308]},
        "initial": {"position": [0.1 + 0.7, 123456789.12345679, -1e22], "omega_b": [1e-17, 2 / 3, 4.35]},
        "inputs": {"parameters": ["force_a"]},
        "run": {"start": 0.1 + 0.2, "stop": 1.1, "step": 0.1, "accuracy": 1e-3},
    },
}


NATIVE = {"native": {}, "fmi3": {"fmi": 3}, "fmi3_scalars": {"fmi": 3, "scalars": True}}
"""Arguments of `build` for kinds of native FMU."""
_in_use = ["native"]


def bench(name):
    """The module of a benchmark in examples/."""
    return importlib.import_module(f"examples.benchmarks.{name}")


@cache
def workshop():
    """A folder for the session."""
    folder = Path(tempfile.mkdtemp(prefix="rbfmu-tests-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    for kind in ("python", *NATIVE):
        (folder / kind / "new").mkdir(parents=True)
    return folder


@cache
def scene(name):
    """One of the tables above, or of the shipped scenes by its file's name."""
    if name in TABLES:
        return Scene.from_dict({"name": name} | TABLES[name])
    return load_scene(BRICK if name == "brick" else next(SCENES.rglob(f"{name}.toml")))


@cache
def planned(name):
    return plan(scene(name))


def built(name, kind="python"):
    """The FMU's file."""
    return unzipped(name, kind).with_suffix(".fmu")


def unzipped_at(path, folder):
    with zipfile.ZipFile(path) as archive:
        archive.extractall(folder)
    return folder


def unzipped(name, kind="python"):
    """The FMU's folder."""
    return opened(name, kind).folder


def copied(name, folder):
    """A copy of the pythonfmu FMU's folder, to spoil."""
    return Path(shutil.copytree(unzipped(name), folder))


def opened(name, kind="python"):
    """The FMU's library in this process."""
    return _opened(name, kind)


@cache
def _opened(name, kind):
    path = workshop() / kind / f"{name}.fmu"
    path.write_bytes(_built_once(name, kind).read_bytes())
    return imported(unzipped_at(path, path.with_suffix("")))


def _built_once(name, kind):
    """The file, which all workers of a session share: whoever needs it first builds it."""
    path = SHARED_BY_WORKERS / kind / f"{name}.fmu"
    if not path.exists():
        mine = workshop() / kind / "new" / path.name
        rbfmu_fmu.build(scene(name), mine, kind="native" if kind in NATIVE else kind, **NATIVE.get(kind, {}))
        path.parent.mkdir(parents=True, exist_ok=True)
        mine.replace(path)
    return path


def native(name="driven"):
    """The library of the native FMU that is in use."""
    return opened(name, _in_use[-1])


@pytest.fixture(params=["native", "fmi3"])
def each_version(request):
    """Native FMUs of one version of FMI and of the other, with arrays, in use in turn."""
    _in_use.append(request.param)
    yield request.param
    _in_use.pop()


def started(values=(), name="driven"):
    """An instance of a native FMU that is ready to step."""
    return native(name).started(values)


class Kernels:
    """The unit's kernels on a buffer, by the FMU's variable names."""

    def __init__(self, name, values=()):
        self.unit, self.z = planned(name).kernels, filled_buffer(scene(name), planned(name))
        variables = describe(scene(name), planned(name)).variables
        self.places = {v.name: v.offset for v in variables}
        self.wanted = [v.offset for v in variables if v.causality == "output"]
        self.set(dict(values))
        initialize(scene(name), self.unit, self.z)

    def set(self, values):
        for name, value in values.items():
            self.z[self.places[name]] = value

    def step(self, size):
        assert self.unit.step(self.z, size) == 0

    def outputs(self):
        self.unit.outputs(self.z)
        return self.z[self.wanted].tolist()


def signal(name, steps, seed=1, held=10):
    """Piecewise-constant inputs: a dict for every step."""
    names = [v.name for v in describe(scene(name), planned(name)).variables if v.causality == "input"]
    levels = np.random.default_rng(seed).normal(size=(-(-steps // held), len(names)))
    return [dict(zip(names, levels[k // held].tolist(), strict=True)) for k in range(steps)]


def run_case(case, *arguments, **environment):
    """Run a case of fmu_cases.py in a process of its own, in a folder of its own, where rbfmu cannot be imported.

    It must end well; (what it printed last, as JSON; its stderr).
    """
    module = "tests.support.fmu.fmu_cases"
    command = [sys.executable, "-E", "-s", "-X", "faulthandler", "-m", module, case, *map(str, arguments)]
    environment = os.environ | {"NUMBA_CACHE_DIR": str(workshop() / "numba")} | environment
    with tempfile.TemporaryDirectory() as folder:
        copy_modules(folder, "fmu_cases", "fmu_importer", "fmu_importer3")
        done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, timeout=1200)
    errors = done.stderr.decode(errors="replace")
    assert done.returncode == 0, f"{case} ended with {done.returncode}:\n{errors}"
    return json.loads(done.stdout.decode().splitlines()[-1]), errors
