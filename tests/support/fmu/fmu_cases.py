"""What may crash a process, each to be run in one of its own by `fmus.run_case`. Needs neither rbfmu nor Numba.

A case gets folders of unzipped FMUs, asserts what must hold, and returns what is to be compared (printed as JSON).
"""

import atexit
import ctypes
import gc
import json
import math
import os
import resource
import shutil
import sys
import tempfile
import zipfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from tests.support.fmu.fmu_importer import DISCARD, FATAL, OK, without
from tests.support.fmu.fmu_importer3 import imported

H = 0.01
NO_REFERENCE = 4294967295


def main(case, *arguments):
    without("rbfmu", "rbfmu_kernels", "rbfmu_fmu")
    print(json.dumps(globals()[case](*arguments)))


def _rows(instance, steps=20, first=0):
    """Outputs at some steps, with inputs (where there are any) that change."""
    rows = []
    for k in range(first, first + steps):
        inputs = instance.fmu.by_causality["input"]
        if inputs:
            assert instance.set({name: math.sin(k + i) for i, name in enumerate(inputs)}) == OK
        assert instance.step(k * H, H) == OK, instance.log
        rows.append(instance.outputs())
    return rows


def rows(*folders):
    """The motions of FMUs that live in one process, a step of each in turn."""
    instances = [imported(folder).started() for folder in folders]
    found = [[] for _ in folders]
    for k in range(20):
        for instance, rows_of_it in zip(instances, found, strict=True):
            rows_of_it += _rows(instance, 1, k)
    return found


def shipped_code_alone(folder):
    """The rows of an FMU where neither Numba, nor llvmlite, nor NumPy can be imported."""
    without("numba", "llvmlite", "numpy")
    return rows(folder)


def rows_and_imports(folder):
    """Its rows, and the modules of interest that the run has imported."""
    found = rows(folder)[0]
    return found, [name for name in ("numba", "numpy", "rbfmu_kernels", "rbfmu") if sys.modules.get(name) is not None]


def refusals(folder):
    """Every way to be refused: what it answered and logged. Afterwards the instance, and others, go on."""
    fmu, found = imported(folder), {}
    expected = rows(folder)[0]
    for name, (phase, wrong, _) in WRONGS.items():
        instance = fmu.instance(name)
        if phase != "instantiated":
            assert instance.setup() == instance.enter() == OK
        if phase == "stepping":
            assert instance.exit() == OK
        before = _reals(instance, phase)
        status = wrong(instance)
        found[name] = {"status": status, "log": [(s, (c or b"").decode(), t.decode()) for s, c, t in instance.log]}
        found[name]["untouched"] = _reals(instance, phase) == before
        instance.log.clear()
        if phase == "stepping":
            assert _rows(instance) == expected, name
        assert instance.reset() == OK
        instance.start()
        assert _rows(instance) == expected, name
        instance.free()
        assert _rows(fmu.started()) == expected, name
    return found


def logged_categories(folder):
    """The categories of what is logged of refused calls, however logging was turned on; None is NULL."""
    fmu = imported(folder)

    def told(instance, call):
        instance.log.clear()
        call(instance)
        return [category and category.decode() for _, category, _ in instance.log]

    def wrong(instance):
        assert instance.enter() == FATAL

    def discarded(instance):
        assert instance.step(0.0, -1.0) == DISCARD
        wrong(instance)

    first = fmu.started()
    found = [told(first, wrong)]
    second = fmu.instance(logging=0)
    second.start()
    assert second.set_debug_logging(1) == OK
    found.append(told(second, wrong))
    found.append(told(second, lambda it: it.lib.fmi2CancelStep(it.component)))
    assert second.set_debug_logging(1, "logStatusDiscard") == OK
    found.append(told(second, discarded))
    assert second.set_debug_logging(0) == OK
    found.append(told(second, discarded))
    return found


def _reals(instance, phase):
    names = instance.fmu.by_causality
    known = instance.get(*names["parameter"], *names["input"])
    return known + (instance.outputs() if phase != "instantiated" else [])


def _bad_parameters(values):
    def wrong(instance):
        right = dict(zip(values, instance.get(*values), strict=True))
        assert instance.set(values) == OK
        assert instance.get(*values) == list(values.values())  # a parameter can be read however the others stand
        status = instance.exit()
        assert instance.set(right) == OK
        return status

    return wrong


