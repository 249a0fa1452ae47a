"""The pythonfmu FMU computes what the kernels compute, to the bit, through a whole life."""

import json
import math
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from xml.etree import ElementTree

import numpy as np
import pytest

import rbfmu_kernels
from rbfmu.simulation import simulate
from rbfmu_fmu.builder import kernel_sources
from rbfmu_fmu.demo import ROUND_OFF
from rbfmu_fmu.description import describe
from rbfmu_fmu.python.slave import Slave
from rbfmu_fmu.python.slave_access import TO_VARY, Access
from rbfmu_kernels.buffer import CHANGED
from tests.support.covering import some_of
from tests.support.fmu.beside_kernels import LOADED, assert_same_before_and_after_a_restore
from tests.support.fmu.fmu_importer import DISCARD, FATAL, OK
from tests.support.fmu.fmus import Kernels, built, opened, planned, scene, signal, unzipped

# From CPython 3.13 on ctypes reports that pythonfmu calls the importer's logger while an exception is on its way.
pytestmark = pytest.mark.filterwarnings(
    "ignore:Exception ignored on calling ctypes callback function:pytest.PytestUnraisableExceptionWarning"
)
H = 0.01


@pytest.mark.parametrize("name", some_of(["brick", "driven", "pendulum", "prescribed"], 2))
def test_fmu_is_the_kernels_over_10000_steps_before_and_after_a_restore(name):
    inputs, size = signal(name, 10_000), scene(name).run.step
    instance, kernels = opened(name).started(), Kernels(name)
    state = assert_same_before_and_after_a_restore(instance, kernels, inputs, size, 6000)
    instance.free_state(state)
    instance.free()


def prescribed():
    """What a slave knows of an FMU."""
    return json.loads(json.dumps(describe(scene("prescribed"), planned("prescribed")).to_dict()))


def test_inputs_between_which_something_else_stands_are_not_set_together(tmp_path):
    """As ports of one's own and others; to set them so would set all that lies between to zero."""
    known = prescribed()
    for apart, together in ((0, [0, 1, 2]), (50, [])):
        known["variables"][2]["offset"] += apart
        (tmp_path / "description.json").write_text(json.dumps(known))
        assert Access(str(tmp_path), "").inputs == together


def test_a_state_of_another_fmu_with_as_many_numbers_is_refused(tmp_path):
    (tmp_path / "description.json").write_text(json.dumps(prescribed()))
    one, other = (Access(str(tmp_path), identity) for identity in ("of one", "other."))
    content = bytes(3) + one.start
    assert one.state_content(one.state_head(content) + content) == content
    with pytest.raises(ValueError, match="are no state of this FMU"):
        other.state_content(one.state_head(content) + content)


def test_fmpy_command_line_writes_the_same_bits(tmp_path):
    command = [sys.executable, "-m", "fmpy", "simulate", str(built("brick")), "--output-file", str(tmp_path / "o.csv")]
    command += ["--start-time", "0", "--stop-time", "30", "--output-interval", "0.1"]
    subprocess.run(command, check=True, capture_output=True, cwd=tmp_path)
    rows = np.genfromtxt(tmp_path / "o.csv", delimiter=",", names=True, deletechars="")
    for name, values in simulate(scene("brick")).columns().items():
        assert np.max(np.abs(rows[name] - values)) <= ROUND_OFF, name


def test_reset_forgets_everything():
    instance = opened("driven").started({"mass": 3.0} | LOADED)
    instance.steps(5)
    assert instance.reset() == OK
    instance.start()
    fresh = opened("driven").started()
    assert instance.get("mass", *LOADED) == fresh.get("mass", *LOADED) == [2.0, 0.0, 0.0, 0.0, 0.0]
    assert instance.steps(20) == fresh.steps(20)
    assert instance.serialized(instance.state()) == fresh.serialized(fresh.state())


def test_interleaved_instances_do_not_touch_each_other():
    fmu = opened("driven")
    values = [{"mass": 2.0 + k, "torque_b[2]": 0.1 * k} for k in range(4)]
    alone = [fmu.started(v).steps(30) for v in values]
    together = [fmu.started(v, name=f"number {k}") for k, v in enumerate(values)]
    rows = [[i.steps(1, first=k)[0] for i in together] for k in range(30)]
    assert [list(column) for column in zip(*rows, strict=True)] == alone


