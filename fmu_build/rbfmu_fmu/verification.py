"""Verification of an FMU: it is valid and complete, and agrees with direct calls of the kernels it was made from."""

import json
import tempfile
import zipfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from ctypes import byref
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import fmpy
import numpy as np
from fmpy import fmi1, fmi2
from fmpy.validation import validate_fmu

from rbfmu import Plan, Scene, SceneError, exceptions
from rbfmu.planning.select import plan
from rbfmu.runs.motion import largest_error
from rbfmu.runs.plan import initialize
from rbfmu.scene.section import whole
from rbfmu.types import Array
from rbfmu_fmu import builder, model_description
from rbfmu_fmu.description import Description, describe, input_sizes
from rbfmu_fmu.python.pythonfmu_traps import CRASHES_IN_PATH, clear_error
from rbfmu_kernels.buffer import OK
from rbfmu_kernels.compile.tiered import evaluated, tiered
from rbfmu_kernels.rotations.euler_angles import ZYX, quaternion_from_euler

MAX_STEPS = 10_000
HELD_STEPS = 10
"""The number of communication steps between changes of the inputs."""

_PRINT = fmi2.fmi2CallbackLoggerTYPE(fmi1.printLogMessage)
"""FMPy's own logger for FMI 2.0."""


class VerificationError(ValueError):
    """The error of a file that cannot be verified: it is not an FMU, was not built by rbfmu, or cannot run here."""


@dataclass(frozen=True)
class Verification:
    """The result of a verification: problems in words, and the largest difference of each output from the kernels.

    differences: in the output's unit; to_full: the difference between the planned and the full model under the same
    inputs, as the scene's accuracy counts it; NaN if the full model cannot meet a tenth of the accuracy.
    """

    seed: int
    steps_asked: int
    steps_done: int
    differences: dict[str, float]
    units: dict[str, str]
    problems: tuple[str, ...]
    to_full: float
    accuracy: float

    @property
    def passed(self) -> bool:
        """Return whether there are no problems and no differences, and all steps were taken."""
        same = all(d == 0.0 for d in self.differences.values())
        return same and not self.problems and self.steps_done == self.steps_asked


def verify(path: str | Path, seed: int = 1) -> Verification:
    """Run an FMU in FMPy with seeded piecewise-constant inputs, and compare it with direct calls of the kernels.

    At most 10,000 steps of the scene are taken. Raises VerificationError if the file is not an FMU built by rbfmu, or
    cannot run here.

    Differences must be exactly zero: an FMU runs the same kernels as a direct call, on the same buffer, so that any
    difference is an error of the packing (a wrong place, unit or order of calls) and not of arithmetic. Inputs are
    random, of about 1 m/s2 and 1 rad/s2, since a wrongly connected port shows only if it moves the body.
    """
    path, seed = exceptions.path_of(path), whole(0, 2**63).read(seed, "seed")
    d, problems = _read_scene(path)
    run = d.scene.run
    _check_runs_here(path)
    time = run.grid()[: MAX_STEPS + 1]
    inputs = _signal(d, len(time) - 1, np.random.default_rng(seed))
    try:
        problems += [f"fmpy validate: {text}" for text in validate_fmu(str(path))] + _missing_parts(path, d)
        recorded, log = _run_by_fmpy(path, d, time, inputs)
    except VerificationError:
        raise
    except Exception as error:  # FMPy raises any class
        raise VerificationError(f"{path}: FMPy cannot import it: {type(error).__name__}: {error}") from error
    expected = _run_by_kernels(d, time[: len(recorded)], inputs)
    apart = np.nan_to_num(np.abs(recorded - expected), nan=np.inf, posinf=np.inf).max(axis=0).tolist()
    units = {v.name: v.unit for v in d.outputs} | {count.name: "1" for count in d.counts}
    differences = dict(zip(units, apart, strict=True))
    to_full = _distance_to_full(d, time, inputs, expected)
    if to_full > run.accuracy:
        problems += [f"the planned model is {to_full:.2g} from the full one: accuracy asked {run.accuracy:g}"]
    asked, done, messages = len(time) - 1, len(recorded) - 1, tuple(problems + log)
    return Verification(seed, asked, done, differences, units, messages, to_full, run.accuracy)


def _check_runs_here(path: Path) -> None:
    platforms = fmpy.supported_platforms(str(path))
    if fmpy.platform not in platforms:
        raise VerificationError(f"{path}: built for {', '.join(platforms) or 'other platforms'}, not {fmpy.platform}")
    with zipfile.ZipFile(path) as archive:
        names = archive.namelist()
    if any(name.startswith("resources/pythonfmu/") for name in names):
        check_plain(tempfile.gettempdir())
        if (script := builder.NAME_OF_SCRIPT) not in names:
            raise VerificationError(f"{path}: has no {script}, without which pythonfmu crashes: build it anew")


def check_plain(folder: str) -> None:
    """Raise VerificationError if pythonfmu would crash in this folder for unzipped FMUs."""
    if found := CRASHES_IN_PATH.search(folder):
        expected = "expected a plain path; set TMPDIR to one"
        raise VerificationError(f"FMUs are unzipped to {folder!r}, and pythonfmu crashes at {found[0]!r}: {expected}")


