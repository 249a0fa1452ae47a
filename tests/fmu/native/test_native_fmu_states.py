"""Saved states of the native FMU: complete, its own, and checked."""

import pytest

from tests.fmu.native.test_native_fmu_calls import ALLOWED, MADE, in_phase
from tests.support.fmu.beside_kernels import LOADED
from tests.support.fmu.fmu_importer import DISCARD, ERROR, OK
from tests.support.fmu.fmus import each_version, native, started  # noqa: F401


def test_a_state_holds_pending_inputs_status_time_and_phase():
    fmu = native()
    instance = fmu.started(LOADED)
    instance.steps(3)
    assert instance.step(0.03, 1e300) == DISCARD
    assert instance.set({"torque_b[1]": 5.0}) == OK  # not yet in the outputs
    saved = instance.serialized(instance.state())
    expected = [instance.status(), instance.terminated(), instance.last_time(), instance.outputs()]
    expected += [instance.get(*LOADED), instance.steps(10, first=3)]
    assert expected[:3] == [1, True, 0.03]
    for other in (fmu.instance(), fmu.started(), instance):  # also one that never was initialised
        code, state = other.deserialized(saved)
        assert code == other.restore(state) == OK
        assert other.serialized(other.state()) == saved
        found = [other.status(), other.terminated(), other.last_time(), other.outputs()]
        assert [*found, other.get(*LOADED), other.steps(10, first=3)] == expected
        assert other.set({"mass": 3.0}) == ERROR  # it is stepping
        assert other.free_state(state) == OK


@pytest.mark.parametrize("phase", ALLOWED)
def test_a_state_of_any_phase_goes_on_from_there(phase):
    state, other = in_phase(phase), started(LOADED)
    code, restored = other.deserialized(state.serialized(state.state()))
    assert code == other.restore(restored) == OK
    assert {call for call in MADE if MADE[call](in_phase_of(state)) == OK} == ALLOWED[phase]
    for call in MADE:
        assert other.restore(restored) == OK
        assert (MADE[call](other) == OK) == (call in ALLOWED[phase]), call


def in_phase_of(instance):
    """A new instance that got its state."""
    other = native().instance()
    code, state = other.deserialized(instance.serialized(instance.state()))
    assert code == other.restore(state) == OK
    return other


@pytest.mark.usefixtures("each_version")
def test_a_state_is_overwritten_where_its_pointer_is_given():
    instance = started(LOADED)
    state = instance.state()
    instance.steps(3)
    same = instance.state_into(state)
    assert same.value == state.value
    expected = instance.steps(5, first=3)
    assert instance.restore(state) == OK
    assert instance.steps(5, first=3) == expected


def test_only_the_instances_own_live_states_are_taken():
    instance, other = started(LOADED), started(LOADED)
    foreign, freed = other.state(), instance.state()
    assert instance.free_state(freed) == OK  # a copy of the pointer stays
    expected = instance.outputs()
    for state in (foreign, freed, type(freed)(8), type(freed)(2**63)):
        assert instance.restore(state) == ERROR
        assert "no saved state of this instance" in instance.log[-1][2].decode()
        assert instance.free_state(state) == ERROR
        assert instance.lib.fmi2SerializeFMUstate(instance.component, state, b"", 0) == ERROR
    assert instance.restore(type(freed)(None)) == ERROR
    assert instance.free_state(type(freed)(None)) == OK  # FMI: ignored
    assert instance.outputs() == expected
    assert other.restore(foreign) == OK


@pytest.mark.usefixtures("each_version")
def test_damaged_bytes_are_no_state():
    instance = started(LOADED)
    content = instance.serialized(instance.state())
    wrongs = [b"", content[:-1], content + b"\0", bytes(len(content)), opened_bytes("pendulum")]
    wrongs += [content[:k] + bytes([content[k] ^ 1]) + content[k + 1 :] for k in range(0, len(content), 97)]
    for wrong in wrongs:
        assert instance.deserialized(wrong)[0] == ERROR
    assert instance.deserialized(content)[0] == OK


def opened_bytes(name):
    instance = started(name=name)
    return instance.serialized(instance.state())


def test_a_buffer_that_is_too_small_is_an_error():
    instance = started()
    state = instance.state()
    size = len(instance.serialized(state))
    assert instance.lib.fmi2SerializeFMUstate(instance.component, state, bytes(size), size - 1) == ERROR