def test_start_values_come_back_to_the_bit():
    expected = {
        "mass": 0.1 + 0.2,
        "inertia[1,1]": 1 / 3,
        "inertia[2,2]": 2 / 3,
        "inertia[3,3]": 0.7 + 0.1,
        "r_oc_b[1]": 0.1 * 3,
        "r_oc_b[2]": 5e-324,
        "r_oc_b[3]": -1.7e-308,
        "position_0[1]": 0.1 + 0.7,
        "position_0[2]": 123456789.12345679,
        "position_0[3]": -1e22,
        "omega_b_0[1]": 1e-17,
        "omega_b_0[2]": 2 / 3,
        "omega_b_0[3]": 4.35,
    }
    root = ElementTree.parse(unzipped("class") / "modelDescription.xml").getroot()
    written = {
        v.get("name"): v.find("Real").get("start") for v in root.iter("ScalarVariable") if v.find("Real") is not None
    }
    instance = opened("class").instance()
    assert {name: float(written[name]) for name in expected} == expected
    assert dict(zip(expected, instance.get(*expected), strict=True)) == expected
    assert float(root.find("DefaultExperiment").get("startTime")) == 0.1 + 0.2
    instance.start()
    assert dict(zip(expected, instance.get(*expected), strict=True)) == expected


def test_every_start_value_of_every_scene_is_written_in_full():
    for name in ("brick", "driven", "pendulum", "prescribed"):
        root = ElementTree.parse(unzipped(name) / "modelDescription.xml").getroot()
        start = {v.get("name"): r.get("start") for v in root.iter("ScalarVariable") for r in v.findall("Real")}
        start = {n: float(text) for n, text in start.items() if text is not None}
        assert opened(name).instance().get(*start) == list(start.values())


def test_a_state_of_the_initialisation_goes_on_initialising():
    instance = opened("driven").instance()
    assert instance.setup() == instance.enter() == OK
    assert instance.set({"mass": 3.0}) == OK
    state = instance.state()
    assert instance.exit() == OK
    expected = instance.steps(3)
    assert instance.restore(state) == OK
    assert instance.set({"mass": 4.0}) == OK
    assert instance.set({"mass": 3.0}) == OK
    assert instance.exit() == OK
    assert instance.steps(3) == expected


def test_restored_states_do_not_share_memory():
    instance = opened("driven").started(LOADED)
    state = instance.state()
    before = instance.serialized(state)
    first = instance.steps(10)
    assert instance.restore(state) == OK
    assert instance.steps(10) == first
    assert instance.serialized(state) == before


def test_accelerations_follow_an_input_set_since_the_step():
    instance, kernels = opened("driven").started(), Kernels("driven")
    instance.steps(2)
    for _ in range(2):
        kernels.step(H)
    rest = instance.get("alpha_b[1]", "acceleration[2]", "omega_b[1]", "position[2]")
    assert instance.set(LOADED) == OK
    kernels.set(LOADED)
    names = opened("driven").by_causality["output"]
    assert instance.outputs() == kernels.outputs()
    now = instance.get("alpha_b[1]", "acceleration[2]", "omega_b[1]", "position[2]")
    assert now[0] != rest[0]
    assert now[1] != rest[1]
    assert now[2:] == rest[2:]
    assert instance.get(*names) == instance.outputs()  # one by one, too
    assert [instance.get(name)[0] for name in names] == kernels.outputs()
    assert instance.step(0.02, H) == OK
    kernels.step(H)
    assert instance.outputs() == kernels.outputs()


def test_rates_at_a_port_show_at_once():
    instance = opened("prescribed").started()
    assert instance.set({"omega_b[3]": 2.0}) == OK
    assert instance.get("omega_a[3]") == [2.0]


def test_inputs_keep_their_values_over_steps_and_can_be_set_in_any_order():
    instance, other = opened("two_ports").started(), opened("two_ports").started()
    names = opened("two_ports").by_causality["input"]
    values = dict(zip(names, (0.1, 0.2, 0.3, 0.4, 0.5, 0.6), strict=True))
    assert instance.set(values) == OK
    for name in reversed(names):
        assert other.set({name: values[name]}) == OK
    assert instance.steps(5) == other.steps(5)
    assert instance.get(*names) == other.get(*names) == list(values.values())


def test_outputs_follow_inputs_also_beside_one_and_in_a_state_that_was_saved_before_they_were_read():
    instance = opened("two_ports").started()
    before = instance.outputs()
    assert instance.set({"torque_b[1]": 0.3}) == OK
    saved = instance.state()
    pushed, alpha = instance.get("torque_b[1]", "alpha_b[1]")
    assert pushed == 0.3
    assert alpha == instance.get("alpha_b[1]")[0] != 0.0
    after = instance.outputs()
    assert after != before
    assert instance.restore(saved) == OK
    assert instance.outputs() == after
    instance.free_state(saved)


def test_huge_finite_inputs_are_taken_though_their_sum_is_not_finite():
    instance = opened("driven").started()
    assert instance.set(dict.fromkeys(LOADED, 1e308)) == OK
    assert instance.get(*LOADED) == [1e308] * 4