def _read_scene(path: Path) -> tuple[Description, list[str]]:
    """Return an FMU's description, made from the scene and plan in it, and a problem if it has other kernels."""
    try:
        with zipfile.ZipFile(path) as archive:
            data = json.loads(archive.read("resources/scene.json"))
        kernels, tables, planned = data["kernels"], data["scene"], Plan.from_dict(data["plan"])
    except OSError as error:
        raise VerificationError(f"{path}: cannot be read ({error.strerror}): expected an FMU") from None
    except (zipfile.BadZipFile, EOFError):
        raise VerificationError(f"{path}: not an FMU (a zip archive)") from None
    except (KeyError, TypeError, ValueError):
        reason = "not an FMU that rbfmu built, or of another version"
        raise VerificationError(f"{path}: {reason} (no resources/scene.json in it that can be read)") from None
    old = kernels != builder.kernel_hash()
    problems = ["built from other kernels than those installed: build it anew"] if old else []
    scene = Scene.from_dict(tables, source=str(path))
    try:
        return describe(scene, planned), problems
    except (TypeError, ValueError) as error:
        raise VerificationError(f"{path}: another version of rbfmu planned it: {error}") from None


def _missing_parts(path: Path, d: Description) -> list[str]:
    """Return problems in words: variables, units and dependencies that an importer needs and does not find."""
    model = fmpy.read_model_description(str(path), validate=False)
    found, version = {v.name: v for v in model.modelVariables}, version_in(model)
    names = {variable.name: k for k, variable in enumerate(version.references(d))}
    problems = [f"variable {name} is missing" for name in sorted({*names} - {*found})]
    wrong = [found[name] for name, k in names.items() if name in found and found[name].valueReference != k]
    problems += [f"variable {v.name} has the value reference {v.valueReference}, not {names[v.name]}" for v in wrong]
    problems += [f"variable {v.name} has no unit" for v in found.values() if v.type == version.real and not v.unit]
    outputs = {v.name for v in found.values() if v.causality == "output"}
    for kind, listed in _with_dependencies(path, model).items():
        problems += [f"{n} is not among the {kind} with dependencies" for n in sorted(outputs - listed)]
    return problems


def _with_dependencies(path: Path, model: fmpy.model_description.ModelDescription) -> dict[str, set[str]]:
    """Return the names of variables with listed dependencies; older FMPy reads a missing list as no dependency."""
    with zipfile.ZipFile(path) as archive:
        root = ElementTree.fromstring(archive.read("modelDescription.xml"))
    nested = version_in(model).nested
    key, within = ("index", "s/Unknown") if nested else ("valueReference", "")
    names = {str(k if nested else v.valueReference): v.name for k, v in enumerate(model.modelVariables, start=1)}
    return {
        kind: {names[u.attrib[key]] for u in root.iterfind(f"ModelStructure/{place}{within}[@dependencies]")}
        for kind, place in (("outputs", "Output"), ("initial unknowns", "InitialUnknown"))
    }