def _set(values):
    return lambda instance: instance.set(values)


def _step(size, time=0.0):
    return lambda instance: instance.step(time, size)


_INERTIA = [f"inertia[{pair}]" for pair in ("1,1", "2,2", "3,3", "1,2", "1,3", "2,3")]
WRONGS = {
    "start_time_nan": ("instantiated", lambda i: i.setup(math.nan) or i.enter(),
        "start time = nan: expected a finite number"),
    "start_time_infinite": ("instantiated", lambda i: i.setup(-math.inf) or i.enter(),
        "start time = -inf: expected a finite number"),
    "mass_negative": ("initializing", _bad_parameters({"mass": -1.0}), "mass = -1.0"),
    "mass_zero": ("initializing", _bad_parameters({"mass": 0.0}), "mass = 0.0"),
    "inertia_triangle": ("initializing", _bad_parameters({"inertia[1,1]": 9.0}), "inertia[1,1] = 9.0"),
    "inertia_negative": ("initializing", _bad_parameters({"inertia[2,2]": -1.0}), "inertia[2,2] = -1.0"),
    "inertia_indefinite": ("initializing", _bad_parameters({"inertia[1,2]": 100.0}), "inertia[1,2] = 100.0"),
    "inertia_zero": ("initializing", _bad_parameters(dict.fromkeys(_INERTIA, 0.0)), "inertia[1,1] = 0.0"),
    "quaternion_zero": ("initializing", _bad_parameters({f"quaternion_0[{i}]": 0.0 for i in (1, 2, 3, 4)}),
        "quaternion_0[1] = 0.0"),
    "damping_negative": ("initializing", _bad_parameters({"damping_b[1]": -0.1}), "damping_b[1] = -0.1"),
    "parameter_nan": ("initializing", _set({"mass": math.nan}), "mass = nan"),
    "parameter_infinite": ("instantiated", _set({"gravity_a[3]": -math.inf}), "gravity_a[3] = -inf"),
    "input_nan": ("stepping", _set({"torque_b[2]": math.nan}), "torque_b[2] = nan"),
    "all_inputs_nan": ("stepping", lambda i: i.set(dict.fromkeys(i.fmu.by_causality["input"], math.nan)),
        "force_a[1] = nan"),
    "input_infinite": ("stepping", _set({"force_a[1]": math.inf}), "force_a[1] = inf"),
    "parameter_while_stepping": ("stepping", _set({"mass": 3.0}), "parameter mass cannot be set while stepping"),
    "start_while_stepping": ("stepping", _set({"omega_b_0[1]": 3.0}),
        "parameter omega_b_0[1] cannot be set while stepping"),
    "input_and_parameter": ("stepping", _set({"torque_b[1]": 1.0, "mass": 3.0}),
        "parameter mass cannot be set while stepping"),
    "output": ("stepping", _set({"omega_b[1]": 3.0}), "output omega_b[1] cannot be set while stepping"),
    "output_at_first": ("instantiated", _set({"position[2]": 3.0}),
        "output position[2] cannot be set before initialisation"),
    "get_unknown": ("stepping", lambda i: i.get_references([0, NO_REFERENCE])[0],
        "value reference 4294967295 is no Real"),
    "get_just_above": ("stepping", lambda i: i.get_references([i.fmu.references["status"]])[0], "status is no Real"),
    "get_output_at_first": ("instantiated", lambda i: i.get_references([i.fmu.references["position[2]"]])[0],
        "outputs have no values before initialisation"),
    "set_unknown": ("stepping", lambda i: i.set_references([0, NO_REFERENCE], [5.0, 5.0]),
        "value reference 4294967295 is no Real"),
    "get_integer_unknown": ("stepping", lambda i: i.get_integer(0)[0], "force_a[1] is no Integer"),
    "step_zero": ("stepping", _step(0.0), "by 0.0 s refused"),
    "step_negative": ("stepping", _step(-0.01), "by -0.01 s refused"),
    "step_nan": ("stepping", _step(math.nan), "by nan s refused"),
    "step_infinite": ("stepping", _step(math.inf), "by inf s refused"),
    "step_minus_infinite": ("stepping", _step(-math.inf), "by -inf s refused"),
    "time_nan": ("stepping", _step(0.01, math.nan), "from t = nan"),
    "step_out_of_reach": ("stepping", _step(1e300), "by 1e+300 s refused"),
    "step_before_initialisation": ("instantiated", _step(0.01), "no step can be taken before initialisation"),
    "step_in_initialisation": ("initializing", _step(0.01), "no step can be taken in initialisation"),
    "enter_twice": ("stepping", lambda i: i.enter(), "initialisation cannot begin while stepping"),
    "exit_twice": ("stepping", lambda i: i.exit(), "initialisation cannot end while stepping"),
    "exit_before_enter": ("instantiated", lambda i: i.exit(), "initialisation cannot end before initialisation"),
    "state_of_no_bytes": ("stepping", lambda i: i.deserialized(b"")[0], "no state of this FMU"),
    "state_too_short": ("stepping", lambda i: i.deserialized(i.serialized(i.state())[:-1])[0], "no state of this FMU"),
    "state_too_long": ("stepping", lambda i: i.deserialized(i.serialized(i.state()) + b"\0")[0],
        "no state of this FMU"),
    "state_with_a_bit_wrong": ("stepping", lambda i: i.deserialized(_bit_wrong(i.serialized(i.state())))[0],
        "no state of this FMU"),
}  # fmt: skip
"""By name: the phase of an instance, a call that is wrong in it, and a part of what is said."""


