"""The pythonfmu FMU computes what the kernels compute, to the bit, through a whole life."""

import json
import math
from pathlib import Path
from types import SimpleNamespace
from xml.etree import ElementTree

import pytest

import rbfmu_kernels
from rbfmu_fmu.builder import kernel_sources
from rbfmu_fmu.description import describe
from rbfmu_fmu.python.slave import Slave
from rbfmu_fmu.python.slave_access import TO_VARY, Access
from rbfmu_kernels.buffer import CHANGED
from tests.support.covering import some_of
from tests.support.fmu.beside_kernels import LOADED, assert_same_before_and_after_a_restore
from tests.support.fmu.fmu_importer import DISCARD, FATAL, OK
from tests.support.fmu.fmus import Kernels, opened, planned, scene, signal, unzipped

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


@pytest.mark.parametrize("name", ["class", *some_of(["brick", "driven", "pendulum", "prescribed"], 1)])
def test_every_start_value_is_written_and_read_to_the_bit(name):
    root = ElementTree.parse(unzipped(name) / "modelDescription.xml").getroot()
    start = {v.get("name"): r.get("start") for v in root.iter("ScalarVariable") for r in v.findall("Real")}
    start = {n: float(text) for n, text in start.items() if text is not None}
    assert start == {v.name: v.start for v in describe(scene(name), planned(name)).variables if v.name in start}
    assert float(root.find("DefaultExperiment").get("startTime")) == scene(name).run.start
    instance = opened(name).instance()
    assert instance.get(*start) == list(start.values())
    instance.start()
    assert instance.get(*start) == list(start.values())


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