def test_status_tells_a_refused_step_and_times_past_stop():
    instance, stop, half = opened("class").started(), scene("class").run.stop, 0.5 * scene("class").run.last_time
    assert instance.status() == 0
    assert instance.step(half, half) == OK
    assert instance.status() == 0  # round-off in the importer's clock
    assert instance.step(stop, 0.1) == OK
    assert instance.status() == 2
    assert instance.step(stop + 0.1, math.nan) == DISCARD
    assert instance.status() == 1
    assert instance.step(stop + 0.1, 1e-300) == DISCARD
    assert "the step is too small for this time" in instance.log[-1][-1].decode()
    assert instance.step(stop - 0.2, 0.1) == OK
    assert instance.status() == 0


def test_values_can_be_read_after_termination_and_nothing_set():
    instance = opened("driven").started(LOADED)
    rows = instance.steps(3)
    assert instance.terminate() == OK
    assert instance.outputs() == rows[-1]
    assert instance.set(LOADED) == FATAL
    assert instance.set(dict.fromkeys(instance.fmu.by_causality["input"], 0.0)) == FATAL
    assert instance.step(0.03, H) == FATAL
    assert instance.outputs() == rows[-1]


def test_the_communication_step_may_change_without_a_trace_beyond_the_accuracy():
    coarse, fine, mixed = (opened("driven").started(LOADED) for _ in range(3))
    for k in range(10):
        assert coarse.step(0.1 * k, 0.1) == OK
    fine.steps(100)
    for k, size in enumerate((0.3, 0.01, 0.19, 0.2, 0.3)):
        assert mixed.step(sum((0.3, 0.01, 0.19, 0.2, 0.3)[:k]), size) == OK
    scale = max(map(abs, fine.outputs()))
    for other in (coarse, mixed):
        assert np.max(np.abs(np.subtract(other.outputs(), fine.outputs()))) < scene("driven").run.accuracy * scale


def test_scene_and_plan_lie_in_the_fmu():
    data = json.loads((unzipped("driven") / "resources" / "scene.json").read_text())
    assert type(scene("driven")).from_dict(data["scene"]) == scene("driven")
    assert type(planned("driven")).from_dict(data["plan"]) == planned("driven")


def test_all_kernel_modules_are_shipped():
    package = Path(rbfmu_kernels.__file__).parent
    modules = {path.relative_to(package).as_posix() for path in package.rglob("*.py")} - {"__init__.py"}
    assert kernel_sources().keys() == modules
    (folder,) = (unzipped("driven") / "resources").glob("rbfmu_*")
    assert all((folder / name).read_bytes() == (package / name).read_bytes() for name in modules)


def test_outputs_of_an_fmu_that_was_never_initialised_are_refused_after_terminate_too():
    """2026-11-22: what a failed initialisation had left was read, without a word."""
    fmu = opened("driven")
    instance = fmu.instance()
    assert instance.setup() == OK
    assert instance.enter() == OK
    assert instance.terminate() == OK
    assert instance.get_references([fmu.references["rpy[1]"]])[0] == FATAL
    instance.free()
    found = []
    for ends in (False, True):
        instance = fmu.started()
        assert instance.set({"torque_b[1]": 0.5}) == OK
        assert not ends or instance.terminate() == OK
        found.append(instance.outputs())
        instance.free()
    assert found[0] == found[1]


def test_a_parameter_that_the_model_has_no_place_for_is_told_with_its_value():
    instance = opened("default").instance()
    assert instance.setup() == instance.enter() == OK
    assert instance.set({"omega_b_0[2]": 0.25}) == OK
    assert instance.exit() == FATAL
    said = instance.log[-1][-1].decode()
    assert "omega_b_0[2] = 0.25: expected no rate" in said
    assert 'list "omega_b_0" under parameters' in said


def test_each_event_has_its_own_count():
    unit = SimpleNamespace(
        access=SimpleNamespace(offsets=[0, 1, 2], counts=[3, 4]), _status=1, _z=[0.0] * 3 + [7.0, 8.0]
    )
    assert Slave.get_integer(unit, [5, 3, 4]) == [8, 1, 7]


def test_of_what_was_changed_parameters_alone_are_at_fault():
    """Inputs are there to be changed."""
    variables = [
        {"name": name, "block": name, "causality": causality, "offset": k, "start": 0.0}
        for k, (name, causality) in enumerate([("force", "input"), ("mass", "parameter"), ("c", "parameter")])
    ]
    known = SimpleNamespace(description={"variables": variables, "changed": CHANGED})
    said = Slave._said_of(SimpleNamespace(access=known, _z=[1.0, 2.0, 0.0]), CHANGED, "expected others")
    assert said == f"mass = 2.0: expected others; {TO_VARY % 'mass'}"