def _bit_wrong(content):
    return content[:100] + bytes([content[100] ^ 1]) + content[101:]


def errors_again_and_again(folder):
    """Hundreds of errors in one instance, among live neighbours; everything is freed in the end."""
    fmu = imported(folder)
    neighbour, instance = fmu.started(), fmu.started()
    for k in range(300):
        assert instance.get_references([NO_REFERENCE])[0] == FATAL
        assert instance.set({"mass": math.nan}) == FATAL
        assert instance.deserialized(b"no state")[0] == FATAL
        assert instance.step(0.0, -1.0) == DISCARD
        if k % 50 == 0:
            assert instance.reset() == OK
            instance.start()
        instance.log.clear()
    assert _rows(instance) == _rows(neighbour)
    instance.free()
    neighbour.free()
    gc.collect()
    return _rows(fmu.started()) == rows(folder)[0]


def refused_beside_others(folder):
    """Bytes are refused beside neighbours that are freed without another call; what each was told."""
    fmu = imported(folder)
    instance, *neighbours = [fmu.instance(name, logging=0) for name in ("it", *"abcdefgh")]
    for one in (instance, *neighbours):
        assert one.set_debug_logging(1) == OK
    for neighbour in neighbours:
        assert instance.deserialized(b"no state")[0] == FATAL
        neighbour.free()
    told = [[(category.decode(), text.decode()) for _, category, text in it.log] for it in (instance, *neighbours)]
    instance.free()
    gc.collect()
    (left,) = (sys.modules[name]._LIVE for name in sys.modules if name.endswith(".slave"))
    return told, len(left)


def foreign_state(folder, other):
    """The state of another FMU is refused, and of the same FMU from another folder is not."""
    with tempfile.TemporaryDirectory() as place:
        twin = imported(shutil.copytree(folder, Path(place) / "twin")).started()
        a, b = imported(folder).started(), imported(other).started()
        _rows(twin, 5)
        assert a.restore(b.state()) == FATAL
        assert a.deserialized(b.serialized(b.state()))[0] == FATAL
        assert a.restore(twin.state()) == OK
        assert _rows(a, 5, 5) == _rows(twin, 5, 5)
        for instance in (a, b, twin):
            instance.free()
    return True


def threads(folder):
    """Eight instances in eight threads: the same bits as one after the other."""
    fmu = imported(folder)
    expected = _rows(fmu.started(), 200)
    instances = [fmu.started(name=f"number {k}") for k in range(8)]
    with ThreadPoolExecutor(8) as pool:
        found = list(pool.map(lambda i: _rows(i, 200), instances))
    with ThreadPoolExecutor(8) as pool:  # whole lives in threads
        found += pool.map(lambda k: _rows(fmu.started(name=f"again {k}"), 200), range(8))
    return [rows_of_it == expected for rows_of_it in found]


