"""What rbfmu's pythonfmu FMU costs beside an empty pythonfmu slave, both measured here and now, in turn.

Per communication step: set all inputs, fmi2DoStep with one substep, get all outputs, called through ctypes with
prepared arrays. First step: from the start of a process to the end of its first step, nothing but ctypes in it.
Exits with status 1 where a goal is missed.
"""

import ctypes
import json
import statistics
import subprocess
import sys
import tempfile
import time
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from pythonfmu.builder import FmuBuilder

import rbfmu
import rbfmu_fmu
from examples.benchmarks.support.goals import Goal, status

GOAL_STEP, GOAL_START = 2.2, 1.5
SCENES = {
    "tumbling brick, no input": {"inertia": [0.0026, 0.0084, 0.0098], "ports": []},
    "triaxial body, 6 inputs": {"inertia": [1.0, 2.0, 2.5], "ports": ["force_a", "torque_b"]},
}
STEP = 0.001

EMPTY = '''"""A slave that does nothing."""
import ctypes

from pythonfmu import Fmi2Causality, Fmi2Slave, Real

ctypes.pythonapi.Py_IncRef(ctypes.py_object(globals()))  # pythonfmu releases it at every instantiation


class {identifier}(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        for name in {inputs!r}:
            self.register_variable(Real(name, causality=Fmi2Causality.input), nested=False)
        for name in {outputs!r}:
            self.register_variable(Real(name, causality=Fmi2Causality.output), nested=False)
        self.values = [0.5] * {count}

    def do_step(self, current_time, step_size):
        return True

    def get_real(self, references):
        return self.values

    def set_real(self, references, values):
        pass
'''

FIRST_STEP = """
import ctypes as c, json, sys, time
from pathlib import Path
library, guid, resources, inputs, outputs, h = json.loads(sys.argv[1])
class Callbacks(c.Structure):
    _fields_ = [(name, c.c_void_p) for name in ("logger", "allocate", "free", "finished", "environment")]
logger = c.CFUNCTYPE(None, c.c_void_p, c.c_char_p, c.c_int, c.c_char_p, c.c_char_p)(lambda *a: None)
callbacks = Callbacks(c.cast(logger, c.c_void_p))
lib = c.CDLL(library)
lib.fmi2Instantiate.restype = c.c_void_p
it = c.c_void_p(lib.fmi2Instantiate(b"it", 1, guid.encode(), resources.encode(), c.byref(callbacks), 0, 0))
zero = c.c_double(0.0)
lib.fmi2SetupExperiment(it, 0, zero, zero, 0, zero)
lib.fmi2EnterInitializationMode(it)
lib.fmi2ExitInitializationMode(it)
n, m = len(inputs), len(outputs)
fine = lib.fmi2SetReal(it, (c.c_uint * n)(*inputs), c.c_size_t(n), (c.c_double * n)())
fine += lib.fmi2DoStep(it, zero, c.c_double(h), 1)
fine += lib.fmi2GetReal(it, (c.c_uint * m)(*outputs), c.c_size_t(m), (c.c_double * m)())
print(time.monotonic() if fine == 0 else "failed")
"""


class Fmu:
    """An unzipped FMU with one running instance: `communicate` is a whole communication step."""

    def __init__(self, path: Path, folder: Path) -> None:
        with zipfile.ZipFile(path) as archive:
            archive.extractall(folder)
        root = ElementTree.parse(folder / "modelDescription.xml").getroot()
        self.names: dict[str, dict[str, int]] = {"input": {}, "output": {}, "parameter": {}}
        for variable in root.iter("ScalarVariable"):
            if variable.find("Real") is not None:
                names = self.names[variable.attrib["causality"]]
                names[variable.attrib["name"]] = int(variable.attrib["valueReference"])
        identifier = next(root.iter("CoSimulation")).attrib["modelIdentifier"]
        (library,) = (folder / "binaries").glob(f"linux*/{identifier}.so")
        inputs, outputs = (list(self.names[c].values()) for c in ("input", "output"))
        self.arguments = [str(library), root.attrib["guid"], (folder / "resources").as_uri(), inputs, outputs, STEP]

    def start(self) -> Callable[[], int]:
        """Instantiate, initialise; the function that takes a communication step and returns the worst status."""
        library, guid, resources, inputs, outputs, _ = self.arguments
        lib = ctypes.CDLL(library)
        self.logger = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 2, ctypes.c_int, *[ctypes.c_void_p] * 2)(_ignore)
        self.callbacks = (ctypes.c_void_p * 5)(ctypes.cast(self.logger, ctypes.c_void_p))
        lib.fmi2Instantiate.restype = ctypes.c_void_p
        arguments = guid.encode(), resources.encode(), ctypes.byref(self.callbacks)
        it = ctypes.c_void_p(lib.fmi2Instantiate(b"it", 1, *arguments, 0, 0))
        zero = ctypes.c_double(0.0)
        lib.fmi2SetupExperiment(it, 0, zero, zero, 0, zero)
        lib.fmi2EnterInitializationMode(it)
        lib.fmi2ExitInitializationMode(it)
        set_real, do_step, get_real = lib.fmi2SetReal, lib.fmi2DoStep, lib.fmi2GetReal
        given, taken = _real_arguments(inputs), _real_arguments(outputs)
        h = ctypes.c_double(STEP)

        def communicate() -> int:
            return set_real(it, *given) or do_step(it, zero, h, 1) or get_real(it, *taken)  # type: ignore[no-any-return]

        return communicate