def _signal(d: Description, steps: int, random: np.random.Generator) -> Array:
    """Return piecewise-constant inputs (steps, n): about 1 m/s2 for forces, 1 rad/s2 for torques, 1 rad/s for rates.

    Inputs vary about their start values, as formulas may have no value far from those of your own inputs.
    """
    sizes = input_sizes(d.scene)
    levels = random.normal(size=(steps // HELD_STEPS + 1, len(d.inputs))) * [sizes[v.block] for v in d.inputs]
    return np.repeat(levels + [v.start or 0.0 for v in d.inputs], HELD_STEPS, axis=0)[:steps]


def version_in(model: fmpy.model_description.ModelDescription) -> model_description.FmiVersion:
    """Return the version of FMI of a model, from FMPy's description of it."""
    fmi = 3 if model.fmiVersion.startswith("3") else 2
    return model_description.version_of(fmi, scalars=fmi == 3 and not any(v.dimensions for v in model.modelVariables))


class Unit:
    """One instance of an FMU, of FMI 2 or 3, that is unzipped in a folder.

    fmu: FMPy's instance, for calls that are the same in both versions; messages: the FMU's warnings and errors.
    """

    def __init__(self, folder: str, d: Description):
        model = fmpy.read_model_description(folder, validate=False)
        version = version_in(model)
        causality = [d.variables[variable.elements[0]].causality for variable in version.references(d)]
        self._inputs, self._outputs = ([k for k, c in enumerate(causality) if c == x] for x in ("input", "output"))
        self._old = not version.has_time
        self._counted = () if self._old else (len(d.outputs),)
        self._integers = [*(reference for reference, _ in version.counts(d)), version.status_reference(d)]
        self.messages: list[str] = []
        self.fmu = fmpy.instantiate_fmu(folder, model, "CoSimulation", debug_logging=True, logger=self._log)
        self._get, self._set = (getattr(self.fmu, f"{call}{version.real}") for call in ("get", "set"))
        self._get_integers = getattr(self.fmu, f"get{version.integer}")

    def _log(self, *said: object) -> None:
        """Keep a message; said: status, category and text, and in FMI 2.0 the instance's name before the status.

        A pythonfmu FMU calls this while its own exception is set, with which calls from here fail in Python 3.13.
        """
        clear_error()
        *_, status, _, message = said
        if status and isinstance(message, bytes):
            self.messages.append(message.decode())

    def start(self, begin: float, end: float, inputs: Sequence[float]) -> None:
        """Initialise the instance with these inputs; begin, end: the times of the run, s."""
        if self._old:
            self.fmu.setupExperiment(startTime=begin, stopTime=end)
            self.fmu.enterInitializationMode()
        else:
            self.fmu.enterInitializationMode(startTime=begin, stopTime=end)
        self.set_inputs(inputs)
        self.fmu.exitInitializationMode()

    def set_inputs(self, values: Sequence[float]) -> None:
        """Set all inputs."""
        if self._inputs:
            self._set(self._inputs, list(values))

    def outputs(self) -> list[float]:
        """Return all outputs, the counts of events and, as the last number, `status`."""
        return [*self._get(self._outputs, *self._counted), *self._get_integers(self._integers)]


@contextmanager
def unit_of(path: Path, d: Description) -> Iterator[Unit]:
    """Unzip an FMU and yield an instance of it; free that afterwards."""
    with tempfile.TemporaryDirectory(prefix="rbfmu_", ignore_cleanup_errors=True) as folder:
        fmpy.extract(str(path), folder)
        try:
            unit = Unit(folder, d)
            yield unit
            unit.fmu.freeInstance()
        finally:
            _give_back_logger()


def _give_back_logger() -> None:
    """Let FMPy print messages again: it sends those of all later FMUs of FMI 2.0 to the last logger, gone or not."""
    with suppress(Exception):  # FMPy too goes on without the library that this needs
        from fmpy.logging import addLoggerProxy

        addLoggerProxy(byref(fmi2.fmi2CallbackFunctions(logger=_PRINT)))


def _run_by_fmpy(path: Path, d: Description, time: Array, inputs: Array) -> tuple[Array, list[str]]:
    """Return the outputs, a column each, at each time up to a refused step, and the FMU's messages.

    FMPy's `simulate_fmu` is not used, as it compares times with a relative tolerance of 1e-9.
    """
    with unit_of(path, d) as unit:
        try:
            unit.start(time[0], time[-1], inputs[0].tolist())
            points = [unit.outputs()]
        except fmi1.FMICallException as error:
            reason = "; ".join(unit.messages) or str(error)
            raise VerificationError(f"{path}: refuses to start, perhaps not with another seed: {reason}") from None
        with suppress(fmi1.FMICallException):
            for t, h, now in zip(time.tolist(), np.diff(time).tolist(), inputs.tolist(), strict=False):
                unit.set_inputs(now)
                unit.fmu.doStep(t, h)
                points.append(unit.outputs())
            unit.fmu.terminate()
    rows = np.array(points)
    bad = int(np.count_nonzero(rows[:, -1]))
    return rows[:, :-1], unit.messages + ([f"status was not 0 at {bad} points"] if bad else [])


def _run_by_kernels(d: Description, time: Array, inputs: Array) -> Array:
    """Return the outputs that the kernels compute, a column each, at the same times; NaN from a refused step on."""
    kernels, z, places = d.plan.kernels, np.array(d.start_buffer), [v.offset for v in d.inputs]
    wanted = [*(v.offset for v in d.outputs), *(count.offset for count in d.counts)]
    rows = np.full((len(time), len(wanted)), np.nan)
    for k in range(len(time)):
        z[places] = inputs[max(k - 1, 0)]
        if k == 0:
            initialize(d.scene, kernels, z)
        elif tiered(kernels.step, len(time) - k)(z, time[k] - time[k - 1]) != OK:
            break
        rows[k] = z[wanted]
    return rows


def _distance_to_full(d: Description, time: Array, inputs: Array, planned: Array) -> float:
    """Return the largest difference between the planned and the full model under the same inputs; NaN without plan."""
    scene, accuracy = d.scene, max(d.scene.run.accuracy / 10.0, 1e-12)
    try:
        full = plan(scene.replace(run={"stop": float(time[-1]), "accuracy": accuracy}), full=True)
    except SceneError:
        return np.nan
    rows = _run_by_kernels(describe(scene, full), time, inputs)
    of_events = {f"{name}_time" for name in scene.events}  # a small change may move such a time by a whole turn
    blocks = [v.block for v in d.outputs if v.block not in of_events]
    columns = {name: [k for k, block in enumerate(blocks) if block == name] for name in blocks}
    a, b = ({n: m[: len(planned), c] for n, c in columns.items()} for m in (planned, rows))
    for motion in (a, b):
        if "rpy" in motion:
            angles = motion.pop("rpy")[:, ::-1].tolist()
            motion["quaternion"] = np.array([evaluated(quaternion_from_euler, ZYX, row) for row in angles])
    return largest_error(a, b, tuple(a))