def threads_from_the_start(folder):
    """The very first instances are made in eight threads at once."""
    fmu = imported(folder)
    with ThreadPoolExecutor(8) as pool:
        found = list(pool.map(lambda k: _rows(fmu.started(name=f"number {k}")), range(8)))
    return found == [found[0]] * 8, found[0]


def released_at_exit(folder, place):
    """Ends badly where pythonfmu's library still holds its interpreter (at `place`, hexadecimal) late in the exit."""
    fmu = imported(folder)
    name = fmu.lib._name
    with open("/proc/self/maps") as file:
        base = min(int(line.split("-")[0], 16) for line in file if line.strip().endswith(name))
    pointer = ctypes.c_void_p.from_address(base + int(place, 16))
    assert not pointer.value
    atexit.register(lambda: os._exit(9) if pointer.value else None)
    fmu.started()
    assert pointer.value
    return True


def cycles(folder, lives="1000"):
    """Growth in MB of a process over lives of an instance, of which each is used, later on every tenth."""
    fmu = imported(folder)
    for k in range(int(lives)):
        instance = fmu.instance()
        if k < 1000 or k % 10 == 0:
            instance.start()
            assert instance.step(0.0, H) == OK
            assert k % 10 or instance.deserialized(instance.serialized(instance.state()))[0] == OK
        instance.free()
        if k == int(lives) // 20:  # after what is done once
            before, counts = _megabytes(), _import_system()
    assert _import_system() == counts
    return _megabytes() - before


def _import_system():
    return list(sys.path), len(sys.modules), len(sys.path_importer_cache)


def _megabytes():
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * resource.getpagesize() / 1e6


def fresh_folders(path):
    """As FMPy does: unzip to a new folder for each run, delete it. Nothing of them stays in sys.path."""
    paths, found = list(sys.path), []
    for _ in range(5):
        with tempfile.TemporaryDirectory() as folder:
            with zipfile.ZipFile(path) as archive:
                archive.extractall(folder)
            instance = imported(folder).started()
            found.append(_rows(instance))
            instance.free()
            assert str(Path(folder, "resources")) not in sys.path_importer_cache
    assert sys.path == paths
    return found


def deleted_folders(first, second):
    """Folders vanish while instances live, before and after initialisation; another copy then serves new ones."""
    expected = rows(first)[0]
    with tempfile.TemporaryDirectory() as place:
        places = [shutil.copytree(f, Path(place) / str(k)) for k, f in enumerate((first, second))]
        fmu, other = map(imported, places)
        running, waiting, neighbour = fmu.started(), fmu.instance(), other.started()
        half = _rows(running, 10)
        _rows(neighbour, 10)
    assert not any(p.exists() for p in places)
    assert half + _rows(running, 10, 10) == expected
    waiting.start()
    assert _rows(waiting) == expected
    _rows(neighbour, 10, 10)
    assert running.reset() == OK
    running.start()
    assert _rows(running) == expected
    for instance in (running, waiting, neighbour):
        instance.free()
    return _rows(imported(first).started()) == expected


def closed_stderr(folder):
    """Errors where nobody reads stderr: a closed pipe, a closed file, none at all."""
    fmu = imported(folder)
    read, write = os.pipe()
    os.close(read)
    statuses = []
    for stderr in (os.fdopen(write, "w"), sys.stderr, None):
        sys.stderr = stderr
        if stderr is sys.__stderr__:
            os.close(2)
        for name, (phase, wrong, _) in WRONGS.items():
            if phase == "stepping":
                instance = fmu.started(name=name)
                statuses.append(wrong(instance))
                instance.free()
    return sorted(set(statuses))


def in_fmpy(path):
    """A run by FMPy, 10 times, where rbfmu is not installed: the last row, and whether all are the same."""
    import fmpy

    runs = [fmpy.simulate_fmu(path, stop_time=0.5, output_interval=0.1).tolist() for _ in range(10)]
    return [list(runs[0][-1]), all(run == runs[0] for run in runs)]


if __name__ == "__main__":
    main(*sys.argv[1:])