def _ignore(*arguments: Any) -> None:
    """Log nothing."""


def _real_arguments(references: list[int]) -> tuple[Any, Any, Any]:
    """Return references, their number and values, of fmi2SetReal and fmi2GetReal."""
    n = len(references)
    return (ctypes.c_uint * n)(*references), ctypes.c_size_t(n), (ctypes.c_double * n)(*[0.1] * n)


def _scene(name: str) -> rbfmu.Scene:
    parts = SCENES[name]
    run = {"stop": 1.0, "step": STEP, "accuracy": 1e-3}
    body = {"mass": 2.0, "inertia": parts["inertia"]}
    tables = {"name": "bench", "body": body, "inputs": {"ports": parts["ports"]}, "run": run}
    return rbfmu.Scene.from_dict(tables | {"initial": {"omega_b": [0.1, 0.2, 0.3]}})


def _build_pair(name: str, folder: Path) -> tuple[Fmu, Fmu]:
    """(empty, ours), with the same numbers of inputs and outputs."""
    scene = _scene(name)
    ours = Fmu(rbfmu_fmu.build(scene, folder / "ours.fmu"), folder / "ours")
    inputs, outputs = (list(ours.names[causality]) for causality in ("input", "output"))
    identifier = f"Empty{len(inputs)}x{len(outputs)}"
    script = folder / f"{identifier.lower()}.py"
    script.write_text(EMPTY.format(identifier=identifier, inputs=inputs, outputs=outputs, count=len(outputs)))
    path = FmuBuilder.build_FMU(script, dest=folder / "empty.fmu")
    return Fmu(path, folder / "empty"), ours


def _seconds_per_step(communicate: Callable[[], int], steps: int) -> float:
    bad = 0
    begin = time.perf_counter()
    for _ in range(steps):
        bad |= communicate()
    seconds = time.perf_counter() - begin
    assert not bad
    return seconds / steps


def _seconds_to_first_step(fmu: Fmu) -> float:
    begin = time.monotonic()  # one clock for all processes
    command = [sys.executable, "-c", FIRST_STEP, json.dumps(fmu.arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return float(done.stdout) - begin


def main(repeats: int = 25, steps: int = 2000, starts: int = 9) -> dict[str, dict[str, float]]:
    """Print the table; seconds and ratios by scene."""
    figures = {}
    print(f"{'':26} {'empty slave':>12} {'this FMU':>12} {'ratio':>7}   median of ratios")
    with tempfile.TemporaryDirectory() as folder:
        for number, name in enumerate(SCENES):
            place = Path(folder) / str(number)
            place.mkdir()
            pair = _build_pair(name, place)
            print(f"{name}: {len(pair[1].names['input'])} inputs, {len(pair[1].names['output'])} outputs")
            running = [fmu.start() for fmu in pair]
            costs = [[_seconds_per_step(c, steps) for c in running] for _ in range(repeats)]
            figures[name] = _row("communication step, us", costs, 1e6, "step", GOAL_STEP)
            times = [[_seconds_to_first_step(fmu) for fmu in pair] for _ in range(starts)]
            figures[name] |= _row("first step of a process, ms", times, 1e3, "start", GOAL_START)
    return figures


def _row(text: str, pairs: list[list[float]], scale: float, key: str, goal: float) -> dict[str, float]:
    empty, ours = (min(column) for column in zip(*pairs, strict=True))
    median = statistics.median(b / a for a, b in pairs)
    print(f"  {text:26} {empty * scale:10.2f} {ours * scale:12.2f} {ours / empty:7.2f}   {median:.2f} (goal {goal})")
    return {f"{key}_empty": empty, f"{key}_ours": ours, f"{key}_ratio": ours / empty, f"{key}_median": median}


def goals(by_scene: dict[str, dict[str, float]]) -> list[Goal]:
    """Of the figures that `main` returns."""
    return [
        Goal(f"{scene}, {name}", figures[key], most=most)
        for scene, figures in by_scene.items()
        for name, key, most in (("step", "step_ratio", GOAL_STEP), ("first step", "start_ratio", GOAL_START))
    ]


if __name__ == "__main__":
    raise SystemExit(status(goals(main())))
