"""The native FMU's calls obey FMI 2.0: what is refused answers fmi2Error or fmi2Discard, says why, changes nothing."""

import ctypes
import json
import math

import fmpy
import numpy as np
import pytest

from rbfmu_fmu.description import describe
from rbfmu_fmu.model_description import FMI2
from rbfmu_fmu.native import headers, platforms
from rbfmu_fmu.native.platforms import this_platform
from rbfmu_kernels.buffer import FAULTS
from tests.support.fmu.fmu_cases import WRONGS
from tests.support.fmu.fmu_importer import DISCARD, ERROR, FATAL, OK, Memory
from tests.support.fmu.fmus import (
    built,
    each_version,  # noqa: F401
    native,
    opened,
    planned,
    run_case,
    scene,
    started,
    unzipped,
)

H = 0.01


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "types"), [("native", {}), ("fmi3_scalars", {"Real": "Float64", "Integer": "Int32"})])
def test_every_refusal_of_the_pythonfmu_fmu_is_an_error_with_the_same_message_and_leaves_no_trace(kind, types):
    """The case itself asserts that the instance, the same after a reset, and another one go on to the bit."""
    found, errors = run_case("refusals", unzipped("driven", kind))
    assert set(found) == set(WRONGS)
    assert not errors  # it prints nothing
    for case, (_, _, text) in WRONGS.items():
        status = DISCARD if case == "step_out_of_reach" else ERROR
        assert found[case]["status"] == status, case
        assert found[case]["untouched"], case
        ((logged, category, message),) = found[case]["log"]
        assert (logged, category) == (status, "logStatusDiscard" if status == DISCARD else "logStatusError")
        for word, name in types.items():
            text = text.replace(f"is no {word}", f"is no {name}")
        assert text in message, case


NOT_MADE = [
    ("native", {"guid": "{0}"}, "the guid is not that of this FMU"),
    ("native", {"kind": 0}, "for co-simulation"),
    ("native", {"name": None}, "no name"),
    ("native", {"memory": Memory(most=100)}, "no memory"),
    ("fmi3", {"guid": "{0}"}, "fmi3InstantiateCoSimulation: the instantiation token is not that of this FMU"),
    ("fmi3", {"kind": 0}, "fmi3InstantiateModelExchange: this FMU is for co-simulation"),
    ("fmi3", {"name": None}, "no name"),
    ("fmi3", {"events": 1}, "this FMU has no event mode"),
]


def test_an_instance_that_cannot_be_made_is_none_and_says_why():
    for kind, arguments, reason in NOT_MADE:
        instance = opened("driven", kind).instance(**{"name": "it"} | arguments)
        assert not instance.component.value
        ((status, category, message),) = instance.log
        assert (status, category) == (ERROR, b"logStatusError")
        assert reason in message.decode()


def test_null_pointers_are_errors():
    instance, state = started(), started().state()
    for name, *arguments in (
        ("GetReal", None, 1, None), ("SetReal", None, 1, None), ("GetInteger", None, 1, None),
        ("GetString", None, 1, None), ("SetBoolean", None, 1, None), ("SetDebugLogging", 1, 1, None),
        ("SetRealInputDerivatives", None, 1, None, None), ("GetRealOutputDerivatives", None, 1, None, None),
        ("GetFMUstate", None), ("SetFMUstate", None), ("SerializedFMUstateSize", state, None),
        ("SerializeFMUstate", state, None, 0), ("DeSerializeFMUstate", None, 0, None),
        ("GetRealStatus", 2, None), ("GetBooleanStatus", 3, None),
    ):  # fmt: skip
        call = getattr(native().lib, f"fmi2{name}")
        for component in (None, instance.component):
            instance.log.clear()
            assert call(component, *arguments) == ERROR, name
            assert len(instance.log) == (component is not None), name
    assert instance.steps(5) == started().steps(5)


@pytest.mark.usefixtures("each_version")
def test_a_step_from_another_time_is_an_error_and_the_clocks_round_off_is_none():
    instance = started()
    t = 0.0
    for k in range(1000):  # two clocks that differ by round-off
        assert instance.step(t if k % 2 else k * H, H) == OK
        t += H
    for wrong in (10.0 + H, 10.0 - H, 10.0 + 1e-6, 0.0):
        assert instance.step(wrong, H) == ERROR
        assert "where the instance stands" in instance.log[-1][-1].decode()
        assert "(it stands at t = " in instance.log[-1][-1].decode()
    assert instance.step(10.0, H) == OK


@pytest.mark.usefixtures("each_version")
def test_no_step_passes_the_experiments_stop():
    instance = native().instance()
    for wrong in (-0.1, math.nan):
        assert (instance.setup(stop=wrong) or instance.enter()) == ERROR
    assert instance.setup(stop=0.1) == instance.enter() == instance.exit() == OK
    for k in range(10):
        assert instance.step(k * H, H) == OK
    assert instance.step(0.1, H) == ERROR
    assert "the experiment ends before" in instance.log[-1][-1].decode()


@pytest.mark.usefixtures("each_version")
@pytest.mark.parametrize("start", [1e9, 2e9])
def test_a_unix_clocks_times_are_as_strict(start):
    """Within half a step: also that of an importer which adds up."""
    instance = native().instance()
    assert instance.setup(start=start, stop=start + 0.1) == instance.enter() == instance.exit() == OK
    for k in range(5):
        assert instance.step(start + k * H, H) == OK
    for wrong in (start, start + 0.03, start + 0.07, start + 1.0):
        assert instance.step(wrong, H) == ERROR
        assert "where the instance stands" in instance.log[-1][-1].decode()
    for _ in range(5):
        assert instance.step(instance.last_time(), H) == OK
    assert instance.step(start + 0.1, H) == ERROR
    assert "the experiment ends before" in instance.log[-1][-1].decode()
    assert instance.status() == 1


def test_fmpy_ends_a_run_at_a_discarded_step():
    signals = np.array(
        [(0.0, 0.0), (0.5, 0.0), (0.5, 1e300), (1.0, 1e300)], dtype=[("time", "f8"), ("force_b[1]", "f8")]
    )
    said = []

    def logger(environment, name, status, category, message):
        """Keep a message; FMPy, where it is given none, calls one that an earlier run was given and that is gone."""
        said.append(message.decode())

    recorded = fmpy.simulate_fmu(str(built("driven", "native")), stop_time=1.0, output_interval=0.1, input=signals,
                                 output=["status"], logger=logger)  # fmt: skip
    assert "no finite motion" in said[-1]  # though logging is off
    assert recorded["time"][-1] == pytest.approx(0.5)
    assert recorded["status"][-1] == 1


@pytest.mark.thorough
@pytest.mark.usefixtures("each_version")
def test_status_tells_times_past_the_scenes_stop():
    run = scene("class").run
    start, stop = run.start, 0.5 * (run.stop + run.last_time)  # as late as round-off of an importer's clock may be
    instance = native("class").instance()
    assert instance.setup(start=start) == instance.enter() == instance.exit() == OK
    assert instance.step(start, stop - start) == OK
    assert instance.status() == 0
    assert instance.step(stop, 0.1) == OK
    assert instance.status() == 2


@pytest.mark.parametrize(("kind", "refusal"), [("native", ERROR), ("fmi3", ERROR), ("python", FATAL)])
def test_what_the_plan_rests_on_must_keep_its_value(kind, refusal):
    """Of both kinds: they ask when initialisation ends, and say what to list in the scene."""
    instance = opened("earth", kind).instance()
    name, (planned,) = "omega_b_0[3]", instance.get("omega_b_0[3]")
    assert instance.setup() == instance.enter() == OK
    assert instance.set({name: 0.25}) == OK
    assert instance.exit() == refusal
    expected = f'{name} = 0.25: this FMU\'s model was planned for {planned!r} here; list "omega_b_0" under parameters'
    assert any(expected in text.decode() for *_, text in instance.log)
    assert instance.set({name: planned}) == OK
    assert instance.exit() == OK


@pytest.mark.parametrize("value", [
    0.1, 1 / 3, -2.0, 1e16, 123456789012345.0, 12345678901234567.0, 5e-324, 1.7976931348623157e308, 0.0001, 0.00001234,
    100.0, -1e22, math.nan, -math.inf,
])  # fmt: skip
def test_numbers_in_messages_are_pythons_own(value):
    instance = native().instance()
    assert instance.setup() == OK
    if math.isfinite(value):
        assert instance.setup(start=value, stop=value - abs(value)) == ERROR
        assert instance.log[-1][-1].decode().endswith(f"the start, {value!r}")
    else:
        assert instance.setup(start=value) == ERROR
        assert f"= {value!r}:" in instance.log[-1][-1].decode()


def test_every_fault_has_its_words_and_what_is_none_of_them_too():
    """In place of the last one's another text could stand."""
    header = headers.scene_header(describe(scene("prescribed"), planned("prescribed")), FMI2, "")
    assert all(json.dumps(said) in header for _, said in FAULTS.values())
    assert f"UNKNOWN_FAULT = {max(FAULTS) + 1} }};" in header
    assert f'[{max(FAULTS) + 1}] = {{"", "initialisation failed"}},' in header


@pytest.mark.parametrize("kind", ["native", "fmi3"])
@pytest.mark.parametrize("logging", [0, 1])
def test_errors_and_discards_are_logged_whatever_is_turned_on_or_off(kind, logging):
    """FMPy, for one, turns debug logging on where it is asked to; else nobody would know why a run has ended."""
    for switch in ((), (0,), (1,), (1, "logStatusError"), (0, "logStatusError", "logStatusDiscard")):
        instance = opened("driven", kind).instance(logging=logging)
        instance.start()
        assert not switch or instance.set_debug_logging(*switch) == OK
        assert instance.step(0.0, 1e300) == DISCARD
        assert instance.step(0.0, -1.0) == ERROR
        assert [(status, category) for status, category, _ in instance.log] == [
            (DISCARD, b"logStatusDiscard"), (ERROR, b"logStatusError"),
        ]  # fmt: skip


@pytest.mark.parametrize("kind", ["native", "fmi3"])
def test_a_tolerance_that_is_not_the_scenes_accuracy_is_said_to_have_no_effect(kind):
    for tolerance, said in (
        (1e-3, []),
        (1e-9, ["tolerance = 1e-09 has no effect: the accuracy is the scene's, 0.001"]),
    ):
        instance = opened("driven", kind).instance()
        assert instance.setup(tolerance=tolerance) == instance.enter() == OK
        assert [text.decode().split(": ", 1)[1] for _, _, text in instance.log] == said
        assert all(category == b"logStatusWarning" for _, category, _ in instance.log)


def test_unknown_categories_are_an_error_and_no_message_is_a_format_or_names_a_variable():
    instance = started()
    assert instance.set_debug_logging(1, "logAll", "%n%s #r7#") == ERROR
    assert instance.log[-1][-1] == b"fmi2SetDebugLogging: there is no category %%n%%s ##r7##"
    assert instance.set_debug_logging(1, "x" * 5000) == ERROR
    assert len(instance.log[-1][-1]) < 200


# Messages

PROBE = """
static unsigned char told[4 * MESSAGE_SIZE];

static void keep(const Host *host, const char *name, Status status, const char *category, const char *text) {
    (void)host, (void)name, (void)status, (void)category;
    snprintf((char *)told, sizeof told, "%s", text);
}

__attribute__((visibility("default"))) const unsigned char *told_of(const char *text) {
    static Instance m;
    m.host.log = keep;
    refuse(&m, "call", "%s", text);
    return told;
}
"""
"""An importer that keeps what it is told; compiled into messages.c."""


@pytest.mark.thorough
def test_a_message_that_is_too_long_ends_with_its_buffer(tmp_path):
    probed = headers.headers(describe(scene("driven"), planned("driven")), FMI2, "{}")
    probed["instance.h"] = f"#include <stdio.h>\n{platforms.source('instance.h').decode()}{PROBE}"
    library = tmp_path / "messages.so"
    library.write_bytes(platforms.link(["messages.c"], {}, this_platform(), "messages", probed))
    told_of = ctypes.CDLL(str(library)).told_of
    told_of.restype = ctypes.c_char_p
    for size in (0, 1, 1017, 1018, 3000):
        assert told_of(b"x" * size) == (b"call: " + b"x" * size)[:1023]
